"""The pinned files: what a frozen version and the scaling track must give on every machine.

Run once, when a version is frozen: an edit that changes a label is a new version.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial as partial_of
from pathlib import Path

import numpy as np
from eigbench.scaling import surfaces

from evidence import ROOT
from evidence.timing import progress
from synthnet import recipe, store
from synthnet.build.workers import local_processes, one_thread
from synthnet.errors import SpectrumError
from synthnet.families import FAMILIES
from synthnet.families.limits import Limit
from synthnet.recipe.drawing import draw_shape
from synthnet.store import pins

VERSIONS = ROOT / "synthnet" / "recipe" / "versions"
EVERY = 50  # limits: how often progress is written
ANY = {"triangulation": "uniform", "vertices": 50, "seed": 0}


def pin_version(version: str, target: Path | None = None) -> None:
    """Write ``<version>.lock.parquet``: digests, moments and labels of a built version."""
    dataset = store.open_dataset(version)
    target = target or VERSIONS / f"{version}.lock.parquet"
    samples = progress(dataset.samples(), "pinning", dataset.manifest.rows)
    pins.write(target, (pins.pin(sample) for sample in samples))
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, {dataset.manifest.rows} shapes")


def pin_limits(version: str, target: Path | None = None, workers: int = 1) -> None:
    """Write ``<version>.limits.parquet``: the spectra of the shapes' surfaces, with their bars.

    Shapes are those of ``<version>.lock.parquet``; triangulations of one surface share its limit.
    Each limit goes into a file beside the target as soon as it is known, so an interrupted run
    goes on where it stopped. Limits that another version pins are taken from there.
    """
    locked = pins.read(version)
    if locked is None:
        raise ValueError(f"no shapes of {version} are pinned: python -m evidence pin version")
    target = target or VERSIONS / f"{version}.limits.parquet"
    surfaces = surfaces_of(version, locked)
    partial = target.with_suffix(".partial")
    known = limits_elsewhere(version, set(surfaces.values()))
    known |= _read_partial(partial) if partial.exists() else {}
    missing = [key for key in dict.fromkeys(surfaces.values()) if key not in known]
    print(f"{len(missing):,} limits to compute, {len(known):,} are there", flush=True)
    started = time.perf_counter()
    with partial.open("a") as file, _mapped(workers) as mapped:
        computed = zip(missing, mapped(limit_of, missing), strict=True)
        for number, (key, limit) in enumerate(computed, start=1):
            known[key] = limit
            row = {"key": key, "eigenvalues": list(limit.eigenvalues), "bar": list(limit.bar)}
            file.write(json.dumps(row) + "\n")
            if number % EVERY == 0 or number == len(missing):
                file.flush()
                left = (time.perf_counter() - started) * (len(missing) / number - 1)
                print(f"{number:,} of {len(missing):,}, {left / 60:.0f} minutes left", flush=True)
    pins.write_limits(target, {id: known[key] for id, key in surfaces.items()})
    partial.unlink()
    print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, {len(surfaces):,} shapes")


def limits_elsewhere(version: str, surfaces: set[str]) -> dict[str, Limit]:
    """Return the limits of surfaces, by the text of :func:`surfaces_of`, that others pin."""
    families = recipe.load(version).families
    known = {}
    for other in recipe.available():
        shared = families.keys() & recipe.load(other).families.keys()
        pinned = pins.read_limits(other) if shared and other != version else None
        ids = [id for id in pinned or () if id.rpartition("-")[0] in shared]
        known |= {key: pinned[id] for id, key in surfaces_of(other, ids).items() if key in surfaces}
    return known


def surfaces_of(version: str, ids: Iterable[str]) -> dict[str, str]:
    """Return the family and the surface's parameters of each shape, as a text."""
    resolved = recipe.load(version)
    surfaces = {}
    for id in ids:
        name, _, index = id.rpartition("-")
        surfaces[id] = FAMILIES[name].surface_key(draw_shape(resolved, name, int(index)).parameters)
    return surfaces


def limit_of(key: str) -> Limit:
    """Return the limit of a surface, by its text of :func:`surfaces_of`."""
    name, surface = json.loads(key)
    family = FAMILIES[name]
    try:
        with one_thread:  # a limit takes all parameters; any triangulation of a surface will do
            return family.limit_spectrum({**ANY, **surface} if family.shared else surface)
    except SpectrumError as error:
        raise SpectrumError(f"{key}: {error}") from error


def _read_partial(path: Path) -> dict[str, Limit]:
    """Read what an interrupted run wrote; a line that it did not end is cut off."""
    text = path.read_text()
    whole = text[: text.rfind("\n") + 1]
    path.write_text(whole)
    rows = map(json.loads, whole.splitlines())
    return {row["key"]: Limit(np.array(row["eigenvalues"]), np.array(row["bar"])) for row in rows}


@contextmanager
def _mapped(workers: int) -> Iterator[Callable[..., Iterable[Limit]]]:
    """Give a ``map`` by so many processes."""
    if workers == 1:
        yield map
        return
    with local_processes(workers) as pool:
        yield partial_of(pool.executor.map, chunksize=8)


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
