"""What `synthnet import` makes of the meshes that packages on PyPI ship, without any option.

The packages are those of synthnet/build/packages.toml, in a folder that pip has filled. Tried is
every mesh file of 300 to 50,000 vertices; of equal files one, and of two that are named alike but
for left and right. The set for the board is of those that are labelled, are one component, and are
no copy of another: all ten eigenvalues, each divided by their geometric mean, within 1 %. Three
minutes.
"""

import json
import re
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from eigbench.scoring.neighbours import SIMILAR

from evidence import ROOT, markdown
from evidence.timing import progress
from synthnet.build import packages
from synthnet.build.importing import file_outcomes, import_meshes
from synthnet.build.packages import Package
from synthnet.mesh import formats
from synthnet.mesh.formats import UnreadableError, kind_of
from synthnet.store import StoredDataset, files

LIST = ROOT / "synthnet" / "build" / packages.LIST
VERTICES = (300, 50_000)  # at different positions
NO_SURFACE = "values on a surface that is another file"  # a GIfTI file of a curvature, say
SIDE = re.compile(r"(?<![a-z0-9])(left|right|lh|rh|l|r)(?![a-z0-9])")
REASONS = {  # of rejections, as they are said
    "non_manifold_edge": "edge of more than two faces",
    "unreadable": "polygon that crosses itself",
    "certificate": "no certificate",
}


@dataclass(frozen=True, slots=True)
class Survey:
    """What became of the files of one package.

    Attributes
    ----------
    package
        With the files of the set.
    files
        How many mesh files it has.
    tried, labelled, components
        How many different ones are of the sizes, are labelled, and have several components.
    refused
        Counts of reasons.
    """

    package: Package
    files: int
    tried: int
    labelled: int
    components: int
    refused: Counter[str]


def measure(directory: str) -> dict:
    """Return one row per package.

    Parameters
    ----------
    directory
        Where pip has installed the packages.
    """
    return {
        "vertices": list(VERTICES),
        "rows": [
            {
                "package": survey.package.name,
                "version": survey.package.version,
                "licence": survey.package.licence,
                "meshes": survey.package.meshes,
                "files": survey.files,
                "tried": survey.tried,
                "labelled": survey.labelled,
                "refused": dict(survey.refused.most_common()),
                "components": survey.components,
                "set": len(survey.package.files),
                "listed": survey.package in packages.packages(),
            }
            for survey in surveys(Path(directory))
        ],
    }


def problems(data: dict) -> list[str]:
    """Return the packages whose files are not those of the list."""
    return [
        f"{row['package']}: {packages.LIST} has other files: python -m evidence pin packages"
        for row in data["rows"]
        if not row["listed"]
    ]


def pin_packages(directory: Path) -> None:
    """Write the list of files of the set."""
    chosen = [survey.package for survey in surveys(directory)]
    files.write_text(LIST, "\n".join(map(entry, chosen)))
    count = sum(len(package.files) for package in chosen)
    print(f"{LIST}: {LIST.stat().st_size / 1e3:.0f} kB, {count} files")


def entry(package: Package) -> str:
    """Return a package of the list as TOML."""
    names = ("name", "version", "licence", "meshes", "folder")
    lines = ["[[package]]", *(f'{name} = "{getattr(package, name)}"' for name in names)]
    lines.append(f"without = {json.dumps(package.without)}")
    lines += ["[package.files]", *(f'"{file}" = "{sha}"' for file, sha in package.files.items())]
    return "\n".join(lines) + "\n"


def surveys(directory: Path) -> list[Survey]:
    """Return what became of each package's files; they are imported for it."""
    heads = [replace(package, files={}) for package in packages.packages()]
    packages.find(directory, heads)  # says what is lacking
    candidates = {head.folder: tried(directory, head) for head in heads}
    places = {
        directory / folder: [directory / folder / file for file in found]
        for folder, (_, found) in candidates.items()
    }
    with tempfile.TemporaryDirectory() as temporary:
        dataset = import_meshes(places, "candidates", root=temporary, workers=1).dataset
        outcomes = {row["id"]: row for row in file_outcomes(dataset)}
        kept = different(dataset)
        components = Counter(
            sample.spec.family
            for sample in dataset.samples()
            if "components" in sample.spec.parameters
        )
    surveyed = []
    for head in heads:
        count, found = candidates[head.folder]
        family = [row for id, row in outcomes.items() if id.rpartition("-")[0] == head.folder]
        refused = [row["what"] for row in family if row["outcome"] == "rejected"]
        in_set = {file: sha for file, sha in found.items() if (head.folder, file) in kept}
        surveyed.append(
            Survey(
                replace(head, files=in_set),
                count,
                len(found),
                len(family) - len(refused),
                components[head.folder],
                Counter(str(what).partition(":")[0] for what in refused),
            )
        )
    return surveyed


def tried(directory: Path, package: Package) -> tuple[int, dict[str, str]]:
    """Return how many mesh files a package has, and the SHA-256 of those that are tried."""
    chosen, seen, count = dict[str, str](), set[tuple[str, str]](), 0
    for file, content in progress(mesh_files(directory / package.folder), package.name):
        if file.split("/")[0] in package.without:
            continue
        try:
            triangles = formats.read(content, kind_of(file) or "")
            corners = triangles.vertices[np.unique(triangles.faces)]
            fits = VERTICES[0] <= len(np.unique(corners, axis=0)) <= VERTICES[1]
        except UnreadableError as error:
            if NO_SURFACE in str(error):
                continue
            fits = True  # import says why
        count += 1
        if not fits:
            continue
        sha256 = files.sha256(directory / package.folder / file)
        names = {("bytes", sha256), ("name", SIDE.sub("side", file.lower()))}
        if not names & seen:
            chosen[file] = sha256
        seen |= names
    return count, chosen


def mesh_files(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the mesh files below a folder, in order."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and kind_of(path.name) is not None:
            yield path.relative_to(folder).as_posix(), path.read_bytes()


def different(dataset: StoredDataset) -> set[tuple[str, str]]:
    """Return family and file of the shapes of one component that are no copies of others."""
    forms: list[np.ndarray] = []
    kept = set()
    for sample in dataset.samples():
        if "components" in sample.spec.parameters:
            continue
        form = sample.eigenvalues / np.exp(np.mean(np.log(sample.eigenvalues)))
        if all(np.abs(form / other - 1).max() > SIMILAR for other in forms):
            forms.append(form)
            kept.add((sample.spec.family, str(sample.spec.parameters["file"])))
    return kept


def table(data: dict) -> str:
    """Return one row per package, and their sum."""
    rows = [{**row, "why": reasons(row["refused"])} for row in data["rows"]]
    counts = ("files", "tried", "labelled", "components", "set")
    total = {name: sum(row[name] for row in rows) for name in counts}
    every = sum((Counter(row["refused"]) for row in data["rows"]), Counter[str]())
    empty = dict.fromkeys(("version", "licence", "meshes"), "")
    rows.append({"package": "all", **empty, **total, "why": reasons(every)})
    columns = {
        "package": "{package} {version}",
        "licence": "{licence}",
        "meshes": "{meshes}",
        "mesh files": "{files:,}",
        "tried": "{tried:,}",
        "labelled": "{labelled:,}",
        "refused": "{why}",
        "of several components": "{components:,}",
        "in the set": "{set:,}",
    }
    return markdown.columns(rows, columns, "lllrrrlrr")


def reasons(refused: dict[str, int]) -> str:
    """Return why files were refused, with counts.

    Examples
    --------
    >>> reasons({"non_manifold_edge": 2, "memory": 1})
    'edge of more than two faces 2, memory 1'
    """
    ordered = sorted(refused.items(), key=lambda item: -item[1])
    return ", ".join(f"{REASONS.get(name, name)} {count:,}" for name, count in ordered)


def claim(data: dict) -> str:
    """Return the share that is labelled, as part of a sentence."""
    labelled, every = (sum(row[name] for row in data["rows"]) for name in ("labelled", "tried"))
    return f"{labelled:,} of {every:,} ({labelled / every:.0%})"
