"""Names of targets, what the eigenvalues of a prediction are compared with, and of models.

A predictor's process imports them, and for that needs no dataset and no solver.
"""

import re
import unicodedata

SURFACE, MESH = "surface", "mesh"  # see :mod:`eigbench.scoring.targets`
TARGETS = (SURFACE, MESH)  # the headline comes first


def slug(name: str) -> str:
    """Return a model's name in lower-case letters, digits and hyphens, as its files have it.

    Examples
    --------
    >>> slug("Rayleigh-Ritz, degree 7"), slug("Poincaré")
    ('rayleigh-ritz-degree-7', 'poincare')
    """
    return re.sub(r"[^a-z0-9.]+", "-", _plain(name)).strip("-.")


def nameless(name: str) -> str:
    """Return what a model's name has so that no file can have it; empty if one can.

    That is a letter or a digit which :func:`slug` would leave out.

    Examples
    --------
    >>> nameless("Poincaré, ℓ²"), nameless("Fit of λ")[:23], nameless("?!")[:22]
    ('', 'the letter λ (U+03BB): ', 'no letter and no digit')
    """
    for letter in name:
        if any(part.isalnum() and not part.isascii() for part in _plain(letter)):
            return (
                f"the letter {letter} (U+{ord(letter):04X}): a row's files have its name in a to z "
                "and digits, so spell it in these; accents may stay"
            )
    return "" if slug(name) else "no letter and no digit, and a row's files have its name: add one"


def _plain(name: str) -> str:
    """Return a name in lower-case letters without accents."""
    parts = unicodedata.normalize("NFKD", name)
    return "".join(part for part in parts if not unicodedata.combining(part)).lower()
