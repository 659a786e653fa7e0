"""The generated blocks of the pages: which there are, and how they are filled and checked."""

import re
import sys
from types import SimpleNamespace

import pytest
from eigbench.board.markdown import marked

from evidence import DOCS, ROOT, blocks
from evidence.__main__ import main
from evidence.blocks import BLOCKS, ELSEWHERE, Block, fill, page_of
from evidence.measurements import FILES, MEASUREMENTS, REPORTS

PAGE = "# Page\n<!-- begin a-b -->old<!-- end a-b --> and\n<!-- begin c -->\nold\n<!-- end c -->\n"


def test_every_marked_block_is_in_the_table_and_every_block_has_its_marks():
    marks = {
        f"{page.stem}/{name}"
        for page in [ROOT / "README.md", *DOCS.rglob("*.md")]
        for name in re.findall(r"<!-- begin ([\w-]+) -->", page.read_text())
    }
    assert marks == {*BLOCKS, *ELSEWHERE}


@pytest.mark.parametrize("name", BLOCKS)
def test_every_block_is_what_its_data_say(name):
    assert fill([name], check=True) == []


def test_all_data_of_blocks_come_from_a_measurement_or_a_build():
    measured = {
        FILES.get(name, name).format(version=version)
        for name in MEASUREMENTS
        for version in ("1.0", "2.0", "2.1")
    }
    assert {name for block in BLOCKS.values() for name in block.data} <= measured | {*REPORTS}


def test_text_is_written_between_marks():
    text = marked(marked(PAGE, "a-b", "new \\1"), "c", "\n| x |\n")
    assert text == PAGE.replace(">old<", ">new \\1<").replace("\nold\n", "\n| x |\n")


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page of its own with two blocks, and a table of both."""
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    made = SimpleNamespace(rows=lambda data: f"{len(data['rows'])} rows", new=lambda: "new")
    table = {
        "page/a-b": Block(("solver",), "made.rows", inline=True),
        "page/c": Block((), "made.new"),
    }
    monkeypatch.setitem(sys.modules, "evidence.made", made)
    monkeypatch.setattr(blocks, "DOCS", tmp_path)
    monkeypatch.setattr("evidence.blocks.BLOCKS", table)
    monkeypatch.setattr("evidence.__main__.BLOCKS", table)
    monkeypatch.setattr("evidence.reproduction.fill", lambda *, check: [])
    return page


def test_blocks_are_filled_and_what_is_stale_is_named(page, capsys):
    assert main(["fill", "--check"]) == 1
    assert page.read_text() == PAGE
    stale = capsys.readouterr().err.splitlines()
    assert stale == [
        f"{name} is stale: python -m evidence fill {name}" for name in ("page/a-b", "page/c")
    ]
    assert main(["fill", "page/c"]) == 0
    assert page.read_text() == PAGE.replace("\nold\n", "\nnew\n")
    assert main(["fill"]) == 0
    assert re.search(r">\d+ rows<", page.read_text())
    assert main(["fill", "--check"]) == 0


@pytest.mark.parametrize("text", ["no marks", PAGE + PAGE])
def test_page_without_its_marks_is_left_alone(page, text, capsys):
    page.write_text(text)
    with pytest.raises(ValueError, match=r"page\.md has the marks of c [02] times, not once"):
        fill(["page/c"])
    assert page.read_text() == text
    assert main(["fill"]) == 2
    assert re.search(r"^evidence: .*page\.md has the marks of a-b", capsys.readouterr().err)


def test_unknown_block_is_one_line(capsys):
    assert main(["fill", "labels/none"]) == 2
    assert capsys.readouterr().err.startswith("evidence: there is no block labels/none")


def test_list_names_every_block_and_measurement(capsys):
    assert main([]) == 0
    words = capsys.readouterr().out.split()
    assert {*BLOCKS, *MEASUREMENTS} <= {*words}


def test_page_of_a_block():
    assert page_of("labels/solver") == (DOCS / "labels.md", "solver")
    assert page_of("README/installation") == (ROOT / "README.md", "installation")
