"""The command verify-row: it runs the code of rows again, on their split and on a fresh draw."""

from __future__ import annotations

import argparse
import contextlib
import datetime
import json
import secrets
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from eigbench import results
from eigbench.board.ranking import RANKED_BY
from eigbench.commands import arguments, predict
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError, ResultError
from eigbench.results import predictions, submission, verification
from eigbench.results.sources import digest, git
from eigbench.results.submission import Submission
from eigbench.running import packages, record
from eigbench.running.evaluate import Evaluation, Options
from eigbench.scoring import scores, truth
from eigbench.scoring.names import MESH
from synthnet import recipe, store, terminal
from synthnet.errors import SynthNetError
from synthnet.verify import seal

SHARE = 0.03  # of each family's surfaces: some hundred shapes, minutes
WRONG = (*terminal.UNSUITABLE, EigbenchError, SynthNetError)  # is one line, and the next row's turn
ROUNDING = 1e-6  # relative: what another processor may make of a mean


def add_commands(command: Command) -> None:
    """Add verify-row to the command line."""
    sub = command(
        "verify-row",
        verify_rows,
        "run the code of rows again, on their split and on a fresh sealed draw, and write down "
        "what came of it; this runs the files' code",
        "benchmark/results/1.0-test-grouped/weyl-s-law.json",
    )
    sub.add_argument(
        "results", type=Path, nargs="+", metavar="RESULT.json", help="the rows' results"
    )
    arguments.path(sub, "--predictions", "FILE", "of one row (default: beside the result)")
    where = "(default: the checkout's last commit, else the commit that the result names)"
    arguments.path(sub, "--source", "DIR", f"directory with the code {where}")
    sub.add_argument(
        "--share",
        type=float,
        default=SHARE,
        metavar="P",
        help="of the fresh draw: surfaces of each family, as a share of the version's (default: "
        "%(default)s)",
    )
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
        tempfile.TemporaryDirectory(prefix="eigbench-verify-") as made,
        contextlib.closing(_Desk(options, settings, Path(made))) as desk,
    ):
        rows = [row for path in options.results if (row := _read(path, options))]
        code = 0 if len(rows) == len(options.results) else terminal.WRONG_INPUT
        for number, row in enumerate(rows, start=1):
            if len(options.results) > 1:
                print(f"{number} of {len(rows)}: {row.result_path}", file=sys.stderr)
            code = max(code, _tried(row, desk, by, verified))
    if options.json:
        print(json.dumps(verified, indent=1))
    elif verified:
        print(f"now: eigbench leaderboard{arguments.board_argument(options)}")
    return code


def _read(path: Path, options: argparse.Namespace) -> Submission | None:
    """Return a row that can be verified; of another say why not."""
    try:
        row = submission.read(path, options.predictions)
        if row.result["partial"] or row.truth.protocol != "grouped":
            raise ResultError(f"{path} is no whole result under the protocol grouped")
        seal.check_terms(recipe.load(row.truth.version), options.share, None)
    except WRONG as error:
        terminal.report("eigbench", options, error)
        return None
    return row


def _tried(row: Submission, desk: _Desk, by: str, verified: dict[str, dict[str, Any]]) -> int:
    """Verify a row, write what came of it and add it to the others; return the exit code."""
    options, path = desk.options, row.result_path
    try:
        said, against = _verify(row, desk)
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
        print(_told(row, said), flush=True)
    return code


def _verify(row: Submission, desk: _Desk) -> tuple[dict[str, Any], list[str]]:
    """Return what ``verified`` says of a row whose code has run again, and what speaks against."""
    dataset = predict.meshes_of(row.truth, None, desk.options.root)
    with tempfile.TemporaryDirectory(dir=desk.folder) as made:
        folder = Path(made)
        found, commit = desk.code(row)
        code = _copied(row, found, folder / "code")
        own = packages.install(code, folder / "packages")
        if own is None:
            print(
                f"{code.name} names no packages (PEP 723): it gets those of this environment",
                file=sys.stderr,
            )
        installed = packages.installed(own)
        settings = replace(
            desk.settings,
            batch_size=row.batch_size,
            seeds=len(row.predictions),
            threads=row.result["cost"]["threads"],
            device=row.result["cost"]["device"],
            packages=own,
        )
        public = predict.answers(code, row.truth, dataset, settings, folder / "public")
        labels, drawn = desk.draw(row.truth.version)
        sealed = predict.answers(code, labels, drawn, settings, folder / "fresh")
    verified, against = _compared(row, public, labels, sealed)
    verified["sealed"]["share"] = desk.options.share
    return verified | {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "commit": commit,
        "machine": record.hardware(),
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


class _Desk:
    """Where rows are verified: the checkouts with their code, and a fresh draw of each version.

    The rows of one command share the draw. Its salt is forgotten at once, no row sees it but as
    meshes without a name, and it is removed when the desk is closed.

    Parameters
    ----------
    options : argparse.Namespace
        Of the command: board, source, share.
    settings : Options
        How code is run, but for what a row says of itself.
    folder : Path
        A directory of its own, which is there.
    """

    def __init__(self, options: argparse.Namespace, settings: Options, folder: Path) -> None:
        self.options, self.settings, self.folder = options, settings, folder
        self.checkouts: dict[str, Path] = {}
        self.draws: dict[str, tuple[truth.Truth, store.StoredDataset]] = {}

    def code(self, row: Submission) -> tuple[Path, str | None]:
        """Return the file with a row's code, and the commit that has it.

        The last commit comes first: what has moved since the row was made, and is still the same
        code by its digests, fits the packages that are installed.

        Raises
        ------
        EigbenchError
            If no place has files with the digests that the row names.
        """
        if self.options.source is not None:
            return _code(row, self.options.source), None
        head = git(self.options.board, "rev-parse", "HEAD")
        made_by = row.result.get("checkout", {})
        named = None if made_by.get("dirty", True) else made_by["commit"]
        if head is not None:
            with contextlib.suppress(ResultError):
                return _code(row, self.checkout(head)), head
        if named is None:
            raise ResultError(
                f"{row.result_path} names no commit that has its code, and the last commit of "
                f"{self.options.board.resolve()} has not: give --source DIR"
            )
        return _code(row, self.checkout(named)), named

    def checkout(self, commit: str) -> Path:
        """Return a directory with the files of a commit."""
        if commit not in self.checkouts:
            folder = self.folder / commit
            added = self._worktree("add", "--quiet", "--detach", str(folder), commit)
            if added.returncode:
                raise EigbenchError(
                    f"cannot check out {commit[:12]} ({' '.join(added.stderr.split())[:200]}): "
                    "fetch it first, or give --source DIR"
                )
            self.checkouts[commit] = folder
        return self.checkouts[commit]

    def draw(self, version: str) -> tuple[truth.Truth, store.StoredDataset]:
        """Return the labels of a sealed set of a version, and the set, from a salt that is lost."""
        if version not in self.draws:
            salt = secrets.token_bytes(seal.SALT_BYTES)
            resolved = seal.sealed_recipe(version, salt, share=self.options.share)
            with Console(stderr=True).status("drawing and labelling a fresh sealed set"):
                seal.make(resolved, root=self.folder / "sealed")
            drawn = store.open_dataset(resolved.version, self.folder / "sealed")
            self.draws[version] = truth.of_dataset(drawn), drawn
        return self.draws[version]

    def close(self) -> None:
        """Take the checkouts out of git's list of working trees."""
        for folder in self.checkouts.values():
            self._worktree("remove", "--force", str(folder))

    def _worktree(self, *command: str) -> subprocess.CompletedProcess[str]:
        return _done(["git", "-C", str(self.options.board), "worktree", *command])


def _code(row: Submission, source: Path) -> Path:
    """Return the predictor's file in a directory: of its name, with the digests of the result."""
    model = row.result["model"]
    file, _, variant = model["code"].partition(":")
    for path in sorted(source.rglob(file)):
        here = {name: path.parent / name for name in model["sources"]}
        if all(p.is_file() and digest(p) == model["sources"][n] for n, p in here.items()):
            return path.with_name(f"{file}:{variant}") if variant else path
    raise ResultError(
        f"{source} has no {file} with the code and weights that {row.result_path} names: "
        f"{', '.join(model['sources'])}. Weights that lay elsewhere, shown by --readable, must lie "
        "beside the code"
    )


def _copied(row: Submission, code: Path, folder: Path) -> Path:
    """Copy the files that the result names, and nothing else: it must need no others."""
    for name in row.result["model"]["sources"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(code.parent / name, folder / name)
    return folder / code.name


def _compared(
    row: Submission, public: Evaluation, drawn: truth.Truth, sealed: Evaluation
) -> tuple[dict[str, Any], list[str]]:
    """Return the scores of both runs as ``verified`` has them, and what speaks against the row."""
    model, problems = row.result["model"], []
    for evaluation in (public, sealed):
        named, used = model["sources"], evaluation.status.sources
        problems += [
            f"{name} is not the file that the result names"
            for name in sorted(set(named) | set(used))
            if named.get(name) != used.get(name)
        ]
        if evaluation.status.refused:
            problems.append(f"its box has refused: {', '.join(evaluation.status.refused[:3])}")
    again = scores.of_targets(row.truth, public.predictions)
    numbers: dict[str, Any] = {}
    for target, scored in again.items():
        numbers[target] = None if scored is None else _interval(scored)
        if scored is None:
            continue
        declared = row.result["scores"][target]["overall"][RANKED_BY]["mean"]
        numbers[target]["declared"] = declared
        if not _within(declared, numbers[target]):
            problems.append(
                f"against the {target}, {RANKED_BY} is {declared} as declared, and "
                f"{numbers[target]['mean']} when run again"
            )
    fresh = _interval(scores.score(drawn, sealed.predictions))
    on_sealed = {"shapes": len(set(drawn.shapes.tolist())), "instances": len(drawn.ids), **fresh}
    if fresh["low"] is None or fresh["low"] > max(numbers[MESH]["high"] or 0, ROUNDING):
        problems.append(
            f"on shapes that nobody has seen, {RANKED_BY} is {fresh['mean']} ({fresh['low']} to "
            f"{fresh['high']}), surely worse than {numbers[MESH]['mean']} on the public split"
        )
    for labels, evaluation in ((row.truth, public), (drawn, sealed)):
        problems.append(predictions.looked_up(model["kind"], labels, evaluation.predictions))
    return {"scores": numbers, "sealed": on_sealed}, list(dict.fromkeys(filter(None, problems)))


def _interval(scored: dict[str, Any]) -> dict[str, float | None]:
    return {key: scored["overall"][RANKED_BY][key] for key in ("mean", "low", "high")}


def _within(declared: float | None, again: dict[str, float | None]) -> bool:
    """Whether a declared mean is in the interval of the mean when run again, or equals it."""
    mean, low, high = (again[key] for key in ("mean", "low", "high"))
    if declared is None or mean is None or low is None or high is None:
        return declared is None and mean is None
    return low <= declared <= high or bool(np.isclose(declared, mean, rtol=ROUNDING, atol=1e-12))


def _told(row: Submission, verified: dict[str, Any]) -> str:
    sealed, mesh = verified["sealed"], verified["scores"][MESH]
    return (
        f"{row.name} is verified by {verified['by']}, sandbox {verified['sandbox']}: {RANKED_BY} "
        f"{mesh['mean']:.4g} on the split, {sealed['mean']:.4g} on {sealed['instances']:,} meshes "
        f"that nobody has seen; {row.result_path} says so"
    )


def _done(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)
