"""Files of each format: read as they stand, or refused with what is wrong and where."""

import codecs
import gzip
import io
import itertools

import numpy as np
import pytest
import trimesh

from evidence.fuzz_import import FORMATS
from synthnet.mesh import formats
from synthnet.mesh.formats import UnreadableError, read

SPHERE = trimesh.creation.icosphere(subdivisions=1)
POINTS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"  # a square
HALVES = [[0, 1, 2], [0, 2, 3]]
VERTICES = "".join(f"v {line}\n" for line in POINTS.splitlines())
PLY = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
PLY += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
FACET = "facet normal 0 0 1\nouter loop\n" + "vertex 1 2 3\n" * 3 + "endloop\nendfacet\n"


def content(name):
    made = SPHERE.export(**FORMATS[name])
    return made.encode() if isinstance(made, str) else made


def suffix(name):
    return f".{name.rpartition('.')[2]}"


def faces_of(text, kind=".obj"):
    return read(text.encode(), kind).faces.tolist()


def refused(text, kind):
    with pytest.raises(UnreadableError) as error:
        read(text.encode() if isinstance(text, str) else text, kind)
    (line,) = str(error.value).splitlines()
    assert line.isprintable()
    return line


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_read(name):
    mesh = read(content(name), suffix(name))
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)
    np.testing.assert_allclose(mesh.vertices[mesh.faces], SPHERE.triangles, atol=1e-6)
    if not name.endswith("stl"):
        np.testing.assert_array_equal(mesh.faces, SPHERE.faces)


@pytest.mark.parametrize("name", sorted(set(FORMATS) - {"obj"}))
def test_no_file_that_was_cut_off_is_read(name):
    """But within the digits of the last number, or the blanks and the name at the end."""
    whole = content(name)
    end = len(whole.rstrip().removesuffix(b"endsolid")) if name == "ascii.stl" else len(whole)
    if name in ("off", "ascii.ply"):
        end = len(whole.rstrip().rstrip(b"0123456789"))
    assert end > 300
    for size in {*range(0, end, end // 300), *range(end - 120, end)}:
        refused(whole[:size], suffix(name))


@pytest.mark.parametrize("name", ["off", "ascii.ply", "ascii.stl"])
def test_a_line_that_is_gone_or_there_twice_is_seen(name):
    lines = content(name).splitlines(keepends=True)
    assert len(lines) > 100
    for i, line in enumerate(lines):
        if not line.strip() or line.split()[0] in (b"ply", b"outer", b"endloop", b"comment"):
            continue
        refused(b"".join(lines[:i] + lines[i + 1 :]), suffix(name))
        if line.split()[0] not in (b"OFF", b"format", b"end_header"):
            refused(b"".join([*lines[:i], line, *lines[i:]]), suffix(name))


def test_obj_counts_from_1_or_back_from_the_last_vertex_so_far():
    text = VERTICES + "f -4 -3 -2\nv 9 9 9\nf 1/7 3//2 4/1/1 # a comment\nf -5 4 5\n"
    assert faces_of(text) == [*HALVES, [0, 3, 4]]


@pytest.mark.parametrize("name", [name for name in FORMATS if not name.startswith("binary")])
@pytest.mark.parametrize("start", [codecs.BOM_UTF8, codecs.BOM_UTF8 + b"# made by hand\n\n"])
def test_text_may_begin_with_a_mark_of_its_bytes_order(name, start):
    if name == "ascii.ply":  # whose first word is ply
        start = codecs.BOM_UTF8
    mesh, expected = read(start + content(name), suffix(name)), read(content(name), suffix(name))
    np.testing.assert_array_equal(mesh.vertices, expected.vertices)
    np.testing.assert_array_equal(mesh.faces, expected.faces)


def test_obj_is_read_alone():
    text = "mtllib missing.mtl\nvt 0 0\nvn 0 0 1\no a\ng b\nusemtl c\ns off\nv 5 5 5 1 0 0\n"
    mesh = read((text + VERTICES + "f 2 3 4\nl 1 2\np 1\n").encode(), ".obj")
    assert len(mesh.vertices) == 5  # the loose one too
    assert mesh.faces.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_lines_end_in_any_way(newline):
    ply = PLY + POINTS + "3 0 1 2\n"
    texts = {".obj": VERTICES + "f 1 2 3\n", ".off": f"OFF\n4 1 0\n{POINTS}3 0 1 2\n", ".ply": ply}
    for kind, text in {**texts, ".stl": f"solid\n{FACET}endsolid\n"}.items():
        assert len(faces_of(text.replace("\n", newline), kind)) == 1
    early = ply.replace("3 0 1 2", "3 0 1").replace("\n", newline)
    assert refused(early, ".ply").endswith("line 14 ends early")


@pytest.mark.parametrize("kind", [".obj", ".off", ".ply", ".stl"])
def test_lines_of_one_file_end_in_several_ways(kind):
    text = {
        ".obj": VERTICES + "f 1 2 3\n",
        ".off": f"OFF\n4 1 0\n{POINTS}3 0 1 2\n",
        ".ply": PLY + POINTS + "3 0 1 2\n",
        ".stl": f"solid\n{FACET}endsolid\n",
    }[kind]
    lines, whole = text.split("\n"), faces_of(text, kind)
    for odd in range(len(lines) - 1):
        for end, others in itertools.permutations(("\n", "\r\n", "\r"), 2):
            ends = [end if i == odd else others for i in range(len(lines))]
            mixed = "".join(map("".join, zip(lines, ends, strict=True)))
            assert faces_of(mixed, kind) == whole


@pytest.mark.parametrize("before", ["v 5 5 5", "v 5 5 5 1 0 0", "vn 0 0 1", "l 1 2", "s off"])
def test_a_line_of_obj_that_has_lost_its_end_is_refused(before):
    text = f"{VERTICES}{before}\nf 1 2 3\nf 1 3 4\n"
    assert faces_of(text, ".obj") == HALVES
    message = "line 5: 'f' must begin a line of its own"
    assert refused(text.replace("\nf", " f", 1), ".obj") == message


@pytest.mark.parametrize("name", [r"usemtl mat", r"mtllib C:\models", "o a", "g", "v 5 5"])
def test_a_line_that_goes_on_takes_no_vertex_or_face_away(name):
    for line in ("f 1 2 3", "v 7 7 7"):
        text = f"{VERTICES}{name}\\\n{line}\nf 1 3 4\n"
        message = f"line 6: '{line[0]}' must begin a line of its own, and the line before goes on"
        assert refused(text, ".obj") == f"{message}: take the backslash at its end away"


@pytest.mark.parametrize("newline", [b"\n", b"\r\n"])
def test_binary_ply_begins_after_the_line_end_header(newline):
    header, end, body = content("binary.ply").partition(b"end_header\n")
    header = header.replace(b"element vertex", b"comment before end_header\nelement vertex", 1)
    whole = (header + end).replace(b"\n", newline) + body
    np.testing.assert_array_equal(read(whole, ".ply").faces, SPHERE.faces)


@pytest.mark.parametrize("end", ["", "\n"])
def test_off_may_have_all_vertices_on_a_line_and_all_faces(end):
    points = " ".join(POINTS.split())
    mesh = read(f"OFF\n4 3 0\n{points}\n3 0 1 2 3 0 2 3 4 0 1 2 3{end}".encode(), ".off")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == HALVES + HALVES
    for faces in ("3 0 1 2 3 0 2 3", "3 0 1 2 0.5 1 0 1\n3 0 2 3 9\n"):
        assert faces_of(f"OFF\n4 2 0\n{points}\n{faces}", ".off") == HALVES


@pytest.mark.parametrize("head", ["OFF\n4 1 0", "OFF 4 1 0", "OFF4 1 0", "# c\n\nCOFF # c\n4 1"])
def test_off_headers(head):
    assert faces_of(f"{head}\n{POINTS}4 0 1 2 3 255 0 0\n", ".off") == HALVES


def test_three_vertices_of_off_may_have_normals_and_colours():
    text = "CNOFF\n3 1 0\n" + "".join(f"{x} {y} 0 0 0 1 255 0 0\n" for x, y in ("00", "10", "11"))
    mesh = read(f"{text}3 0 1 2\n".encode(), ".off")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]


def test_polygons_are_fans_in_the_order_of_the_file():
    hexagon = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3]
    text = "".join(f"v {x} {y} 0\n" for x, y in hexagon) + "f 1 2 3 4 5 6\nf 1 2 3\nf 3 2 1 6\n"
    assert faces_of(text) == [
        *([0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]),
        *([0, 1, 2], [2, 1, 0], [2, 0, 5]),
    ]


@pytest.mark.parametrize(
    ("points", "face", "faces"),
    [
        # an arrow, cut from a side
        ("v 0 0 0\nv 2 0 0\nv 1 .5 0\nv 1 2 0\n", "f 2 3 4 1", [[1, 2, 0], [2, 3, 0]]),
        # three corners in a line: the one in the middle stays, as its neighbours end there
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nv 1 1 0\n", "f 1 2 3 4", [[3, 0, 1], [1, 2, 3]]),
    ],
)
def test_polygons_that_a_fan_cannot_cut_are_cut_by_ears(points, face, faces):
    mesh = read((points + face).encode(), ".obj")
    assert mesh.clipped == 1
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert {frozenset(f) for f in mesh.faces.tolist()} == {frozenset(f) for f in faces}


def comb(teeth):
    """The corners of a comb, counter-clockwise, one of them amid its straight back."""
    up = [(2 * i + dx, y) for i in range(teeth) for dx, y in ((0.6, 0.2), (1.4, 3))]
    return np.array([(2 * teeth, -1), *up[::-1], (0, 3.5), (0, -1), (teeth, -1)], float)


@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_ears_cover_a_polygon_once_and_keep_every_corner(tilt):
    flat = comb(9)
    x, y = flat.T
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    points = np.stack([x, y * np.cos(tilt), y * np.sin(tilt)], axis=1)
    text = "".join(f"v {a:.17g} {b:.17g} {c:.17g}\n" for a, b, c in points)
    mesh = read((text + "f " + " ".join(map(str, range(1, len(x) + 1)))).encode(), ".obj")
    assert (mesh.clipped, len(mesh.faces)) == (1, len(x) - 2)
    assert set(mesh.faces.ravel().tolist()) == set(range(len(x)))
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area)
    assert np.linalg.norm(normals.sum(axis=0)) == pytest.approx(area)  # all face one way


def test_a_polygon_that_crosses_itself_is_refused():
    message = refused(VERTICES + "f 1 2 4\nf 1 2 4 3", ".obj")  # a bow tie
    assert message == "line 6: a polygon that crosses itself or has no area"


# They cross themselves, though all triangles of the fan, or of ears, face one way.
CROSSING = {
    "fan": [(2, 3), (4, 5), (1, 3), (4, 1), (2, 5)],
    "ears": [(1, 4), (4, 3), (2, 2), (5, 4), (2, 0)],
    "spiral": [(0, 0), (1, 0), (0, 1), (-1.2, 0), (0, -1.4), (1.6, 0.1), (-0.1, 1.8)],
}


def polygon(points, tilt):
    """OBJ text of one polygon, turned about the x-axis."""
    text = "".join(f"v {x} {y * np.cos(tilt)} {y * np.sin(tilt)}\n" for x, y in points)
    return text + "f " + " ".join(map(str, range(1, len(points) + 1)))


@pytest.mark.parametrize("name", CROSSING)
@pytest.mark.parametrize("tilt", [0.0, 1.0])
def test_a_polygon_that_crosses_itself_is_refused_though_it_could_be_cut(name, tilt):
    points = CROSSING[name]
    assert refused(polygon(points, tilt), ".obj") == (
        f"line {len(points) + 1}: a polygon that crosses itself: save it as triangles"
    )


def test_a_polygon_is_refused_if_and_only_if_it_crosses_itself():
    """Random ones, against every two of their sides, as exact integers."""
    rng, outcomes = np.random.default_rng(0), set()
    for _ in range(400):
        points = rng.integers(0, 10**6, (int(rng.integers(4, 8)), 2))
        sides = [(points[i - 1], points[i]) for i in range(len(points))]
        crosses = any(beside(*a, *b) and beside(*b, *a) for a in sides for b in sides)
        if crosses:
            assert "a polygon that crosses itself" in refused(polygon(points, 0.0), ".obj")
        else:
            assert len(faces_of(polygon(points, 0.0))) == len(points) - 2
        outcomes.add(crosses)
    assert outcomes == {True, False}


def beside(start, end, first, second):
    """Whether two points of whole numbers lie on either side of a line."""
    (a, b), (c, d) = start.tolist(), end.tolist()
    one, other = ((c - a) * (y - b) - (d - b) * (x - a) for x, y in (first, second))
    return (one > 0 > other) or (one < 0 < other)


@pytest.mark.parametrize(
    "points",
    [
        # A square with a square hole, joined to its rim by a side that is there twice.
        [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)],
        # A corner that touches another side, but for rounding
        [(0, 0), (2, 0), (2, 2), (1, 1e-7), (0, 2)],
    ],
)
def test_a_polygon_that_touches_itself_is_cut(points):
    assert len(faces_of(polygon(points, 0.0))) == len(points) - 2


@pytest.mark.parametrize(
    "points",
    [
        # Four corners on a straight side, of which rounding puts some beside it
        [(0.6, 1.5), (0.2, 0.9), (-0.2, 0.3), (-0.6, -0.3), (2.7, 1.8)],
        # One position twice in a row, as of another vertex
        [(0, 0), (1, 0), (1, 0), (1, 1), (0, 1)],
        # The same at the end of a ring that is not convex
        [(2, 0), (1, 0.5), (1, 2), (0, 0), (2, 0)],
    ],
)
def test_corners_on_a_straight_side_or_there_twice_are_kept_and_cover_it_once(points):
    mesh = read(polygon(points, 0.0).encode(), ".obj")
    assert mesh.clipped == 1
    assert set(mesh.faces.ravel().tolist()) == set(range(len(points)))
    corners, flat = mesh.vertices[mesh.faces], np.array(points, float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    (x, y), (u, v) = flat.T, np.roll(flat, -1, axis=0).T
    area = abs(np.sum(x * v - y * u)) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area)
    assert np.linalg.norm(normals.sum(axis=0)) == pytest.approx(area)


def test_a_ring_that_names_its_first_vertex_again_is_cut():
    text = "v 0 0 0\nv 2 0 0\nv 1 .5 0\nv 1 2 0\nf 2 3 4 1 2\n"
    good = [face for face in faces_of(text) if len(set(face)) == 3]
    assert {frozenset(face) for face in good} == {frozenset((0, 1, 2)), frozenset((0, 2, 3))}


@pytest.mark.parametrize("scale", [1e-90, 1.0, 1e90])
def test_a_polygon_of_any_size_is_cut_without_a_warning(scale):
    points = np.array([(2, 0), (0.5, 0.5), (0, 2), (0, 0), (1, -1)]) * scale
    assert len(faces_of(polygon(points.tolist(), 1.0))) == 3


def test_a_coordinate_whose_square_overflows_is_left_to_repair():
    text = "v 2 0 0\nv .5 .5 0\nv 0 2 0\nv 0 0 0\nv 1 1e300 0\nf 1 2 3 4 5\n"
    assert faces_of(text) == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]


def test_arrow_is_cut_from_its_inner_corner_or_its_tip():
    text = "v 0 0 0\nv 2 0 0\nv 1 .5 0\nv 1 2 0\nf 3 4 1 2\nf 1 2 3 4\n"
    assert faces_of(text) == [[2, 3, 0], [2, 0, 1], *HALVES]


def test_polygons_that_name_a_vertex_twice_are_left_to_repair():
    assert faces_of(VERTICES + "f 1 2 3 3") == [[0, 1, 2], [0, 2, 2]]


def binary_ply(faces, rows, order="<"):
    name = {"<": "little", ">": "big"}[order]
    header = f"ply\nformat binary_{name}_endian 1.0\ncomment c\nelement vertex 4\n"
    header += f"property double x\nproperty float y\nproperty short z\n{faces}end_header\n"
    kinds = np.dtype([("x", order + "f8"), ("y", order + "f4"), ("z", order + "i2")])
    points = np.array([tuple(map(float, p.split())) for p in POINTS.splitlines()], kinds)
    return header.encode() + points.tobytes() + rows


LIST = "element face 2\nproperty list uchar short vertex_index\nproperty uchar red\n"


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_of_any_kinds_and_order(order):
    kinds = np.dtype([("n", "u1"), ("i", order + "i2", 4), ("red", "u1")])
    rows = np.array([(4, [0, 1, 2, 3], 7), (4, [3, 2, 1, 0], 7)], kinds).tobytes()
    mesh = read(binary_ply(LIST, rows, order), ".ply")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [*HALVES, [3, 2, 1], [3, 1, 0]]


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_ply_of_polygons_of_several_sizes(order):
    rows = b"".join(
        bytes([len(face)]) + np.array(face, order + "i2").tobytes() + b"\x07"
        for face in ([0, 1, 2, 3], [3, 2, 1])
    )
    assert read(binary_ply(LIST, rows, order), ".ply").faces.tolist() == [*HALVES, [3, 2, 1]]


def test_ascii_ply_with_other_elements_and_properties():
    text = PLY.replace("element face 1\n", "element camera 1\nproperty float f\nelement face 1\n")
    more = "property uchar red\nproperty list uchar float uv\nproperty list"
    text = text.replace("property list", more)
    text += POINTS + "50.0\n255 2 0.5 0.5 4 0 1 2 3\n"
    assert faces_of(text, ".ply") == HALVES


def test_ascii_stl_of_two_solids_and_any_names():
    text = f"solid vertex of a facet\n{FACET}endsolid\nSOLID b\n{FACET.upper()}ENDSOLID b\n"
    mesh = read(text.encode(), ".stl")
    assert (mesh.vertices == [1, 2, 3]).all()
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_binary_stl_may_begin_with_solid():
    whole = b"solid".ljust(80) + content("binary.stl")[80:]
    assert len(read(whole, ".stl").faces) == 80


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        (".obj", "", "the file is empty"),
        (".obj", "# nothing", "an empty mesh"),
        (".obj", VERTICES, "a point cloud: 4 points and no faces, or cut off"),
        (".off", f"OFF\n4 0 0\n{POINTS}", "a point cloud: 4 points and no faces"),
        (".off", "OFF\n0 0 0\n", "an empty mesh"),
        (".ply", PLY[: PLY.index("element face")] + "end_header\n" + POINTS, "a point cloud: 4"),
        (".ply", PLY.replace("element face", "element tristrips"), "its faces are strips"),
        (".obj.gz", "no gzip", "cut off or no gzip file"),
        (".gii", "<GIFTI>", "cut off or no GIfTI file"),
        (".pial", "nothing", "it does not begin as a triangle surface of FreeSurfer does"),
        (".obj", VERTICES + "f 1 2 0\n", "line 5: vertex 0, but OBJ counts from 1"),
        (".obj", VERTICES + "f 1 2 9\n", "line 5: a corner is none of the 4 vertices"),
        (".obj", VERTICES + "f 1 2 -5\n", "line 5: a corner is none of the 4 vertices"),
        (".obj", VERTICES + "f 1 2\n", "line 5: a face of 2 corners"),
        (".obj", VERTICES + "f 1 2 x\n", "line 5: '1 2 x': no whole numbers"),
        (".obj", VERTICES + "f 1 2 1_0\n", "line 5: '1 2 1_0': no whole numbers"),
        (".obj", VERTICES + f"f 1 2 {2**64}\n", "line 5: no vertex has a number that large"),
        (".obj", VERTICES + "w 1 2 3\n", "line 5: 'w' begins no line of an OBJ file"),
        (".obj", "call other.obj\n", "line 1: 'call' begins no line of an OBJ file"),
        (".obj", "v 0 0\n", "line 1: '0 0' are no three numbers"),
        (".obj", "\nv 0 0 1_0\n", "line 2: '0 0 1_0' are no three numbers"),
        (".obj", b"v 0 \xff\x1b 0\n", r"line 1: '0 \xff\x1b 0' are no three numbers"),
        (".off", "#", "line 1: it begins with '', not with OFF"),
        (".off", "4OFF\n", "line 1: it begins with '4OFF', not with OFF"),
        (".off", "OFF BINARY\n", "a binary OFF file: save it as text"),
        (".off", "OFF BINARI x\n", "line 1: 'BINARI x': no whole numbers"),
        (".off", "OFF\n-3 1 0\n", "line 2: -3 vertices and 1 faces: a number below zero"),
        (".off", "OFF\n4 -1 0\n" + POINTS, "line 2: 4 vertices and -1 faces: a number below"),
        (".off", "OFF\n9 1 0\n" + 5 * "0 0 1 ", "line 3: 15 values of one vertex: save each"),
        (".off", f"OFF\n4 9 0\n{POINTS}" + 5 * "3 0 1 2 ", "line 7: 20 values of one face: save"),
        (".off", "OFF\n4\n", "line 2: the numbers of vertices and faces are missing"),
        (".off", "OFF\n9 1 0\n" + POINTS, "cut off: 4 of 9 vertices"),
        (".off", f"OFF\n4 1200 0\n{POINTS}3 0 1 2\n", "cut off: 1 of 1,200 faces"),
        (".off", f"OFF\n4 2 0\n{POINTS}3 0 1 2\n3 0 2\n", "cut off: 1 of 2 faces, line 8 ends"),
        (".off", f"OFF\n4 1 0\n{POINTS}3 0 1 2\n3 0 2 3\n", "line 8: it comes after the 1 faces"),
        (".off", f"OFF\n4 1 0\n{POINTS}3 0 1 7\n", "line 7: a corner is none of the 4 vertices"),
        (".off", f"OFF\n4 1 0\n{POINTS}-3 0 1 2\n", "line 7: a face of 0 corners"),
        (".ply", "no ply", "it has no PLY header from ply to end_header"),
        (".ply", PLY.replace("end_header", "comment end_header"), "it has no PLY header from ply"),
        (".ply", PLY.replace("ascii", "asci"), "line 2: 'format asci 1.0' is of no PLY header"),
        (".ply", PLY.replace("float x", "flaot x"), "line 4: 'property flaot x' is of no PLY"),
        (".ply", PLY.replace("float y", "float x"), "line 5: the property 'x' again"),
        (".ply", PLY.replace("format ascii 1.0\n", ""), "its header has no format"),
        (".ply", PLY.replace("float y", "float t"), "no properties x, y and z of the vertices"),
        (".ply", PLY.replace("vertex_indices", "v"), "no faces with one list vertex_indices"),
        (".ply", PLY.replace("list uchar ", ""), "vertex_indices that are no list of whole"),
        (".ply", PLY.replace("uchar int", "uchar float"), "vertex_indices that are no list of"),
        (".ply", PLY + POINTS, "cut off: 0 of 1 faces"),
        (".ply", PLY + POINTS + "3 0 1\n", "cut off: 0 of 1 faces, line 14 ends early"),
        (".ply", PLY + POINTS + "3 0 1 2 3\n", "line 14: 5 values instead of 4"),
        (".ply", PLY + POINTS + "3 0 1 2\n1\n", "line 15: it comes after all that its header"),
        (".ply", binary_ply(LIST, b""), "cut off: 0 of 2 faces, as its header has"),
        (
            ".ply",
            binary_ply(LIST.replace("property uchar red\n", ""), bytes([3] + 6 * [0])),
            "cut off: 1 of 2 faces, as its header has",
        ),
        (".ply", binary_ply(LIST, bytes([3] + 7 * [0])), "cut off: 1 of 2 faces, as its header"),
        (".ply", binary_ply(LIST, bytes([3] + 7 * [0]) * 3), "8 bytes more than its header"),
        (
            ".ply",
            binary_ply(LIST, bytes([3, *7 * [0], 4, *7 * [0]])),
            "cut off: 1 of 2 faces, as its header has",
        ),
        (
            ".ply",
            binary_ply(LIST, bytes([3, *7 * [0], 4, *11 * [0]])),
            "2 bytes more than its header declares",
        ),
        (".ply", binary_ply(LIST, bytes([2] + 5 * [0]) * 2), "face 1: a face of 2 corners"),
        (
            ".ply",
            binary_ply(LIST.replace("uchar short", "uint short"), b"\xff" * 40),
            "a list vertex_index of 4,294,967,295 values, more than the file has bytes",
        ),
        (
            ".ply",
            binary_ply(LIST, np.array([3, 0, 9, 0, 0, 0, 0, 0] * 2, "u1").tobytes()),
            "face 1: a corner is none of the 4 vertices",
        ),
        (".stl", bytes(80) + (7).to_bytes(4, "little") + bytes(120), "cut off: 2 of 7 faces"),
        (".stl", bytes(84 + 3), "3 bytes more than its 0 faces take"),
        (".stl", bytes(84), "an empty mesh"),
        (
            ".stl",
            binary_ply(LIST, bytes([3] + 7 * [0]) * 2),
            "by how it begins it is a PLY file: name it .ply",
        ),
        (".ply", f"solid\n{FACET}endsolid", "by how it begins it is an STL file: name it .stl"),
        (".ply", "OFF\n3 1 0\n", "by how it begins it is an OFF file: name it .off"),
        (".off", "<!DOCTYPE html>\n<p>", "by how it begins it is a web page: get the file itself"),
        (".obj", "glTF\2\0\0\0", "by how it begins it is a file of glTF: convert it to PLY"),
        (".stl", 20 * "no mesh ", "line 1: it begins with 'no', not with solid, and is no whole"),
        (".stl", 2 * FACET, "line 1: it begins with 'facet', not with solid"),
        (".stl", f"solid\n{FACET}facet\nvertex 1 2 3\n", "cut off: 1 of 2 faces have their"),
        (".stl", f"solid\n{FACET}vertex 1 2 3\nendsolid", "cut off: 1 of 1 faces have their"),
        (".stl", f"solid\n{FACET}", "cut off: 0 of 1 solids have their endsolid"),
        (".stl", "solid\nfacet\nvertex 1 2 3\nendfacet", "line 4: a facet that has not three"),
        (".stl", "solid\nfacet\nvertex 1 two 3\n", "line 3: '1 two 3' are no three numbers"),
    ],
)
def test_what_is_no_mesh_is_refused(kind, text, message):
    assert message in refused(text, kind)


SQUARE = f"{PLY}{POINTS}3 0 1 2\n".replace("face 1", "face 2")
BAD_CORNER = content("binary.ply")[:-4] + (99).to_bytes(4, "little")
# What is wrong: the format, a file, how many faces trimesh makes of it, why it is refused here.
FORGIVEN = {
    "a line of no keyword": (".obj", VERTICES + "f 1 2 3\nff 1 3 4\n", 1, "'ff' begins no line"),
    "a face of two corners": (".obj", VERTICES + "f 1 2 3\nf 1 3\n", 1, "a face of 2 corners"),
    "a vertex of two numbers": (".obj", VERTICES + "v 1 0\nf 1 2 3\n", 1, "no three numbers"),
    "a face too few": (".off", f"OFF\n4 2 0\n{POINTS}3 0 1 2\n", 1, "cut off: 1 of 2 faces"),
    "a face too many": (".off", f"OFF\n4 1 0\n{POINTS}3 0 1 2\n3 0 2 3\n", 1, "it comes after"),
    "a vertex too few": (".off", f"OFF\n5 2 0\n{POINTS}3 0 1 2\n3 0 2 3\n", 1, "cut off: 1 of 2"),
    "a row too few": (".ply", SQUARE, 1, "cut off: 1 of 2 faces"),
    "a row cut off": (".ply", f"{SQUARE}3 0 2\n", 1, "cut off: 1 of 2 faces, line 15 ends early"),
    "a row too many": (".ply", f"{SQUARE}3 0 2 3\n3 0 1 3\n", 2, "it comes after all"),
    "values too many": (".ply", f"{SQUARE}3 0 2 3 9 9\n", 2, "line 15: 6 values instead of 4"),
    "a corner of no vertex": (".ply", BAD_CORNER, 80, "face 80: a corner is none of the 42"),
    "text cut off": (".stl", f"solid\n{FACET}", 0, "cut off: 0 of 1 solids"),
    "bytes cut off": (".stl", content("binary.stl")[:-10], 0, "cut off: 79 of 80 faces"),
}


@pytest.mark.parametrize("wrong", FORGIVEN)
def test_what_trimesh_forgives_is_refused(wrong):
    """As long as this holds, our own readers have their reason."""
    kind, text, faces, message = FORGIVEN[wrong]
    whole = text if isinstance(text, bytes) else text.encode()
    loaded = trimesh.load(io.BytesIO(whole), file_type=kind[1:], process=False, force="mesh")
    assert len(loaded.faces) == faces
    assert message in refused(whole, kind)


def test_every_reader_of_a_format_that_trimesh_has_is_stricter():
    by_trimesh = {kind for kind in formats.READERS if kind[1:] in trimesh.available_formats()}
    assert {kind for kind, *_ in FORGIVEN.values()} == by_trimesh


def test_freesurfer_s_corners_are_checked_which_nibabel_takes(tmp_path):
    freesurfer = pytest.importorskip("nibabel").freesurfer
    path = tmp_path / "lh.pial"
    freesurfer.write_geometry(path, SPHERE.vertices, np.append(SPHERE.faces, [[0, 1, 99]], axis=0))
    assert freesurfer.read_geometry(path)[1].max() == 99
    assert refused(path.read_bytes(), ".pial") == "triangle 80: a corner is none of the 42 vertices"


def test_lines_of_obj_that_go_on_are_joined():
    text = VERTICES + "f 1 2 \\\n3\nf 1 \\\n 3 \\\n4\n"
    assert faces_of(text) == HALVES
    assert refused(text + "f 1 2 9\n", ".obj").startswith("line 10: ")


@pytest.mark.parametrize("kind", [*formats.READERS, ".obj.gz"])
def test_a_pointer_of_git_lfs_is_named(kind):
    text = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
    text = gzip.compress(text) if kind.endswith(".gz") else text
    line = "a pointer of Git LFS in the place of the file: run `git lfs pull`"
    assert refused(text, kind) == line


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("name", [name for name in FORMATS if not name.startswith("binary")])
def test_text_in_utf_16_is_named(name, encoding):
    text = ("\ufeff" + content(name).decode()).encode(encoding)
    assert refused(text, suffix(name)) == "text in UTF-16: save it as UTF-8"


def test_gifti_may_be_utf_16_and_binary_stl_begin_with_its_mark():
    assert "no GIfTI file: it is XML without" in refused("<a/>".encode("utf-16"), ".gii")
    whole = b"\xff\xfe by a scanner".ljust(80) + content("binary.stl")[80:]
    assert len(read(whole, ".stl").faces) == 80


@pytest.mark.parametrize("name", FORMATS)
def test_compressed_files_are_read_whole_or_not_at_all(name):
    whole = gzip.compress(content(name), mtime=0)
    mesh, expected = read(whole, suffix(name) + ".gz"), read(content(name), suffix(name))
    np.testing.assert_array_equal(mesh.faces, expected.faces)
    assert "cut off or no gzip file" in refused(whole[:-40], suffix(name) + ".gz")


def test_gifti():
    gifti = pytest.importorskip("nibabel").gifti
    arrays = [
        gifti.GiftiDataArray(SPHERE.vertices.astype(np.float32), "NIFTI_INTENT_POINTSET"),
        gifti.GiftiDataArray(SPHERE.faces.astype(np.int32), "NIFTI_INTENT_TRIANGLE"),
    ]
    whole = gifti.GiftiImage(darrays=arrays).to_bytes()
    mesh = read(whole, ".gii")
    np.testing.assert_array_equal(mesh.faces, SPHERE.faces)
    np.testing.assert_allclose(mesh.vertices, SPHERE.vertices, atol=1e-6)
    assert "cut off or no GIfTI file" in refused(whole[: len(whole) // 2], ".gii")
    values = gifti.GiftiImage(darrays=arrays[:1]).to_bytes()
    assert "a point cloud: 42 points" in refused(values, ".gii")
    assert "it has no points" in refused(gifti.GiftiImage(darrays=arrays[1:]).to_bytes(), ".gii")


@pytest.mark.parametrize(
    ("points", "triangles", "message"),
    [
        (np.eye(4)[:, :3], [[0, 1, 2, 3]], "its triangles are 1 x 4 of int32, not rows of three"),
        (np.eye(4)[:, :3], [[0, 1, 2, 3]] * 3, "its triangles are 3 x 4 of int32, not rows of"),
        (np.eye(4)[:, :3], [0, 1, 2], "its triangles are 3 of int32, not rows of three whole"),
        (np.eye(6)[:, :2], [[0, 1, 2]], "its points are 6 x 2 of float32, not rows of three"),
        (np.eye(4)[:, :2], [[0, 1, 2]], "its points are 4 x 2 of float32, not rows of three"),
    ],
)
def test_gifti_of_other_arrays_is_refused(points, triangles, message):
    gifti = pytest.importorskip("nibabel").gifti
    arrays = [
        gifti.GiftiDataArray(np.array(points, np.float32), "NIFTI_INTENT_POINTSET"),
        gifti.GiftiDataArray(np.array(triangles, np.int32), "NIFTI_INTENT_TRIANGLE"),
    ]
    whole = gifti.GiftiImage(darrays=arrays).to_bytes()
    assert refused(whole, ".gii").startswith(f"no GIfTI file of triangles: {message}")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<html><body/></html>", "by how it begins it is a web page: get the file itself"),
        ("<body/>", "no GIfTI file: it is XML without an element GIFTI"),
        ("<Data>1 2</Data>", "cut off or no GIfTI file ("),
        ("<GIFTI><Name>a</Name></GIFTI>", "cut off or no GIfTI file (GiftiParseError)"),
        ("<GIFTI><CoordinateSystemTransformMatrix/></GIFTI>", "cut off or no GIfTI file ("),
        (
            f'<GIFTI><DataArray Dimensionality="1" Dim0="{2**70}"><Data>1</Data>'
            "</DataArray></GIFTI>",
            "cut off or no GIfTI file (",
        ),
        ('<?xml version="1.0" encoding="no"?><GIFTI/>', "cut off or no GIfTI file ("),
        (
            '<GIFTI><DataArray Intent="NIFTI_INTENT_POINTSET"/></GIFTI>',
            "no GIfTI file: its points are without data",
        ),
    ],
)
def test_xml_that_is_no_gifti_is_refused(text, message):
    pytest.importorskip("nibabel")
    assert refused(text, ".gii").startswith(message)


def test_freesurfer(tmp_path):
    freesurfer = pytest.importorskip("nibabel").freesurfer
    path = tmp_path / "lh.pial"
    freesurfer.write_geometry(path, SPHERE.vertices, SPHERE.faces)
    whole = path.read_bytes()
    mesh = read(whole, ".pial")
    np.testing.assert_array_equal(mesh.faces, SPHERE.faces)
    np.testing.assert_allclose(mesh.vertices, SPHERE.vertices, atol=1e-6)
    end = len(whole) - whole[::-1].index(np.array(SPHERE.faces[-1], ">i4").tobytes()[::-1])
    assert "cut off" in refused(whole[: end - 1], ".pial")


def freesurfer(kind):
    """A square as FreeSurfer's old or new quads; values at its corners; a thousand values."""
    quads = np.array([0, 1, 2, 3], ">i4").view("u1").reshape(4, 4)[:, 1:].tobytes()
    points = np.array(POINTS.split(), float)
    return {
        "old quads": bytes([255, 255, 255, 0, 0, 4, 0, 0, 1])
        + (100 * points).astype(">i2").tobytes()
        + quads,
        "quads": bytes([255, 255, 253, 0, 0, 4, 0, 0, 1]) + points.astype(">f4").tobytes() + quads,
        "values": bytes(3 * [255]) + np.array([4, 2, 1, 0, 0, 0, 0], ">i4").tobytes(),
        "more values": bytes(3 * [255]) + np.array([1000, 1996, 1] + 1000 * [0], ">i4").tobytes(),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("quads", "a FreeSurfer surface of quads: convert it into triangles, as by `mris_convert"),
        ("old quads", "a FreeSurfer surface of quads: convert it into triangles, as by `mris_con"),
        ("values", "it has values at vertices, and no triangles: give the surface, such as lh.w"),
        ("more values", "it has values at vertices, and no triangles: give the surface, such as"),
    ],
)
def test_freesurfer_s_other_files_are_named(kind, message, tmp_path):
    nibabel = pytest.importorskip("nibabel")
    path = tmp_path / "lh.orig"
    path.write_bytes(freesurfer(kind))
    if "quads" in kind:  # they are what we call them
        points, faces = nibabel.freesurfer.read_geometry(path)
        np.testing.assert_allclose(points.ravel(), np.array(POINTS.split(), float))
        assert len(faces) == 2
    else:
        assert not nibabel.freesurfer.read_morph_data(path).any()
    assert refused(path.read_bytes(), ".orig").startswith(message)


@pytest.mark.parametrize("start", [b"\xff\xff\xff", b"\xff\xff\xff" + bytes([0, 0, 9, 0, 0, 9, 0])])
def test_what_may_be_quads_or_values_cut_off_is_called_neither(start):
    assert refused(start, ".white") == "it does not begin as a triangle surface of FreeSurfer does"


def test_a_freesurfer_surface_without_counts_is_cut_off():
    assert refused(b"\xff\xff\xfecreated by", ".white").startswith("cut off: 13 bytes, and no numb")


@pytest.mark.parametrize("name", ["lh.curv", "scans/sub-01.RH.thickness.gz", "lh.area.pial"])
def test_values_at_vertices_are_named_by_the_name_of_their_file(name):
    assert formats.kind_of(name.rpartition("/")[2]) is None
    message = "has values at vertices, and no triangles: give the surface, such as lh.white"
    assert formats.no_mesh(name) == f"{name} {message}"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("a.OBJ", ".obj"), ("a.stl.GZ", ".stl.gz"), ("lh.pial", ".pial"), ("a.gii", ".gii")),
        *(("sub-01.rh.white.gz", ".white.gz"), ("paper.white", None), ("a.txt", None)),
        *(("obj", None), ("a.gz", None), ("lh.curv", None)),
        *(("lh.pial.T1", ".pial"), ("rh.white.preaparc", ".white"), ("LH.sphere.reg", ".sphere")),
        *(("lh.white.preaparc.H", ".white"), ("sub.rh.orig.nofix.gz", ".orig.gz")),
        *(("lh.pial.surf.gii", ".gii"), ("lh.white.obj.gz", ".obj.gz"), ("h.pial.T1", None)),
        *(("lh.pial_lgi", None), ("lhpial.T1", None), ("lh.area.pial", None), ("lh.pial.", None)),
    ],
)
def test_kinds_of_files(name, kind):
    assert formats.kind_of(name) == kind


def test_suffixes_are_those_of_the_documentation():
    others = {".gii": "GIfTI", **dict.fromkeys(formats.FREESURFER, "FreeSurfer")}
    assert (".obj", ".off", ".ply", ".stl", *others) == formats.SUFFIXES
    assert all(
        others.get(suffix, suffix[1:].upper()) in (formats.__doc__ or "")
        for suffix in formats.SUFFIXES
    )


def test_a_compressed_file_of_another_format_is_said_to_be_that():
    content = gzip.compress(binary_ply(LIST, bytes([3] + 7 * [0]) * 2))
    assert refused(content, ".stl.gz") == "by how it begins it is a PLY file: name it .ply.gz"
