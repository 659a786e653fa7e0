"""The table of faults that are put into the core: each still finds the text that it replaces."""

from pathlib import Path

import pytest

from tests.mutations import MUTATIONS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", MUTATIONS)
def test_what_a_fault_replaces_stands_there_once(name: str) -> None:
    file, old, new, _ = MUTATIONS[name]
    assert (ROOT / file).read_text().count(old) == 1
    assert new != old
