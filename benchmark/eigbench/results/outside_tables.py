"""Tables that others hand in: Parquet, NPZ and CSV, their heads checked before their data.

Each reader is told how many rows and how many values a row there can be at most, and refuses a
file that says more, or whose data would not be what its head says. So what a file takes in memory
is bounded by what can be right, not by what it claims.
"""

from __future__ import annotations

import codecs
import csv
import math
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eigbench.errors import OutsideError
from eigbench.results import parquet_pages

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = 100  # of a table
MISSING = ("", "NA", "N/A", "NULL", "null", "None")  # what pandas, R and databases write for NaN
NAN = ("nan", "NaN", "-nan", "-NaN")  # of Python's spellings those that pandas knows
TEXT = 200  # characters of a cell of text
WIDEST = TEXT + 16  # bytes of a value when it is unpacked, with its length and levels
PAGES = 10_000  # items of a list in a Parquet file's footer
LINE = 16 * 2**10  # bytes of a line of CSV
# Encodings of Parquet: Arrow does not read the first everywhere, and by the second a long text can
# be the start of every cell.
UNREAD = {6: "DELTA_LENGTH_BYTE_ARRAY", 7: "DELTA_BYTE_ARRAY"}


def parquet(
    file: BinaryIO,
    columns: Mapping[str, int],
    *,
    text: str,
    rows: int,
    check: Callable[[pa.Schema], None],
) -> pa.Table:
    """Return columns of a Parquet file.

    Parameters
    ----------
    file : file
        As :func:`eigbench.outside.opened` gives it.
    columns : mapping of str to int
        Those to be read, where they are there, and how many values a row of each has at most.
    text : str
        That of them which holds text, and must be there.
    rows : int
        Most rows.
    check : callable
        Called with the file's schema before data are read.

    Raises
    ------
    OutsideError, pyarrow.ArrowException
        If the file is damaged, or has more than these.
    """
    footer = parquet_pages.footer(file)
    if text not in {chunk.name for group in footer.groups for chunk in group}:
        raise OutsideError(f"it has no column {text}")
    if footer.rows:  # a column without values may have no page
        _check_footer(file, footer, columns, rows)
    file.seek(0)
    with pq.ParquetFile(
        file,
        read_dictionary=[text],  # what is repeated is unpacked once
        page_checksum_verification=True,
        thrift_string_size_limit=parquet_pages.FOOTER,
        thrift_container_size_limit=PAGES,
    ) as opened:
        check(opened.schema_arrow)
        paths = [opened.schema.column(i).path for i in range(len(opened.schema))]
        if any([chunk.path for chunk in group] != paths for group in footer.groups):
            raise OutsideError("columns whose names are not those of its schema")
        names = [name for name in columns if name in opened.schema_arrow.names]
        if not footer.rows:
            return opened.schema_arrow.empty_table().select(names)
        table = opened.read(names, use_threads=False)
    for chunk in table[text].chunks:
        longest = pc.max(pc.binary_length(getattr(chunk, "dictionary", chunk))).as_py()
        if (longest or 0) > 4 * TEXT:
            raise OutsideError(f"a text of {longest:,} bytes in the column {text}")
    return table


def is_text(kind: pa.DataType) -> bool:
    """Return whether a column holds text, be it written once and repeated."""
    if pa.types.is_dictionary(kind):
        return is_text(kind.value_type)
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _check_footer(
    file: BinaryIO, footer: parquet_pages.Footer, columns: Mapping[str, int], rows: int
) -> None:
    """Check that columns have as many values, and unpack to as much, as can be right."""
    if footer.rows > rows:
        raise OutsideError(f"{footer.rows:,} rows, there can be {rows:,} at most")
    values: Counter[int] = Counter()
    unpacked: Counter[int] = Counter()
    for group in footer.groups:
        if len(group) > COLUMNS:
            raise OutsideError(f"{len(group):,} columns, at most {COLUMNS} are read")
        for i, chunk in enumerate(group):
            if chunk.name not in columns:
                continue
            most = columns[chunk.name] * rows
            for page in parquet_pages.pages(file, chunk):
                if page.encoding in UNREAD:
                    raise OutsideError(
                        f"the column {chunk.name} is encoded as {UNREAD[page.encoding]}, which is "
                        "not read: write it with a dictionary, or plain"
                    )
                values[i] += page.values if page.kind != parquet_pages.DICTIONARY else 0
                unpacked[i] += page.unpacked
                if max(values[i], page.values) > most or unpacked[i] > most * WIDEST + 2**20:
                    raise OutsideError(f"the column {chunk.name} unpacks to more than it can have")


def npz(file: BinaryIO, names: Sequence[str], *, size: int) -> dict[str, NDArray[np.generic]]:
    """Return arrays of an NPZ file of numbers or text; nothing is unpickled.

    Parameters
    ----------
    file : file
        As :func:`eigbench.outside.opened` gives it.
    names : sequence of str
        The arrays to be read.
    size : int
        Most bytes of one.

    Raises
    ------
    OutsideError, ValueError, zipfile.BadZipFile, zlib.error
        If the file is damaged, lacks one, or has more than that.
    """
    with zipfile.ZipFile(file) as archive:
        entries = archive.namelist()
        if len(entries) > COLUMNS:
            raise OutsideError(f"{len(entries):,} arrays, at most {COLUMNS} are read")
        lacking = [name for name in names if f"{name}.npy" not in entries]
        if lacking:
            raise OutsideError(f"it has no array {lacking[0]}")
        return {name: _npy(archive, f"{name}.npy", size) for name in names}


def _npy(archive: zipfile.ZipFile, name: str, size: int) -> NDArray[np.generic]:
    with archive.open(name) as file:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
        elif version == (2, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_2_0(file)
        else:
            raise OutsideError(f"{name} has NPY version {version}: save it with NumPy")
        if dtype.hasobject or dtype.kind not in "fiucUS":
            hint = ", as .astype(str) makes" if dtype.hasobject else ""
            raise OutsideError(f"{name} has dtype {dtype}: arrays are of numbers or text{hint}")
        needed = math.prod(shape) * dtype.itemsize
        if len(shape) > 2 or min(shape, default=0) < 0 or needed > size:
            raise OutsideError(f"{name} has shape {shape} and dtype {dtype}, more than it can have")
        content = file.read(needed)
        if len(content) < needed or file.read(1):
            raise OutsideError(f"{name} has another length than its header says")
    values: NDArray[np.generic] = np.frombuffer(content, dtype)
    return values.reshape(shape, order="F" if fortran else "C")


def csv_table(
    file: BinaryIO, columns: Sequence[str], *, text: str, numbers: Sequence[str], rows: int
) -> pd.DataFrame:
    """Return columns of a CSV file with a header: UTF-8, separated by commas.

    Parameters
    ----------
    file : file
        As :func:`eigbench.outside.opened` gives it.
    columns : sequence of str
        Those to be read, where they are there.
    text, numbers
        Those of them that must be there: one of text, and those of numbers.
    rows : int
        Most rows.

    Raises
    ------
    OutsideError, ValueError
        If the file is damaged, lacks one, or has more than that; if a row has more or fewer fields
        than the header, or a word for a number.
    """
    header = _header(file.readline(LINE + 1))
    if lacking := [name for name in (text, *numbers) if name not in header]:
        raise OutsideError(f"it has no column {lacking[0]}{_instead(header)}")
    records, line = csv.reader(_lines(file, rows)), 2
    try:
        for record in records:
            if len(record) > 1 or "".join(record).strip():  # pandas passes over blank lines, too
                _check_record(record, header, numbers, f"line {line}")
            line = records.line_num + 2
    except csv.Error as error:
        raise OutsideError(f"line {line} is no CSV: {error}") from error
    file.seek(0)
    import pandas as pd  # as late as here, since that takes a quarter of a second

    return pd.read_csv(
        file,
        usecols=[name for name in columns if name in header],
        dtype={text: str, **dict.fromkeys(numbers, np.float64)},
    )


def _header(line: bytes) -> list[str]:
    _check_line(line)
    names = next(csv.reader([_text(line.removeprefix(codecs.BOM_UTF8))]), [])
    if len(names) > COLUMNS:
        raise OutsideError(f"{len(names):,} columns, at most {COLUMNS} are read")
    if twice := [name for name in names if names.count(name) > 1]:
        raise OutsideError(f"the column {twice[0]!a} is there twice")
    return names


def _instead(header: Sequence[str]) -> str:
    """Return what a header is that lacks a column, and what to do if no commas separate it.

    Examples
    --------
    >>> _instead(["id;lambda_1;lambda_2"])
    ': separate columns by commas, not by semicolons'
    >>> _instead(["ID", "l1", "l2", "l3"]), _instead([])
    (": it has 'ID', 'l1', 'l2', …", ': its first line is empty')
    """
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in header[0]:
            return f": separate columns by commas, not by {name}"
    if not header:
        return ": its first line is empty"
    names = [ascii(name[:40]) for name in header[:3]]
    return f": it has {', '.join([*names, *['…'] * (len(header) > 3)])}"


def _lines(file: BinaryIO, most: int) -> Iterator[str]:
    """Yield the lines that are left in a file, one by one."""
    lines = 0
    while line := file.readline(LINE + 1):
        _check_line(line)
        lines += 1
        if lines > most:
            raise OutsideError(f"more than {most:,} lines, there can be {most:,} at most")
        yield _text(line)


def _text(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError as error:
        raise OutsideError(f"{line[:20]!a} is no UTF-8: save it as UTF-8") from error


def _check_record(
    record: Sequence[str], header: Sequence[str], numbers: Sequence[str], where: str
) -> None:
    """Check what pandas lets through: fields too many or too few, and truth values as numbers."""
    if len(record) != len(header):
        raise OutsideError(
            f"{where} has {len(record)} fields and the header {len(header)}: fields are "
            "separated by commas, decimals by a point"
        )
    for name, field in zip(header, record, strict=True):
        if name in numbers and field not in MISSING and not _is_number(field):
            raise OutsideError(f"{where}: {name} is {field[:60]!a}, it must be a number")


def _is_number(text: str) -> bool:
    """Return whether a text is a number to Python and to pandas, which knows fewer."""
    try:
        number = float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text and (not math.isnan(number) or text in NAN)


def _check_line(line: bytes) -> None:
    if len(line) > LINE:
        raise OutsideError(f"a line of more than {LINE:,} bytes")
