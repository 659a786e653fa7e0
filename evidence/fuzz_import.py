"""Truncated and altered mesh files of each format, all imported: no crash, no hang.

The files are an icosphere and a torus as OBJ, OFF, PLY and STL, ASCII and binary. Every file must
become a certified shape or a rejection with a reason; a shape must have all the faces that its
altered file declares; the dataset must verify.
"""

import random
import re
import tempfile
import time
from collections import Counter
from itertools import product
from pathlib import Path

import trimesh

from synthnet.build.importing import file_outcomes, import_meshes
from synthnet.types import Sample
from synthnet.verify.checks import verify

FORMATS = {  # suffix of the file, and how trimesh writes it
    "obj": {"file_type": "obj"},
    "off": {"file_type": "off"},
    "ascii.ply": {"file_type": "ply", "encoding": "ascii"},
    "binary.ply": {"file_type": "ply", "encoding": "binary"},
    "ascii.stl": {"file_type": "stl_ascii"},
    "binary.stl": {"file_type": "stl"},
}
MESHES = {
    "sphere": trimesh.creation.icosphere(subdivisions=2),
    "torus": trimesh.creation.torus(3.0, 1.0, major_sections=16, minor_sections=12),
}


def measure(*, cases: int = 1000, seed: int = 0) -> dict:
    """Return the outcomes by format, and what should not have happened."""
    with tempfile.TemporaryDirectory() as temporary:
        directory = Path(temporary) / "fuzz"
        directory.mkdir()
        write_cases(directory, cases, random.Random(seed))
        started = time.perf_counter()
        home = Path(temporary) / "datasets"
        dataset = import_meshes([directory], "fuzz", root=home).dataset
        seconds = time.perf_counter() - started
        rows = file_outcomes(dataset)
        wrong = list(verify("fuzz", root=home, sample=20).problems)
        wrong += filter(None, (lost_faces(sample, directory) for sample in dataset.samples()))
    if len(rows) != cases:
        wrong.append(f"{cases} files, {len(rows)} outcomes")
    outcomes: dict[str, Counter[str]] = {suffix: Counter() for suffix in FORMATS}
    for row in rows:
        reason = str(row["what"]).partition(":")[0]
        outcome = reason if row["outcome"] == "rejected" else row["outcome"]
        outcomes[str(row["file"]).partition(".")[2]][outcome] += 1
    return {
        "cases": cases,
        "seed": seed,
        "seconds": round(seconds, 1),
        "outcomes": {suffix: dict(sorted(counts.items())) for suffix, counts in outcomes.items()},
        "problems": wrong,
    }


def problems(data: dict) -> list[str]:
    """Return what was neither a certified shape nor a rejection."""
    return data["problems"]


def write_cases(directory: Path, cases: int, rng: random.Random) -> None:
    """Write so many altered files, of each format and mesh in turn."""
    kinds = sorted(product(MESHES, FORMATS))
    wholes = [MESHES[name].export(**FORMATS[suffix]) for name, suffix in kinds]
    for case in range(cases):
        name, suffix = kinds[case % len(kinds)]
        whole = wholes[case % len(kinds)]
        whole = whole.encode() if isinstance(whole, str) else whole
        (directory / f"{case:05d}-{name}.{suffix}").write_bytes(altered(whole, rng))


def altered(whole: bytes, rng: random.Random) -> bytes:
    """Return a file cut off, with other bytes in it, a part gone, or a part twice."""
    content = bytearray(whole)
    first, last = sorted(rng.randrange(len(whole)) for _ in range(2))
    kind = rng.choice(("cut", "bytes", "bytes", "digits", "gone", "twice"))
    if kind == "cut":
        del content[first:]
    elif kind == "gone":
        del content[first : first + (last - first) % 64 + 1]
    elif kind == "twice":
        content[first:first] = content[first : first + (last - first) % 256 + 1]
    elif kind == "digits":  # it stays a number, but another
        digits = [i for i, byte in enumerate(content) if byte in b"0123456789"] or [first]
        for i in rng.sample(digits, min(5, len(digits))):
            content[i] = rng.choice(b"0123456789")
    else:
        for _ in range(rng.choice((1, 3, 20))):
            content[rng.randrange(len(content))] = rng.randrange(256)
    return bytes(content)


def lost_faces(sample: Sample, directory: Path) -> str | None:
    """Return how the faces of a shape differ from those that its file declares."""
    parameters = dict(sample.spec.parameters)
    path = directory / str(parameters["file"])
    suffix = path.name.partition(".")[2]
    dropped = ("faces_with_repeated_corners", "duplicate_faces")
    faces = len(sample.mesh.faces) + sum(int(parameters.get(name, 0)) for name in dropped)
    expected = declared(path.read_bytes(), suffix)
    # An altered line of an OBJ file may be a polygon of more corners, and so more triangles.
    if faces == expected or (suffix == "obj" and faces > expected):
        return None
    return f"{path.name}: {faces} faces, the file declares {expected}"


def declared(content: bytes, suffix: str) -> int:
    """Return how many faces a file says it has, read otherwise than by the reader."""
    if suffix == "binary.stl":
        return int.from_bytes(content[80:84], "little")
    if suffix.endswith("ply") or suffix == "off":
        pattern = rb"element\s+face\s+(\d+)" if suffix != "off" else rb"OFF\s*\d+\s+(\d+)"
        (count,) = re.findall(pattern, content)
        return int(count)
    return len(re.findall(rb"^\s*(?:f|facet)\s", content, re.MULTILINE | re.IGNORECASE))
