"""What MkDocs is told about this repository: pages and links that lie outside docs/.

A page's links are written as GitHub reads them, relative to its own file. README.md, the
leaderboard and others become pages of the site; a linked source file becomes a page that shows it,
a picture is copied, a folder becomes a list of what it holds.
"""

from __future__ import annotations

import posixpath
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent
DOCS = "docs"
PAGES = {  # path in the repository: path in the site
    "README.md": "index.md",
    "LEADERBOARD.md": "leaderboard.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "baselines/README.md": "baselines.md",
}
PICTURES = (".svg", ".png")
LANGUAGES = {".py": "python", ".toml": "toml", ".json": "json", ".cff": "yaml"}
HOMES = {uri: path for path, uri in PAGES.items()}

# Code comes first: what looks like a link in it is none.
LINK = re.compile(r"^```.*?^```|`[^`\n]*`|(\]\()([^)\s#]*)([^)\s]*\))", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages outside docs/, and what any page links to outside of it."""
    for path, uri in PAGES.items():
        files.append(File.generated(config, uri, abs_src_path=str(ROOT / path)))
    wanted = {
        target
        for page in list(files.documentation_pages())
        for target in links(home(page.src_uri), (ROOT / home(page.src_uri)).read_text())
        if not target.startswith(f"{DOCS}/") and target not in PAGES
    }
    for path in sorted(wanted):
        files.append(_outside(path, config))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Rewrite a page's links from places in the repository to places in the site."""
    if page.file.src_uri.startswith("source/"):
        return markdown
    return rewrite(markdown, page.file.src_uri)


def home(uri: str) -> str:
    """Return where a page of the site lies in the repository."""
    return HOMES.get(uri, f"{DOCS}/{uri}")


def links(path: str, markdown: str) -> Iterator[str]:
    """Yield what a page of the repository links to, as paths in the repository.

    Examples
    --------
    >>> list(links("docs/a.md", "[b](../b.py), [c](data/c.json#d), [e](https://e.org), `[f](g)`"))
    ['b.py', 'docs/data/c.json']
    """
    for match in LINK.finditer(markdown):
        if match[2] and "://" not in match[2]:
            yield posixpath.normpath(posixpath.join(posixpath.dirname(path), match[2]))


def rewrite(markdown: str, uri: str) -> str:
    """Return a page of the site with its links leading to places in the site.

    Examples
    --------
    >>> rewrite("[board](../../LEADERBOARD.md#noise), [card](../card.md)", "tutorials/a.md")
    '[board](../leaderboard.md#noise), [card](../card.md)'
    """

    def replaced(match: re.Match[str]) -> str:
        if not match[2] or "://" in match[2]:
            return match[0]
        target = posixpath.normpath(posixpath.join(posixpath.dirname(home(uri)), match[2]))
        place = posixpath.relpath(site_uri(target), posixpath.dirname(uri) or ".")
        return f"{match[1]}{place}{match[3]}"

    return LINK.sub(replaced, markdown)


def site_uri(path: str) -> str:
    """Return where a path of the repository lies in the site.

    Examples
    --------
    >>> site_uri("docs/metrics.md"), site_uri("LEADERBOARD.md"), site_uri("synthnet/types.py")
    ('metrics.md', 'leaderboard.md', 'source/synthnet/types.py.md')
    """
    if path.startswith(f"{DOCS}/"):
        return path.removeprefix(f"{DOCS}/")
    if path in PAGES:
        return PAGES[path]
    return f"source/{path}" if path.endswith(PICTURES) else f"source/{path}.md"


def _outside(path: str, config: Any) -> File:
    """Return the file of the site that stands for one of the repository outside docs/."""
    there = ROOT / path
    if path.endswith(PICTURES):
        return File.generated(config, site_uri(path), abs_src_path=str(there))
    if there.is_dir():
        lines = "\n".join(f"- `{one}`" for one in held(path))
        return File.generated(config, site_uri(path), content=f"# {path}\n\n{lines}\n")
    shown = fenced(there.read_text(), LANGUAGES.get(there.suffix, "text"))
    return File.generated(config, site_uri(path), content=f"# {path}\n\n{shown}")


def held(path: str) -> list[str]:
    """Return the files in a folder of the repository: those git knows, if this is a checkout."""
    if (ROOT / ".git").exists():
        command = ["git", "ls-files", "-z", "--", path]
        done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
        files = [ROOT / name for name in done.stdout.split("\0") if name]
    else:
        files = [one for one in (ROOT / path).rglob("*") if "__pycache__" not in one.parts]
    return sorted(one.relative_to(ROOT).as_posix() for one in files if one.is_file())


def fenced(text: str, language: str) -> str:
    r"""Return text as a block of code, its fence longer than any in the text.

    Examples
    --------
    >>> fenced("a", "text")
    '```text\na\n```\n'
    >>> fenced("```sh\nls\n```\n", "text")
    '````text\n```sh\nls\n```\n````\n'
    """
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    end = "" if text.endswith("\n") else "\n"
    return f"{fence}{language}\n{text}{end}{fence}\n"
