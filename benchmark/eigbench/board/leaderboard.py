"""LEADERBOARD.md: generated from results, predictions and pinned labels, the same to the byte.

A board is all results of one dataset, split and protocol. In a checkout::

    LEADERBOARD.md                              generated
    README.md                                   generated between its marks of the leaderboard
    benchmark/results/BOARD/MODEL.json          placed by `eigbench submit`
    benchmark/predictions/BOARD/MODEL.parquet   placed by `eigbench submit`
    benchmark/figures/BOARD.svg                 generated
    benchmark/reported/*.json                   numbers of papers, as printed
    benchmark/scaling/MODEL.json                placed by `eigbench submit`, see scaling.results
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from eigbench import results
from eigbench.board import figures, generalisation, page, ranking
from eigbench.board import scaling_page as scaling_page
from eigbench.board.marks import marked
from eigbench.board.ranking import Ranked
from eigbench.errors import ResultError
from eigbench.results import predictions, submission
from eigbench.results.submission import Submission
from eigbench.scaling.results import Scaled
from eigbench.scoring.training import IMPORTED
from synthnet import recipe
from synthnet.types import PROTOCOLS

PAGE = "LEADERBOARD.md"
README = "README.md"
MARK = "<!-- begin leaderboard -->"  # a board of one's own may have a README without it
RESULTS = Path("benchmark", "results")
PREDICTIONS = Path("benchmark", "predictions")
FIGURES = Path("benchmark", "figures")
REPORTED = Path("benchmark", "reported")


def read(root: Path, on_row: Callable[[str], None] | None = None) -> list[Submission]:
    """Read every submission under a checkout, each checked against its predictions.

    Raises
    ------
    ResultError
        If one is partial, misplaced, without predictions, or does not bear its scores out.
    """
    found = []
    paths = sorted((root / RESULTS).glob("*/*.json"))
    for path in paths:
        if on_row is not None:
            on_row(f"{path.parent.name}/{path.stem}")
        predictions = root / PREDICTIONS / path.parent.name / f"{path.stem}.parquet"
        one = submission.read(path, predictions)
        check_fit(one)
        if (one.board, one.slug) != (path.parent.name, path.stem):
            raise ResultError(f"{path} belongs at {RESULTS / one.board / one.slug}.json")
        found.append(one)
    _check_protocols(found)
    known = {
        path
        for one in found
        for path in (
            one.result_path,
            one.predictions_path,
            submission.remark_path(one.result_path),
        )
    }
    for folder in (RESULTS, PREDICTIONS):
        for path in sorted((root / folder).rglob("*")):
            if path.is_file() and path not in known:
                raise ResultError(f"{path} belongs to no row: remove it, or submit its result")
    return found


def _check_protocols(found: Sequence[Submission]) -> None:
    """Check that who has a result under a version's own protocol has one under ``grouped``."""
    whole = {(one.truth.version, one.slug): one for one in found if one.truth.protocol == "grouped"}
    for one in found:
        base = whole.get((one.truth.version, one.slug))
        if one.truth.protocol in PROTOCOLS:
            continue
        if base is None:
            raise ResultError(
                f"{one.result_path}: {one.name} has a result under {one.truth.protocol} and none "
                f"under grouped of {one.truth.version} to compare it with: submit that too"
            )
        if one.result["model"]["sources"] != base.result["model"]["sources"]:
            raise ResultError(
                f"{one.result_path} and {base.result_path} are of other code, or other weights: "
                "the drop between them would say nothing; evaluate both anew"
            )


def check_fit(one: Submission) -> None:
    """Check that a submission may stand on a board.

    Raises
    ------
    ResultError
        If it is partial, not of a test split, of a single training of a protocol, not in
        Parquet, or has predictions that are not finite or not positive.
    """
    split, protocol = (one.result["dataset"][key] for key in ("split", "protocol"))
    problem = predictions.unphysical(one.truth, one.predictions)
    if one.result["partial"]:
        raise ResultError(f"{one.result_path} is partial (made with --limit): evaluate it whole")
    if split != "test":
        raise ResultError(f"{one.result_path} is of the split {split}: a board takes test only")
    if "/" in protocol and not protocol.startswith(IMPORTED):
        whole = protocol.partition("/")[0]
        raise ResultError(
            f"{one.result_path} is of {protocol} alone: evaluate it with --protocol {whole}"
        )
    if one.predictions_path.suffix != ".parquet":
        raise ResultError(f"{one.predictions_path} must be the Parquet file of `eigbench evaluate`")
    if problem:
        raise ResultError(f"{one.predictions_path}: {problem}")


def generate(
    submissions: Iterable[Submission],
    reported: Sequence[dict[str, Any]],
    scaled: Sequence[Scaled] = (),
    readme: str = "",
) -> dict[Path, str]:
    """Return the text of each generated file, by its place in the checkout.

    The order of the input does not matter. ``readme`` is the README as it is: where it has the
    marks, the first rows of each board go between them.

    Raises
    ------
    ValueError
        If it has the marks more than once, or not both of them.
    """
    submissions = list(submissions)
    parts, tops, generated = [page.BANNER], [], {}
    for rows, protocols in boards(submissions):
        place = FIGURES / f"{rows[0].submission.board}.svg"
        generated[place] = figures.error_against_time([row.submission for row in rows])
        parts += page.board(rows, place)
        tops.append(page.top(rows))
        if protocols is not None:
            place = FIGURES / f"{protocols.version}-generalisation.svg"
            generated[place] = figures.generalisation(protocols)
            parts += generalisation.section(protocols, place.as_posix())
            tops.append(generalisation.top(protocols, page.TOP))
    if not submissions:
        parts.append("No result has been submitted yet.\n")
    section, drawn = scaling_page.section(scaled)
    parts += section
    generated.update(drawn)
    for paper in sorted(reported, key=lambda paper: str(paper["source"])):
        parts += page.reported(paper)
    generated[Path(PAGE)] = "\n".join(parts)
    if MARK in readme:
        generated[Path(README)] = _with_tops(readme, tops)
    return generated


def _with_tops(readme: str, tops: Sequence[str]) -> str:
    try:
        return marked(readme, "leaderboard", "\n" + "\n".join(tops))
    except ValueError as error:
        raise ValueError(f"{README} has {error}") from error


def boards(
    submissions: Iterable[Submission],
) -> Iterator[tuple[list[Ranked], generalisation.Board | None]]:
    """Yield the rows of each board, best first, by version and protocol.

    With those of a version's protocol ``grouped`` go its own protocols, if it has any: who was
    evaluated under these stands beside who was under that, on no board apart.
    """
    by_board: dict[str, list[Submission]] = {}
    for one in submissions:
        by_board.setdefault(one.board, []).append(one)
    for board in sorted(by_board):
        version, protocol = by_board[board][0].truth.version, by_board[board][0].truth.protocol
        if protocol not in PROTOCOLS:
            continue
        rows = ranking.ranked(by_board[board])
        if protocol != "grouped" or not recipe.load(version).protocols:
            yield rows, None
            continue
        held_out = {
            found[0].truth.protocol: found
            for found in by_board.values()
            if found[0].truth.version == version and found[0].truth.protocol not in PROTOCOLS
        }
        yield rows, generalisation.Board(rows, held_out)


def read_reported(root: Path) -> list[dict[str, Any]]:
    """Read the papers' own numbers."""
    return [json.loads(path.read_text()) for path in sorted((root / REPORTED).glob("*.json"))]


def place(one: Submission, root: Path, *, replace: bool = False) -> tuple[Path, Path]:
    """Copy a result and its predictions to their places; return these.

    Raises
    ------
    ResultError
        If it does not fit, see :func:`check_fit`, or was not timed beside LaPy and its times
        are to be shown: those of a version's own protocols are not.
    EigbenchError
        If another of that name is there and ``replace`` is not given.
    """
    check_fit(one)
    if one.truth.protocol in PROTOCOLS and one.result["cost"].get("reference") is None:
        raise ResultError(
            f"{one.result_path} was not timed beside LaPy: evaluate without --no-reference"
        )
    generate([one], [])  # a row that cannot be drawn would break the page for all
    places = (
        root / RESULTS / one.board / f"{one.slug}.json",
        root / PREDICTIONS / one.board / f"{one.slug}.parquet",
    )
    results.put((one.result_path, one.predictions_path), places, replace=replace)
    return places
