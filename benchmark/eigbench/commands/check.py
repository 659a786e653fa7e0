"""The command check: it tries a predictor on some hundred small meshes."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from eigbench.board import tables
from eigbench.commands import arguments, predict
from eigbench.commands.arguments import Command
from eigbench.results import predictions
from eigbench.running.evaluate import Options, predict_meshes
from eigbench.scoring import physics
from synthnet.terminal import print_answer

AGREE = 1e-5  # relative, between batch sizes and orders of one predictor


def add_commands(command: Command) -> None:
    """Add the command to the command line."""
    text = "try a predictor on about 130 small meshes; this runs the file's code"
    sub = command("check", check, text, "my_model.py")
    arguments.predictor(sub)
    arguments.time_limit(sub, 600.0)
    predict.add_sandbox(sub)


def check(options: argparse.Namespace) -> int:
    """Try a predictor on the probes, one at a time, shuffled and changed."""
    ids, probes = physics.questions()
    base = len(ids) // (1 + len(physics.CHANGES))
    order = np.random.default_rng(0).permutation(len(ids))
    held = predict.settings_of(options, Options)

    def ask(chosen: Sequence[int], batch_size: int) -> NDArray[np.float64]:
        settings = replace(held, batch_size=batch_size)
        asked = [ids[i] for i in chosen], [probes[i] for i in chosen]
        return predict_meshes(options.predictor, *asked, 10, settings)

    console = Console(stderr=True)
    with console.status("predicting all at once"):
        answers = ask(range(len(ids)), len(ids))
    with console.status("predicting one at a time"):
        singly = ask(range(base), 1)
    with console.status("predicting in shuffled order"):
        shuffled = ask(order.tolist(), len(ids))
    contract = physics.contract(answers)
    findings = [
        *_differences("one mesh at a time", ids, answers[:base], singly),
        *_differences("shuffled order", [ids[i] for i in order], answers[order], shuffled),
    ]
    if findings:
        with console.status("predicting all again"):
            again = _differences("the same call", ids, answers, ask(range(len(ids)), len(ids)))
        findings = [f"{line}; load weights, or set a seed" for line in again] or findings
    what, bad = predictions.impossible(answers)
    if bad.any():
        first = [ids[i] for i in np.flatnonzero(bad.any(axis=1))[:3]]
        findings.append(f"answers that are {what}, first for {', '.join(first)}")
    if np.isfinite(answers).all() and contract["ascending"] != 1:
        findings.append("answers that do not ascend: sort each spectrum")
    verdict = "it can be evaluated" if not findings else "look at the findings above"
    lines = [
        f"{tables.physics(contract)}\n",
        f"{base} shapes and {len(ids) - base} changed copies of them",
        *(f"  {finding}" for finding in findings),
        f"{options.predictor}: loads and answers in shape; {verdict}",
    ]
    print_answer(options, {"physics": contract, "findings": findings}, "\n".join(lines))
    return 1 if findings else 0


def _differences(
    how: str, ids: Sequence[str], a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]
) -> list[str]:
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.where(a == b, 0.0, np.abs(a / b - 1)).max(axis=1)
    apart = np.nan_to_num(apart, nan=np.inf)  # one of the two is no number
    bad = np.flatnonzero((apart > AGREE) & np.isfinite(a).all(axis=1))
    if not len(bad):
        return []
    first = ", ".join(ids[i] for i in bad[:3])
    return [f"other answers for {how}: up to {apart[bad].max():.2g} relative, first for {first}"]
