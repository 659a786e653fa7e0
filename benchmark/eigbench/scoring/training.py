"""Names of training sets, ``VERSION/PROTOCOL``: what a trained predictor may have seen."""

from __future__ import annotations

import re
from collections.abc import Mapping

DEFAULT = "1.0/grouped"  # of a predictor that runs on meshes without a training split
IMPORTED = "imported"  # the protocol that holds nothing out: tested is an imported dataset


def training_set(version: str, protocol: str) -> str:
    """Return the name of a training set.

    Examples
    --------
    >>> training_set("2.0", "family/pretzel"), training_set("2.0", "imported/scans")
    ('2.0/family/pretzel', '2.0/grouped')
    """
    return f"{version}/{'grouped' if on_imports(protocol) else protocol}"  # nothing is held out


def on_imports(protocol: str) -> bool:
    """Return whether a protocol tests an imported dataset.

    Examples
    --------
    >>> on_imports("imported/scans"), on_imports("family/pretzel")
    (True, False)
    """
    return protocol.partition("/")[0] == IMPORTED


def protocols(version: str) -> list[str]:
    """Return the protocols of a version that a model is trained for, each of several by itself.

    Examples
    --------
    >>> names = protocols("2.0")
    >>> len(names), names[:5]
    (29, ['grouped', 'resolution', 'genus', 'boundary', 'family/cuboid'])
    """
    from synthnet import recipe  # a predictor's process needs the name above, and no families

    known = sorted((recipe.load(version).protocols or {}).values(), key=len)
    return ["grouped", *(fold.name for folds in known for fold in folds)]


def untrained(meta: Mapping[str, object]) -> bool:
    """Return whether a model says that nothing in it was fitted to labels.

    Examples
    --------
    >>> untrained({"kind": "classical"}), untrained({"kind": "learned", "training_data": "none"})
    (True, False)
    >>> untrained({"kind": "trivial", "training_data": "synthNet 2.0 train"})
    False
    """
    return meta.get("kind") != "learned" and meta.get("training_data", "none") == "none"


def may_be_trained_on(meta: Mapping[str, object], version: str) -> bool:
    """Return whether a model may be fitted to a version's labels, by what it says of its data.

    It may, unless it names versions, of any size, and this is none of them.

    Examples
    --------
    >>> may_be_trained_on({"training_data": "synthNet 1.0-small train, grouped"}, "2.0")
    False
    >>> may_be_trained_on({"training_data": "1.0-mini train"}, "2.0")
    False
    >>> may_be_trained_on({"training_data": "the training split, 2.5 h"}, "2.0-mini")
    True
    """
    from synthnet import recipe  # a predictor's process needs the name above, and no families

    words = re.findall(r"(?<![\w.-])\d+\.\d+(?![\d.])", str(meta.get("training_data", "")))
    named = set(words) & {name.partition("-")[0] for name in recipe.available()}
    return not named or version.partition("-")[0] in named
