"""Loops over long vectors, which read one once for several others: most of the time is in them."""

from synthnet.arrays import Floats
from synthnet.kernels import kernel

Four = tuple[float, float, float, float]


@kernel
def subtract(y: Floats, x: Floats, factor: float) -> None:
    """Subtract a multiple of a vector: y −= factor x."""
    for j in range(y.shape[0]):
        y[j] -= factor * x[j]


@kernel
def subtract_four(
    y: Floats, z: Floats, x0: Floats, x1: Floats, x2: Floats, x3: Floats, a: Four, b: Four
) -> None:
    """Subtract two combinations of four vectors: y −= Σ aᵢ xᵢ, z −= Σ bᵢ xᵢ."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    for j in range(y.shape[0]):
        p, q, r, s = x0[j], x1[j], x2[j], x3[j]
        y[j] -= a0 * p + a1 * q + a2 * r + a3 * s
        z[j] -= b0 * p + b1 * q + b2 * r + b3 * s


@kernel
def dot_four(
    y: Floats, z: Floats, x0: Floats, x1: Floats, x2: Floats, x3: Floats
) -> tuple[Four, Four]:
    """Return the products of y, and of z, with four vectors."""
    a0 = a1 = a2 = a3 = 0.0
    b0 = b1 = b2 = b3 = 0.0
    for j in range(y.shape[0]):
        p, q = y[j], z[j]
        a0 += x0[j] * p
        a1 += x1[j] * p
        a2 += x2[j] * p
        a3 += x3[j] * p
        b0 += x0[j] * q
        b1 += x1[j] * q
        b2 += x2[j] * q
        b3 += x3[j] * q
    return (a0, a1, a2, a3), (b0, b1, b2, b3)
