r"""The noise floor: what the labels score against the spectra of the surfaces themselves.

A label :math:`\lambda_h` is the spectrum of a mesh. Its estimated discretisation error e
(:mod:`synthnet.build.discretisation`) gives the spectrum :math:`\lambda_h - e` of the smooth or
polyhedral surface. The floor of a metric is how far the mean score of the labels, taken as
predictions of :math:`\lambda_h - e`, is from a perfect score. Two predictors that differ by
less differ by less than the labels are off.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.training import IMPORTED
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.store import pins


def floor(truth: Truth, key: str) -> float | None:
    """Return the noise floor of a metric over the given instances.

    Returns
    -------
    float or None
        In the metric's unit, not negative. None where no estimates are pinned for the
        version, or a perfect score is infinite (PSNR).

    Raises
    ------
    EigbenchError
        If the pinned estimates lack some of the shapes.

    Examples
    --------
    >>> from eigbench.scoring import truth
    >>> round(floor(truth.load("1.0-mini"), "rpd"), 3)  # of ten, the sum that RPD is
    0.395
    """
    limits = surface_eigenvalues(truth)
    if limits is None:
        return None
    function = METRICS[key].function
    perfect, scored = (function(p, limits).mean() for p in (limits, truth.eigenvalues))
    return abs(float(perfect - scored)) if np.isfinite(perfect) else None


def surface_eigenvalues(truth: Truth) -> NDArray[np.float64] | None:
    """Return the extrapolated spectra of the surfaces, shape (n, k), in 1/length².

    None where no estimates are pinned for the version.

    Raises
    ------
    EigbenchError
        If the pinned estimates lack some of the shapes.
    """
    if truth.version not in recipe.available() or truth.protocol.startswith(IMPORTED):
        return None
    base = recipe.load(truth.version).base
    pinned = _pinned(base)
    if pinned is None:
        return None
    missing = sorted(set(truth.shapes.tolist()) - set(pinned))
    if missing:
        raise EigbenchError(
            f"the pinned error estimates of {base} lack {len(missing)} shapes of "
            f"{truth.version}, the first {missing[0]}: pin them anew "
            "(python -m evidence pin errors)"
        )
    relative = np.array([pinned[shape] for shape in truth.shapes.tolist()], dtype=np.float64)
    return truth.eigenvalues * (1 - relative)


@lru_cache
def _pinned(version: str) -> dict[str, NDArray[np.float32]] | None:
    return pins.read_errors(version)
