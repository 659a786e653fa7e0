"""What a dataset's name says: which kind it is of, and which version it was drawn from."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from importlib import resources

SCALED = re.compile(r"(?P<version>.+)-x(?P<scale>[0-9]+)")
SEALED = re.compile(r"(?P<version>.+)-sealed-[0-9a-f]{12}")


class Kind(Enum):
    """The four kinds of dataset, by what makes them."""

    VERSION = "version"  # its recipe ships with the package, or is one of your own
    SCALED = "scaled version"  # it has such a recipe, with many times the shapes
    SEALED = "sealed set"  # it has such a recipe, with a seed from a secret salt
    IMPORTED = "import"  # mesh files: there is no recipe


@dataclass(frozen=True, slots=True)
class Name:
    """A dataset's name, taken apart.

    Parameters
    ----------
    kind : Kind
        What the name says the dataset is. A name that is no version's can only be an import's.
    version : str
        The version that a scaled version or a sealed set was drawn from; else the name itself.
    scale : int
        How many times the version's shapes there are; 1 unless it is scaled.
    """

    kind: Kind
    version: str
    scale: int = 1


def parse_name(name: str) -> Name:
    """Take a dataset's name apart.

    Examples
    --------
    >>> scaled = parse_name("1.0-x100")
    >>> scaled.kind, scaled.version, scaled.scale
    (<Kind.SCALED: 'scaled version'>, '1.0', 100)
    >>> parse_name("1.0-mini-sealed-0123456789ab").version
    '1.0-mini'
    >>> [parse_name(name).kind.value for name in ("1.0-mini", "scans")]
    ['version', 'import']
    """
    if not isinstance(name, str):  # as version=1.0
        raise TypeError(f"a version is named by a string such as '1.0', got {name!r}")
    if scaled := SCALED.fullmatch(name):
        return Name(Kind.SCALED, scaled["version"], int(scaled["scale"]))
    if sealed := SEALED.fullmatch(name):
        return Name(Kind.SEALED, sealed["version"])
    return Name(Kind.VERSION if name in available() else Kind.IMPORTED, name)


def available() -> list[str]:
    """Return the versions that can be built.

    Examples
    --------
    >>> available()
    ['1.0', '1.0-mini', '1.0-small', '2.0', '2.0-mini', '2.1', '2.1-mini']
    """
    files = resources.files("synthnet.recipe.versions").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


def title(name: str) -> str:
    """Return what a dataset is called before readers: an import is none of ours.

    Examples
    --------
    >>> title("2.0"), title("1.0-x100"), title("scans"), title("mesh-x100")
    ('synthNet 2.0', 'synthNet 1.0-x100', 'scans', 'mesh-x100')
    """
    return f"synthNet {name}" if parse_name(name).version in available() else name
