from __future__ import annotations

import hypothesis
import pytest

from synthnet import recipe
from synthnet.families import draw_shapes
from synthnet.recipe import FilterSettings, Recipe
from synthnet.types import ShapeSpec

hypothesis.settings.register_profile("synthnet", derandomize=True, deadline=None)
hypothesis.settings.load_profile("synthnet")


# --- the recipe and the draw of version 1.0 -------------------------------------------


@pytest.fixture(scope="session")
def recipe_1_0() -> Recipe:
    return recipe.load("1.0")


@pytest.fixture(scope="session")
def limits(recipe_1_0: Recipe) -> FilterSettings:
    return recipe_1_0.filters


@pytest.fixture(scope="session")
def specs(recipe_1_0: Recipe) -> list[ShapeSpec]:
    return draw_shapes(recipe_1_0)


# --- end of the recipe and the draw ---------------------------------------------------
