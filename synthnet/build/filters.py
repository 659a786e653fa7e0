"""Named checks in a fixed order, before and after the eigenvalue solver.

A check looks at a mesh or a spectrum and returns what is wrong, or ``None``. The first
finding rejects the shape; nothing is repaired. To add a check, write it and put it into
its table, with a threshold in :class:`~synthnet.recipe.FilterSettings` that is ``None`` by
default: where it is, the check finds nothing, so recipes without it give the same data.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from synthnet.mesh.geometry import MeshFacts
from synthnet.recipe import FilterSettings
from synthnet.spectrum.rounding import OPERATIONS, UNIT
from synthnet.types import Mesh, Spectrum, Topology

# Of the largest eigenvalue: so far off may another solver's smallest one be, by rounding.
ROUNDING = OPERATIONS * UNIT


def finite(facts: MeshFacts, thresholds: FilterSettings, declared: Topology) -> str | None:
    """All coordinates are finite."""
    bad = int(np.count_nonzero(~np.isfinite(facts.mesh.vertices).all(axis=1)))
    return f"{bad} vertices are not finite" if bad else None


def degenerate_face(facts: MeshFacts, thresholds: FilterSettings, declared: Topology) -> str | None:
    """Every triangle has an altitude above ``thresholds.altitude`` of its longest edge."""
    altitudes = facts.relative_altitudes
    bad = int(np.count_nonzero(altitudes <= thresholds.altitude))
    if not bad:
        return None
    return (
        f"{bad} of {facts.n_faces} faces have altitude / longest edge at most "
        f"{thresholds.altitude:g}, the least {altitudes.min():.3g}"
    )


def duplicate_face(facts: MeshFacts, thresholds: FilterSettings, declared: Topology) -> str | None:
    """No two triangles have the same three corners."""
    bad = facts.n_duplicate_faces
    return f"{bad} faces repeat another" if bad else None


def non_manifold_edge(
    facts: MeshFacts, thresholds: FilterSettings, declared: Topology
) -> str | None:
    """No edge belongs to more than two triangles."""
    bad = int(np.count_nonzero(facts.edge_valences > 2))
    return f"{bad} edges have more than two faces" if bad else None


def components(facts: MeshFacts, thresholds: FilterSettings, declared: Topology) -> str | None:
    """The mesh is connected, with no vertex left over."""
    count = facts.n_components
    return f"{count} components instead of one" if count != 1 else None


def orientation(facts: MeshFacts, thresholds: FilterSettings, declared: Topology) -> str | None:
    """Neighbours turn the same way, and a closed surface encloses a positive volume."""
    if not declared.orientable:
        return None
    if facts.n_repeated_half_edges:
        return f"{facts.n_repeated_half_edges} edges are passed twice in one direction"
    if facts.is_closed and facts.volume <= 0:
        return f"the enclosed volume is {facts.volume:.3g}"
    return None


def euler_characteristic(
    facts: MeshFacts, thresholds: FilterSettings, declared: Topology
) -> str | None:
    """V − E + F is what the family declares."""
    counted, expected = facts.euler_characteristic, declared.euler_characteristic
    return f"Euler characteristic {counted} instead of {expected}" if counted != expected else None


def boundary(facts: MeshFacts, thresholds: FilterSettings, declared: Topology) -> str | None:
    """The boundary has as many curves as the family declares."""
    counted, expected = facts.n_boundaries, declared.boundaries
    return f"{counted} boundary curves instead of {expected}" if counted != expected else None


def non_finite_eigenvalue(spectrum: Spectrum, thresholds: FilterSettings) -> str | None:
    """All eigenvalues are finite."""
    values = np.append(spectrum.eigenvalues, spectrum.trivial)
    bad = int(np.count_nonzero(~np.isfinite(values)))
    return f"{bad} eigenvalues are not finite" if bad else None


def non_positive_eigenvalue(spectrum: Spectrum, thresholds: FilterSettings) -> str | None:
    """The first eigenvalue is positive."""
    first = float(spectrum.eigenvalues[0])
    return f"first eigenvalue is {first:.3g}" if first <= 0 else None


def trivial_eigenvalue(spectrum: Spectrum, thresholds: FilterSettings) -> str | None:
    """The zero eigenvalue is small against the first."""
    ratio = abs(spectrum.trivial) / float(spectrum.eigenvalues[0])
    if ratio <= thresholds.trivial:
        return None
    return f"|lambda_0| / lambda_1 is {ratio:.3g}, above {thresholds.trivial:g}"


def not_ascending(spectrum: Spectrum, thresholds: FilterSettings) -> str | None:
    """The eigenvalues do not decrease."""
    bad = int(np.count_nonzero(np.diff(spectrum.eigenvalues) < 0))
    return f"{bad} eigenvalues are below the one before" if bad else None


def residual(spectrum: Spectrum, thresholds: FilterSettings) -> str | None:
    """The eigenpairs satisfy the equation."""
    relative = spectrum.certificate.residual
    if relative <= thresholds.residual:
        return None
    return f"relative residual is {relative:.3g}, above {thresholds.residual:g}"


def relative_error(spectrum: Spectrum) -> float:
    """Return the largest bound of an eigenvalue's error, relative to it; infinite without one."""
    bounds = spectrum.certificate.error_bound
    if bounds is None:
        return np.inf
    return float(np.max(bounds / spectrum.eigenvalues))


def check_error(spectrum: Spectrum, thresholds: FilterSettings) -> tuple[str, str] | None:
    """Return name and finding if an eigenvalue may be further off than a residual may be.

    Or if one of LaPy's may be, whose rounding is relative to the last eigenvalue: then ``verify``
    could not check the label.
    """
    error = relative_error(spectrum)
    span = float(spectrum.eigenvalues[-1] / spectrum.eigenvalues[0])
    if error <= thresholds.residual < ROUNDING * span:
        return CERTIFICATE, (
            f"the last eigenvalue is {span:.2g} times the first, which another solver would lose "
            "in its rounding: the label could not be verified"
        )
    if error <= thresholds.residual:
        return None
    if np.isinf(error):
        return CERTIFICATE, "rounding on thin triangles leaves no bound of the eigenvalues' errors"
    return CERTIFICATE, (
        f"rounding on thin triangles may move an eigenvalue by {error:.2g} of it, more than "
        f"{thresholds.residual:g}"
    )


MESH_CHECKS: dict[str, Callable[[MeshFacts, FilterSettings, Topology], str | None]] = {
    check.__name__: check
    for check in (
        finite,
        degenerate_face,
        duplicate_face,
        non_manifold_edge,
        components,
        orientation,
        euler_characteristic,
        boundary,
    )
}

SOLVER = "solver"  # the reason where the solver itself gave up
CERTIFICATE = "certificate"  # and of one whose spectrum could not be proved complete

SPECTRUM_CHECKS: dict[str, Callable[[Spectrum, FilterSettings], str | None]] = {
    check.__name__: check
    for check in (
        non_finite_eigenvalue,
        non_positive_eigenvalue,
        trivial_eigenvalue,
        not_ascending,
        residual,
    )
}


def check_mesh(
    mesh: Mesh, thresholds: FilterSettings, declared: Topology
) -> tuple[str, str] | None:
    """Return the name and the finding of the first check a mesh fails, or ``None``.

    Parameters
    ----------
    mesh : Mesh
        At the precision it is stored in.
    thresholds : FilterSettings
        The recipe's thresholds.
    declared : Topology
        What the family declares.

    Examples
    --------
    >>> import numpy as np
    >>> from synthnet import recipe
    >>> flat = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]]))
    >>> name, finding = check_mesh(flat, recipe.load("1.0").filters, Topology(1, boundaries=1))
    >>> name
    'degenerate_face'
    """
    facts = MeshFacts(mesh)
    for name, check in MESH_CHECKS.items():
        if finding := check(facts, thresholds, declared):
            return name, finding
    return None


def check_spectrum(spectrum: Spectrum, thresholds: FilterSettings) -> tuple[str, str] | None:
    """Return the name and the finding of the first check a spectrum fails, or ``None``."""
    for name, check in SPECTRUM_CHECKS.items():
        if finding := check(spectrum, thresholds):
            return name, finding
    return None
