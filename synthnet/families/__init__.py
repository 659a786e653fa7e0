"""The families of shapes, one file each, and the draw of their parameters.

To add a family: write its file with an atlas and a ``FAMILY``, add it to :data:`CHARTED`, and
name it in a new recipe.
"""

from __future__ import annotations

from synthnet.distributions import MESHES, PARAMETERS, draw, generator
from synthnet.errors import RecipeError
from synthnet.families import (
    annulus,
    bent_tube,
    blob,
    capped_cylinder,
    circular_cone,
    cone,
    conforming_split_cone,
    conforming_split_sphere,
    conical_frustum,
    cuboid,
    cylinder,
    dented_cone,
    drum,
    ellipsoid,
    elliptic_disc,
    extruded_drum,
    extruded_star,
    flat_rectangle,
    inverted_cone,
    knotted_tube,
    mobius_band,
    open_cylinder,
    pretzel,
    rectangular_prism,
    rolled_sheet,
    simplex,
    sphere,
    spherical_cap,
    split_cone,
    split_sphere,
    superquadric,
    tetrahedron,
    torus,
    truncated_cone,
    twisted_torus,
)
from synthnet.families.charted import TRIANGULATION
from synthnet.families.charted import TRIANGULATIONS as KINDS
from synthnet.families.family import Family
from synthnet.recipe import Recipe
from synthnet.types import Parameters, ShapeSpec

__all__ = ["CHARTED", "FAMILIES", "PRIMITIVES", "Family", "draw_shape", "draw_shapes"]

PRIMITIVES: dict[str, Family] = {  # 1.0: the paper's, as Open3D makes them
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
CHARTED: dict[str, Family] = {  # 2.0: given by charts, each surface in several triangulations
    "cuboid": cuboid.FAMILY,
    "simplex": simplex.FAMILY,
    "ellipsoid": ellipsoid.FAMILY,
    "circular_cone": circular_cone.FAMILY,
    "capped_cylinder": capped_cylinder.FAMILY,
    "truncated_cone": truncated_cone.FAMILY,
    "dented_cone": dented_cone.FAMILY,
    "conforming_split_cone": conforming_split_cone.FAMILY,
    "conforming_split_sphere": conforming_split_sphere.FAMILY,
    "twisted_torus": twisted_torus.FAMILY,
    "knotted_tube": knotted_tube.FAMILY,
    "pretzel": pretzel.FAMILY,
    "blob": blob.FAMILY,
    "superquadric": superquadric.FAMILY,
    "bent_tube": bent_tube.FAMILY,
    "extruded_star": extruded_star.FAMILY,
    "extruded_drum": extruded_drum.FAMILY,
    "flat_rectangle": flat_rectangle.FAMILY,
    "rolled_sheet": rolled_sheet.FAMILY,
    "elliptic_disc": elliptic_disc.FAMILY,
    "annulus": annulus.FAMILY,
    "spherical_cap": spherical_cap.FAMILY,
    "open_cylinder": open_cylinder.FAMILY,
    "mobius_band": mobius_band.FAMILY,
    "drum": drum.FAMILY,
}
FAMILIES: dict[str, Family] = {**PRIMITIVES, **CHARTED}

LARGEST_SEED = 2**31 - 1


def draw_shape(recipe: Recipe, family: str, index: int) -> ShapeSpec:
    """Draw one shape of a recipe from the shape's own seed.

    Where surfaces come in several sizes, the meshes of a surface have numbers that follow each
    other. Their kinds of triangulation take turns, so that no kind goes with a size.

    Examples
    --------
    >>> from synthnet import recipe
    >>> draw_shape(recipe.load("1.0"), "sphere", 0).id
    'sphere-00000'
    """
    surface, copy = divmod(index, recipe.copies)
    rng = generator(recipe.seed, family, surface, PARAMETERS)
    parameters: Parameters = draw(recipe.families[family].parameters, rng)
    if recipe.sizes is not None:
        rng = generator(recipe.seed, family, index, MESHES)
        size = recipe.sizes[copy]
        wanted = {"vertices": size.vertices, "seed": {"integers": [0, LARGEST_SEED]}}
        drawn = {key: int(value) for key, value in draw(wanted, rng).items()}
        kind = KINDS[(surface + copy) % len(KINDS)]
        parameters = {**parameters, "triangulation": kind, **drawn}
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

    Examples
    --------
    >>> from synthnet.recipe import load
    >>> shapes = draw_shapes(load("1.0"))
    >>> len(shapes), shapes[0].id
    (16550, 'rectangular_prism-00000')
    """
    for name, family in recipe.families.items():
        if name not in FAMILIES:
            raise RecipeError(f"unknown family {name!r}: choose from {', '.join(FAMILIES)}")
        given = [*family.parameters, *(TRIANGULATION if recipe.sizes else ())]
        if sorted(given) != sorted(FAMILIES[name].least):
            raise RecipeError(
                f"family {name} takes the parameters {', '.join(FAMILIES[name].least)}; "
                f"the recipe gives {', '.join(given)}"
            )
    return [
        draw_shape(recipe, name, index)
        for name, family in recipe.families.items()
        for index in range(family.count)
    ]
