"""The commands leaderboard, export and site. None of them runs a predictor."""

import argparse
import difflib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from rich import filesize
from rich.console import Console

from eigbench import outside
from eigbench.board import export, leaderboard
from eigbench.commands import arguments
from eigbench.commands.arguments import Command
from eigbench.results.submission import Submission
from eigbench.scaling import results as scaling_results
from eigbench.site import bundle, write
from synthnet.errors import counted
from synthnet.store.files import make_directory, write_text
from synthnet.terminal import print_answer, print_json

SHOWN = 40  # so many lines of a difference are printed
SCORING = "scoring every row anew from its predictions"
MOST_GENERATED = 64 * 2**20  # bytes of a generated page


def add_commands(command: Command) -> None:
    """Add leaderboard, export and site to the command line."""
    text = "generate LEADERBOARD.md from the results on the board; no predictor is run"
    sub = command("leaderboard", regenerate, text, "--check")
    text = "write nothing; exit 1 if a file is not up to date"
    either = sub.add_mutually_exclusive_group()
    either.add_argument("--check", action="store_true", help=text)
    text = "first write the scores of every row anew from its predictions: the metrics have changed"
    either.add_argument("--rescore", action="store_true", help=text)
    arguments.board(sub)

    text = "write every prediction on the boards as tidy tables, beside both targets"
    sub = command("export", write_tables, text, "--only 2.0-test-grouped --format parquet")
    arguments.out(sub, "tables", "directory that receives BOARD.parquet and BOARD.csv", "DIR")
    text = "write these alone, such as 2.0-test-grouped (default: every board)"
    sub.add_argument("--only", nargs="+", metavar="BOARD", help=text)
    text = "of the tables (default: both)"
    sub.add_argument(
        "--format", nargs="+", choices=export.FORMATS, default=export.FORMATS, help=text
    )
    arguments.board(sub)

    text = "write the leaderboard as a page to sort, filter and open, which needs no server"
    sub = command("site", site, text, "--out page")
    arguments.out(sub, "page", "directory that receives the page", "DIR")
    text = (
        "address of the documentation, relative to DIR; {} is a page's name, as in "
        f"{write.DOCS} (default: those of the checkout)"
    )
    sub.add_argument("--docs", metavar="URL", help=text)
    text = (
        "address of a file of the project, as https://HOST/OWNER/NAME/blob/main/{}, to link "
        "code and weights of models there (default: %(default)s, which the page then has itself)"
    )
    sub.add_argument("--code", metavar="URL", default=write.CODE, help=text)
    arguments.board(sub)


class Stages:
    """What a long command is doing, on stderr: on a terminal one line that changes.

    Elsewhere, as in a log, each stage is a line of its own when it begins, without its details.
    """

    def __init__(self) -> None:
        self._status = Console(stderr=True).status("")
        self._stage = ""

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._status.stop()

    def __call__(self, stage: str, detail: str = "") -> None:
        """Say which stage it is, and what of it."""
        self._status.update(f"{stage} {detail}".rstrip())
        if stage != self._stage and not sys.stderr.isatty():
            print(f"eigbench: {stage}", file=sys.stderr, flush=True)
        self._stage = stage


def regenerate(options: argparse.Namespace) -> int:
    """Generate the leaderboard, or say what of it is not up to date."""
    root = arguments.board_root(options)
    with Console(stderr=True).status("scoring") as status:
        if options.rescore:
            leaderboard.rescore(root, lambda row: status.update(f"scoring anew {row}"))
        rows = leaderboard.read(root, lambda row: status.update(f"scoring {row}"))
        scaled = scaling_results.read_board(root)
        reported, readme = leaderboard.read_reported(root), _text(root, leaderboard.README)
        not_run = leaderboard.read_not_run(root, rows)
        generated = leaderboard.generate(rows, reported, scaled, readme, not_run)
    stale = [p for p, text in generated.items() if _text(root, p) != text]
    known = {root / path for path in generated}
    there = (path for pattern in leaderboard.GENERATED for path in root.glob(pattern))
    orphans = sorted(path for path in there if path not in known)
    if options.json:
        stale_paths = list(map(str, [*stale, *orphans]))
        print_json({"rows": len(rows), "scaling_rows": len(scaled), "stale": stale_paths})
    if options.check:
        _print_changes(root, generated, stale, orphans)
        if stale or orphans:
            again = f"eigbench leaderboard{arguments.board_argument(options)}"
            print(f"eigbench: not up to date: run {again}", file=sys.stderr)
            return 1
        if not options.json:
            print(f"{counted(len(rows), 'row')} scored anew, every generated file is up to date")
        return 0
    for path in [*(root / path for path in stale), *orphans]:
        outside.check_way(path, root)  # before anything is written or removed
    for path in stale:
        make_directory((root / path).parent)
        write_text(root / path, generated[path])
    for path in orphans:
        path.unlink()
    if not options.json:
        written = ", ".join(str(root / path) for path in stale) or "nothing new"
        print(
            f"rows: {len(rows)} on boards, {len(scaled)} on the scaling track; written: {written}"
        )
        for path in orphans:
            print(f"removed: {path}, which belongs to no board")
    return 0


def write_tables(options: argparse.Namespace) -> int:
    """Write the predictions of each board as one tidy table."""
    root = arguments.board_root(options)
    with Console(stderr=True).status("scoring") as status:
        by_board: dict[str, list[Submission]] = {}
        for row in leaderboard.read(
            root, lambda row: status.update(f"scoring {row}"), options.only
        ):
            by_board.setdefault(row.board, []).append(row)
        written = []
        boards = [by_board[name] for name in sorted(by_board)]
        for path in export.write(options.out, boards, options.format):
            status.update(f"wrote {path}")
            written.append(path)
    lines = [f"{path}  {filesize.decimal(path.stat().st_size)}" for path in written]
    lines.append(f"columns: {', '.join(export.COLUMNS)}")
    print_answer(options, {"files": list(map(str, written))}, "\n".join(lines))
    return 0


def _print_changes(
    root: Path, generated: Mapping[Path, str], stale: Sequence[Path], orphans: Sequence[Path]
) -> None:
    """Print what would change in each stale file, and the figures that no board has."""
    for path in stale:
        old, new = _text(root, path).splitlines(), generated[path].splitlines()
        titles = f"{path} as it is", f"{path} as generated"
        lines = list(difflib.unified_diff(old, new, *titles, n=0, lineterm=""))
        more = [f"... and {len(lines) - SHOWN} more lines"] if len(lines) > SHOWN else []
        print("\n".join([*lines[:SHOWN], *more]), file=sys.stderr)
    for path in orphans:
        print(f"{path} belongs to no board", file=sys.stderr)


def site(options: argparse.Namespace) -> int:
    """Write the leaderboard as a static page."""
    root = arguments.board_root(options)
    docs = write.docs_from(options.out) if options.docs is None else options.docs
    write.check_address("--docs", docs)
    write.check_address("--code", options.code)
    write.check_out(options.out)
    bundle.read()  # all three before the minute that scoring takes
    with Stages() as stage:
        stage(SCORING)
        rows = leaderboard.read(root, lambda row: stage(SCORING, row))
        content = write.files(
            rows,
            leaderboard.read_reported(root),
            scaling_results.read_board(root),
            not_run=leaderboard.read_not_run(root, rows),
            docs=docs,
            code=options.code,
            on_step=stage,
        )
        stage(f"writing {options.out}")
        write.write(options.out, content)
    size, count = sum(map(len, content.values())), len(content)
    facts = {"out": str(options.out), "files": count, "bytes": size, "rows": len(rows)}
    text = f"rows: {len(rows)}; {count} files, {filesize.decimal(size)}: open "
    print_answer(options, facts, f"{text}{options.out / 'index.html'}")
    return 0


def _text(root: Path, path: Path | str) -> str:
    """Return a generated page as it is; empty if there is none yet."""
    try:
        return outside.read(root / path, most=MOST_GENERATED, below=root).decode()
    except FileNotFoundError:
        return ""
