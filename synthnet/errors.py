"""Errors a user can act on.

Each message is one line that says what was wrong, where, and what to do next.
The command line prints it and exits with code 2.
"""

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

# Packages that an installation may lack, by the name that is imported: the package's own
# name, and the extra of this project that brings it.
OPTIONAL = {
    "cholespy": ("cholespy", "cholmod"),
    "datasets": ("datasets", "datasets"),
    "distributed": ("distributed", "dask"),
    "lapy": ("LaPy", "verify"),
    "matplotlib": ("Matplotlib", "pictures"),
    "mpi4py": ("mpi4py", "mpi"),
    "nibabel": ("NiBabel", "brain"),
    "open3d": ("Open3D", "build"),
    "robust_laplacian": ("robust_laplacian", "robust"),
    "s3fs": ("s3fs", "s3"),
    "safetensors": ("safetensors", "baselines"),
    "sklearn": ("scikit-learn", "baselines"),
    "torch": ("PyTorch", "torch"),
    "torch_geometric": ("PyTorch Geometric", "torch"),
}


class SynthNetError(Exception):
    """Base of all errors raised on purpose by this package."""


class RecipeError(SynthNetError):
    """A recipe (``versions/*.toml``) is unknown, malformed or contradicts itself."""


class StoreError(SynthNetError):
    """A dataset on disk is missing, is damaged or comes from another recipe."""


class DamagedError(StoreError):
    """A file of a dataset is missing, truncated or altered."""


class BuildError(SynthNetError):
    """A build had to stop; the shards it had finished are kept."""


class MeshImportError(SynthNetError):
    """There is nothing to import, or the dataset's name is not allowed."""


class SealError(SynthNetError):
    """A seal file or a salt is missing, is malformed, or belongs to another set."""


class MissingPackageError(SynthNetError, ImportError):
    """An optional package is needed, and it is not installed or cannot be imported."""


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a question to add to a message on an unknown word: which known one was meant.

    Examples
    --------
    >>> suggestion("1.0-mni", ["1.0", "1.0-mini"]), suggestion("frobnicate", ["build"])
    ('; did you mean 1.0-mini?', '')
    """
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""


def missing(path: Path) -> str:
    """Return that there is no such file, and which one beside it may have been meant."""
    try:
        hidden = path.name.startswith(".")
        names = [o.name for o in path.parent.iterdir() if o.name.startswith(".") == hidden]
    except OSError:  # nor is the directory there, or it may not be read
        names = []
    if path.name in names:
        return f"{path} is a link to a file that is not there"
    return f"there is no file {path}{suggestion(path.name, map(printable, names))}"


def printable(name: str) -> str:
    r"""Return a file's name with what cannot be printed or encoded escaped.

    Examples
    --------
    >>> printable("a\nb\udcff.obj")
    'a\\nb\\udcff.obj'
    """
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in name)


def install(module: str) -> str:
    """Return the command that installs the package of a module.

    Examples
    --------
    >>> install("open3d")
    "pip install 'synthnet[build]'"
    >>> install("no_such_thing")  # its package may have any name
    'pip install it'
    """
    return (
        f"pip install 'synthnet[{OPTIONAL[module][1]}]'" if module in OPTIONAL else "pip install it"
    )


@contextmanager
def needed_by(what: str) -> Iterator[None]:
    """Import optional packages in this block; a missing one is one line that names its extra.

    Raises
    ------
    MissingPackageError
        If a package of :data:`OPTIONAL` is not installed, or is installed and cannot be
        imported, such as for want of a library of the system.

    Examples
    --------
    >>> with needed_by("building shapes"):
    ...     raise ModuleNotFoundError(name="open3d")
    Traceback (most recent call last):
    synthnet.errors.MissingPackageError: building shapes needs Open3D: pip install 'synthnet[build]'
    """
    try:
        yield
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        if package not in OPTIONAL:
            raise  # a MissingPackageError of an inner block has no name, and passes here
        name = OPTIONAL[package][0]
        if isinstance(error, ModuleNotFoundError):
            raise MissingPackageError(f"{what} needs {name}: {install(package)}") from error
        reason = " ".join(str(error).split())
        raise MissingPackageError(
            f"{what} needs {name}, which is installed and cannot be imported: {reason}"
        ) from error


class SpectrumError(SynthNetError):
    """The eigenvalue solver returned no answer for a mesh."""


class CertificateError(SpectrumError):
    """Eigenvalues were computed, but they are not proved to be complete."""


def counted(count: int, noun: str, plural: str = "") -> str:
    """Return a count with its noun.

    Examples
    --------
    >>> counted(1, "shard"), counted(1200, "mesh", "meshes")
    ('1 shard', '1,200 meshes')
    """
    return f"{count:,} {noun if count == 1 else plural or f'{noun}s'}"
