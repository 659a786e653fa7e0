"""Files that others hand in: opened, bounded and checked before anything is made of them.

A path is opened name by name and no symbolic link is followed, so a file that is handed in cannot
stand for another one of this machine. What is no regular file, or is larger than it may be, is
refused before it is read. :mod:`eigbench.results.outside_tables` reads tables of such files.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import stat
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any

from eigbench.errors import OutsideError

MOST_JSON = 4 * 2**20  # bytes; the largest result so far has 42 KB
MOST_TEXT = 64 * 2**10  # bytes of a text that people write
DEPTH = 32  # of JSON in JSON; a result has 6
VALUES = 50_000  # keys and values of a JSON file; a result has 3,000
DIGITS = 40  # of a number; float64 needs 24 with sign and exponent
LONGEST = 4096  # characters of a text in JSON
# Characters that are printable to Python and leave nothing on a page: Unicode's default-ignorable
# ones (DerivedCoreProperties), and blank signs
INVISIBLE = frozenset(
    (
        *(0x034F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x2800, 0x3164, 0xFFA0, 0x16FE4, 0x1D159),
        *range(0x180B, 0x1810),
        *range(0xFE00, 0xFE10),
        *range(0xE0100, 0xE01F0),
    )
)
# First words of the Unicode names of letters that look like those of the others
ALIKE = ("LATIN", "GREEK", "CYRILLIC", "ARMENIAN", "COPTIC", "CHEROKEE", "LISU")


@contextmanager
def opened(path: Path, *, most: int, below: Path | None = None) -> Iterator[BufferedReader]:
    """Open a regular file of at most ``most`` bytes; no symbolic link is followed.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Bytes.
    below : Path, optional
        A folder above it: no name on the way from there may be a link. By default the file's own
        folder, so that only the file itself may be none.

    Raises
    ------
    FileNotFoundError
        If nothing is there.
    OutsideError
        If it is no regular file, too large, not below the folder, reached by a link or cannot be
        read.
    """
    folder = path.parent if below is None else below
    whole, above = path.absolute(), folder.absolute()
    names = whole.relative_to(above).parts if whole.is_relative_to(above) else ()
    if not names or ".." in names:
        raise OutsideError(f"{path} is not below {folder}")
    try:
        descriptor = _descend(folder, names)
    except FileNotFoundError:
        raise
    except OSError as error:
        if error.errno == errno.ELOOP or _by_link(whole, names):
            raise OutsideError(
                f"{path} is reached by a symbolic link: put the file itself there"
            ) from error
        raise OutsideError(f"{path} cannot be read: {error.strerror}") from error
    facts = os.fstat(descriptor)
    if not stat.S_ISREG(facts.st_mode):
        os.close(descriptor)
        raise OutsideError(f"{path} is no regular file")
    with os.fdopen(descriptor, "rb") as file:
        if facts.st_size > most:
            raise OutsideError(f"{path} has {facts.st_size:,} bytes, at most {most:,} are read")
        yield file


def _descend(folder: Path, names: Sequence[str]) -> int:
    """Return the descriptor of what is below a folder, opened name by name."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    # Not to wait for who writes into a pipe, and not to be given a terminal
    last = os.O_NONBLOCK | os.O_NOCTTY
    for how, name in zip([os.O_DIRECTORY] * (len(names) - 1) + [last], names, strict=True):
        above = descriptor
        try:
            descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | how, dir_fd=above)
        finally:
            os.close(above)
    return descriptor


def _by_link(path: Path, names: Sequence[str]) -> bool:
    """Whether a name on the way to a file is a link; only the message depends on it."""
    parts = [path, *path.parents][: len(names)]
    return any(os.path.islink(part) for part in parts)  # noqa: PTH114  # a name may be too long


def read(path: Path, *, most: int, below: Path | None = None) -> bytes:
    """Return the bytes of a file, as :func:`opened` opens it."""
    with opened(path, most=most, below=below) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OutsideError(f"{path} grows while it is read, past {most:,} bytes")
    return content


def sha256(path: Path, *, most: int, below: Path | None = None) -> str:
    """Return the SHA-256 of a file as hexadecimal digits, as :func:`opened` opens it."""
    with opened(path, most=most, below=below) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_way(path: Path, below: Path) -> None:
    """Check that what is written or removed at a path stays below a folder.

    Raises
    ------
    OutsideError
        If a folder on the way there is a symbolic link, or the path is not below the folder.
    """
    if not path.is_relative_to(below) or ".." in path.relative_to(below).parts:
        raise OutsideError(f"{path} is not below {below}")
    for part in path.parents:
        if part == below:
            return
        if part.is_symlink():
            raise OutsideError(f"{part} is a symbolic link: put a folder there, or remove it")


def read_json(path: Path, *, below: Path | None = None) -> Any:
    """Return what a file of JSON holds, as :func:`parsed` reads it."""
    content = read(path, most=MOST_JSON, below=below)
    try:
        return parsed(content)
    except OutsideError as error:
        raise OutsideError(f"{path} cannot be read: {error}") from error


def read_line(path: Path, *, below: Path | None = None) -> str:
    """Return a text on one line: its words, a space between them."""
    content = read(path, most=MOST_TEXT, below=below)
    try:
        text = " ".join(content.decode("utf-8").split())
    except UnicodeDecodeError as error:
        raise OutsideError(f"{path} is not UTF-8 text: save it as that") from error
    if problem := strange(text):
        raise OutsideError(f"{path} has {problem}")
    return text


def parsed(content: bytes) -> Any:
    """Return JSON: every number finite, every text printable, no key twice, not too deep.

    Raises
    ------
    OutsideError
        With the first thing that is wrong.

    Examples
    --------
    >>> parsed(b'{"a": [1, 2.5]}')
    {'a': [1, 2.5]}
    >>> parsed(b'{"a": 1, "a": 2}')
    Traceback (most recent call last):
    eigbench.errors.OutsideError: the key 'a' is there twice
    """
    # Before anything is made of them: a value is the first in brackets, or follows a comma
    if sum(map(content.count, (b",", b"[", b"{"))) > VALUES:
        raise OutsideError(f"JSON of more than {VALUES:,} values")
    try:
        value = json.loads(
            content.decode("utf-8"),
            parse_constant=_no_constant,
            parse_float=_finite,
            parse_int=_whole,
            object_pairs_hook=_distinct,
        )
    except RecursionError as error:
        raise OutsideError("JSON that is too deep") from error
    except ValueError as error:  # no UTF-8, or no JSON
        raise OutsideError(" ".join(str(error).split())) from error
    check(value)
    return value


def strange(text: str) -> str:
    r"""Return what a text has that none may have on a page; empty if it is plain.

    These are what cannot be printed: control characters, marks that turn the direction of text,
    joiners without a width, halves of surrogate pairs, spaces of other widths, characters that
    are not assigned; what leaves nothing on a page, such as U+3164 or a variation selector; letters
    that are not composed (NFC), which look like others; and marks that do not compose with a letter
    of :data:`ALIKE`. Other scripts need their marks.

    Examples
    --------
    >>> strange("Weyl's law, ℓ²"), strange("a\u202eb"), strange("e\u0301")
    ('', 'the character U+202E, which cannot be printed', 'letters that are not composed (NFC)')
    >>> strange("Weyl\u3164")
    'the character U+3164, which cannot be seen'
    >>> strange("Weyl\u0332")
    'the mark U+0332, which does not compose with a letter'
    """
    for character in text:
        if not character.isprintable():
            return f"the character U+{ord(character):04X}, which cannot be printed"
        if ord(character) in INVISIBLE:
            return f"the character U+{ord(character):04X}, which cannot be seen"
    if not unicodedata.is_normalized("NFC", text):
        return "letters that are not composed (NFC)"
    before = ""  # the last character that is no mark
    for character in text:
        if unicodedata.category(character) not in ("Mn", "Me"):
            before = character
        elif not before.isalpha() or _script(before) in ALIKE:
            return f"the mark U+{ord(character):04X}, which does not compose with a letter"
    return ""


def strange_name(name: str) -> str:
    """Return what a file's name has that none in a result may have; empty if it is plain."""
    return strange(name) or ("a backslash" if "\\" in name else "")


def _script(letter: str) -> str:
    """Return the first word of a character's Unicode name, which for a letter is its script."""
    return unicodedata.name(letter, "").partition(" ")[0]


def check(value: Any) -> None:
    """Check that values which are JSON, or become such, are what :func:`parsed` takes.

    Raises
    ------
    OutsideError
        If they are too many or too deep, or a text is too long or cannot be printed.
    """
    left, seen = [(value, 0)], 0  # what is left, in place of calls
    while left:
        item, depth = left.pop()
        seen += 1
        if depth > DEPTH:
            raise OutsideError(f"JSON of more than {DEPTH} levels")
        if seen > VALUES:
            raise OutsideError(f"more than {VALUES:,} keys and values")
        if isinstance(item, str):
            if len(item) > LONGEST:
                raise OutsideError(f"a text of {len(item):,} characters")
            if problem := strange(item):
                raise OutsideError(problem)
        elif isinstance(item, dict):
            left += [(part, depth + 1) for pair in item.items() for part in pair]
        elif isinstance(item, list):
            left += [(part, depth + 1) for part in item]


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members: dict[str, Any] = {}
    for key, value in pairs:
        if key in members:
            raise OutsideError(f"the key {key[:40]!a} is there twice")
        members[key] = value
    return members


def _finite(digits: str) -> float:
    if not math.isfinite(number := float(_short(digits))):
        raise OutsideError(f"{digits} is too large a number")
    return number


def _whole(digits: str) -> int:
    return int(_short(digits))


def _short(digits: str) -> str:
    if len(digits) > DIGITS:
        raise OutsideError(f"a number of {len(digits)} digits, at most {DIGITS} are read")
    return digits


def _no_constant(word: str) -> float:
    raise OutsideError(f"{word} is no JSON number")
