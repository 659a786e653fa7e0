r"""What a prediction is compared with: the spectrum of the surface, or that of the mesh.

The **mesh** target is the label: the finite element spectrum of the very mesh, as the paper has
it. A solver of the same elements is exact there. The **surface** target is the spectrum of the
smooth or polyhedral surface that the mesh stands for, the limit of ever finer meshes
(:mod:`synthnet.families.limits`); there an exact solver of the mesh has the discretisation error,
and a predictor may be nearer.

Both are known up to a bar. An answer within the bar is exact, and a difference of two predictors
that the bars could make is no difference. The bar of a label is a relative 1e-9, for rounding;
that of a limit is pinned with it.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.names import MESH, SURFACE, TARGETS
from eigbench.scoring.training import on_imports
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.families.limits import Limit
from synthnet.store import pins


def at(truth: Truth, target: str) -> Truth | None:
    """Return labels of meshes with the eigenvalues and bars of one of the :data:`TARGETS`.

    Returns
    -------
    Truth or None
        None for the surfaces of a dataset whose limits are not pinned, such as an import.

    Raises
    ------
    EigbenchError
        If there is no such target, or the pinned limits lack some of the shapes.

    Examples
    --------
    >>> from eigbench.scoring import truth
    >>> labels = truth.load("1.0-mini")
    >>> box = labels.ids.index("rectangular_prism-00008/0")
    >>> labels.eigenvalues[box, :3].round(3), at(labels, "surface").eigenvalues[box, :3].round(3)
    (array([ 9.027, 37.227, 50.571]), array([ 8.932, 35.72 , 50.189]))
    """
    if target not in TARGETS:
        raise EigbenchError(f"target must be {' or '.join(TARGETS)}, got {target!r}")
    if truth.target == target:
        return truth
    if target == MESH:
        raise EigbenchError("the labels of the meshes do not follow from the surfaces'")
    limits = _limits_of(truth)
    if limits is None:
        return None
    base = recipe.load(truth.version).base
    missing = sorted(set(truth.shapes.tolist()) - set(limits))
    if missing:
        raise EigbenchError(
            f"the pinned spectra of the surfaces of {base} lack {len(missing)} shapes of "
            f"{truth.version}, the first {missing[0]}: pin them anew "
            f"(python -m evidence pin limits {base})"
        )
    return of_surfaces(truth, limits)


def every(truth: Truth) -> list[Truth]:
    """Return labels of meshes at each target that is known for them, the meshes' own first."""
    known = (at(truth, target) for target in (MESH, SURFACE))
    return [labels for labels in known if labels is not None]


def of_surfaces(truth: Truth, limits: Mapping[str, Limit]) -> Truth:
    """Return labels of meshes with the spectra of the surfaces of their shapes, by shape."""
    found = [limits[shape] for shape in truth.shapes.tolist()]
    return replace(
        truth,
        target=SURFACE,
        eigenvalues=np.array([limit.eigenvalues for limit in found]),
        bars=np.array([limit.bar for limit in found]),
    )


def _limits_of(truth: Truth) -> dict[str, Limit] | None:
    if truth.version not in recipe.available() or on_imports(truth.protocol):
        return None
    return _pinned(recipe.load(truth.version).base)


@lru_cache
def _pinned(version: str) -> dict[str, Limit] | None:
    return pins.read_limits(version)


def settled(truth: Truth, predictions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return predictions of shape (..., n, k) with those within the bar of the target on it.

    Examples
    --------
    >>> from eigbench.scoring import truth
    >>> labels = truth.load("1.0-mini")
    >>> bool((settled(labels, labels.eigenvalues * (1 + 1e-12)) == labels.eigenvalues).all())
    True
    """
    with np.errstate(invalid="ignore"):
        within = np.abs(predictions - truth.eigenvalues) <= truth.tolerance
    return np.where(within, truth.eigenvalues, predictions)


def floor(truth: Truth, key: str) -> float | None:
    """Return how far a mean score can be off because the target is known up to its bars.

    Returns
    -------
    float or None
        In the metric's unit: what predictions that are off by their bar everywhere would lose.
        None where a perfect score is infinite (PSNR).

    Examples
    --------
    >>> from eigbench.scoring import truth
    >>> bool(floor(at(truth.load("1.0-mini"), "surface"), "rpd") < 1e-4)  # of ten, RPD's largest
    True
    """
    function, g = METRICS[key].function, truth.eigenvalues
    perfect, scored = (function(p, g).mean() for p in (g, g + truth.tolerance))
    return abs(float(perfect - scored)) if np.isfinite(perfect) else None
