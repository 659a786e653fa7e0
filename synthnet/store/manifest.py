"""The manifest: a dataset's table of contents, the last file that a build writes."""

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

from synthnet.errors import StoreError
from synthnet.store.files import one_line
from synthnet.store.shards import SCHEMA_VERSION, damaged
from synthnet.store.storage import Location, write_text
from synthnet.types import Manifest, Rejection, ShardRecord

MANIFEST = "manifest.json"
DIGEST = "sha256"  # the key of a JSON file's own digest
SHA256 = re.compile(r"[0-9a-f]{64}")
NAME = re.compile(r"[^/\0]+")  # of a dataset or a family: it becomes part of paths


def write_manifest(directory: Location, manifest: Manifest) -> None:
    """Write the manifest, the mark of a finished dataset."""
    content = {"schema_version": SCHEMA_VERSION, **asdict(manifest)}
    write_text(directory / MANIFEST, with_digest(content))


def with_digest(content: dict[str, Any]) -> str:
    """Return content as JSON text; its last key is the SHA-256 of the other ones.

    So no byte of the text can be altered without a trace.
    """
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    return json.dumps({**content, DIGEST: digest}, indent=1) + "\n"


def without_digest(text: bytes) -> tuple[dict[str, Any], bool]:
    """Return the content of what :func:`with_digest` wrote, and whether no byte was altered."""
    content = json.loads(text)
    content.pop(DIGEST, None)
    return content, with_digest(content).encode() == text


def read_manifest(directory: Location) -> Manifest | None:
    """Read the manifest, or return ``None`` where no build has finished.

    Raise StoreError if it is not JSON, lacks a key, has another schema version, or was altered.
    """
    path = directory / MANIFEST
    if isinstance(path, Path) and path.exists() and not (path.is_file() or path.is_dir()):
        raise damaged(path, "it is no file")
    try:
        content, whole = without_digest(path.read_bytes())
        schema = content.pop("schema_version")
        if schema != SCHEMA_VERSION:
            raise StoreError(
                f"{path} has schema version {schema}, this synthnet reads {SCHEMA_VERSION}: "
                "remove its directory or choose another --out, and build it again"
            )
        shards = tuple(
            ShardRecord(**{**s, "rejections": tuple(Rejection(**r) for r in s["rejections"])})
            for s in content.pop("shards")
        )
        manifest = Manifest(**content, shards=shards)
        _check(manifest)
        if not whole:
            raise ValueError("its bytes are not those of its content")  # noqa: TRY301 - as the others
        return manifest  # noqa: TRY300 - all of it may raise
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise StoreError(f"cannot read {path} ({error.strerror}): choose another --out") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise damaged(path, one_line(error)) from error


def _check(manifest: Manifest) -> None:
    """Raise TypeError or ValueError where a value of the manifest is not what it must be."""
    shards = manifest.shards
    rejections = [rejection for shard in shards for rejection in shard.rejections]
    kinds: list[tuple[type, Iterable[Any]]] = [
        (dict, (manifest.recipe, manifest.drawn, manifest.packages)),
        (str, (manifest.version, *manifest.packages.values())),
        (str, (text for shard in shards for text in (shard.file, shard.family))),
        (str, (text for rejection in rejections for text in asdict(rejection).values())),
    ]
    for kind, values in kinds:
        for value in values:
            if type(value) is not kind:
                raise TypeError(f"{value!r} is no {kind.__name__}")
    counts = [(s.size, s.rows, s.vertices, s.faces) for s in shards]
    for count in chain(manifest.drawn.values(), *counts):
        if type(count) is not int or count < 0:
            raise TypeError(f"{count!r} is no number of something")
    for digest in (manifest.recipe_digest, *(shard.sha256 for shard in shards)):
        if type(digest) is not str or not SHA256.fullmatch(digest):
            raise ValueError(f"{digest!r} is no SHA-256")
    for name in (manifest.version, *manifest.drawn):
        if not NAME.fullmatch(name) or name in (".", ".."):
            raise ValueError(f"{name!r} is no name")
    for shard in shards:
        if shard.family not in manifest.drawn:
            raise ValueError("a shard is of a family that was not drawn")
        # The family is a name, so that no file lies elsewhere.
        if not re.fullmatch(rf"shards/{re.escape(shard.family)}-\d{{4,}}\.parquet", shard.file):
            raise ValueError(f"{shard.file!r} is no file of a shard of {shard.family}")
