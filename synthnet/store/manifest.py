"""The manifest: a dataset's table of contents, the last file that a build writes."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

from synthnet.errors import DamagedError, StoreError
from synthnet.store.files import one_line
from synthnet.store.shards import AGAIN, SCHEMA_VERSION
from synthnet.store.storage import Location, write_text
from synthnet.types import Manifest, Rejection, ShardRecord

MANIFEST = "manifest.json"
DIGEST = "sha256"  # the key of a JSON file's own digest


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


def read_manifest(directory: Location) -> Manifest | None:
    """Read the manifest, or return ``None`` where no build has finished.

    Raises
    ------
    StoreError
        If it is not JSON, lacks a key, has another schema version, or was altered.
    """
    path = directory / MANIFEST
    try:
        written = path.read_bytes()
        content = json.loads(written)
        content.pop(DIGEST, None)
        expected = with_digest(content)
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
        _check_types(manifest)
        if written != expected.encode():
            raise ValueError("its bytes are not those of its content")  # noqa: TRY301 - as the others
        return manifest  # noqa: TRY300 - all of it may raise
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise StoreError(f"cannot read {path} ({error.strerror}): choose another --out") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DamagedError(
            f"{path} is damaged ({one_line(error)}): remove it and {AGAIN}"
        ) from error


def _check_types(manifest: Manifest) -> None:
    """Raise TypeError where a value of the manifest is of the wrong kind."""
    values: list[tuple[Any, type]] = [
        (manifest.version, str),
        (manifest.recipe_digest, str),
        (manifest.recipe, dict),
        (manifest.drawn, dict),
        (manifest.packages, dict),
        *((count, int) for count in manifest.drawn.values()),
    ]
    for shard in manifest.shards:
        values += [(getattr(shard, name), str) for name in ("file", "family", "sha256")]
        values += [(getattr(shard, name), int) for name in ("size", "rows", "vertices", "faces")]
    for value, kind in values:
        if type(value) is not kind:
            raise TypeError(f"{value!r} is no {kind.__name__}")
    if {shard.family for shard in manifest.shards} - set(manifest.drawn):
        raise ValueError("a shard is of a family that was not drawn")
