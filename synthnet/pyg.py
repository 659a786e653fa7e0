"""synthNet as a PyTorch Geometric dataset: the door to :mod:`synthnet.loaders.pyg`."""

from synthnet.loaders.pyg import SynthNet

__all__ = ["SynthNet"]
