"""How far limits and a second method agree: what is counted, and the sentence."""

import numpy as np
import pytest

from evidence import limits
from synthnet.families.limits import Limit


def of(eigenvalues, bar):
    return Limit(np.array(eigenvalues), np.array(bar))


@pytest.mark.parametrize(
    ("within", "said"), [([25, 10], "On all 35 surfaces"), ([25, 9], "On 34 of 35 surfaces")]
)
def test_surfaces_where_the_two_methods_disagree_are_counted(within, said):
    rows = [{"within": n, "compared": m} for n, m in zip(within, (25, 10), strict=True)]
    assert limits.agreement({"rows": rows[:1]}, {"rows": rows[1:]}).startswith(said)


def test_a_surface_counts_where_all_its_eigenvalues_are_within_both_bars(monkeypatch):
    """Of three surfaces, one is off by more than the bars in its last eigenvalue alone."""
    pinned = {f"cuboid-{i}": of([1.0, 2.0 + i], [0.1, 0.1]) for i in range(3)}
    surfaces = {id: f'["cuboid", {{"i": {i}}}]' for i, id in enumerate(pinned)}
    others = [of([1.0, 2.1], [0.1, 0.1]), of([1.1, 3.0], [0.1, 0.1]), of([1.0, 4.5], [0.1, 0.2])]
    monkeypatch.setattr(limits, "second", lambda name, parameters: others[parameters["i"]])
    row = limits.family("cuboid", list(pinned), pinned, surfaces)
    assert (row["within"], row["compared"]) == (2, 3)
    assert row["apart"] == [0.1, 0.12]  # 0.05, 0.1 and 0.125
    assert row["own_bar"] == 0.05  # 0.2 of 4
