"""Where a row comes from: its authors, its code and weights, its day, and how it is cited."""

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from eigbench.results import sources

Fact = tuple[str, list[tuple[str, str | None]]]  # a title, and texts with what they lead to

OWN = "The synthNet authors"  # of the predictors that lie in the project itself, as CITATION.cff
FOLDERS = ("benchmark/results", "benchmark/scaling")
DECLARED = {
    "paper": "paper",
    "licence": "licence",
    "training_data": "training set",
    "training_cost": "training cost",
    "hardware": "trained on",
}


def facts(result: Mapping[str, Any], path: Path, code: str) -> list[Fact]:
    """Return what is known of a row's origin, as titles and texts with links.

    The result may be of any track; ``path`` is its file, ``code`` the address of a file of the
    checkout, with ``{}`` for its path.
    """
    model = result["model"]
    here = files(result, path)
    links = {name: code.replace("{}", quote(f"{sources.CODE}/{name}")) for name in here}
    parts = [(name, links.get(name)) for name in _ordered(model)]
    scripts = [part for part in parts if part[0].endswith(".py")]
    fitted = [part for part in parts if not part[0].endswith(".py")]
    declared = {title: model.get(key, "") for key, title in DECLARED.items()}
    texts = {**declared, "result of": date(path), "commit of the code": _commit(result)}
    by = "authors" if "authors" in model else "row by"
    entries: list[Fact] = [
        (by, [(authors(result, path), None)]),
        ("code", scripts),
        ("weights", fitted),
    ]
    entries += [(title, [(text, None)]) for title, text in texts.items()]
    return [(title, parts) for title, parts in entries if any(text for text, _ in parts)]


def _ordered(model: Mapping[str, Any]) -> list[str]:
    """Return the files of a model, its own first."""
    own = model["code"].partition(":")[0]
    return sorted(model["sources"], key=lambda name: (name != own, name))


def files(result: Mapping[str, Any], path: Path) -> dict[str, Path]:
    """Return the files of a model that the checkout still has as they made the result, by name."""
    root = sources.checkout(path)
    if root is None:
        return {}
    made_by = result["model"]["sources"]
    return {
        name: root / sources.CODE / name
        for name in _ordered(result["model"])
        if sources.current(root, name) == made_by[name]
    }


def authors(result: Mapping[str, Any], path: Path) -> str:
    """Return who a model is by: as declared, or the project where it has the model's code."""
    model = result["model"]
    if "authors" in model:
        return str(model["authors"])
    return OWN if _ordered(model)[0] in files(result, path) else ""


def _commit(result: Mapping[str, Any]) -> str:
    """Return the commit that a row's code lay in, and whether that was changed; or nothing."""
    there = result.get("checkout")
    if there is None:
        return ""
    return f"{there['commit'][:12]}{', with changes' if there['dirty'] else ''}"


def date(path: Path) -> str:
    """Return the day on which a result was committed as it is, ``2026-11-24``.

    Empty where that is not known: without git, in a shallow clone, or where it is not committed.
    """
    root = sources.checkout(path)
    if root is None:
        return ""
    return _dates(root).get(path.resolve().relative_to(root).as_posix(), "")


def bibtex(result: Mapping[str, Any], path: Path, slug: str, where: str) -> str:
    """Return a row as an entry of BibTeX; what is not known of it is left out."""
    day, paper = date(path), result["model"].get("paper")
    notes = [f"result of {day}" if day else "", f"after {paper}" if paper else ""]
    fields = {
        "title": "{" + _escaped(result["model"]["name"]) + "}",
        "author": "{" + _escaped(by) + "}" if (by := authors(result, path)) else "",
        "year": day[:4],
        "howpublished": _escaped(f"eigbench leaderboard, {where}"),
        "note": _escaped("; ".join(filter(None, notes))),
    }
    lines = [f"  {name} = {{{text}}}," for name, text in fields.items() if text]
    return "\n".join([f"@misc{{eigbench-{slug},", *lines, "}"])


def _escaped(text: str) -> str:
    r"""Return text that TeX takes as it is.

    Examples
    --------
    >>> print(_escaped("50 % & {a_b}"))
    50 \% \& \{a\_b\}
    """
    return re.sub(r"([&%$#_{}])", r"\\\1", text.replace("\\", "/"))


@lru_cache(maxsize=4)
def _dates(root: Path) -> dict[str, str]:
    """Return the day of the last commit of every result of a checkout that is as committed."""
    if sources.git(root, "rev-parse", "--is-shallow-repository") != "false":
        return {}  # its one commit has every file; or there is no git, or no repository
    log = sources.git(root, "log", "--format=:%cs", "--name-only", "--relative", "--", *FOLDERS)
    changed = sources.git(root, "diff", "HEAD", "--name-only", "--relative", "--", *FOLDERS)
    if log is None or changed is None:
        return {}
    dates: dict[str, str] = {}
    day = ""
    for line in filter(None, log.splitlines()):
        if line.startswith(":"):
            day = line[1:]
        else:
            dates.setdefault(line, day)
    for name in changed.splitlines():
        dates.pop(name, None)
    return dates
