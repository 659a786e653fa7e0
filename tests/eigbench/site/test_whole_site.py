"""The whole site, documentation and board as `make docs` puts them together, in a browser."""

import os
import re
import subprocess
import sys
import threading
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, unquote, urldefrag, urlparse

import pytest
from eigbench.site import write
from playwright.sync_api import expect

pytest.importorskip("sphinx", reason="the site's tools are not installed: pip install -e '.[docs]'")
pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[3]
WIDTHS = (320, 390, 1440)
PHONE = {"width": 390, "height": 800}
SOURCES = "_modules"  # pages of code, all by one template: one of them stands for them


@pytest.fixture(scope="module")
def site(request, tmp_path_factory):
    """The site, as the Makefile makes it.

    Or, where ``SYNTHNET_TEST_SITE`` names its directory, what `make docs` has made of this very
    checkout.
    """
    if ready := os.environ.get("SYNTHNET_TEST_SITE"):
        return Path(ready)
    request.getfixturevalue("bundled")
    real_board = request.getfixturevalue("real_board")
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
    parser = Links()
    parser.feed(path.read_text())
    return parser


def test_no_page_shows_the_marks_of_its_markdown(site):
    """A generated block right after its mark is HTML to the end of the line, asterisks and all."""
    raw = re.compile(r"(?:<!-- begin [\w-]+ -->|<p>)\*+\w")
    assert [path for path in site.rglob("*.html") if raw.search(path.read_text())] == []


def test_every_link_inside_the_site_leads_to_what_is_there(site):
    pages = {path: links(path) for path in site.rglob("*.html") if path.name != "404.html"}
    assert len(pages) > 60
    lost, views = [], set()
    for path, page in pages.items():
        for target in page.targets:
            if urlparse(target).scheme or target.startswith("//"):
                continue
            address, anchor = urldefrag(target)
            there = (path.parent / unquote(address.partition("?")[0])).resolve()
            there = path if not address else there
            known = pages.get(there)
            # The fragment of the board is its view; that of source code is made by Sphinx
            if address and anchor and there == site / "board" / "index.html":
                views.add(anchor)
            elif not there.is_file() or (known and unquote(anchor) not in known.anchors):
                lost.append(f"{path.relative_to(site)}: {target}")
    assert lost == []
    for view in views:
        named = {key: values[0] for key, values in parse_qs(view).items()}
        assert (site / "board" / "boards" / f"{named['board']}.js").is_file(), view
        if "model" in named:
            row = Path(named["board"], f"{named['model']}.js")
            assert (site / "board" / "rows" / row).is_file(), view
    assert any("model=" in view for view in views)


OPENED = """() => {
  for (const one of document.querySelectorAll("details")) one.open = true;
  const links = [...document.querySelectorAll("a[href]")];
  return links.map((one) => [one.getAttribute("href"), one.href]);
}"""


def test_every_link_of_every_board_and_model_leads_to_what_is_there(site, new_page):
    folder = site / "board"
    boards = {path.stem for path in folder.glob("boards/*.js")}
    models = {path.stem for path in folder.glob("models/*.js")}
    rows = {Path(path.parent.name, path.stem) for path in folder.glob("rows/*/*.js")}
    assert len(boards) > 10
    assert len(models) > 20
    of_a_model = sorted({row.name: row.parent.name for row in sorted(rows)}.items())
    views = [f"#board={key}" for key in sorted(boards)]
    views += [f"#board={board}&model={model}" for model, board in of_a_model]
    anchors = {}
    lost, kinds = [], set()
    page = new_page()
    page.set_default_timeout(60_000)
    for view in views:
        page.goto("about:blank")
        page.goto(f"{(folder / 'index.html').as_uri()}{view}")
        expect(page.locator("#status")).not_to_be_empty()
        if "model=" in view:
            expect(page.locator(".detail")).not_to_have_text("Loading …")
        for given, address in page.evaluate(OPENED):
            if given.startswith("#"):
                kinds.add("view")
                state = parse_qs(given[1:])
                if "board" in state:
                    board, model = state["board"][0], state.get("model", [""])[0]
                    there = Path(board, model) in rows if model else board in boards
                else:  # to a place on the same page
                    there = page.locator(given).count() == 1
            elif address.startswith("file:"):
                path = Path(unquote(urlparse(address).path))
                kinds.add(path.relative_to(site).parts[0] if path.is_relative_to(site) else "out")
                there = path.is_file()
                if there and path.suffix == ".html":
                    known = anchors.setdefault(path, links(path).anchors)
                    there = unquote(urlparse(address).fragment) in known
            else:
                there = address.startswith("https://")
            if not there:
                lost.append((view, given))
    assert lost == []
    assert {"view", "docs", "board"} <= kinds
    assert "out" not in kinds


# --- search, and what is not there ----------------------------------------------------------


@pytest.mark.parametrize("size", [{"width": 1440, "height": 900}, PHONE], ids=["wide", "phone"])
def test_a_word_is_searched_for_and_found_from_a_file(site, new_page, size):
    phone = {"has_touch": True, "is_mobile": True} if size == PHONE else {}
    page = new_page(viewport=size, **phone)
    page.goto((site / "docs" / "start.html").as_uri())
    field = page.get_by_role("searchbox").or_(page.locator("input[name=q]")).first
    if size == PHONE:
        page.locator(".mobile-header label[for=__navigation]").tap()
    expect(field).to_be_in_viewport()
    field.fill("isospectral")
    field.press("Enter")
    hits = page.locator("#search-results li a")
    expect(hits.first).to_be_visible(timeout=30_000)
    assert urlparse(page.url).path.endswith("/search.html")
    titles = hits.all_text_contents()
    assert any("glossary" in title.lower() or "concepts" in title.lower() for title in titles)
    hits.first.click()
    page.wait_for_load_state()
    assert Path(unquote(urlparse(page.url).path)).is_file()
    expect(page.locator("article")).to_contain_text(re.compile("isospectral", re.IGNORECASE))


@pytest.fixture
def hosted(site):
    """Address of the site on a host that has it in a folder, and its 404.html for the rest."""

    class Host(SimpleHTTPRequestHandler):
        def do_GET(self):
            self._serve(super().do_GET)

        def do_HEAD(self):
            self._serve(super().do_HEAD)

        def _serve(self, known):
            path = urlparse(self.path).path
            self.path = path.removeprefix("/some/project")
            if path.startswith("/some/project/") and Path(self.translate_path(self.path)).is_file():
                known()
            else:
                body = (site / "404.html").read_bytes()
                self.send_response(404)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                if self.command == "GET":
                    self.wfile.write(body)

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Host, directory=site)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/some/project/"
        server.shutdown()


@pytest.mark.parametrize("lost", ["gone.html", "docs/gone.html", "a/b/c/d.html", "board/a/"])
def test_a_page_that_is_not_there_leads_back_from_any_depth(hosted, new_page, lost):
    page = new_page()
    page.goto(hosted + lost)
    targets = ("index.html", "board/index.html", "search.html")
    for link, target in zip(page.locator("main a").all(), targets, strict=True):
        expect(link).to_have_attribute("href", re.compile(f"{re.escape(target)}$"))
    expect(page.locator("main a").first).to_have_attribute("href", "/some/project/index.html")
    page.locator("main a").first.click()
    expect(page).to_have_url(f"{hosted}index.html")
    expect(page.locator("h1")).to_contain_text("synthNet")


# --- every page -----------------------------------------------------------------------------


def pages_of_the_docs(site):
    every = sorted(site.rglob("*.html"))
    code = [path for path in every if SOURCES in path.parts]
    beside = [*code, *(site / "board").rglob("*.html")]
    pages = [path for path in every if path not in beside]
    assert len(pages) > 50
    return [*pages, code[-1]]


# A page in the dark has other colours, and is else as it is in the light
@pytest.mark.parametrize(
    ("scheme", "rules"), [("light", ()), ("dark", ("color-contrast",))], ids=["light", "dark"]
)
def test_axe_finds_nothing_serious_in_the_docs(site, new_page, violations, scheme, rules):
    page = new_page(color_scheme=scheme, viewport={"width": 1440, "height": 900})
    serious = {}
    for path in pages_of_the_docs(site):
        page.goto(path.as_uri())
        for violation in violations(page, *rules):
            if re.match("serious|critical", violation):
                serious.setdefault(violation, path.relative_to(site).as_posix())
    assert serious == {}


@pytest.mark.parametrize("width", WIDTHS)
def test_no_page_of_the_docs_scrolls_sideways(site, new_page, overflow, width):
    page = new_page(viewport={"width": width, "height": 900})
    wide = []
    for path in pages_of_the_docs(site):
        page.goto(path.as_uri())
        if overflow(page):
            wide.append(path.relative_to(site).as_posix())
    assert wide == []
