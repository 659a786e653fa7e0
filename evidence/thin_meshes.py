"""The bound of an eigenvalue's error on thin triangles, against arithmetic of 200 bits.

Strips of needles and of caps, bent ones, and strips with one row of thin triangles, with aspects
of 1 to 1e-8, turned in space. An eigenvalue is within the bound if the exact matrices have as many
eigenvalues below either end as that says, by the law of inertia.
"""

import numpy as np

from evidence import markdown
from synthnet import spectrum
from synthnet.errors import SpectrumError
from synthnet.types import Mesh

KINDS = ("needles", "caps", "bent", "row")
BITS = 200
ALONG, ACROSS, K = 7, 3, 4
LOOSE = 100  # times the true error: the bound should be no larger
ROUNDING = 1e-11  # relative; below it, both are rounding of doubles


def measure(*, cases: int = 2000, seed: int = 0) -> dict:
    """Return by kind and aspect how far eigenvalues and bounds are off, and what does not hold."""
    rng = np.random.default_rng(seed)
    rows: dict[tuple[str, int], list[dict]] = {}
    for case in range(cases):
        kind, exponent = KINDS[case % len(KINDS)], case // len(KINDS) % 9
        aspect = 10.0 ** -(exponent - rng.random() * (exponent > 0))
        rows.setdefault((kind, exponent), []).append(judge(thin(aspect, kind, cases * seed + case)))
    return {
        "cases": cases,
        "seed": seed,
        "rows": [
            {"kind": kind, "aspect": f"1e-{e}" if e else "1", **together(outcomes)}
            for (kind, e), outcomes in sorted(rows.items(), key=lambda row: KINDS.index(row[0][0]))
        ],
    }


def problems(data: dict) -> list[str]:
    """Return the rows in which a bound does not hold, or too many are loose."""
    wrong = [
        f"{row['kind']} {row['aspect']}: {row['outside']} beyond their bounds"
        for row in data["rows"]
        if row["outside"]
    ]
    loose, number = (sum(row[name] for row in data["rows"]) for name in ("loose", "bounded"))
    if loose > 0.05 * number:
        wrong.append(f"{loose} of {number} bounds are over {LOOSE} times the error")
    return wrong


def judge(mesh: Mesh) -> dict | None:
    """Return what becomes of one mesh; None if there is no certificate, or no bound."""
    import mpmath

    try:
        plain, sharp = spectrum.compute(mesh, K), spectrum.compute(mesh, K, sharp=True)
    except SpectrumError:
        return None
    if not all(np.isfinite(label.certificate.error_bound).all() for label in (plain, sharp)):
        return None
    with mpmath.workprec(BITS):
        matrices = exact_matrices(mesh)
        outcome = {}
        for name, label in (("plain", plain), ("sharp", sharp)):
            values, bounds = label.eigenvalues, label.certificate.error_bound
            outcome[f"{name} bound"] = float((bounds / values).max())
            outcome[f"{name} outside"] = not all(
                within(matrices, i, *pair)
                for i, pair in enumerate(zip(values, bounds, strict=True), start=1)
            )
            worst = int(np.argmax(bounds / values))
            value, bound = values[worst], bounds[worst]
            outcome[f"{name} loose"] = bool(bound > ROUNDING * value) and within(
                matrices, worst + 1, value, bound / LOOSE
            )
        return outcome


def together(outcomes: list[dict | None]) -> dict:
    """Return the numbers of several meshes as one row."""
    bounded = [case for case in outcomes if case is not None]
    row: dict = {"cases": len(outcomes), "bounded": len(bounded)}
    for name in ("plain", "sharp"):
        bounds = [case[f"{name} bound"] for case in bounded]
        row[name] = float(f"{np.median(bounds):.2g}") if bounds else None
    row["outside"] = sum(case["plain outside"] or case["sharp outside"] for case in bounded)
    row["loose"] = sum(case["plain loose"] for case in bounded)
    row["sharp loose"] = sum(case["sharp loose"] for case in bounded)
    return row


def table(data: dict) -> str:
    """Return the rows as Markdown."""
    rows = []
    for row in data["rows"]:
        bounds = {name: row[name] for name in ("plain", "sharp")}
        rows.append(row | {k: "" if v is None else f"{v:.1e}" for k, v in bounds.items()})
    columns = {
        "strip of": "{kind}",
        "aspect": "{aspect}",
        "meshes": "{cases}",
        "with a bound": "{bounded}",
        "bound, matrices": "{plain}",
        "bound, sharp": "{sharp}",
        "bounds broken": "{outside}",
        "over 100 times the error": "{loose}",
        "sharp ones": "{sharp loose}",
    }
    return markdown.columns(rows, columns, "ll")


def sharp_bounds(data: dict) -> str:
    """Return how much smaller the bounds of sharp values are on needles and caps, thin ones."""
    ratios = [
        row["plain"] / row["sharp"]
        for row in data["rows"]
        if row["kind"] in ("needles", "caps") and 1e-5 <= float(row["aspect"]) <= 1e-3
    ]
    return f"{min(ratios):.0f} to {max(ratios):.0f} times"


def loose_bounds(data: dict) -> str:
    """Return how many strips have no bound, and how many bounds are far too large."""
    cases, bounded, plain, sharp = (
        sum(row[name] for row in data["rows"])
        for name in ("cases", "bounded", "loose", "sharp loose")
    )
    return (
        f"{cases - bounded} of the {cases:,} have no certificate or no bound. On the others the "
        f"bound of the matrices' eigenvalues is over {LOOSE:g} times the error on {plain}, that of "
        f"sharp values on {sharp}."
    )


def thin(aspect: float, kind: str, seed: int) -> Mesh:
    """A thin strip, turned in space: of needles, of caps, bent, or with a row of thin triangles."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, ALONG), np.linspace(0, 1, ACROSS), indexing="ij")
    points = np.stack([x.ravel(), aspect * y.ravel(), np.zeros(x.size)], axis=1)
    points[1:, 0] += rng.random(x.size - 1) * 0.3 / ALONG
    if kind == "bent":
        points[:, 2] = 0.1 * np.sin(3 * points[:, 0])
    if kind == "caps":
        points[:, 1] += 0.3 * aspect * rng.random(x.size)
    if kind == "row":
        points[:, 1] /= aspect
        points[ACROSS : 2 * ACROSS, 0] = points[:ACROSS, 0] + aspect * (0.5 + rng.random(ACROSS))
    corner = (np.arange(ALONG - 1)[:, None] * ACROSS + np.arange(ACROSS - 1)).ravel()
    below = np.stack([corner, corner + ACROSS, corner + ACROSS + 1], axis=1)
    above = np.stack([corner, corner + ACROSS + 1, corner + 1], axis=1)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return Mesh(points @ turn.T, np.concatenate([below, above]))


def exact_matrices(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of linear elements in numbers of mpmath's precision."""
    import mpmath

    points = [[mpmath.mpf(float(x)) for x in row] for row in mesh.vertices]
    n = len(points)
    stiffness, mass = (np.array([[mpmath.mpf(0)] * n for _ in range(n)]) for _ in range(2))
    for face in mesh.faces.tolist():
        corners = np.array([points[i] for i in face])
        edges = np.roll(corners, 1, axis=0) - np.roll(corners, -1, axis=0)
        dots = edges @ edges.T
        area = mpmath.sqrt(dots[0, 0] * dots[1, 1] - dots[0, 1] ** 2) / 2
        stiffness[np.ix_(face, face)] += dots / (4 * area)
        mass[np.ix_(face, face)] += area * np.array([[2, 1, 1], [1, 2, 1], [1, 1, 2]]) / 12
    return stiffness, mass


def count_below(stiffness: np.ndarray, mass: np.ndarray, shift: float) -> int:
    """By the law of inertia, in numbers of mpmath's precision."""
    import mpmath

    rest, negative = stiffness - mpmath.mpf(shift) * mass, 0
    while len(rest):
        negative += int(rest[0, 0] < 0)
        rest = rest[1:, 1:] - np.outer(rest[1:, 0], rest[0, 1:] / rest[0, 0])
    return negative


def within(matrices: tuple[np.ndarray, np.ndarray], i: int, value: float, bound: float) -> bool:
    """Return whether the i-th eigenvalue after zero is within a bound of a value."""
    if np.isinf(bound):
        return True
    return bool(count_below(*matrices, value - bound) <= i < count_below(*matrices, value + bound))
