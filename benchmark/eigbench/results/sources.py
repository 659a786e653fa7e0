"""Digests of the files that a predictor is made of, which a tidy-up leaves as they are.

The digest of a Python file is that of its statements: comments, docstrings, formatting and
imports that moved do not change it, a changed statement does. Any other file counts by its bytes.
No code is run here.
"""

import ast
import hashlib
import os
import re
import subprocess
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from eigbench import outside
from eigbench.errors import OutsideError
from synthnet.store.files import sha256

# What follows from the position (ctx), from the spelling (kind), or is written as a comment.
IGNORED_FIELDS = ("ctx", "kind", "type_comment", "type_ignores")

CODE = "baselines"  # of a checkout: the folder with the predictors of its rows
MOST_CODE = 2**20  # bytes of a file that is parsed
MOST_WEIGHTS = 2**40  # bytes of any file
MOST_FILES, LONGEST_NAME = 1000, 300  # of a predictor, as result.schema.json has them
# What the parser raises at code that it does not know, or that is too deep
UNPARSABLE = (SyntaxError, ValueError, RecursionError, MemoryError)
ELSEWHERE = re.compile(r"\b(__name__|TYPE_CHECKING)\b")  # in a condition: not as it is loaded
HEAD = 2**16  # bytes of a file that are looked at to see what it is
# By suffix: whether it is the beginning that tells, else the end, and what stands there
OUTPUTS = {
    ".json": (True, re.compile(rb'"(metric|scaling|timing)_version":')),
    ".parquet": (False, re.compile(rb"\x18\x08eigbench\x18")),  # a key of its metadata
}
# Suffixes of notes, logs and pictures: no predictor reads them. A .txt or .csv may hold its numbers
NOTES = frozenset(
    (
        *(".log", ".out", ".err", ".md", ".rst", ".html"),
        *(".pdf", ".svg", ".png", ".jpg", ".jpeg", ".gif"),
    )
)
EARLIER = "This row was made by an earlier version of the model's code."


def outdated(result: dict[str, Any], root: Path) -> bool:
    """Return whether the code of a result in a checkout is not that which made it any more.

    A result whose predictor is not among the checkout's baselines is not: nothing is known of it.
    Another's predictor may have the file name of a baseline; it does not have its model's name.
    """
    folder, model = root / CODE, result["model"]
    file, _, variant = model["code"].partition(":")
    try:
        code = outside.read(folder / file, most=MOST_CODE, below=root)
    except FileNotFoundError:
        return False
    if not variant and model["name"] not in code.decode("utf-8", errors="replace"):
        return False
    return any(current(root, name) != made_by for name, made_by in model["sources"].items())


def is_output(path: Path, below: Path | None = None) -> bool:
    """Return whether a file is an earlier run's: results, predictions, or a log, note or picture.

    They may have a predictor's name, and are no part of it. Results, those of ``scale`` and
    ``time`` too, and predictions are known by what eigbench has written, the others by their
    suffix. ``below`` is as of :func:`eigbench.outside.opened`; what that does not open is none.
    """
    if path.suffix.lower() in NOTES:
        return True
    if path.suffix not in OUTPUTS:
        return False
    start, mark = OUTPUTS[path.suffix]
    try:
        with outside.opened(path, most=MOST_WEIGHTS, below=below) as file:
            if not start:
                file.seek(max(0, os.fstat(file.fileno()).st_size - HEAD))
            return mark.search(file.read(HEAD)) is not None
    except (FileNotFoundError, OutsideError):  # whoever needs it says so
        return False


def unnameable(names: Collection[str]) -> str:
    """Return why no result can name a predictor's files, and what to do; empty if one can."""
    if len(names) > MOST_FILES:
        return (
            f"the predictor has {len(names):,} files, and a result names {MOST_FILES:,} at most: "
            "put its data into fewer"
        )
    for name in names:
        if problem := outside.strange_name(name):
            return f"a result cannot name the predictor's file {name!a}, for {problem}: rename it"
        if len(name) > LONGEST_NAME:
            return f"a result cannot name the predictor's file {name}: give it a shorter path"
    return ""


def remark(result: dict[str, Any], path: Path) -> str:
    """Return what a board says of a result in a checkout whose code has changed since."""
    root = checkout(path)
    return EARLIER if root is not None and outdated(result, root) else ""


def checkout(path: Path) -> Path | None:
    """Return the checkout whose board a result is on."""
    board = next((folder for folder in path.resolve().parents if folder.name == "benchmark"), None)
    return None if board is None else board.parent


def git(folder: Path, *command: str) -> str | None:
    """Return what git prints of a folder; None where it fails, or is not installed."""
    line = ["git", "-C", str(folder), *command]
    try:
        done = subprocess.run(line, capture_output=True, text=True, check=False)
    except OSError:
        return None
    return None if done.returncode else done.stdout.strip()


def current(root: Path, name: str) -> str:
    """Return the digest of a file of a checkout's predictors as it is; empty if it is not there."""
    path = root / CODE / name
    if not os.path.lexists(path):
        return ""
    facts = path.lstat()
    return _remembered(path, root, facts.st_mtime_ns, facts.st_size)


@lru_cache(maxsize=1024)
def _remembered(path: Path, root: Path, changed: int, size: int) -> str:
    return digest(path, root)


def digest(path: Path, below: Path | None = None) -> str:
    """Return the digest of a file, 64 hexadecimal digits.

    A Python file that does not parse, or is no code by its size, counts by its bytes, like any
    other file. ``below`` is as of :func:`eigbench.outside.opened`.
    """
    with outside.opened(path, most=MOST_WEIGHTS, below=below) as file:
        if path.suffix == ".py" and os.fstat(file.fileno()).st_size <= MOST_CODE:
            try:
                return digest_of_code(file.read(MOST_CODE))
            except UNPARSABLE:
                file.seek(0)
        return hashlib.file_digest(file, "sha256").hexdigest()


def contents(names: Iterable[str], folders: Sequence[Path]) -> dict[str, str]:
    """Return the SHA-256 of the bytes of a predictor's files: what a run may go on with.

    Code may read its docstring, and a name imported from elsewhere is another: :func:`digest`
    sees neither. The files have their names as in a result, and are in the first of the folders
    that has one of the name; one that is in none is left out.
    """
    paths = {
        name: next((path for path in (folder / name for folder in folders) if path.is_file()), None)
        for name in names
    }
    return {name: sha256(path) for name, path in paths.items() if path is not None}


def digest_of_code(code: bytes | str) -> str:
    r"""Return the SHA-256 of code's syntax tree, the same for every version of Python.

    The tree is taken without what does nothing: docstrings and other constants that stand alone,
    and ``pass``. Of the imports only the names count, in no order: what is imported, without its
    module, and the name that it is given.

    Raises
    ------
    SyntaxError, ValueError
        If it is not Python.

    Examples
    --------
    >>> old = "from a import area\ndef f(x): return  area(x)  # in length²"
    >>> new = "from b.c import area\ndef f(x):\n  'Return the area.'\n  return area(x)"
    >>> digest_of_code(old) == digest_of_code(new)
    True
    >>> digest_of_code(old) == digest_of_code(old.replace("area(x)", "area(2 * x)"))
    False
    """
    tree = _parsed(code)
    hashed = hashlib.sha256()
    for part in (*_imported(tree), *_tokens(tree)):
        text = part.encode("utf-8", "surrogatepass")
        hashed.update(b"%d:%s" % (len(text), text))  # the length keeps neighbours apart
    return hashed.hexdigest()


def modules(code: bytes | str) -> set[str]:
    r"""Return the first names of the modules that code imports as it is loaded.

    What a function imports when it is called does not count, nor what only a script or a checker
    of types imports. Of code that does not parse nothing is known, and nothing returned.

    Examples
    --------
    >>> sorted(modules("import a, b.c\nfrom d import e\ndef f():\n  import g"))
    ['a', 'b', 'd']
    >>> modules("if __name__ == '__main__':\n  import g"), modules("import")
    (set(), set())
    """
    found: set[str] = set()
    try:
        left: list[ast.AST] = [_parsed(code)]
    except UNPARSABLE:
        return found
    while left:
        node = left.pop()
        if isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.If) and ELSEWHERE.search(ast.unparse(node.test)):
            left += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            left += ast.iter_child_nodes(node)
    return {name.partition(".")[0] for name in found}


def _parsed(code: bytes | str) -> ast.Module:
    """Return the tree of code; warnings of its escapes are for its author."""
    with warnings.catch_warnings(action="ignore"):
        return ast.parse(code)


def _imported(tree: ast.Module) -> list[str]:
    """Return what the imports of a file bind, as ``name as bound``."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names |= {(alias.name, alias.asname or alias.name) for alias in node.names}
        elif isinstance(node, ast.Import):
            for alias in node.names:  # ``import a.b`` binds a, ``import a.b as c`` binds b as c
                first, last = alias.name.split(".")[0], alias.name.split(".")[-1]
                names.add((last, alias.asname) if alias.asname else (first, first))
    return [f"{name} as {bound}" for name, bound in sorted(names)]


def _tokens(tree: ast.Module) -> Iterator[str]:
    """Yield a tree, a node after the other; a stack instead of calls, for code that nests deep."""
    left: list[Any] = [tree]
    while left:
        item = left.pop()
        if isinstance(item, _Mark):
            yield item
        elif isinstance(item, ast.Constant):
            yield f"{type(item.value).__name__} {_spelt(item.value)}"
        elif isinstance(item, ast.AST):
            left += [_Mark(")"), *reversed(_fields(item)), _Mark(f"{type(item).__name__}(")]
        elif isinstance(item, list):
            left += [_Mark("]"), *reversed(item), _Mark("[")]
        else:
            yield f"{type(item).__name__} {_spelt(item)}"


class _Mark(str):
    """A bracket or a name of the tree's own, which no identifier in it can be taken for."""


def _fields(node: ast.AST) -> list[Any]:
    """Return the names and values of a node's fields, in order, without those that are empty."""
    parts: list[Any] = []
    for name in sorted(set(node._fields) - set(IGNORED_FIELDS)):
        value = getattr(node, name, None)
        if isinstance(value, list):
            value = _joined(value) if isinstance(node, ast.JoinedStr) else _acting(value)
        if value is not None and value != []:
            parts += [_Mark(f"{name}="), value]
    return parts


def _acting(items: list[Any]) -> list[Any]:
    """Return a list of nodes without the statements that do nothing, and without imports."""
    idle = (ast.Pass, ast.Import, ast.ImportFrom)
    return [
        item
        for item in items
        if not isinstance(item, idle)
        and not (isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant))
    ]


def _joined(items: list[Any]) -> list[Any]:
    """Return the parts of an f-string; parsers differ in how they cut the text between braces."""
    parts: list[Any] = []
    for item in items:
        if not isinstance(item, ast.Constant):
            parts.append(item)
        elif parts and isinstance(parts[-1], ast.Constant):
            parts[-1] = ast.Constant(_spelt(parts[-1].value) + _spelt(item.value))
        elif item.value:
            parts.append(item)
    return parts


def _spelt(value: Any) -> str:
    """Return a constant as text; of a string itself, since repr follows Python's Unicode tables."""
    return value if isinstance(value, str) else repr(value)
