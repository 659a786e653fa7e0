"""The metrics, by their public name: the door to :mod:`eigbench.scoring.metrics`."""

from eigbench.scoring.metrics import (
    ACCURATE,
    EPSILON,
    MAIN,
    METRIC_VERSION,
    METRICS,
    Metric,
    inverse_laplacian,
    l1_norm,
    l2_norm,
    polar_loss,
    psnr,
    psnr_above_20,
    relative_percent_difference,
)

__all__ = [
    "ACCURATE",
    "EPSILON",
    "MAIN",
    "METRICS",
    "METRIC_VERSION",
    "Metric",
    "inverse_laplacian",
    "l1_norm",
    "l2_norm",
    "polar_loss",
    "psnr",
    "psnr_above_20",
    "relative_percent_difference",
]
