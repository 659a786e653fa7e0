"""Checks of one shape: against the recipe, the pins, its own certificate and LaPy."""

import importlib
import types
from collections.abc import Iterator, Mapping

import numpy as np
import threadpoolctl
from scipy import linalg

from synthnet import spectrum
from synthnet.arrays import Floats
from synthnet.build import sources
from synthnet.errors import SpectrumError, needed_by
from synthnet.families import FAMILIES
from synthnet.families.limits import Limit
from synthnet.mesh.adjacency import face_components
from synthnet.mesh.geometry import MeshFacts, area
from synthnet.mesh.repair import compact
from synthnet.recipe import Recipe
from synthnet.recipe.drawing import draw_instances
from synthnet.recipe.plan import PlannedShape
from synthnet.spectrum import certificate, solve
from synthnet.store import ImportDescription, limits, pins
from synthnet.store.files import one_line
from synthnet.store.limits import StoredLimit
from synthnet.types import Mesh, Sample, ShapeSpec

VERTEX_TOLERANCE = 1e-6  # of the largest coordinate: float32 keeps 6e-8
ISOMETRY_TOLERANCE = 1e-12  # how far entries may differ: sines do in their last bits
LAPY_TOLERANCE = 1e-8  # relative: how far a stored label may be from LaPy's own solver
OTHER_ROUNDING = 100  # LaPy's rounding may be so many times the largest bound of ours


def check_plan(
    sample: Sample, planned: Mapping[str, PlannedShape], recipe: Recipe
) -> Iterator[str]:
    """Compare ids, parameters, splits and isometries with the recipe's draw."""
    spec = sample.spec
    shape = planned.get(spec.id)
    if shape is None:
        yield f"{spec.id}: not drawn by the recipe"
    elif spec != shape.spec:
        yield f"{spec.id}: parameters differ from the recipe's draw"
    elif (sample.split, sample.paper_splits) != (shape.split, shape.paper_splits):
        yield f"{spec.id}: splits differ from the recipe's"
    else:
        drawn = draw_instances(recipe, spec)
        if sample.isometries.shape != drawn.shape or not np.allclose(
            sample.isometries, drawn, rtol=0, atol=ISOMETRY_TOLERANCE
        ):
            yield f"{spec.id}: isometries differ from the recipe's draw"


def generated_anew(spec: ShapeSpec) -> Mesh:
    """Return the mesh a shape has by its parameters, at the precision of the store."""
    return FAMILIES[spec.family].generate(spec.parameters).stored()


def check_mesh(sample: Sample) -> Iterator[str]:
    """Compare the mesh with one generated anew."""
    spec = sample.spec
    try:
        expected = generated_anew(spec)
    except (KeyError, ValueError) as error:
        yield f"{spec.id}: cannot be generated: {one_line(error)}"
        return
    if not np.array_equal(sample.mesh.faces, expected.faces):
        yield f"{spec.id}: faces differ from those generated anew"
        return
    apart = float(np.abs(sample.mesh.vertices - expected.vertices).max())
    size = float(np.abs(expected.vertices).max())
    if not apart <= VERTEX_TOLERANCE * size:
        off = apart / size
        yield f"{spec.id}: a vertex is {off:.2g} of the size off, more than {VERTEX_TOLERANCE:g}"


def check_certificate(sample: Sample, recipe: Recipe) -> Iterator[str]:
    """Count the eigenvalues below the shift, and below the last gap within the label."""
    id, proof, label = sample.spec.id, sample.certificate, sample.eigenvalues
    limit, pieces = recipe.filters.residual, MeshFacts(sample.mesh).n_components
    if not 0 <= proof.residual <= limit:
        yield f"{id}: residual is {proof.residual:.3g}, not between 0 and {limit:g}"
    if not proof.shift > label[-1] or proof.count < len(label) + pieces:
        yield (
            f"{id}: {proof.count} eigenvalues counted below {proof.shift:g} do not cover "
            f"the label's {len(label)} up to {label[-1]:g}"
        )
    edges = np.concatenate([[0.0], label])
    gaps = np.flatnonzero(np.diff(edges) > solve.NORMAL.gap * edges[1:])
    if len(gaps) == 0:
        yield f"{id}: no label: its eigenvalues are not positive"
        return
    lower = int(gaps[-1])  # eigenvalues of the label below its last gap
    shifts = (proof.shift, float(edges[lower] + edges[lower + 1]) / 2)
    try:
        counts = spectrum.count_below(sample.mesh, *shifts)
    except (SpectrumError, ValueError) as error:
        yield f"{id}: its eigenvalues cannot be counted: {one_line(error)}"
        return
    expectations = ((proof.count, "certificate"), (lower + pieces, "label"))
    for shift, count, (expected, what) in zip(shifts, counts, expectations, strict=True):
        if count != expected:
            yield f"{id}: {count} eigenvalues are below {shift:g}, the {what} has {expected}"


def check_listed(sample: Sample, description: ImportDescription) -> Iterator[str]:
    """Compare an imported shape with what the manifest lists of its file."""
    spec = sample.spec
    listed = description.files.get(spec.id)
    if listed is None:
        yield f"{spec.id}: not in the manifest's list of files"
        return
    if {name: spec.parameters.get(name) for name in listed} != listed:
        yield f"{spec.id}: file or SHA-256 differ from the manifest's list"
    split = sources.split_of(listed["sha256"], description.options["split"])
    expected = (listed["sha256"][:16], split, (split,))
    if (spec.group, sample.split, sample.paper_splits) != expected:
        yield f"{spec.id}: group or splits differ from those of its file"
    if not np.array_equal(sample.isometries, np.eye(3)[None]):
        yield f"{spec.id}: isometries are not the identity alone"


def check_pin(sample: Sample, pinned: Mapping[str, pins.Pin]) -> Iterator[str]:
    """Compare a shape with its pin."""
    expected = pinned.get(sample.spec.id)
    if expected is None:
        yield f"{sample.spec.id}: stored here, but the pinned build rejected it"
        return
    for difference in pins.differences(pins.pin(sample), expected):
        yield f"{sample.spec.id}: {difference}"


def check_label(sample: Sample) -> Iterator[str]:
    """Compare the label and its certificate with LaPy's own solver."""
    k, parts = len(sample.eigenvalues), list(isolated(sample.mesh))
    beyond = sample.certificate.count
    try:
        sizes = [len(part.vertices) for part in parts]
        each = [
            lapy_eigenvalues(part, min(max(k, min(beyond, n - 3)), n - 1))
            for part, n in zip(parts, sizes, strict=True)
        ]
    except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        yield f"{sample.spec.id}: LaPy has no answer: {one_line(error)}"
        return
    independent = np.sort(np.concatenate(each))
    # Next to zero labels are exact to a part of Weyl's k-th eigenvalue, and so is LaPy.
    least = certificate.NEAR_ZERO * 4 * np.pi * k / area(sample.mesh)
    size = np.maximum(independent[:k], least)
    off = np.abs(sample.eigenvalues - independent[:k]) / size
    apart = float(off.max())
    if not apart <= LAPY_TOLERANCE and not _is_rounding(sample, apart, size):
        yield f"{sample.spec.id}: label is {apart:.2g} off LaPy's, more than {LAPY_TOLERANCE:g}"
    below = len(parts) + int(np.count_nonzero(independent < sample.certificate.shift))
    if below != min(sample.certificate.count, len(independent) + len(parts)):
        yield (
            f"{sample.spec.id}: LaPy has {below} eigenvalues below "
            f"{sample.certificate.shift:g}, the certificate has {sample.certificate.count}"
        )


def _is_rounding(sample: Sample, apart: float, size: Floats) -> bool:
    """Return whether a label and LaPy's are apart for no other reason than rounding.

    LaPy's matrices have the same entries as ours, rounded in another way; on thin triangles that
    moves eigenvalues by more than any residual shows, and its iteration then converges to less.
    There the label must be the one computed anew, within the bounds of both. ``apart`` is the
    largest distance from LaPy's eigenvalues, relative to ``size``, (k,), in 1/length².
    """
    k = len(sample.eigenvalues)
    try:
        plain, sharp = (spectrum.compute(sample.mesh, k, sharp=how) for how in (False, True))
    except (SpectrumError, ValueError):
        return False
    bounds = plain.certificate.error_bound, sharp.certificate.error_bound
    if bounds[0] is None or bounds[1] is None:
        return False
    anew = np.abs(sample.eigenvalues - sharp.eigenvalues) <= bounds[0] + LAPY_TOLERANCE * size
    return bool(anew.all() and apart <= OTHER_ROUNDING * (bounds[0] / plain.eigenvalues).max())


def isolated(mesh: Mesh) -> Iterator[Mesh]:
    """Yield each component of a mesh as a mesh; LaPy knows no eigenvalue zero but the first."""
    of_face = face_components(mesh.faces)
    for number in range(int(of_face.max()) + 1):
        yield compact(Mesh(mesh.vertices, mesh.faces[of_face == number]))


def load_lapy() -> types.ModuleType:
    """Import LaPy, or raise :class:`~synthnet.errors.MissingPackageError`."""
    with needed_by("checking labels"):
        return importlib.import_module("lapy")


def lapy_eigenvalues(mesh: Mesh, k: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the first k eigenvalues after zero by LaPy's own solver, on one thread.

    The mesh is scaled to area 1 for it, since the shift next to zero that LaPy solves around is
    a fixed one. Of a mesh that is hardly larger than the basis ARPACK needs, LaPy's matrices are
    solved densely: ARPACK finds no more than n - 1 eigenvalues.
    """
    lapy = load_lapy()
    size = area(mesh)
    vertices = mesh.vertices.astype(np.float64) / np.sqrt(size)
    with threadpoolctl.threadpool_limits(1):
        solver = lapy.Solver(lapy.TriaMesh(vertices, mesh.faces))
        if len(vertices) <= 2 * (k + 1):
            dense = solver.stiffness.toarray(), solver.mass.toarray()
            values = linalg.eigh(*dense, eigvals_only=True)[: k + 1]
        else:
            values, _ = solver.eigs(k + 1, rng=0)
    return np.asarray(values[1:], dtype=np.float64) / size


def check_limits(
    file: str,
    samples: list[Sample],
    rows: list[StoredLimit],
    pinned: Mapping[str, Limit],
    anew: set[str],
) -> Iterator[str]:
    """Compare a shard's limits with their labels, the pins, and some computed anew."""
    if [row.id for row in rows] != [sample.spec.id for sample in samples]:
        yield f"{file}: the limits beside it are of other shapes"
        return
    for sample, row in zip(samples, rows, strict=True):
        label, limit = sample.eigenvalues, Limit(row.eigenvalues, row.bar)
        if not label.shape == row.eigenvalues.shape == row.bar.shape == row.error.shape:
            yield f"{row.id}: {len(row.eigenvalues)} limits of {len(label)} eigenvalues"
            continue
        expected = limits.compare(row.id, label, limit)
        if not (
            np.allclose(row.error, expected.error, rtol=1e-12, atol=1e-14)
            and row.above_20_db == expected.above_20_db
        ):
            yield f"{row.id}: error or PSNR are not those of its label and its limit"
        if row.id in pinned and not _equal(limit, pinned[row.id]):
            yield f"{row.id}: limit or bar are not the pinned ones"
        if row.id in anew:
            yield from _check_anew(sample.spec, limit)


def _equal(a: Limit, b: Limit) -> bool:
    """Return whether two limits are the same, their bars at the precision of the pins."""
    bar, other = (limit.bar.astype(np.float32) for limit in (a, b))
    return np.array_equal(a.eigenvalues, b.eigenvalues) and np.array_equal(bar, other)


def _check_anew(spec: ShapeSpec, stored: Limit) -> Iterator[str]:
    """Compare a limit with one computed anew: they must agree within their bars."""
    try:
        limit = FAMILIES[spec.family].limit_spectrum(spec.parameters, len(stored.eigenvalues))
    except (SpectrumError, ValueError, KeyError) as error:
        yield f"{spec.id}: its limit cannot be computed anew: {one_line(error)}"
        return
    apart = np.abs(stored.eigenvalues - limit.eigenvalues)
    if not (apart <= stored.bar + limit.bar).all():
        off = float((apart / limit.eigenvalues).max())
        yield f"{spec.id}: limit is {off:.2g} off one computed anew, more than the bars say"
