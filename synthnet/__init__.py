"""synthNet: labelled triangle meshes for learning Laplace-Beltrami spectra.

Importing this package is cheap: everything is imported by what needs it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from synthnet.version import __version__

if TYPE_CHECKING:
    from synthnet.errors import SynthNetError
    from synthnet.hf import load_dataset
    from synthnet.types import Mesh, Spectrum

__all__ = ["Mesh", "Spectrum", "SynthNetError", "__version__", "load_dataset"]

_HOMES = {
    "Mesh": "synthnet.types",
    "Spectrum": "synthnet.types",
    "SynthNetError": "synthnet.errors",
    "load_dataset": "synthnet.hf",
}


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'synthnet' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
