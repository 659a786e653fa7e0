"""Pictures as bytes: sizes, signs, notebooks, and no hint of a user's own style."""

import io
import json
import os
import subprocess
import sys
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


IN_A_SHELL = """
import json
import sys

from IPython.core.interactiveshell import InteractiveShell

shell = InteractiveShell.instance()
if "without-matplotlib" in sys.argv:
    sys.modules["matplotlib"] = None

import numpy as np
import synthnet
from synthnet.types import Certificate, Sample, ShapeSpec

drawn_at_import = "synthnet.pictures.draw" in sys.modules
mesh = synthnet.Mesh(np.eye(3), np.array([[0, 1, 2]]))
sample = Sample(
    ShapeSpec("triangle-00000", "triangle", 0, {}, "group"), mesh, np.arange(1.0, 11.0), 0.0,
    Certificate(11, 10.5, 1e-9), np.eye(3)[None], "train", ("train",),
)
shown = [shell.display_formatter.format(thing)[0] for thing in (mesh, sample)]
pictures = [data.get("image/png", b"")[:4].decode("latin-1") for data in shown]
print(json.dumps([drawn_at_import, pictures, [sorted(data) for data in shown]]))
"""


def in_a_shell(tmp_path, *arguments):
    done = subprocess.run(
        [sys.executable, "-c", IN_A_SHELL, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "IPYTHONDIR": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_a_real_shell_shows_a_mesh_and_a_sample_as_png(tmp_path):
    drawn_at_import, pictures, kinds = in_a_shell(tmp_path)
    assert not drawn_at_import
    assert pictures == ["\x89PNG", "\x89PNG"]
    assert kinds == [["image/png", "text/plain"]] * 2


def test_a_shell_without_matplotlib_shows_the_text(tmp_path):
    _, _, kinds = in_a_shell(tmp_path, "without-matplotlib")
    assert kinds == [["text/plain"]] * 2


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
    vectors = spectrum.compute(sample.mesh, 5).eigenvectors
    flips = np.array([1.0, -1.0, -1.0, 1.0, -1.0])
    np.testing.assert_array_equal(draw.signed(vectors), draw.signed(vectors * flips))
    np.testing.assert_array_equal(np.abs(draw.signed(vectors)), np.abs(vectors))


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
