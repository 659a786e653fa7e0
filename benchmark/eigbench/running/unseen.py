"""Meshes that nobody has seen: drawn, labelled, and asked among public ones."""

import secrets
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from eigbench.results.timing import takes_longer
from eigbench.running.evaluate import Evaluation
from eigbench.running.meshes import Instances
from eigbench.scoring import targets, truth
from eigbench.scoring.truth import Truth
from synthnet import store
from synthnet.families import FAMILIES
from synthnet.families.limits import Limit
from synthnet.store import StoredDataset
from synthnet.verify import seal

ENOUGH = 5  # batches of each kind: of fewer, their times say nothing
APART = 100  # meshes that are asked by themselves, each of another surface
FRESH = "fresh/"  # before the ids of fresh shapes: the public ones may have the same


class Draws:
    """A fresh sealed draw of each version, which all rows of one command share.

    Its salt is forgotten at once.
    """

    def __init__(self, share: float, folder: Path) -> None:
        self.share = share  # surfaces of each family, as a share of the version's
        self.folder = folder  # an empty directory, which is to be removed when all is done
        self.made: dict[str, StoredDataset] = {}
        self.limits: dict[str, dict[str, Limit]] = {}  # of each version, by group

    def of(self, version: str) -> StoredDataset:
        """Return the draw of a version; the first time, draw and label it."""
        if version not in self.made:
            salt = secrets.token_bytes(seal.SALT_BYTES)
            resolved = seal.sealed_recipe(version, salt, share=self.share)
            seal.make(resolved, root=self.folder)
            self.made[version] = store.open_dataset(resolved.version, self.folder)
        return self.made[version]

    def surfaces(self, public: Truth, fresh: Truth) -> Truth:
        """Return the labels of fresh meshes with the spectra of their surfaces, each found once."""
        limits = self.limits.setdefault(public.version, {})
        group = dict(zip(fresh.shapes.tolist(), fresh.groups.tolist(), strict=True))
        for sample in self.of(public.version).samples():
            mine = group.get(sample.spec.id)
            if mine is not None and mine not in limits:
                family = FAMILIES[sample.spec.family]
                limits[mine] = family.limit_spectrum(sample.spec.parameters)
        return targets.of_surfaces(fresh, {id: limits[mine] for id, mine in group.items()})

    def labels(self, public: Truth) -> Truth:
        """Return the labels of a draw under the protocol of public ones.

        Where the protocol holds something out, it is this part of the draw that is tested.
        """
        return truth.of_dataset(self.of(public.version), "test", public.protocol)


def mixed(public: Truth, fresh: Truth) -> Truth:
    """Return public instances and, behind them, fresh ones, as those of one split.

    Both must have the trainings of one protocol, and be of one target.
    """
    bars = public.bars
    return replace(
        public,
        ids=(*public.ids, *_named(fresh.ids)),
        shapes=np.array([*public.shapes, *_named(fresh.shapes)]),
        groups=np.array([*public.groups, *_named(fresh.groups)]),
        families=np.concatenate([public.families, fresh.families]),
        trainings=np.concatenate([public.trainings, fresh.trainings]),
        eigenvalues=np.concatenate([public.eigenvalues, fresh.eigenvalues]),
        bars=None if bars is None else np.concatenate([bars, fresh.tolerance]),
    )


def mixed_meshes(public: Instances, fresh: Instances) -> Instances:
    """Return the meshes of :func:`mixed`."""
    return Instances(
        {**public.shapes, **{f"{FRESH}{id}": mesh for id, mesh in fresh.shapes.items()}},
        {**public.isometries, **{f"{FRESH}{id}": each for id, each in fresh.isometries.items()}},
    )


def _named(ids: Iterable[str]) -> list[str]:
    """Return the ids of fresh shapes as no public shape has them."""
    return [f"{FRESH}{id}" for id in ids]


def batch_size(declared: int, fresh: Truth) -> int:
    """Return how many meshes a call gets: as declared, or fewer, so that times can be compared."""
    return max(1, min(declared, len(set(fresh.shapes.tolist())) // (2 * ENOUGH)))


def one_per_surface(truth: Truth, most: int = APART) -> NDArray[np.int64]:
    """Return instances that have no surface in common, drawn anew, all of one training set."""
    rng = np.random.default_rng(secrets.randbits(128))
    order = rng.permutation(np.flatnonzero(truth.trainings == rng.choice(truth.trainings)))
    return order[np.sort(np.unique(truth.groups[order], return_index=True)[1])][:most]


def longer(
    seconds: NDArray[np.float64], vertices: NDArray[np.int64], fresh: NDArray[np.bool_]
) -> float | None:
    """Return how many times as long fresh batches take as public ones of as many vertices would.

    What a batch takes is a constant and a multiple of its vertices, by those of public meshes. The
    answer is that of all fresh batches or the median over them, whichever is less: a pause of the
    machine in one batch is no knowledge. All arrays have the shape (batches,). Of too few batches
    of either kind the answer is ``None``.

    Examples
    --------
    >>> vertices = np.arange(1, 13)
    >>> round(longer(vertices * np.repeat([0.5, 2.0], 6), vertices, np.repeat([False, True], 6)), 9)
    4.0
    >>> paused = np.array([1.0] * 11 + [99.0])
    >>> round(longer(paused, np.ones(12), np.repeat([False, True], 6)), 9)
    1.0
    """
    if min(fresh.sum(), (~fresh).sum()) < ENOUGH:
        return None
    terms = np.stack([np.ones(len(vertices)), vertices], axis=1)
    fitted, _ = nnls(terms[~fresh], seconds[~fresh])
    own, expected = seconds[fresh], terms[fresh] @ fitted
    return float(min(own.sum() / expected.sum(), np.median(own / expected)))


def slower(evaluation: Evaluation, instances: Instances, truth: Truth, public: int) -> str:
    """Return what shows that fresh meshes take longer than public ones; or "".

    The first batch of each process may compile code and does not count, nor do copies of shapes.
    The evaluation is of both sets: the first ``public`` instances are the public ones.
    """
    vertices = instances.vertices(truth.ids)
    of_batches = np.array([vertices[chosen].sum() for _, chosen in evaluation.asked])
    fresh = np.array([chosen[0] >= public for _, chosen in evaluation.asked])
    counts = evaluation.new & ~evaluation.opening
    ratio = longer(evaluation.seconds[counts], of_batches[counts], fresh[counts])
    return takes_longer(ratio)
