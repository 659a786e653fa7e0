"""The shapes of a recipe: each drawn from its own seed, so order and parallelism cannot matter."""

from synthnet.arrays import Floats
from synthnet.errors import RecipeError
from synthnet.families import FAMILIES
from synthnet.families.charted import TRIANGULATION
from synthnet.families.charted import TRIANGULATIONS as KINDS
from synthnet.mesh.isometries import draw_isometries
from synthnet.recipe.distributions import ISOMETRIES, MESHES, PARAMETERS, draw, generator
from synthnet.recipe.recipe import Recipe
from synthnet.types import Parameters, ShapeSpec

LARGEST_SEED = 2**31 - 1


def draw_shape(recipe: Recipe, family: str, index: int) -> ShapeSpec:
    """Draw one shape of a recipe from the shape's own seed.

    Where surfaces come in several sizes, the meshes of a surface have numbers that follow each
    other. Their kinds of triangulation take turns, so that no kind goes with a size.

    Raise RecipeError if there is no such family.

    Examples
    --------
    >>> from synthnet import recipe
    >>> draw_shape(recipe.load("1.0"), "sphere", 0).id
    'sphere-00000'
    """
    _check_family(family)
    surface, copy = divmod(index, recipe.copies)
    rng = generator(recipe.seed, family, surface, PARAMETERS)
    parameters: Parameters = draw(recipe.families[family].parameters, rng)
    if recipe.sizes is not None:
        rng = generator(recipe.seed, family, index, MESHES)
        size = recipe.sizes[copy]
        distributions = {"vertices": size.vertices, "seed": {"integers": [0, LARGEST_SEED]}}
        drawn = {key: int(value) for key, value in draw(distributions, rng).items()}
        kind = KINDS[(surface + copy) % len(KINDS)]
        parameters = {**parameters, "triangulation": kind, **drawn}
    return ShapeSpec(
        id=f"{family}-{index:05d}",
        family=family,
        index=index,
        parameters=parameters,
        group=FAMILIES[family].group(parameters),
    )


def _check_family(name: str) -> None:
    if name not in FAMILIES:
        raise RecipeError(
            f"unknown family {name!r}: choose from {', '.join(FAMILIES)}, which "
            "synthnet/families/__init__.py names"
        )


def draw_instances(recipe: Recipe, spec: ShapeSpec) -> Floats:
    """Draw the isometries of a shape's instances from its own seed, shape (c, 3, 3), float64."""
    rng = generator(recipe.seed, spec.family, spec.index, ISOMETRIES)
    return draw_isometries(recipe.augmentation.rotations, recipe.augmentation.reflections, rng)


def draw_shapes(recipe: Recipe) -> list[ShapeSpec]:
    """Draw every shape of a recipe's full version, in order of family and index.

    Raise RecipeError if it names a family that is not there, or wrong parameters for one.

    Examples
    --------
    >>> from synthnet.recipe import load
    >>> shapes = draw_shapes(load("1.0"))
    >>> len(shapes), shapes[0].id
    (16550, 'rectangular_prism-00000')
    """
    for name, family in recipe.families.items():
        _check_family(name)
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
