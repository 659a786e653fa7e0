"""The picture of the map: drawn from the plan that tests/ground holds the code to."""

import re

import pytest

from evidence import architecture
from evidence.__main__ import main
from tests.ground import test_imports as house


def test_picture_is_what_the_plan_and_the_imports_say():
    assert architecture.TARGET.read_text() == architecture.drawing(), (
        "stale: python -m evidence draw architecture"
    )


def test_picture_has_every_room_once_and_an_arrow_an_import_that_follows_from_no_other():
    svg = architecture.drawing()
    names = re.findall(r'class="name"[^>]*>(\w+)<', svg)
    rooms = [room for plan in house.PLANS.values() for line in plan for room in line.split()]
    assert [name for name in names if name not in ("ground", "doors")] == rooms
    needed = [
        pair
        for package in house.PLANS
        for pair in architecture.needed(architecture.arrows(package))
    ]
    assert svg.count('class="arrow"') == len(needed) + 1  # and one between the packages
    assert ("recipe", "families") in needed
    assert ("recipe", "mesh") not in needed  # by way of families


@pytest.mark.parametrize("package", house.PLANS)
def test_arrows_go_up(package):
    arrows = list(architecture.arrows(package))
    assert len(arrows) > len(house.PLANS[package])
    for lower, upper in arrows:
        assert house.level(package, upper) < house.level(package, lower)


def test_command_draws_it(tmp_path, monkeypatch):
    monkeypatch.setattr(architecture, "TARGET", tmp_path / "architecture.svg")
    assert main(["draw", "architecture"]) == 0
    assert (tmp_path / "architecture.svg").read_text() == architecture.drawing()
