"""The documentation's site. `make docs`, which CI runs, builds it and fails at a broken link."""

import ast
import doctest
import importlib
import re
from types import SimpleNamespace

import pytest

from tests.docs.pages import PAGES, ROOT

pytest.importorskip("sphinx", reason="the site's tools are not installed: pip install -e '.[docs]'")


def formulas(docstring):
    """Return what stands in the roles and blocks ``math`` of a docstring."""
    blocks = re.findall(r"^( *)\.\. math::\n\n((?:\1 +.*\n?|\n)+)", docstring, flags=re.M)
    roles = re.findall(r":math:`(.+?)`", docstring, flags=re.S)
    return [" ".join(text.split()) for text in [*(body for _, body in blocks), *roles]]


@pytest.fixture(scope="module")
def conf():
    return importlib.import_module("docs.conf")


def test_examples_of_the_configuration_are_true(conf):
    done = doctest.testmod(conf)
    assert done.attempted > 0
    assert done.failed == 0


def test_every_page_of_the_repository_is_in_the_navigation_once(conf):
    entries = re.findall(r"^   (?:[\w, ]+ <)?([\w/.-]+)>?$", conf.NAVIGATION, flags=re.M)
    named = [entry for entry in entries if not entry.startswith("benchmark/boards/")]
    pages = {page.relative_to(ROOT).with_suffix("").as_posix() for page in PAGES}
    assert sorted([conf.root_doc, *named]) == sorted(pages)


def test_every_formula_can_be_drawn():
    mathtext = pytest.importorskip("matplotlib.mathtext", reason="Matplotlib is not installed")
    parse = mathtext.MathTextParser("path").parse
    rooms = ("synthnet", "benchmark/eigbench", "baselines")
    drawn = 0
    for path in (path for room in rooms for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                for formula in formulas(ast.get_docstring(node) or ""):
                    parse(f"${formula}$")
                    drawn += 1
    assert drawn > 0


def test_navigation_goes_to_the_first_page_only(conf):
    first, other = ["# a\n"], ["# b\n"]
    conf.add_navigation(None, conf.root_doc, first)
    conf.add_navigation(None, "docs/labels", other)
    assert ".. toctree::" in first[0]
    assert other == ["# b\n"]


def test_the_first_page_and_the_lost_page_are_written(conf, tmp_path):
    (tmp_path / f"{conf.root_doc}.html").write_text("first")
    app = SimpleNamespace(builder=SimpleNamespace(format="html"), outdir=tmp_path)
    conf.add_index(app, None)
    assert (tmp_path / "index.html").read_text() == "first"
    links = re.findall(r"href=\"(.+?)\"", (tmp_path / "404.html").read_text())
    assert links == ["index.html", "board/index.html", "search.html"]


def test_the_board_is_in_the_side_bar_of_every_page(conf):
    assert "sidebar/doors.html" in conf.html_sidebars["**"]
    door = (ROOT / "docs" / conf.templates_path[0] / "sidebar" / "doors.html").read_text()
    assert "pathto('board/index.html', 1)" in door
    assert "--out $(SITE)/board" in (ROOT / "Makefile").read_text()


BOARDS = {page.stem for page in (ROOT / "benchmark" / "boards").glob("*.md")}


@pytest.mark.parametrize(
    ("name", "link"),
    [
        ("LEADERBOARD", "board/index.html"),
        ("docs/scaling", "../board/index.html#board=scaling"),
        *(
            (f"benchmark/boards/{board}", f"../../board/index.html#board={board}")
            for board in sorted(BOARDS)
            if "generalisation" not in board
        ),
    ],
)
def test_the_interactive_board_is_linked_below_the_title_of_a_board(conf, name, link):
    source = [(ROOT / f"{name}.md").read_text()]
    before = source[0]
    conf.link_board(None, name, source)
    title = re.search(r"^# .+\n", before, flags=re.M)[0]
    _, _, below = source[0].partition(title)
    assert below.startswith(f'\n<p class="door"><a href="{link}">')
    assert len(re.findall('class="door"', source[0])) == 1


def test_a_link_to_a_result_leads_to_the_page_of_its_model(conf):
    source = ["# a\n[its row](../benchmark/results/2.0-test-grouped/lapy.json), [b](b.json)\n"]
    conf.link_board(None, "docs/learned", source)
    link = '<a href="../board/index.html#board=2.0-test-grouped-surface&amp;model=lapy">its row</a>'
    assert source == [f"# a\n{link}, [b](b.json)\n"]


def test_every_result_that_a_page_links_is_there(conf):
    linked = [match for page in PAGES for match in conf.RESULT.findall(page.read_text())]
    assert len(linked) > 5
    for _, board, model in linked:
        assert (ROOT / "benchmark" / "results" / board / f"{model}.json").is_file()


def test_every_module_named_in_the_reference_exists_and_is_named_once():
    text = "".join(path.read_text() for path in ROOT.glob("docs/reference/*.md"))
    named = re.findall(r"^\.\. automodule:: (\S+)$", text, flags=re.M)
    assert len(named) > 30
    assert len(named) == len(set(named))
    for name in named:
        base = ROOT / ("benchmark" if name.startswith("eigbench") else "")
        path = base / name.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__init__.py").exists(), name


@pytest.mark.parametrize(
    ("page", "addresses"),
    [
        ('<img src="https://e.org/c.png">', ["https://e.org/c.png"]),
        ('<script defer src="//e.org/c.js"></script>', ["//e.org/c.js"]),
        ('<link rel="preconnect" href="https://e.org">', ["https://e.org"]),
        ('<link href="https://e.org/a.css" rel="stylesheet">', ["https://e.org/a.css"]),
        ("<style>@import url('https://e.org/a.css')</style>", ["https://e.org/a.css"]),
        ("@font-face { src: url('https://e.org/f.woff2') }", ["https://e.org/f.woff2"]),
        ('<p style="background: url(//e.org/a)">', ["//e.org/a"]),
        # What a page has itself or links to is no load.
        ('<a href="https://e.org/c.html">c</a>', []),
        ('<link rel="canonical" href="https://e.org/">', []),
        ('<img src="data:image/png;base64,AA==">', []),
        ('<script src="_static/a.js"></script>', []),
        ("p { background: url(data:image/png;base64,AA==) }", []),
    ],
)
def test_what_a_page_loads_from_another_host_is_seen(conf, page, addresses):
    assert conf.addresses(page) == addresses


def test_pictures_of_the_readme_are_small():
    pictures = re.findall(r"!\[.+?\]\((.+?)\)", (ROOT / "README.md").read_text())
    assert pictures == ["benchmark/figures/2.0-answer.svg", "docs/pictures/surfaces.png"]
    assert all((ROOT / picture).stat().st_size < 200_000 for picture in pictures)
