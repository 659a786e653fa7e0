"""The pinned files: what a frozen version and the scaling track must give on every machine.

Run once, when a version is frozen: an edit that changes a label is a new version.
"""

from __future__ import annotations

import time
from pathlib import Path

from eigbench.scaling import surfaces

from evidence import ROOT
from evidence.timing import progress
from synthnet import store
from synthnet.build import estimates
from synthnet.store import pins

VERSIONS = ROOT / "synthnet" / "recipe" / "versions"


def pin_version(version: str, target: Path | None = None) -> None:
    """Write ``<version>.lock.parquet``: digests, moments and labels of a built version."""
    dataset = store.open_dataset(version)
    target = target or VERSIONS / f"{version}.lock.parquet"
    samples = progress(dataset.samples(), "pinning", dataset.manifest.rows)
    pins.write(target, (pins.pin(sample) for sample in samples))
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, {dataset.manifest.rows} shapes")


def pin_errors(version: str, target: Path | None = None) -> None:
    """Write ``<version>.errors.parquet``: error estimates as shares of the labels.

    The version was built with ``--error-estimates``, which is several times the work of a build.
    """
    dataset = store.open_dataset(version)
    target = target or VERSIONS / f"{version}.errors.parquet"
    labels = (label for path in dataset.paths() for _, label in estimates.labels(path))
    rows = zip(estimates.read(dataset), labels, strict=True)
    pins.write_errors(target, {row.id: row.error / label for row, label in rows})
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, {dataset.manifest.rows} shapes")


def pin_scaling(sizes: list[int]) -> None:
    """Add meshes, labels and limits of the scaling track to its surfaces.parquet.

    What is pinned already stays as it is. Each mesh is written as soon as it is done, so an
    interrupted run goes on where it stopped. The limit of a surface is computed with its first
    mesh. ``eigbench scaling --verify`` makes all anew and compares.
    """
    if unknown := set(sizes) - set(surfaces.SIZES):
        raise ValueError(f"no size {min(unknown)}: there are {', '.join(map(str, surfaces.SIZES))}")
    target = ROOT / "benchmark" / "eigbench" / "scaling" / surfaces.PINS
    pinned = dict(surfaces.read())
    limits = {mesh.surface: (mesh.limit, mesh.limit_error) for mesh in pinned.values()}
    missing = [
        (s, n) for n in sorted(set(sizes)) for s in surfaces.SURFACES if (s, n) not in pinned
    ]
    for surface, size in missing:
        started = time.perf_counter()
        mesh = surfaces.make(surface, size, limits.get(surface))
        limits[surface] = mesh.limit, mesh.limit_error
        pinned[surface, size] = mesh
        surfaces.write(target, pinned.values())
        took = time.perf_counter() - started
        print(
            f"{surface}, {mesh.vertices:,} vertices: {took:.1f} s, residual "
            f"{mesh.certificate.residual:.0e}, discretisation error "
            f"{100 * mesh.discretisation_error:.2g} %, limit good to "
            f"{100 * (mesh.limit_error / mesh.limit).max():.1g} %",
            flush=True,
        )
