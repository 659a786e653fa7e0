"""synthNet: labelled triangle meshes for learning Laplace-Beltrami spectra.

Importing this package is cheap: everything is imported by what needs it.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from synthnet.version import __version__

if TYPE_CHECKING:
    from synthnet.errors import SynthNetError
    from synthnet.loaders.hf import load_dataset
    from synthnet.loaders.pyg import SynthNet
    from synthnet.types import Mesh, Spectrum

__all__ = ["Mesh", "Spectrum", "SynthNet", "SynthNetError", "__version__", "load_dataset"]

_HOMES = {
    "Mesh": "synthnet.types",
    "Spectrum": "synthnet.types",
    "SynthNet": "synthnet.loaders.pyg",
    "SynthNetError": "synthnet.errors",
    "load_dataset": "synthnet.loaders.hf",
}


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'synthnet' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def _picture(shown: Any) -> bytes | None:
    """Return what a notebook shows; nothing without Matplotlib, so that it shows the text."""
    from synthnet.errors import MissingPackageError

    try:
        from synthnet.pictures.draw import notebook_picture
    except MissingPackageError:
        return None
    return notebook_picture(shown)


def _show_pictures_in_notebooks() -> None:
    """Register pictures of meshes and samples with a running notebook, which draws them on show."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        png = shell.display_formatter.formatters["image/png"]
        for name in ("Mesh", "Sample"):
            png.for_type_by_name("synthnet.types", name, _picture)


_show_pictures_in_notebooks()
