"""What a Parquet file will unpack to, read from its footer and its pages' headers alone.

A footer may say that a column is small while a page of it unpacks to two gigabytes. What a reader
will allocate stands in the header before each page, and only there; these are read here, without
decompressing a page, by the compact protocol of Apache Thrift.

References
----------
Apache Parquet, `parquet.thrift`: FileMetaData, ColumnMetaData, PageHeader. Apache Thrift, compact
protocol.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

from eigbench.errors import OutsideError

TRUE, FALSE, BYTE, I16, I32, I64, DOUBLE, TEXT, LIST, SET, MAP, STRUCT = range(1, 13)  # of Thrift
DATA, DICTIONARY, DATA_2 = 0, 2, 3  # kinds of pages; the field of a header that describes each,
DESCRIBED = {DATA: 5, DICTIONARY: 7, DATA_2: 8}
ENCODING = {DATA: 2, DICTIONARY: 2, DATA_2: 4}  # and the field therein
MAGIC = b"PAR1"
FOOTER = 256 * 2**10  # bytes of a footer at most; that of 300,000 predictions has 3,000
HEADER = 64 * 2**10  # bytes of a page's header; it may hold the least and the greatest value
PAGES = 10_000  # of a column chunk at most; writers make pages of a megabyte
NESTED = 10  # structs in structs; a footer has 6


@dataclass(frozen=True, slots=True)
class Chunk:
    """Where the pages of a column lie, the names on the way to it, and the first of them."""

    path: str
    name: str
    begin: int
    length: int


@dataclass(frozen=True, slots=True)
class Footer:
    """What a file says of itself: its rows, and the chunks of each group of rows."""

    rows: int
    groups: tuple[tuple[Chunk, ...], ...]


@dataclass(frozen=True, slots=True)
class Page:
    """What a page's header says: its kind, bytes when unpacked, values and encoding."""

    kind: int
    unpacked: int
    values: int
    encoding: int


def footer(file: BinaryIO) -> Footer:
    """Return a file's footer; raise OutsideError if it is none of Parquet, or too long."""
    size = file.seek(0, 2)
    file.seek(max(size - 8, 0))
    tail = file.read(8)
    length = int.from_bytes(tail[:4], "little")
    if tail[4:] != MAGIC or length > min(FOOTER, size - 12):
        raise OutsideError("no footer of Parquet, or one that is too long")
    file.seek(size - 8 - length)
    try:
        fields = _Compact(file.read(length)).struct()
        groups = [_chunks(group) for group in fields.get((4, LIST), [])]
        return Footer(_natural(fields[3, I64]), tuple(groups))
    except (LookupError, AttributeError, TypeError, ValueError, RecursionError) as error:
        raise OutsideError("a footer that is not Parquet's") from error


def _chunks(group: dict[tuple[int, int], Any]) -> tuple[Chunk, ...]:
    chunks = []
    for column in group[1, LIST]:
        facts = column[3, STRUCT]
        begin, other = _natural(facts[9, I64]), facts.get((11, I64), 0)  # that of the dictionary
        begin = other if 0 < other < begin else begin
        way = [name.decode() for name in facts[3, LIST]]
        if (1, TEXT) in column:
            raise ValueError("data in another file")
        chunks.append(Chunk(".".join(way), way[0], begin, _natural(facts[7, I64])))
    return tuple(chunks)


def _natural(number: int) -> int:
    if number < 0:
        raise ValueError(f"{number} is less than nothing")
    return number


def pages(file: BinaryIO, chunk: Chunk) -> Iterator[Page]:
    """Yield the headers of a chunk's pages.

    Raise OutsideError if the pages do not fill the chunk, or are too many.
    """
    begin, count = chunk.begin, 0
    while begin < (end := chunk.begin + chunk.length):
        count += 1
        file.seek(begin)
        reader = _Compact(file.read(min(HEADER, end - begin)))
        try:
            header = reader.struct()
            kind, unpacked, packed = (header[field, I32] for field in (1, 2, 3))
            described = header.get((DESCRIBED.get(kind, 0), STRUCT), {})
            values = described.get((1, I32), 0)
            encoding = described.get((ENCODING.get(kind, 0), I32), 0)
        except (LookupError, AttributeError, RecursionError) as error:
            raise OutsideError("a page without a header of Parquet") from error
        begin += reader.at + packed
        if min(unpacked, packed, values) < 0 or begin > end or count > PAGES:
            raise OutsideError("pages of sizes that cannot be")
        yield Page(kind, unpacked, values, encoding)


class _Compact:
    """A reader of Thrift's compact protocol.

    A struct is a dictionary by number and type of a field: a reader that expects another type
    passes over the field. No field may come twice, so that no two readers take different ones.
    """

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def _byte(self) -> int:
        self.at += 1
        return self.content[self.at - 1]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise IndexError("a varint of more than ten bytes")

    def _integer(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)

    def _text(self) -> bytes:
        length = self._varint()
        self.at += length
        if self.at > len(self.content):
            raise IndexError("a text that ends later than what it is in")
        return self.content[self.at - length : self.at]

    def struct(self, depth: int = 0) -> dict[tuple[int, int], Any]:
        """Return the fields up to the end of a struct."""
        if depth > NESTED:
            raise IndexError("structs that nest too deep")
        fields: dict[tuple[int, int], Any] = {}
        field, seen = 0, set()
        while byte := self._byte():
            field = field + (byte >> 4) if byte >> 4 else self._integer()
            kind = byte & 0x0F
            if field in seen:
                raise IndexError(f"the field {field} twice")
            seen.add(field)
            fields[field, kind] = (
                kind == TRUE if kind in (TRUE, FALSE) else self._value(kind, depth)
            )
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in (TRUE, FALSE, BYTE):  # a boolean in a list
            return self._byte()
        if kind in (I16, I32, I64):
            return self._integer()
        if kind == DOUBLE:
            self.at += 8
            return None
        if kind == TEXT:
            return self._text()
        if kind in (LIST, SET):
            size = self._byte()
            count = self._varint() if size >> 4 == 15 else size >> 4
            if count > len(self.content) - self.at:
                raise IndexError("a list that ends later than what it is in")
            return [self._value(size & 0x0F, depth + 1) for _ in range(count)]
        if kind == STRUCT:
            return self.struct(depth + 1)
        raise IndexError(f"a value of kind {kind}")  # a map: Parquet has none
