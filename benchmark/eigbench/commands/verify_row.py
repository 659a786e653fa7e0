"""The command verify-row: it runs the code of rows again, on their split and on a fresh draw."""

import argparse
import contextlib
import datetime
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from eigbench import results
from eigbench.board import leaderboard
from eigbench.board.ranking import RANKED_BY
from eigbench.commands import arguments, predict
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError, ResultError
from eigbench.results import predictions, submission, verification
from eigbench.results.sources import git
from eigbench.results.submission import Submission
from eigbench.running import machine, packages, record, rerun, unseen
from eigbench.running.evaluate import Evaluation, Options, predict_meshes
from eigbench.scoring import scores, targets
from eigbench.scoring.names import MESH, SURFACE
from eigbench.scoring.truth import Truth
from synthnet import recipe, terminal
from synthnet.errors import SynthNetError
from synthnet.verify import seal

SHARE = 0.03  # of each family's surfaces: some hundred shapes, minutes
WRONG = (*terminal.UNSUITABLE, EigbenchError, SynthNetError)  # is one line, and the next row's turn


@dataclass(frozen=True, slots=True)
class _Setup:
    """How the rows of a command are verified, and a directory of its own for that."""

    options: argparse.Namespace
    settings: Options
    checkouts: rerun.Checkouts
    draws: unseen.Draws
    folder: Path


def add_commands(command: Command) -> None:
    """Add verify-row to the command line."""
    text = (
        "run the code of rows again, on their split and on a fresh sealed draw, and write down "
        "what came of it; this runs the files' code"
    )
    example = "benchmark/results/1.0-test-grouped/weyl-s-law.json"
    sub = command("verify-row", verify_rows, text, example)
    text = "the rows' results"
    sub.add_argument("results", type=Path, nargs="+", metavar="RESULT.json", help=text)
    arguments.path(sub, "--predictions", "FILE", "of one row (default: beside the result)")
    where = "(default: the checkout's last commit that has it)"
    arguments.path(sub, "--source", "DIR", f"directory with the code {where}")
    text = "of the fresh draw: surfaces of each family, as a share of the version's"
    text = f"{text} (default: %(default)s)"
    sub.add_argument("--share", type=float, default=SHARE, metavar="P", help=text)
    arguments.compute_device(sub)
    sub.add_argument("--by", metavar="NAME", help="who verifies (default: git's user.name)")
    arguments.path(sub, "--key", "FILE", "an SSH key that signs (default: unsigned)")
    arguments.board(sub)
    arguments.root(sub)
    arguments.time_limit(sub, 3600.0)
    predict.add_readable(sub)
    sub.set_defaults(sandbox="required")


def verify_rows(options: argparse.Namespace) -> int:
    """Run the code of rows again; write what came of it into each, if nothing speaks against.

    A row that cannot be run does not stop those after it.
    """
    by = options.by or git(options.board, "config", "user.name")
    if not by:
        raise EigbenchError("who verifies? give --by NAME, or set git's user.name")
    for option in ("predictions", "readable"):
        if len(options.results) > 1 and getattr(options, option):
            raise EigbenchError(f"--{option} is for one row: verify it by itself")
    settings = predict.settings_of(options, Options)
    if options.key is not None:
        verification.sign("0" * 64, options.key)  # one that cannot sign is found at once
    verified: dict[str, dict[str, Any]] = {}
    with (
        tempfile.TemporaryDirectory() as made,  # a name that does not tell what it is for
        contextlib.closing(
            rerun.Checkouts(options.board, options.source, Path(made) / "commits")
        ) as checkouts,
    ):
        draws = unseen.Draws(options.share, Path(made) / "sealed")
        setup = _Setup(options, settings, checkouts, draws, Path(made))
        rows = [row for path in options.results if (row := _read(path, options))]
        code = 0 if len(rows) == len(options.results) else terminal.WRONG_INPUT
        for number, row in enumerate(rows, start=1):
            if len(options.results) > 1:
                print(f"{number} of {len(rows)}: {row.result_path}", file=sys.stderr)
            code = max(code, _tried(row, setup, by, verified))
    if options.json:
        terminal.print_json(verified)
    elif verified:
        print(f"now: eigbench leaderboard{arguments.board_argument(options)}")
    return code


def _read(path: Path, options: argparse.Namespace) -> Submission | None:
    """Return a row that can be verified; of another say why not."""
    try:
        row = _read_below(path, options.predictions, options.board)
        if row.result["partial"]:
            raise ResultError(f"{path} is partial (made with --limit): evaluate it whole")
        rerun.check_protocol(row)
        seal.check_terms(recipe.load(row.truth.version), options.share, None)
    except WRONG as error:
        terminal.report("eigbench", options, error)
        return None
    # Not the row's to choose: an accelerator's sandbox shows the machine's devices
    if (declared := row.result["cost"]["device"]) != options.device:
        print(
            f"{path} was run with --device {declared}, and is run again with {options.device}",
            file=sys.stderr,
        )
    return row


def _read_below(path: Path, answers: Path | None, board: Path) -> Submission:
    """Read a row and its predictions; below the board, a stranger's checkout, no link is followed.

    Files elsewhere are the maintainer's own: only the file itself must be no link.
    """
    below = _above(path, board)
    if answers is not None and _above(answers, board) != below:
        results.read(path, below)  # what follows would not look at the folders above it
        below = None
    return submission.read(path, answers, below=below)


def _above(path: Path, board: Path) -> Path | None:
    """Return the board's folder as the path to a file spells it; None for a file elsewhere.

    A directory without results, as that in which the command is run, is no board.
    """
    if not (board / leaderboard.RESULTS).is_dir():
        return None
    folders = path.absolute().parents
    return next((folder for folder in folders if folder.exists() and folder.samefile(board)), None)


def _tried(row: Submission, setup: _Setup, by: str, verified: dict[str, dict[str, Any]]) -> int:
    """Verify a row, write what came of it and add it to the others; return the exit code."""
    options, path = setup.options, row.result_path
    try:
        said, against = _verify(row, setup)
        if not against:
            verified[str(path)] = said = _write(row, {**said, "by": by}, options.key)
    except WRONG as error:
        code = terminal.report("eigbench", options, error)
    else:
        code = 1 if against else 0
        for finding in against:
            print(f"eigbench: {finding}", file=sys.stderr)
    if code:
        print(f"{path} is not verified: it stays as it is", file=sys.stderr)
    elif not options.json:
        print(_summary(row, said), flush=True)
    return code


def _verify(row: Submission, setup: _Setup) -> tuple[dict[str, Any], list[str]]:
    """Return what ``verified`` says of a row whose code has run again, and what speaks against."""
    dataset = predict.meshes_of(row.truth, None, setup.options.root)
    with tempfile.TemporaryDirectory(dir=setup.folder) as made:
        folder = Path(made)
        found, commit = setup.checkouts.code(row)
        code = rerun.copied(row, found, folder / "code")
        own = packages.install(code, folder / "packages")
        if own is None:
            print(
                f"{code.name} names no packages (PEP 723): it gets those of this environment",
                file=sys.stderr,
            )
        installed = packages.installed(own)
        with Console(stderr=True).status("drawing and labelling a fresh sealed set"):
            drawn, fresh = setup.draws.of(row.truth.version), setup.draws.labels(row.truth)
        settings = replace(
            setup.settings,
            batch_size=unseen.batch_size(row.batch_size, fresh),
            seeds=len(row.predictions),
            threads=row.result["cost"]["threads"],
            packages=own,
        )
        targeted = [(row.truth, fresh)]
        if (surfaces := targets.at(row.truth, SURFACE)) is not None:
            with Console(stderr=True).status("computing the spectra of the fresh surfaces"):
                targeted.append((surfaces, setup.draws.surfaces(row.truth, fresh)))
        every = [unseen.mixed(*pair) for pair in targeted]
        both = every[0]
        given = unseen.mixed_meshes(
            predict.read_meshes(dataset, row.truth), predict.read_meshes(drawn, fresh)
        )
        public = len(row.truth.ids)
        sets = (np.arange(len(both.ids)) >= public).astype(np.int64)
        answers = folder / "answers"
        evaluation = predict.answers(code, both, given, settings, answers, sets=sets)
        chosen = unseen.one_per_surface(both)
        ids = [both.ids[i] for i in chosen]
        with Console(stderr=True).status(f"asking for {len(ids)} meshes by themselves"):
            apart = predict_meshes(
                code,
                ids,
                [given.mesh(id) for id in ids],
                both.eigenvalues.shape[1],
                replace(settings, batch_size=1),
                training=str(both.trainings[chosen[0]]),
            )
    verified, against = _compared(row, targeted, evaluation)
    against += record.copies_answered_otherwise(every, evaluation)
    against += rerun.better_among_others(every, chosen, evaluation.predictions[0], apart)
    against += filter(None, [unseen.slower(evaluation, given, both, public)])
    verified["sealed"]["share"] = setup.options.share
    return verified | {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "commit": commit,
        "machine": machine.hardware(),
        "sandbox": settings.sandbox,
        "packages": installed,
    }, against


def _write(row: Submission, verified: dict[str, Any], key: Path | None) -> dict[str, Any]:
    """Write into a row's result what is verified, with its digest and, with a key, a signature."""
    result = {**row.result, "verified": verified}
    verified["digest"] = verification.digest(result)
    if key is not None:
        verified["signature"] = verification.sign(verified["digest"], key)
    results.write(row.result_path, result)
    return verified


def _compared(
    row: Submission, targeted: Sequence[tuple[Truth, Truth]], evaluation: Evaluation
) -> tuple[dict[str, Any], list[str]]:
    """Return the scores as ``verified`` has them, and what speaks against the row.

    ``targeted`` are the labels of the row's own split and of the fresh draw at each target, the
    meshes' first. The answers are of the split first, and of the draw behind.
    """
    model, status = row.result["model"], evaluation.status
    answered, unseen = np.split(evaluation.predictions, [len(row.truth.ids)], axis=1)
    named, used = model["sources"], status.sources
    problems = [
        f"{name} is not the file that the result names"
        for name in sorted(set(named) | set(used))
        if named.get(name) != used.get(name)
    ]
    if status.refused:
        problems.append(f"its sandbox has refused: {', '.join(status.refused[:3])}")
    numbers: dict[str, Any] = {}
    for target, scored in scores.of_targets(row.truth, answered).items():
        numbers[target] = None if scored is None else _interval(scored)
        if scored is None:
            continue
        declared = row.result["scores"][target]["overall"][RANKED_BY]["mean"]
        numbers[target]["declared"] = declared
        if not verification.within(declared, numbers[target]):
            problems.append(
                f"against the {target}, {RANKED_BY} is {declared} as declared, and "
                f"{numbers[target]['mean']} when run again"
            )
    fresh = targeted[0][1]
    sealed: dict[str, Any] = {
        "shapes": len(set(fresh.shapes.tolist())),
        "instances": len(fresh.ids),
    }
    for public, drawn in targeted:
        here, there = numbers[public.target], _interval(scores.score(drawn, unseen))
        sealed |= there if public.target == MESH else {public.target: there}
        least = max(here["high"] or 0, verification.SAME)  # an RPD is itself relative
        if there["low"] is None or there["low"] > least:
            problems.append(
                f"on shapes that nobody has seen, {RANKED_BY} against the {public.target} is "
                f"{there['mean']} ({there['low']} to {there['high']}), significantly worse than "
                f"{here['mean']} on the public split"
            )
        for labels, predicted in ((public, answered), (drawn, unseen)):
            problems.append(predictions.looked_up(model["kind"], labels, predicted))
    return {"scores": numbers, "sealed": sealed}, [*filter(None, problems)]


def _interval(scored: dict[str, Any]) -> dict[str, float | None]:
    return {key: scored["overall"][RANKED_BY][key] for key in ("mean", "low", "high")}


def _summary(row: Submission, verified: dict[str, Any]) -> str:
    sealed, mesh = verified["sealed"], verified["scores"][MESH]
    return (
        f"{row.name} is verified by {verified['by']}, sandbox {verified['sandbox']}: {RANKED_BY} "
        f"{mesh['mean']:.4g} on the split, {sealed['mean']:.4g} on {sealed['instances']:,} meshes "
        f"that nobody has seen; {row.result_path} says so"
    )
