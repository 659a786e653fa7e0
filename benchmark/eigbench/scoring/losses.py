"""The paper's losses in PyTorch, equal to the metrics of the same name, with gradients.

Every loss takes predictions p and labels g, tensors of shape (B, k) in 1/length², and returns the
mean over the batch, a tensor of shape (). It raises :class:`ValueError` if they are not both of one
such shape: nothing is broadcast.
"""

from __future__ import annotations

from eigbench.scoring.metrics import EPSILON, check_shapes
from synthnet.errors import needed_by

with needed_by("eigbench.losses"):
    import torch
    from torch import Tensor


def rpd_loss(p: Tensor, g: Tensor) -> Tensor:
    r"""Return the batch mean of :math:`\sum_i |p_i - g_i| / (|p_i| + |g_i| + \varepsilon)`.

    References
    ----------
    Paper, section 3.4.

    Examples
    --------
    >>> rpd_loss(torch.tensor([[1.0, 4.0]]), torch.tensor([[3.0, 4.0]])).item()
    0.5
    """
    check_shapes(tuple(p.shape), tuple(g.shape))
    return ((p - g).abs() / (p.abs() + g.abs() + EPSILON)).sum(dim=1).mean()


def polar_loss(p: Tensor, g: Tensor) -> Tensor:
    r"""Return the batch mean of :math:`1 - \langle\hat p,\hat g\rangle + \|p-g\|/(\|p\|+\|g\|)`.

    References
    ----------
    Paper, section 3.4, the numerator of the second term as printed there.

    Examples
    --------
    >>> round(polar_loss(torch.tensor([[3.0, 0.0]]), torch.tensor([[0.0, 4.0]])).item(), 4)
    1.7143
    """
    check_shapes(tuple(p.shape), tuple(g.shape))
    length_p, length_g = torch.linalg.norm(p, dim=1), torch.linalg.norm(g, dim=1)
    cosine = (p * g).sum(dim=1) / (length_p * length_g)
    apart = torch.linalg.norm(p - g, dim=1) / (length_p + length_g)
    loss: Tensor = (1 - cosine + apart).mean()
    return loss


def l1_loss(p: Tensor, g: Tensor) -> Tensor:
    r"""Return the mean over the batch of :math:`\sum_i |p_i - g_i|`.

    Examples
    --------
    >>> l1_loss(torch.tensor([[1.0, 4.0]]), torch.tensor([[3.0, 4.0]])).item()
    2.0
    """
    check_shapes(tuple(p.shape), tuple(g.shape))
    return (p - g).abs().sum(dim=1).mean()
