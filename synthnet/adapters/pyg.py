"""Spectra as a transform of PyTorch Geometric."""

from synthnet.errors import needed_by
from synthnet.spectrum import compute

with needed_by("synthnet.adapters.pyg"):
    import torch
    from torch_geometric.data import Data
    from torch_geometric.transforms import BaseTransform


class AddMeshSpectrum(BaseTransform):  # type: ignore[misc]
    """Add the mesh's certified eigenvalues, and eigenvectors if wanted, to a ``Data``.

    ``data.eigenvalues``, of shape (1, k) so that batches have one row per mesh, in 1/length², after
    the zeros, ascending; ``data.eigenvectors``, of shape (n, k), orthonormal in the mass matrix.
    Both have the dtype and the device of ``data.pos``, and PyTorch's default dtype where that is of
    whole numbers; they are computed in float64 on the CPU, Neumann on a boundary.

    Parameters
    ----------
    k : int
        Number of eigenvalues.
    eigenvectors : bool
        Add eigenvectors too.
    repair : bool
        Add the eigenvalues of the repaired mesh, see :func:`synthnet.spectrum.compute`. ``pos`` and
        ``face`` stay as they are, so that there can be no eigenvectors.

    Raises
    ------
    ValueError
        If eigenvectors are to be those of a repaired mesh.
    ValueError, Refused, CertificateError, SpectrumError
        When it is called on a mesh, see :func:`synthnet.spectrum.compute`.
    """

    def __init__(self, k: int = 10, *, eigenvectors: bool = False, repair: bool = False) -> None:
        if eigenvectors and repair:
            raise ValueError(
                "eigenvectors of a repaired mesh are not at the vertices of the data: repair it "
                "first, spectrum.compute(data, repair=True).mesh"
            )
        self.repair = repair
        self.k = k
        self.eigenvectors = eigenvectors

    def forward(self, data: Data) -> Data:
        """Return the data with its spectrum."""
        spectrum = compute(data, self.k, repair=self.repair)
        dtype = data.pos.dtype if data.pos.is_floating_point() else torch.get_default_dtype()
        like = {"dtype": dtype, "device": data.pos.device}
        data.eigenvalues = torch.as_tensor(spectrum.eigenvalues[None], **like)
        if self.eigenvectors:
            data.eigenvectors = torch.as_tensor(spectrum.eigenvectors, **like)
        return data

    def __repr__(self) -> str:
        options = f"eigenvectors={self.eigenvectors}" + ", repair=True" * self.repair
        return f"AddMeshSpectrum({self.k}, {options})"
