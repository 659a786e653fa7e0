"""The sparse product of the graph convolution, compiled, on one thread.

In float32, and in bfloat16 with sums in float32. NumPy has no bfloat16: its numbers are the
upper halves of float32's, and travel as 16-bit integers.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from synthnet.kernels import kernel

NONE = np.zeros(0, np.float32)


@kernel
def _gather(offsets, neighbours, weights, x, both):  # type: ignore[no-untyped-def]
    n, c = x.shape
    for i in range(n):
        for k in range(c):
            both[i, k] = 0
            both[i, c + k] = x[i, k]
        for e in range(offsets[i], offsets[i + 1]):
            j = neighbours[e]
            w = weights[e] if len(weights) else np.float32(1)
            for k in range(c):
                both[i, k] += w * x[j, k]


@kernel
def _scatter(offsets, neighbours, weights, both, x):  # type: ignore[no-untyped-def]
    n, c = x.shape
    for i in range(n):
        for k in range(c):
            x[i, k] = both[i, c + k]
        for e in range(offsets[i], offsets[i + 1]):
            j = neighbours[e]
            w = weights[e] if len(weights) else np.float32(1)
            for k in range(c):
                x[i, k] += w * both[j, k]


@kernel
def _gather_half(offsets, neighbours, weights, x, both):  # type: ignore[no-untyped-def]
    n, c = x.shape
    total = np.empty(c, np.float32)
    row = np.empty(c, np.uint32)
    total_bits, row_values = total.view(np.uint32), row.view(np.float32)
    for i in range(n):
        total[:] = 0
        for e in range(offsets[i], offsets[i + 1]):
            j = neighbours[e]
            w = weights[e] if len(weights) else np.float32(1)
            for k in range(c):
                row[k] = np.uint32(x[j, k]) << np.uint32(16)
            for k in range(c):
                total[k] += w * row_values[k]
        for k in range(c):
            bits = total_bits[k]  # rounded to nearest, ties to even
            bits += np.uint32(0x7FFF) + ((bits >> np.uint32(16)) & np.uint32(1))
            both[i, k] = bits >> np.uint32(16)
            both[i, c + k] = x[i, k]


@kernel
def _gather_wide(offsets, neighbours, weights, x, both):  # type: ignore[no-untyped-def]
    n, c = x.shape
    row = np.empty(c, np.uint32)
    values = row.view(np.float32)
    for i in range(n):
        for k in range(c):
            row[k] = np.uint32(x[i, k]) << np.uint32(16)
        for k in range(c):
            both[i, k] = 0
            both[i, c + k] = values[k]
        for e in range(offsets[i], offsets[i + 1]):
            j = neighbours[e]
            w = weights[e] if len(weights) else np.float32(1)
            for k in range(c):
                row[k] = np.uint32(x[j, k]) << np.uint32(16)
            for k in range(c):
                both[i, k] += w * values[k]


@kernel
def _scatter_half(offsets, neighbours, weights, both, x):  # type: ignore[no-untyped-def]
    n, c = x.shape
    total = np.empty(c, np.float32)
    row = np.empty(c, np.uint32)
    total_bits, row_values = total.view(np.uint32), row.view(np.float32)
    for i in range(n):
        for k in range(c):
            total_bits[k] = np.uint32(both[i, c + k]) << np.uint32(16)
        for e in range(offsets[i], offsets[i + 1]):
            j = neighbours[e]
            w = weights[e] if len(weights) else np.float32(1)
            for k in range(c):
                row[k] = np.uint32(both[j, k]) << np.uint32(16)
            for k in range(c):
                total[k] += w * row_values[k]
        for k in range(c):
            bits = total_bits[k]
            bits += np.uint32(0x7FFF) + ((bits >> np.uint32(16)) & np.uint32(1))
            x[i, k] = bits >> np.uint32(16)


RUNS = {
    (torch.float32, torch.float32): _gather,
    (torch.bfloat16, torch.bfloat16): _gather_half,
    (torch.bfloat16, torch.float32): _gather_wide,
}


def gather(
    offsets: Tensor, neighbours: Tensor, weights: Tensor | None, x: Tensor, both: Tensor
) -> None:
    """Write ``[A x, x]`` to the first 2c columns of ``both``; x has shape (n, c).

    Of x in bfloat16 ``both`` may be in float32.
    """
    run = RUNS[x.dtype, both.dtype]
    run(*_arrays(offsets, neighbours, weights), _array(x), _array(both))


def scatter(
    offsets: Tensor, neighbours: Tensor, weights: Tensor | None, both: Tensor, x: Tensor
) -> None:
    """Write ``A u + v`` to x, (n, c), where ``both`` begins with the columns ``[u, v]``.

    The transpose of :func:`gather`, since A is symmetric.
    """
    run = _scatter_half if x.dtype == torch.bfloat16 else _scatter
    run(*_arrays(offsets, neighbours, weights), _array(both), _array(x))


def _array(x: Tensor) -> np.ndarray:
    if x.dtype == torch.bfloat16:
        return x.contiguous().view(torch.uint16).numpy()
    return x.contiguous().numpy()


def _arrays(
    offsets: Tensor, neighbours: Tensor, weights: Tensor | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return offsets.numpy(), neighbours.numpy(), NONE if weights is None else weights.numpy()
