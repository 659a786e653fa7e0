"""The paper's graph convolutional network, in PyTorch Geometric's own layers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from torch import Tensor, nn
from torch_geometric.data import Batch
from torch_geometric.nn import GraphConv, global_mean_pool

from .encodings import CHANNELS

WIDTHS = (64, 128, 256, 256, 256)  # of the blocks; paper, section 3.3.1, which names three


@dataclass(frozen=True, slots=True)
class GCNConfig:
    """What a network is built from.

    Parameters
    ----------
    encoding : str
        Preset of :mod:`encodings`.
    virtual_node : bool
        Whether every graph has one.
    blocks : int
        1 to 5; the paper has 3, 4 and 5.
    scale_free : bool
        Not the paper's: the mesh is centred and divided by s, the root of its area, Voronoi
        areas by their mean, and the outputs are logarithms of factors to Weyl's law. Scaling
        and translation are exact then.
    principal_axes : bool
        Not the paper's: the mesh is turned into its principal axes, so that the network need not
        learn what rotations leave as it is.
    head_width, outputs : int
        Hidden width of the head's five layers (the paper gives none), and eigenvalues.
    slope : float
        Of LeakyReLU below zero: PyTorch's default.

    Raises
    ------
    ValueError
        If an option is out of range.
    """

    encoding: str = "none"
    virtual_node: bool = False
    blocks: int = 3
    scale_free: bool = False
    principal_axes: bool = False
    head_width: int = 64
    outputs: int = 10
    slope: float = 0.01

    def __post_init__(self) -> None:
        if self.encoding not in CHANNELS:
            raise ValueError(
                f"the encoding must be one of {', '.join(CHANNELS)}, got {self.encoding!r}"
            )
        if not 1 <= self.blocks <= len(WIDTHS):
            raise ValueError(f"blocks must be 1 to {len(WIDTHS)}, got {self.blocks}")

    @property
    def channels(self) -> int:
        """Channels of a vertex at the input."""
        return CHANNELS[self.encoding]


class Block(nn.Module):
    """GraphConv, LeakyReLU, Linear."""

    def __init__(self, inputs: int, outputs: int, slope: float) -> None:
        super().__init__()
        self.conv = GraphConv(inputs, outputs)
        self.act = nn.LeakyReLU(slope)
        self.linear = nn.Linear(outputs, outputs)

    def forward(self, x: Tensor, edge_index: Tensor, edge_weight: Tensor | None) -> Tensor:
        """Map (n, inputs) to (n, outputs)."""
        mapped: Tensor = self.linear(self.act(self.conv(x, edge_index, edge_weight)))
        return mapped


class GCN(nn.Module):
    r"""Blocks of graph convolution, the mean over vertices, and a perceptron of five layers.

    A block maps :math:`x_i` to
    :math:`L\,\mathrm{LeakyReLU}(W_1 x_i + W_2 \sum_j w_{ij} x_j + b) + d`, with the edge weights
    w of encoding L, else 1. The mean includes a virtual node.

    References
    ----------
    Paper, section 3.3 and figure 4. Its formula is that of Kipf and Welling, its name
    (GraphConv) that of Morris et al., "Weisfeiler and Leman go neural", 2019: the latter here.
    """

    def __init__(self, config: GCNConfig) -> None:
        super().__init__()
        self.config = config
        widths = (config.channels, *WIDTHS[: config.blocks])
        self.blocks = nn.ModuleList(Block(i, o, config.slope) for i, o in pairwise(widths))
        sizes = (widths[-1], *[config.head_width] * 4, config.outputs)
        layers: list[nn.Module] = []
        for i, o in pairwise(sizes):
            layers += [nn.Linear(i, o), nn.LeakyReLU(config.slope)]
        self.head = nn.Sequential(*layers[:-1])

    def forward(self, batch: Batch) -> Tensor:
        """Return the outputs of a batch of encoded graphs, (B, outputs): the plain way.

        :func:`folded.outputs` computes the same several times faster.
        """
        x = batch.x
        for block in self.blocks:
            x = block(x, batch.edge_index, batch.get("edge_weight"))
        pooled = global_mean_pool(x, batch.batch, size=batch.num_graphs)
        answer: Tensor = self.head(pooled)
        return answer

    def parameter_count(self) -> int:
        """Return the number of trained numbers."""
        return sum(parameter.numel() for parameter in self.parameters())
