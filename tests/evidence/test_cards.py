"""The pictures and the measured facts of the dataset cards."""

import json
import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from evidence import folds
from evidence.shapes import new_families
from synthnet import recipe
from synthnet.families import FAMILIES
from synthnet.types import Mesh

DOCS = Path(__file__).parents[2] / "docs"
CARDS = {
    "1.0": DOCS / "dataset-card.md",
    **{version: DOCS / f"dataset-card-{version}.md" for version in ("2.0", "2.1")},
}
BUDGET = 1.1e6  # bytes of pictures in the repository, for each card


def facts(version):
    return json.loads((DOCS / "data" / f"shapes-{version}.json").read_text())


def cells(version, part):
    """Rows of the table between two marks of a card, the header left out."""
    text = CARDS[version].read_text()
    inside = text.partition(f"<!-- begin {part} -->")[2].partition(f"<!-- end {part} -->")[0]
    rows = [line for line in inside.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


@pytest.mark.parametrize("version", CARDS)
def test_every_family_has_its_pictures(version):
    new = new_families(version)
    assert len(new) > 0
    for name in new:
        parameters = recipe.load(version).families[name].parameters
        varied = [key for key, value in parameters.items() if isinstance(value, dict)]
        thumbnail = matplotlib.image.imread(DOCS / "pictures" / version / f"{name}.png")
        assert thumbnail.shape[:2] == (120, 160)
        assert 0.05 < (thumbnail[..., :3] < 0.98).any(axis=2).mean() < 0.95
        strips = matplotlib.image.imread(DOCS / "pictures" / version / f"{name}-parameters.png")
        assert strips.shape[1] == 675
        assert strips.shape[0] == pytest.approx(len(varied) * 200, abs=len(varied) + 1)


def test_pictures_are_within_their_budget_and_all_are_shown():
    pages = "".join(page.read_text() for page in DOCS.glob("*.md"))
    pages += (DOCS.parent / "README.md").read_text().replace("(docs/", "(")
    files = [path for path in (DOCS / "pictures").rglob("*.*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < BUDGET * len(CARDS)
    for path in files:
        assert f"({path.relative_to(DOCS).as_posix()})" in pages, path


def test_every_picture_has_words_for_who_cannot_see_it():
    pages = {page.name: page.read_text() for page in DOCS.glob("*.md")}
    words = [(p, alt) for p, text in pages.items() for alt in re.findall(r"!\[([^\]]*)\]\(", text)]
    assert len(words) > 50
    assert [(page, alt) for page, alt in words if len(alt) <= 3] == []


@pytest.mark.parametrize("version", CARDS)
def test_facts_are_those_of_the_pinned_build(version):
    data = facts(version)
    build = json.loads((DOCS / "data" / f"build-{version}.json").read_text())
    assert data["recipe_digest"] == build["recipe_digest"] == recipe.load(version).digest
    assert [row["family"] for row in build["families"]] == list(recipe.load(version).families)
    lock = pq.read_table(Path(recipe.__file__).parent / "versions" / f"{version}.lock.parquet")
    labels = np.array(lock["eigenvalues"].to_pylist())
    families = np.array([id.rpartition("-")[0] for id in lock["id"].to_pylist()])
    new = [row for row in build["families"] if row["family"] in new_families(version)]
    assert [f["family"] for f in data["families"]] == [row["family"] for row in new]
    for family, built in zip(data["families"], new, strict=True):
        assert sum(family["splits"].values()) == built["kept"]
        for counts in family["counts"].values():
            assert sum(counts) == built["kept"]
        mine = labels[families == family["family"]]
        for measure, column in (("first", 0), ("last", -1)):
            expected = np.percentile(mine[:, column], (0, 5, 50, 95, 100))
            np.testing.assert_allclose(family["percentiles"][measure], expected, rtol=1e-3)
    reasons = {reason for row in new for reason in row["rejected"]}
    assert {rejection["reason"] for rejection in data["rejections"]} == reasons


@pytest.mark.parametrize("version", CARDS)
def test_versions_and_their_semantic_numbers_are_on_both_cards(version):
    from synthnet.loaders import croissant

    section = CARDS[version].read_text().partition("## Versions")[2]
    assert len(recipe.available()) > 3
    for name in recipe.available():
        base = recipe.load(name).base
        (row,) = (line for line in section.splitlines() if f"`{name}`" in line)
        assert f"| {croissant.ABOUT[base].semantic} |" in row


def test_folds_are_of_the_smooth_families_and_pretzels_have_them():
    rows = {row[0]: row[1:] for row in cells("2.0", "folds")}
    assert list(rows) == [FAMILIES[name].title for name in folds.SMOOTH]
    medians = {
        title: [float(re.match(r"[\d.]+", cell)[0]) for cell in row] for title, row in rows.items()
    }
    for title, (*_, fine_angle, fine_area) in medians.items():
        assert (fine_angle > folds.SHARP) == (title == FAMILIES["pretzel"].title)
        assert fine_area < 0.2
    box = trimesh.creation.box()
    angle, share = folds.folded(Mesh(box.vertices, box.faces))
    assert angle == pytest.approx(90)
    assert share == pytest.approx(1)
