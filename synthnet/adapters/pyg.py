"""Spectra as a transform of PyTorch Geometric."""

from __future__ import annotations

from synthnet.errors import needed_by
from synthnet.spectrum import compute

with needed_by("synthnet.adapters.pyg"):
    import torch
    from torch_geometric.data import Data
    from torch_geometric.transforms import BaseTransform


class AddMeshSpectrum(BaseTransform):  # type: ignore[misc]
    """Add the mesh's certified eigenvalues, and eigenvectors if wanted, to a ``Data``.

    ``data.eigenvalues``, of shape (1, k) so that a batch has a row a mesh, in 1/length², after the
    zeros, ascending; ``data.eigenvectors``, of shape (n, k), orthonormal in the mass matrix. Both
    have the dtype and the device of ``data.pos``; they are computed in float64 on the CPU, Neumann
    on a boundary.

    Parameters
    ----------
    k : int
        Number of eigenvalues.
    eigenvectors : bool
        Add eigenvectors too.

    Raises
    ------
    ValueError, CertificateError, SpectrumError
        When it is called on a mesh, see :func:`synthnet.spectrum.compute`.
    """

    def __init__(self, k: int = 10, *, eigenvectors: bool = False) -> None:
        self.k = k
        self.eigenvectors = eigenvectors

    def forward(self, data: Data) -> Data:
        """Return the data with its spectrum."""
        found = compute(data, self.k)
        like = {"dtype": data.pos.dtype, "device": data.pos.device}
        data.eigenvalues = torch.as_tensor(found.eigenvalues[None], **like)
        if self.eigenvectors:
            data.eigenvectors = torch.as_tensor(found.eigenvectors, **like)
        return data

    def __repr__(self) -> str:
        """Return the call that makes it."""
        return f"AddMeshSpectrum({self.k}, eigenvectors={self.eigenvectors})"
