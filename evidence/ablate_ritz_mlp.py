"""What makes the difference in baselines/ritz_mlp.py: docs/data/ritz-mlp.json and docs/learned.md.

    python scripts/ablate_ritz_mlp.py

Every variant is trained anew on a built 1.0 with a quarter of the epochs, and scored on the
validation split; then each family is left out of training, and scored on its own shapes there.
A quarter of an hour on one core.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from tabulate import tabulate

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "baselines"))

import ritz_mlp  # noqa: E402
from eigbench.board.tables import family_title  # noqa: E402
from eigbench.scoring.metrics import METRICS  # noqa: E402
from ritz_features import CORRECTED, NAMES, VALUES  # noqa: E402

from synthnet.store.files import write_marked, write_text  # noqa: E402

RESULT, PAGE = ROOT / "docs" / "data" / "ritz-mlp.json", ROOT / "docs" / "learned.md"
EPOCHS = ritz_mlp.EPOCHS // 4
KEYS = ("invlap", "rpd", "psnr20")
RITZ = np.arange(len(NAMES)) < VALUES
TRIANGLES = np.isin(
    NAMES, ["log_longest_edges", "log_shortest_edges", "log_triangle_areas", "log_vertices"]
)


def score(logs: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return metrics of predicted logarithms; all are free of scale."""
    p, g = np.sort(np.exp(logs), axis=1), np.exp(truth)
    return {key: float(METRICS[key].function(p, g).mean()) for key in KEYS}


class Data:
    """Features and labels of both splits, and a way to fit and score a variant."""

    def __init__(self) -> None:
        self.families, self.numbers, self.logs = ritz_mlp.read(split="train")
        self.of, self.seen, self.wanted = ritz_mlp.read(split="validation")

    def fit(
        self,
        columns: np.ndarray,
        shapes: np.ndarray | slice = slice(None),
        *,
        onto_ritz: bool = True,
        **settings: int,
    ) -> np.ndarray:
        """Return the logarithms predicted for the validation split."""
        base, seen = self.numbers[:, :CORRECTED], self.seen[:, :CORRECTED]
        if not onto_ritz:
            law = np.log(4 * np.pi * np.arange(1, CORRECTED + 1))
            base, seen = np.tile(law, (len(base), 1)), np.tile(law, (len(seen), 1))
        targets = (self.logs - base)[shapes]
        settings = {"epochs": EPOCHS, **settings}
        fitted = ritz_mlp.train(self.numbers[shapes][:, columns], targets, 0, **settings)
        return seen + ritz_mlp.Corrected(fitted).correct(self.seen[:, columns])


def ablations(data: Data) -> list[dict]:
    """Return a row a variant."""
    every = np.ones(len(NAMES), dtype=bool)
    tenth = np.arange(0, len(data.numbers), 10)
    variants = {
        f"as it is, but {EPOCHS} epochs": data.fit(every),
        "without the Ritz values after the tenth": data.fit(
            every & ~(RITZ & (np.arange(len(NAMES)) >= CORRECTED))
        ),
        "without moments, volume and distances": data.fit(RITZ | TRIANGLES),
        "without the sizes of triangles": data.fit(~TRIANGLES),
        "one hidden layer": data.fit(every, depth=1),
        "a tenth of the shapes": data.fit(every, tenth),
        "no Ritz values: Weyl's law corrected": data.fit(~RITZ, onto_ritz=False),
        "no network: the Ritz values": data.seen[:, :CORRECTED],
        f"as it is, {ritz_mlp.EPOCHS} epochs": data.fit(every, epochs=ritz_mlp.EPOCHS),
    }
    return [{"variant": name, **score(found, data.wanted)} for name, found in variants.items()]


def left_out(data: Data) -> list[dict]:
    """Return a row a family: its errors when trained with it, and without it."""
    every = np.ones(len(NAMES), dtype=bool)
    whole = data.fit(every)
    rows = []
    for family in dict.fromkeys(data.families):
        mine = data.of == family
        without = data.fit(every, data.families != family)
        rows.append(
            {
                "family": str(family),
                "shapes": int(mine.sum()),
                "with": score(whole[mine], data.wanted[mine]),
                "without": score(without[mine], data.wanted[mine]),
                "ritz": score(data.seen[mine, :CORRECTED], data.wanted[mine]),
            }
        )
    return rows


def write(found: dict[str, list[dict]]) -> None:
    """Write both tables into the page."""
    parts = {
        "ablation": tabulate(
            [[r["variant"], *cells(r)] for r in found["ablations"]],
            ["variant", "InvLap ↓", "RPD ↓", "PSNR>20 ↑"],
            tablefmt="github",
            disable_numparse=True,
            colalign=["left"] + ["right"] * 3,
        ),
        "left_out": tabulate(
            [
                [family_title(r["family"]), r["shapes"], *(c for k in WAYS for c in pair(r[k]))]
                for r in found["left_out"]
            ],
            [
                "family",
                "shapes",
                *(f"{m}, {w}" for w in WAYS.values() for m in ("InvLap", "PSNR>20")),
            ],
            tablefmt="github",
            disable_numparse=True,
            colalign=["left"] + ["right"] * 7,
        ),
    }
    write_marked(PAGE, **{name: f"\n{table}\n" for name, table in parts.items()})


WAYS = {"with": "trained on it", "without": "left out", "ritz": "Ritz alone"}


def cells(row: dict) -> list[str]:
    """Return the three metrics for a table."""
    return [f"{row['invlap']:.4f}", f"{row['rpd']:.4f}", f"{row['psnr20']:.2%}"]


def pair(row: dict) -> list[str]:
    """Return Inverse Laplacian and PSNR>20 for a table."""
    return [f"{row['invlap']:.4f}", f"{row['psnr20']:.1%}"]


def main() -> None:
    """Train, score, write."""
    data = Data()
    found = {"ablations": ablations(data), "left_out": left_out(data)}
    write_text(RESULT, json.dumps(found, indent=1) + "\n")
    write(found)
    print(f"{RESULT} and {PAGE} written")


if __name__ == "__main__":
    main()
