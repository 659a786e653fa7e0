"""Named configurations: every row of the paper's Tables 1 to 3, as printed and as it learns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from .model import GCNConfig
from .objective import LOSSES

KNOWN = {
    "loss": tuple(LOSSES),
    "optimiser": ("sgd", "adamw"),
    "schedule": ("constant", "one-cycle", "trapezoid"),
    "isometries": ("stored", "random", "signs"),
}


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """How a network is trained.

    Parameters
    ----------
    model : GCNConfig
        What is trained.
    loss : str
        ``rpd``, ``polar`` or ``l1``: those of :mod:`eigbench.scoring.losses`.
    optimiser : str
        ``sgd`` (with ``momentum``) or ``adamw``.
    learning_rate, momentum, weight_decay : float
        Its settings.
    schedule : str
        ``constant``; ``one-cycle``: a rise over a tenth of the steps, then a cosine to zero; or
        ``trapezoid``: a rise over 300 steps, a plateau to step ``plateau``, a straight fall to a
        share ``floor`` at step ``fall``, and that rate until the training has converged.
    plateau, fall : int
        Steps of a trapezoid.
    floor : float
        Of the rate, what a trapezoid ends with.
    average : bool
        Whether the weights that are validated and kept are a mean of those of all steps, in which
        a step counts by the ninth power of its number: two thirds are of the last tenth.
    converged : float
        Training ends before its epochs once the last quarter of its steps has improved the RPD on
        the validation split by less than this share; 0 for never. A trapezoid has fallen by then.
    epochs, batch_size : int
        An epoch is every instance of the training split once (``stored``), or every shape
        once (``random``), but for what does not fill a last batch.
    vertices : int
        A mesh of n vertices is drawn for a batch with a probability that is proportional to
        min(1, vertices / n), so that a few meshes of 16,000 do not make the cost of a step; an
        epoch has as many draws as that makes shapes. 0: an epoch is a permutation.
    isometries : str
        ``stored``: the dataset's instances. ``random``: a fresh isometry at every visit.
        ``signs``: at every visit the axes are mirrored at random, for a network that turns
        meshes into their principal axes, whose signs may be those of rounding.
    clip : float
        Norm beyond which a gradient is shortened; 0 for never.
    """

    model: GCNConfig = field(default_factory=GCNConfig)
    loss: str = "rpd"
    optimiser: str = "sgd"
    learning_rate: float = 1e-3
    momentum: float = 0.9
    weight_decay: float = 1e-5
    schedule: str = "constant"
    plateau: int = 4500
    fall: int = 7500
    floor: float = 0.05
    average: bool = False
    converged: float = 0.0
    epochs: int = 200
    batch_size: int = 32
    vertices: int = 0
    isometries: str = "stored"
    clip: float = 0.0

    def __post_init__(self) -> None:
        for name, known in KNOWN.items():
            if getattr(self, name) not in known:
                raise ValueError(
                    f"{name} must be one of {', '.join(known)}, got {getattr(self, name)!r}"
                )


# Paper, section 4.2.
TABLE_1 = TrainConfig(learning_rate=1e-3, epochs=200, batch_size=32)
TABLES_2_AND_3 = TrainConfig(learning_rate=1e-4, epochs=400, batch_size=16)

PAPER: dict[str, TrainConfig] = {
    "table1-polar": replace(TABLE_1, loss="polar"),
    "table1-rpd": TABLE_1,
    "table1-l1": replace(TABLE_1, loss="l1"),
    **{
        name: replace(TABLES_2_AND_3, model=GCNConfig(encoding, virtual, blocks))
        for name, encoding, virtual, blocks in (
            ("table2-none-virtual", "none", True, 3),
            ("table2-a", "A", False, 3),
            ("table2-a-virtual", "A", True, 3),
            ("table2-alg", "ALG", False, 3),
            ("table2-alg-virtual", "ALG", True, 3),
            # The rows of Table 3 with three blocks are those above.
            ("table3-a-4", "A", False, 4),
            ("table3-a-5", "A", False, 5),
            ("table3-a-4-virtual", "A", True, 4),
            ("table3-a-5-virtual", "A", True, 5),
        )
    },
}

FALL = 5000  # the step at which the rate has fallen, in every row of the tables


def scale_free(config: TrainConfig) -> TrainConfig:
    """Return the same network and loss in the form that learns.

    The mesh has area 1 and lies in its principal axes; outputs are factors to Weyl's law.
    """
    return replace(
        config,
        model=replace(config.model, scale_free=True, principal_axes=True),
        optimiser="adamw",
        learning_rate=1e-3,
        weight_decay=1e-2,
        schedule="trapezoid",
        plateau=2500,
        fall=FALL,
        floor=0.002,
        average=True,
        converged=0.02,
        epochs=200,
        batch_size=16,
        vertices=1000,
        isometries="signs",
        clip=1.0,
    )


SCALE_FREE = {f"{name}-scale-free": scale_free(config) for name, config in PAPER.items()}
LONG = {  # the paper's best row, for as long as it still improves
    "table2-alg-virtual-long": replace(
        SCALE_FREE["table2-alg-virtual-scale-free"], plateau=6000, fall=10_000, floor=0.01
    )
}
MODERN = replace(  # an earlier schedule of this form, for trials of minutes
    scale_free(TrainConfig()),
    model=GCNConfig("ALG", False, 3, scale_free=True),
    schedule="one-cycle",
    average=False,
    converged=0.0,
    epochs=30,
    vertices=0,
    isometries="random",
)
CONFIGS = {**PAPER, **SCALE_FREE, **LONG, "modern": MODERN}
