"""What is unpacked from a dataset's shards into a folder of its own: its table of contents.

``<home>/<version>/processed/<key>/digests.json`` is written last, or for Hugging Face datasets
``datasets-cache/<split>/digests.json``. It names every file of the folder with its size and
SHA-256, and the shards that they were unpacked from; it ends with its own SHA-256. When the folder
is opened, all sizes and most digests are checked. The files that hold most bytes have digests by
the item in one of the others, and :func:`problems` reads every byte.
"""

import hashlib
import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from synthnet import recipe
from synthnet.errors import DamagedError
from synthnet.store import files, storage
from synthnet.store.datasets import StoredDataset
from synthnet.store.files import one_line
from synthnet.store.manifest import with_digest, without_digest

CONTENTS = "digests.json"
FOLDER, HUGGING_FACE = FOLDERS = ("processed", "datasets-cache")  # of a dataset's directory
PYG = "PyTorch Geometric"
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")  # of a file in the folder itself

Opened = TypeVar("Opened")


def folder(dataset: StoredDataset) -> Path:
    """Return the folder beside a dataset's shards that holds what is unpacked of them."""
    return storage.local(dataset.directory, dataset.manifest.version) / FOLDER


def source(dataset: StoredDataset) -> str:
    """Return a hash of the shards that are unpacked: a rebuilt one may have other last digits."""
    shards = [(shard.file, shard.sha256) for shard in dataset.manifest.shards]
    return hashlib.sha256(json.dumps(shards).encode()).hexdigest()


def write_contents(directory: Path, dataset: StoredDataset, by_item: tuple[str, ...]) -> None:
    """Write the table of contents of a folder that holds files alone.

    Files whose names end in one of ``by_item`` are checked by the item, when that is read.
    """
    listed = {
        path.name: {
            "size": path.stat().st_size,
            "sha256": files.sha256(path),
            "by_item": path.name.endswith(by_item),
        }
        for path in sorted(directory.iterdir())
    }
    content = {"source": source(dataset), "files": listed}
    (directory / CONTENTS).write_text(with_digest(content), encoding="utf-8")


def check(directory: Path, dataset: StoredDataset) -> None:
    """Check sizes, and the digests of all files that are not checked by the item.

    Raises
    ------
    FileNotFoundError
        If nothing is unpacked there.
    DamagedError
        If something is missing, truncated or altered, or was unpacked from other shards.
    """
    content = _read(directory)
    if content["source"] != source(dataset):
        raise DamagedError(f"{directory} was unpacked from other shards")
    for problem in _differences(directory, content["files"], wholly=False):
        raise DamagedError(f"{directory / problem}")


def problems(directory: Path) -> Iterator[str]:
    """Yield what is missing, truncated or altered in a folder, every byte of it read."""
    try:
        content = _read(directory)
    except DamagedError as error:
        yield str(error)
        return
    for problem in _differences(directory, content["files"], wholly=True):
        yield f"{directory / problem}"


def open_or_unpack(
    directory: Path,
    dataset: StoredDataset,
    read: Callable[[], Opened],
    fill: Callable[[Path], None],
    *,
    by_item: tuple[str, ...],
    reader: str,
    wholly: bool = False,
) -> Opened:
    """Return what ``read`` opens; where it is missing or damaged, let ``fill`` unpack it first.

    Parameters
    ----------
    directory : Path
        Where it is.
    dataset : StoredDataset
        What it is unpacked from.
    read : callable
        Opens it. Raises :class:`DamagedError` where it finds something wrong.
    fill : callable
        Fills the directory it is given with files.
    by_item : tuple of str
        Ends of the names of files that ``read`` checks by the item.
    reader : str
        The library it is unpacked for.
    wholly : bool
        Whether to read every byte first, after an item was found to be damaged.

    Raises
    ------
    DamagedError
        If what was just unpacked is damaged.
    BuildError
        If it cannot be unpacked.
    """

    def opened() -> Opened:
        check(directory, dataset)
        for problem in problems(directory) if wholly else ():
            raise DamagedError(problem)
        return read()

    def is_whole() -> bool:
        try:
            opened()
        except (FileNotFoundError, DamagedError):
            return False
        return True

    def fill_and_list(to: Path) -> None:
        fill(to)
        write_contents(to, dataset, by_item)

    title = recipe.title(dataset.manifest.version)
    try:
        return opened()
    except FileNotFoundError:
        what = f"Unpacking {title}"
    except DamagedError as error:
        what = f"{error}: unpacking {title} anew"
    sys.stderr.write(f"{what} for {reader}\n")
    files.make_in_place(directory, is_whole, fill_and_list)
    check(directory, dataset)
    return read()


def _read(directory: Path) -> dict[str, Any]:
    path = directory / CONTENTS
    try:
        content, whole = without_digest(path.read_bytes())
        if not whole:
            raise ValueError("its bytes are not those of its content")  # noqa: TRY301 - as the others
        for name, file in content["files"].items():
            if not NAME.fullmatch(name) or file.keys() != {"size", "sha256", "by_item"}:
                raise ValueError(f"{name!r} is no entry of a file")  # noqa: TRY301
        return {"source": content["source"], "files": content["files"]}
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise DamagedError(f"{path} is damaged ({one_line(error)})") from error


def _differences(directory: Path, listed: dict[str, Any], *, wholly: bool) -> Iterator[str]:
    """Yield the files that differ, those that are checked by the item by their size alone."""
    for name, file in listed.items():
        path = directory / name
        if not path.is_file():
            yield f"{name} is missing"
        elif (size := path.stat().st_size) != file["size"]:
            yield f"{name} is damaged (it has {size:,} bytes instead of {file['size']:,})"
        elif (wholly or not file["by_item"]) and files.sha256(path) != file["sha256"]:
            yield f"{name} is damaged (its SHA-256 is another)"
