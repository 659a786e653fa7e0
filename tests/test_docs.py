"""What README and docs say is run: commands, code, numbers and links."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from synthnet import filters, recipe, store

ROOT = Path(__file__).parent.parent
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
README = (ROOT / "README.md").read_text()
CARD = (ROOT / "docs" / "dataset-card.md").read_text()


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, flags=re.S | re.M)


def run(command, home, place):
    environment = {**os.environ, "SYNTHNET_HOME": str(home)}
    done = subprocess.run(
        command, cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("line", [line for b in blocks("sh") for line in b.splitlines()])
def test_commands_of_the_readme_run(line, mini_home, tmp_path):
    program, *arguments = shlex.split(line)
    if program == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        assert arguments == ["install", "-c", "constraints.txt", "-e", ".[all]"]
        assert "all" in extras["optional-dependencies"]
        return
    (predictor,) = blocks("py")
    (tmp_path / "my_model.py").write_text(predictor)
    assert program in ("synthnet", "eigbench")
    if arguments[0] == "score":
        evaluate = next(s for b in blocks("sh") for s in b.splitlines() if "evaluate" in s)
        run([sys.executable, "-m", *shlex.split(evaluate)], mini_home, tmp_path)
    assert run([sys.executable, "-m", program, *arguments], mini_home, tmp_path)


@pytest.mark.parametrize("code", blocks("python"))
def test_code_of_the_readme_runs(code, mini_home, tmp_path):
    assert run([sys.executable, "-c", code], mini_home, tmp_path)


def test_example_runs(mini_home, tmp_path):
    example = ROOT / "examples" / "first_batch.py"
    assert "a batch:" in run([sys.executable, str(example), "1.0-mini"], mini_home, tmp_path)


def test_make_targets_are_there():
    makefile = (ROOT / "Makefile").read_text()
    pages = README + (ROOT / "CONTRIBUTING.md").read_text()
    targets = set(re.findall(r"\bmake ([a-z]+)\b", pages)) - {"sure"}
    assert {"quickstart", "test"} <= targets
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.M), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        if not target.startswith("https://"):
            assert (page.parent / target).exists(), target


def test_versions_of_the_readme_are_the_recipes():
    rows = dict(re.findall(r"^\| `([\w.-]+)` \| ([\d,]+) \|", README, flags=re.M))
    assert rows == {v: f"{recipe.load(v).count:,}" for v in recipe.available()}


def test_card_names_every_filter_in_order():
    names = [*filters.MESH_CHECKS, filters.SOLVER, *filters.SPECTRUM_CHECKS]
    table = CARD.partition("## Filters")[2].partition("## Instances")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, flags=re.M) == names


def test_card_names_every_column_in_order():
    table = CARD.partition("| column | type |")[2]
    cells = re.findall(r"^\| (`.+?) \|", table, flags=re.M)
    assert re.findall(r"`(\w+)`", " ".join(cells)) == store.SCHEMA.names


def test_card_has_the_numbers_of_the_pinned_build():
    report = json.loads((ROOT / "docs" / "data" / "build-1.0.json").read_text())
    assert report["recipe_digest"] == recipe.load("1.0").digest
    for row in report["families"]:
        numbers = (row["drawn"], row["kept"], row["vertices"], row["faces"])
        for number in numbers:
            assert f"{number:,}" in CARD
        assert f"{row['core_seconds']:,.1f}" in CARD


def test_card_has_the_costs_that_were_measured():
    build, loading = (
        json.loads((ROOT / "docs" / "data" / f"{name}.json").read_text())
        for name in ("build-cost", "loading-1.0")
    )
    whole = build["rows"][-1]
    cost = CARD.partition("## What it costs")[2].partition("## Files")[0]
    for number in (whole["ours ms"], whole["plain ms"], whole["ratio"], *loading.values()):
        if number not in (loading["version"], loading["vertices"]):
            assert f"{number:,}" in cost
