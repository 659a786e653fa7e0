"""From a recipe, or from files of others, to a labelled dataset: generate, filter, label, store."""

from synthnet.build.jobs import BuildReport, Watcher
from synthnet.build.versions import build, ensure_built

__all__ = ["BuildReport", "Watcher", "build", "ensure_built"]
