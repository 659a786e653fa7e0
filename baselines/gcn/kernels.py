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


@kernel
def _pool(starts, z, slope, means):  # type: ignore[no-untyped-def]
    c = z.shape[1]
    total = np.empty(c)
    for b in range(len(means)):
        total[:] = 0
        for i in range(starts[b], starts[b + 1]):
            for k in range(c):
                total[k] += max(z[i, k], slope * z[i, k])
        means[b] = total / (starts[b + 1] - starts[b])


@kernel
def _spread(starts, z, slope, gradient, x):  # type: ignore[no-untyped-def]
    c = z.shape[1]
    for b in range(len(gradient)):
        share = gradient[b] / np.float32(starts[b + 1] - starts[b])
        for i in range(starts[b], starts[b + 1]):
            for k in range(c):
                x[i, k] = share[k] if z[i, k] > 0 else slope * share[k]


@kernel
def _pool_half(starts, z, slope, means):  # type: ignore[no-untyped-def]
    c = z.shape[1]
    total, row = np.empty(c, np.float32), np.empty(c, np.uint32)
    values = row.view(np.float32)
    for b in range(len(means)):
        total[:] = 0
        for i in range(starts[b], starts[b + 1]):
            for k in range(c):
                row[k] = np.uint32(z[i, k]) << np.uint32(16)
            for k in range(c):
                total[k] += max(values[k], slope * values[k])
        means[b] = total / np.float32(starts[b + 1] - starts[b])


@kernel
def _spread_half(starts, z, slope, gradient, x):  # type: ignore[no-untyped-def]
    c = z.shape[1]
    both = np.empty((2, c), np.uint16)  # the gradient where z is negative, and where it is not
    for b in range(len(gradient)):
        share = gradient[b] / np.float32(starts[b + 1] - starts[b])
        for sign, factor in ((0, slope), (1, np.float32(1))):
            bits = (factor * share).view(np.uint32)
            for k in range(c):
                rounded = bits[k] + np.uint32(0x7FFF) + ((bits[k] >> np.uint32(16)) & np.uint32(1))
                both[sign, k] = rounded >> np.uint32(16)
        for i in range(starts[b], starts[b + 1]):
            for k in range(c):
                x[i, k] = both[1, k] if z[i, k] < 0x8000 else both[0, k]


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


def pool(starts: tuple[int, ...], z: Tensor, slope: float, means: Tensor) -> None:
    """Write the mean of LeakyReLU(z) over each mesh's vertices, (B, c), float32; z is (n, c)."""
    run = _pool_half if z.dtype == torch.bfloat16 else _pool
    run(np.array(starts), _array(z), np.float32(slope), means.numpy())


def spread(starts: tuple[int, ...], z: Tensor, slope: float, gradient: Tensor, x: Tensor) -> None:
    """Write the gradient of :func:`pool` with respect to z, (n, c), in z's dtype."""
    run = _spread_half if z.dtype == torch.bfloat16 else _spread
    run(np.array(starts), _array(z), np.float32(slope), gradient.contiguous().numpy(), _array(x))


def _array(x: Tensor) -> np.ndarray:
    if x.dtype == torch.bfloat16:
        return x.contiguous().view(torch.uint16).numpy()
    return x.contiguous().numpy()


def _arrays(
    offsets: Tensor, neighbours: Tensor, weights: Tensor | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return offsets.numpy(), neighbours.numpy(), NONE if weights is None else weights.numpy()
