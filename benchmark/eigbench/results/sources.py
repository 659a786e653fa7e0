"""Digests of the files that a predictor is made of, which a tidy-up leaves as they are.

The digest of a Python file is that of its statements: comments, docstrings, formatting and
imports that moved do not change it, a changed statement does. Any other file counts by its bytes.
No code is run here.
"""

from __future__ import annotations

import ast
import hashlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from synthnet.store.files import sha256

# What follows from the position (ctx), from the spelling (kind), or is written as a comment.
UNSEEN = ("ctx", "kind", "type_comment", "type_ignores")


def digest(path: Path) -> str:
    """Return the digest of a file, 64 hexadecimal digits.

    A Python file that does not parse counts by its bytes, like any other file.
    """
    if path.suffix == ".py":
        try:
            return digest_of_code(path.read_bytes())
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            pass  # what the parser raises at code that it does not know, or that nests too deep
    return sha256(path)


def digest_of_code(code: bytes | str) -> str:
    """Return the SHA-256 of code's syntax tree, the same for every version of Python.

    The tree is taken without what does nothing: docstrings and other constants that stand alone,
    and ``pass``. Of the imports only the names count, in no order: what is imported, without its
    module, and the name that it is given.

    Raises
    ------
    SyntaxError, ValueError
        If it is not Python.

    Examples
    --------
    >>> old = "from a import area\\ndef f(x): return  area(x)  # in length²"
    >>> new = "from b.c import area\\ndef f(x):\\n  'Return the area.'\\n  return area(x)"
    >>> digest_of_code(old) == digest_of_code(new)
    True
    >>> digest_of_code(old) == digest_of_code(old.replace("area(x)", "area(2 * x)"))
    False
    """
    with warnings.catch_warnings(action="ignore"):  # of its escapes; they are for its author
        tree = ast.parse(code)
    hashed = hashlib.sha256()
    for part in (*_imported(tree), *_tokens(tree)):
        text = part.encode("utf-8", "surrogatepass")
        hashed.update(b"%d:%s" % (len(text), text))  # the length keeps neighbours apart
    return hashed.hexdigest()


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
    for name in sorted(set(node._fields) - set(UNSEEN)):
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
            parts[-1] = ast.Constant(f"{parts[-1].value}{item.value}")
        elif item.value:
            parts.append(item)
    return parts


def _spelt(value: Any) -> str:
    """Return a constant as text; of a string itself, since repr follows Python's Unicode tables."""
    return value if isinstance(value, str) else repr(value)
