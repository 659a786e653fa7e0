"""Which meshes of packages are tried and which make the set, on packages made here."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from evidence import packages
from synthnet.build.packages import Package, read

BOX = Package("toy-box", "1.0", "MIT", "toys", "toybox", ("other licence",), {})


def bumpy(seed, subdivisions=3):
    """Return a ball that no other seed's is like."""
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    a, b, c = np.random.default_rng(seed).normal(size=(3, 3))
    bumps = 0.3 * np.sin(2 * ball.vertices @ a) + 0.2 * np.cos(3 * ball.vertices @ b + c[0])
    ball.vertices *= (1 + bumps)[:, None]
    return ball


@pytest.fixture
def meshes(tmp_path, monkeypatch):
    """A folder with a package whose files each meet one rule."""
    folder = tmp_path / "meshes" / "toybox"
    for below in ("a", "other licence"):
        (folder / below).mkdir(parents=True)
    bumpy(1).export(folder / "a" / "arm_L.stl")
    bumpy(2).export(folder / "a" / "arm_R.stl")  # another surface, by its name the same
    bumpy(3).export(folder / "head.ply")
    (folder / "z_bytes.ply").write_bytes((folder / "head.ply").read_bytes())
    mirrored = bumpy(3)
    mirrored.apply_transform(np.diag([-2.0, 2.0, 2.0, 1.0]))
    mirrored.export(folder / "z_mirrored.stl")  # a copy, whatever its size and side
    bumpy(4, subdivisions=2).export(folder / "small.ply")  # 162 vertices
    two = trimesh.util.concatenate([bumpy(5), bumpy(6).apply_translation([9, 0, 0])])
    two.export(folder / "two.ply")
    fin = bumpy(7)
    fin.faces = np.vstack([fin.faces, [*fin.faces[0][:2], fin.faces[-1][0]]])
    fin.export(folder / "fin.ply")
    bumpy(8).export(folder / "other licence" / "left out.ply")
    (folder / "read me.txt").write_text("no mesh")
    monkeypatch.setattr(packages.packages, "packages", lambda: (BOX,))
    return tmp_path / "meshes"


def test_each_rule_leaves_out_what_it_says(meshes):
    (survey,) = packages.surveys(meshes)
    assert list(survey.package.files) == ["a/arm_L.stl", "head.ply"]
    # small.ply, arm_R.stl and z_bytes.ply are counted among the files, and not tried
    assert (survey.files, survey.tried) == (8, 5)
    assert (survey.labelled, survey.components) == (4, 1)
    assert survey.refused == {"non_manifold_edge": 1}


@pytest.mark.slow
def test_a_list_that_is_not_what_the_files_give_is_wrong(meshes, monkeypatch):
    (survey,) = packages.surveys(meshes)
    row = packages.measure(str(meshes))
    assert packages.problems(row) == [
        "toy-box: packages.toml has other files: python -m evidence pin packages"
    ]
    monkeypatch.setattr(packages.packages, "packages", lambda: (survey.package,))
    assert packages.problems(packages.measure(str(meshes))) == []


def test_the_list_is_read_as_it_was_written(meshes, tmp_path, monkeypatch):
    monkeypatch.setattr(packages, "LIST", tmp_path / "packages.toml")
    packages.pin_packages(meshes)
    (written,) = read((tmp_path / "packages.toml").read_text())
    assert replace(written, files={}) == BOX
    assert list(written.files) == ["a/arm_L.stl", "head.ply"]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("arm_L.stl", "arm_R.stl", True),
        ("pial.left.gii", "pial.right.gii", True),
        ("l_femur.stl", "r_femur.stl", True),
        ("kr6r700.stl", "kr6l700.stl", False),
        ("lunate.stl", "runate.stl", False),
    ],
)
def test_sides_are_words_of_a_name(one, other, same):
    one, other = (packages.SIDE.sub("side", name.lower()) for name in (one, other))
    assert (one == other) is same


def test_the_table_has_a_sum():
    row = {"package": "a", "version": "1", "licence": "MIT", "meshes": "toys", "files": 9}
    row |= {"tried": 5, "labelled": 3, "refused": {"non_manifold_edge": 2}, "components": 1}
    row |= {"set": 2, "listed": True}
    lines = packages.table({"rows": [row, row]}).splitlines()
    assert [cell.strip() for cell in lines[-1].split("|")[1:-1]] == [
        *("all", "", "", "18", "10", "6", "edge of more than two faces 4", "2", "4")
    ]
    assert packages.claim({"rows": [row, row]}) == "6 of 10 (60%)"
