"""Pictures as bytes: sizes, signs, notebooks, and no hint of a user's own style."""

import io
from dataclasses import replace

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest

from synthnet import spectrum
from synthnet.pictures import draw
from synthnet.types import Mesh

HEADER = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def sample(tiny_samples):
    return tiny_samples["torus"][0]


def pixels(png):
    return matplotlib.image.imread(io.BytesIO(png))[..., :3]


def test_a_sample_and_a_mesh_show_themselves_in_a_notebook(sample):
    assert draw.notebook_picture(sample) == draw.picture_of_sample(sample)
    assert draw.notebook_picture(sample.mesh) == draw.picture_of_mesh(sample.mesh)
    assert draw.notebook_picture(sample).startswith(HEADER)
    assert pixels(draw.notebook_picture(sample.mesh)).shape == (360, 480, 3)
    assert draw.notebook_picture(Mesh(np.eye(3), np.zeros((0, 3), dtype=int))) is None


def test_the_same_sample_gives_the_same_bytes_whatever_the_users_style(sample):
    plain = draw.picture_of_sample(sample, eigenfunctions=2, edges=True)
    with mpl.rc_context({"axes.facecolor": "black", "font.size": 30}):
        assert draw.picture_of_sample(sample, eigenfunctions=2, edges=True) == plain
    assert b"matplotlib" not in plain.lower()


def test_eigenfunctions_are_drawn_in_blue_and_orange(sample):
    below = pixels(draw.picture_of_sample(sample, eigenfunctions=1))[600:, :270]
    blue, orange = below[..., 2] - below[..., 0] > 0.4, below[..., 0] - below[..., 2] > 0.4
    assert blue.sum() > 500
    assert orange.sum() > 500


def test_signs_do_not_hang_on_the_sign_that_was_found(sample):
    found = spectrum.compute(sample.mesh, 5).eigenvectors
    flips = np.array([1.0, -1.0, -1.0, 1.0, -1.0])
    np.testing.assert_array_equal(draw.signed(found), draw.signed(found * flips))
    np.testing.assert_array_equal(np.abs(draw.signed(found)), np.abs(found))


def test_a_sheet_has_a_row_for_each_five_meshes(sample):
    for count, rows in ((1, 1), (5, 1), (6, 2)):
        sheet = pixels(draw.picture_of_sheet([sample.mesh] * count, [["a", "b"]] * count, "many"))
        tall = 1.5 + 0.1 + 2 * 0.135
        assert sheet.shape[0] == pytest.approx(150 * (rows * tall + 0.42), abs=1)
        assert sheet.shape[1] == 270 * min(count, 5)


def test_a_mesh_that_cannot_be_drawn_leaves_no_file(sample, tmp_path):
    broken = replace(sample, mesh=Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]])))
    with pytest.raises(ValueError, match="not finite cannot be drawn"):
        draw.draw_sample(broken, tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_a_dollar_sign_of_an_imported_name_begins_no_formula(sample):
    spec = replace(sample.spec, id="files-$\\no$")
    assert draw.picture_of_sample(replace(sample, spec=spec)).startswith(HEADER)


def test_a_sheet_of_nothing_is_refused():
    with pytest.raises(ValueError, match="needs at least 1 mesh, got 0"):
        draw.picture_of_sheet([], [])
