"""The whole site, documentation and board as `make docs` puts them together, in a browser."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlparse

import pytest
from eigbench.site import write
from playwright.sync_api import expect

pytest.importorskip("sphinx", reason="the site's tools are not installed: pip install -e '.[docs]'")
pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[3]
PAGES = (
    "index.html",
    "LEADERBOARD.html",
    "docs/start.html",
    "docs/concepts.html",
    "docs/labels.html",
    "docs/pictures.html",
    "docs/dataset-card-2.0.html",
    "docs/reproduction.html",
    "docs/tutorials/train.html",
    "benchmark/boards/2.0-test-grouped-surface.html",
    "search.html",
    "404.html",
)


@pytest.fixture(scope="module")
def site(tmp_path_factory, real_board, bundled):
    """The site, as the Makefile makes it."""
    out = tmp_path_factory.mktemp("site")
    sphinx = [sys.executable, "-m", "sphinx", "--quiet", "--fail-on-warning", "-j", "auto"]
    subprocess.run([*sphinx, "-c", "docs", ".", str(out)], cwd=CHECKOUT, check=True)
    write.write(out / "board", write.files(*real_board, docs="../docs/{}.html"))
    return out


class Links(HTMLParser):
    """What a page links to or loads, and the anchors that it has."""

    def __init__(self):
        super().__init__()
        self.targets, self.anchors = set(), {"", "top"}

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors |= {given[key] for key in ("id", "name") if given.get(key)}
        key = {"a": "href", "link": "href", "img": "src", "script": "src"}.get(tag)
        if key and given.get(key):
            self.targets.add(given[key])


def links(path):
    found = Links()
    found.feed(path.read_text())
    return found


def test_no_page_shows_the_marks_of_its_markdown(site):
    """A generated block right after its mark is HTML to the end of the line, asterisks and all."""
    raw = re.compile(r"(?:<!-- begin [\w-]+ -->|<p>)\*+\w")
    assert [path for path in site.rglob("*.html") if raw.search(path.read_text())] == []


def test_every_link_inside_the_site_leads_to_what_is_there(site):
    pages = {path: links(path) for path in site.rglob("*.html") if path.name != "404.html"}
    assert len(pages) > 60
    lost = []
    for path, page in pages.items():
        for target in page.targets:
            if urlparse(target).scheme or target.startswith("//"):
                continue
            address, anchor = urldefrag(target)
            there = (path.parent / unquote(address.partition("?")[0])).resolve()
            there = path if not address else there
            known = pages.get(there)
            # The fragment of the board is its view; that of source code is made by Sphinx
            if not there.is_file() or (known and unquote(anchor) not in known.anchors):
                lost.append(f"{path.relative_to(site)}: {target}")
    assert lost == []


def test_every_link_of_the_board_to_the_docs_leads_to_a_page(site, browser):
    page = browser.new_page()
    page.goto((site / "board" / "index.html").as_uri())
    expect(page.locator("#links a")).not_to_have_count(0)
    hrefs = page.locator("a[href]").evaluate_all("links => links.map((one) => one.href)")
    docs = [href for href in hrefs if "/docs/" in href]
    assert len(docs) >= 5
    for href in docs:
        path = Path(unquote(urlparse(href).path))
        assert unquote(urlparse(href).fragment) in links(path).anchors, href
    page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing_serious_in_the_docs(site, browser, violations, name, scheme):
    context = browser.new_context(color_scheme=scheme, viewport={"width": 1440, "height": 900})
    page = context.new_page()
    page.goto((site / name).as_uri())
    found = violations(page)
    assert [one for one in found if re.match("serious|critical", one)] == []
    context.close()


@pytest.mark.parametrize("width", [320, 390, 1440])
@pytest.mark.parametrize("name", PAGES)
def test_no_page_of_the_docs_scrolls_sideways(site, browser, overflow, name, width):
    context = browser.new_context(viewport={"width": width, "height": 900})
    page = context.new_page()
    page.goto((site / name).as_uri())
    assert overflow(page) == 0
    context.close()
