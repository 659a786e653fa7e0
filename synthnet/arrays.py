"""Names of the types of arrays, and arrays of what others give."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Int32s: TypeAlias = NDArray[np.int32]  # as kernels take sparse matrices and meshes
Int64s: TypeAlias = NDArray[np.int64]
Booleans: TypeAlias = NDArray[np.bool_]


def as_array(values: Any) -> NDArray[Any]:
    """Return an array, list or tensor as an array of NumPy.

    A tensor of PyTorch is fetched from its device and its graph.

    Raises
    ------
    ValueError
        If rows differ in length, something is masked, or it is otherwise no array of NumPy, as a
        tensor of bfloat16 or a sparse one.

    Examples
    --------
    >>> as_array([[1, 2], [3, 4]]).shape
    (2, 2)
    """
    rows = values if isinstance(values, (list, tuple)) else ()
    if np.ma.is_masked(values) or any(map(np.ma.is_masked, rows)):
        raise ValueError("a masked array: fill what is masked, with NaN if need be")
    tensor = hasattr(values, "detach") and hasattr(values, "layout")  # a stream detaches, too
    try:
        return np.asarray(values.detach().cpu() if tensor else values)
    except (TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        if tensor:
            reason = f"a tensor of {values.dtype} and layout {values.layout} is no array of NumPy"
        elif "inhomogeneous" in reason:
            reason = "rows of different length are no array"
        if tensor or "ScalarType" in reason:  # of a list of PyTorch's tensors
            reason += ": give a dense one of float32 or float64"
        raise ValueError(reason) from error


def as_reals(values: Any, name: str) -> Floats:
    """Return an array, list or tensor of real numbers as float64.

    Raises
    ------
    ValueError
        As :func:`as_array`; if they are of another kind, such as complex.

    Examples
    --------
    >>> as_reals([1, 2], "times")
    array([1., 2.])
    """
    array = as_array(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be real numbers, got {array.dtype}")
    return array.astype(np.float64)
