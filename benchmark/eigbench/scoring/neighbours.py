"""How near the shapes of a test are to those of training: what a test measures."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eigbench.scoring import targets, truth
from eigbench.scoring.names import SURFACE
from eigbench.scoring.training import on_imports
from eigbench.scoring.truth import Truth

SIMILAR = 0.01  # a shape of training within it makes a test one of interpolation


@lru_cache(maxsize=16)
def distances(version: str, protocol: str) -> NDArray[np.float64]:
    """Return the distance of each tested shape to the nearest that may be trained on.

    Parameters
    ----------
    version, protocol : str
        As of :func:`eigbench.scoring.truth.load`.

    Returns
    -------
    ndarray of shape (shapes,), float64
        The largest difference of the logarithms of two spectra, each divided by its geometric
        mean: the largest relative difference, scale apart. Of surfaces where they are known, else
        of the meshes' labels.

    Examples
    --------
    >>> apart = distances("1.0-mini", "grouped")
    >>> len(apart), bool((apart >= 0).all())
    (34, True)
    """
    tested = _shapes(truth.load(version, "test", protocol))
    apart = np.empty(len(tested.ids))
    for training in np.unique(tested.trainings).tolist():
        _, _, name = training.partition("/")
        trained = _shapes(truth.load(version, "train", name))
        mine = tested.trainings == training
        tree = cKDTree(_form(trained))
        apart[mine] = tree.query(_form(tested.take(mine)), p=np.inf)[0]
    return apart


def share(version: str, protocol: str, within: float = SIMILAR) -> str:
    """Return the share of the tested shapes that have one of training within a distance."""
    return f"{100 * np.mean(distances(version, protocol) <= within):.0f} %"


def _shapes(labels: Truth) -> Truth:
    """Return one instance of each shape, with the spectra of the surfaces where they are known."""
    _, first = np.unique(labels.shapes, return_index=True)
    single = labels.take(np.sort(first))
    known = None if on_imports(labels.protocol) else targets.at(single, SURFACE)
    return single if known is None else known


def _form(labels: Truth) -> NDArray[np.float64]:
    """Return the logarithms of spectra without their scale, shape (n, k)."""
    logs = np.log(labels.eigenvalues)
    return np.asarray(logs - logs.mean(axis=1, keepdims=True))
