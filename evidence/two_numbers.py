"""What the two fitted numbers of baselines/multilevel_masses.py are worth, beside other choices.

A variant is log λ = an estimate − a combination of terms. It is fitted and scored on the training
split of 2.0 alone, by what the protocols of 2.0 hold out of it, from the numbers that the baselines
keep of its shapes. A quarter of a minute on one core.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from eigbench.scoring import truth
from eigbench.scoring.metrics import METRICS
from scipy import optimize

from evidence import baseline, markdown
from evidence.timing import progress
from synthnet import recipe
from synthnet.recipe import Fold
from synthnet.recipe.splits import folds, takes

VERSION = "2.0"
PROTOCOLS = {
    "family": "families",
    "resolution": "fine",
    "genus": "handles",
    "boundary": "boundaries",
}
EXACT, OURS = "linear elements, solved exactly", "as it is: two cycles, a and b"


@dataclass(frozen=True, slots=True)
class Variant:
    """A way to fit.

    Parameters
    ----------
    base : ndarray of shape (S, 10)
        Logarithms of estimates times area, of every shape.
    terms : tuple of ndarray of shape (S, 10)
        What is taken off, each times a fitted number.
    each : bool
        Whether every eigenvalue has numbers of its own.
    """

    base: np.ndarray
    terms: tuple[np.ndarray, ...] = ()
    each: bool = False

    def predicted(self, limits: np.ndarray, fitted: np.ndarray, tested: np.ndarray) -> np.ndarray:
        """Return logarithms for the tested shapes, fitted to the others' limits."""
        columns = [[i] for i in range(self.base.shape[1])] if self.each else [slice(None)]
        return np.hstack([self._of(limits, fitted, tested, which) for which in columns])

    def _of(
        self,
        limits: np.ndarray,
        fitted: np.ndarray,
        tested: np.ndarray,
        which: slice | list[int],
    ) -> np.ndarray:
        base, *terms = (part[:, which] for part in (self.base, *self.terms))

        def left(pair: np.ndarray, rows: np.ndarray) -> np.ndarray:
            return base[rows] - sum(w * term[rows] for w, term in zip(pair, terms, strict=True))

        def error(pair: np.ndarray) -> float:
            return float(np.abs(left(pair, fitted) - limits[fitted][:, which]).mean())

        start = (0.5, 1.0)[: len(terms)]
        found = optimize.minimize(error, start, method="Nelder-Mead").x if terms else start
        return left(found, tested)


def measure() -> dict:
    """Return the variants' errors on what is held out, and the two numbers fitted to all shapes."""
    masses, spectra = baseline("multilevel_masses"), baseline("spectrum_mlp").SPECTRA
    kept, limits = baseline("more_numbers").kept(f"{VERSION}/grouped", (*masses.NAMES, *spectra))
    ids = np.unique(truth.load(VERSION, "train").shapes).tolist()
    held_out = trainings(ids)
    ritz, ratio, residual, consistent, lumped = np.split(kept, 5, axis=1)
    pair = masses.fit(kept[:, : len(masses.NAMES)], limits)
    variants = {
        EXACT: Variant(consistent),
        "the mean of both masses, nothing fitted": Variant(
            np.logaddexp(consistent, lumped) - np.log(2)
        ),
        "solved exactly, a alone": Variant(consistent, (consistent - lumped,)),
        OURS: Variant(ritz, (ratio, residual)),
        "two cycles, a alone": Variant(ritz, (ratio,)),
        "two cycles, nothing fitted": Variant(ritz),
        "two cycles, a pair for each eigenvalue": Variant(ritz, (ratio, residual), each=True),
    }
    return {
        "shapes": len(ids),
        "pair": [pair.a, pair.b],
        "variants": [
            {"variant": name, **errors(variant, limits, held_out)}
            for name, variant in progress(variants.items(), "variants")
        ],
    }


def trainings(ids: Sequence[str]) -> dict[str, list[list[np.ndarray]]]:
    """Return, for each training of each protocol, which shapes are fitted and which are tested."""
    definition = recipe.load(VERSION)

    def used(fold: Fold, split: str) -> np.ndarray:
        return np.array([takes(fold, definition, split, id) for id in ids])

    return {
        protocol: [
            [used(fold, "train"), used(fold, "test")] for fold in folds(definition, protocol)
        ]
        for protocol in PROTOCOLS
    }


def errors(
    variant: Variant, limits: np.ndarray, held_out: dict[str, list[list[np.ndarray]]]
) -> dict[str, float]:
    """Return the mean RPD over what each protocol holds out."""
    found = {}
    for protocol, every in held_out.items():
        rpd = []
        for fitted, tested in every:
            logs = variant.predicted(limits, fitted, tested)
            rpd.append(METRICS["rpd"].function(np.sort(np.exp(logs)), np.exp(limits[tested])))
        found[protocol] = float(np.concatenate(rpd).mean())
    return found


def table(data: dict) -> str:
    """Return one row per variant."""
    columns = {"variant": "{variant}"}
    columns |= {header: f"{{{protocol}:.4f}}" for protocol, header in PROTOCOLS.items()}
    return markdown.columns(data["variants"], columns, "lr")


def pair(data: dict) -> str:
    """Return the numbers that are fitted to all shapes."""
    a, b = data["pair"]
    return f"a = {a:.2f} and b = {b:.1f}"


def left(data: dict) -> str:
    """Return which shares of the error of linear elements the two numbers leave."""
    rows = {row["variant"]: row for row in data["variants"]}
    share = {
        name: f"{rows[OURS][name] / rows[EXACT][name]:.0%}".replace("%", " %") for name in PROTOCOLS
    }
    return (
        f"{share['family']} of the error of linear elements on unseen families, "
        f"{share['boundary']} on boundaries, {share['genus']} on handles, and "
        f"{share['resolution']} on fine meshes"
    )
