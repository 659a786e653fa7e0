"""The page's own scripts and styles, as `make page` bundled them from benchmark/page/src."""

from __future__ import annotations

from pathlib import Path

from eigbench.errors import EigbenchError
from synthnet.store.files import sha256

# A checkout has it, an installed package does not.
CHECKOUT = Path(__file__).resolve().parents[3]
BUNDLE = CHECKOUT / "benchmark" / "page" / "dist"
FILES = ("index.html", "style.css", "page.js", "chart.js", "viewer.js", "LICENSES.txt")
STAMP = "SOURCES.sha256"  # of what the files were made from, as sha256sum writes it
RUN = "run `make page` in a checkout of the project, which bundles the page's scripts (needs npm)"


def read() -> dict[str, bytes]:
    """Return the files that every page has.

    Raises
    ------
    EigbenchError
        If one is missing, or was made from other sources than those of this checkout.
    """
    missing = [name for name in (*FILES, STAMP) if not (BUNDLE / name).is_file()]
    if missing:
        raise EigbenchError(f"{BUNDLE} has no {missing[0]}: {RUN}")
    if changed := stale():
        raise EigbenchError(f"{BUNDLE} was not made from {changed[0]} as it is now: {RUN}")
    return {name: (BUNDLE / name).read_bytes() for name in FILES}


def stale() -> list[str]:
    """Return the sources that came, went or changed since the bundle was made."""
    lines = (BUNDLE / STAMP).read_text().splitlines()
    made = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
    here = BUNDLE.parent
    paths = {*here.glob("src/[!.]*"), *(here / name for name in made)}
    now = {path.relative_to(here).as_posix(): sha256(path) for path in paths if path.is_file()}
    return sorted(name for name in made.keys() | now.keys() if made.get(name) != now.get(name))
