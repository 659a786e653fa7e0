"""Check a built dataset against its manifest, its recipe, the pins and LaPy."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import threadpoolctl
from numpy.typing import NDArray
from scipy import linalg

from synthnet import recipe, spectrum, store
from synthnet.build import estimates, importing
from synthnet.build.discretisation import Estimate, estimate, extrapolate
from synthnet.errors import SpectrumError, StoreError, needed_by
from synthnet.families import FAMILIES
from synthnet.mesh import isometries
from synthnet.mesh.geometry import area
from synthnet.recipe import Recipe
from synthnet.recipe.distributions import ISOMETRIES, generator
from synthnet.recipe.plan import PlannedShape, plan_shards
from synthnet.spectrum import solve
from synthnet.store import pins, storage
from synthnet.store.files import one_line
from synthnet.store.storage import Place
from synthnet.types import Manifest, Mesh, Sample, ShapeSpec, ShardRecord
from synthnet.verify import seal

VERTEX_TOLERANCE = 1e-6  # of the largest coordinate: float32 keeps 6e-8
ISOMETRY_TOLERANCE = 1e-12  # of entries: sines differ in their last bits
LAPY_TOLERANCE = 1e-8  # relative, stored label against LaPy's own solver
ERRORS_MADE_ANEW = 5  # estimates of the sample: a refined mesh costs several labels
ERROR_TOLERANCE = 1e-5  # of an error, as a share of its label; that is good to 1e-6


CHECKS = {  # in order, with what each holds
    "manifest": "the recipe's digest and the counts by family",
    "digests": "SHA-256 of every shard",
    "shards": "schema, page checksums and rows of every shard",
    "recipe": "ids, parameters, splits and isometries, drawn anew or as an import lists them",
    "meshes": "generated anew: faces equal, every vertex to 1e-6",
    "certificates": "residuals, and the eigenvalues counted anew below two shifts",
    "pins": "digests of the pinned build; its vertex moments and eigenvalues to 1e-6",
    "labels": "against LaPy's own solver, to 1e-8",
    "errors": "estimates, where there are any: whole, from their label, some made anew, pins",
}


@dataclass(frozen=True, slots=True)
class Check:
    """The outcome of one check: how many things were looked at, and what differed."""

    name: str
    examined: int
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class VerifyReport:
    """All checks of a dataset."""

    directory: Place
    checks: tuple[Check, ...]

    @property
    def problems(self) -> tuple[str, ...]:
        """Everything that differed."""
        return tuple(problem for check in self.checks for problem in check.problems)


def verify(
    version: str,
    *,
    root: str | os.PathLike[str] | None = None,
    sample: int = 100,
    seed: int = 0,
    on_shard: Callable[[int, int], None] | None = None,
) -> VerifyReport:
    """Verify a dataset on disk.

    Checks, in order: the manifest's recipe; SHA-256 of every shard; schema, page checksums
    and row counts; ids, parameters, splits and isometries against the recipe's own draw;
    every mesh against one generated anew; every certificate, its eigenvalues counted anew;
    digests, vertex moments and labels against the pins of the repository (a scaled version
    and a sealed set have none); labels of a random sample against
    ``lapy.Solver(...).eigs``; the error estimates, where they have been made, against their
    labels, the pins, and some of the sample's made anew.

    Parameters
    ----------
    version : str
        The version.
    root : path, optional
        Directory that holds the versions.
    sample : int
        Shapes whose labels are derived anew.
    seed : int
        Of the random sample.
    on_shard : callable, optional
        Called with the number of shards read and of all shards.

    Raises
    ------
    StoreError
        If the dataset has not been built there or its manifest is damaged.
    """
    imported = store.open_imported(version, root)
    if imported is not None:
        return verify_imported(imported, sample=sample, seed=seed, on_shard=on_shard)
    wanted, dataset = _opened(version, root)
    manifest = dataset.manifest
    planned = {s.spec.id: s for plan in plan_shards(wanted) for s in plan.shapes}
    pinned = pins.read(wanted.base)
    chosen = _choose(manifest, planned, sample, seed)
    found: dict[str, list[str]] = {name: [] for name in CHECKS}
    found["manifest"] += _check_manifest(manifest, wanted)
    estimates_made = estimates.any_made(dataset)
    seen: set[str] = set()
    relabelled = estimated = 0
    pinned_errors = pins.read_errors(wanted.base) or {}
    anew = set(sorted(chosen)[:: max(1, len(chosen) // ERRORS_MADE_ANEW)][:ERRORS_MADE_ANEW])
    for number, record in enumerate(manifest.shards, start=1):
        samples = _read_checked(dataset, record, found)
        if samples is None:
            continue
        for one in samples:
            seen.add(one.spec.id)
            found["recipe"] += _check_plan(one, planned, wanted)
            found["meshes"] += _check_mesh(one)
            found["certificates"] += _check_certificate(one, wanted)
            if pinned is not None:
                found["pins"] += _check_pin(one, pinned)
            if one.spec.id in chosen:
                relabelled += 1
                found["labels"] += _check_label(one)
        if estimates_made:
            try:
                rows = estimates.read_shard(dataset.directory, record)
            except StoreError as error:
                found["errors"].append(str(error))
            else:
                estimated += len(rows)
                found["errors"] += _check_errors(record.file, samples, rows, pinned_errors, anew)
        if on_shard is not None:
            on_shard(number, len(manifest.shards))
    found["recipe"] += _check_complete(seen, manifest, planned)
    if pinned is not None:
        found["pins"] += _check_kept(seen, manifest, set(planned) & set(pinned))
    elif wanted.scale is None and wanted.sealed is None:
        found["pins"].append(f"the repository pins nothing for {wanted.base}")
    examined = {
        "manifest": 1,
        "digests": len(manifest.shards),
        "shards": len(manifest.shards),
        "recipe": len(planned),
        "meshes": len(seen),
        "certificates": len(seen),
        "pins": len(seen & set(pinned or ())),
        "labels": relabelled,
        "errors": estimated,
    }
    checks = tuple(Check(name, examined[name], tuple(p)) for name, p in found.items())
    return VerifyReport(dataset.directory, checks)


def verify_files(version: str, *, root: str | os.PathLike[str] | None = None) -> VerifyReport:
    """Check the files of a dataset, and compute nothing anew: a part of :func:`verify`.

    It finds every byte that has changed since the build, in seconds: the manifest's own
    digest and its recipe's; SHA-256, schema, page checksums and rows of every shard; and
    that the error estimates, where they have been made, are whole and of their shard.

    Raises
    ------
    StoreError
        If the dataset has not been built there or its manifest is damaged.
    """
    dataset = store.open_imported(version, root)
    wanted = None
    if dataset is None:
        wanted, dataset = _opened(version, root)
    shards = dataset.manifest.shards
    made = shards if estimates.any_made(dataset) else ()
    found = {
        "manifest": list(_check_manifest(dataset.manifest, wanted)),
        "digests": [p for s in shards for p in _check_file(dataset.directory / s.file, s)],
        "shards": [p for s in shards for p in _check_shard(dataset.directory / s.file, s)],
        "errors": [p for s in made for p in _check_estimates_file(dataset.directory, s)],
    }
    examined = {"manifest": 1, "errors": len(made)}
    checks = tuple(
        Check(name, examined.get(name, len(shards)), tuple(p)) for name, p in found.items()
    )
    return VerifyReport(dataset.directory, checks)


def _opened(
    version: str, root: str | os.PathLike[str] | None
) -> tuple[Recipe, store.StoredDataset]:
    """Return the recipe and the dataset; of a sealed set its own manifest has the recipe."""
    if recipe.is_sealed(version):
        dataset = store.open_dataset(version, root)
        return seal.recipe_of(dataset), dataset
    return recipe.load(version), store.open_dataset(version, root)


def verify_imported(
    dataset: store.StoredDataset,
    *,
    sample: int = 100,
    seed: int = 0,
    on_shard: Callable[[int, int], None] | None = None,
) -> VerifyReport:
    """Verify a dataset of imported meshes; the files themselves need not be there.

    Checks, in order: that the manifest's digest is that of its options and list of files, and the
    counts by family; SHA-256 of every shard; schema, page checksums and row counts; that every
    file listed is stored or rejected, with its name, hash and split; every certificate, its
    eigenvalues counted anew; labels of a random sample against ``lapy.Solver(...).eigs``.

    Raises
    ------
    StoreError
        If the manifest lists no files, as those before synthnet 0.1 did not.
    """
    manifest = dataset.manifest
    if not {"limits", "files"} <= set(manifest.recipe):
        raise StoreError(
            f"{dataset.directory} was imported by an older synthnet: remove it and import again"
        )
    limits = recipe.load(manifest.recipe["limits"])
    rng = np.random.default_rng(seed)
    chosen = set(rng.choice(manifest.rows, min(sample, manifest.rows), replace=False).tolist())
    ids: list[str] = [rejection.id for rejection in manifest.rejections]
    seen = relabelled = 0
    names = ("manifest", "digests", "shards", "recipe", "certificates", "labels")
    found: dict[str, list[str]] = {name: [] for name in names}
    found["manifest"] += _check_manifest(manifest, None)
    for number, record in enumerate(manifest.shards, start=1):
        for one in _read_checked(dataset, record, found) or ():
            ids.append(one.spec.id)
            found["recipe"] += _check_listed(one, manifest)
            found["certificates"] += _check_certificate(one, limits)
            if seen in chosen:
                relabelled += 1
                found["labels"] += _check_label(one)
            seen += 1
        if on_shard is not None:
            on_shard(number, len(manifest.shards))
    listed = manifest.recipe["files"]
    times = Counter(ids)
    found["recipe"] += [
        f"{id}: {times[id]} times among those stored or rejected"
        for id in sorted({*listed, *times})
        if times[id] != 1
    ]
    many = len(manifest.shards)
    examined = (1, many, many, len(listed), seen, relabelled)
    checks = [Check(n, e, tuple(found[n])) for n, e in zip(names, examined, strict=True)]
    return VerifyReport(dataset.directory, tuple(checks))


def _check_listed(sample: Sample, manifest: Manifest) -> Iterator[str]:
    """Compare a shape with what the manifest lists of its file."""
    spec = sample.spec
    listed = manifest.recipe["files"].get(spec.id)
    if listed is None:
        yield f"{spec.id}: not in the manifest's list of files"
        return
    if {name: spec.parameters.get(name) for name in listed} != listed:
        yield f"{spec.id}: file or SHA-256 differ from the manifest's list"
    split = importing.split_of(listed["sha256"], manifest.recipe["imported"]["split"])
    expected = (listed["sha256"][:16], split, (split,))
    if (spec.group, sample.split, sample.paper_splits) != expected:
        yield f"{spec.id}: group or splits differ from those of its file"
    if not np.array_equal(sample.isometries, np.eye(3)[None]):
        yield f"{spec.id}: isometries are not the identity alone"


def _read_checked(
    dataset: store.StoredDataset, record: ShardRecord, found: dict[str, list[str]]
) -> list[Sample] | None:
    """Return a shard's samples, or ``None`` if it cannot be read; note what is wrong with it."""
    path = dataset.directory / record.file
    found["digests"] += _check_file(path, record)
    try:
        samples = list(store.read_samples(path))
    except StoreError as error:
        found["shards"].append(str(error))
        return None
    found["shards"] += _check_rows(samples, record)
    return samples


def lapy_eigenvalues(mesh: Mesh, k: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the first k eigenvalues after zero by LaPy's own solver, on one thread.

    The mesh is scaled to area 1 for it, since the shift next to zero that LaPy solves around is
    a fixed one. Of a mesh that is hardly larger than the basis ARPACK needs, LaPy's matrices are
    solved densely: ARPACK finds no more than n - 1 eigenvalues.
    """
    with needed_by("checking labels"):
        import lapy
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


def _choose(
    manifest: Manifest, planned: dict[str, PlannedShape], sample: int, seed: int
) -> set[str]:
    kept = sorted(set(planned) - {r.id for r in manifest.rejections})
    rng = np.random.default_rng(seed)
    return set(rng.choice(kept, size=min(sample, len(kept)), replace=False).tolist())


def _check_manifest(manifest: Manifest, wanted: Recipe | None) -> Iterator[str]:
    if wanted is None:  # imported: the manifest alone knows how many
        drawn = dict(manifest.drawn)
        if manifest.recipe_digest != importing.digest_of(dict(manifest.recipe)):
            yield "manifest: its digest is not that of its options and files"
    else:
        drawn = {family: wanted.drawn(family) for family in wanted.families}
        if manifest.recipe_digest != wanted.digest:
            yield "manifest: made from another recipe than this release's"
    for family, expected in drawn.items():
        shards = [s for s in manifest.shards if s.family == family]
        counted = sum(s.rows + len(s.rejections) for s in shards)
        if not counted == manifest.drawn.get(family) == expected:
            yield (
                f"manifest: {family} has {counted} shapes kept or rejected and "
                f"{manifest.drawn.get(family)} drawn, the recipe draws {expected}"
            )


def _check_file(path: Place, record: ShardRecord) -> Iterator[str]:
    if storage.size(path) is None:
        yield f"{record.file}: missing"
    elif (found := storage.sha256(path)) != record.sha256:
        yield f"{record.file}: SHA-256 is {found[:12]}…, the manifest has {record.sha256[:12]}…"


def _check_shard(path: Place, record: ShardRecord) -> Iterator[str]:
    try:
        samples = list(store.read_samples(path))
    except StoreError as error:
        yield str(error)
    else:
        yield from _check_rows(samples, record)


def _check_estimates_file(directory: Place, record: ShardRecord) -> Iterator[str]:
    try:
        estimates.read_shard(directory, record)
    except StoreError as error:
        yield str(error)


def _check_rows(samples: list[Sample], record: ShardRecord) -> Iterator[str]:
    counts = (
        ("rows", len(samples), record.rows),
        ("vertices", sum(len(s.mesh.vertices) for s in samples), record.vertices),
        ("faces", sum(len(s.mesh.faces) for s in samples), record.faces),
    )
    for what, found, expected in counts:
        if found != expected:
            yield f"{record.file}: {found} {what}, the manifest has {expected}"


def _check_plan(sample: Sample, planned: dict[str, PlannedShape], wanted: Recipe) -> Iterator[str]:
    spec = sample.spec
    shape = planned.get(spec.id)
    if shape is None:
        yield f"{spec.id}: not drawn by the recipe"
    elif spec != shape.spec:
        yield f"{spec.id}: parameters differ from the recipe's draw"
    elif (sample.split, sample.paper_splits) != (shape.split, shape.paper_splits):
        yield f"{spec.id}: splits differ from the recipe's"
    else:
        rng = generator(wanted.seed, spec.family, spec.index, ISOMETRIES)
        copies = wanted.augmentation
        drawn = isometries.draw_isometries(copies.rotations, copies.reflections, rng)
        if sample.isometries.shape != drawn.shape or not np.allclose(
            sample.isometries, drawn, rtol=0, atol=ISOMETRY_TOLERANCE
        ):
            yield f"{spec.id}: isometries differ from the recipe's draw"


def generated_anew(spec: ShapeSpec) -> Mesh:
    """Return the mesh a shape has by its parameters, at the precision of the store."""
    return FAMILIES[spec.family].generate(spec.parameters).stored()


def _check_mesh(sample: Sample) -> Iterator[str]:
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


def _check_certificate(sample: Sample, wanted: Recipe) -> Iterator[str]:
    """Count the eigenvalues below the shift, and below the last gap within the label."""
    id, proof, label = sample.spec.id, sample.certificate, sample.eigenvalues
    if not 0 <= proof.residual <= wanted.filters.residual:
        limit = wanted.filters.residual
        yield f"{id}: residual is {proof.residual:.3g}, not between 0 and {limit:g}"
    if not proof.shift > label[-1] or proof.count < len(label) + 1:
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
    sources = ("certificate", "label")
    for shift, count, expected, what in zip(
        shifts, counts, (proof.count, lower + 1), sources, strict=True
    ):
        if count != expected:
            yield f"{id}: {count} eigenvalues are below {shift:g}, the {what} has {expected}"


def _check_complete(
    seen: Iterable[str], manifest: Manifest, planned: dict[str, PlannedShape]
) -> Iterator[str]:
    lost = set(planned) - set(seen) - {r.id for r in manifest.rejections}
    yield from (f"{id}: neither stored nor rejected" for id in sorted(lost))


def _check_kept(seen: set[str], manifest: Manifest, expected: set[str]) -> Iterator[str]:
    rejected = {r.id for r in manifest.rejections}
    for id in sorted(expected - seen):
        how = "rejected" if id in rejected else "missing"
        yield f"{id}: {how} here, but the pinned build kept it"


def _check_pin(sample: Sample, pinned: dict[str, pins.Pin]) -> Iterator[str]:
    expected = pinned.get(sample.spec.id)
    if expected is None:
        yield f"{sample.spec.id}: stored here, but the pinned build rejected it"
        return
    for difference in pins.differences(pins.pin(sample), expected):
        yield f"{sample.spec.id}: {difference}"


def _check_label(sample: Sample) -> Iterator[str]:
    wanted = len(sample.eigenvalues)
    beyond = min(sample.certificate.count, len(sample.mesh.vertices) - 3)
    try:
        found = lapy_eigenvalues(sample.mesh, max(wanted, beyond))
    except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        yield f"{sample.spec.id}: LaPy has no answer: {one_line(error)}"
        return
    # Next to zero labels are exact to a part of Weyl's k-th eigenvalue, and so is LaPy
    least = solve.NEAR_ZERO * 4 * np.pi * wanted / area(sample.mesh)
    off = np.abs(sample.eigenvalues - found[:wanted]) / np.maximum(found[:wanted], least)
    apart = float(off.max())
    if not apart <= LAPY_TOLERANCE:
        yield f"{sample.spec.id}: label is {apart:.2g} off LaPy's, more than {LAPY_TOLERANCE:g}"
    below = 1 + int(np.count_nonzero(found < sample.certificate.shift))
    if below != min(sample.certificate.count, len(found) + 1):
        yield (
            f"{sample.spec.id}: LaPy has {below} eigenvalues below "
            f"{sample.certificate.shift:g}, the certificate has {sample.certificate.count}"
        )


def _check_errors(
    file: str,
    samples: list[Sample],
    rows: list[Estimate],
    pinned: Mapping[str, NDArray[np.float32]],
    anew: set[str],
) -> Iterator[str]:
    if [row.id for row in rows] != [sample.spec.id for sample in samples]:
        yield f"{file}: the error estimates beside it are of other shapes"
        return
    for sample, row in zip(samples, rows, strict=True):
        label = sample.eigenvalues
        if row.error.shape != label.shape or row.refined.shape[1:] != label.shape:
            yield f"{row.id}: {len(row.error)} error estimates of {len(label)} eigenvalues"
            continue
        meshes = [label, *row.refined]
        sources = [("its own refined eigenvalues", label - extrapolate(*meshes[-2:]))]
        if row.id in pinned:
            sources.append(("the pinned one", pinned[row.id] * label))
        if row.id in anew:
            try:
                sources.append(("one made anew", estimate(sample.spec, label).error))
            except (SpectrumError, ValueError, KeyError) as error:
                yield f"{row.id}: no error estimate can be made anew: {one_line(error)}"
        for name, expected in sources:
            apart = float(np.max(np.abs((row.error - expected) / label)))
            if not apart <= ERROR_TOLERANCE:
                yield (
                    f"{row.id}: error estimate is {apart:.2g} of the label off {name}, "
                    f"more than {ERROR_TOLERANCE:g}"
                )
