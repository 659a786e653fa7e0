"""The command verify-row: it runs a row's code again, on its split and on a fresh draw."""

from __future__ import annotations

import argparse
import contextlib
import datetime
import json
import re
import secrets
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name
from rich.console import Console

from eigbench import results
from eigbench.board.ranking import RANKED_BY
from eigbench.commands import arguments, predict
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError, ResultError
from eigbench.results import predictions, submission, verification
from eigbench.results.sources import digest, git
from eigbench.results.submission import Submission
from eigbench.running import record
from eigbench.running.evaluate import Evaluation, Options
from eigbench.scoring import scores, truth
from eigbench.scoring.truth import MESH
from synthnet import store
from synthnet.verify import seal

SHARE = 0.03  # of each family's surfaces: some hundred shapes, minutes
SCRIPT = re.compile(r"^# /// script\n((?:#(?: .*)?\n)+?)# ///$", re.MULTILINE)  # of PEP 723
HERE = ("synthnet", "eigbench")  # what runs the predictor is this release
ROUNDING = 1e-6  # relative: what another processor may make of a mean


def add_commands(command: Command) -> None:
    """Add verify-row to the command line."""
    sub = command(
        "verify-row",
        verify_row,
        "run a row's code again, on its split and on a fresh sealed draw, and write down what came "
        "of it; this runs the file's code",
        "benchmark/results/1.0-test-grouped/weyl-s-law.json",
    )
    arguments.row(sub, "the row's result")
    where = "(default: the commit that the result names, in the checkout)"
    arguments.path(sub, "--source", "DIR", f"directory with its code {where}")
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


def verify_row(options: argparse.Namespace) -> int:
    """Run a row's code again; write what came of it into the result, if nothing speaks against."""
    row = submission.read(options.result, options.predictions)
    if row.result["partial"] or row.truth.protocol != "grouped":
        raise ResultError(f"{options.result} is no whole result under the protocol grouped")
    by = options.by or git(options.board, "config", "user.name")
    if not by:
        raise EigbenchError("who verifies? give --by NAME, or set git's user.name")
    settings = replace(
        predict.settings_of(options, Options),
        batch_size=row.batch_size,
        seeds=len(row.predictions),
        threads=row.result["cost"]["threads"],
        device=row.result["cost"]["device"],
    )
    dataset = predict.meshes_of(row.truth, None, options.root)
    with tempfile.TemporaryDirectory(prefix="eigbench-verify-") as made:
        folder = Path(made)
        with _source(row, options, folder / "checkout") as source:
            code = _copied(row, _code(row, source), folder / "code")
            packages = _install(code, folder / "packages")
            settings = replace(settings, packages=packages)
            public = predict.answers(code, row.truth, dataset, settings, folder / "public")
            drawn, sealed = _fresh(row, code, settings, options.share, folder)
    verified, against = _compared(row, public, drawn, sealed)
    if against:
        for finding in against:
            print(f"eigbench: {finding}", file=sys.stderr)
        print(f"{row.name} is not verified; nothing was written", file=sys.stderr)
        return 1
    commit = row.result.get("checkout", {}).get("commit") if options.source is None else None
    verified |= {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "by": by,
        "commit": commit,
        "machine": record.hardware(),
        "sandbox": settings.sandbox,
        "packages": _installed(packages),
    }
    verified["sealed"]["share"] = options.share
    result = {**row.result, "verified": verified}
    verified["digest"] = verification.digest(result)
    if options.key is not None:
        verified["signature"] = verification.sign(verified["digest"], options.key)
    results.write(options.result, result)
    print(json.dumps(verified, indent=1) if options.json else _told(row, verified))
    return 0


@contextlib.contextmanager
def _source(row: Submission, options: argparse.Namespace, folder: Path) -> Iterator[Path]:
    """Give the directory with a row's code: the one that is named, or its commit checked out."""
    if options.source is not None:
        yield options.source
        return
    checkout = row.result.get("checkout")
    if checkout is None or checkout["dirty"]:
        raise ResultError(f"{row.result_path} names no commit that has its code: give --source DIR")
    worktree = ["git", "-C", str(options.board), "worktree"]
    added = _done([*worktree, "add", "--quiet", "--detach", str(folder), checkout["commit"]])
    if added.returncode:
        raise EigbenchError(
            f"cannot check out {checkout['commit'][:12]} ({' '.join(added.stderr.split())[:200]}): "
            "fetch it first, or give --source DIR"
        )
    try:
        yield folder
    finally:
        _done([*worktree, "remove", "--force", str(folder)])


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


def _install(code: Path, folder: Path) -> Path | None:
    """Install what a file's header of PEP 723 asks for; None where it has no header.

    Wheels alone, since to build a package runs its code outside the box.
    """
    file = code.with_name(code.name.partition(":")[0])
    header = SCRIPT.search(file.read_text(encoding="utf-8"))
    if header is None:
        print(f"{file.name} names no packages (PEP 723): it gets those of this environment")
        return None
    lines = (line[2:] if line.startswith("# ") else line[1:] for line in header[1].splitlines())
    try:
        dependencies = tomllib.loads("\n".join(lines)).get("dependencies", [])
    except tomllib.TOMLDecodeError as error:
        raise ResultError(f"{file}: its header of PEP 723 is no TOML: {error}") from error
    folder.mkdir()
    if packages := [str(package) for package in _requirements(dependencies, file)]:
        uv = shutil.which("uv")
        install = [uv, "pip"] if uv else [sys.executable, "-m", "pip"]
        where = ["--target", str(folder), "--only-binary", ":all:"]
        done = _done([*install, "install", *where, "--", *packages])
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["?"])[-1]
            raise EigbenchError(f"cannot install what {file.name} asks for: {last[:300]}")
    return folder


def _requirements(dependencies: Any, file: Path) -> list[Requirement]:
    """Return what a header asks for, without what runs it: names and versions, no addresses.

    From an address, or a folder, comes what need not be a wheel.
    """
    is_list = isinstance(dependencies, list)
    if not is_list or not all(isinstance(text, str) for text in dependencies):
        raise ResultError(
            f"{file}: dependencies of PEP 723 are a list of texts, got {dependencies}"
        )
    try:
        requirements = [Requirement(text) for text in dependencies]
    except InvalidRequirement as error:
        message = " ".join(str(error).split())
        raise ResultError(f"{file}: a dependency of PEP 723: {message}") from error
    for requirement in requirements:
        if requirement.url is not None:
            raise ResultError(f"{file}: {requirement.name} comes from an address: name a version")
    return [r for r in requirements if canonicalize_name(r.name) not in HERE]


def _installed(packages: Path | None) -> dict[str, str]:
    if packages is None:
        return record.environment()
    distributions = metadata.distributions(path=[str(packages)])
    return dict(sorted((d.metadata["Name"], d.version) for d in distributions))


def _fresh(
    row: Submission, code: Path, settings: Options, share: float, folder: Path
) -> tuple[truth.Truth, Evaluation]:
    """Draw a sealed set from a salt that is forgotten, and return its labels and the answers."""
    salt = secrets.token_bytes(seal.SALT_BYTES)
    resolved = seal.sealed_recipe(row.truth.version, salt, share=share)
    with Console(stderr=True).status("drawing and labelling a fresh sealed set"):
        seal.make(resolved, root=folder / "sealed")
    drawn = store.open_dataset(resolved.version, folder / "sealed")
    labels = truth.of_dataset(drawn)
    return labels, predict.answers(code, labels, drawn, settings, folder / "fresh")


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
        f"that nobody has seen\n{row.result_path} says so; now: eigbench leaderboard"
    )


def _done(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)
