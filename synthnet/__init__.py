"""synthNet: labelled triangle meshes for learning Laplace-Beltrami spectra.

Importing this package is cheap: Open3D, PyTorch and the rest are imported by
the functions that need them.
"""

from synthnet.errors import SynthNetError
from synthnet.hf import load_dataset
from synthnet.types import Mesh, Spectrum
from synthnet.version import __version__

__all__ = ["Mesh", "Spectrum", "SynthNetError", "__version__", "load_dataset"]
