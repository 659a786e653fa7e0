"""What a built mesh costs, against a plain loop over Open3D and LaPy.

Both sides do a fixed random sample of synthNet 1.0 in this process, on one thread, chunk
by chunk in turn. Ours is the build as it is: generation, filters, label, residual,
isometries and the Parquet shard. The peer makes the mesh by Open3D's methods alone and
calls ``lapy.Solver(...).eigs(11)``; it checks and stores nothing.

Usage: python benchmarks/build_cost.py [--shapes 300] [--json]
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import lapy
import numpy as np
import threadpoolctl
from rich.progress import track
from tabulate import tabulate

from synthnet import recipe
from synthnet.build.versions import build_shard
from synthnet.mesh.open3d import load_open3d
from synthnet.recipe.plan import ShardPlan, plan_shards

CHUNK = 5


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


def sample_chunks(count: int) -> list[ShardPlan]:
    """Draw shapes of 1.0 at random, the same at every call, in chunks of one family."""
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


def time_ours(plan: ShardPlan, directory: Path) -> float:
    """Return the core-seconds of building one chunk as a shard."""
    started = time.process_time()
    build_shard(plan, recipe.load("1.0"), directory)
    return time.process_time() - started


def time_plain(plan: ShardPlan) -> float:
    """Return the core-seconds of the plain loop over one chunk."""
    started = time.process_time()
    for shape in plan.shapes:
        vertices, faces = plain_mesh(shape.spec.family, dict(shape.spec.parameters))
        lapy.Solver(lapy.TriaMesh(vertices, faces)).eigs(11)
    return time.process_time() - started


def main() -> None:
    """Run the comparison and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shapes", type=int, default=300)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    chunks = sample_chunks(options.shapes)
    ours, plain, counts = defaultdict(float), defaultdict(float), defaultdict(int)
    ratios = []
    with threadpoolctl.threadpool_limits(1), tempfile.TemporaryDirectory() as place:
        directory = Path(place)
        (directory / "shards").mkdir()
        (directory / "warm" / "shards").mkdir(parents=True)
        time_ours(chunks[0], directory / "warm")
        time_plain(chunks[0])
        for number, plan in enumerate(track(chunks, "timing", disable=not sys.stderr.isatty())):
            if number % 2:
                first, second = time_ours(plan, directory), time_plain(plan)
            else:
                second, first = time_plain(plan), time_ours(plan, directory)
            ours[plan.family] += first
            plain[plan.family] += second
            counts[plan.family] += len(plan.shapes)
            ratios.append(first / second)
    rows = [
        {
            "family": family,
            "shapes": counts[family],
            "ours ms": round(1e3 * ours[family] / counts[family], 2),
            "plain ms": round(1e3 * plain[family] / counts[family], 2),
            "ratio": round(ours[family] / plain[family], 3),
        }
        for family in counts
    ]
    shapes, total_ours, total_plain = options.shapes, sum(ours.values()), sum(plain.values())
    rows.append(
        {
            "family": "all",
            "shapes": shapes,
            "ours ms": round(1e3 * total_ours / shapes, 2),
            "plain ms": round(1e3 * total_plain / shapes, 2),
            "ratio": round(total_ours / total_plain, 3),
        }
    )
    median = round(statistics.median(ratios), 3)
    if options.json:
        print(json.dumps({"rows": rows, "median_chunk_ratio": median}, indent=1))
        return
    print(tabulate(rows, headers="keys"))
    print(f"\ncore-milliseconds a mesh, one thread; median ratio of {len(ratios)} chunks: {median}")


if __name__ == "__main__":
    main()
