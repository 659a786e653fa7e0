"""Check a built dataset against its manifest, its recipe, the pins and LaPy."""

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias, TypeVar

import numpy as np

from synthnet import recipe, store
from synthnet.build.limits import pinned as pinned_limits
from synthnet.families import FAMILIES
from synthnet.recipe import Kind, Recipe
from synthnet.recipe.plan import plan_shards
from synthnet.store import StoredDataset, limits, pins
from synthnet.types import Sample, ShardRecord
from synthnet.verify import files, seal, shapes
from synthnet.verify.report import Findings, VerifyReport

LIMITS_MADE_ANEW = 5  # so many of the sample are computed anew

CHECKS = {  # in order, with what each holds
    "manifest": "the recipe's digest and the counts by family",
    "digests": "SHA-256 of every shard",
    "shards": "schema, page checksums and rows of every shard",
    "recipe": "ids, parameters, splits and isometries, drawn anew or as an import lists them",
    "meshes": "generated anew: faces equal, every vertex to 1e-6",
    "certificates": "residuals, and the eigenvalues counted anew below two shifts",
    "pins": "digests of the pinned build; its vertex moments and eigenvalues to 1e-6",
    "labels": "against LaPy's own solver, to 1e-8",
    "limits": "where there are any: whole, equal to the pins, some computed anew",
    "unpacked": "SHA-256 of all that loaders have unpacked, where they have",
}

OnShard: TypeAlias = Callable[[int, int], None]
Item = TypeVar("Item", str, int)


def verify(
    version: str,
    *,
    root: str | os.PathLike[str] | None = None,
    sample: int = 100,
    seed: int = 0,
    on_shard: OnShard | None = None,
) -> VerifyReport:
    """Verify a dataset on disk.

    Checks, in order: the manifest's recipe; SHA-256 of every shard; schema, page checksums
    and row counts; ids, parameters, splits and isometries against the recipe's own draw;
    every mesh against one generated anew; every certificate, its eigenvalues counted anew;
    digests, vertex moments and labels against the pins of the repository (a scaled version
    and a sealed set have none); labels of a random sample against
    ``lapy.Solver(...).eigs``; the limits of the surfaces, where there are any, against their
    labels, the pins, and some of the sample's computed anew where a closed form or an equation of
    one variable gives them; what loaders have unpacked, where there is any.

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
    MissingPackageError
        If labels are to be derived anew and LaPy is not installed.
    """
    dataset = store.open_dataset(version, root)
    if sample:
        shapes.load_lapy()  # now, not after the minutes that the other checks take
    if dataset.kind is Kind.IMPORTED:
        return _verify_imported(dataset, sample, seed, on_shard)
    return _verify_drawn(dataset, sample, seed, on_shard)


def verify_files(version: str, *, root: str | os.PathLike[str] | None = None) -> VerifyReport:
    """Check the files of a dataset, and compute nothing anew: a part of :func:`verify`.

    It finds every byte that has changed since the build, in seconds: the manifest's own
    digest and its recipe's; SHA-256, schema, page checksums and rows of every shard; and
    that the limits of the surfaces, where there are any, are whole and of their shard; and that
    what loaders have unpacked is as they left it.

    Raises
    ------
    StoreError
        If the dataset has not been built there or its manifest is damaged.
    """
    dataset = store.open_dataset(version, root)
    drawn = None if dataset.kind is Kind.IMPORTED else _recipe_of(dataset)
    any_limits = limits.any_there(dataset)
    findings = Findings(("manifest", "digests", "shards", "limits", "unpacked"))
    findings.add("manifest", files.check_manifest(dataset.manifest, drawn))
    for record in dataset.manifest.shards:
        files.read_checked(dataset, record, findings)
        if any_limits:
            findings.examined["limits"] += 1
            files.read_limits(dataset, record, findings)
    files.check_unpacked(dataset, findings)
    return findings.report(dataset.directory)


def _recipe_of(dataset: StoredDataset) -> Recipe:
    """Return the recipe of a dataset; of a sealed set its own manifest has it."""
    if dataset.kind is Kind.SEALED:
        return seal.recipe_of(dataset)
    return recipe.load(dataset.manifest.version)


def _verify_drawn(
    dataset: StoredDataset, sample: int, seed: int, on_shard: OnShard | None
) -> VerifyReport:
    """Verify a dataset that a recipe draws."""
    drawn = _recipe_of(dataset)
    manifest = dataset.manifest
    planned = {shape.spec.id: shape for plan in plan_shards(drawn) for shape in plan.shapes}
    rejected = {rejection.id for rejection in manifest.rejections}
    pinned = pins.read(drawn.base)
    chosen = _choose(sorted(set(planned) - rejected), sample, seed)
    known = sorted(id for id in chosen if FAMILIES[planned[id].spec.family].limit is not None)
    anew = set(known[:: max(1, len(known) // LIMITS_MADE_ANEW)][:LIMITS_MADE_ANEW])
    any_limits = limits.any_there(dataset)
    known_limits = (pinned_limits(drawn) if any_limits else None) or {}
    findings = Findings(CHECKS)
    findings.add("manifest", files.check_manifest(manifest, drawn))
    seen: set[str] = set()
    for record, samples in _read_shards(dataset, findings, on_shard):
        for stored in samples:
            id = stored.spec.id
            seen.add(id)
            findings.add("recipe", shapes.check_plan(stored, planned, drawn), examined=0)
            findings.add("meshes", shapes.check_mesh(stored))
            findings.add("certificates", shapes.check_certificate(stored, drawn))
            if pinned is not None:
                findings.add("pins", shapes.check_pin(stored, pinned), examined=id in pinned)
            if id in chosen:
                findings.add("labels", shapes.check_label(stored))
        rows = files.read_limits(dataset, record, findings) if any_limits else None
        if rows is not None:
            wrong = shapes.check_limits(record.file, samples, rows, known_limits, anew)
            findings.add("limits", wrong, examined=len(rows))
    lost = sorted(set(planned) - seen - rejected)
    problems = [f"{id}: neither stored nor rejected" for id in lost]
    findings.add("recipe", problems, examined=len(planned))
    if pinned is not None:
        expected = set(planned) & set(pinned)
        findings.add("pins", _check_kept(seen, rejected, expected), examined=0)
    elif drawn.kind is Kind.VERSION:
        remedy = f"run `python -m evidence pin version {drawn.base}`"
        problem = f"the repository pins nothing for {drawn.base}: {remedy}"
        findings.add("pins", [problem], examined=0)
    files.check_unpacked(dataset, findings)
    return findings.report(dataset.directory)


def _verify_imported(
    dataset: StoredDataset, sample: int, seed: int, on_shard: OnShard | None
) -> VerifyReport:
    """Verify a dataset of imported meshes; the files themselves need not be there.

    Checks, in order: that the manifest's digest is that of its options and list of files, and the
    counts by family; SHA-256 of every shard; schema, page checksums and row counts; that every
    file listed is stored or rejected, with its name, hash and split; every certificate, its
    eigenvalues counted anew; labels of a random sample against ``lapy.Solver(...).eigs``; what
    loaders have unpacked, where there is any. Raise StoreError if the manifest lists no files, as
    those before synthnet 0.1 did not.
    """
    manifest = dataset.manifest
    description = store.description_of(manifest)
    resolved = recipe.load(description.limits)
    chosen = _choose(range(manifest.rows), sample, seed)
    ids: list[str] = [rejection.id for rejection in manifest.rejections]
    names = ("manifest", "digests", "shards", "recipe", "certificates", "labels", "unpacked")
    findings = Findings(names)
    findings.add("manifest", files.check_manifest(manifest, None))
    for _, samples in _read_shards(dataset, findings, on_shard):
        for stored in samples:
            ids.append(stored.spec.id)
            findings.add("recipe", shapes.check_listed(stored, description), examined=0)
            if findings.examined["certificates"] in chosen:
                findings.add("labels", shapes.check_label(stored))
            findings.add("certificates", shapes.check_certificate(stored, resolved))
    times = Counter(ids)
    problems = [
        f"{id}: {times[id]} times among those stored or rejected"
        for id in sorted({*description.files, *times})
        if times[id] != 1
    ]
    findings.add("recipe", problems, examined=len(description.files))
    files.check_unpacked(dataset, findings)
    return findings.report(dataset.directory)


def _read_shards(
    dataset: StoredDataset, findings: Findings, on_shard: OnShard | None
) -> Iterator[tuple[ShardRecord, list[Sample]]]:
    """Yield the shards that can be read, their files checked."""
    shards = dataset.manifest.shards
    for number, record in enumerate(shards, start=1):
        samples = files.read_checked(dataset, record, findings)
        if samples is not None:
            yield record, samples
        if on_shard is not None:
            on_shard(number, len(shards))


def _choose(among: Sequence[Item], sample: int, seed: int) -> set[Item]:
    rng = np.random.default_rng(seed)
    return set(rng.choice(among, size=min(sample, len(among)), replace=False).tolist())


def _check_kept(seen: set[str], rejected: set[str], expected: set[str]) -> Iterator[str]:
    for id in sorted(expected - seen):
        how = "rejected" if id in rejected else "missing"
        yield f"{id}: {how} here, but the pinned build kept it"
