"""Which discrete operator is nearest to the surface: errors against closed forms."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy import spatial, special

from evidence import markdown
from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.spectrum import Operator
from synthnet.spectrum.operators import MASSES
from synthnet.types import Mesh

K = 10
CELLS = 32  # along the unit square; as many triangles for the other shapes, about


@dataclass(frozen=True, slots=True)
class Shape:
    """A surface whose spectrum is known.

    Attributes
    ----------
    mesh
        Makes a mesh of it from the cells along its side.
    boundary
        What is held at zero, from the mesh.
    exact
        Its eigenvalues after zero, ascending.
    curved
        Whether flat triangles are not on it, or its boundary.
    even
        Whether the triangles around each vertex are nearly symmetric.
    """

    mesh: Callable[[int], Mesh]
    boundary: Callable[[Mesh], Any]
    exact: np.ndarray
    curved: bool = False
    even: bool = True


def square(cells: int) -> Mesh:
    """Return the unit square, each cell cut in two."""
    side = np.linspace(0.0, 1.0, cells + 1)
    points = np.stack([*np.meshgrid(side, side), np.zeros((cells + 1,) * 2)], axis=-1)
    corner = np.arange((cells + 1) * cells)
    corner = corner[corner % (cells + 1) < cells]
    below = np.stack([corner, corner + 1, corner + cells + 2], axis=1)
    above = np.stack([corner, corner + cells + 2, corner + cells + 1], axis=1)
    return Mesh(points.reshape(-1, 3), np.concatenate([below, above]))


def disc(cells: int) -> Mesh:
    """Return the unit disc: rings of vertices, ever six more, joined as they lie."""
    rings = cells // 2
    points, faces, before = [np.zeros((1, 3))], [], np.zeros(1, dtype=np.int64)
    for ring in range(1, rings + 1):
        count = 6 * ring
        angles = 2 * np.pi * np.arange(count) / count
        circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        now = before[-1] + 1 + np.arange(count)
        for step in range(count):
            sixth, along = divmod(step, ring)
            inner = len(before) if ring > 1 else 1
            low = before[(sixth * (ring - 1) + along) % inner]
            faces.append((low, now[step], now[(step + 1) % count]))
            if along:
                last = before[(sixth * (ring - 1) + along - 1) % inner]
                faces.append((last, now[step], low))
        points.append(ring / rings * circle)
        before = now
    return Mesh(np.concatenate(points), np.array(faces))


def ball(cells: int) -> Mesh:
    """Return the unit sphere."""
    return FAMILIES["sphere"].generate({"radius": 1.0, "resolution": cells})


def scattered(cells: int) -> Mesh:
    """Return the unit sphere, its vertices drawn at random: the hull of these points."""
    points = np.random.default_rng(0).standard_normal((2 * cells * cells, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = spatial.ConvexHull(points).simplices
    inward = np.linalg.det(points[faces]) < 0
    return Mesh(points, np.where(inward[:, None], faces[:, ::-1], faces))


def _grid(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.sort([np.pi**2 * (i * i + j * j) for i, j in product(first, second)])


def _discs(roots: Callable[[int], np.ndarray]) -> np.ndarray:
    """Squares of the roots of all orders; those of a cosine and a sine are two."""
    orders = [np.repeat(roots(m), 1 if m == 0 else 2) for m in range(12)]
    return np.sort(np.concatenate(orders) ** 2)


_SPHERE = np.repeat([n * (n + 1.0) for n in range(1, 8)], [2 * n + 1 for n in range(1, 8)])
_ALL, _INNER, _HALF = np.arange(12.0), np.arange(1.0, 12), np.arange(12) + 0.5
SHAPES = {
    "square, Neumann": Shape(square, lambda _: "neumann", _grid(_ALL, _ALL)[1:]),
    "square, Dirichlet": Shape(square, lambda _: "dirichlet", _grid(_INNER, _INNER)),
    "square, one side held": Shape(
        square, lambda mesh: mesh.vertices[:, 0] == 0, _grid(_HALF, _ALL)
    ),
    "disc, Neumann": Shape(
        disc, lambda _: "neumann", _discs(lambda m: special.jnp_zeros(m, 8)), curved=True
    ),
    "disc, Dirichlet": Shape(
        disc, lambda _: "dirichlet", _discs(lambda m: special.jn_zeros(m, 8)), curved=True
    ),
    "sphere": Shape(ball, lambda _: "neumann", _SPHERE, curved=True),
    "sphere, scattered vertices": Shape(
        scattered, lambda _: "neumann", _SPHERE, curved=True, even=False
    ),
}


def measure(*, cells: int = CELLS) -> dict:
    """Return the errors of every operator on every shape, on two meshes."""
    rows = [
        row(name, elements, mass, cells)
        for name in SHAPES
        for elements, masses in MASSES.items()
        for mass in masses
    ]
    return {"cells": cells, "rows": rows}


def row(name: str, elements: str, mass: str, cells: int) -> dict:
    """Return the errors of an operator on a shape, on two meshes."""
    shape, errors, sizes = SHAPES[name], [], []
    for count in (cells // 2, cells):
        mesh = shape.mesh(count)
        operator = Operator(shape.boundary(mesh), mass, elements)
        values = spectrum.compute(mesh, K, operator=operator).eigenvalues
        errors.append(float(np.abs(values / shape.exact[:K] - 1).max()))
        sizes.append(len(mesh.vertices))
    return {
        "shape": name,
        "elements": elements,
        "mass": mass,
        "vertices": sizes,
        "errors": errors,
        "order": float(np.log2(errors[0] / errors[1])),
    }


def problems(data: dict) -> list[str]:
    """Return the rows whose error does not fall at the order of the elements."""
    # Flat triangles are off by h² on curved shapes, and uneven ones shrink at different rates
    fast = {(name, "curved") for name, shape in SHAPES.items() if shape.even}
    fast |= {(name, "quadratic") for name, shape in SHAPES.items() if not shape.curved}
    return [
        f"{row['shape']}, {row['elements']} {row['mass']}: order {row['order']:.2f}"
        for row in data["rows"]
        if not row["order"] >= (3.7 if (row["shape"], row["elements"]) in fast else 1.7)
    ]


def table(data: dict) -> str:
    """Return the largest error of the first ten, in per cent, one row per operator."""
    shapes = list(dict.fromkeys(row["shape"] for row in data["rows"]))
    errors: dict[tuple[str, str], dict[str, str]] = {}
    for row in data["rows"]:
        of_operator = errors.setdefault((row["elements"], row["mass"]), {})
        of_operator[row["shape"]] = f"{100 * row['errors'][1]:.2g} %"
    rows = [[*operator, *(cells[shape] for shape in shapes)] for operator, cells in errors.items()]
    return markdown.table(["elements", "mass", *shapes], rows)
