"""What a callable is: a digest of its code and of all that it holds.

``SynthNet(pre_transform=...)`` names the directory of what a callable has made by this, so that a
changed one is another. A name or a ``repr`` would hide most changes. Code is what Python compiled
it to, that of installed libraries their version; what is read from elsewhere, such as a global
variable, is not seen.
"""

import copyreg
import hashlib
import json
import sys
import sysconfig
import weakref
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import (
    BuiltinFunctionType,
    CellType,
    CodeType,
    FunctionType,
    MappingProxyType,
    MethodType,
    ModuleType,
)
from typing import Any

import numpy as np

from synthnet.errors import needed_by
from synthnet.store.files import one_line

with needed_by("synthnet.pyg"):
    import torch

PLAIN = (type(None), bool, int, float, complex, str, bytes)  # their repr is all that they are
HOLDERS = (tuple, list, dict, set, frozenset, np.ndarray, np.generic, torch.Tensor)


def fingerprint(value: Any) -> str:
    """Return a digest of an object's code and state, the same in every process.

    Raise TypeError if it holds something whose state cannot be seen, as an open file or a lock.
    """
    try:
        return _Digests().of(value)
    except RecursionError as error:
        raise TypeError(
            f"pre_transform holds a {type(value).__qualname__} whose parts are nested too deep"
        ) from error


class _Digests:
    """Digests of objects; each is looked at once, however many others hold it."""

    def __init__(self) -> None:
        self._known: dict[int, str] = {}
        self._alive: list[Any] = []  # so that no other object gets its number

    def of(self, value: Any) -> str:
        """Return the digest of an object."""
        if type(value) in PLAIN:
            return _digest([type(value).__name__, repr(value)])
        if id(value) not in self._known:
            self._known[id(value)] = f"object {len(self._known)}"  # to those that it holds
            self._alive.append(value)
            parts = [self.of(part) for part in self._parts(value)]
            if isinstance(value, set | frozenset):
                parts.sort()  # the order in which a set is passed through differs by process
            self._known[id(value)] = _digest([type(value).__qualname__, *parts])
        return self._known[id(value)]

    def _parts(self, value: Any) -> list[Any]:
        """Return what an object consists of: its code, and what it holds."""
        kind = type(value)
        if kind in (list, tuple, set, frozenset):
            return list(value)
        if kind in (dict, MappingProxyType):
            return [part for pair in value.items() for part in pair]
        if isinstance(value, torch.Tensor):
            return _tensor_parts(value)
        if kind is np.ndarray and not value.dtype.hasobject:
            content = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
            return [str(value.dtype), value.shape, content]
        if kind is CodeType:
            names = (value.co_names, value.co_freevars, value.co_argcount)
            return [value.co_code, value.co_exceptiontable, *names, *value.co_consts]
        if kind is FunctionType:
            library = _library(value.__module__)
            code = value.__code__ if library is None else f"{library}: {value.__qualname__}"
            defaults = (value.__defaults__, value.__kwdefaults__)
            return [code, *defaults, value.__closure__, value.__dict__]
        if kind is CellType:
            try:
                return [value.cell_contents]
            except ValueError:  # nothing has been put into it yet
                return []
        if kind is MethodType:
            return [value.__func__, value.__self__]
        if kind is BuiltinFunctionType:
            return [value.__name__, value.__self__]
        if isinstance(value, weakref.ReferenceType):
            return [value()]
        if isinstance(value, ModuleType):
            return [value.__name__]
        if isinstance(value, type):
            return [part for base in value.__mro__ for part in _class_parts(base)]
        return [kind, *_reduced(value)]


def _digest(parts: list[str]) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def _tensor_parts(tensor: torch.Tensor) -> list[Any]:
    """Return what a tensor consists of; its dtype may be one that NumPy does not know."""
    tensor = tensor.detach().cpu().resolve_conj().resolve_neg()
    if tensor.layout is not torch.strided:
        entries = tensor.to_sparse(layout=torch.sparse_coo).coalesce()
        return [entries.indices(), entries.values(), tuple(tensor.shape), str(tensor.layout)]
    content = tensor.contiguous().flatten().view(torch.uint8).numpy()
    return [str(tensor.dtype), tuple(tensor.shape), content]


def _class_parts(kind: type) -> list[Any]:
    """Return what a class itself, without those that it derives from, defines."""
    library = _library(kind.__module__)
    if library is not None:
        return [f"{library}: {kind.__qualname__}"]
    parts: list[Any] = [kind.__module__, kind.__qualname__]
    for name, value in vars(kind).items():
        if isinstance(value, staticmethod | classmethod):
            parts += [name, value.__func__]
        elif isinstance(value, property):
            parts += [name, value.fget]
        elif isinstance(value, FunctionType):
            parts += [name, value]
        elif type(value) in PLAIN and not name.startswith("__"):
            parts.append(f"{name} = {value!r}")
        elif isinstance(value, HOLDERS) and not name.startswith("__"):
            parts += [name, value]
    return parts


@cache
def _library(module: str | None) -> str | None:
    """Return name and version of the library that a module belongs to; None if it is in none."""
    name = str(module).partition(".")[0]
    if name in sys.stdlib_module_names:
        return f"Python {sys.version_info.major}.{sys.version_info.minor}, {module}"
    file = getattr(sys.modules.get(name), "__file__", None)
    folders = (sysconfig.get_path("purelib"), sysconfig.get_path("platlib"))
    if file is None or not any(Path(file).is_relative_to(folder) for folder in folders):
        return None
    return f"{name} {getattr(sys.modules[name], '__version__', '')}, {module}"


def _reduced(value: Any) -> list[Any]:
    """Return what pickle would keep of an object, which types written in C tell, too."""
    reduce = copyreg.dispatch_table.get(type(value))
    try:
        state = value.__reduce_ex__(2) if reduce is None else reduce(value)
    except Exception as error:
        kind = type(value)
        raise TypeError(
            f"pre_transform holds a {kind.__module__}.{kind.__qualname__}, whose state cannot be "
            f"seen ({one_line(error)}): leave it out, or give it as transform, which keeps nothing"
        ) from error
    if isinstance(state, str):  # it is known by its name alone, as a cached function is
        return [state, getattr(value, "__dict__", {})]
    return [list(part) if isinstance(part, Iterator) else part for part in state]
