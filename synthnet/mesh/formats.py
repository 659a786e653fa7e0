"""The triangles of OBJ, OFF, PLY, STL, GIfTI and FreeSurfer files, from their bytes.

A file is read as it stands or refused, with the line if it is text. What its header declares, or
its own brackets (``facet`` and ``endfacet``), must all be there: a file that was cut off is no
smaller mesh. Only OBJ declares nothing, so of an OBJ file a cut between two lines cannot be seen;
nor can one within the digits of the very last number of any text. Colours, normals, texture
coordinates, materials and groups are passed over, and no other file is opened.

Trimesh reads four of these formats, and forgives what is refused here; a table in
``tests/mesh/test_formats.py`` holds each of these against it:

==========  ========================================================================================
format      why its reader is our own
==========  ========================================================================================
OBJ         trimesh drops lines that it does not know, and faces of two corners; where one vertex
            has two numbers, it drops the third of all
OFF         trimesh takes fewer faces, or more, than the header declares; where that declares too
            many vertices, the first faces become vertices
PLY         of text trimesh takes fewer rows or more, too; of binary files, corners that are no
            vertices, and no polygons of several sizes
STL         trimesh takes text and binary files that are cut off for others, which are empty
FreeSurfer  trimesh has no reader; that of nibabel takes corners that are no vertices, and makes
            triangles of quads by a rule of its own
GIfTI       by nibabel, which reads its table of arrays whole or not at all: trimesh has no reader
==========  ========================================================================================

Polygons are cut into triangles by :mod:`synthnet.mesh.polygons`.
"""

from __future__ import annotations

import codecs
import gzip
import io
import re
import zlib
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias
from xml.parsers.expat import ExpatError

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Floats, Int64s
from synthnet.errors import SynthNetError, needed_by
from synthnet.mesh import polygons
from synthnet.mesh.polygons import PolygonError

Rows: TypeAlias = Iterator[tuple[int, list[bytes]]]
Lists: TypeAlias = tuple[NDArray[Any], Int64s]  # values in a row, how many of each

# What OBJ has beside v and f (Wavefront, Advanced Visualizer, appendix B1); an unknown word may be
# a v or f that was damaged. Not here: call and csh, which would read other files.
OBJ_OTHERS = frozenset(
    b"vt vn vp p l g s mg o usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj "
    b"trace_obj deg bmat step cstype curv curv2 surf parm trim hole scrv sp end con ctech "
    b"stech".split()
)
OBJ_WORDS = OBJ_OTHERS | {b"v", b"f"}
OBJ_NUMBERS = frozenset(b"v vt vn vp p l s".split())  # no word of OBJ comes after these
PLY_KINDS = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
PLY_INDICES = ("vertex_indices", "vertex_index")
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FREESURFER = (".orig", ".white", ".pial", ".inflated", ".smoothwm", ".sphere", ".midthickness")
# lh.pial, and what FreeSurfer adds to that: lh.pial.T1, rh.white.preaparc, lh.sphere.reg
FREESURFER_NAME = re.compile(rf"(?:.*\.)?[lr]h({'|'.join(map(re.escape, FREESURFER))})(?:\..+)?")
FREESURFER_VALUES = re.compile(
    r"(?:.*[./])?[lr]h\.(area|avg_curv|curv|jacobian_white|sulc|thickness|volume)(\..+)?",
    re.IGNORECASE,
)
# The first bytes of its files (FreeSurfer, include/mrisurf.h): of old quads and of values the same
TRIANGLES, QUADS, OLD_QUADS = b"\xff\xff\xfe", b"\xff\xff\xfd", b"\xff\xff\xff"
LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # git-lfs, docs/spec.md
BEGINNINGS = (  # of files whose name may say something else: how, of which suffix, what to say
    (re.compile(rb"ply\s"), ".ply", "a PLY file: name it .ply"),
    (re.compile(rb"(?:ST|C|N|4|n)*OFF\s"), ".off", "an OFF file: name it .off"),
    (re.compile(rb"solid\s"), ".stl", "an STL file: name it .stl"),
    (re.compile(rb"glTF"), "", "a file of glTF: convert it to PLY"),
    (re.compile(rb"(?i)\s*<(?:!doctype )?html"), "", "a web page: get the file itself"),
)
TEXTS = (".obj", ".off", ".ply", ".stl")  # XML may be UTF-16
UTF_16 = re.compile(rb"(?s)\xff\xfe.\0|\xfe\xff\0")  # its mark, then a letter of ASCII
VALUES_ALONE = "values at vertices, and no triangles: give the surface, such as lh.white"
GZIP = ".gz"
PLY_END = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(\r?\n|\r)")  # a line of its own, no comment
OFF_COLUMNS = 12  # of a vertex, at most: position, normal, colour, texture; more than of a colour
# What nibabel raises where a file is none: it does not look at which elements are in which.
GIFTI_ERRORS = (
    *(ExpatError, zlib.error, ValueError, TypeError, LookupError, AttributeError, AssertionError),
)
STL_HEADER = 84  # bytes: 80 of text, 4 of the number of faces


class UnreadableError(SynthNetError):
    """A file that is no mesh, or that cannot be read within the limits."""


@dataclass(frozen=True, slots=True)
class Triangles:
    """What a file holds: vertices (n, 3), float64, and faces (m, 3), int64.

    ``clipped`` is the number of polygons that are not convex, of which ears were cut.
    """

    vertices: Floats
    faces: Int64s
    clipped: int = 0


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
        """Return the vertices, and the triangles of the polygons."""
        vertices = np.array(positions, np.float64).reshape(-1, 3)
        corners, sizes = np.array(self.corners, np.int64), np.array(self.sizes, np.int64)
        return _cut(vertices, corners, sizes, np.array(self.lines, np.int64))


def read(content: bytes, suffix: str) -> Triangles:
    r"""Return the triangles of a file.

    Parameters
    ----------
    content : bytes
        The file.
    suffix : str
        What it is: a key of :data:`READERS`, and ``.gz`` after it if it is compressed.

    Raises
    ------
    UnreadableError
        If it is cut off, no such file, or has no triangle.

    Examples
    --------
    >>> triangles = read(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1", ".obj")
    >>> triangles.faces.tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    zipped = GZIP if suffix.endswith(GZIP) else ""
    if zipped:
        content, suffix = _decompressed(content), suffix.removesuffix(GZIP)
    if not content.strip():
        raise UnreadableError("the file is empty")
    if content.startswith(LFS_POINTER):
        raise UnreadableError("a pointer of Git LFS in the place of the file: run `git lfs pull`")
    if suffix in TEXTS and UTF_16.match(content):
        raise UnreadableError("text in UTF-16: save it as UTF-8")
    try:
        triangles = READERS[suffix](content)
    except UnreadableError as error:
        if (other := _of_another_format(content, suffix, zipped)) is not None:
            raise UnreadableError(other) from error
        raise
    if not len(triangles.faces):
        raise _without_faces(len(triangles.vertices))
    return triangles


def _of_another_format(content: bytes, suffix: str, zipped: str) -> str | None:
    r"""Return what a file is by how it begins, where its name says something else.

    Examples
    --------
    >>> _of_another_format(b"ply\nformat", ".stl", ".gz")
    'by how it begins it is a PLY file: name it .ply.gz'
    """
    for begins, own, what in BEGINNINGS:
        if own != suffix and begins.match(content):
            return f"by how it begins it is {what}{zipped if own else ''}"
    return None


def kind_of(name: str) -> str | None:
    """Return what a file of this name is, as :func:`read` wants it, or None if it is no mesh.

    Examples
    --------
    >>> kind_of("Bunny.PLY.gz"), kind_of("lh.pial.T1"), kind_of("paper.pdf")
    ('.ply.gz', '.pial', None)
    """
    lower = name.lower()
    zipped = GZIP if lower.endswith(GZIP) else ""
    lower = lower.removesuffix(zipped)
    suffix = f".{lower.rpartition('.')[2]}" if "." in lower else ""
    if suffix in READERS and suffix not in FREESURFER:
        return suffix + zipped
    surface = FREESURFER_NAME.fullmatch(lower)
    return None if surface is None else surface[1] + zipped


def no_mesh(name: str) -> str:
    """Return what to say of a file that is no mesh by its name, or its path's.

    Examples
    --------
    >>> no_mesh("paper.pdf").startswith("paper.pdf is none of .obj, .off, ")
    True
    """
    if FREESURFER_VALUES.fullmatch(name):
        return f"{name} has {VALUES_ALONE}"
    return f"{name} is none of {', '.join(SUFFIXES)}: convert it to PLY"


def _without_faces(count: int) -> UnreadableError:
    """Return the error for a file of vertices alone."""
    return UnreadableError(
        f"a point cloud: {count:,} points and no faces, or cut off" if count else "an empty mesh"
    )


def _decompressed(content: bytes) -> bytes:
    try:
        return gzip.decompress(content)
    except (OSError, EOFError, zlib.error) as error:
        raise UnreadableError(f"cut off or no gzip file ({error})") from error


def read_obj(content: bytes) -> Triangles:
    """Read the lines ``v`` and ``f`` of an OBJ file; all others are passed over."""
    positions, polygons = array("d"), Polygons()
    for line, words in _rows(_continued(content)):
        if words[0] in OBJ_NUMBERS and not OBJ_WORDS.isdisjoint(words[1:]):
            word = next(word for word in words[1:] if word in OBJ_WORDS)
            raise UnreadableError(f"line {line}: {_quoted(word)} must begin a line of its own")
        if words[0] == b"v":
            positions.extend(_position(words[1:4], line))
        elif words[0] == b"f":
            corners = _integers([word.partition(b"/")[0] for word in words[1:]], line)
            if 0 in corners:
                raise UnreadableError(f"line {line}: vertex 0, but OBJ counts from 1")
            known = len(positions) // 3  # a negative number counts back from the last so far
            polygons.add([c - 1 if c > 0 else known + c for c in corners], line)
        elif words[0] not in OBJ_OTHERS:
            raise UnreadableError(f"line {line}: {_quoted(words[0])} begins no line of an OBJ file")
    return polygons.triangles(positions)


def read_off(content: bytes) -> Triangles:
    """Read an OFF file, or its kin with colours, normals or texture coordinates, as text."""
    rows = _rows(content)
    line, words = next(rows, (1, [b""]))
    head = re.match(rb"(ST)?C?N?OFF", words[0])
    if head is None:
        raise UnreadableError(f"line {line}: it begins with {_quoted(words[0])}, not with OFF")
    if words[1:2] == [b"BINARY"]:
        raise UnreadableError("a binary OFF file: save it as text")
    counts = [word for word in (words[0][head.end() :], *words[1:]) if word]
    if not counts:
        line, counts = next(rows, (line, []))
    if len(counts) < 2:
        raise UnreadableError(f"line {line}: the numbers of vertices and faces are missing")
    n, m = _integers(counts[:2], line)
    if min(n, m) < 0:
        raise UnreadableError(f"line {line}: {n:,} vertices and {m:,} faces: a number below zero")
    positions, polygons = array("d"), Polygons()
    while len(positions) < 3 * n:
        line, words = _next(rows, len(positions) // 3, n, "vertices")
        positions.extend(_off_positions(words, n if head[0] == b"OFF" else 0, line))
    while (i := len(polygons.sizes)) < m:
        line, words = _next(rows, i, m, "faces")
        for face in _off_faces(words, m, line):
            (size,) = _integers(face[:1], line)
            if len(face) < 1 + size:
                raise UnreadableError(f"cut off: {i:,} of {m:,} faces, line {line} ends early")
            polygons.add(_integers(face[1 : 1 + max(size, 0)], line), line)
    _no_more(rows, f"the {m:,} faces that its header declares")
    return polygons.triangles(positions)


def _off_positions(words: Sequence[bytes], count: int, line: int) -> Sequence[float]:
    """Return the position of a line's vertex, or of ``count`` if it has so many.

    Those of a header that names normals or colours have one each: 9 numbers, as 3 positions.
    """
    if count > 2 and len(words) == 3 * count:
        return [x for i in range(0, len(words), 3) for x in _position(words[i : i + 3], line)]
    _check_one(words, OFF_COLUMNS, "vertex", line)
    return _position(words[:3], line)


def _off_faces(words: Sequence[bytes], count: int, line: int) -> list[Sequence[bytes]]:
    """Return a line's face and its colour, or all faces if the file has them on one line."""
    (size,) = _integers(words[:1], line)
    if len(words) <= 1 + size:
        return [words]
    faces, at = list[Sequence[bytes]](), 0
    while at < len(words) and len(faces) < count and re.fullmatch(rb"\d{1,18}", words[at]):
        end = at + 1 + int(words[at])
        faces.append(words[at:end])
        at = end
    if len(faces) == count and at == len(words):
        return faces
    _check_one(words, 1 + size + OFF_COLUMNS, "face", line)
    return [words]


def _check_one(words: Sequence[bytes], most: int, what: str, line: int) -> None:
    """Refuse several vertices or faces on a line, of which all but one would be passed over."""
    if len(words) > most:
        raise UnreadableError(
            f"line {line}: {len(words):,} values of one {what}: save each {what} on its own line"
        )


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
    """Read a PLY file, ASCII or binary."""
    content = content.removeprefix(codecs.BOM_UTF8)
    end = PLY_END.search(content)
    if not content.startswith(b"ply") or end is None:
        raise UnreadableError("it has no PLY header from ply to end_header")
    lines = content[: end.start()].splitlines()
    form, elements = _ply_header(lines)
    if form == "ascii":
        return _ply_text(_rows(content[end.end() :], len(lines) + 2), elements)
    return _ply_binary(memoryview(content)[end.end() :], elements, PLY_ORDERS[form])


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
                raise UnreadableError(f"line {number}: {_quoted(line)} is of no PLY header")
        if name in elements[-1].properties:
            raise UnreadableError(f"line {number}: the property {_quoted(line.split()[-1])} again")
        elements[-1].properties[name] = kinds
    known = {element.name: element.properties for element in elements}
    if not form or len(known) < len(elements) or "vertex" not in known or {} in known.values():
        raise UnreadableError(
            "its header has no format, no vertices, or an element that is empty or there twice"
        )
    if any(known["vertex"].get(axis, ("", "list"))[1] for axis in "xyz"):
        raise UnreadableError("its header has no properties x, y and z of the vertices")
    if not known.get("face") and "tristrips" not in known:
        (points,) = (element.count for element in elements if element.name == "vertex")
        raise _without_faces(points)
    if "tristrips" in known:
        raise UnreadableError("its faces are strips (tristrips): save triangles")
    lists = [kinds for name, kinds in known.get("face", {}).items() if name in PLY_INDICES]
    if len(lists) != 1:
        raise UnreadableError("its header has no faces with one list vertex_indices")
    ((kind, length),) = lists
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
    at, columns = 0, dict[str, Lists]()
    for element in elements:
        there, size, lists = _ply_rows(body[at:], element, order)
        if there < element.count:
            raise UnreadableError(
                f"cut off: {there:,} of {element.count:,} {element.plural}, as its header has"
            )
        at += size
        columns |= {f"{element.name}.{name}": values for name, values in lists.items()}
    if at != len(body):
        raise UnreadableError(f"{len(body) - at:,} bytes more than its header declares")
    vertices = np.stack([columns[f"vertex.{axis}"][0].astype(np.float64) for axis in "xyz"], axis=1)
    name = next(name for name in PLY_INDICES if f"face.{name}" in columns)
    corners, sizes = columns[f"face.{name}"]
    if len(sizes) and sizes.min() < 3:
        number = int(sizes.argmin())
        raise UnreadableError(f"face {number + 1}: a face of {sizes[number]} corners")
    numbers = np.arange(1, len(sizes) + 1)
    return _cut(vertices, corners.astype(np.int64), sizes.astype(np.int64), numbers, "face")


def _ply_rows(body: memoryview, element: Element, order: str) -> tuple[int, int, dict[str, Lists]]:
    """Return how many rows of an element are there, their bytes, and each property's values.

    The values of a list stand in a row, with how many there are in each list.
    """
    fields = list[tuple[str, str, tuple[int, ...]]]()
    sizes = dict[str, int]()
    for name, (kind, length) in element.properties.items():
        if length is None:
            fields.append((name, order + kind, ()))
            continue
        here = np.dtype(fields).itemsize  # of the first row, whose lists have the length of most
        first = body[here : here + np.dtype(length).itemsize]
        if element.count and len(first) < np.dtype(length).itemsize:
            return 0, 0, {}
        size = int(np.frombuffer(first, order + length)[0]) if element.count else 0
        if not 0 <= size <= len(body):
            raise UnreadableError(f"a list {name} of {size:,} values, more than the file has bytes")
        sizes[name] = size
        fields += [(f"{name}, length", order + length, ()), (name, order + kind, (size,))]
    kinds = np.dtype(fields)
    count = min(element.count, len(body) // kinds.itemsize)
    rows = np.frombuffer(body[: count * kinds.itemsize], kinds) if count else np.zeros(0, kinds)
    mixed = any((rows[f"{name}, length"] != size).any() for name, size in sizes.items())
    if mixed or (sizes and count < element.count):  # the lists of the last rows may be shorter
        return _ply_mixed(body, element, order)
    lists = {
        name: (rows[name].ravel(), np.full(count, sizes.get(name, 1)))
        for name in element.properties
    }
    return count, rows.nbytes, lists


def _ply_mixed(body: memoryview, element: Element, order: str) -> tuple[int, int, dict[str, Lists]]:
    """Read the rows of an element one by one: lists of several lengths."""
    at = 0
    pieces = {name: list[memoryview]() for name in element.properties}
    sizes = {name: array("q") for name in element.properties}
    endian: Literal["little", "big"] = "little" if order == "<" else "big"
    for row in range(element.count):
        for name, (kind, length) in element.properties.items():
            size = 1
            if length is not None:
                head = body[at : at + np.dtype(length).itemsize]
                if len(head) < np.dtype(length).itemsize:
                    return row, at, {}
                size = int.from_bytes(head, endian, signed=length[0] == "i")
                at += len(head)
            end = at + size * np.dtype(kind).itemsize
            if size < 0 or end > len(body):
                return row, at, {}
            pieces[name].append(body[at:end])
            sizes[name].append(size)
            at = end
    lists = {
        name: (np.frombuffer(b"".join(pieces[name]), order + kind), np.array(sizes[name]))
        for name, (kind, _) in element.properties.items()
    }
    return element.count, at, lists


def read_stl(content: bytes) -> Triangles:
    """Read an STL file, binary or ASCII; every triangle has three vertices of its own."""
    header = content[:STL_HEADER]
    count = int.from_bytes(header[80:84], "little")
    more = len(content) - STL_HEADER - count * STL_FACE.itemsize
    if len(header) < STL_HEADER or (more and b"\0" not in content):
        return _stl_text(_rows(content))
    if more:
        there = (len(content) - STL_HEADER) // STL_FACE.itemsize
        raise UnreadableError(
            f"cut off: {there:,} of {count:,} faces"
            if more < 0
            else f"{more:,} bytes more than its {count:,} faces take"
        )
    rows = np.frombuffer(content[STL_HEADER:], STL_FACE) if count else np.zeros(0, STL_FACE)
    return _soup(rows["corners"].astype(np.float64))


def _soup(corners: Floats) -> Triangles:
    """Return triangles that each have three vertices of their own."""
    vertices = corners.reshape(-1, 3)
    return Triangles(vertices, np.arange(len(vertices)).reshape(-1, 3))


def _stl_text(rows: Rows) -> Triangles:
    positions = array("d")
    opened = dict.fromkeys((b"solid", b"facet"), 0)
    closed = dict.fromkeys((b"endsolid", b"endfacet"), 0)
    for line, words in rows:
        word = words[0].lower()
        if word != b"solid" and not opened[b"solid"]:
            begins = f"it begins with {_quoted(words[0])}, not with solid"
            raise UnreadableError(f"line {line}: {begins}, and is no whole binary STL file")
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
    return _soup(np.array(positions, np.float64))


def read_gifti(content: bytes) -> Triangles:
    """Read the first array of points and the first of triangles of a GIfTI file, by nibabel."""
    with needed_by("reading GIfTI"):
        from nibabel.gifti import GiftiImage
    try:
        image = GiftiImage.from_bytes(content)
        if image is None:
            raise UnreadableError("no GIfTI file: it is XML without an element GIFTI")
        points, triangles = (
            [array.data for array in image.get_arrays_from_intent(intent)]
            for intent in ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE")
        )
    except GIFTI_ERRORS as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise UnreadableError(f"cut off or no GIfTI file ({said})") from error
    if not points:
        raise UnreadableError("it has no points: values on a surface that is another file, perhaps")
    vertices = _gifti_rows(points[0], "points", "fiu").astype(np.float64)
    if not triangles:
        raise _without_faces(len(vertices))
    faces = _gifti_rows(triangles[0], "triangles", "iu").astype(np.int64)
    return _cut(vertices, faces.ravel(), np.full(len(faces), 3), np.arange(len(faces)), "triangle")


def _gifti_rows(data: NDArray[Any] | None, what: str, kinds: str) -> NDArray[Any]:
    """Return an array of GIfTI if it has rows of three numbers of these kinds of dtype."""
    if data is None:
        raise UnreadableError(f"no GIfTI file: its {what} are without data")
    if data.ndim == 2 and data.shape[1] == 3 and data.dtype.kind in kinds:
        return data
    shape = " x ".join(map(str, data.shape))
    rows = "rows of three numbers" if "f" in kinds else "rows of three whole numbers"
    raise UnreadableError(
        f"no GIfTI file of triangles: its {what} are {shape} of {data.dtype}, not {rows}"
    )


def read_freesurfer(content: bytes) -> Triangles:
    """Read a triangle surface of FreeSurfer: a magic number, a line, counts, points, triangles."""
    if not content.startswith(TRIANGLES):
        raise UnreadableError(_other_freesurfer(content))
    end = content.find(b"\n\n")
    if end < 0:
        raise UnreadableError(f"cut off: {len(content):,} bytes, and no number of vertices")
    start = end + 2
    n, m = (
        int(count) for count in np.frombuffer(content[start : start + 8].ljust(8, b"\0"), ">i4")
    )
    middle, last = start + 8 + 12 * n, start + 8 + 12 * (n + m)
    if min(n, m) < 0 or len(content) < last:  # what stands after it says how it was made
        raise UnreadableError(f"cut off: {len(content):,} of {last:,} bytes")
    vertices = np.frombuffer(content[start + 8 : middle], ">f4").astype(np.float64).reshape(-1, 3)
    faces = np.frombuffer(content[middle:last], ">i4").astype(np.int64)
    return _cut(vertices, faces, np.full(m, 3), np.arange(m), "triangle")


def _other_freesurfer(content: bytes) -> str:
    """Return what a file is that FreeSurfer's surfaces are named like, and what helps.

    Files of values have the first bytes of old quads. Their sizes differ: 3 bytes, then three
    numbers of 4 and the values of 4; or 3 bytes, two numbers of 3, then 6 a vertex and 12 a quad.
    """
    head = content[3:15].ljust(12, b"\0")
    values, _, columns = (int.from_bytes(head[i : i + 4], "big") for i in (0, 4, 8))
    n, m = (int.from_bytes(head[i : i + 3], "big") for i in (0, 3))
    old = content.startswith(OLD_QUADS)
    if old and len(content) == 15 + 4 * values * columns:
        return f"it has {VALUES_ALONE}"
    if content.startswith(QUADS) or (old and len(content) >= 9 + 6 * n + 12 * m):
        return (
            "a FreeSurfer surface of quads: convert it into triangles, as by "
            "`mris_convert lh.orig lh.orig.gii`"
        )
    return "it does not begin as a triangle surface of FreeSurfer does"


READERS: dict[str, Callable[[bytes], Triangles]] = {
    ".obj": read_obj,
    ".off": read_off,
    ".ply": read_ply,
    ".stl": read_stl,
    ".gii": read_gifti,
    **dict.fromkeys(FREESURFER, read_freesurfer),
}
SUFFIXES = tuple(READERS)


def _cut(
    vertices: Floats,
    corners: Int64s,
    sizes: Int64s,
    numbers: Int64s,
    unit: str = "line",
) -> Triangles:
    """Return the triangles of polygons, as :func:`polygons.triangles`; ``unit`` is of numbers."""
    try:
        return Triangles(vertices, *polygons.triangles(vertices, corners, sizes, numbers))
    except PolygonError as error:
        raise UnreadableError(f"{unit} {error.number}: {error.detail}") from error


def _continued(content: bytes) -> bytes:
    """Return OBJ text with the lines that end in a backslash joined, and as many lines as before.

    A line that goes on is put at its end, so that numbers of lines stay right.
    """
    if b"\\" not in content:
        return content
    lines, begun = list[bytes](), b""
    for number, line in enumerate(content.splitlines(), start=1):
        text = line.partition(b"#")[0].rstrip()
        words = text.split(maxsplit=1) if begun else []
        if words and words[0] in OBJ_NUMBERS | {b"f"}:  # behind a name such as C:\ it is lost
            raise UnreadableError(
                f"line {number}: {_quoted(words[0])} must begin a line of its own, and the line "
                "before goes on: take the backslash at its end away"
            )
        text = begun + text
        goes_on = text.endswith(b"\\")
        begun = text[:-1] + b" " if goes_on else b""
        lines.append(b"" if goes_on else text)
    return b"\n".join([*lines, begun])


def _rows(content: bytes, first: int = 1) -> Rows:
    """Yield the number and words of each line that has any, comments left out.

    Lines end as in universal newlines, and in one file they may end in several ways.
    """
    content = content.removeprefix(codecs.BOM_UTF8)
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
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
        raise UnreadableError(f"line {line}: {_quoted(*words)} are no three numbers") from error
    if b"_" in b"".join(words):  # which Python reads over
        raise UnreadableError(f"line {line}: {_quoted(*words)} are no three numbers")
    return x, y, z


def _integers(words: Sequence[bytes], line: int) -> list[int]:
    try:
        numbers = [int(word) for word in words]
    except ValueError as error:
        raise UnreadableError(f"line {line}: {_quoted(*words)}: no whole numbers") from error
    if b"_" in b"".join(words):
        raise UnreadableError(f"line {line}: {_quoted(*words)}: no whole numbers")
    return numbers


def _quoted(*words: bytes) -> str:
    """Return words of a file for a message: short, and nothing that cannot be printed."""
    return ascii(b" ".join(words)[:40].decode("latin-1"))
