"""The triangles of OBJ, OFF, PLY and STL files, from their bytes.

A file is read as it stands or refused, with the line if it is text. What its header declares, or
its own brackets (``facet`` and ``endfacet``), must all be there: a file that was cut off is no
smaller mesh. Only OBJ declares nothing, so of an OBJ file a cut between two lines cannot be seen;
nor can one within the digits of the very last number of any text. Colours, normals, texture
coordinates, materials and groups are passed over, and no other file is opened.

Polygons are cut into fans of triangles around their first corner. Where these do not all face one
way, or one has no area, the file is refused: another cut would be a guess.
"""

from __future__ import annotations

import codecs
import io
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from synthnet.errors import SynthNetError

Triangles: TypeAlias = tuple[NDArray[np.float64], NDArray[np.int64]]
Rows: TypeAlias = Iterator[tuple[int, list[bytes]]]

# What OBJ has beside v and f (Wavefront, Advanced Visualizer, appendix B1); an unknown word may be
# a v or f that was damaged. Not here: call and csh, which would read other files.
OBJ_OTHERS = frozenset(
    b"vt vn vp p l g s mg o usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
    b"trace_obj deg bmat step cstype curv curv2 surf parm trim hole scrv sp end con ctech "
    b"stech".split()
)
PLY_KINDS = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
PLY_INDICES = ("vertex_indices", "vertex_index")
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEADER = 84  # bytes: 80 of text, 4 of the number of faces


class UnreadableError(SynthNetError):
    """A file that is no mesh, or that cannot be read within the limits."""


@dataclass(slots=True)
class Polygons:
    """Polygons as they are read: corners in a row, and of each polygon their number and line."""

    corners: array[int] = field(default_factory=lambda: array("q"))
    sizes: array[int] = field(default_factory=lambda: array("q"))
    lines: array[int] = field(default_factory=lambda: array("q"))

    def add(self, corners: Sequence[int], line: int) -> None:
        """Append a polygon."""
        if len(corners) < 3:
            raise UnreadableError(f"line {line}: a face of {len(corners)} corners")
        try:
            self.corners.extend(corners)
        except OverflowError as error:
            raise UnreadableError(f"line {line}: no vertex has a number that large") from error
        self.sizes.append(len(corners))
        self.lines.append(line)

    def triangles(self, positions: array[float]) -> Triangles:
        """Return vertices of shape (n, 3), and fans of the polygons of shape (m, 3)."""
        vertices = np.array(positions, np.float64).reshape(-1, 3)
        corners, sizes = np.array(self.corners, np.int64), np.array(self.sizes, np.int64)
        return vertices, fans(vertices, corners, sizes, np.array(self.lines, np.int64))


def read(content: bytes, suffix: str) -> Triangles:
    r"""Return the vertices (n, 3), float64, and triangles (m, 3), int64, of a file.

    Parameters
    ----------
    content : bytes
        The file.
    suffix : str
        What it is: a key of :data:`READERS`.

    Raises
    ------
    UnreadableError
        If it is cut off, no such file, or has no triangle.

    Examples
    --------
    >>> vertices, faces = read(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1", ".obj")
    >>> faces.tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    vertices, faces = READERS[suffix](content)
    if not len(faces):
        raise UnreadableError("it holds no triangles, or is cut off")
    return vertices, faces


def read_obj(content: bytes) -> Triangles:
    """Read the lines ``v`` and ``f`` of an OBJ file; all others are passed over."""
    positions, polygons = array("d"), Polygons()
    for line, words in _rows(content):
        if words[-1].endswith(b"\\"):
            raise UnreadableError(f"line {line}: it goes on in the next line (\\): join the two")
        if words[0] == b"v":
            positions.extend(_position(words[1:4], line))
        elif words[0] == b"f":
            corners = _integers([word.partition(b"/")[0] for word in words[1:]], line)
            if 0 in corners:
                raise UnreadableError(f"line {line}: vertex 0, but OBJ counts from 1")
            known = len(positions) // 3  # a negative number counts back from the last so far
            polygons.add([c - 1 if c > 0 else known + c for c in corners], line)
        elif words[0] not in OBJ_OTHERS:
            raise UnreadableError(f"line {line}: {_told(words[0])} begins no line of an OBJ file")
    return polygons.triangles(positions)


def read_off(content: bytes) -> Triangles:
    """Read an OFF file, or its kin with colours, normals or texture coordinates, as text."""
    rows = _rows(content)
    line, words = next(rows, (1, [b""]))
    head = re.match(rb"(ST)?C?N?OFF", words[0])
    if head is None:
        raise UnreadableError(f"line {line}: it begins with {_told(words[0])}, not with OFF")
    counts = [word for word in (words[0][head.end() :], *words[1:]) if word]
    if not counts:
        line, counts = next(rows, (line, []))
    if len(counts) < 2:
        raise UnreadableError(f"line {line}: the numbers of vertices and faces are missing")
    n, m = _integers(counts[:2], line)
    positions, polygons = array("d"), Polygons()
    for i in range(n):
        line, words = _next(rows, i, n, "vertices")
        positions.extend(_position(words[:3], line))
    for i in range(m):
        line, words = _next(rows, i, m, "faces")
        (size,) = _integers(words[:1], line)
        if len(words) < 1 + size:
            raise UnreadableError(f"cut off: {i:,} of {m:,} faces, line {line} ends early")
        polygons.add(_integers(words[1 : 1 + max(size, 0)], line), line)
    _no_more(rows, f"the {m:,} faces that its header declares")
    return polygons.triangles(positions)


@dataclass(frozen=True, slots=True)
class Element:
    """An element of a PLY header: each property's name, kind, and kind of its length if a list."""

    name: str
    count: int
    properties: dict[str, tuple[str, str | None]] = field(default_factory=dict)

    @property
    def plural(self) -> str:
        """What its rows are called."""
        return {"vertex": "vertices", "face": "faces"}.get(self.name, f"rows of {self.name}")


def read_ply(content: bytes) -> Triangles:
    """Read a PLY file, ASCII or binary; in a binary one all polygons have as many corners."""
    end = content.find(b"end_header")
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or not start:
        raise UnreadableError("it has no PLY header from ply to end_header")
    lines = content[:end].splitlines()
    form, elements = _ply_header(lines)
    if form == "ascii":
        return _ply_text(_rows(content[start:], len(lines) + 2), elements)
    return _ply_binary(memoryview(content)[start:], elements, PLY_ORDERS[form])


def _ply_header(lines: Sequence[bytes]) -> tuple[str, list[Element]]:
    form, elements = "", list[Element]()
    kinds: tuple[str, str | None]
    for number, line in enumerate(lines, start=1):
        match line.decode("ascii", "replace").split():
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                continue
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, _]:
                continue
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append(Element(name, int(count)))
                continue
            case ["property", kind, name] if kind in PLY_KINDS and elements:
                kinds = PLY_KINDS[kind], None
            case ["property", "list", many, kind, name] if (
                {many, kind} <= set(PLY_KINDS) and PLY_KINDS[many][0] in "iu" and elements
            ):
                kinds = PLY_KINDS[kind], PLY_KINDS[many]
            case _:
                raise UnreadableError(f"line {number}: {_told(line)} is of no PLY header")
        if name in elements[-1].properties:
            raise UnreadableError(f"line {number}: the property {_told(line.split()[-1])} again")
        elements[-1].properties[name] = kinds
    known = {element.name: element.properties for element in elements}
    lists = [PLY_INDICES[0] in known.get("face", {}), PLY_INDICES[1] in known.get("face", {})]
    if not form or len(known) < len(elements) or "vertex" not in known or {} in known.values():
        raise UnreadableError(
            "its header has no format, no vertices, or an element that is empty or there twice"
        )
    if any(known["vertex"].get(axis, ("", "list"))[1] for axis in "xyz"):
        raise UnreadableError("its header has no properties x, y and z of the vertices")
    if sum(lists) != 1:
        raise UnreadableError("its header has no faces with one list vertex_indices")
    kind, length = known["face"][PLY_INDICES[lists.index(True)]]
    if length is None or kind[0] not in "iu":
        raise UnreadableError("its header has vertex_indices that are no list of whole numbers")
    return form, elements


def _ply_text(rows: Rows, elements: Sequence[Element]) -> Triangles:
    positions, polygons = array("d"), Polygons()
    for element in elements:
        for i in range(element.count):
            line, words = _next(rows, i, element.count, element.plural)
            values, at = dict[str, list[bytes]](), 0
            for name, (_, length) in element.properties.items():
                size = 1
                if length:
                    size = sum(_integers(words[at : at + 1], line))
                    at += 1
                values[name] = words[at : at + max(size, 0)]
                at += max(size, 0)
            if at > len(words):
                raise UnreadableError(
                    f"cut off: {i:,} of {element.count:,} {element.plural}, line {line} ends early"
                )
            if at < len(words):
                raise UnreadableError(f"line {line}: {len(words)} values instead of {at}")
            if element.name == "vertex":
                positions.extend(_position([values[axis][0] for axis in "xyz"], line))
            elif element.name == "face":
                indices = next(values[name] for name in PLY_INDICES if name in values)
                polygons.add(_integers(indices, line), line)
    _no_more(rows, "all that its header declares")
    return polygons.triangles(positions)


def _ply_binary(body: memoryview, elements: Sequence[Element], order: str) -> Triangles:
    at, columns = 0, dict[str, NDArray[np.void]]()
    for element in elements:
        rows = _ply_rows(body[at:], element, order)
        if len(rows) < element.count:
            raise UnreadableError(
                f"cut off: {len(rows):,} of {element.count:,} {element.plural}, as its header has"
            )
        at += rows.nbytes
        columns[element.name] = rows
    if at != len(body):
        raise UnreadableError(f"{len(body) - at:,} bytes more than its header declares")
    xyz = columns["vertex"]
    vertices = np.stack([xyz[axis].astype(np.float64) for axis in "xyz"], axis=1)
    faces = columns["face"]
    if not len(faces):
        return vertices, np.zeros((0, 3), np.int64)
    names = faces.dtype.names or ()
    corners = faces[next(name for name in PLY_INDICES if name in names)].astype(np.int64)
    m, size = corners.shape
    if size < 3:
        raise UnreadableError(f"faces of {size} corners")
    numbers = np.arange(1, m + 1)
    return vertices, fans(vertices, corners.ravel(), np.full(m, size), numbers, "face")


def _ply_rows(body: memoryview, element: Element, order: str) -> NDArray[np.void]:
    """Return the rows of an element that are there, at most as many as were declared."""
    fields = list[tuple[str, str, tuple[int, ...]]]()
    sizes = dict[str, int]()
    for name, (kind, length) in element.properties.items():
        if length is None:
            fields.append((name, order + kind, ()))
            continue
        here = np.dtype(fields).itemsize  # of the first row, whose lists set the length of all
        first = body[here : here + np.dtype(length).itemsize]
        if element.count and len(first) < np.dtype(length).itemsize:
            return np.zeros(0, np.dtype(fields))
        size = int(np.frombuffer(first, order + length)[0]) if element.count else 0
        if not 0 <= size <= len(body):
            raise UnreadableError(f"a list {name} of {size:,} values, more than the file has bytes")
        sizes[name] = size
        fields += [(f"{name}, length", order + length, ()), (name, order + kind, (size,))]
    kinds = np.dtype(fields)
    count = min(element.count, len(body) // kinds.itemsize)
    rows = np.frombuffer(body[: count * kinds.itemsize], kinds) if count else np.zeros(0, kinds)
    for name, size in sizes.items():
        if (rows[f"{name}, length"] != size).any():
            raise UnreadableError(
                f"lists {name} of several lengths in a binary PLY, or bytes that are not in "
                "their place: save it as triangles, or as an ASCII PLY"
            )
    return rows


def read_stl(content: bytes) -> Triangles:
    """Read an STL file, binary or ASCII; every triangle has three vertices of its own."""
    header = content[:STL_HEADER]
    count = int.from_bytes(header[80:84], "little")
    more = len(content) - STL_HEADER - count * STL_FACE.itemsize
    if len(header) < STL_HEADER or (more and header.lstrip()[:5].lower() == b"solid"):
        return _stl_text(_rows(content))
    if more:
        there = (len(content) - STL_HEADER) // STL_FACE.itemsize
        raise UnreadableError(
            f"cut off: {there:,} of {count:,} faces"
            if more < 0
            else f"{more:,} bytes more than its {count:,} faces take"
        )
    rows = np.frombuffer(content[STL_HEADER:], STL_FACE) if count else np.zeros(0, STL_FACE)
    vertices = rows["corners"].astype(np.float64).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _stl_text(rows: Rows) -> Triangles:
    positions = array("d")
    opened = dict.fromkeys((b"solid", b"facet"), 0)
    closed = dict.fromkeys((b"endsolid", b"endfacet"), 0)
    for line, words in rows:
        word = words[0].lower()
        if word in opened:
            opened[word] += 1
        elif word == b"vertex":
            positions.extend(_position(words[1:4], line))
        elif word in closed:
            closed[word] += 1
            if word == b"endfacet" and len(positions) != 9 * closed[word]:
                raise UnreadableError(f"line {line}: a facet that has not three vertices")
    (solids, facets), (ends, faces) = opened.values(), closed.values()
    if faces != facets or len(positions) != 9 * faces:
        raise UnreadableError(f"cut off: {faces:,} of {facets:,} faces have their endfacet")
    if ends != solids:
        raise UnreadableError(f"cut off: {ends:,} of {solids:,} solids have their endsolid")
    vertices = np.array(positions, np.float64).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


READERS: dict[str, Callable[[bytes], Triangles]] = {
    ".obj": read_obj,
    ".off": read_off,
    ".ply": read_ply,
    ".stl": read_stl,
}
SUFFIXES = tuple(READERS)


def fans(
    vertices: NDArray[np.float64],
    corners: NDArray[np.int64],
    sizes: NDArray[np.int64],
    numbers: NDArray[np.int64],
    unit: str = "line",
) -> NDArray[np.int64]:
    """Cut polygons into triangles around their first corners.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3), float64
        Positions.
    corners : ndarray of int64
        The corners of all polygons in a row.
    sizes, numbers : ndarray of shape (p,), int64
        How many corners each polygon has, at least 3, and its number in error messages.
    unit : str
        What ``numbers`` count.

    Returns
    -------
    ndarray of shape (m, 3), int64
        Triangles in the order of the polygons.

    Raises
    ------
    UnreadableError
        If a corner is no vertex, or the triangles of a polygon do not all face one way; those
        that name a vertex twice are not checked.

    Examples
    --------
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> fans(corners, np.array([0, 1, 2, 3]), np.array([4]), np.array([1])).tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    outside = (corners < 0) | (corners >= len(vertices))
    if outside.any():
        number = np.repeat(numbers, sizes)[outside.argmax()]
        raise UnreadableError(
            f"{unit} {number}: a corner is none of the {len(vertices):,} vertices"
        )
    many = sizes - 2
    polygon = np.repeat(np.arange(len(sizes)), many)
    step = 1 + np.arange(len(polygon)) - np.repeat(np.cumsum(many) - many, many)
    first = (np.cumsum(sizes) - sizes)[polygon]
    faces = corners[np.stack([first, first + step, first + step + 1], axis=1)]
    several = (many[polygon] > 1) & (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if several.any():
        turned = _turned(vertices[faces[several]], polygon[several])
        if turned.any():
            number = numbers[polygon[several][turned.argmax()]]
            raise UnreadableError(f"{unit} {number}: a polygon that is not convex: save triangles")
    return faces


def _turned(triangles: NDArray[np.float64], polygon: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which triangles do not face as their polygon does, from corners (t, 3, 3)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite has a rule of its own
        normals = np.cross(b - a, c - a)
        whole = np.stack([np.bincount(polygon, n) for n in normals.T], axis=1)
        facing: NDArray[np.float64] = np.einsum("ij,ij->i", normals, whole[polygon])
    return facing <= 0


def _rows(content: bytes, first: int = 1) -> Rows:
    """Yield the number and words of each line that has any, comments left out."""
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\n" not in content:
        content = content.replace(b"\r", b"\n")
    for line, text in enumerate(io.BytesIO(content), start=first):
        words = text.partition(b"#")[0].split()
        if words:
            yield line, words


def _next(rows: Rows, i: int, count: int, what: str) -> tuple[int, list[bytes]]:
    row = next(rows, None)
    if row is None:
        raise UnreadableError(f"cut off: {i:,} of {count:,} {what}")
    return row


def _no_more(rows: Rows, what: str) -> None:
    line, words = next(rows, (0, []))
    if words:
        raise UnreadableError(f"line {line}: it comes after {what}")


def _position(words: Sequence[bytes], line: int) -> tuple[float, float, float]:
    try:
        x, y, z = map(float, words)
    except ValueError as error:
        raise UnreadableError(f"line {line}: {_told(*words)} are no three numbers") from error
    if b"_" in b"".join(words):  # which Python reads over
        raise UnreadableError(f"line {line}: {_told(*words)} are no three numbers")
    return x, y, z


def _integers(words: Sequence[bytes], line: int) -> list[int]:
    try:
        numbers = [int(word) for word in words]
    except ValueError as error:
        raise UnreadableError(f"line {line}: {_told(*words)}: no whole numbers") from error
    if b"_" in b"".join(words):
        raise UnreadableError(f"line {line}: {_told(*words)}: no whole numbers")
    return numbers


def _told(*words: bytes) -> str:
    """Return words of a file for a message: short, and nothing that cannot be printed."""
    return ascii(b" ".join(words)[:40].decode("latin-1"))
