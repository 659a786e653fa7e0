"""The description of an import, which its manifest holds where a version's has its recipe."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from synthnet.errors import DamagedError, StoreError
from synthnet.types import Manifest

IMPORTED = "imported"  # the key that marks a manifest's recipe as a description


@dataclass(frozen=True, slots=True)
class ImportDescription:
    """All that the shards of an import depend on.

    Parameters
    ----------
    options : mapping
        How files become shapes, see :class:`synthnet.build.surfaces.Settings`.
    limits : str
        The version whose limits the labels keep.
    rules : int
        The version of the rules of reading and repair.
    files : mapping of str to mapping
        By id the name of each file, its SHA-256 and, if it was not read at all, why.
    """

    options: Mapping[str, Any]
    limits: str
    rules: int
    files: Mapping[str, Mapping[str, Any]]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready data, as it stands in the manifest."""
        return {
            IMPORTED: dict(self.options),
            "limits": self.limits,
            "rules": self.rules,
            "files": {id: dict(file) for id, file in self.files.items()},
        }

    @property
    def digest(self) -> str:
        """SHA-256 of the description as JSON."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()

    def differences(self, now: ImportDescription) -> list[str]:
        """Say in what another import differs from this one."""
        options = [
            f"other --{name.replace('_', '-')}"
            for name in sorted(self.options.keys() | now.options.keys())
            if self.options.get(name) != now.options.get(name)
        ]
        rules = [
            f"other {name}"
            for name in ("limits", "rules")
            if getattr(self, name) != getattr(now, name)
        ]
        return [*options, *rules, *self._other_files(now)] or ["other names of files"]

    def _other_files(self, now: ImportDescription) -> Iterator[str]:
        old, new = (
            {f"{id.rpartition('-')[0]}/{file['file']}": file for id, file in files.items()}
            for files in (self.files, now.files)
        )
        for word, names in (
            ("new", new.keys() - old.keys()),
            ("missing", old.keys() - new.keys()),
            ("changed", {name for name in new.keys() & old.keys() if new[name] != old[name]}),
        ):
            if names:
                such_as = "" if len(names) == 1 else "such as "
                yield f"{len(names):,} {word}: {such_as}{min(names)}"


def description_of(manifest: Manifest) -> ImportDescription:
    """Read the description in an import's manifest.

    Raises
    ------
    StoreError
        If the manifest lacks a part of it, as those before synthnet 0.1 did.
    DamagedError
        If a part is not what an import writes.
    """
    stored = dict(manifest.recipe)
    try:
        description = ImportDescription(
            stored.pop(IMPORTED), stored.pop("limits"), stored.pop("rules"), stored.pop("files")
        )
    except KeyError as error:
        raise StoreError(
            f"{manifest.version} was imported by an older synthnet: remove it and import again"
        ) from error
    if stored:
        raise StoreError(
            f"{manifest.version} was imported by a newer synthnet ({', '.join(sorted(stored))}): "
            "install a matching release"
        )
    if not _is_whole(description):
        raise DamagedError(
            f"the manifest of {manifest.version} does not say how each of its files was imported: "
            "remove it and import again"
        )
    return description


def _is_whole(description: ImportDescription) -> bool:
    """Return whether the parts of a description that was read are of their types."""
    options, files = description.options, description.files
    return (
        isinstance(options, dict)
        and isinstance(options.get("split"), str)
        and isinstance(description.limits, str)
        and isinstance(description.rules, int)
        and isinstance(files, dict)
        and all(
            isinstance(file, dict)
            and isinstance(file.get("file"), str)
            and isinstance(file.get("sha256"), str)
            for file in files.values()
        )
    )
