"""The folder of the page: what is in it, and how it is put in place of an older one."""

from __future__ import annotations

import json
import shutil
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from eigbench.errors import EigbenchError
from eigbench.figures import FASTEST, FLOOR, KINDS
from eigbench.metrics import MAIN, METRICS
from eigbench.ranking import RANKED_BY
from eigbench.scaling.results import Scaled
from eigbench.site import boards, rows, scaling, shapes
from eigbench.submission import Submission
from synthnet.files import make_directory
from synthnet.version import __version__

# Made by `make page` from benchmark/page/src; a checkout has it, an installed package does not.
BUNDLE = Path(__file__).parents[2] / "page" / "dist"
BUNDLED = ("index.html", "style.css", "page.js", "chart.js", "viewer.js", "LICENSES.txt")
DATA = "data.js"
DOCS = "../docs/{}.md"
REPORTED = "reported"


def files(
    submissions: Sequence[Submission],
    reported: Sequence[Mapping[str, Any]],
    scaled: Sequence[Scaled],
    *,
    docs: str = DOCS,
    on_step: Callable[[str], None] = lambda step: None,
) -> dict[str, bytes]:
    """Return the content of every file of the page, by its place in the folder.

    The order of the input does not matter.

    Raises
    ------
    EigbenchError
        If the scripts were not bundled, or ``docs`` has no place for a page's name.
    """
    if "{}" not in docs:
        raise EigbenchError(
            f"--docs {docs} must have {{}} where the name of a page goes, as in {DOCS}"
        )
    found = bundle()
    told: dict[str, Any] = {}
    meshes: dict[str, tuple[Submission, str]] = {}
    shown = boards.shown(submissions)
    for board in shown:
        on_step(f"board {board.key}")
        told[f"boards/{board.key}"] = boards.told(board)
        for row in board.rows:
            one = row.submission
            on_step(f"row {board.key}/{one.slug}")
            told[f"rows/{board.key}/{one.slug}"] = opened = rows.told(one, board.own)
            for shape in opened["shapes"]:
                if shape["mesh"] is not None:
                    meshes[shape["mesh"]] = (one, shape["id"].partition("/")[0])
    for place in sorted(meshes):
        on_step(f"mesh {Path(place).name}")
        one, shape_id = meshes[place]
        spec = shapes.spec_of(one.truth, shape_id)
        if spec is not None:
            told[place] = shapes.packed(shapes.generated(spec))
    if scaled:
        told[f"boards/{scaling.KEY}"] = scaling.told(scaled)
        told |= {f"rows/{scaling.KEY}/{row.slug}": scaling.opened(row) for row in scaled}
    if reported:
        told[f"boards/{REPORTED}"] = _reported(reported)
    found |= {f"{place}.js": script(place, value) for place, value in told.items()}
    found[DATA] = script("index", _index(shown, bool(scaled), bool(reported), docs))
    return found


def bundle() -> dict[str, bytes]:
    """Return the files that every page has, as `make page` bundled them.

    Raises
    ------
    EigbenchError
        If one is missing.
    """
    missing = [name for name in BUNDLED if not (BUNDLE / name).is_file()]
    if missing:
        raise EigbenchError(
            f"{BUNDLE} has no {missing[0]}: run `make page` in a checkout of the project, which "
            "bundles the page's scripts (it needs npm)"
        )
    return {name: (BUNDLE / name).read_bytes() for name in BUNDLED}


def script(key: str, value: Any) -> bytes:
    """Return a script that hands a value to the page: from a file nothing else can be loaded."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return f"eigbench.put({json.dumps(key)},{text})\n".encode()


def _index(
    shown: Sequence[boards.Shown], scaled: bool, reported: bool, docs: str
) -> dict[str, Any]:
    """Return what the page needs before any board."""
    versions: dict[str, list[list[str]]] = {}
    for board in shown:
        versions.setdefault(f"synthNet {board.truth.version}", []).append([board.key, board.title])
    datasets = [{"title": title, "boards": keys} for title, keys in versions.items()]
    if scaled:
        datasets.append({"title": "Scaling track", "boards": [[scaling.KEY, "one mesh a call"]]})
    if reported:
        entry = [REPORTED, "as printed in the paper"]
        datasets.append({"title": "Reported, not run here", "boards": [entry]})
    return {
        "version": __version__,
        "docs": docs,
        "datasets": datasets,
        "kinds": {kind: colour for kind, (colour, _) in KINDS.items()},
        "edge": {"error": FLOOR, "ms": FASTEST},
        "ranked_by": RANKED_BY,
        "metrics": {
            key: {
                "title": METRICS[key].heading,
                "higher": METRICS[key].higher_is_better,
                "share": METRICS[key].unit == "share",
            }
            for key in MAIN
        },
    }


def _reported(papers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return papers' own numbers, as printed: they stand apart from all boards."""
    about, tables, notes = [], [], []
    for paper in sorted(papers, key=lambda paper: str(paper["source"])):
        about += [f"{paper['source']}.", paper["setting"]]
        notes += [f"- {note}" for note in paper["notes"]]
        tables += [
            {"title": table["title"], "headers": table["columns"], "rows": table["rows"]}
            for table in paper["tables"]
        ]
    return {
        "key": REPORTED,
        "kind": REPORTED,
        "title": "Reported by the paper, not run here",
        "about": about,
        "notes": notes,
        "tables": tables,
    }


def write(out: Path, content: Mapping[str, bytes]) -> None:
    """Write the page beside its place and move it there; a run that fails leaves the older page.

    Raises
    ------
    EigbenchError
        If something else is there, which would be lost.
    BuildError
        If it cannot be written.
    """
    check_place(out)
    make_directory(out.resolve().parent)
    beside = out.resolve().with_name(f".{out.resolve().name}.{uuid.uuid4().hex}")
    partial, older = (beside.with_suffix(kind) for kind in (".partial", ".older"))
    try:
        for place, data in sorted(content.items()):
            (partial / place).parent.mkdir(parents=True, exist_ok=True)
            (partial / place).write_bytes(data)
        if out.exists():
            out.resolve().rename(older)
        partial.rename(out.resolve())
    except OSError as error:
        if older.exists() and not out.exists():
            older.rename(out.resolve())
        raise EigbenchError(f"cannot write {out} ({error.strerror})") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        shutil.rmtree(older, ignore_errors=True)


def check_place(out: Path) -> None:
    """Check that a page may be put at a place: nothing, an empty folder or an older page.

    Raises
    ------
    EigbenchError
        If something else is there.
    """
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not all((out / name).is_file() for name in ("index.html", "page.js", DATA)):
        raise EigbenchError(
            f"{out} is there and is no page of `eigbench site`, which would replace it: give "
            "another place with --out"
        )
