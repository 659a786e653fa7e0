"""What README and docs say is run as it stands: commands in their order, and pages as a whole."""

import doctest
import json
import shlex
import sys

import pytest
import trimesh

from tests.docs.pages import DOCS, ROOT, WHOLE, blocks, commands, run, steps


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [page for page in DOCS if commands("sh", page)],
    ids=lambda page: page.name,
)
def test_commands_of_a_page_run_in_their_order(page, unpacking_home, tmp_path):
    (predictor,) = blocks("py")
    (tmp_path / "my_model.py").write_text(predictor)
    (tmp_path / "benchmark").symlink_to(ROOT / "benchmark")
    (tmp_path / "scans").mkdir()
    trimesh.creation.torus(3, 1).export(tmp_path / "scans" / "torus.stl")
    lines = commands("sh", page)
    assert lines
    for line in lines:
        program, *arguments = shlex.split(line)
        assert program in ("synthnet", "eigbench")
        assert run([sys.executable, "-m", program, *arguments], unpacking_home, tmp_path), line


# A page that is one piece: its files, commands and code run in their order, in one directory and
# one namespace, and a block `output` shows what the block before it printed; ... is anything.

MARK = "-- end of a step --"
RUNNER = f"""
import json, shlex, subprocess, sys

names = {{"__name__": "__main__"}}
for language, code in json.load(sys.stdin):
    if language == "python":
        exec(code, names)
    for line in code.splitlines() if language == "sh" else ():
        program, *arguments = shlex.split(line)
        assert program in ("synthnet", "eigbench"), line
        subprocess.run([sys.executable, "-m", program, *arguments], check=True)
    print({MARK!r}, flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("page", WHOLE, ids=lambda page: page.name)
def test_page_runs_as_a_whole_and_prints_what_it_shows(page, unpacking_home, tmp_path):
    (predictor,) = blocks("py")
    (tmp_path / "my_model.py").write_text(predictor)
    for _, name, text in steps(page):
        if name:
            (tmp_path / name).write_text(text)
    shown = [(language, text) for language, _, text in steps(page) if language != "output"]
    command = [sys.executable, "-c", RUNNER]
    printed = run(command, unpacking_home, tmp_path, json.dumps(shown)).split(f"{MARK}\n")
    assert len(printed) == len(shown) + 1
    number = -1
    for language, _, text in steps(page):
        number += language != "output"
        if language == "output":
            same = doctest.OutputChecker().check_output(text, printed[number], doctest.ELLIPSIS)
            assert same, f"{page.name} shows\n{text}and it printed\n{printed[number]}"
