"""What the commands on results do. None of them runs a predictor."""

from __future__ import annotations

import argparse
import difflib
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from tabulate import tabulate

from eigbench.board import error_figures, figures, leaderboard, ranking
from eigbench.board import scaling_page as scaling_page
from eigbench.board.ranking import RANKED_BY, Difference
from eigbench.board.tables import family_title, number
from eigbench.errors import EigbenchError
from eigbench.results import submission
from eigbench.scaling import results as scaling_results
from eigbench.scoring.metrics import METRICS
from eigbench.site import bundle, write
from synthnet import store
from synthnet.store.files import make_directory, write_text

SHOWN = 40  # lines of a difference
TIES = (
    "(interval): too few shapes to tell. (floor): labels too coarse to tell, see docs/metrics.md; "
    "there is none for PSNR, nor for labels without estimates of their error. (equal): the same on "
    "every instance. (not finite): both have values that are not."
)


def compare(options: argparse.Namespace) -> int:
    """Print the paired differences of two results."""
    dataset = _dataset(options)
    a, b = (
        submission.read(path, predictions, dataset)
        for path, predictions in zip((options.a, options.b), options.predictions, strict=True)
    )
    overall = {key: ranking.difference(a, b, key) for key in METRICS}
    families = {
        family: ranking.difference(a, b, RANKED_BY, family)
        for family in sorted(set(a.truth.families.tolist()))
    }
    if options.json:
        found = {
            "a": a.name,
            "b": b.name,
            "overall": {key: _plain(d) for key, d in overall.items()},
            "families": {"metric": RANKED_BY, **{f: _plain(d) for f, d in families.items()}},
        }
        print(json.dumps(found, indent=1))
        return 0
    print(f"A: {a.name} ({options.a})\nB: {b.name} ({options.b})\n")
    names = {"a": "A is better", "b": "B is better"}

    def row(title: str, d: Difference, key: str) -> list[str]:
        decimals = METRICS[key].decimals
        between = f"{number(d.low, decimals)} to {number(d.high, decimals)}"
        return [
            title,
            number(d.a, decimals),
            number(d.b, decimals),
            number(d.a - d.b, decimals),
            between,
            "none" if d.floor is None else number(d.floor, decimals),
            names.get(d.verdict) or f"tie ({d.why})",
        ]

    headers = ["A", "B", "A − B", "95 % interval over shapes", "noise floor", "verdict"]
    rows = [row(METRICS[key].title, d, key) for key, d in overall.items()]
    print(tabulate(rows, headers=["metric", *headers], disable_numparse=True) + "\n")
    rows = [row(family_title(family), d, RANKED_BY) for family, d in families.items()]
    title = f"{METRICS[RANKED_BY].title} by family"
    print(tabulate(rows, headers=[title, *headers], disable_numparse=True))
    print(f"\n{TIES}")
    return 0


def _plain(difference: Difference) -> dict[str, object]:
    """Return a difference for JSON, which has no NaN or infinity."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in asdict(difference).items()
    }


def submit(options: argparse.Namespace) -> int:
    """Check a result with its predictions and put both on the board."""
    root = _root(options, make=True)
    if scaling_results.is_one(options.result):
        return _submit_scaled(options, root)
    one = submission.read(options.result, options.predictions)
    places = leaderboard.place(one, root, replace=options.replace)
    if options.json:
        print(json.dumps({"model": one.name, "board": one.board, "files": list(map(str, places))}))
        return 0
    print(f"{one.name}: every score follows from its predictions; cost and physics as declared")
    for place in places:
        print(f"  {place}")
    remark = submission.remark_path(places[0])
    if remark.is_file():
        print(f"the remark on what was there before stays: {remark}")
    print(f"now: eigbench leaderboard{_board_argument(options)}")
    return 0


def _submit_scaled(options: argparse.Namespace, root: Path) -> int:
    """Put a result of the scaling track, which holds its predictions, on the board."""
    one = scaling_results.read(options.result)
    scaling_page.section([one])  # a row that cannot be drawn would break the page for all
    place = scaling_results.place(one, root, replace=options.replace)
    if options.json:
        print(json.dumps({"model": one.name, "board": "scaling", "files": [str(place)]}))
        return 0
    print(f"{one.name}: the meshes are the pinned ones; times as declared\n  {place}")
    print(f"now: eigbench leaderboard{_board_argument(options)}")
    return 0


def regenerate(options: argparse.Namespace) -> int:
    """Generate the leaderboard, or say what of it is not up to date."""
    root = _root(options)
    with Console(stderr=True).status("scoring") as status:
        found = leaderboard.read(root, lambda row: status.update(f"scoring {row}"))
        scaled = scaling_results.read_board(root)
        reported, readme = leaderboard.read_reported(root), _text(root / leaderboard.README)
        generated = leaderboard.generate(found, reported, scaled, readme)
    stale = [p for p, text in generated.items() if _text(root / p) != text]
    known = {root / place for place in generated}
    orphans = [p for p in sorted((root / leaderboard.FIGURES).glob("*.svg")) if p not in known]
    if options.json:
        print(json.dumps({"rows": len(found), "stale": list(map(str, [*stale, *orphans]))}))
    if options.check:
        for place in stale:
            old, new = _text(root / place).splitlines(), generated[place].splitlines()
            titles = f"{place} as it is", f"{place} as generated"
            lines = list(difflib.unified_diff(old, new, *titles, n=0, lineterm=""))
            more = [f"... and {len(lines) - SHOWN} more lines"] if len(lines) > SHOWN else []
            print("\n".join([*lines[:SHOWN], *more]), file=sys.stderr)
        for place in orphans:
            print(f"{place} belongs to no board", file=sys.stderr)
        if stale or orphans:
            print(
                f"eigbench: not up to date: run eigbench leaderboard{_board_argument(options)}",
                file=sys.stderr,
            )
            return 1
        if not options.json:
            print(f"{len(found)} rows scored anew, every generated file is up to date")
        return 0
    for place in stale:
        make_directory((root / place).parent)
        write_text(root / place, generated[place])
    for place in orphans:
        place.unlink()
    if not options.json:
        written = ", ".join(str(root / place) for place in stale) or "nothing new"
        print(f"rows: {len(found)}; written: {written}")
        for place in orphans:
            print(f"removed: {place}, which belongs to no board")
    return 0


def site(options: argparse.Namespace) -> int:
    """Write the leaderboard as a static page."""
    root = _root(options)
    docs = write.docs_from(options.out) if options.docs is None else options.docs
    write.check_docs(docs)
    write.check_place(options.out)
    bundle.read()  # all three before the minute that scoring takes
    with Console(stderr=True).status("scoring") as status:
        found = leaderboard.read(root, lambda row: status.update(f"scoring {row}"))
        content = write.files(
            found,
            leaderboard.read_reported(root),
            scaling_results.read_board(root),
            docs=docs,
            on_step=lambda step: status.update(f"drawing {step}"),
        )
    write.write(options.out, content)
    size = sum(map(len, content.values()))
    if options.json:
        told = {"out": str(options.out), "files": len(content), "bytes": size, "rows": len(found)}
        print(json.dumps(told))
    else:
        place = options.out / "index.html"
        print(f"rows: {len(found)}; {len(content)} files, {size / 1e6:.1f} MB: open {place}")
    return 0


def plot(options: argparse.Namespace) -> int:
    """Draw the pictures of one or several results."""
    found = [submission.read(path, None, _dataset(options)) for path in options.results]
    if len({one.truth.digest for one in found}) > 1:
        raise EigbenchError("the results are of different datasets, splits or protocols")
    make_directory(options.out)
    found = [row.submission for row in ranking.ranked(found)]
    drawn = {
        "families.png": figures.families(found, options.metric),
        "index.png": error_figures.by_index(found),
        "histogram.png": error_figures.histogram(found, options.metric),
    }
    written = [options.out / name for name in drawn]
    for path, figure in zip(written, drawn.values(), strict=True):
        figures.save(path, figure)
    written.append(options.out / "error-time.svg")
    write_text(written[-1], figures.error_against_time(found, options.metric))
    for one in found:
        path = options.out / f"spectra-{one.slug}.png"
        figures.save(path, figures.spectra(one))
        written.append(path)
    if options.json:
        print(json.dumps({"files": list(map(str, written))}))
    else:
        print("\n".join(map(str, written)))
    return 0


def _dataset(options: argparse.Namespace) -> store.StoredDataset | None:
    if options.dataset is None:
        return None
    manifest = store.read_manifest(options.dataset)
    if manifest is None:
        raise EigbenchError(f"{options.dataset} holds no dataset (no manifest)")
    return store.StoredDataset(options.dataset, manifest)


def _root(options: argparse.Namespace, *, make: bool = False) -> Path:
    root: Path = options.board
    there = any((root / place).is_dir() for place in (leaderboard.RESULTS, scaling_results.PLACE))
    if not there and not (make and root != Path()):
        raise EigbenchError(
            f"{root.resolve()} has no {leaderboard.RESULTS}: run this in a checkout of the "
            "project, or give one with --board DIR"
        )
    return root


def _board_argument(options: argparse.Namespace) -> str:
    return "" if options.board == Path() else f" --board {options.board}"


def _text(path: Path) -> str:
    return path.read_text() if path.is_file() else ""
