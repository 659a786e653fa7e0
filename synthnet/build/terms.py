"""The terms of a build: what a worker, on whatever machine, must have in common with it."""

import functools
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from platform import python_version

import numpy
import scipy.linalg  # noqa: F401 - or its BLAS may not be loaded yet
import threadpoolctl

from synthnet.errors import BuildError
from synthnet.kernels import processor
from synthnet.recipe import Recipe
from synthnet.store.storage import Location
from synthnet.version import __version__

PACKAGES = ("synthnet", "numpy", "scipy", "numba", "open3d", "open3d-cpu", "trimesh", "pyarrow")
SHARDS = "shards"
SHARED = "--out must be a directory that all machines share, or a URL"


@dataclass(frozen=True, slots=True)
class Terms:
    """What all jobs of a task have in common, and a worker must agree with."""

    recipe: Recipe  # that makes the shapes, or whose limits their labels must keep
    digest: str  # the recipe's, as this process computed it
    packages: Mapping[str, str]  # the versions this process has
    processor: str  # its kind: the last digits of a label depend on it
    blas: str  # the kernels of NumPy and SciPy: the last digits depend on these, too
    directory: Location  # where the dataset is to be


def agree(terms: Terms) -> None:
    """Raise BuildError unless this worker does what the process that set the terms would."""
    here, host = _packages(), socket.gethostname()
    for name in sorted({*here, *terms.packages}):
        installed, expected = here.get(name), terms.packages.get(name)
        if installed != expected:
            raise BuildError(
                f"the worker on {host} has {name} {installed or 'missing'}, the build has "
                f"{expected or 'none'}: install the same versions there (constraints.txt)"
            )
    if processor() != terms.processor:
        raise BuildError(
            f"the worker on {host} has a processor of another kind ({processor()}) than the "
            f"build ({terms.processor}): their labels would differ in the last digits, so "
            "take machines of one kind"
        )
    if blas_kernels() != terms.blas:
        raise BuildError(
            f"the worker on {host} computes with other BLAS kernels ({blas_kernels()}) than the "
            f"build ({terms.blas}): their labels would differ in the last digits, so set the same "
            "OPENBLAS_CORETYPE for all"
        )
    if terms.recipe.digest != terms.digest:
        raise BuildError(
            f"the worker on {host} understands another recipe than the build: "
            "install the same synthnet there"
        )
    shards = terms.directory / SHARDS
    if isinstance(shards, Path) and not shards.is_dir():
        raise BuildError(f"the worker on {host} does not see {shards}: {SHARED}")


def terms_of(recipe: Recipe, directory: Location) -> Terms:
    """Return what this process holds its workers to."""
    return Terms(recipe, recipe.digest, _packages(), processor(), blas_kernels(), directory)


@functools.cache
def blas_kernels() -> str:
    """Return the libraries of linear algebra that NumPy and SciPy load, with their kernels.

    OpenBLAS chooses its kernels when it is loaded, by the processor or ``$OPENBLAS_CORETYPE``.
    """
    kernels = {
        " ".join(
            str(library[key])
            for key in ("internal_api", "version", "architecture")
            if library.get(key)
        )
        for library in threadpoolctl.threadpool_info()
        if library["user_api"] == "blas" and is_ours(Path(library["filepath"]))
    }
    return ", ".join(sorted(kernels))


def is_ours(library: Path) -> bool:
    """Return whether a library came with NumPy or SciPy, or is the environment's for all.

    Those that PyTorch and others bring for themselves are loaded in some processes only.
    """
    packages = Path(numpy.__file__).parent.parent
    if not library.is_relative_to(packages):
        return True
    return library.relative_to(packages).parts[0] in ("numpy.libs", "scipy.libs")


@functools.cache
def _packages() -> dict[str, str]:
    """Return the versions of the packages that the data depend on."""
    versions = {}
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):  # open3d comes under one of two names
            versions[name] = metadata.version(name)
    return {**versions, "synthnet": __version__}


def made_with() -> dict[str, str]:
    """Return the versions of Python and the packages, for a manifest."""
    return {"python": python_version(), **_packages()}
