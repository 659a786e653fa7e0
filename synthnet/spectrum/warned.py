"""Warnings about a mesh or its spectrum, which one thread can collect and leave others' alone."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeAlias

Warned: TypeAlias = list[tuple[type[Warning], str]]  # the category and the text of each

_collected: ContextVar[Warned | None] = ContextVar("_collected", default=None)


def warn(message: str, category: type[Warning] = UserWarning, *, stacklevel: int) -> None:
    """Warn as :func:`warnings.warn` does of who called this, or let :func:`collected` have it."""
    kept = _collected.get()
    if kept is not None:
        kept.append((category, message))
    else:
        warnings.warn(message, category, stacklevel=stacklevel + 1)


@contextmanager
def collected() -> Iterator[Warned]:
    """Collect what is warned of within, in this thread, and show none of it."""
    kept: Warned = []
    token = _collected.set(kept)
    try:
        yield kept
    finally:
        _collected.reset(token)
