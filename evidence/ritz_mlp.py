"""What makes the difference in baselines/ritz_mlp.py.

Every variant is trained anew on a built 1.0 with a quarter of the epochs, and scored on the
validation split; then each family is left out of training, and scored on its own shapes there.
A quarter of an hour on one core.
"""

import numpy as np
from eigbench.scoring.metrics import METRICS

from evidence import baseline, markdown
from synthnet.families import FAMILIES

KEYS = ("invlap", "rpd", "psnr20")
TRIANGLES = ("log_longest_edges", "log_shortest_edges", "log_triangle_areas", "log_vertices")
WAYS = {"with": "trained on it", "without": "left out", "ritz": "Ritz alone"}


def measure() -> dict:
    """Train and score the variants, and each family left out."""
    data = Data()
    return {"ablations": ablations(data), "left_out": left_out(data)}


class Data:
    """Features and labels of both splits, and a way to fit and score a variant."""

    def __init__(self) -> None:
        self.ritz_mlp, features = baseline("ritz_mlp"), baseline("ritz_features")
        self.names, self.corrected = features.NAMES, features.CORRECTED
        self.ritz = np.arange(len(self.names)) < features.VALUES
        self.every = np.ones(len(self.names), dtype=bool)
        self.epochs = self.ritz_mlp.EPOCHS // 4
        self.families, self.features, self.logs = self.ritz_mlp.read(split="train")
        self.their_families, self.their_features, self.truth = self.ritz_mlp.read(
            split="validation"
        )

    def fit(
        self,
        columns: np.ndarray,
        shapes: np.ndarray | slice = slice(None),
        *,
        onto_ritz: bool = True,
        **settings: int,
    ) -> np.ndarray:
        """Return the logarithms predicted for the validation split."""
        base, theirs = (f[:, : self.corrected] for f in (self.features, self.their_features))
        if not onto_ritz:
            law = np.log(4 * np.pi * np.arange(1, self.corrected + 1))
            base, theirs = np.tile(law, (len(base), 1)), np.tile(law, (len(theirs), 1))
        fitted = self.ritz_mlp.train(
            self.features[shapes][:, columns],
            (self.logs - base)[shapes],
            0,
            **{"epochs": self.epochs, **settings},
        )
        return theirs + self.ritz_mlp.Corrected(fitted).correct(self.their_features[:, columns])


def score(logs: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return metrics of predicted logarithms; none depends on scale."""
    p, g = np.sort(np.exp(logs), axis=1), np.exp(truth)
    return {key: float(METRICS[key].function(p, g).mean()) for key in KEYS}


def ablations(data: Data) -> list[dict]:
    """Return one row per variant."""
    ritz, every = data.ritz, data.every
    triangles = np.isin(data.names, TRIANGLES)
    tenth = np.arange(0, len(data.features), 10)
    variants = {
        f"as it is, but {data.epochs} epochs": data.fit(every),
        "without the Ritz values after the tenth": data.fit(
            every & ~(ritz & (np.arange(len(every)) >= data.corrected))
        ),
        "without moments, volume and distances": data.fit(ritz | triangles),
        "without the sizes of triangles": data.fit(~triangles),
        "one hidden layer": data.fit(every, depth=1),
        "a tenth of the shapes": data.fit(every, tenth),
        "no Ritz values: Weyl's law corrected": data.fit(~ritz, onto_ritz=False),
        "no network: the Ritz values": data.their_features[:, : data.corrected],
        f"as it is, {data.ritz_mlp.EPOCHS} epochs": data.fit(every, epochs=data.ritz_mlp.EPOCHS),
    }
    return [{"variant": name, **score(logs, data.truth)} for name, logs in variants.items()]


def left_out(data: Data) -> list[dict]:
    """Return one row per family: its errors when trained with it, and without it."""
    whole = data.fit(data.every)
    rows = []
    for family in dict.fromkeys(data.families):
        own = data.their_families == family
        without = data.fit(data.every, data.families != family)
        ritz = data.their_features[:, : data.corrected]
        ways = {"with": whole, "without": without, "ritz": ritz}
        rows.append(
            {"family": str(family), "shapes": int(own.sum())}
            | {way: score(logs[own], data.truth[own]) for way, logs in ways.items()}
        )
    return rows


def variants_table(data: dict) -> str:
    """Return one row per variant."""
    columns = {
        "variant": "{variant}",
        "InvLap ↓": "{invlap:.4f}",
        "RPD ↓": "{rpd:.4f}",
        "PSNR>20 ↑": "{psnr20:.2%}",
    }
    return markdown.columns(data["ablations"], columns, "lr")


def left_out_table(data: dict) -> str:
    """Return one row per family."""
    rows = [{**row, "family": FAMILIES[row["family"]].title} for row in data["left_out"]]
    columns = {"family": "{family}", "shapes": "{shapes}"}
    for key, way in WAYS.items():
        columns[f"InvLap, {way}"] = f"{{{key}[invlap]:.4f}}"
        columns[f"PSNR>20, {way}"] = f"{{{key}[psnr20]:.1%}}"
    return markdown.columns(rows, columns, "lr")
