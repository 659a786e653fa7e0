"""The command submit: it puts a result on a board, or says where it would stand."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from eigbench.board import leaderboard, page, scaling_page
from eigbench.board.ranking import Ranked, count_ranked
from eigbench.commands import arguments, score
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError
from eigbench.results import submission
from eigbench.results.submission import Submission
from eigbench.results.verification import is_verified
from eigbench.scaling import results as scaling_results

ROWS_AROUND = 2  # rows above and below that a dry run shows


def add_commands(command: Command) -> None:
    """Add submit to the command line."""
    text = "check a result and its predictions, and put both on the board"
    sub = command("submit", submit, text, "results.json")
    text = "made by `eigbench evaluate`"
    sub.add_argument("result", type=Path, metavar="RESULT.json", help=text)
    text = "its predictions (default: beside the result)"
    arguments.path(sub, "--predictions", "FILE", text)
    text = "write nothing: check both and show between which rows the result would stand"
    sub.add_argument("--dry-run", action="store_true", help=text)
    sub.add_argument("--replace", action="store_true", help="replace the model's earlier result")
    arguments.board(sub)
    arguments.dataset(sub, None, "with --dry-run, the import or directory that was predicted")
    arguments.root(sub)


def submit(options: argparse.Namespace) -> int:
    """Check a result with its predictions and put both on the board, or say where it would be."""
    if scaling_results.is_scaled(options.result):
        return _submit_scaled(options)
    root = arguments.board_root(options, make=not options.dry_run)
    dataset = arguments.unpinned(options.dataset, options.root)
    if dataset is not None and not options.dry_run:
        raise EigbenchError(
            f"the labels of {options.dataset} are not pinned, so that no board has its results; "
            "add --dry-run to check one"
        )
    row = submission.read(options.result, options.predictions, dataset)
    if is_verified(row.result) and not options.dry_run:
        raise EigbenchError(
            f"{options.result} says that it is verified, and a submitted row is not: `eigbench "
            "verify-row` says so of a row on the board; take 'verified' out of the file"
        )
    kind = row.result["model"]["kind"]
    score.warn_of_answers(kind, row.truth, row.predictions)
    if options.dry_run:
        return _try(row, root, options)
    paths = leaderboard.add(row, root, replace=options.replace)
    if options.json:
        print(json.dumps({"model": row.name, "board": row.board, "files": list(map(str, paths))}))
        return 0
    print(f"{row.name}: every score follows from its predictions; cost and physics as declared")
    for path in paths:
        print(f"  {path}")
    remark = submission.remark_path(paths[0])
    if remark.is_file():
        print(f"the remark on the earlier result stays: {remark}")
    print(f"now: eigbench leaderboard{arguments.board_argument(options)}")
    return 0


def _submit_scaled(options: argparse.Namespace) -> int:
    """Put a result of the scaling track, which holds its predictions, on the board."""
    root = arguments.board_root(options, make=not options.dry_run)
    row = scaling_results.read(options.result)
    scaling_page.section([row])  # a row that cannot be drawn would break the page for all
    paths = [] if options.dry_run else [scaling_results.add(row, root, replace=options.replace)]
    if options.json:
        print(json.dumps({"model": row.name, "board": "scaling", "files": list(map(str, paths))}))
        return 0
    print(f"{row.name}: the meshes are the pinned ones; times as declared")
    if options.dry_run:
        print("nothing was written; the scaling track has no ranks")
        return 0
    print(f"  {paths[0]}\nnow: eigbench leaderboard{arguments.board_argument(options)}")
    return 0


def _try(row: Submission, root: Path, options: argparse.Namespace) -> int:
    """Show where a result would stand, beside each target."""
    with Console(stderr=True).status("scoring") as status:
        boards = leaderboard.placed(row, root, lambda other: status.update(f"scoring {other}"))
    there, _ = leaderboard.paths_of(root, row.board, row.slug)
    taken = str(there) if there.is_file() else None
    if options.json:
        targets = {rows[0].submission.target: _place(rows, row) for rows in boards}
        facts = {"model": row.name, "board": row.board, "replaces": taken, "targets": targets}
        print(json.dumps(facts, indent=1))
        return 0
    for rows in boards:
        at = _index(rows, row)
        near = rows[max(at - ROWS_AROUND, 0) : at + ROWS_AROUND + 1]
        shown = rows[at].shown_rank
        stand = f"have rank {shown} of {count_ranked(rows)}"
        if rows[at].ranks is None:
            stand = f"stand as {shown}, without a rank"
        print(f"{page.title(rows)}: {row.name} would {stand}\n")
        print(f"{page.top_table(near)}\n")
    print("a rank is an interval: the true one is in it with a chance of 95 %; nothing was written")
    if taken and not options.replace:
        print(f"{taken} has that name: `eigbench submit` needs --replace")
    return 0


def _place(rows: Sequence[Ranked], row: Submission) -> dict[str, Any]:
    """Return a row's interval of ranks and its neighbours as JSON-ready data."""
    at = _index(rows, row)
    above, below = rows[max(at - ROWS_AROUND, 0) : at], rows[at + 1 : at + ROWS_AROUND + 1]
    return {
        "rows": len(rows),
        "ranked": count_ranked(rows),
        "rank": rows[at].ranks,
        "exact": rows[at].exact,
        "above": [other.submission.name for other in above],
        "below": [other.submission.name for other in below],
    }


def _index(rows: Sequence[Ranked], row: Submission) -> int:
    return next(i for i, other in enumerate(rows) if other.submission.slug == row.slug)
