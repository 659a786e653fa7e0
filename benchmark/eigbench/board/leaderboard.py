"""LEADERBOARD.md: generated from results, predictions and pinned labels, the same to the byte.

A board is all results of one dataset, split and protocol. In a checkout::

    LEADERBOARD.md                              generated, one table a board
    README.md                                   generated between its marks of the leaderboard
    benchmark/boards/BOARD-TARGET.md, .json     generated, all that is known of a board
    benchmark/boards/scaling.md, .json          generated, of the scaling track
    benchmark/boards/reported.md                generated, the papers' own tables
    benchmark/results/BOARD/MODEL.json          added by `eigbench submit`
    benchmark/predictions/BOARD/MODEL.parquet   added by `eigbench submit`
    benchmark/timing/VERSION.json               of `eigbench time`: the cost of rows in one run
    benchmark/figures/BOARD-TARGET.svg          generated
    benchmark/reported/*.json                   numbers of papers, as printed
    benchmark/not-run.json                      why models have no row under a protocol
    benchmark/scaling/MODEL.json                added by `eigbench submit`, see scaling.results
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from eigbench import results
from eigbench.board import (
    answer_figure,
    export,
    figures,
    generalisation,
    generalisation_figure,
    page,
    ranking,
    scaling_page,
)
from eigbench.board.generalisation import NotRun
from eigbench.board.markdown import marked
from eigbench.board.ranking import Ranked
from eigbench.errors import ResultError
from eigbench.results import predictions, submission, timing, verification
from eigbench.results.submission import Submission
from eigbench.scaling.results import Scaled
from eigbench.scoring.names import SURFACE, TARGETS
from eigbench.scoring.training import on_imports, untrained
from synthnet import recipe
from synthnet.types import PROTOCOLS

PAGE = "LEADERBOARD.md"
README = "README.md"
MARK = "<!-- begin leaderboard -->"  # a README without it stays as it is
FINDING = "<!-- begin finding -->"  # may be there too
RESULTS = Path("benchmark", "results")
PREDICTIONS = Path("benchmark", "predictions")
FIGURES = Path("benchmark", "figures")
BOARDS = Path("benchmark", "boards")
GENERATED = (f"{FIGURES}/*.svg", f"{BOARDS}/*")  # nothing else belongs there
REPRODUCTION = Path("benchmark", "reproduction")  # of the paper's tables
REPORTED = Path("benchmark", "reported")
WHY_NOT = Path("benchmark", "not-run.json")


def read(
    root: Path,
    on_row: Callable[[str], None] = lambda row: None,
    boards: Sequence[str] | None = None,
) -> list[Submission]:
    """Read the submissions under a checkout, each checked against its predictions.

    Of the boards named, such as ``2.0-test-grouped``, alone, or of all. Of all they are checked
    against each other too, and no file may be of none.

    Raises
    ------
    ResultError
        If one is partial, misplaced, without predictions, or does not bear its scores out; or if
        a board that is named has no rows.
    """
    if boards is not None:
        there = sorted({path.parent.name for path in (root / RESULTS).glob("*/*.json")})
        for board in boards:
            if board not in there:
                known = ", ".join(there) or "none"
                raise ResultError(f"{root} has no board {board!r}; there is {known}")
        return [row for board in dict.fromkeys(boards) for row in _rows(root, board, on_row)]
    rows = _rows(root, "*", on_row)
    _check_protocols(rows)
    _check_strays(root, rows)
    return rows


def rescore(root: Path, on_row: Callable[[str], None] = lambda row: None) -> list[Path]:
    """Score every result on a board anew from its predictions; return those that have changed.

    For when the metrics have: then no result is read before. Those of the paper's tables are among
    them, which lie beside their predictions.

    Raises
    ------
    ResultError
        If one does not fit its predictions.
    """
    every = {
        path: root / PREDICTIONS / path.parent.name / f"{path.stem}.parquet"
        for path in (root / RESULTS).glob("*/*.json")
    }
    every |= {p: p.with_suffix(".parquet") for p in (root / REPRODUCTION).glob("*/*.json")}
    changed = []
    for path, kept in sorted(every.items()):
        on_row(f"{path.parent.name}/{path.stem}")
        result = submission.rescored(path, kept, below=root)
        if result != results.load(path, below=root):
            results.write(path, result)
            changed.append(path)
    return changed


def _rows(root: Path, board: str, on_row: Callable[[str], None]) -> list[Submission]:
    """Read the submissions of a board, or with ``*`` of all, as they are."""
    rows, times = [], timing.read(root)
    for path in sorted((root / RESULTS).glob(f"{board}/*.json")):
        on_row(f"{path.parent.name}/{path.stem}")
        kept = root / PREDICTIONS / path.parent.name / f"{path.stem}.parquet"
        row = submission.read(path, kept, below=root)
        check_fit(row)
        verification.check(row.result, path, root)
        if (row.board, row.slug) != (path.parent.name, path.stem):
            raise ResultError(f"{path} belongs at {RESULTS / row.board / row.slug}.json")
        timed = timing.row_of(row.result, times.get(row.truth.version, []))
        if timed is not None:
            row = replace(row, result={**row.result, "cost": timing.cost_of(timed)})
            check_fit(row)
            if row.truth.protocol == "grouped":
                timing.check_answers(timed, row)
        rows.append(row)
    return rows


def _check_strays(root: Path, rows: Sequence[Submission]) -> None:
    """Check that every file of results and predictions is of a row."""
    known = {
        path
        for row in rows
        for path in (row.result_path, row.predictions_path, submission.remark_path(row.result_path))
    }
    for folder in (RESULTS, PREDICTIONS):
        for path in sorted((root / folder).rglob("*")):
            if (path.is_symlink() or not path.is_dir()) and path not in known:
                raise ResultError(f"{path} belongs to no row: remove it, or submit its result")


def _of_same_code(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Return whether the files that one names are among the other's, with the same digests.

    Earlier releases did not name what lies beside an imported module.
    """
    a, b = one["sources"].items(), other["sources"].items()
    return bool(one["code"] == other["code"] and (a <= b or b <= a))


def _check_protocols(rows: Sequence[Submission]) -> None:
    """Check that a row of a version's own protocol has one under ``grouped``.

    That of a trained model must be of the same code, because the drop between the two is shown.
    """
    grouped = {
        (row.truth.version, row.slug): row for row in rows if row.truth.protocol == "grouped"
    }
    for row in rows:
        if row.truth.protocol in PROTOCOLS:
            continue
        base = grouped.get((row.truth.version, row.slug))
        _check_protocol(row, None if base is None else (base.result_path, base.result))


def _check_protocol(row: Submission, base: tuple[Path, dict[str, Any]] | None) -> None:
    """Check a row of a version's own protocol against the same model's result under ``grouped``."""
    if base is None:
        raise ResultError(
            f"{row.result_path}: {row.name} has a result under {row.truth.protocol} and none "
            f"under grouped of {row.truth.version} to compare it with: submit that first"
        )
    path, grouped = base
    model = row.result["model"]
    if not untrained(model) and not _of_same_code(model, grouped["model"]):
        raise ResultError(
            f"{row.result_path} and {path} are of other code, or other weights: "
            "the drop between them would say nothing; evaluate both anew, grouped first"
        )


def check_fit(row: Submission) -> None:
    """Check that a submission may stand on a board.

    Raises
    ------
    ResultError
        If it is partial, not of a test split, of a single training of a protocol, not in
        Parquet, has predictions that no eigenvalue has (not finite, not positive, far too large
        or small), or used more cores than its threads.
    """
    split, protocol = (row.result["dataset"][key] for key in ("split", "protocol"))
    problem = predictions.unphysical(row.truth, row.predictions)
    if row.result["partial"]:
        raise ResultError(f"{row.result_path} is partial (made with --limit): evaluate it whole")
    if split != "test":
        raise ResultError(f"{row.result_path} is of the split {split}: a board takes test only")
    if "/" in protocol and not on_imports(protocol):
        whole = protocol.partition("/")[0]
        raise ResultError(
            f"{row.result_path} is of {protocol} alone: evaluate it with --protocol {whole}"
        )
    if row.predictions_path.suffix != ".parquet":
        raise ResultError(f"{row.predictions_path} must be the Parquet file of `eigbench evaluate`")
    if problem:
        raise ResultError(f"{row.predictions_path}: {problem}")
    if results.overused(cost := row.result["cost"]):
        raise ResultError(
            f"{row.result_path} used {cost['cores_used']:.1f} cores and declares "
            f"{cost['threads']} threads: evaluate with --threads that allows for them"
        )


def generate(
    submissions: Iterable[Submission],
    reported: Sequence[dict[str, Any]],
    scaled: Sequence[Scaled] = (),
    readme: str = "",
    not_run: Sequence[NotRun] = (),
) -> dict[Path, str]:
    """Return the text of each generated file, by its path in the checkout.

    The order of the input does not matter. ``readme`` is the text of the README: where it has the
    marks, the first rows of each board go between them.

    Raises
    ------
    ValueError
        If the README has the marks more than once, or not both of them.
    """
    every = list(boards(submissions, not_run))
    opening, parts = [], []
    generated: dict[Path, str] = {}
    held_out: dict[str, list[str]] = {}  # by version, for the README
    finding = ""
    tops: dict[str, str] = {}
    for rows, protocols in every:
        submission = rows[0].submission
        files = _files(f"{submission.board}-{submission.target}")
        timed = [row.submission for row in rows if not row.declared]
        texts = page.details(rows), export.as_json(rows), figures.error_against_time(timed)
        generated.update(zip(files, texts, strict=True))
        parts += page.board(rows, *files)
        if protocols is not None:
            files = _files(f"{protocols.version}-generalisation-{protocols.target}")
            drawn = {page.DROP: files[2]}
            generated[files[0]] = page.generalised_details(protocols)
            generated[files[1]] = export.generalised_as_json(protocols)
            generated[files[2]] = generalisation_figure.draw(protocols)
            if (
                submission.target == SURFACE
                and answer_figure.UNSEEN_PROTOCOL in protocols.protocols
            ):
                path = drawn[page.ANSWER] = FIGURES / f"{protocols.version}-answer.svg"
                generated[path] = answer_figure.draw(protocols)
                narrow = path.with_stem(f"{path.stem}-narrow")  # which the site shows on phones
                generated[narrow] = answer_figure.draw(protocols, layout=answer_figure.NARROW)
                # The newest version comes first
                finding = finding or answer_figure.sentences(protocols)
            opening += page.generalised(protocols, *files[:2], drawn)
            mine = held_out.setdefault(protocols.version, [])
            mine.append(
                page.generalised_best(protocols, files[0])
                if mine
                else page.generalised_top(protocols, page.TOP)
            )
        tops.setdefault(submission.board, page.top(rows))  # beside the first of its targets
    if not every:
        parts.append("No result has been submitted yet.\n")
    section, files_of_track = scaling_page.section(scaled)
    parts += section
    generated |= files_of_track
    if reported:
        papers = sorted(reported, key=lambda paper: str(paper["source"]))
        generated[BOARDS / "reported.md"] = page.reported(papers)
        parts += page.reported_section(papers, BOARDS / "reported.md")
    generated[Path(PAGE)] = "\n".join([page.BANNER, *opening, *parts])
    if MARK in readme:
        first = [*next(iter(held_out.values()), []), *list(tops.values())[:1]]
        generated[Path(README)] = _filled(readme, first, finding)
    return generated


def _files(name: str) -> tuple[Path, Path, Path]:
    """Return the paths of a page, its JSON and its figure."""
    return BOARDS / f"{name}.md", BOARDS / f"{name}.json", FIGURES / f"{name}.svg"


def _filled(readme: str, tops: Sequence[str], finding: str) -> str:
    try:
        if FINDING in readme:
            readme = marked(readme, "finding", f"\n{finding}\n")
        return marked(readme, "leaderboard", "\n" + "\n".join(tops))
    except ValueError as error:
        raise ValueError(f"{README} has {error}") from error


def boards(
    submissions: Iterable[Submission], not_run: Sequence[NotRun] = ()
) -> Iterator[tuple[list[Ranked], generalisation.Board | None]]:
    """Yield the rows of each board, best first: the newest versions first, the surface first.

    The rows of a version's protocol ``grouped`` come with its own protocols, if it has any: a row
    of these stands beside the same model's under ``grouped``, on no board of its own.
    """
    by_board: dict[tuple[str, str], list[Submission]] = {}
    for row in submissions:
        by_board.setdefault((row.truth.version, row.truth.protocol), []).append(row)
    for version, protocol in sorted(by_board, key=_newest_first):
        for target in TARGETS:
            rows = _at(by_board[version, protocol], target)
            if protocol not in PROTOCOLS or not rows:
                continue
            ordered = ranking.ranked(rows)
            if protocol != "grouped" or not recipe.load(version).protocols:
                yield ordered, None
                continue
            others = {p: _at(mine, target) for (v, p), mine in by_board.items() if v == version}
            held_out = {p: mine for p, mine in others.items() if mine and p not in PROTOCOLS}
            why = [entry for entry in not_run if entry.version == version]
            yield ordered, generalisation.Board(ordered, held_out, why)


def _newest_first(board: tuple[str, str]) -> tuple[int, str, str]:
    """Return what boards are sorted by: a new major version first, then those that add to it."""
    version, protocol = board
    major, _, _ = recipe.load(version).base.partition(".")
    return -int(major), version, protocol


def _at(submissions: Iterable[Submission], target: str) -> list[Submission]:
    """Return the submissions beside a target, where it is known."""
    return [there for row in submissions if (there := row.at(target)) is not None]


def read_reported(root: Path) -> list[dict[str, Any]]:
    """Read the papers' own numbers.

    Raises
    ------
    ResultError
        If a file holds no such tables.
    """
    papers = []
    for path in sorted((root / REPORTED).glob("*.json")):
        paper = results.load(path, below=root)
        results.check_schema(paper, results.schema("reported"), path)
        papers.append(paper)
    return papers


def read_not_run(root: Path, rows: Iterable[Submission]) -> list[NotRun]:
    """Read why models of a board have no row under a protocol.

    Raises
    ------
    ResultError
        If the file is no list of such reasons, or one of them is of nothing that is missing.
    """
    path = root / WHY_NOT
    if not path.exists():
        return []
    content = results.load(path, below=root)
    results.check_schema(content, results.schema("not-run"), path)
    entries = [NotRun(**entry) for entry in content["reasons"]]
    known = {(row.truth.version, row.truth.protocol, row.name) for row in rows}
    for entry in entries:
        for protocol, model in itertools.product(entry.protocols, entry.models):
            if (entry.version, "grouped", model) not in known:
                raise ResultError(f"{path}: {model} has no row under grouped of {entry.version}")
            if not (
                on_imports(protocol) or protocol in (recipe.load(entry.version).protocols or ())
            ):
                raise ResultError(f"{path}: {entry.version} has no protocol {protocol}")
            if (entry.version, protocol, model) in known:
                raise ResultError(
                    f"{path}: {model} has a row under {protocol} of {entry.version}, so there is "
                    "no reason to give: remove it"
                )
    return entries


def add(row: Submission, root: Path, *, replace: bool = False) -> tuple[Path, Path]:
    """Copy a result and its predictions onto a board; return their paths there.

    Raises
    ------
    ResultError
        If it does not fit, see :func:`check_fit`, or was not timed beside LaPy and its times are
        to be shown: those of a version's own protocols are not, but the same model must be on the
        board ``grouped`` before it.
    EigbenchError
        If another of that name is there and ``replace`` is not given.
    """
    _check_new(row, root)
    paths = paths_of(root, row.board, row.slug)
    results.put((row.result_path, row.predictions_path), paths, root, replace=replace)
    return paths


def paths_of(root: Path, board: str, slug: str) -> tuple[Path, Path]:
    """Return where the result and the predictions of a model are on a board, or would be."""
    return root / RESULTS / board / f"{slug}.json", root / PREDICTIONS / board / f"{slug}.parquet"


def placed(
    row: Submission, root: Path, on_row: Callable[[str], None] = lambda row: None
) -> list[list[Ranked]]:
    """Return a submission among the rows of its board, best first, beside each target it has.

    An earlier result of the same model is left out, as :func:`add` would replace it.

    Raises
    ------
    ResultError
        If it does not fit, as :func:`add`.
    """
    _check_new(row, root)
    others = [other for other in _rows(root, row.board, on_row) if other.slug != row.slug]
    by_target = (_at([*others, row], target) for target in TARGETS)
    return [ranking.ranked(rows) for rows in by_target if rows]


def _check_new(row: Submission, root: Path) -> None:
    """Check that a submission may be added, and was timed beside LaPy if its times are shown."""
    check_fit(row)
    if row.truth.protocol not in PROTOCOLS:
        base, _ = paths_of(root, f"{row.truth.version}-test-grouped", row.slug)
        _check_protocol(row, (base, results.read(base, root)) if base.is_file() else None)
    elif row.result["cost"].get("reference") is None:
        raise ResultError(
            f"{row.result_path} was not timed beside LaPy: evaluate without --no-reference"
        )
    if row.truth.version in recipe.available():  # of an import there is no page
        generate([row], [])  # a row that cannot be drawn would break the page for all
