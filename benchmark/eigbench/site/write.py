"""The folder of the page: what is in it, and how it is put in place of an older one."""

from __future__ import annotations

import glob
import json
import os
import shutil
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from eigbench.board.figures import FASTEST, FLOOR, KINDS
from eigbench.board.ranking import RANKED_BY
from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scaling.results import Scaled
from eigbench.scoring.metrics import MAIN, METRICS
from eigbench.site import boards, bundle, rows, scaling, shapes
from eigbench.site.bundle import CHECKOUT
from synthnet.store.files import make_directory
from synthnet.version import __version__

DATA = "data.js"
FOLDERS = ("boards", "meshes", "rows")
DOCS = "../docs/{}.md"  # seen from a folder that is directly in the checkout
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
        If the scripts are not bundled as they are now, or ``docs`` has no place for a page's name.
    """
    check_docs(docs)
    found = bundle.read()
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

    At every moment a whole page is in its place, or beside it as ``.NAME.*.older``, from where a
    run that was stopped between its two moves, or the next run, puts it back.

    Raises
    ------
    EigbenchError
        If something else is there, which would be lost, or the page cannot be written.
    BuildError
        If the folder that it is to be in cannot be written.
    """
    check_place(out)
    place = out.resolve()
    make_directory(place.parent)
    # No two runs may have a folder in common: each would move and remove the other's.
    beside = f".{place.name}.{uuid.uuid4().hex}"
    partial, older = (place.with_name(f"{beside}.{kind}") for kind in ("partial", "older"))
    try:
        own = f".{glob.escape(place.name)}.{'[0-9a-f]' * 32}.older"  # of this place alone
        for lost in sorted(place.parent.glob(own)):
            _put_back(lost, place)
        for name, data in sorted(content.items()):
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            (partial / name).write_bytes(data)
        if place.exists():
            place.rename(older)
        partial.rename(place)
    except OSError as error:
        raise EigbenchError(f"cannot write {out} ({error.strerror})") from error
    finally:  # by an interrupt too
        shutil.rmtree(partial, ignore_errors=True)
        _put_back(older, place)
        if place.exists():
            shutil.rmtree(older, ignore_errors=True)


def _put_back(older: Path, place: Path) -> None:
    if older.exists() and not place.exists():
        older.rename(place)


def check_place(out: Path) -> None:
    """Check that a page may be put at a place: nothing, an empty folder or an older page.

    Raises
    ------
    EigbenchError
        If something else is there, or something else is in the older page's folder.
    """
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not all((out / name).is_file() for name in ("index.html", "page.js", DATA)):
        raise EigbenchError(
            f"{out} is there and is no page of `eigbench site`, which would replace it: give "
            "another place with --out"
        )
    if foreign := _foreign(out):
        raise EigbenchError(
            f"{out} has {foreign[0].relative_to(out)}, which `eigbench site` did not write and "
            "would remove: move it elsewhere, or give another place with --out"
        )


def _foreign(page: Path) -> list[Path]:
    """Return what is in a page's folder but is not of the page."""
    top = {*bundle.FILES, DATA, *FOLDERS}
    return [path for path in sorted(page.iterdir()) if path.name not in top] + [
        path
        for folder in FOLDERS
        for path in sorted((page / folder).rglob("*"))
        if path.suffix != ".js" and not path.is_dir()
    ]


def check_docs(docs: str) -> None:
    """Check that ``docs`` has a place for a page's name.

    Raises
    ------
    EigbenchError
        If it has none.
    """
    if "{}" not in docs:
        raise EigbenchError(
            f"--docs {docs} must have {{}} where the name of a page goes, as in {DOCS}"
        )


def docs_from(out: Path) -> str:
    """Return where the pages of this checkout's docs are, seen from a folder.

    Examples
    --------
    >>> docs_from(CHECKOUT / "page"), docs_from(CHECKOUT / "build" / "page")
    ('../docs/{}.md', '../../docs/{}.md')
    """
    relative = Path(os.path.relpath(CHECKOUT / "docs", out.resolve()))
    return f"{quote(relative.as_posix())}/{{}}.md"
