"""Eigenvalues in PyTorch: the door to :mod:`synthnet.loaders.gradients`."""

from synthnet.loaders.gradients import eigenvalues

__all__ = ["eigenvalues"]
