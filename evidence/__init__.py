"""Every measurement of the project, and every generated block of its pages.

``python -m evidence`` lists both. A measurement writes its numbers to ``docs/data``; a block is
made from such files alone, so pages can be filled and checked without measuring again.
"""

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
DATA = DOCS / "data"
BASELINES = ROOT / "baselines"


def baseline(name: str) -> ModuleType:
    """Import a file of baselines/, which imports its siblings by their bare names."""
    if str(BASELINES) not in sys.path:
        sys.path.insert(0, str(BASELINES))
    return import_module(name)
