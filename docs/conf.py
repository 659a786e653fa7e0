"""The documentation's site, built by Sphinx: ``make docs``.

The sources are the Markdown files of the whole repository, as GitHub shows them; README.md is the
first page. Links are relative to the page's own file, wherever it lies.
"""

import os
import re
import shutil
import warnings
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from matplotlib.sphinxext import mathmpl
from sphinx.application import Sphinx
from sphinx.errors import SphinxError

ROOT = Path(__file__).parents[1]

project = "synthNet"
author = "The synthNet authors"
extensions = [
    "matplotlib.sphinxext.mathmpl",
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
root_doc = "README"
include_patterns = ["*.md", "baselines/*.md", "benchmark/boards/*.md", "docs/**.md"]
exclude_patterns = ["**/node_modules", "**/_build", "site", ".venv"]
nitpicky = False

# Markdown: anchors of headings as GitHub makes them, code blocks with a title as its own caption.
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_inline"]

# API reference: NumPy docstrings, in the order of the source, types from the annotations.
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "furo"
templates_path = ["templates"]
html_sidebars = {
    "**": [
        "sidebar/brand.html",
        "sidebar/search.html",
        "sidebar/scroll-start.html",
        "sidebar/doors.html",  # ours: the board, which is no page of Sphinx
        "sidebar/navigation.html",
        "sidebar/scroll-end.html",
    ]
}
html_context = {"repository": os.environ.get("REPOSITORY", "")}  # where the code is published
html_title = "synthNet"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_show_search_summary = False  # it is fetched, which a browser forbids pages from files
html_show_copyright = False
copybutton_exclude = ".linenos, .gp, .go"
copybutton_selector = "div:not(.highlight-output) > div.highlight > pre"

NAVIGATION = (ROOT / "docs" / "navigation.rst").read_text()


def add_navigation(app: Sphinx, name: str, source: list[str]) -> None:
    """Put the table of contents at the end of the first page, which GitHub shows without it."""
    if name == root_doc:
        source[0] += f"\n```{{eval-rst}}\n{NAVIGATION}```\n"


# Pages that the interactive board shows as well, with their views there; all of benchmark/boards.
VIEWS = {"LEADERBOARD": "", "docs/page": "", "docs/scaling": "#board=scaling"}
RESULT = re.compile(r"\[([^\]]+)\]\((?:\.\./)*benchmark/results/([\w.-]+)/([\w.-]+)\.json\)")


def view_of(name: str) -> str | None:
    """Return the fragment of the interactive board that shows what a page shows, if one does.

    Examples
    --------
    >>> view_of("benchmark/boards/2.0-test-grouped-mesh")
    '#board=2.0-test-grouped-mesh'
    >>> view_of("benchmark/boards/2.0-generalisation-mesh")
    '#board=2.0-test-grouped-mesh&columns=protocols-rpd'
    >>> view_of("docs/labels")
    """
    if not name.startswith("benchmark/boards/"):
        return VIEWS.get(name)
    key = name.removeprefix("benchmark/boards/")
    whole = key.replace("-generalisation-", "-test-grouped-")
    return f"#board={whole}" + ("&columns=protocols-rpd" if whole != key else "")


def link_board(app: Sphinx, name: str, source: list[str]) -> None:
    """Link the interactive board, which GitHub does not show: below titles, and for results.

    A link to a result, ``benchmark/results/BOARD/MODEL.json``, leads to the page of its model.
    """
    board = f"{'../' * name.count('/')}board/index.html"

    def to_model(link: re.Match[str]) -> str:
        text, key, model = link.groups()
        target = "mesh" if "imported" in key else "surface"  # that of imported files is not known
        return f'<a href="{board}#board={key}-{target}&amp;model={model}">{text}</a>'

    source[0] = RESULT.sub(to_model, source[0])
    if name == root_doc:
        boards = "[all boards](LEADERBOARD.md)"
        source[0] = source[0].replace(
            boards, f'{boards} · <a href="{board}">sort and compare them</a>'
        )
    if (view := view_of(name)) is not None:
        link = f'<a href="{board}{escape(view)}">Sort, filter and compare interactively</a>'
        door = f'\n\n<p class="door">{link}</p>\n'
        source[0] = re.sub(r"^# .+$", lambda title: title[0] + door, source[0], count=1, flags=re.M)


def make_room(app: Sphinx, name: str, _: str, context: dict[str, Any], *more: Any) -> None:
    """Give the first page and the boards, whose tables are wide, the room of the contents aside."""
    if name in (root_doc, "LEADERBOARD") or name.startswith("benchmark/boards/"):
        context["meta"] = {**(context["meta"] or {}), "hide-toc": ""}


def add_index(app: Sphinx, failed: Exception | None) -> None:
    """Let the site open at its first page, and say on a page of its own that one is not there.

    A host shows 404.html at any depth; the page itself finds where the site begins.
    """
    if failed is None and app.builder.format == "html":
        shutil.copyfile(app.outdir / f"{root_doc}.html", app.outdir / "index.html")
        shutil.copyfile(ROOT / "docs" / "templates" / "404.html", app.outdir / "404.html")


def give_phones(page: str, narrow: dict[str, str]) -> str:
    """Return a page on which narrow screens load the narrow twin of a figure, where it has one.

    Examples
    --------
    >>> print(give_phones('<img src="f/a.svg">', {"a.svg": "b.svg"}))
    <picture><source media="(max-width: 36rem)" srcset="f/b.svg"><img src="f/a.svg"></picture>
    """

    def with_twin(image: re.Match[str]) -> str:
        directory, name = image[1], image[2]
        if name not in narrow:
            return image[0]
        source = f'<source media="(max-width: 36rem)" srcset="{directory}{narrow[name]}">'
        return f"<picture>{source}{image[0]}</picture>"

    return re.sub(r'<img [^>]*?src="([^"]*/)([^"/]+)"[^>]*>', with_twin, page)


def copy_narrow_figures(app: Sphinx) -> dict[str, str]:
    """Copy each figure NAME-narrow.svg beside NAME.svg; return the names of the narrow by those."""
    narrow = {}
    for source, (_, name) in app.env.images.items():
        twin = Path(app.srcdir, source).with_stem(f"{Path(source).stem}-narrow")
        if twin.exists():
            narrow[name] = twin.name
            shutil.copyfile(twin, app.outdir / "_images" / twin.name)
    return narrow


def reachable(page: str) -> str:
    """Return a page whose wide tables and code the keyboard can scroll, with heading levels.

    Examples
    --------
    >>> reachable('<pre>1</pre><div class="table-wrapper docutils container">')
    '<pre tabindex="0">1</pre><div class="table-wrapper docutils container" tabindex="0">'
    >>> reachable('<p class="caption" role="heading">Use</p>')
    '<p class="caption" role="heading" aria-level="2">Use</p>'
    """
    page = re.sub(r'(<pre|<div class="table-wrapper [\w -]+")>', r'\1 tabindex="0">', page)
    return page.replace('role="heading">', 'role="heading" aria-level="2">')


def finish_pages(app: Sphinx, failed: Exception | None) -> None:
    """Let every page be read without a mouse and on a phone, which the theme leaves out."""
    if failed is None and app.builder.format == "html":
        narrow = copy_narrow_figures(app)
        for path in app.outdir.rglob("*.html"):
            path.write_text(reachable(give_phones(path.read_text(), narrow)))


LOADED = re.compile(
    r"<(?:script|img|iframe|source|video|audio|embed)\b[^>]*?\bsrc=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|<link\b(?=[^>]*stylesheet|[^>]*preconnect|[^>]*icon)[^>]*?\bhref=[\"']?((?:https?:)?//[^\"'\s>]+)"
    r"|url\(\s*[\"']?((?:https?:)?//[^\"')\s]+)",
    re.IGNORECASE,
)


def addresses(page: str) -> list[str]:
    """Return what a page or a style sheet makes a browser load from another host.

    Examples
    --------
    >>> addresses('<a href="https://a.org">a</a> <script src="//b.org/c.js"></script>')
    ['//b.org/c.js']
    """
    return [next(filter(None, match)) for match in LOADED.findall(page)]


def check_hosts(app: Sphinx, failed: Exception | None) -> None:
    """Fail where a page of the site would ask another host for anything."""
    if failed is None and app.builder.format == "html":
        for path in sorted(p for p in app.outdir.rglob("*") if p.suffix in (".html", ".css")):
            for address in addresses(path.read_text(errors="replace")):
                raise SphinxError(
                    f"{path.relative_to(app.outdir)} loads {address} from another host"
                )


def math_role(*given: Any, **more: Any) -> tuple[list[nodes.Node], list[nodes.Node]]:
    """Draw ``:math:`` when the site is built, so that no page needs a script for it."""
    return mathmpl.math_role(*given, **more)


def visit_formula(self: Any, node: nodes.Element) -> None:
    """Write a drawn formula with its source as the text that a screen reader says."""
    image = mathmpl.latex2html(node, "").replace(" []", " ")  # its empty list of sizes
    self.body.append(image.replace("<img ", f'<img alt="{escape(node["latex"])}" ', 1))


def depart_formula(self: Any, node: nodes.Element) -> None:
    """A picture has nothing to close."""


class Formula(mathmpl.MathDirective):
    """``.. math::`` whose lines are joined by a space; Matplotlib's joins them by nothing."""

    def run(self) -> list[nodes.Node]:
        """Return the formula's one node."""
        self.content = [" ".join(self.content)]
        return super().run()


def setup(app: Sphinx) -> None:
    """Register the above; a formula that cannot be drawn is an error."""
    warnings.filterwarnings("error", message="Could not render math expression")
    app.connect("source-read", add_navigation)
    app.connect("source-read", link_board)
    app.connect("html-page-context", make_room, priority=400)  # before the theme reads it
    app.connect("build-finished", finish_pages)
    app.connect("build-finished", add_index)
    app.connect("build-finished", check_hosts)
    app.add_node(mathmpl.latex_math, override=True, html=(visit_formula, depart_formula))
    app.add_role("math", math_role, override=True)
    app.add_directive("math", Formula, override=True)
