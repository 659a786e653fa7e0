"""How the kernels of this package are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

# Sums may be reordered and fused so that loops use the processor's vector units; infinities
# and NaN keep their meaning, and a division by zero gives them instead of an error.
SETTINGS = {"fastmath": {"reassoc", "contract"}, "error_model": "numpy"}


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers to machine code at its first call.

    The code is kept beside the module, or in the user's cache, for the next process; where
    neither can be written every process compiles anew.
    """
    try:
        compiled: Function = njit(cache=True, **SETTINGS)(function)
    except RuntimeError:  # Numba found no place for its cache
        compiled = njit(**SETTINGS)(function)
    return compiled
