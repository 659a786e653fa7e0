"""The families of shapes, one file each, and the draw of their parameters.

To add a family: write its file with a pure generator and a ``FAMILY``, add it to
:data:`FAMILIES`, and name it in a new recipe.
"""

from __future__ import annotations

from synthnet.distributions import PARAMETERS, draw, generator
from synthnet.errors import RecipeError
from synthnet.families import (
    cone,
    conical_frustum,
    cylinder,
    inverted_cone,
    rectangular_prism,
    sphere,
    split_cone,
    split_sphere,
    tetrahedron,
    torus,
)
from synthnet.families.family import Family
from synthnet.recipe import Recipe
from synthnet.types import ShapeSpec

__all__ = ["FAMILIES", "Family", "draw_shape", "draw_shapes"]

FAMILIES: dict[str, Family] = {
    "rectangular_prism": rectangular_prism.FAMILY,
    "cone": cone.FAMILY,
    "cylinder": cylinder.FAMILY,
    "sphere": sphere.FAMILY,
    "torus": torus.FAMILY,
    "tetrahedron": tetrahedron.FAMILY,
    "conical_frustum": conical_frustum.FAMILY,
    "split_sphere": split_sphere.FAMILY,
    "split_cone": split_cone.FAMILY,
    "inverted_cone": inverted_cone.FAMILY,
}


def draw_shape(recipe: Recipe, family: str, index: int) -> ShapeSpec:
    """Draw one shape of a recipe from the shape's own seed.

    Examples
    --------
    >>> from synthnet import recipe
    >>> draw_shape(recipe.load("1.0"), "sphere", 0).id
    'sphere-00000'
    """
    rng = generator(recipe.seed, family, index, PARAMETERS)
    parameters = draw(recipe.families[family].parameters, rng)
    return ShapeSpec(
        id=f"{family}-{index:05d}",
        family=family,
        index=index,
        parameters=parameters,
        group=FAMILIES[family].group(parameters),
    )


def draw_shapes(recipe: Recipe) -> list[ShapeSpec]:
    """Draw every shape of a recipe's full version, in order of family and index.

    Raises
    ------
    RecipeError
        If the recipe names a family that is not there, or wrong parameters for one.
    """
    for name, family in recipe.families.items():
        if name not in FAMILIES:
            raise RecipeError(f"unknown family {name!r}: choose from {', '.join(FAMILIES)}")
        if set(family.parameters) != set(FAMILIES[name].least):
            raise RecipeError(
                f"family {name} takes the parameters {', '.join(FAMILIES[name].least)}; "
                f"the recipe gives {', '.join(family.parameters)}"
            )
    return [
        draw_shape(recipe, name, index)
        for name, family in recipe.families.items()
        for index in range(family.count)
    ]
