"""From outputs to eigenvalues to a loss."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from eigbench.scoring import losses
from torch import Tensor, nn

from .folded import batch_loss, outputs
from .graphs import Graphs
from .model import GCN, GCNConfig

MOST = 20.0  # of a scale-free network's output
LOSSES = {"rpd": losses.rpd_loss, "polar": losses.polar_loss, "l1": losses.l1_loss}


def eigenvalues(outputs: Tensor, areas: Tensor, config: GCNConfig) -> Tensor:
    r"""Return the eigenvalues that a network's outputs o stand for, (B, k), in 1/length².

    They are the outputs themselves, or, of a scale-free network, Weyl's law corrected:
    :math:`4\pi i\,e^{o_i} / \mathrm{area}`, with o bent to between -20 and 20,
    so that no step overflows.
    """
    if not config.scale_free:
        return outputs
    law = 4 * torch.pi * torch.arange(1, outputs.shape[1] + 1, device=outputs.device)
    return law * torch.exp(MOST * torch.tanh(outputs / MOST)) / areas[:, None]


def mean_outputs(y: Tensor, areas: Tensor, config: GCNConfig) -> Tensor:
    """Return the outputs, (k,), that stand for the geometric mean of labels, (S, k).

    An untrained network is put there by its last bias. The paper does not say how it begins;
    but RPDLoss is constant where an output is negative, so an output that begins there has no
    gradient of its own, and PyTorch's initial values leave about half of the ten there.
    """
    if not config.scale_free:
        return y.log().mean(dim=0).exp()
    law = 4 * torch.pi * torch.arange(1, y.shape[1] + 1, device=y.device)
    return (y * areas[:, None] / law).log().mean(dim=0)


def predict(model: GCN, graphs: Sequence[Graphs], threads: int = 1) -> Tensor:
    """Return the eigenvalues of encoded meshes, (B, k), float32, on the CPU."""
    areas = torch.cat([one.areas for one in graphs])
    return eigenvalues(outputs(model, graphs, threads=threads), areas, model.config).cpu()


class Objective(nn.Module):
    """A network with its loss, as one module: what DistributedDataParallel wants."""

    def __init__(
        self, model: GCN, loss: str, dtype: torch.dtype = torch.float32, threads: int = 1
    ) -> None:
        super().__init__()
        self.model, self.loss, self.dtype, self.threads = model, LOSSES[loss], dtype, threads

    def forward(self, graphs: Sequence[Graphs], isometries: Tensor, y: Tensor) -> Tensor:
        """Return the mean loss of a batch of graphs of one mesh each."""

        def loss(outputs: Tensor, y: Tensor, areas: Tensor) -> Tensor:
            return self.loss(eigenvalues(outputs, areas, self.model.config), y)

        return batch_loss(self.model, graphs, isometries, y, loss, self.dtype, self.threads)
