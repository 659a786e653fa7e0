"""Truncate and alter mesh files of each format, and import them all: no crash, no hang.

    python scripts/fuzz_import.py --cases 1000 --seed 0 [--json docs/data/fuzz-import.json]

The files are an icosphere and a torus as OBJ, OFF, PLY and STL, ASCII and binary. Every file must
become a certified shape or a rejection with a reason; a shape must have all the faces that its
altered file declares; the dataset must verify. Exit code 1 if not.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import trimesh
from tabulate import tabulate

from synthnet.build.importing import import_meshes, what_was_met
from synthnet.store.files import write_text
from synthnet.types import Sample
from synthnet.verify.checks import verify

ROOT = Path(__file__).parent.parent
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
    elif kind == "digits":  # still a number, but another
        places = [i for i, byte in enumerate(content) if byte in b"0123456789"] or [first]
        for i in rng.sample(places, min(5, len(places))):
            content[i] = rng.choice(b"0123456789")
    else:
        for _ in range(rng.choice((1, 3, 20))):
            content[rng.randrange(len(content))] = rng.randrange(256)
    return bytes(content)


def declared(content: bytes, suffix: str) -> int:
    """Return how many faces a file says it has, told otherwise than by the reader."""
    if suffix == "binary.stl":
        return int.from_bytes(content[80:84], "little")
    if suffix.endswith("ply") or suffix == "off":
        pattern = rb"element\s+face\s+(\d+)" if suffix != "off" else rb"OFF\s*\d+\s+(\d+)"
        (count,) = re.findall(pattern, content)
        return int(count)
    return len(re.findall(rb"^\s*(?:f|facet)\s", content, re.MULTILINE | re.IGNORECASE))


def lost(sample: Sample, place: Path) -> str | None:
    """Return how the faces of a shape differ from those its file declares."""
    told = dict(sample.spec.parameters)
    path = place / str(told["file"])
    suffix = path.name.partition(".")[2]
    dropped = ("faces_with_repeated_corners", "duplicate_faces")
    found = len(sample.mesh.faces) + sum(int(told.get(name, 0)) for name in dropped)
    expected = declared(path.read_bytes(), suffix)
    # An altered line of an OBJ file may be a polygon of more corners, and so more triangles
    if found == expected or (suffix == "obj" and found > expected):
        return None
    return f"{path.name}: {found} faces, the file declares {expected}"


def write_cases(place: Path, cases: int, rng: random.Random) -> None:
    """Write so many altered files, of each format and mesh in turn."""
    wholes = {
        (name, suffix): mesh.export(**options)
        for name, mesh in MESHES.items()
        for suffix, options in FORMATS.items()
    }
    kinds = sorted(wholes)
    for case in range(cases):
        name, suffix = kinds[case % len(kinds)]
        whole = wholes[name, suffix]
        whole = whole.encode() if isinstance(whole, str) else whole
        (place / f"{case:05d}-{name}.{suffix}").write_bytes(altered(whole, rng))


def run(cases: int, seed: int) -> dict:
    """Import the cases and verify what came of them; return what was found."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary) / "fuzz"
        place.mkdir()
        write_cases(place, cases, random.Random(seed))
        started = time.perf_counter()
        home = Path(temporary) / "datasets"
        dataset = import_meshes([place], "fuzz", root=home).dataset
        seconds = time.perf_counter() - started
        rows = what_was_met(dataset)
        problems = list(verify("fuzz", root=home, sample=20).problems)
        problems += [wrong for one in dataset.samples() if (wrong := lost(one, place))]
    if len(rows) != cases:
        problems.append(f"{cases} files, {len(rows)} outcomes")
    outcomes = {
        suffix: Counter(
            str(row["what"]).partition(":")[0] if row["outcome"] == "rejected" else row["outcome"]
            for row in rows
            if str(row["file"]).partition(".")[2] == suffix
        )
        for suffix in FORMATS
    }
    return {
        "cases": cases,
        "seed": seed,
        "seconds": round(seconds, 1),
        "outcomes": {suffix: dict(sorted(c.items())) for suffix, c in outcomes.items()},
        "problems": problems,
    }


def main() -> int:
    """Run the cases and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = run(options.cases, options.seed)
    names = sorted({name for row in found["outcomes"].values() for name in row})
    table = [[s, *(row.get(n, 0) for n in names)] for s, row in found["outcomes"].items()]
    print(tabulate(table, ["format", *names]))
    print(f"\n{found['cases']:,} files in {found['seconds']:.0f} s")
    for problem in found["problems"]:
        print(f"WRONG: {problem}")
    if options.json:
        write_text(options.json, json.dumps(found, indent=1) + "\n")
    return int(bool(found["problems"]))


if __name__ == "__main__":
    sys.exit(main())
