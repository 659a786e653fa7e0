"""Two of 1.0's known flaws: split cones are coarse, some inverted cones are not inverted."""

import numpy as np

from synthnet import recipe
from synthnet.recipe.drawing import draw_shapes
from synthnet.store import pins
from synthnet.types import ShapeSpec

VERSION = "1.0"


def measure() -> dict:
    """Compare split cones with their surfaces, and count inverted cones by where their tip is."""
    shapes = draw_shapes(recipe.load(VERSION))
    cones = [shape for shape in shapes if shape.family == "split_cone"]
    tips = [tip(shape) for shape in shapes if shape.family == "inverted_cone"]
    counts = {"shapes": len(tips), "plain": tips.count(1.0), "touching": tips.count(0.5)}
    return {
        "split_cones": {"compared": len(cones), "excess": excess(cones)},
        "inverted_cones": counts,
    }


def excess(cones: list[ShapeSpec]) -> list[float]:
    """Return how far labels are above the surface's: 5th, 50th, 95th percentile of the mean."""
    labels, limits = pins.read(VERSION), pins.read_limits(VERSION)
    ratios = [labels[cone.id].eigenvalues / limits[cone.id].eigenvalues for cone in cones]
    return np.percentile(np.mean(ratios, axis=1) - 1, [5, 50, 95]).round(4).tolist()


def tip(shape: ShapeSpec) -> float:
    """Return the height of the plane in which an inverted cone is reflected, as a share."""
    rings, flip = 2 * shape.parameters["split"], shape.parameters["flip"]
    return float(np.floor(flip * rings + 0.5) / rings)


def split_cones(data: dict) -> str:
    """Return how far the labels of split cones are above their surfaces' spectra."""
    compared = data["split_cones"]["compared"]
    low, median, high = data["split_cones"]["excess"]
    return (
        f"The ten eigenvalues of a label are on average {100 * median:.0f} % too large for the "
        f"median of the {compared:,} cones, and {100 * low:.0f} to {100 * high:.0f} % from the 5th "
        "to the 95th percentile; tall cones are the worst."
    )


def inverted_cones(data: dict) -> str:
    """Return how many inverted cones are not inverted, and how many touch their base."""
    counts = data["inverted_cones"]
    return (
        f"Of {counts['shapes']:,}, {counts['plain']} have t rounded to 1, so nothing is reflected "
        f"and they are plain cones; {counts['touching']} have t rounded to 0.5, so the tip lies on "
        "the centre of the base. The two are different vertices, and the surface is a manifold."
    )
