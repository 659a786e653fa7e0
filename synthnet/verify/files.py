"""Checks of a dataset's files: manifest, digests, shards and limits as they were built."""

from collections.abc import Iterator
from pathlib import Path

from synthnet import store
from synthnet.errors import StoreError
from synthnet.recipe import Recipe
from synthnet.store import StoredDataset, limits, storage, unpacked
from synthnet.store.limits import StoredLimit
from synthnet.types import Manifest, Sample, ShardRecord
from synthnet.verify.report import Findings


def check_manifest(manifest: Manifest, recipe: Recipe | None) -> Iterator[str]:
    """Compare the manifest with its recipe; an import's, which has none, with its description."""
    if recipe is None:  # the manifest alone knows how many files there were
        drawn = dict(manifest.drawn)
        if manifest.recipe_digest != store.description_of(manifest).digest:
            yield "manifest: its digest is not that of its options and files"
    else:
        drawn = {family: recipe.drawn(family) for family in recipe.families}
        if manifest.version != recipe.version:
            yield f"manifest: of {manifest.version}, its recipe of {recipe.version}"
        if manifest.recipe_digest != recipe.digest:
            yield "manifest: made from another recipe than this release's"
    for family, expected in drawn.items():
        shards = [s for s in manifest.shards if s.family == family]
        counted = sum(s.rows + len(s.rejections) for s in shards)
        if not counted == manifest.drawn.get(family) == expected:
            yield (
                f"manifest: {family} has {counted} shapes kept or rejected and "
                f"{manifest.drawn.get(family)} drawn, the recipe draws {expected}"
            )


def read_checked(
    dataset: StoredDataset, record: ShardRecord, findings: Findings
) -> list[Sample] | None:
    """Return a shard's samples, or ``None`` if it cannot be read; note what is wrong with it."""
    findings.add("digests", _check_digest(dataset, record))
    try:
        samples = list(store.read_samples(dataset.directory / record.file))
    except StoreError as error:
        findings.add("shards", [str(error)])
        return None
    findings.add("shards", _check_rows(samples, record))
    return samples


def read_limits(
    dataset: StoredDataset, record: ShardRecord, findings: Findings
) -> list[StoredLimit] | None:
    """Return the limits of a shard, or ``None``; note what is wrong with their file."""
    try:
        return limits.read_shard(dataset.directory, record)
    except StoreError as error:
        findings.add("limits", [str(error)], examined=0)
        return None


def check_unpacked(dataset: StoredDataset, findings: Findings) -> None:
    """Read every byte of what loaders have unpacked of a dataset, where that is on this machine."""
    if not isinstance(dataset.directory, Path):
        return
    for path in sorted(
        path
        for folder in unpacked.FOLDERS
        for path in (dataset.directory / folder).glob(f"*/{unpacked.CONTENTS}")
    ):
        problems = [
            f"{problem}: it is unpacked anew when it is opened"
            for problem in unpacked.problems(path.parent)
        ]
        findings.add("unpacked", problems)


def _check_digest(dataset: StoredDataset, record: ShardRecord) -> Iterator[str]:
    path = dataset.directory / record.file
    if storage.size(path) is None:
        yield f"{record.file}: missing"
    elif (here := storage.sha256(path)) != record.sha256:
        yield f"{record.file}: SHA-256 is {here[:12]}…, the manifest has {record.sha256[:12]}…"


def _check_rows(samples: list[Sample], record: ShardRecord) -> Iterator[str]:
    counts = (
        ("rows", len(samples), record.rows),
        ("vertices", sum(len(s.mesh.vertices) for s in samples), record.vertices),
        ("faces", sum(len(s.mesh.faces) for s in samples), record.faces),
    )
    for what, stored, expected in counts:
        if stored != expected:
            yield f"{record.file}: {stored} {what}, the manifest has {expected}"
