"""What a built mesh costs, against a plain loop over Open3D and LaPy.

Both sides do a fixed random sample of synthNet 1.0 in this process, on one thread, chunk
by chunk in turn. Ours is the build as it is: generation, filters, label, residual,
isometries and the Parquet shard. The peer makes the mesh by Open3D's methods alone and
calls ``lapy.Solver(...).eigs(11)``; it checks and stores nothing.
"""

from __future__ import annotations

import statistics
import tempfile
from collections import defaultdict
from functools import partial
from pathlib import Path

import numpy as np
import threadpoolctl

from evidence.timing import in_turn, progress
from synthnet import recipe
from synthnet.build.versions import make_shard
from synthnet.mesh.open3d import load_open3d
from synthnet.recipe.plan import ShardPlan, plan_shards
from synthnet.types import ShapeSpec

CHUNK = 5


def measure(*, shapes: int = 300) -> dict:
    """Return core-milliseconds a mesh by family and for all, and the median ratio of a chunk."""
    chunks = sample_chunks(shapes)
    seconds: dict[str, list[tuple[int, float, float]]] = defaultdict(list)
    with threadpoolctl.threadpool_limits(1), tempfile.TemporaryDirectory() as temporary:
        warm, directory = (Path(temporary) / name for name in ("warm", "timed"))
        time_chunk(chunks[0], warm)
        for number, plan in enumerate(progress(chunks, "timing")):
            both = time_chunk(plan, directory, backwards=number % 2 == 0)
            seconds[plan.family].append((len(plan.shapes), *both))
    every = [chunk for chunks in seconds.values() for chunk in chunks]
    rows = [row(family, chunks) for family, chunks in {**seconds, "all": every}.items()]
    median = statistics.median(ours / plain for _, ours, plain in every)
    return {"rows": rows, "median_chunk_ratio": round(median, 3)}


def sample_chunks(count: int) -> list[ShardPlan]:
    """Draw shapes of 1.0 at random, the same in every run, in chunks of one family."""
    shapes = [shape for plan in plan_shards(recipe.load("1.0")) for shape in plan.shapes]
    chosen = np.random.default_rng(0).choice(len(shapes), size=count, replace=False)
    families = defaultdict(list)
    for number in sorted(chosen):
        families[shapes[number].spec.family].append(shapes[number])
    return [
        ShardPlan(f"shards/{family}-{start}.parquet", family, tuple(members[start : start + CHUNK]))
        for family, members in families.items()
        for start in range(0, len(members), CHUNK)
    ]


def time_chunk(plan: ShardPlan, directory: Path, *, backwards: bool = False) -> list[float]:
    """Return the core-seconds of building a chunk as a shard, and of the plain loop over it."""
    (directory / "shards").mkdir(parents=True, exist_ok=True)
    sides = {
        "ours": partial(make_shard, plan, recipe.load("1.0"), directory / plan.file),
        "plain": lambda: [plain_label(shape.spec) for shape in plan.shapes],
    }
    return [timed.seconds for timed in in_turn(sides, backwards=backwards).values()]


def row(family: str, chunks: list[tuple[int, float, float]]) -> dict:
    """Return the number of shapes, milliseconds a mesh of both sides, and their ratio."""
    shapes, ours, plain = (sum(column) for column in zip(*chunks, strict=True))
    return {
        "family": family,
        "shapes": shapes,
        "ours ms": round(1e3 * ours / shapes, 2),
        "plain ms": round(1e3 * plain / shapes, 2),
        "ratio": round(ours / plain, 3),
    }


def plain_label(spec: ShapeSpec) -> np.ndarray:
    """Make and solve a mesh as one would by hand."""
    import lapy

    vertices, faces = plain_mesh(spec.family, dict(spec.parameters))
    return lapy.Solver(lapy.TriaMesh(vertices, faces)).eigs(11)[0][1:]


def plain_mesh(family: str, p: dict) -> tuple[np.ndarray, np.ndarray]:
    """Make a shape as one would by hand: Open3D's calls and nothing else."""
    o3d = load_open3d()
    shapes = o3d.geometry.TriangleMesh
    match family:
        case "rectangular_prism":
            mesh = shapes.create_box(p["width"], p["height"], p["depth"])
        case "cone" | "inverted_cone":
            mesh = shapes.create_cone(p["radius"], p["height"], p["resolution"], p["split"])
        case "cylinder" | "conical_frustum":
            mesh = shapes.create_cylinder(p["radius"], p["height"], p["resolution"], p["split"])
        case "sphere":
            mesh = shapes.create_sphere(p["radius"], p["resolution"])
        case "torus":
            mesh = shapes.create_torus(p["torus_radius"], p["tube_radius"])
        case "tetrahedron":
            corners = np.vstack([np.zeros(3), np.diag([p["width"], p["height"], p["depth"]])])
            faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
            mesh = shapes(o3d.utility.Vector3dVector(corners), o3d.utility.Vector3iVector(faces))
        case "split_sphere":
            halves = [shapes.create_sphere(1.0, p[f"resolution_{half}"]) for half in "ab"]
            mesh = plain_hull(halves)
        case "split_cone":
            halves = [
                shapes.create_cone(1.0, p["height"], p[f"resolution_{half}"], p[f"split_{half}"])
                for half in "ab"
            ]
            mesh = plain_hull(halves)
    if p.get("subdivisions"):
        mesh = mesh.subdivide_midpoint(p["subdivisions"])
    vertices = np.asarray(mesh.vertices).copy()
    if family == "conical_frustum":
        vertices[:, :2] *= 1 + (p["scaling"] - 1) * (vertices[:, 2:] / p["height"] + 0.5)
    if family == "inverted_cone":
        rings = p["split"] * 2 ** p["subdivisions"]
        plane = p["height"] * round(p["flip"] * rings) / rings
        vertices[:, 2] = np.minimum(vertices[:, 2], 2 * plane - vertices[:, 2])
    return vertices, np.asarray(mesh.triangles)


def plain_hull(halves: list):
    """Return the convex hull of one mesh's points with x ≤ 0 and another's with x ≥ 0."""
    o3d = load_open3d()
    a, b = (np.asarray(half.vertices) for half in halves)
    points = np.concatenate([a[a[:, 0] <= 1e-9], b[b[:, 0] >= -1e-9]])
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    return cloud.compute_convex_hull()[0]
