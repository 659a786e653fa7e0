"""The documentation's site: links out of docs/, docstrings, and the check of what was built.

`make docs`, which CI runs, builds the site itself.
"""

from __future__ import annotations

import base64
import doctest
import html
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]

pytest.importorskip("mkdocs", reason="the site's tools are not installed: pip install -e '.[docs]'")


def imported(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Import a script."""
    monkeypatch.syspath_prepend(ROOT / "scripts")
    monkeypatch.delitem(sys.modules, name, raising=False)
    return __import__(name)


@pytest.fixture
def hooks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return imported("mkdocs_hooks", monkeypatch)


@pytest.fixture
def roles(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return imported("docstring_roles", monkeypatch)


@pytest.fixture
def check_site(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    return imported("check_site", monkeypatch)


@pytest.mark.parametrize("name", ["mkdocs_hooks", "docstring_roles", "check_site"])
def test_examples_of_the_scripts_are_true(name, monkeypatch):
    done = doctest.testmod(imported(name, monkeypatch))
    assert done.attempted > 0
    assert done.failed == 0


# --- pages and links outside docs/ --------------------------------------------------------


@pytest.mark.parametrize(
    ("uri", "link", "there"),
    [
        ("import.md", "../LEADERBOARD.md", "leaderboard.md"),
        ("submit.md", "../README.md#score-a-predictor", "index.md#score-a-predictor"),
        ("tutorials/train.md", "../../baselines/README.md", "../baselines.md"),
        ("tutorials/train.md", "../metrics.md", "../metrics.md"),
        ("index.md", "docs/start.md", "start.md"),
        ("index.md", "LICENSE", "source/LICENSE.md"),
        ("leaderboard.md", "benchmark/figures/a.svg", "source/benchmark/figures/a.svg"),
        ("baselines.md", "../docs/data/gcn.json", "data/gcn.json"),
        ("reproduction.md", "../baselines/gcn/configs.py", "source/baselines/gcn/configs.py.md"),
        ("index.md", "https://example.org/a.md", "https://example.org/a.md"),
        ("index.md", "#use", "#use"),
    ],
)
def test_link_of_the_repository_leads_to_the_same_in_the_site(hooks, uri, link, there):
    assert hooks.rewrite(f"[a]({link})", uri) == f"[a]({there})"


@pytest.mark.parametrize("code", ["`[a](../b.md)`", "```py\nc[0](../b.md)\n```"])
def test_code_has_no_links(hooks, code):
    assert hooks.rewrite(code, "a.md") == code
    assert not list(hooks.links("docs/a.md", code))


def test_every_page_of_the_repository_is_in_the_navigation(hooks):
    nav = (ROOT / "mkdocs.yml").read_text().partition("\nnav:\n")[2]
    named = set(re.findall(r"[\w./-]+\.md$", nav, flags=re.M))
    docs = {path.relative_to(ROOT / "docs").as_posix() for path in ROOT.glob("docs/**/*.md")}
    assert named == docs | set(hooks.PAGES.values())


def test_every_module_named_in_the_reference_exists_and_is_named_once():
    told = "".join(path.read_text() for path in ROOT.glob("docs/reference/*.md"))
    named = re.findall(r"^::: (\S+)$", told, flags=re.M)
    assert len(named) == len(set(named)) > 40
    for name in named:
        base = ROOT / ("benchmark" if name.startswith("eigbench") else "")
        path = base / name.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__init__.py").exists(), name


def test_a_folder_lists_the_files_that_git_knows(hooks, tmp_path, monkeypatch):
    monkeypatch.setattr(hooks, "ROOT", tmp_path)
    (tmp_path / "code" / "__pycache__").mkdir(parents=True)
    for name in ("b.py", "a.py", "scratch.txt", "gone.py", "__pycache__/a.pyc"):
        (tmp_path / "code" / name).touch()
    everything = ["code/a.py", "code/b.py", "code/gone.py", "code/scratch.txt"]
    assert hooks.held("code") == everything  # an archive of the sources has no checkout
    git = ["git", "-C", str(tmp_path)]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "add", "code/a.py", "code/b.py", "code/gone.py"], check=True)
    (tmp_path / "code" / "gone.py").unlink()
    assert hooks.held("code") == ["code/a.py", "code/b.py"]


@pytest.mark.parametrize("text", ["x", "a\n```sh\nls\n```\nb\n", "`````\n", "``` in a line\n"])
def test_a_shown_file_is_one_block_whatever_it_holds(hooks, text):
    import markdown

    page = f"# a\n\n{hooks.fenced(text, 'text')}\nafter\n"
    shown = markdown.markdown(page, extensions=["pymdownx.superfences"])
    assert shown.count("<pre>") == 1
    assert shown.endswith("<p>after</p>")
    assert html.unescape(re.sub("<[^>]+>", "", shown)).strip() == f"a\n{text.rstrip()}\n\nafter"


# --- docstrings ---------------------------------------------------------------------------


def test_role_becomes_a_link_where_the_name_is_ours(roles):
    text = (
        "see :func:`~synthnet.recipe.splits.by_hash`, :data:`synthnet.store.pins.TOLERANCE`, "
        ":class:`int`::"
    )
    assert roles.rewrite(text) == (
        "see [`by_hash`][synthnet.recipe.splits.by_hash], "
        "[`synthnet.store.pins.TOLERANCE`][synthnet.store.pins], `int`:"
    )


def test_formula_becomes_a_picture_that_says_its_tex(roles):
    (image,) = re.findall("<img .*?>", roles.rewrite(r"of :math:`\sum_i |p_i| < 1`, so"))
    assert r'alt="\sum_i |p_i| &lt; 1"' in image
    (picture,) = re.findall('base64,([^"]+)', image)
    assert ET.fromstring(base64.b64decode(picture)).tag.endswith("svg")
    assert image == roles.formula(r"\sum_i |p_i| < 1")  # the same bytes again


def test_displayed_formula_keeps_its_indentation(roles):
    text = "a\n\n    .. math::\n        x = \\frac{1}{2},\n        y = 3\n\n    b"
    before, image, after = roles.rewrite(text).split("\n\n")
    assert (before, after) == ("a", "    b")
    assert image.startswith(r'    <img class="math" alt="x = \frac{1}{2}, y = 3" src=')


def test_every_formula_of_the_docstrings_can_be_drawn(roles):
    paths = [*ROOT.glob("synthnet/**/*.py"), *ROOT.glob("benchmark/eigbench/**/*.py")]
    assert sum(":math:" in path.read_text() for path in paths) > 5
    for path in paths:
        text = roles.rewrite(path.read_text())
        assert ":math:" not in text
        assert ".. math::" not in text, path


# --- the check of the built site ----------------------------------------------------------


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "a").mkdir()
    (tmp_path / "index.html").write_text(
        '<link rel="stylesheet" href="site.css"><p id="top"><a href="a/b.html#here">b</a>'
        '<a href="https://example.org">elsewhere</a><img src="data:image/png;base64,AA=="></p>'
    )
    (tmp_path / "a" / "b.html").write_text('<p id="here"><a href="../index.html#top">a</a></p>')
    (tmp_path / "site.css").write_text("p { background: url(data:image/png;base64,AA==) }")
    return tmp_path


def test_whole_site_passes(check_site, site, capsys):
    assert check_site.main([str(site)]) == 0
    assert "every link leads somewhere, no other host is asked" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("added", "problem"),
    [
        ('<a href="c.html">c</a>', "links to c.html, which is not there"),
        ('<a href="/c.html">c</a>', "links to /c.html, which is not there"),
        ('<a href="a/b.html#no">c</a>', "links to a/b.html#no, and that page has no no"),
        ('<a href="#no">c</a>', "links to #no, and that page has no no"),
        ('<img src="c.png">', "loads c.png, which is not there"),
        ('<img src="https://e.org/c.png">', "loads https://e.org/c.png from another host"),
        ('<script src="//e.org/c.js"></script>', "loads //e.org/c.js from another host"),
        ('<link rel="preconnect" href="https://e.org">', "loads https://e.org from another host"),
        ("<style>@import 'https://e.org/a.css'</style>", "loads https://e.org/a.css from another"),
        ('<p style="background: url(//e.org/a)">', "loads //e.org/a from another host"),
        ('<pre class="mermaid"></pre>', "a mermaid diagram would load its script"),
    ],
)
def test_problem_of_a_page_is_told(check_site, site, capsys, added, problem):
    page = site / "index.html"
    page.write_text(page.read_text() + added)
    assert check_site.main([str(site)]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"index.html: {problem}")


def test_font_of_another_host_in_a_style_sheet_is_told(check_site, site, capsys):
    (site / "site.css").write_text("@font-face { src: url('https://e.org/f.woff2') }")
    assert check_site.main([str(site)]) == 1
    assert "site.css: loads https://e.org/f.woff2 from another host" in capsys.readouterr().out


def test_site_that_was_not_built_is_one_line(check_site, tmp_path, capsys):
    assert check_site.main([str(tmp_path / "site")]) == 2
    assert capsys.readouterr().err.endswith("holds no site: run make docs\n")


def test_picture_of_the_readme_is_small():
    pictures = re.findall(r"!\[.+?\]\((.+?)\)", (ROOT / "README.md").read_text())
    assert pictures == ["docs/pictures/surfaces.png"]
    assert (ROOT / pictures[0]).stat().st_size < 200_000
