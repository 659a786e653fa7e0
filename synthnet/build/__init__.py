"""From a recipe, or from files of others, to a labelled dataset: generate, filter, label, store."""

from synthnet.build.jobs import BuildReport
from synthnet.build.versions import build

__all__ = ["BuildReport", "build"]
