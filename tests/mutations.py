"""Forty faults of the core, put into it one at a time: do its quick tests notice them?

    python tests/mutations.py [NAMES]

A copy of the checkout gets one fault, the tests named beside it run there, and the fault is
"killed" if one of them fails. Before, the same tests must pass without it. A fault that survives
shows a test that is missing.
"""

# ruff: noqa: E501 - a row of the table is a line
from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]

# Where the sources and the tests of these faults are.
METRICS, SCORES = "benchmark/eigbench/scoring/metrics.py", "benchmark/eigbench/scoring/scores.py"
BOOTSTRAP = "benchmark/eigbench/scoring/bootstrap.py"
RANKING = "benchmark/eigbench/board/ranking.py"
SPLITS, SHARDS = "synthnet/recipe/splits.py", "synthnet/store/shards.py"
MANIFEST, FILES = "synthnet/store/manifest.py", "synthnet/store/files.py"
REPAIR, SOLVER = "synthnet/mesh/repair.py", "synthnet/spectrum/"
TEST_METRICS = "tests/eigbench/scoring/test_metrics.py"
TEST_SCORES = "tests/eigbench/scoring/test_scores.py"
TEST_BOOTSTRAP = "tests/eigbench/scoring/test_bootstrap.py"
TEST_RANKING = (
    "tests/eigbench/board/test_board.py -k "
    "'ranks or rows_are_first or surely or predictor_ties or difference or not_finite or seeds'"
)
TEST_FLOOR = "tests/eigbench/scoring/test_targets.py -k bars_could_make"
TEST_SPLITS, TEST_PROTOCOLS = "tests/recipe/test_splits.py", "tests/recipe/test_protocols.py"
TEST_STORE, TEST_REPAIR = "tests/store/test_store.py", "tests/mesh/test_repair.py"
TEST_SPECTRUM = "tests/spectrum/test_spectrum.py"
TEST_COMPONENTS = "tests/spectrum/test_components.py"
TEST_FAULTS = "tests/spectrum/test_faults.py"
TEST_ROUNDING = "tests/spectrum/test_rounding.py"

# Name: file, text that stands there once, what stands there instead, tests.
MUTATIONS: dict[str, tuple[str, str, str, str]] = {
    # Metrics and scores
    "invlap-of-infinity": (METRICS, "np.where(np.isfinite(p), g / p", "np.where(np.isfinite(g), g / p", TEST_METRICS),
    "rpd-of-signs": (METRICS, "np.abs(p) + np.abs(g) + EPSILON", "np.abs(p + g) + EPSILON", TEST_METRICS),
    "rpd-without-epsilon": (METRICS, " + EPSILON", "", TEST_METRICS),
    "polar-of-label": (METRICS, "/ (length_p + length_g)\n    return", "/ (2 * length_g)\n    return", TEST_METRICS),
    "psnr-of-largest": (METRICS, "np.ptp(g, axis=1) ** 2", "g.max(axis=1) ** 2", TEST_METRICS),
    "psnr20-at-20": (METRICS, "psnr(p, g) > ACCURATE", "psnr(p, g) >= ACCURATE", TEST_METRICS),
    "metric-broadcasts": (METRICS, " or p != g", "", TEST_METRICS),
    "spread-of-all-seeds": (SCORES, "ddof=1", "ddof=0", TEST_SCORES),
    "share-of-instances": (SCORES, "CERTAIN / drawn.shapes", "CERTAIN / table.shape[1]", TEST_SCORES),
    "bonferroni": (BOOTSTRAP, "(1 - COVERAGE) / (len(p) - left)", "(1 - COVERAGE) / len(p)", TEST_BOOTSTRAP),
    "one-sided": (BOOTSTRAP, "float(2 * (beyond + 1)", "float((beyond + 1)", TEST_BOOTSTRAP),
    "few-seeds-too-narrow": (BOOTSTRAP, "np.sqrt(count / (count - 1)) * ", "", TEST_BOOTSTRAP),
    # Ranking
    "floor-of-one-side": (RANKING, "<= 2 * (floor or 0)", "<= (floor or 0)", TEST_FLOOR),
    "never-worse": (RANKING, "1 + len(beside) - worse)", "1 + len(beside))", TEST_RANKING),
    "better-is-worse": (RANKING, "sum(mean < 0 for mean", "sum(mean > 0 for mean", TEST_RANKING),
    "exact-by-name": (RANKING, '(-ratio, cost["ms_per_mesh"])', "(0.0, 0.0)", TEST_RANKING),
    "infinite-is-better": (RANKING, '"ab"[good_a < good_b]', '"ba"[good_a < good_b]', TEST_RANKING),
    "same-seeds-of-both": (RANKING, "drawn.means(y, b.slug)", "drawn.means(y, a.slug)", TEST_RANKING),
    # Solver
    "more-than-counted": (SOLVER + "certificate.py", "counted.negative != pairs + zeros", "counted.negative > pairs + zeros", TEST_SPECTRUM),
    "rounding-of-count": (SOLVER + "certificate.py", "SAFETY * counted.uncertainty > (high", "counted.uncertainty > 10 * (high", TEST_SPECTRUM),
    "residual-of-one-pair": (SOLVER + "certificate.py", "float(np.sqrt(len(self.values))) * largest", "largest", TEST_SPECTRUM),
    "residual-without-wathen": (SOLVER + "certificate.py", "np.sqrt(1 / matrices.least) * ", "", TEST_SPECTRUM),
    "one-may-be-missing": (SOLVER + "search.py", "if missing <= 0:", "if missing <= 1:", TEST_SPECTRUM),
    "no-gap-needed": (SOLVER + "search.py", "if high > low * (1 + least):", "if count == k:", TEST_SPECTRUM),
    "flat-faces-pass": (SOLVER + "fem.py", "> FLAT * longest:", "> -longest:", TEST_FAULTS),
    "no-stronger-setting": (SOLVER + "solve.py", "k, STRONGER)", "k, NORMAL)", TEST_SPECTRUM),
    "components-not-complete": (SOLVER + "components.py", "min(block.complete for block in blocks)", "max(block.complete for block in blocks)", TEST_COMPONENTS),
    "bound-of-sharp-alone": (SOLVER + "solve.py", "np.abs(values - candidate.values[: len(values)]) + bounds", "bounds", TEST_ROUNDING),
    # Splits
    "remainder-to-first": (SPLITS, "(remainders[i], i)", "(remainders[i], -i)", TEST_SPLITS),
    "group-that-just-fits": (SPLITS, "len(ids) <= room", "len(ids) < room", TEST_SPLITS),
    "same-split-of-all-seeds": (SPLITS, 'f"{seed}/{protocol}/{key}"', 'f"{protocol}/{key}"', TEST_SPLITS),
    "same-surfaces-are-seen": (SPLITS, "if family in group), (family,))", "if family in group and False), (family,))", TEST_PROTOCOLS),
    # Store
    "bytes-not-compared": (SHARDS, "same = hashlib.sha256(buffer.getvalue()).hexdigest() == sha256(path)", "same = True", TEST_STORE),
    "other-shapes-pass": (SHARDS, "sorted(stored) != sorted(ids)", "len(stored) != len(ids)", TEST_STORE),
    "altered-manifest": (MANIFEST, "with_digest(content).encode() == text", "True", TEST_STORE),
    "partial-file-stays": (FILES, "            partial.unlink()\n", "            pass\n", TEST_STORE),
    # Repair
    "last-vertex-stays": (REPAIR, "keep = np.full(joined.max() + 1, len(used))\n    np.minimum.at", "keep = np.full(joined.max() + 1, 0)\n    np.maximum.at", TEST_REPAIR),
    "one-grid-of-cells": (REPAIR, "itertools.product((0.0, 0.5), repeat=3)", "itertools.product((0.0,), repeat=3)", TEST_REPAIR),
    "merged-counted-twice": (REPAIR, ' - state.repairs.get("merged vertices", 0)', "", TEST_REPAIR),
    "turned-inwards": (REPAIR, "volume(centred(mesh)) < 0", "volume(centred(mesh)) > 0", TEST_REPAIR),
    "smallest-component": (REPAIR, "np.argsort(-areas", "np.argsort(areas", TEST_REPAIR),
}  # fmt: skip


def main(names: Sequence[str]) -> int:
    unknown = set(names) - set(MUTATIONS)
    if unknown:
        sys.exit(f"no such fault: {', '.join(sorted(unknown))}; there are {', '.join(MUTATIONS)}")
    survived = []
    with tempfile.TemporaryDirectory(prefix="mutations-") as folder:
        tree = copied(Path(folder))
        passes = cache(lambda tests: tests_pass(tree, tests))
        for name in names or MUTATIONS:
            file, old, new, tests = MUTATIONS[name]
            if not passes(tests):
                sys.exit(f"{tests} fails without any fault")
            text = (tree / file).read_text()
            if text.count(old) != 1:
                sys.exit(f"{name}: {file} has {text.count(old)} times {old!r}, not once")
            (tree / file).write_text(text.replace(old, new))
            if tests_pass(tree, tests):
                survived.append(name)
            shutil.copy2(ROOT / file, tree / file)
            print(f"{name}: {'survived' if name in survived else 'killed'}", flush=True)
    count = len(names or MUTATIONS)
    print(f"{count - len(survived)} of {count} killed")
    return int(bool(survived))


def copied(folder: Path) -> Path:
    """Copy what git tracks, and what it does not ignore, to a folder."""
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    files = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for file in files.rstrip("\0").split("\0"):
        if (ROOT / file).is_file():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / file, folder / file)
    return folder


def tests_pass(tree: Path, tests: str) -> bool:
    """Run quick tests in a copy; those of a pytest that could not start have not passed."""
    options = ["-x", "-q", "-m", "not slow", "-p", "no:xdist", "-p", "no:cacheprovider"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *shlex.split(tests)],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": f"{tree}:{tree / 'benchmark'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    if run.returncode not in (0, 1):  # 1: a test has failed
        sys.exit(run.stdout[-2000:] + run.stderr[-2000:])
    return run.returncode == 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
