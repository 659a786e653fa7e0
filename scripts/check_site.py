"""Check the built site: every link within it leads somewhere, and no page asks another host.

Usage: python scripts/check_site.py site
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = ("src", "srcset", "data", "poster")  # attributes whose address the browser asks for
LINKED = ("canonical", "prev", "next", "alternate")  # kinds of <link> that nothing is loaded for
STYLES = re.compile(r"url\(\s*['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)")


class Page(HTMLParser):
    """What a page holds: names to link to, its links, and what it makes a browser load."""

    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.in_style = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take up a tag's names and addresses."""
        given = {name: value or "" for name, value in attrs}
        self.names |= {given[name] for name in ("id", "name") if name in given}
        self.loads += [given[name] for name in LOADED if name in given and tag != "meta"]
        self.loads += addresses(given.get("style", ""))
        self.in_style = tag == "style"
        if "href" in given:
            loaded = tag == "link" and given.get("rel") not in LINKED
            (self.loads if loaded else self.links).append(given["href"])

    def handle_data(self, data: str) -> None:
        """Take up what a style in the page loads."""
        if self.in_style:
            self.loads += addresses(data)


def addresses(style: str) -> list[str]:
    """Return what a style makes a browser load.

    Examples
    --------
    >>> addresses("@import 'a.css'; p { background: url(b.png) }")
    ['a.css', 'b.png']
    """
    return [match[1] or match[2] for match in STYLES.finditer(style)]


def problems(site: Path) -> Iterator[str]:
    """Yield a line for each broken link and each request to another host."""
    pages = {}
    for path in sorted(site.rglob("*.html")):
        page = pages[path] = Page()
        page.feed(path.read_text())
    for path, page in pages.items():
        told = [*_loaded(site, path, page.loads), *_linked(site, path, page.links, pages)]
        if 'class="mermaid"' in path.read_text():
            told.append("a mermaid diagram would load its script from another host")
        yield from (f"{path.relative_to(site)}: {line}" for line in told)
    for path in sorted(site.rglob("*.css")):
        for line in _loaded(site, path, addresses(path.read_text())):
            yield f"{path.relative_to(site)}: {line}"


def _loaded(site: Path, path: Path, found: list[str]) -> Iterator[str]:
    for address in found:
        parts = urlsplit(address)
        if parts.netloc:
            yield f"loads {address} from another host"
        elif not parts.scheme and parts.path and not _target(site, path, parts.path).is_file():
            yield f"loads {address}, which is not there"


def _linked(site: Path, path: Path, found: list[str], pages: dict[Path, Page]) -> Iterator[str]:
    for link in found:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = _target(site, path, parts.path)
        name = unquote(parts.fragment)
        if not target.is_file():
            yield f"links to {link}, which is not there"
        elif name and target in pages and name not in pages[target].names:
            yield f"links to {link}, and that page has no {name}"


def _target(site: Path, path: Path, address: str) -> Path:
    """Return the file that an address of a page means; an empty one means the page."""
    base = site if address.startswith("/") else path.parent
    target = (base / unquote(address).lstrip("/")).resolve() if address else path
    return target / "index.html" if target.is_dir() else target


def main(arguments: list[str]) -> int:
    """Print what is wrong; return 1 if anything is."""
    site = Path(arguments[0] if arguments else "site").resolve()
    if not (site / "index.html").is_file():
        print(f"{site} holds no site: run make docs", file=sys.stderr)
        return 2
    found = list(problems(site))
    print("\n".join(found) or f"{site}: every link leads somewhere, no other host is asked")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
