"""Pictures of numbers of docs/data: each is what its numbers draw."""

import pytest

from evidence import DOCS, card_pictures, figures, numbers
from evidence.__main__ import PICTURES
from evidence.blocks import CARDS, rendered


@pytest.mark.parametrize("name", ["growth", "peers"])
def test_pictures_of_times_are_what_their_numbers_draw(name, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "DOCS", tmp_path)
    rendered(*PICTURES[name])
    drawn = (tmp_path / f"{name}.svg").read_text()
    assert (DOCS / f"{name}.svg").read_text() == drawn, f"stale: python -m evidence draw {name}"


@pytest.mark.parametrize("version", CARDS)
def test_distributions_are_what_the_facts_draw(version):
    drawn = card_pictures.distributions(numbers.read(f"shapes-{version}"))
    picture = DOCS / "pictures" / version / "distributions.svg"
    assert picture.read_text() == drawn, f"stale: python -m evidence draw {version}"
