"""Results of the scaling track: their contents, and the checks when they are read.

Predictions and times stand in the result itself, mesh by mesh; errors do not: they follow from
the pinned labels.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from eigbench import results
from eigbench.errors import EigbenchError, ResultError
from eigbench.results import sources
from eigbench.scaling import surfaces
from eigbench.scoring.names import slug

VERSION = 2  # 2: sources by their statements, the commit
ANSWERED = "answered"
GRACE = 1.0  # seconds in which an answer at the limit is taken
FOLDER = Path("benchmark", "scaling")  # where the results on a board lie


@dataclass(frozen=True, slots=True)
class Scaled:
    """A result of the scaling track, and its file."""

    result: dict[str, Any]  # as :mod:`eigbench.scaling.run` made it
    path: Path

    @property
    def name(self) -> str:
        """Name of the model."""
        return str(self.result["model"]["name"])

    @property
    def slug(self) -> str:
        """Name of the model in a file's name."""
        return slug(self.name)

    @property
    def remark(self) -> str:
        """What a reader should know of the result: that its code has changed since, or nothing."""
        return sources.remark(self.result, self.path)

    @property
    def meshes(self) -> Mapping[tuple[str, int], dict[str, Any]]:
        """What became of each mesh, by surface and size."""
        return {(mesh["surface"], mesh["size"]): mesh for mesh in self.result["meshes"]}


def schema() -> dict[str, Any]:
    """Return the JSON Schema of these results; three parts are as in all others."""
    text = resources.files(__package__).joinpath("result.schema.json").read_text()
    loaded: dict[str, Any] = json.loads(text)
    for name in ("model", "environment", "checkout"):
        loaded["properties"][name] = results.schema()["properties"][name]
    return loaded


def is_scaled(path: Path) -> bool:
    """Return whether a file of JSON says that it is a result of the scaling track."""
    loaded = results.load(path)
    return isinstance(loaded, dict) and "scaling_version" in loaded


def read(path: Path, below: Path | None = None) -> Scaled:
    """Read a result and check it; ``below`` is as of :func:`eigbench.outside.opened`.

    Raises
    ------
    ResultError
        If it is missing, not of the schema, of other meshes, or contradicts itself.
    """
    result = results.load(path, below)
    validate(result, path)
    return Scaled(result, path)


def validate(result: Any, path: Path) -> None:
    """Check a result against the schema and the pinned meshes.

    Raises
    ------
    ResultError
        With the first thing that is wrong.
    """
    results.check_schema(result, schema(), path)
    seen = set()
    for mesh in result["meshes"]:
        try:
            expected = surfaces.pinned(mesh["surface"], mesh["size"])
        except EigbenchError as error:
            raise ResultError(f"{path}: {error}") from error
        key = expected.pin.id
        if key in seen:
            raise ResultError(f"{path} has {key} twice")
        seen.add(key)
        if mesh["digest"] != expected.pin.digest:
            raise ResultError(f"{path}: its {key} is not the mesh that is pinned here")
        answered = mesh["outcome"] == ANSWERED
        if (mesh["eigenvalues"] is not None) != answered or bool(mesh["seconds"]) != answered:
            raise ResultError(f"{path}: {key} is {mesh['outcome']}, its numbers say otherwise")
        if len(mesh["seconds"]) != len(mesh["cpu_seconds"]):
            raise ResultError(f"{path}: {key} has wall times and CPU times of other numbers")
        if max(mesh["seconds"], default=0) > mesh["time_limit"] + GRACE:
            raise ResultError(f"{path}: {key} is answered later than its time limit")
    wall = sum(sum(mesh["seconds"]) for mesh in result["meshes"])
    cpu = sum(sum(mesh["cpu_seconds"]) for mesh in result["meshes"])
    used = {"cores_used": cpu / wall if wall else 0.0, "threads": result["cost"]["threads"]}
    if results.overused(used):
        raise ResultError(
            f"{path} used {used['cores_used']:.1f} cores and declares {used['threads']} threads: "
            "scale with --threads that allows for them"
        )


def read_board(root: Path) -> list[Scaled]:
    """Read the results of the scaling track under a checkout.

    Raises
    ------
    ResultError
        If one is damaged or misplaced.
    """
    rows = []
    for path in sorted(p for p in (root / FOLDER).rglob("*") if p.is_symlink() or not p.is_dir()):
        row = read(path, below=root)
        if path != (expected := _path(row, root)):
            raise ResultError(f"{path} belongs at {expected}")
        rows.append(row)
    return rows


def add(row: Scaled, root: Path, *, replace: bool = False) -> Path:
    """Copy a result onto a board; return its path there.

    Raises
    ------
    EigbenchError
        If another of that name is there and ``replace`` is not given.
    """
    target = _path(row, root)
    results.put([row.path], [target], root, replace=replace)
    return target


def _path(row: Scaled, root: Path) -> Path:
    return root / FOLDER / f"{row.slug}.json"
