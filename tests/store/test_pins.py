"""The pinned spectra of surfaces: written, read, and, where a version has them, complete."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from evidence.pins import limit_of, pin_limits, surfaces_of
from synthnet import recipe
from synthnet.families import FAMILIES
from synthnet.families.limits import KNOWN, Limit
from synthnet.recipe.drawing import draw_shape
from synthnet.store import pins

IDS = ("sphere-00000", "torus-00003", "tetrahedron-00002", "split_sphere-00004")
ELSEWHERE = "evidence.pins.pins.read"
PINNED = ("1.0", "2.0", "2.1")


@pytest.fixture
def few(monkeypatch):
    """A version of four shapes."""
    monkeypatch.setattr(ELSEWHERE, lambda _: dict.fromkeys(IDS))


def read(path, monkeypatch):
    monkeypatch.setattr("synthnet.store.pins.shipped_table", lambda *_: pq.read_table(path))
    return pins.read_limits("1.0")


def test_limits_are_written_and_read(tmp_path, monkeypatch):
    values = np.arange(1.0, 11) / 3
    path = tmp_path / "x.limits.parquet"
    given = {"a-00000": Limit(values, values / 1024), "b-00000": Limit(values, values)}
    pins.write_limits(path, given)
    limits = read(path, monkeypatch)
    assert list(limits) == ["a-00000", "b-00000"]
    np.testing.assert_array_equal(limits["a-00000"].eigenvalues, values)
    np.testing.assert_allclose(limits["a-00000"].bar, values / 1024, rtol=1e-7)
    assert limits["a-00000"].bar.dtype == np.float64
    encodings = pq.ParquetFile(path).metadata.row_group(0).column(1).encodings
    assert "BYTE_STREAM_SPLIT" in encodings


def test_a_version_without_limits_has_none():
    assert pins.read_limits("1.0-mini") is None


@pytest.mark.usefixtures("few")
def test_pinning_gives_each_shape_the_limit_of_its_surface(tmp_path, monkeypatch):
    path = tmp_path / "1.0.limits.parquet"
    pin_limits("1.0", path)
    limits = read(path, monkeypatch)
    assert tuple(limits) == IDS
    for id, limit in limits.items():
        family, index = id.rsplit("-", 1)
        parameters = draw_shape(recipe.load("1.0"), family, int(index)).parameters
        expected = FAMILIES[family].limit_spectrum(parameters)
        # A tenth of the bar: the last digits of LAPACK depend on its threads.
        np.testing.assert_allclose(limit.eigenvalues, expected.eigenvalues, rtol=1e-9)
        np.testing.assert_allclose(limit.bar, expected.bar, rtol=1e-7)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("few")
def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path, monkeypatch, capsys):
    path = tmp_path / "1.0.limits.parquet"
    key = surfaces_of("1.0", IDS)["torus-00003"]
    known = {"key": key, "eigenvalues": [float(i) for i in range(1, 11)], "bar": [0.5] * 10}
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(known) + "\n" + '{"key": "cut o')
    pin_limits("1.0", path)
    assert capsys.readouterr().out.startswith("3 limits to compute, 1 are there")
    np.testing.assert_array_equal(
        read(path, monkeypatch)["torus-00003"].eigenvalues, known["eigenvalues"]
    )


def test_limits_that_another_version_pins_are_taken_from_there(tmp_path, monkeypatch, capsys):
    ids = ["blob-00000", "blob-00001", "shaft-00000"]
    monkeypatch.setattr(ELSEWHERE, lambda _: dict.fromkeys(ids))
    expected = pins.read_limits("2.0")
    path = tmp_path / "2.1.limits.parquet"
    pin_limits("2.1", path)
    assert capsys.readouterr().out.startswith("1 limits to compute, ")
    limits = read(path, monkeypatch)
    assert list(limits) == ids
    for id in ids[:2]:
        np.testing.assert_array_equal(limits[id].eigenvalues, expected[id].eigenvalues)
        np.testing.assert_array_equal(limits[id].bar, expected[id].bar)


def test_triangulations_of_one_surface_share_its_limit():
    ids = [f"ellipsoid-{i:05}" for i in range(6)]
    surfaces = surfaces_of("2.0", ids)
    assert len(set(surfaces.values())) == 2
    assert len({surfaces[id] for id in ids[:3]}) == 1


@pytest.mark.parametrize("version", PINNED)
def test_every_shape_has_a_limit_that_ascends_within_its_bar(version):
    limits, labels = pins.read_limits(version), pins.read(version)
    assert list(limits) == list(labels)
    known = np.array([FAMILIES[id.rpartition("-")[0]].limit is not None for id in limits])
    values = np.array([limit.eigenvalues for limit in limits.values()])
    bars = np.array([limit.bar for limit in limits.values()])
    assert values.shape == bars.shape == (len(labels), 10)
    assert (values > 0).all()
    assert (np.diff(values, axis=1) >= 0).all()
    relative = (bars / values).max(axis=1)
    assert (relative[known] <= KNOWN * (1 + 1e-6)).all()
    assert np.median(relative[~known]) <= 1e-4
    assert np.percentile(relative[~known], 99) <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("version", PINNED)
def test_some_pins_are_what_is_computed_now(version):
    limits = pins.read_limits(version)
    ids = list(limits)[:: len(limits) // 40]
    for id, key in surfaces_of(version, ids).items():
        if json.loads(key)[0] == "pretzel":
            continue  # takes seconds
        limit = limit_of(key)
        np.testing.assert_allclose(limits[id].eigenvalues, limit.eigenvalues, rtol=1e-7)
