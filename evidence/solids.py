"""Solids like those of CAD, made by a seed: thin, perforated, bent, and joined by narrow necks.

Each kind is a function of a random generator to a solid of manifold3d, with booleans of boxes and
cylinders. Its triangles are what that library leaves, long needles between holes, or cut until no
edge is longer than a length, or that in a part of the solid alone. What becomes of it is what
`synthnet import` makes of a file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import manifold3d
import numpy as np
from manifold3d import CrossSection, Manifold

from synthnet import Mesh
from synthnet.mesh.repair import LARGEST, Refused, Rules, repair

VERTICES = (600, 40_000)  # of a mesh, about
SIZES = 3  # tries at the length of edges that gives so many


@dataclass(frozen=True, slots=True)
class Solid:
    """A mesh, and where it comes from.

    Attributes
    ----------
    name
        Kind, how it is triangulated and number.
    kind
        Of :data:`KINDS`.
    mesh
        Closed, of one component.
    """

    name: str
    kind: str
    mesh: Mesh


def box(x: float, y: float, z: float) -> Manifold:
    """Return a box around the origin."""
    return Manifold.cube((x, y, z), True)


def hole(rng: np.random.Generator, radius: float, height: float) -> Manifold:
    """Return a drill along z; cylinders of CAD have more segments than their size needs."""
    segments = int(rng.choice([12, 24, 48, 96]))
    return Manifold.cylinder(height, radius, -1.0, segments, True)


def boolean(rng: np.random.Generator) -> Manifold:
    """A few boxes and cylinders, united or cut away."""
    solid = box(*rng.uniform(0.6, 1.5, 3))
    for _ in range(rng.integers(2, 7)):
        if rng.random() < 0.5:
            tool = box(*rng.uniform(0.2, 1.0, 3))
        else:
            tool = hole(rng, rng.uniform(0.05, 0.4), rng.uniform(0.4, 2.5))
        tool = tool.rotate(tuple(90.0 * rng.integers(0, 4, 3) + 30 * (rng.random(3) < 0.2)))
        tool = tool.translate(tuple(rng.uniform(-0.6, 0.6, 3)))
        solid = solid + tool if rng.random() < 0.4 else solid - tool
    return solid


def plate(rng: np.random.Generator) -> Manifold:
    """A thin plate with rounded corners, a step and some holes."""
    x, y = 1.0, rng.uniform(0.3, 1.0)
    thickness = 10 ** rng.uniform(-2.7, -1.2)
    outline = CrossSection.square((0.9 * x, 0.9 * y), True)
    outline = outline.offset(0.05, manifold3d.JoinType.Round, 2.0, int(rng.choice([16, 64])))
    solid = Manifold.extrude(outline, thickness)
    for _ in range(rng.integers(0, 6)):
        tool = hole(rng, rng.uniform(0.01, 0.12) * y, 1.0)
        solid -= tool.translate((rng.uniform(-0.4, 0.4) * x, rng.uniform(-0.35, 0.35) * y, 0))
    if rng.random() < 0.5:
        solid += box(0.3, 0.2 * y, 4 * thickness).translate((0.2, 0, 0))
    return solid


def perforated(rng: np.random.Generator) -> Manifold:
    """A plate with a grid of holes or slots, the bars between them narrow."""
    columns, rows = rng.integers(3, 12), rng.integers(2, 9)
    thickness, bar = 10 ** rng.uniform(-1.5, -0.3), rng.uniform(0.05, 0.5)
    segments = int(rng.choice([4, 8, 16, 32]))
    tool = Manifold.cylinder(4.0, (1 - bar) / 2, -1.0, segments, True)
    if rng.random() < 0.3:
        tool = box((1 - bar), (1 - bar), 4.0)
    tools = [
        tool.translate((i - (columns - 1) / 2, j - (rows - 1) / 2, 0))
        for i in range(columns)
        for j in range(rows)
    ]
    sheet = box(columns + bar, rows + bar, thickness)
    return sheet - Manifold.batch_boolean(tools, manifold3d.OpType.Add)


def bracket(rng: np.random.Generator) -> Manifold:
    """A sheet bent to an L, T, U or Z, with holes drilled through."""
    t = 10 ** rng.uniform(-2.2, -0.8)
    a, b, width = 1.0, rng.uniform(0.3, 1.2), rng.uniform(0.2, 1.5)
    parts = {
        "L": ((a, t, 0, 0), (t, b, -a / 2, b / 2)),
        "T": ((a, t, 0, 0), (t, b, 0, b / 2)),
        "U": ((a, t, 0, 0), (t, b, -a / 2, b / 2), (t, b, a / 2, b / 2)),
        "Z": ((a, t, 0, 0), (t, b, -a / 2, b / 2), (t, b, a / 2, -b / 2)),
    }[str(rng.choice(["L", "T", "U", "Z"]))]
    profile = CrossSection()
    for x, y, right, up in parts:
        profile += CrossSection.square((x + t, y + t), True).translate((right, up))
    solid = Manifold.extrude(profile, width).translate((0, 0, -width / 2))
    for _ in range(rng.integers(0, 5)):
        tool = hole(rng, rng.uniform(0.01, 0.1), 5.0)
        if rng.random() < 0.5:
            at = (0, b / 2 + rng.uniform(-0.2, 0.2) * b, rng.uniform(-0.3, 0.3) * width)
            solid -= tool.rotate((0, 90, 0)).translate(at)
        else:
            at = (rng.uniform(-0.4, 0.4) * a, 0, rng.uniform(-0.3, 0.3) * width)
            solid -= tool.rotate((90, 0, 0)).translate(at)
    return solid


def necks(rng: np.random.Generator) -> Manifold:
    """Two to twelve bodies in a row, each joined to the next by a narrow neck."""
    count = int(rng.integers(2, 13))
    thin = 10 ** rng.uniform(-2.5, -0.8)
    solid, x = Manifold(), 0.0
    for i in range(count):
        size = rng.uniform(0.5, 1.2)
        if rng.random() < 0.5:
            body = box(size, size, rng.uniform(0.05, 1.0))
        else:
            body = hole(rng, size / 2, rng.uniform(0.05, 1.0))
        solid += body.translate((x, 0, 0))
        step = size / 2 + rng.uniform(0.7, 1.2)
        if i + 1 < count:
            neck = box(step, thin, thin)
            if rng.random() < 0.5:
                neck = hole(rng, thin / 2, step).rotate((0, 90, 0))
            solid += neck.translate((x + step / 2, 0, 0))
        x += step
    return solid


def frame(rng: np.random.Generator) -> Manifold:
    """A lattice of struts."""
    counts = rng.integers(1, 4, 3)
    thick = rng.uniform(0.05, 0.35)
    solids = []
    for axis in range(3):
        others = [i for i in range(3) if i != axis]
        size = np.full(3, thick)
        size[axis] = counts[axis] + thick
        strut = box(*size)
        for i in range(counts[others[0]] + 1):
            for j in range(counts[others[1]] + 1):
                at = np.zeros(3)
                at[axis], at[others[0]], at[others[1]] = counts[axis] / 2, i, j
                solids.append(strut.translate(tuple(at)))
    return Manifold.batch_boolean(solids, manifold3d.OpType.Add)


def turned(rng: np.random.Generator) -> Manifold:
    """Coaxial cylinders and cones of very different radii, with a bore: a shaft, or a bolt."""
    solid, z = Manifold(), 0.0
    segments = int(rng.choice([16, 32, 64, 128]))
    for _ in range(rng.integers(2, 6)):
        height = 10 ** rng.uniform(-1.5, 0)
        low = 10 ** rng.uniform(-1.0, 0)
        high = low if rng.random() < 0.7 else 10 ** rng.uniform(-1.0, 0)
        piece = Manifold.cylinder(1.02 * height, low, high, segments, False)
        solid += piece.translate((0, 0, z))
        z += height
    if rng.random() < 0.5:
        solid -= Manifold.cylinder(3 * z, 10 ** rng.uniform(-1.8, -1.05), -1.0, segments, True)
    return solid


KINDS: dict[str, Callable[[np.random.Generator], Manifold]] = {
    "boolean": boolean,
    "plate": plate,
    "perforated": perforated,
    "bracket": bracket,
    "necks": necks,
    "frame": frame,
    "turned": turned,
}
TRIANGULATIONS = ("as made", "cut", "cut in part")


def solids(count: int, seed: int) -> Iterator[Solid | str]:
    """Yield so many solids, and in place of those that `synthnet import` refuses the reason."""
    for number in range(count):
        yield made(seed, number)


def made(seed: int, number: int) -> Solid | str:
    """Return a solid, or why `synthnet import` refuses it; other seeds give other solids."""
    rng = np.random.default_rng([seed, number])
    kind = list(KINDS)[number % len(KINDS)]
    how = TRIANGULATIONS[number // len(KINDS) % len(TRIANGULATIONS)]
    solid = KINDS[kind](rng)
    vertices = float(np.exp(rng.uniform(*np.log(VERTICES))))
    try:
        mesh = repair(triangulated(solid, how, vertices, rng), Rules(components=LARGEST)).mesh
    except Refused as refused:
        return f"{kind}: {refused}"
    return Solid(f"{kind}-{how.replace(' ', '-')}-{number:03}", kind, mesh)


def triangulated(solid: Manifold, how: str, vertices: float, rng: np.random.Generator) -> Mesh:
    """Return a solid's surface with about so many vertices, or as it is."""
    if how == "cut in part":  # one half finer
        low, high = np.array(solid.bounding_box()).reshape(2, 3)
        axis = int(np.argmax(high - low))
        normal = np.eye(3)[axis]
        at = float(low[axis] + rng.uniform(0.3, 0.7) * (high - low)[axis])
        first, second = solid.split_by_plane(tuple(normal), at)
        edge = length(first, vertices / 2)
        return as_mesh(first.refine_to_length(edge) + second)
    if how == "cut":
        return as_mesh(solid.refine_to_length(length(solid, vertices)))
    return as_mesh(solid)


def length(solid: Manifold, vertices: float) -> float:
    """Return the longest edge with which a solid has about so many vertices."""
    edge = float(np.sqrt(2 * solid.surface_area() / vertices))
    for _ in range(SIZES):
        edge *= float(np.sqrt(solid.refine_to_length(edge).num_vert() / vertices))
    return edge


def as_mesh(solid: Manifold) -> Mesh:
    """Return the triangles of a solid."""
    mesh = solid.to_mesh64()
    return Mesh(mesh.vert_properties[:, :3].copy(), mesh.tri_verts.astype(np.int64))
