"""A version of the dataset as a value: what is drawn, how it is split, which shards it makes."""

from synthnet.recipe.finding import load, parse, scaled
from synthnet.recipe.names import Kind, Name, available, parse_name, title
from synthnet.recipe.recipe import (
    AugmentationSettings,
    FamilyRecipe,
    FilterSettings,
    Fold,
    LabelSettings,
    Recipe,
    Sealed,
    Size,
    SplitSettings,
    Subset,
)

__all__ = [
    "AugmentationSettings",
    "FamilyRecipe",
    "FilterSettings",
    "Fold",
    "Kind",
    "LabelSettings",
    "Name",
    "Recipe",
    "Sealed",
    "Size",
    "SplitSettings",
    "Subset",
    "available",
    "load",
    "parse",
    "parse_name",
    "scaled",
    "title",
]
