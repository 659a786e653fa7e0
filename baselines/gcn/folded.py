r"""The network of :mod:`model`, computed several times faster with the same parameters.

- **Folding.** Between LeakyReLU and the next nonlinearity all is linear: the block's Linear, the
  next GraphConv's two matrices and the bias. With a the activations, A the weighted adjacency
  matrix, L and d the Linear, W₁, W₂ and b the next GraphConv,

  .. math:: W_2 A (aL^T + 1d^T) + W_1 (aL^T + 1d^T) + b = [Aa, a, A1, 1]\,M

  for one matrix M of their products. The last block's Linear is applied after the mean.
  So half of the multiplications are left, and one matrix product a block.
- **One mesh at a time.** Activations of a few thousand vertices stay in the processor's cache;
  small meshes go together. Every thread has a mesh of its own.
- **Forward, then backward** of one mesh before the next, in training: gradients with respect to
  the matrices M add up over the meshes, and go back through the folding once a step.
- **A sparse product** in compressed rows with 32-bit indices, whose transpose is itself: A is
  symmetric.

On a GPU all meshes go together, and the sparse product is PyTorch's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from .graphs import TAIL, Graphs, join
from .kernels import gather, pool, scatter, spread
from .model import GCN

CHUNK = 4096  # vertices up to which meshes go together on a CPU


def fold(model: GCN) -> list[Tensor]:
    """Return the matrix M of each block, (2c + 4, out), then of each layer, (in + 1, out)."""
    matrices: list[Tensor] = []
    linear: nn.Linear | None = None
    for block in model.blocks:
        near, far = block.conv.lin_root.weight, block.conv.lin_rel.weight
        bias = block.conv.lin_rel.bias
        if linear is None:
            rows = [far.T, near.T, torch.zeros_like(bias)[None], bias[None]]
        else:
            rows = [
                linear.weight.T @ far.T,
                linear.weight.T @ near.T,
                (far @ linear.bias)[None],
                (near @ linear.bias + bias)[None],
            ]
        rows.append(bias.new_zeros(TAIL - 2, len(bias)))
        matrices.append(torch.cat(rows))
        linear = block.linear
    for layer in model.head:
        if isinstance(layer, nn.Linear):
            weight, bias = layer.weight, layer.bias
            if linear is not None:
                weight, bias = weight @ linear.weight, weight @ linear.bias + bias
                linear = None
            matrices.append(torch.cat([weight.T, bias[None]]))
    return matrices


class Aggregate(torch.autograd.Function):
    """``[A a, a, A 1, 1, 0, 0]`` of activations a; on a GPU with A as a sparse matrix."""

    @staticmethod
    def forward(
        ctx: Any, a: Tensor, graphs: Graphs, sparse: Tensor | None, dtype: torch.dtype
    ) -> Tensor:
        """Return (n, 2c + 4), in a dtype, of (n, c)."""
        ctx.graphs, ctx.sparse, ctx.dtype = graphs, sparse, a.dtype
        n, c = a.shape
        both = a.new_empty(n, 2 * c + TAIL, dtype=dtype)
        if sparse is not None:
            both[:, :c] = sparse @ a
            both[:, c : 2 * c] = a
        else:
            gather(graphs.offsets, graphs.neighbours, graphs.weights, a, both)
        both[:, 2 * c :] = graphs.features[:, -TAIL:]
        return both

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        """Return the gradient with respect to a: A is symmetric."""
        graphs: Graphs = ctx.graphs
        n, c = len(gradient), (gradient.shape[1] - TAIL) // 2
        if ctx.sparse is not None:
            far = ctx.sparse @ gradient[:, :c].contiguous()
            return far + gradient[:, c : 2 * c], None, None, None
        x = gradient.new_empty(n, c)
        scatter(graphs.offsets, graphs.neighbours, graphs.weights, gradient, x)
        return x.to(ctx.dtype), None, None, None


class Pool(torch.autograd.Function):
    """The mean of LeakyReLU(z) over the vertices of each mesh, in one pass, on a CPU."""

    @staticmethod
    def forward(ctx: Any, z: Tensor, starts: tuple[int, ...], slope: float) -> Tensor:
        """Return (B, c), float32, of (n, c)."""
        ctx.save_for_backward(z)
        ctx.starts, ctx.slope = starts, slope
        means = torch.empty(len(starts) - 1, z.shape[1])
        pool(starts, z, slope, means)
        return means

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        """Return the gradient with respect to z."""
        (z,) = ctx.saved_tensors
        x = torch.empty_like(z)
        spread(ctx.starts, z, ctx.slope, gradient, x)
        return x, None, None


def adjacency(graphs: Graphs, dtype: torch.dtype) -> Tensor:
    """Return A as PyTorch's sparse matrix, (n, n)."""
    n = len(graphs.offsets) - 1
    weights = graphs.weights
    if weights is None:
        weights = torch.ones(len(graphs.neighbours), device=graphs.offsets.device)
    return torch.sparse_csr_tensor(
        graphs.offsets, graphs.neighbours, weights.to(dtype), (n, n), check_invariants=False
    )


def apply(
    matrices: Sequence[Tensor], graphs: Graphs, model: GCN, dtype: torch.dtype = torch.float32
) -> Tensor:
    """Return the outputs of some meshes, (B, k), by the folded matrices.

    Activations have ``dtype``, means and head float32. On a processor that multiplies no bfloat16
    only they are rounded to it, and sums and products are in float32.
    """
    slope, blocks = model.config.slope, model.config.blocks
    products = product_dtype(dtype, graphs.features.device)
    both = graphs.features.to(products)
    sparse = adjacency(graphs, dtype) if both.is_cuda else None
    for matrix in matrices[: blocks - 1]:
        a = functional.leaky_relu_(both @ matrix.to(products), slope).to(dtype)
        both = Aggregate.apply(a, graphs, sparse, products)
    z = both @ matrices[blocks - 1].to(products)
    if sparse is None:
        x = Pool.apply(z, graphs.starts, slope)
    else:
        a = functional.leaky_relu_(z, slope)
        means = [a[i:j].mean(dim=0, dtype=torch.float32) for i, j in pairwise(graphs.starts)]
        x = torch.stack(means)
    for i, matrix in enumerate(matrices[blocks:]):
        if i:
            x = functional.leaky_relu_(x, slope)
        x = torch.addmm(matrix[-1], x, matrix[:-1])
    return x


def product_dtype(dtype: torch.dtype, device: torch.device) -> torch.dtype:
    """Return the dtype in which matrices are multiplied."""
    if dtype == torch.bfloat16 and device.type == "cpu" and not has_bfloat16():
        return torch.float32  # PyTorch's product in bfloat16 would be fifty times slower
    return dtype


def has_bfloat16() -> bool:
    """Return whether PyTorch multiplies bfloat16 matrices quickly on this processor."""
    return torch.backends.cpu.get_cpu_capability() not in ("DEFAULT", "AVX2")


def grouped(graphs: Sequence[Graphs]) -> list[list[int]]:
    """Return the meshes that are computed together: on a GPU all of them."""
    if graphs[0].features.is_cuda:
        return [list(range(len(graphs)))]
    return chunks([len(one.features) for one in graphs], CHUNK)


def chunks(sizes: Sequence[int], limit: int) -> list[list[int]]:
    """Sort meshes by size, the largest first, and group them up to so many vertices."""
    groups: list[list[int]] = []
    room = 0
    for i in sorted(range(len(sizes)), key=lambda i: (-sizes[i], i)):
        if sizes[i] > room:
            groups.append([])
            room = max(limit, sizes[i])
        groups[-1].append(i)
        room -= sizes[i]
    return groups


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))


def each(work: Callable[[Any], Any], items: Sequence[Any], threads: int) -> list[Any]:
    """Return ``work(item)`` of each, on so many threads, PyTorch's own parallelism off in them."""
    if threads == 1 or len(items) == 1:
        return [work(item) for item in items]
    return list(_pool(threads).map(work, items))


def outputs(
    model: GCN, graphs: Sequence[Graphs], dtype: torch.dtype = torch.float32, threads: int = 1
) -> Tensor:
    """Return the outputs of graphs of one mesh each, (B, k), without gradients."""
    with torch.no_grad():
        matrices = fold(model)
        groups = grouped(graphs)

        def work(group: list[int]) -> Tensor:
            with torch.no_grad():
                return apply(matrices, join([graphs[i] for i in group]), model, dtype)

        answers = torch.cat(each(work, groups, threads))
    found = torch.empty_like(answers)
    found[[i for group in groups for i in group]] = answers
    return found


class _Sum(torch.autograd.Function):
    """A number whose gradients have been computed beforehand."""

    @staticmethod
    def forward(ctx: Any, value: Tensor, gradients: list[Tensor], *inputs: Tensor) -> Tensor:
        """Return the value."""
        ctx.save_for_backward(*gradients)
        return value.clone()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Return the gradients."""
        return None, None, *(gradient * g for g in ctx.saved_tensors)


def batch_loss(
    model: GCN,
    graphs: Sequence[Graphs],
    isometries: Tensor | None,
    y: Tensor,
    loss: Callable[[Tensor, Tensor, Tensor], Tensor],
    dtype: torch.dtype = torch.float32,
    threads: int = 1,
) -> Tensor:
    """Return the mean loss of a batch, from which ``backward`` reaches the model's parameters.

    Parameters
    ----------
    model : GCN
        Whose parameters get gradients.
    graphs : sequence of Graphs
        One mesh each.
    isometries : Tensor of shape (B, 3, 3), or None
        By which the meshes are moved.
    y : Tensor of shape (B, k)
        Labels.
    loss : callable
        Mean over meshes, of outputs, labels and areas.
    dtype : torch.dtype
        Of the blocks: float32 or bfloat16.
    threads : int
        Meshes at a time.
    """
    matrices = fold(model)
    leaves = [matrix.detach().requires_grad_() for matrix in matrices]
    groups = grouped(graphs)

    def work(group: list[int]) -> tuple[Tensor, ...]:
        moved = None if isometries is None else isometries[group]
        joined = join([graphs[i] for i in group], moved)
        share = len(group) / len(graphs)
        value = share * loss(apply(leaves, joined, model, dtype), y[group], joined.areas)
        return value.detach(), *torch.autograd.grad(value, leaves)

    value, *gradients = (sum(parts) for parts in zip(*each(work, groups, threads), strict=True))
    return _Sum.apply(value, gradients, *matrices)
