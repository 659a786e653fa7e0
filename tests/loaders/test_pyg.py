import copy
import dataclasses
import functools
import json
import multiprocessing
import os
import pickle
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.spatial import KDTree
from torch_geometric.data import Data, InMemoryDataset
from torch_geometric.loader import DataLoader
from torch_geometric.transforms import Compose, FaceToEdge, NormalizeScale

from synthnet import spectrum, store
from synthnet.errors import DamagedError, RecipeError, StoreError
from synthnet.loaders import mapped
from synthnet.loaders.fingerprint import fingerprint
from synthnet.loaders.pyg import SynthNet, surface_spectra
from synthnet.loaders.transformed import TransformedItems
from synthnet.mesh.geometry import volume
from synthnet.recipe import Kind
from synthnet.store import limits, unpacked
from synthnet.types import SPLITS, Mesh

MINI = "1.0-mini"


@pytest.fixture(scope="session")
def samples(unpacking_home):
    return {s.spec.id: s for s in store.open_dataset(MINI, unpacking_home).samples()}


@pytest.fixture
def open_split(unpacking_home):
    return lambda split="train", **options: SynthNet(unpacking_home, MINI, split, **options)


@pytest.fixture
def items(open_split):
    """The test shapes as they are."""
    return open_split("test", augment=False)


def assert_same_positions(actual, expected):
    for item, other in zip(actual, expected, strict=True):
        assert torch.equal(item.pos, other.pos)


def as_mesh(data):
    return Mesh(data.pos.numpy(), data.face.t().numpy())


def test_items_are_what_the_shards_hold(items, samples):
    assert len(items) == 34
    for data in items:
        sample = samples[data.shape_id]
        assert data.family == sample.spec.family
        assert data.pos.dtype == torch.float32
        assert data.face.dtype == torch.int64
        assert data.y.shape == (1, 10)
        assert data.y.dtype == torch.float32
        np.testing.assert_array_equal(data.pos, sample.mesh.vertices)
        np.testing.assert_array_equal(data.face.t(), sample.mesh.faces)
        np.testing.assert_array_equal(data.y[0], sample.eigenvalues.astype(np.float32))


def test_the_target_is_the_mesh_or_its_surface(open_split, samples, unpacking_home):
    known = {row.id: row for row in limits.read(store.open_dataset(MINI, unpacking_home))}
    mesh, surface = (open_split("test", augment=False, target=t) for t in ("mesh", "surface"))
    assert mesh.processed_dir == surface.processed_dir  # only the labels are unpacked
    again = pickle.loads(pickle.dumps(surface))
    assert len(mesh) == len(surface) == len(again) == 34
    for label, limit, copied in zip(mesh, surface, again, strict=True):
        expected = known[limit.shape_id].eigenvalues.astype(np.float32)
        assert limit.y.dtype == torch.float32
        np.testing.assert_array_equal(limit.y[0], expected)
        np.testing.assert_array_equal(copied.y[0], expected)
        np.testing.assert_array_equal(label.y[0], samples[label.shape_id].eigenvalues.astype("f4"))
        assert not torch.equal(label.y, limit.y)
        assert torch.equal(label.pos, limit.pos)
    assert torch.equal(surface.y, torch.cat([data.y for data in surface]))
    assert "target='surface'" in repr(surface)


def test_a_pre_transform_is_kept_by_its_target(open_split):
    kept = [
        open_split("test", augment=False, target=target, pre_transform=NormalizeScale())
        for target in ("surface", "mesh", "surface")
    ]
    assert kept[0].processed_dir == kept[2].processed_dir != kept[1].processed_dir
    plain = [open_split("test", augment=False, target=target) for target in ("surface", "mesh")]
    for done, source in zip(kept, plain, strict=False):
        assert torch.equal(torch.cat([data.y for data in done]), source.y)


@pytest.fixture
def home(items, unpacking_home, tmp_path):
    """A copy of 1.0-mini and what was unpacked of it, without what transforms made: 0.4 GB."""
    where = mapped.directory(store.open_dataset(MINI, unpacking_home))
    transformed = [path.name for path in where.parent.glob("*") if path != where]
    ignore = shutil.ignore_patterns(*transformed)
    shutil.copytree(unpacking_home / MINI, tmp_path / MINI, ignore=ignore)
    return tmp_path


def test_pinned_limits_are_added_to_a_dataset_that_was_built_without(open_split, home):
    shutil.rmtree(home / MINI / limits.DIRECTORY)
    dataset = SynthNet(home, MINI, "test", augment=False, target="surface")
    expected = open_split("test", augment=False, target="surface")
    assert torch.equal(dataset.y, expected.y)


def test_a_surface_needs_limits(home, monkeypatch):
    shutil.rmtree(home / MINI / limits.DIRECTORY)
    plain = store.open_dataset(MINI, home)
    monkeypatch.setattr(store.StoredDataset, "kind", Kind.SCALED)
    remedy = "has no limits of its surfaces: run `synthnet build 1.0-mini --limits`$"
    with pytest.raises(StoreError, match=remedy):
        surface_spectra(plain)
    monkeypatch.setattr(store.StoredDataset, "kind", Kind.IMPORTED)
    with pytest.raises(StoreError, match=r"have no known surface, take target='mesh'$"):
        surface_spectra(plain)
    with pytest.raises(ValueError, match="target must be one of mesh, surface, got 'limit'"):
        SynthNet(home, MINI, target="limit")


def test_grouped_splits_are_the_shards_splits(open_split, samples):
    for split in SPLITS:
        expected = [s.spec.id for s in samples.values() if s.split == split]
        assert expected
        assert open_split(split, augment=False).shape_id == expected


def test_paper_splits_are_the_shards_splits(open_split, samples):
    for split in SPLITS:
        instances = [(d.shape_id, d.instance) for d in open_split(split, protocol="paper")]
        expected = [
            (s.spec.id, i)
            for s in samples.values()
            for i, name in enumerate(s.paper_splits)
            if name == split
        ]
        assert instances == expected != []


def test_nine_instances_are_the_isometries_of_the_shape(open_split, samples):
    train = open_split()
    assert len(train) == 9 * len(open_split(augment=False))
    for data in train[:18]:
        sample = samples[data.shape_id]
        expected = sample.mesh.vertices @ sample.isometries[data.instance].T
        np.testing.assert_allclose(data.pos, expected, atol=1e-4, rtol=1e-5)
        assert volume(as_mesh(data)) == pytest.approx(volume(sample.mesh), rel=1e-4)


def test_an_instance_keeps_the_label(open_split):
    nine = open_split(augment=True)[-9:]
    assert len(nine) == 9
    for data in nine:
        label = spectrum.compute(as_mesh(data)).eigenvalues
        np.testing.assert_allclose(label, data.y[0], rtol=1e-4)


def test_random_augmentation_is_fresh_isometric_and_follows_torch_seed(open_split):
    train = open_split(augment="random")
    assert len(train) == len(open_split(augment=False))
    torch.manual_seed(0)
    first, second = train[3], train[3]
    torch.manual_seed(0)
    again = train[3]
    assert not torch.allclose(first.pos, second.pos)
    assert torch.equal(first.pos, again.pos)
    signs = set()
    for _ in range(16):
        moved = as_mesh(train[3])
        signs.add(bool((moved.faces == as_mesh(open_split(augment=False)[3]).faces).all()))
        assert volume(moved) == pytest.approx(volume(as_mesh(first)), rel=1e-4)
    assert signs == {True, False}  # both rotations and reflections come up


def test_it_is_an_in_memory_dataset_that_loads_in_batches(open_split):
    train = open_split(transform=FaceToEdge(remove_faces=False))
    assert isinstance(train, InMemoryDataset)
    batch = next(iter(DataLoader(train, batch_size=5, shuffle=True)))
    assert batch.y.shape == (5, 10)
    assert len(batch.family) == len(batch.shape_id) == 5
    assert int(batch.face.max()) == batch.num_nodes - 1  # faces are counted through the batch
    assert batch.edge_index.shape[1] == batch.face.shape[1] * 3  # closed: each edge twice


@pytest.mark.filterwarnings("ignore:This DataLoader will create")  # on a machine of one core
@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
def test_worker_processes_read_the_same_items(items, start):
    if start not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this platform cannot {start} processes")
    loader = DataLoader(items[:6], batch_size=2, num_workers=2, multiprocessing_context=start)
    positions = torch.cat([batch.pos for batch in loader])
    assert torch.equal(positions, torch.cat([data.pos for data in items[:6]]))


def test_slices_shuffles_copies_and_pickles_agree(open_split):
    test = open_split("test")
    part = test[4:9]
    assert [d.shape_id for d in part] == [test[i].shape_id for i in range(4, 9)]
    assert len(test[0.5:]) == len(test) - round(len(test) * 0.5)
    shuffled, order = test.shuffle(return_perm=True)
    assert torch.equal(shuffled[0].pos, test[int(order[0])].pos)
    for other in (part.copy(), pickle.loads(pickle.dumps(part)), copy.copy(part)):
        assert len(other) == 5
        for a, b in zip(other, part, strict=True):
            assert torch.equal(a.pos, b.pos)
            assert torch.equal(a.face, b.face)
            assert a.shape_id == b.shape_id
    assert len(test.copy()) == len(test)
    assert torch.equal(test.copy().y, test.y)


def test_attributes_of_the_whole_split(open_split):
    test = open_split("test")[2:7]
    assert torch.equal(test.y, torch.cat([data.y for data in test]))
    assert test.family == [data.family for data in test]
    assert test.shape_id == [data.shape_id for data in test]
    assert test.num_classes == 10
    with pytest.raises(AttributeError, match="colour"):
        _ = test.colour


def test_summary_counts_the_split(items):
    summary = items.get_summary()
    assert summary.num_graphs == len(items)
    assert summary.num_nodes.max == max(data.num_nodes for data in items)


def test_changing_an_item_changes_nothing_else(items):
    before = items[0].pos.clone()
    data = items[0]
    data.pos.zero_()
    data.y.zero_()
    assert torch.equal(items[0].pos, before)
    assert items[0].y.abs().sum() > 0


def test_mapped_pages_are_handed_back(items, monkeypatch):
    monkeypatch.setattr(mapped, "RELEASE_BYTES", 1)
    plain = list(items)
    assert len(plain) > 1
    assert_same_positions(items, plain)


class Centre:
    """A transform with state, as a user writes one."""

    def __init__(self, offset):
        self.offset = offset

    def __call__(self, data):
        data.pos = data.pos - data.pos.mean(dim=0) + self.offset
        return data


def few_vertices(data):
    return data.num_nodes < 400


def test_pre_transform_is_applied_to_every_instance_once(open_split):
    plain = open_split("test", pre_filter=few_vertices)
    assert len(plain) >= 20
    for pre_transform in (Centre(1.0), Compose([NormalizeScale(), FaceToEdge(remove_faces=True)])):
        done = open_split("test", pre_filter=few_vertices, pre_transform=pre_transform)
        assert len(done) == len(plain)
        for a, b in zip(done[:20], plain[:20], strict=True):
            expected = pre_transform(b)
            assert a.to_dict().keys() == expected.to_dict().keys()
            for key, value in expected.to_dict().items():
                same = torch.equal if isinstance(value, torch.Tensor) else type(value).__eq__
                assert same(a[key], value), key


@pytest.mark.slow
def test_a_callable_has_the_same_key_in_every_process():
    """Sets of texts are passed through in another order there; weights need a gradient."""
    code = (
        "import functools, torch; from synthnet.loaders.fingerprint import fingerprint; "
        "torch.manual_seed(0); names = {'pos', 'face', 'x', 'y'}; "
        "f = lambda data: data if data in {'pos', 'face', 'x'} else torch.relu(data); "
        "print(fingerprint(functools.partial(f, names, torch.nn.Linear(2, 2))))"
    )
    keys = set()
    for seed in ("1", "2"):  # with which sets of these names differ in order
        how = {"env": {**os.environ, "PYTHONHASHSEED": seed}, "check": True, "text": True}
        keys.add(subprocess.run([sys.executable, "-c", code], capture_output=True, **how).stdout)
    assert len(keys) == 1


def test_a_changed_pre_transform_is_another_dataset(open_split):
    first = open_split("test", pre_transform=Centre(0.0))
    second = open_split("test", pre_transform=Centre(5.0))
    assert first.processed_dir != second.processed_dir
    assert first[0].pos.mean() == pytest.approx(0, abs=1e-5)
    assert second[0].pos.mean() == pytest.approx(5, abs=1e-4)
    a = open_split("test", pre_transform=lambda data: Data(x=data.pos * 2, y=data.y))
    b = open_split("test", pre_transform=lambda data: Data(x=data.pos * 3, y=data.y))
    assert torch.allclose(a[0].x * 1.5, b[0].x)


def scaled(data, by=1.0):
    return Data(x=data.pos * by, y=data.y)


class Scale:
    __slots__ = ("by",)

    def __init__(self, by):
        self.by = by

    def __call__(self, data):
        return scaled(data, self.by)

    def method(self, data):
        return scaled(data, self.by)


def with_default(value):
    def transform(data, by=value):
        return scaled(data, by)

    return transform


class Weighted:
    def __init__(self, by):
        self.weights = torch.full((3000,), 1.0)
        self.weights[1500] = by  # repr shortens what is in the middle

    def __call__(self, data):
        return scaled(data, self.weights[1500])


@pytest.mark.parametrize(
    "make",
    [
        lambda by: functools.partial(scaled, by=by),
        Scale,
        lambda by: Scale(by).method,
        with_default,
        Weighted,
        lambda by: lambda data: scaled(data, by),
    ],
    ids=["partial", "slots", "method", "default", "tensor", "closure"],
)
def test_a_pre_transform_with_another_state_is_another_dataset(open_split, items, make):
    for by in (2.0, 3.0):
        item = open_split("test", augment=False, pre_transform=make(by))[0]
        assert torch.allclose(item.x, items[0].pos * by)


class Holder:
    """Not callable itself: its method is what is given."""

    def __init__(self, held):
        self.held = held

    def method(self, data):
        return data


def made(code, by):
    """What a module of a user's defines as f; none of its sources can be read."""
    namespace = {"__name__": "elsewhere"}
    exec(code.format(by=by), namespace)
    return namespace["f"]


CONSTANT = """import numpy as np, torch
class A:
 by = VALUE
 def g(self, data): return data
f = A().g"""

CODES = {
    "function": "f = lambda data: data * {by}",
    "method": "class A:\n def g(self, data): return data * {by}\nf = A().g",
    "static": "class A:\n @staticmethod\n def g(data): return data * {by}\nf = A()",
    "constant": "class A:\n by = {by}\n def g(self, data): return data * self.by\nf = A().g",
    "tuple constant": CONSTANT.replace("VALUE", "({by},)"),
    "list constant": CONSTANT.replace("VALUE", "[{by}]"),
    "dict constant": CONSTANT.replace("VALUE", "dict(x={by})"),
    "set constant": CONSTANT.replace("VALUE", "frozenset([{by}])"),
    "array constant": CONSTANT.replace("VALUE", "np.full(2, {by})"),
    "number of NumPy's": CONSTANT.replace("VALUE", "np.float64({by})"),
    "tensor constant": CONSTANT.replace("VALUE", "torch.full((2,), {by})"),
    "base": "class A:\n def g(self, data): return data * {by}\nclass B(A): pass\nf = B().g",
    "tuple": "from typing import NamedTuple\nclass A(NamedTuple):\n x: int = 1\n"
    " def __call__(self, data): return data * {by}\nf = A()",
    "dict": "class A(dict):\n def __call__(self, data): return data * {by}\nf = A(x=1)",
    "attribute": "def f(data): return data * f.by\nf.by = {by}",
    "default": "def f(data, by={by}): return data * by",
    "cached": "import functools\n@functools.lru_cache\ndef f(data): return data * {by}",
    "wrapper": "import functools\ndef g(h):\n @functools.wraps(h)\n def inner(data): "
    "return h(data) * {by}\n return inner\n@g\ndef f(data): return data",
    "wrapped": "import functools\ndef g(h):\n @functools.wraps(h)\n def inner(data): "
    "return h(data)\n return inner\n@g\ndef f(data): return data * {by}",
    "dispatch": "import functools\n@functools.singledispatch\ndef f(data): return data * {by}",
    "caught": "def f(data):\n try: return data\n except KeyError: return {by}",
}


@pytest.mark.parametrize("name", CODES)
def test_a_change_of_code_is_seen(name):
    code = CODES[name]
    assert fingerprint(made(code, 2)) == fingerprint(made(code, 2)) != fingerprint(made(code, 3))


STATES = {
    "nested": lambda by: Holder(Holder(by)).method,
    "sparse": lambda by: Holder(sparse.identity(3) * by).method,
    "sparse tensor": lambda by: Holder(torch.eye(3).to_sparse() * by).method,
    "bfloat16": lambda by: Holder(torch.tensor(by).bfloat16()).method,
    "mask": lambda by: Holder(np.ma.masked_equal(np.arange(5), by)).method,
    "random": lambda by: Holder(np.random.default_rng(int(by))).method,
    "tree": lambda by: Holder(KDTree(np.full((1, 2), by))).method,
    "class": lambda by: Holder(Scale if by == 2 else Holder).method,
    "pattern": lambda by: Holder([re.compile(str(by)), torch.float32]).method,
    "default": lambda by: Holder(defaultdict(int if by == 2 else list)).method,
    "builtin": lambda by: torch.full((2,), by).mul,
    "set": lambda by: Holder({"a", "b", by}).method,
}


@pytest.mark.parametrize("name", STATES)
def test_a_state_that_no_repr_shows_is_seen(name):
    make = STATES[name]
    assert fingerprint(make(2.0)) == fingerprint(make(2.0)) != fingerprint(make(3.0))


def test_objects_that_refer_to_each_other_are_looked_at_once():
    holders = [Holder(number) for number in range(60)]
    for holder in holders:
        holder.others = holders
    before = fingerprint(holders)
    holders[-1].held = -1
    assert fingerprint(holders) != before
    chain = None
    for _ in range(100_000):
        chain = [chain]
    with pytest.raises(TypeError, match="pre_transform holds a list whose parts are nested too"):
        fingerprint(chain)


def test_what_keeps_its_state_to_itself_is_refused(open_split, tmp_path):
    with (tmp_path / "log").open("w") as file:
        holder = Holder(file)
        with pytest.raises(TypeError, match=r"pre_transform holds a _io\.TextIOWrapper, whose"):
            open_split("test", pre_transform=holder.method)


def test_a_copy_of_a_random_dataset_stays_random(open_split):
    copied = open_split("test", augment="random")[:3].copy()
    assert not torch.allclose(copied[0].pos, copied[0].pos)


def test_the_version_in_the_place_of_the_directory_is_pointed_out(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"the directory, not the version: SynthNet\(version='1.0"):
        SynthNet(MINI)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"version='1\.0-mni'\); did you mean 1\.0-mini\?; a dir"):
        SynthNet("1.0-mni")
    (tmp_path / "3.0").mkdir()
    for directory in ("./1.0-mni", "mini", "v2.0", "1.0-mni", "3.0"):  # names of directories
        with pytest.raises(RecipeError, match="unknown version 'none'"):
            SynthNet(directory, version="none")
    for directory in ("mini", "3.0"):
        with pytest.raises(RecipeError, match="protocol of 1"):
            SynthNet(directory, protocol="none")


def test_repr_names_the_dataset(open_split):
    assert repr(open_split("test")[:2]) == (
        "SynthNet(2, version='1.0-mini', split='test', protocol='grouped', augment=True)"
    )


def test_pre_filter_drops_shapes_with_all_their_instances(open_split):
    kept = open_split(pre_filter=few_vertices)
    expected = [i for i in open_split(augment=False).shape_id if i in set(kept.shape_id)]
    assert all(few_vertices(data) for data in kept[::9])
    assert len(kept) == 9 * len(expected) > 0
    both = open_split(augment=False, pre_filter=few_vertices, pre_transform=Centre(0.0))
    assert len(both) == len(expected)


def test_pre_transform_must_return_what_can_be_stored(open_split):
    def odd(data):
        return Data(thing=object(), y=data.y)

    with pytest.raises(TypeError, match="tensors, numbers and strings; thing is object"):
        open_split("test", pre_transform=odd)

    def uneven(data):
        return Data(y=data.y) if data.family == "cone" else Data(y=data.y, x=data.pos)

    with pytest.raises(TypeError, match="same attributes for every item"):
        open_split("test", pre_transform=uneven)
    with pytest.raises(TypeError, match="must return Data, got NoneType"):
        open_split("test", pre_transform=lambda data: None)
    with pytest.raises(TypeError, match=r"half is of torch\.bfloat16"):
        open_split("test", pre_transform=lambda data: Data(y=data.y, half=data.y.bfloat16()))


class Pair(Data):
    """Data with its own way to join items, which no file keeps."""

    def __cat_dim__(self, key, value, *arguments, **options):
        return 1 if key == "pair" else super().__cat_dim__(key, value, *arguments, **options)


def test_pre_transform_must_not_return_a_subclass(open_split):
    with pytest.raises(TypeError, match="must return Data, got Pair: make that by transform"):
        open_split("test", pre_transform=lambda data: Pair(pair=data.pos.T, y=data.y))


@pytest.mark.parametrize("first", [True, False])
def test_an_attribute_is_a_tensor_always_or_never(open_split, first):
    seen = []

    def mixed(data):
        seen.append(data.shape_id)
        return Data(y=data.y, mark=data.y if (len(seen) == 1) is first else "none")

    with pytest.raises(TypeError, match="must return mark as a tensor always or never"):
        open_split("test", augment=False, pre_transform=mixed)


def test_a_kept_dataset_of_one_item_has_the_item_alone(open_split, items):
    one = items[0].shape_id
    options = {"pre_filter": lambda data: data.shape_id == one, "pre_transform": Centre(0.0)}
    dataset = open_split("test", augment=False, **options)
    assert len(dataset) == 1
    for data in (dataset[0], dataset.copy()[0]):
        assert (data.family, data.shape_id, data.instance) == (items[0].family, one, 0)
        assert torch.equal(data.face, items[0].face)


def test_a_number_that_no_instance_has_is_refused(items, open_split):
    kept = open_split("test", augment=False, pre_transform=Centre(0.0))
    for dataset, count in ((items, 335 * 9), (kept, 34), (items.copy(), 34)):
        for number in (-1, count):
            with pytest.raises(IndexError, match=f"no instance {number}: .* 0 to {count - 1}"):
                dataset.get(number)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "dev"}, "split must be one of train, validation, test, got 'dev'"),
        ({"augment": 3}, "augment must be one of True, False, random, got 3"),
        ({"augment": 1}, "augment must be one of True, False, random, got 1"),
        ({"protocol": None}, "protocol must be a name such as 'grouped', got None"),
        (
            {"protocol": ["grouped"]},
            "protocol must be a name such as 'grouped', got .'grouped'.",
        ),
        (
            {"augment": "random", "pre_transform": FaceToEdge()},
            "pre_transform is applied once and augment='random' afresh",
        ),
    ],
)
def test_unknown_options_are_refused(unpacking_home, options, message):
    with pytest.raises(ValueError, match=message):
        SynthNet(unpacking_home, MINI, **options)


def test_unknown_protocol_is_refused(unpacking_home):
    message = r"protocol of 1\.0-mini must be one of grouped, paper: 'm"
    with pytest.raises(RecipeError, match=message):
        SynthNet(unpacking_home, MINI, protocol="mine")


def test_a_missing_version_is_built_on_first_use(tmp_path, monkeypatch, capfd):
    run = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr("synthnet.build.versions.subprocess.run", run)
    with pytest.raises(KeyboardInterrupt):
        SynthNet(tmp_path, MINI)
    (_, *command), *_ = run.call_args.args
    assert command == ["-m", "synthnet", "build", MINI, "--out", str(tmp_path), "--wait"]
    assert f"synthNet {MINI} is not in {tmp_path / MINI} yet: building it" in capfd.readouterr().err


# What was unpacked is checked before it is used


def altered(path, position=-1):
    """Alter a byte of a file, and leave its size and its times."""
    times = path.stat()
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(bytes(content))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def truncated(path):
    path.write_bytes(path.read_bytes()[:-1])


FILES = ("vertices.npy", "faces.npy", "y.npy", "isometries.npy", "shapes.parquet")


@pytest.mark.attack
@pytest.mark.parametrize("damage", [altered, truncated, Path.unlink])
@pytest.mark.parametrize("name", [*FILES, unpacked.CONTENTS])
def test_damaged_files_are_unpacked_anew_and_never_loaded(home, items, name, damage, capfd):
    where = mapped.directory(store.open_dataset(MINI, home))
    before = {path.name: path.read_bytes() for path in where.iterdir()}
    assert set(before) == {*FILES, unpacked.CONTENTS}
    damage(where / name)
    capfd.readouterr()
    opened = SynthNet(home, MINI, "test", augment=False)
    for data in SynthNet(home, MINI, "train", augment=False):
        assert data.face.max() < data.num_nodes  # every mesh is read, and all are whole
    assert_same_positions(opened, items)
    printed = [line for line in capfd.readouterr().err.splitlines() if line]
    (line,) = printed
    assert line.endswith("synthNet 1.0-mini anew for PyTorch Geometric") or (
        (name, damage) == (unpacked.CONTENTS, Path.unlink)
        and line == "Unpacking synthNet 1.0-mini for PyTorch Geometric"
    )
    assert {path.name: path.read_bytes() for path in where.iterdir()} == before
    assert list(unpacked.problems(where)) == []


@pytest.mark.attack
def test_a_mesh_damaged_after_opening_is_unpacked_anew(home, items, capfd):
    opened = SynthNet(home, MINI, "test", augment=False)
    where = mapped.directory(store.open_dataset(MINI, home))
    altered(where / "vertices.npy", 200)  # a torus is the first: no test shape
    capfd.readouterr()
    train = SynthNet(home, MINI, "train", augment=False)
    assert capfd.readouterr().err == ""  # large files are checked by the mesh
    assert list(unpacked.problems(where)) == [
        f"{where / 'vertices.npy'} is damaged (its SHA-256 is another)"
    ]
    everything = [*train, *SynthNet(home, MINI, "validation", augment=False)]
    assert "is damaged (its SHA-256 is another): unpacking" in capfd.readouterr().err
    assert len(everything) + len(opened) == 335
    assert_same_positions(opened, items)


@pytest.mark.attack
@pytest.mark.parametrize("transformed", [False, True])
def test_a_mesh_that_a_callable_finds_damaged_is_unpacked_anew(home, items, transformed, capfd):
    where = mapped.directory(store.open_dataset(MINI, home))
    altered(where / "vertices.npy", 200)
    options = {"pre_transform": Centre(0.0)} if transformed else {}
    opened = SynthNet(home, MINI, "train", augment=False, pre_filter=few_vertices, **options)
    assert "is damaged (its SHA-256 is another): unpacking" in capfd.readouterr().err
    assert list(unpacked.problems(where)) == []
    assert all(few_vertices(data) for data in opened)


@pytest.mark.attack
def test_transformed_items_are_checked_too(home, capfd):
    options = {"augment": False, "pre_transform": Centre(1.0)}
    first = SynthNet(home, MINI, "test", **options)
    expected = [data.clone() for data in first]
    where = Path(first.processed_dir)
    for name, damage in (("000.bin", altered), ("000.bin", truncated), ("index.json", altered)):
        damage(where / name)
        capfd.readouterr()
        again = SynthNet(home, MINI, "test", **options)
        assert_same_positions(again, expected)
        assert f"{where / name} is damaged" in capfd.readouterr().err


@pytest.mark.attack
def test_what_was_unpacked_of_other_shards_is_not_used(home):
    dataset = store.open_dataset(MINI, home)
    SynthNet(home, MINI, "test")
    manifest = dataset.manifest
    first = dataclasses.replace(manifest.shards[0], sha256="0" * 64)
    shards = (first, *manifest.shards[1:])
    other = store.StoredDataset(dataset.directory, dataclasses.replace(manifest, shards=shards))
    with pytest.raises(DamagedError, match="was unpacked from other shards"):
        unpacked.check(mapped.directory(dataset), other)


@pytest.mark.attack
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["files"].update({"../y.npy": c["files"]["y.npy"]}), r"'../y.npy' is no entry"),
        (lambda c: c["files"]["y.npy"].pop("size"), "'y.npy' is no entry"),
        (lambda c: c.pop("files"), "'files'"),
        (lambda c: c.update(files=[]), "'list' object has no attribute 'items'"),
    ],
)
def test_a_table_of_contents_names_files_of_its_folder(home, change, message):
    dataset = store.open_dataset(MINI, home)
    where = mapped.directory(dataset)
    content = json.loads((where / unpacked.CONTENTS).read_text())
    del content[store.DIGEST]
    change(content)
    (where / unpacked.CONTENTS).write_text(store.with_digest(content))
    with pytest.raises(DamagedError, match=message):
        unpacked.check(where, dataset)


@pytest.mark.attack
@pytest.mark.parametrize("kind", ["object", "<U3"])
def test_transformed_items_are_numbers(tmp_path, kind):
    entry = {"dtype": kind, "dim": 0, "shape": [], "offsets": [0, 0]}
    index = {"digests": ["0" * 64], "attributes": {"x": entry}}
    (tmp_path / "index.json").write_text(json.dumps(index))
    with pytest.raises(DamagedError, match="x is of "):
        TransformedItems(tmp_path)


def test_a_version_that_is_a_number_is_named():
    with pytest.raises(TypeError, match=r"a version is named by a string such as '1\.0', got 1\.0"):
        SynthNet(version=1.0)
