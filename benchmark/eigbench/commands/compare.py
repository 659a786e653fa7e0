"""The commands compare and plot, on one or several results; neither runs a predictor."""

import argparse
import math
from dataclasses import asdict, replace
from pathlib import Path

from rich.console import Console
from tabulate import tabulate

from eigbench import results
from eigbench.board import error_figures, figures, ranking
from eigbench.board.ranking import RANKED_BY, Difference
from eigbench.board.tables import family_title, in_order, number
from eigbench.commands import arguments, queries
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError
from eigbench.results import submission
from eigbench.results.submission import Submission
from eigbench.scoring import scores
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.names import SURFACE
from synthnet import recipe
from synthnet.store.files import make_directory, write_text
from synthnet.terminal import print_answer, print_json

VERDICTS = {"a": "A is better", "b": "B is better"}
OF_RESULTS = "the import, sealed set or directory that was predicted"
TIES = (
    "(interval): the shapes are too few to tell. (few shapes): fewer than five say nothing. "
    "(floor): the target is known too coarsely to tell, see docs/metrics.md; PSNR has no floor. "
    "(equal): the same on every instance. (not finite): both have such values. Verdicts are of "
    "these two results alone; a board corrects them for its number of rows."
)


def add_commands(command: Command) -> None:
    """Add compare and plot to the command line."""
    text = "compare two results, mesh by mesh; their predictions are looked for beside them"
    sub = command("compare", compare, text, "a.json b.json")
    sub.add_argument("a", type=Path, metavar="A.json", help="a result of `eigbench evaluate`")
    sub.add_argument("b", type=Path, metavar="B.json", help="another one")
    text = "their files of predictions (default: beside the results)"
    sub.add_argument(
        "--predictions", type=Path, nargs=2, metavar=("A", "B"), default=(None, None), help=text
    )
    arguments.target(sub, SURFACE)
    arguments.dataset(sub, None, OF_RESULTS)
    arguments.root(sub)

    text = "draw spectra, errors by family and index, their histogram, and error against time"
    sub = command("plot", plot, text, "a.json b.json --out figures")
    text = "results of `eigbench evaluate`"
    sub.add_argument("results", type=Path, nargs="+", metavar="RESULT.json", help=text)
    arguments.out(sub, "figures", "directory that receives the figures", "DIR")
    text = "metric of the errors (default: %(default)s)"
    sub.add_argument("--metric", default=RANKED_BY, choices=METRICS, help=text)
    arguments.target(sub, SURFACE)
    arguments.dataset(sub, None, OF_RESULTS)
    arguments.root(sub)


def compare(options: argparse.Namespace) -> int:
    """Print the paired differences of two results."""
    dataset = arguments.unpinned(options.dataset, options.root)
    _check_alike(options.a, options.b)
    _check_named(options.dataset, options.a)
    with Console(stderr=True).status("comparing"):
        a, b = (
            arguments.beside(submission.read(path, predictions, dataset), options.target)
            for path, predictions in zip((options.a, options.b), options.predictions, strict=True)
        )
        for row in (a, b):
            queries.note(dataset, "compare", row.name, row.result["predictions"]["sha256"])
        overall = {key: _difference(a, b, key) for key in METRICS}
        families = {
            family: _difference(a, b, RANKED_BY, family)
            for family in in_order(a.truth.families.tolist())
        }
    if options.json:
        differences = {
            "a": a.name,
            "b": b.name,
            "target": a.target,
            "overall": {key: _plain(d) for key, d in overall.items()},
            "families": {"metric": RANKED_BY, **{f: _plain(d) for f, d in families.items()}},
        }
        print_json(differences)
        return 0
    print(f"A: {a.name} ({options.a})\nB: {b.name} ({options.b})")
    print(f"both against the {a.target}\n")
    _print_table("metric", [_line(METRICS[key].title, d, key) for key, d in overall.items()])
    print()
    lines = [_line(family_title(family), d, RANKED_BY) for family, d in families.items()]
    _print_table(f"{METRICS[RANKED_BY].title} by family", lines)
    print(f"\n{TIES}")
    return 0


def _difference(a: Submission, b: Submission, key: str, family: str | None = None) -> Difference:
    """Return how far two results are apart, in a few digits where the set is sealed."""
    difference = ranking.difference(a, b, key, family)
    few = scores.rounded(asdict(difference)) if scores.is_sealed(a.truth.version) else {}
    return replace(difference, **few)


def _line(title: str, difference: Difference, key: str) -> list[str]:
    d, decimals = difference, METRICS[key].decimals
    return [
        title,
        number(d.a, decimals),
        number(d.b, decimals),
        number(d.a - d.b, decimals),
        f"{number(d.low, decimals)} to {number(d.high, decimals)}",
        "none" if d.floor is None else f"{d.floor:.0e}" if d.floor else "0",
        VERDICTS.get(d.verdict) or f"{'none' if d.why == ranking.FEW else 'tie'} ({d.why})",
    ]


def _print_table(title: str, lines: list[list[str]]) -> None:
    headers = ["A", "B", "A − B", "95 % interval", "floor", "verdict"]
    print(tabulate(lines, headers=[title, *headers], disable_numparse=True))


def _plain(difference: Difference) -> dict[str, object]:
    """Return a difference for JSON, which has no NaN or infinity."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in asdict(difference).items()
    }


def _check_alike(a: Path, b: Path) -> None:
    """Check that two results are of the same meshes, before what else may be wrong with them."""
    first, second = (results.read(path)["dataset"] for path in (a, b))
    for key in ("version", "split", "protocol"):
        if first[key] != second[key]:
            raise EigbenchError(
                f"{a} and {b} cannot be compared: their {key} is {first[key]} and {second[key]}"
            )


def _check_named(name: str | None, path: Path) -> None:
    """Check that a result is of the version that --dataset names; the labels say it of others."""
    if name in recipe.available():
        submission.check_dataset(results.read(path), name, path)


def plot(options: argparse.Namespace) -> int:
    """Draw the pictures of one or several results."""
    dataset = arguments.unpinned(options.dataset, options.root)
    for path in options.results:
        _check_named(options.dataset, path)
        _check_alike(options.results[0], path)
    with Console(stderr=True).status("drawing"):
        read = (submission.read(path, None, dataset) for path in options.results)
        unordered = [arguments.beside(row, options.target) for row in read]
        if len({row.truth.digest for row in unordered}) > 1:
            raise EigbenchError(
                "the results are of different datasets, splits or protocols, or of parts of one "
                "(--limit)"
            )
        make_directory(options.out, "--out")
        for row in unordered:
            queries.note(dataset, "plot", row.name, row.result["predictions"]["sha256"])
        rows = [row.submission for row in ranking.ranked(unordered)]
        drawn = {
            "families.png": error_figures.families(rows, options.metric),
            "index.png": error_figures.by_index(rows),
            "histogram.png": error_figures.histogram(rows, options.metric),
        }
        written = [options.out / name for name in drawn]
        for path, figure in zip(written, drawn.values(), strict=True):
            figures.save(path, figure)
        written.append(options.out / "error-time.svg")
        write_text(written[-1], figures.error_against_time(rows, options.metric))
        for row in rows:
            path, number = options.out / f"spectra-{row.slug}.png", 1
            while path in written:  # of another result of that name
                number += 1
                path = options.out / f"spectra-{row.slug}-{number}.png"
            figures.save(path, error_figures.spectra(row))
            written.append(path)
    files = list(map(str, written))
    print_answer(options, {"files": files}, "\n".join(files))
    return 0
