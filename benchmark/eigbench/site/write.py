"""The folder of the page: what is in it, and how it replaces an older one."""

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

from eigbench.board import page
from eigbench.board.figures import FASTEST, FLOOR, KINDS
from eigbench.board.generalisation import NotRun
from eigbench.board.ranking import RANKED_BY
from eigbench.errors import EigbenchError
from eigbench.results import sources
from eigbench.results.submission import Submission
from eigbench.scaling.results import Scaled
from eigbench.scoring.metrics import MAIN, METRICS
from eigbench.site import boards, bundle, models, origin, rows, scaling, shapes
from eigbench.site.bundle import CHECKOUT
from synthnet.errors import counted
from synthnet.store.files import make_directory
from synthnet.types import ShapeSpec
from synthnet.verify.shapes import generated_anew
from synthnet.version import __version__

DATA = "data.js"
FOLDERS = ("boards", "columns", "meshes", "models", "rows")
DOCS = "../docs/{}.md"  # seen from a folder that is directly in the checkout
CODE = "code/{}"  # of the page's folder, which has the files of its models
REPORTED = "reported"


def files(
    submissions: Sequence[Submission],
    reported: Sequence[Mapping[str, Any]],
    scaled: Sequence[Scaled],
    *,
    not_run: Sequence[NotRun] = (),
    docs: str = DOCS,
    code: str = CODE,
    on_step: Callable[[str, str], None] = lambda stage, detail: None,
) -> dict[str, bytes]:
    """Return the content of every file of the page, by its path in the folder.

    The order of the input does not matter.

    Raises
    ------
    EigbenchError
        If the scripts were bundled from other sources, or ``docs`` or ``code`` has no ``{}`` for
        the name of a page or a file.
    """
    check_address("--docs", docs)
    check_address("--code", code)
    scripts = bundle.read()
    values: dict[str, Any] = {}
    meshes: dict[str, ShapeSpec] = {}
    shown = boards.shown(submissions, not_run)
    for board in shown:
        stage = f"board {board.key}, {counted(len(board.rows), 'row')}"
        on_step(stage, "")
        first, rest = boards.contents(board)
        values |= {f"boards/{board.key}": first, f"columns/{board.key}": rest}
        for row in board.rows:
            submission = row.submission
            on_step(stage, submission.slug)
            values[f"rows/{board.key}/{submission.slug}"] = opened = rows.content(
                row, page.title(board.rows), board.own, code
            )
            for shape in opened["shapes"]:
                spec = shapes.spec_of(submission.truth, shape["id"].partition("/")[0])
                if spec is not None:
                    meshes[shape["mesh"]] = spec
    for name in sorted(meshes):
        on_step(f"drawing {len(meshes)} shapes anew", Path(name).name)
        values[name] = shapes.packed(generated_anew(meshes[name]))
    if scaled:
        values[f"boards/{scaling.KEY}"] = scaling.content(scaled)
        values |= {f"rows/{scaling.KEY}/{row.slug}": scaling.opened(row, code) for row in scaled}
    values |= {f"models/{slug}": model for slug, model in models.contents(shown, scaled).items()}
    if reported:
        values[f"boards/{REPORTED}"] = _reported(reported)
    scripts |= {f"{name}.js": script(name, value) for name, value in values.items()}
    if code == CODE:
        run = [(s.result, s.result_path) for s in submissions]
        run += [(s.result, s.path) for s in scaled]
        scripts |= {
            f"code/{sources.CODE}/{name}": file.read_bytes()
            for result, path in run
            for name, file in origin.files(result, path).items()
        }
    scripts[DATA] = script("index", _index(shown, bool(scaled), bool(reported), docs))
    return scripts


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
        "edge": {"error": FLOOR, "speed": FASTEST},
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
    """Write the page beside its path and move it there; a run that fails leaves the older page.

    At every moment a whole page is at its path, or beside it as ``.NAME.*.older``, from where a
    run that was stopped between its two moves, or the next run, puts it back.

    Raises
    ------
    EigbenchError
        If there is something else, which would be lost, or the page cannot be written.
    BuildError
        If the folder that it is to be in cannot be written.
    """
    check_out(out)
    page = out.resolve()
    make_directory(page.parent)
    # No two runs may have a folder in common: each would move and remove the other's.
    beside = f".{page.name}.{uuid.uuid4().hex}"
    partial, older = (page.with_name(f"{beside}.{kind}") for kind in ("partial", "older"))
    try:
        own = f".{glob.escape(page.name)}.{'[0-9a-f]' * 32}.older"  # matches this page's alone
        for lost in sorted(page.parent.glob(own)):
            _put_back(lost, page)
        for name, data in sorted(content.items()):
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            (partial / name).write_bytes(data)
        if page.exists():
            page.rename(older)
        partial.rename(page)
    except OSError as error:
        raise EigbenchError(f"cannot write {out} ({error.strerror})") from error
    finally:  # by an interrupt too
        shutil.rmtree(partial, ignore_errors=True)
        _put_back(older, page)
        if page.exists():
            shutil.rmtree(older, ignore_errors=True)


def _put_back(older: Path, page: Path) -> None:
    if older.exists() and not page.exists():
        older.rename(page)


def check_out(out: Path) -> None:
    """Check that a page may be written to a path: nothing, an empty folder or an older page.

    Raises
    ------
    EigbenchError
        If there is something else, or something else is in the older page's folder.
    """
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    if not all((out / name).is_file() for name in ("index.html", "page.js", DATA)):
        raise EigbenchError(
            f"{out} exists and is no page of `eigbench site`, which would replace it: give "
            "another folder with --out"
        )
    if foreign := _foreign(out):
        raise EigbenchError(
            f"{out} has {foreign[0].relative_to(out)}, which `eigbench site` did not write and "
            "would remove: move it elsewhere, or give another folder with --out"
        )


def _foreign(page: Path) -> list[Path]:
    """Return the paths in a page's folder that do not belong to the page."""
    top = {*bundle.FILES, DATA, *FOLDERS, "code"}
    return [path for path in sorted(page.iterdir()) if path.name not in top] + [
        path
        for folder in FOLDERS
        for path in sorted((page / folder).rglob("*"))
        if path.suffix != ".js" and not path.is_dir()
    ]


def check_address(option: str, address: str) -> None:
    """Check that an address has ``{}`` for the name of what it leads to.

    Raises
    ------
    EigbenchError
        If it has none.
    """
    if "{}" not in address:
        raise EigbenchError(f"{option} {address} must have {{}} where a name goes, as in {DOCS}")


def docs_from(out: Path) -> str:
    """Return where the pages of this checkout's docs are, seen from a folder.

    Examples
    --------
    >>> docs_from(CHECKOUT / "page"), docs_from(CHECKOUT / "build" / "page")
    ('../docs/{}.md', '../../docs/{}.md')
    """
    relative = Path(os.path.relpath(CHECKOUT / "docs", out.resolve()))
    return f"{quote(relative.as_posix())}/{{}}.md"
