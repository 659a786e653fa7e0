"""What other solvers miss: answers on meshes with clusters of eigenvalues, judged by counting.

Half of the meshes have symmetries to the last digit, so that eigenvalues are equal to rounding:
icospheres, rounded cubes, spheres and tori of many sizes. The others are such and the twisted tori
of 2.0, turned at random and rounded to float32; one of them, ``twisted_torus-00540/1``, as 2.0 has
it: LaPy was once seen to miss an eigenvalue there. SciPy's releases are installed one after the
other into an environment of their own, and asked as LaPy asks: ``eigsh(A, k + 1, B, sigma=-0.01)``.
``--only MESH SOLVER`` asks again for one mesh, and one solver: parts of their names are enough.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import threadpoolctl

from evidence import markdown
from evidence.solvers import lapy, lapy_cholmod, ours
from evidence.timing import progress
from synthnet import recipe, spectrum
from synthnet.families import FAMILIES
from synthnet.mesh.isometries import apply, random_rotation
from synthnet.recipe.drawing import draw_instances, draw_shape
from synthnet.types import Mesh

RELEASES = ("1.13.1", "1.15.3", "1.17.1")  # of SciPy
SIDES = {"LaPy": lapy, "LaPy with CHOLMOD": lapy_cholmod, "synthNet, certified": ours}
COUNTS = (10, 20, 50)  # eigenvalues
MOST_VERTICES = 3000  # of a twisted torus
NAMED = 540, 1  # of 2.0's twisted tori, and its instance
KINDS = ("icosphere", "rounded cube", "sphere", "torus", "twisted_torus")  # beginnings of names
TOLERANCE = 1e-5
# What each release runs: a file of matrices and where to write, as arguments.
ASK = """
import json, sys
import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import eigsh

arrays, answers = np.load(sys.argv[1], allow_pickle=False), []
for i in range(int(arrays["count"])):
    pointers, indices = arrays[f"{i}-indptr"], arrays[f"{i}-indices"]
    n = len(pointers) - 1
    A, B = (csc_matrix((arrays[f"{i}-{m}"], indices, pointers), (n, n)) for m in ("A", "B"))
    start = np.random.default_rng(i).uniform(-1, 1, n)
    k = int(arrays[f"{i}-k"])
    answers.append(sorted(eigsh(A, k + 1, B, sigma=-0.01, v0=start)[0])[1:])
with open(sys.argv[2], "w") as file:
    json.dump(answers, file)
"""


def measure(*, meshes: int = 500, only: tuple = ()) -> dict:
    """Ask every solver, or one, and judge its answers."""
    mesh_of, solver_of = (*only, "", "")[:2]
    spectrum.compile_solver()
    cases = [case for case in made(meshes) if mesh_of in case[0]]
    if not cases:
        raise ValueError(f"no mesh has {mesh_of!r} in its name")
    with threadpoolctl.threadpool_limits(1):
        answers = {
            name: [solver(mesh, k) for _, mesh, k in progress(cases, name)]
            for name, solver in SIDES.items()
            if solver_of in name
        }
    answers |= asked(cases, [release for release in RELEASES if solver_of in _title(release)])
    if not answers:
        raise ValueError(f"no solver has {solver_of!r} in its name")
    rows, judged = [], []
    for name, given in answers.items():
        wrong = []
        for (what, mesh, k), values in zip(cases, given, strict=True):
            verdict = spectrum.certify(mesh, values, tolerance=TOLERANCE)
            answer = {"mesh": what, "k": k, "verdict": str(verdict)}
            judged.append({"name": name, **answer})
            if not verdict.certified:
                wrong.append(answer)
        rows.append({"name": name, "asked": len(cases), "wrong": wrong})
    return {"meshes": meshes, "rows": rows} | ({"answers": judged} if only else {})


def made(count: int) -> Iterator[tuple[str, Mesh, int]]:
    """Yield names, meshes and how many eigenvalues are asked for."""
    twisted, named = _twisted(), _named()
    yield from ((*named, k) for k in COUNTS)
    for number in range(count):
        rng = np.random.default_rng(number)
        if number % 2:
            name, mesh = _symmetric(rng)
        else:
            name, mesh = next(twisted) if number % 4 else _symmetric(rng)
            name += f", turned by seed {number}"
            mesh = apply(mesh, random_rotation(rng)).stored()
        yield from ((name, mesh, k) for k in COUNTS if k + 2 < len(mesh.vertices))


def _symmetric(rng: np.random.Generator) -> tuple[str, Mesh]:
    """Return a mesh of many symmetries, as it was made."""
    import trimesh

    size = float(rng.uniform(0.1, 10))
    kind = rng.choice(["icosphere", "rounded cube", "sphere", "torus"])
    if kind in ("icosphere", "rounded cube"):
        cuts = int(rng.integers(1, 5))
        if kind == "icosphere":
            solid = trimesh.creation.icosphere(subdivisions=cuts)
        else:
            solid = trimesh.creation.box().subdivide_loop(cuts)
        points = size * np.asarray(solid.vertices, dtype=np.float64)
        return f"{kind} of {cuts} subdivisions, size {size:.4f}", Mesh(points, solid.faces)
    if kind == "sphere":
        cells = int(rng.integers(8, 33))
        mesh = FAMILIES["sphere"].generate({"radius": size, "resolution": cells})
        return f"sphere of resolution {cells}, radius {size:.4f}", mesh
    around, across = (int(i) for i in rng.integers(12, 49, 2))
    radii = {"torus_radius": size, "tube_radius": size * float(rng.uniform(0.2, 0.8))}
    mesh = FAMILIES["torus"].generate(
        radii | {"radial_resolution": around, "tubular_resolution": across}
    )
    return f"torus of {around} × {across}, radius {size:.4f}", mesh


def _twisted() -> Iterator[tuple[str, Mesh]]:
    version = recipe.load("2.0")
    for number in range(version.families["twisted_torus"].count):
        spec = draw_shape(version, "twisted_torus", number)
        mesh = FAMILIES["twisted_torus"].generate(spec.parameters).stored()
        if len(mesh.vertices) <= MOST_VERTICES:
            yield spec.id, mesh


def _named() -> tuple[str, Mesh]:
    number, instance = NAMED
    version = recipe.load("2.0")
    spec = draw_shape(version, "twisted_torus", number)
    mesh = FAMILIES["twisted_torus"].generate(spec.parameters).stored()
    turned = draw_instances(version, spec)[instance]
    return f"{spec.id}/{instance}", apply(mesh, turned).stored()


def _title(release: str) -> str:
    return f"SciPy {release}, eigsh"


def asked(
    cases: list[tuple[str, Mesh, int]], releases: Sequence[str]
) -> dict[str, list[np.ndarray]]:
    """Return what each release of SciPy answers, each in an environment of its own."""
    answers: dict[str, list[np.ndarray]] = {}
    with tempfile.TemporaryDirectory() as folder:
        matrices, script = Path(folder, "matrices.npz"), Path(folder, "ask.py")
        script.write_text(ASK)
        np.savez(matrices, **_arrays(cases))
        for release in releases:
            home, out = Path(folder, release), Path(folder, f"{release}.json")
            python = home / "bin" / "python"
            subprocess.run([sys.executable, "-m", "venv", home], check=True)
            install = [python, "-m", "pip", "install", "--quiet", f"scipy=={release}"]
            subprocess.run(install, check=True)
            subprocess.run([python, script, matrices, out], check=True)
            answers[_title(release)] = [np.array(v) for v in json.loads(out.read_text())]
    return answers


def _arrays(cases: list[tuple[str, Mesh, int]]) -> dict[str, np.ndarray]:
    arrays = {"count": np.array(len(cases))}
    for number, (_, mesh, k) in enumerate(cases):
        stiffness, mass = spectrum.fem_matrices(mesh)
        named = {"k": np.array(k), "A": stiffness.data, "B": mass.data}
        named |= {"indptr": mass.indptr, "indices": mass.indices}
        arrays |= {f"{number}-{name}": values for name, values in named.items()}
    return arrays


def table(data: dict) -> str:
    """Return how many answers of each solver are wrong, by kind of mesh, and the first of them."""
    rows = []
    for row in data["rows"]:
        names = [wrong["mesh"] for wrong in row["wrong"]]
        counts = [str(sum(name.startswith(kind) for name in names)) for kind in KINDS]
        first = _said(row["wrong"][0]) if names else ""
        rows.append([row["name"], f"{row['asked']:,}", *counts, first])
    kinds = [f"wrong on {kind.replace('_', ' ')}" for kind in KINDS]
    return markdown.table(["solver", "answers", *kinds, "the first"], rows, "lrrrrrrl")


def _said(wrong: dict) -> str:
    return f"{wrong['mesh']}, k = {wrong['k']}: {wrong['verdict'].splitlines()[0]}"
