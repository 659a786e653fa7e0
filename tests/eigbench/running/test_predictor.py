"""The four doors of a predictor's file, its META, and what a predictor can see."""

import dataclasses
import gc
import os
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from eigbench.errors import EigbenchError, PredictorError
from eigbench.running import meshes as instances
from eigbench.running import predictor, record
from eigbench.running.meshes import view

from synthnet import store
from synthnet.mesh.geometry import volume
from synthnet.types import Mesh
from tests.eigbench.conftest import WEYL, git

MESH = view(Mesh(np.eye(3), np.array([[0, 1, 2]])))

FUNCTION = "def predict(meshes): return 'function'\n"
CLASS = "class Predictor:\n    def predict(self, meshes): return 'class'\n"
LOAD = """
class Loaded:
    def __init__(self, *given): self.given = given
    def predict(self, meshes): return ('load', *self.given)
def load(device, seed): return Loaded(device, seed)
"""
TORCH = """
import torch
class Net(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.linear = torch.nn.Linear(3, 10)
        self.frozen = torch.nn.Parameter(torch.zeros(5), requires_grad=False)
    def forward(self, batch):
        assert not self.training
        assert not torch.is_grad_enabled()
        assert batch.pos.dtype == torch.float32
        assert batch.face.dtype == torch.int64
        shapes = int(batch.num_graphs)
        total = torch.zeros(shapes, 3).index_add_(0, batch.batch, batch.pos)
        return self.linear(total)
model = Net()
"""


@pytest.fixture(autouse=True)
def fresh_imports(monkeypatch):
    """Forget the modules and the path that a predictor's file brings in."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if "torch" not in name and "/site-packages/" not in str(
            getattr(sys.modules[name], "__file__", "")
        ):
            del sys.modules[name]


@pytest.fixture
def load(predictor_file):
    """Return a function that writes a predictor's code to a file, and loads it or a variant."""

    def load(code, name="my_model.py", variant="", **options):
        return predictor.load(predictor_file(code, name).with_name(name + variant), **options)

    return load


# --- doors -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "answer"),
    [(FUNCTION, "function"), (CLASS, "class"), (LOAD, ("load", "cuda:1", 7))],
    ids=["function", "class", "load"],
)
def test_door_is_given_device_and_seed_if_it_takes_them(load, code, answer):
    loaded = load(code, device="cuda:1", seed=7)
    assert loaded.predict([MESH]) == answer
    assert loaded.parameters is None


@pytest.mark.parametrize(
    ("constructor", "door"), [("self, network", "load"), ("self, network=None", "class")]
)
def test_a_class_that_cannot_be_made_alone_is_made_by_load(load, constructor, door):
    made = f"    def __init__({constructor}): self.door = 'load' if network else 'class'\n"
    code = f"class Predictor:\n{made}    def predict(self, meshes): return self.door\n"
    code += "def load(device, seed): return Predictor('a network')"
    assert load(code).predict([]) == door


@pytest.mark.parametrize("model", ["Net()", "Net"], ids=["module", "class"])
def test_torch_door_evaluates_without_gradients_and_counts_parameters(load, model):
    torch = pytest.importorskip("torch")
    loaded = load(TORCH.replace("model = Net()", f"model = {model}"))
    answer = loaded.predict([MESH, MESH])
    assert answer.shape == (2, 10)
    assert isinstance(answer, torch.Tensor)
    assert loaded.parameters == 3 * 10 + 10 + 5
    assert predictor.checked(predictor.as_array(answer), 2, 10).dtype == np.float64


def test_torch_door_applies_the_transform_of_the_file(load):
    pytest.importorskip("torch")
    loaded = load(TORCH + "def transform(data):\n    data.pos = 0 * data.pos\n    return data\n")
    bias = loaded.predict([view(Mesh(np.zeros((3, 3)), MESH.faces))])
    np.testing.assert_array_equal(loaded.predict([MESH]), bias)


def test_arrays_of_a_predictor_are_counted(load):
    code = """
import numpy as np

class Predictor:
    def parameters(self): return [np.ones((3, 4)), np.ones(5)]
    def predict(self, meshes): return np.ones((len(meshes), 10))
"""
    assert load(code).parameters == 17


def test_parameters_of_a_torch_module_behind_the_load_door_are_counted(load):
    pytest.importorskip("torch")
    code = TORCH.replace("model = Net()", "") + (
        "    def predict(self, meshes): return None\ndef load(device, seed): return Net()\n"
    )
    assert load(code).parameters == 45


DOORS = [FUNCTION, CLASS, LOAD, "model = 'no module'\n"]


@pytest.mark.parametrize("first", range(3))
def test_first_door_wins_whatever_the_order_in_the_file(load, first):
    code = "".join(reversed(DOORS[first:]))
    answer = load(code).predict([MESH])
    assert answer == ("function", "class", ("load", "cpu", 0))[first]


def test_siblings_can_be_imported(predictor_file, load):
    predictor_file("ANSWER = 'sibling'\n", "a_sibling_of_mine.py")
    code = "from a_sibling_of_mine import ANSWER\ndef predict(meshes): return ANSWER\n"
    assert load(code).predict([MESH]) == "sibling"


def test_files_beside_the_predictor_can_be_read(predictor_file, monkeypatch):
    path = predictor_file(
        "from pathlib import Path\n"
        "WEIGHTS = (Path(__file__).parent / 'weights.txt').read_text()\n"
        "def predict(meshes): return WEIGHTS\n"
    )
    (path.parent / "weights.txt").write_text("kept")
    monkeypatch.chdir(path.parent.parent)  # and not because it is the working directory
    assert predictor.load(path).predict([MESH]) == "kept"


def test_relative_path_of_a_predictor_works(predictor_file, monkeypatch):
    path = predictor_file(FUNCTION)
    monkeypatch.chdir(path.parent)
    assert predictor.load(type(path)(path.name)).predict([MESH]) == "function"


def test_dataclass_in_a_predictor_works(load):
    code = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n"
        "@dataclass\nclass Setting:\n    k: int = 10\n" + FUNCTION
    )
    assert load(code).predict([MESH]) == "function"


# --- META ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("meta", "expected"),
    [
        ("", {"name": "my_net", "kind": "learned"}),
        (
            "META = {'name': 'Net', 'kind': 'classical', 'training_cost': 3}\n",
            {"name": "Net", "kind": "classical", "training_cost": "3"},
        ),
        ("META = {'name': 'Mo\u0308del'}\n", {"name": "M\u00f6del", "kind": "learned"}),
    ],
    ids=["without", "as text", "composed letters"],
)
def test_meta_is_text_and_without_it_the_name_is_the_files(load, meta, expected):
    assert load(meta + FUNCTION, "my_net.py").meta == expected


def test_every_key_of_meta_is_allowed_by_the_schema_of_results():
    from eigbench.results import schema

    assert set(predictor.META_KEYS) < set(schema()["properties"]["model"]["properties"])
    assert schema()["properties"]["model"]["properties"]["kind"]["enum"] == list(predictor.KINDS)


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ("['Net']", "META must be a dict, got list"),
        ("{'title': 'Net'}", "META has the unknown key title; it may have name, kind, authors"),
        ("{'kind': 'magic'}", "META kind must be one of trivial, classical, learned"),
        ("{'target': 'both'}", "META target must be one of surface, mesh, got 'both'"),
        ("{'name': None}", "META name must be text, got NoneType: leave it out"),
        ("{'authors': ['A', 'B']}", "META authors must be text, got list: write it as one line"),
        ("{'name': ''}", "META name must have 1 to 80 characters"),
        (f"{{'name': {'x' * 81!r}}}", "META name must have 1 to 80 characters"),
        ("{1: 'a', 'b': 'c'}", "META has the unknown key 1, b; it may have"),
        (f"{{'paper': {'x' * 301!r}}}", "META paper must be one line of at most 300 characters"),
        ("{'training_data': 'a\\nb'}", "META training_data must be one line of at most"),
        ("{'paper': 'a\\x1bb'}", r"META paper has the character U\+001B, which cannot be printed"),
        ("{'name': 'Weyl\\u0332'}", r"META name has the mark U\+0332, which does not compose with"),
        ("{'name': 'Weyl\\u034f'}", r"META name has the character U\+034F, which cannot be seen"),
        ("{'name': 'Weyl\\ufe0f'}", r"META name has the character U\+FE0F, which cannot be seen"),
        ("{'name': 'Weyl\\u3164'}", r"META name has the character U\+3164, which cannot be seen"),
        ("{'name': 'Weyl\\u2800'}", r"META name has the character U\+2800, which cannot be seen"),
        ("{'name': 'W\\u0435yl'}", r"META name has the letter \u0435 \(U\+0435\): a row's files"),
        ("{'name': 'Модель 5'}", r"META name has the letter М \(U\+041C\): a row's files have its"),
        ("{'name': 'Weyl й'}", r"META name has the letter й \(U\+0439\)"),
        ("{'name': 'Fit of λ₁'}", r"META name has the letter λ \(U\+03BB\)"),
        ("{'name': 'ガウス'}", r"META name has the letter ガ \(U\+30AC\)"),
        ("{'name': '٣'}", r"META name has the letter ٣ \(U\+0663\)"),
        ("{'name': '?!'}", "META name has no letter and no digit"),
    ],
)
def test_wrong_meta_is_refused_before_anything_is_run(load, meta, message):
    with pytest.raises(PredictorError, match=message):
        load(f"META = {meta}\n{FUNCTION}")


@pytest.mark.parametrize("name", ["Poincaré", "Weyl's law, ℓ²", "Ångström → 5 %"])
def test_a_name_may_have_accents_and_signs(load, name):
    assert load(f"META = {{'name': {name!r}}}\n{FUNCTION}").meta["name"] == name


# --- what does not load ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.py", r"there is no file .*none\.py"),
        ("", "is a directory: name the predictor's file in it"),
        ("weights.txt", r"weights\.txt is no Python file"),
    ],
)
def test_what_is_no_file_of_python_is_refused(predictor_file, name, message):
    folder = predictor_file("1 2 3", "weights.txt").parent
    with pytest.raises(PredictorError, match=message):
        predictor.load(folder / name)


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("def predict(:", r"failed to load: SyntaxError: .*line 1"),
        ("1 / 0", r"load: ZeroDivisionError: division by zero \(my_model\.py:1: 1 / 0\)"),
        ("raise SystemExit(3)", "failed to load: SystemExit: 3"),
        ("import sys; sys.exit()", "failed to load: SystemExit"),
        ("raise ValueError('a\\nb')", "failed to load: ValueError: a b"),
        ("import no_such_thing.part", "needs the package no_such_thing, which is not installed"),
        ("from os import no_such_name", "failed to load: ImportError: cannot import name"),
        ("x = 1", "has no predictor: define predict.meshes., a class Predictor, load"),
        ("predict = 3", "has no predictor"),
        ("class Predictor: pass", "a Predictor has no method predict"),
        ("class Predictor: predict = 3", "a Predictor has no method predict"),
        (
            "class Predictor:\n    def __init__(self, size): pass\n",
            "failed to load: TypeError: .*missing 1 required positional argument: 'size'",
        ),
        (
            "class Predictor:\n    def __init__(self): raise FileNotFoundError('weights.pt')",
            r"failed to load: FileNotFoundError: weights\.pt",
        ),
        (
            "class Predictor:\n    def __init__(self): raise SystemExit(3)",
            "failed to load: SystemExit: 3",
        ),
        ("def load(device, seed): raise SystemExit(3)", "failed to load: SystemExit: 3"),
        ("def load(device, seed): return None", "a NoneType has no method predict"),
        ("def load(): return None", r"load\(\) cannot be called as load\(device, seed\): too many"),
        ("model = 3", r"model must be a torch\.nn\.Module, got int"),
        ("model = dict", r"model must be a torch\.nn\.Module, got dict"),
    ],
)
def test_file_that_does_not_load_says_why_on_one_line(load, code, message):
    if "model" in code:
        pytest.importorskip("torch_geometric")
    with pytest.raises(PredictorError, match=message) as caught:
        load(code)
    assert "\n" not in str(caught.value)
    assert "my_model.py" in str(caught.value)


# --- answers ---------------------------------------------------------------------------


@pytest.mark.skipif(np.finfo(np.longdouble).max == np.finfo(float).max, reason="no wider float")
def test_what_float64_cannot_hold_is_infinite_without_a_warning():
    answer = np.array([[np.longdouble(10) ** 400, -(np.longdouble(10) ** 400), 2.0]])
    assert predictor.checked(predictor.as_array(answer), 1, 3).tolist() == [[np.inf, -np.inf, 2.0]]


@pytest.mark.parametrize(
    "answer",
    [
        np.ones((4, 10), np.float32),
        np.ones((4, 10), np.int16),
        [[1] * 10] * 4,
        np.full((4, 10), np.nan),
        np.full((4, 10), -np.inf),
        np.zeros((4, 10)),
    ],
    ids=["float32", "integers", "lists", "NaN", "infinite", "zeros"],
)
def test_answer_of_real_numbers_is_taken_as_float64(answer):
    values = predictor.checked(predictor.as_array(answer), 4, 10)
    assert values.dtype == np.float64
    np.testing.assert_array_equal(values, np.asarray(answer, dtype=np.float64))


def test_answer_that_needs_gradients_is_taken():
    torch = pytest.importorskip("torch")
    assert predictor.as_array(torch.ones((4, 10), requires_grad=True)).sum() == 40


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.ones((4, 9)), r"has shape \(4, 9\), it must be \(4, 10\)"),
        (np.ones((10, 4)), r"has shape \(10, 4\), it must be \(4, 10\)"),
        (np.ones((3, 10)), r"has shape \(3, 10\), it must be \(4, 10\)"),
        (np.ones(10), r"has shape \(10,\), it must be \(4, 10\)"),
        (np.ones((4, 10, 1)), r"has shape \(4, 10, 1\), it must be \(4, 10\)"),
        (np.ones((4, 10), complex), "is complex, eigenvalues are real"),
        (np.full((4, 10), "1.0"), "has dtype <U3, it must be real numbers"),
        (np.ones((4, 10), bool), "has dtype bool, it must be real numbers"),
        (None, "predict returned None"),
        ((i for i in range(4)), "predict returned a generator, it must return an array"),
        ({"a": 1}, "predict returned a dict, it must"),
        (np.ma.masked_greater(np.arange(1.0, 41).reshape(4, 10), 3), "a masked array: fill"),
        ([np.ma.array(np.ones(10), mask=[True] + 9 * [False])] * 4, "a masked array: fill"),
        ([[1.0], [1.0, 2.0]], "cannot be taken: ValueError: rows of different length"),
    ],
)
def test_answer_that_is_no_batch_of_spectra_is_refused(answer, message):
    with pytest.raises(PredictorError, match=message) as caught:
        predictor.checked(predictor.as_array(answer), 4, 10)
    assert len(str(caught.value).splitlines()) == 1


def test_a_tensor_that_numpy_has_no_dtype_for_has_a_remedy():
    torch = pytest.importorskip("torch")
    with pytest.raises(PredictorError, match=r"bfloat16 .* is no array of NumPy: give a dense"):
        predictor.as_array(torch.ones((4, 10), dtype=torch.bfloat16))
    with pytest.raises(PredictorError, match=r"BFloat16: give a dense one of float32"):
        predictor.as_array([torch.ones(10, dtype=torch.bfloat16)])
    with pytest.raises(PredictorError, match=r"layout torch\.sparse_coo is no array of"):
        predictor.as_array(torch.ones((4, 10)).to_sparse())


# --- what a predictor sees -------------------------------------------------------------


@pytest.fixture(scope="module")
def seen(mini_meshes, mini_truth):
    """29 instances as they are handed over: all of a few shapes, and one of others."""
    chosen = [*mini_truth.ids[:9], *mini_truth.head(20).ids]
    ids = [id for id in mini_truth.ids if id in set(chosen)]
    meshes = {id: mini_meshes.mesh(id) for id in ids}
    assert len(meshes) == 29
    return meshes, ids


def test_a_mesh_has_vertices_and_faces_and_nothing_else(seen):
    meshes, _ = seen
    for mesh in meshes.values():
        assert [field.name for field in dataclasses.fields(mesh)] == ["vertices", "faces"]
        assert type(mesh) is Mesh
        assert not hasattr(mesh, "__dict__")
        assert tuple(mesh.__slots__) == ("vertices", "faces")
        public = {name for name in dir(mesh) if not name.startswith("_")}
        assert public == {"vertices", "faces", "stored"}


def test_arrays_are_plain_read_only_float64_and_int64(seen):
    meshes, _ = seen
    for mesh in meshes.values():
        for array, kind in ((mesh.vertices, np.float64), (mesh.faces, np.int64)):
            assert type(array) is np.ndarray
            assert array.dtype == kind
            assert array.dtype.metadata is None
            assert array.shape[1:] == (3,)
            assert array.flags.c_contiguous
            assert not array.flags.writeable
            assert array.base is None or array.base.nbytes == array.nbytes  # no window on others
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0


def test_nothing_that_a_mesh_refers_to_holds_a_label_an_id_or_a_family(seen, mini_truth):
    meshes, _ = seen
    known = set(mini_truth.shapes.tolist()) | set(mini_truth.families.tolist())
    for mesh in meshes.values():
        reached = [*gc.get_referents(mesh), *(getattr(mesh, n) for n in ("vertices", "faces"))]
        arrays = [thing for thing in reached if isinstance(thing, np.ndarray)]
        assert {id(a) for a in arrays} == {id(mesh.vertices), id(mesh.faces)}
        for name in dir(mesh):
            if name == "__weakref__":  # of the class before slots: Python 3.11.2 still lists it
                continue
            value = getattr(mesh, name)
            assert not isinstance(value, float)
            assert not (isinstance(value, str) and value in known)
            cells = getattr(value, "__closure__", None) or ()
            held = [cell.cell_contents for cell in cells]  # the dataclass's own class and fields
            assert not any(isinstance(thing, np.ndarray | float) for thing in held)
            assert not known & {thing for thing in held if isinstance(thing, str)}
        assert not any(word in repr(mesh) for word in known)


def test_instances_of_a_shape_are_isometric_and_face_outwards(seen):
    meshes, ids = seen
    shape = ids[0].rpartition("/")[0]
    copies = [mesh for id, mesh in meshes.items() if id.startswith(f"{shape}/")]
    assert len(copies) == 9
    first = volume(copies[0])
    assert first > 0
    np.testing.assert_allclose([volume(mesh) for mesh in copies], first, rtol=1e-9)


def test_dataset_that_lacks_a_shape_is_refused(mini_home):
    stored = store.open_dataset("1.0-mini", mini_home)
    message = r"lacks 1 shapes of the split, first cone-99999.*verify"
    with pytest.raises(EigbenchError, match=message):
        instances.read(stored, ["cone-99999/0"])


def test_sources_are_the_files_beside_it_and_nothing_that_is_no_file(
    predictor_file, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # where the relative names of modules that are no files would lie
    (tmp_path / "my_model.npz").write_bytes(b"weights")
    (tmp_path / "other.npz").write_bytes(b"no part of it")
    (tmp_path / "a_sibling.py").write_text("x = 1\n")
    (tmp_path / "a_sibling.parquet").write_bytes(b"what it learns from")
    path = predictor_file("import a_sibling\n" + FUNCTION)
    loaded = predictor.load(path)
    monkeypatch.setitem(sys.modules, "no_file", types.SimpleNamespace(__file__="_ops.py"))
    sources = predictor.sources(path, loaded.roots)
    assert set(sources) == {"my_model.py", "my_model.npz", "a_sibling.py", "a_sibling.parquet"}


def test_sources_are_all_data_of_a_folder_of_its_name_and_of_a_package(predictor_file, tmp_path):
    for name in ("my_model/a.npz", "my_model/below/b.npz", "package/c.npz", "elsewhere/d.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"weights")
    (tmp_path / "package" / "__init__.py").touch()
    for name in ("unused.py", "__pycache__/a.nbi", ".git/HEAD", ".DS_Store"):
        (tmp_path / "package" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "package" / name).touch()
    (tmp_path / "my_model" / "link.npz").symlink_to(tmp_path / "elsewhere" / "d.npz")
    path = predictor_file("import package\n" + FUNCTION)
    expected = {"my_model.py", "my_model/a.npz", "my_model/below/b.npz"}
    expected |= {"package/__init__.py", "package/c.npz"}
    assert set(predictor.sources(path, predictor.load(path).roots)) == expected


def test_sources_of_a_directory_that_the_file_puts_on_the_path(predictor_file, tmp_path):
    shared = tmp_path / "shared" / "a_package"
    shared.mkdir(parents=True)
    (shared / "__init__.py").write_text("")
    (shared / "net.py").write_text("x = 1\n")
    path = predictor_file(
        f"import sys\nsys.path.insert(0, {str(shared.parent)!r})\nimport a_package.net\n" + FUNCTION
    )
    sources = predictor.sources(path, predictor.load(path).roots)
    assert {Path(os.path.relpath(shared / "net.py", path.parent)).as_posix()} < set(sources)


def test_first_predictor_takes_ten_lines(load):
    assert len(WEYL.strip().splitlines()) < 10
    answer = load(WEYL).predict([MESH])
    area = np.sqrt(3) / 2  # of an equilateral triangle with side sqrt 2
    np.testing.assert_allclose(answer, [4 * np.pi * np.arange(1, 11) / area], rtol=1e-14)


@pytest.fixture
def checkout(tmp_path):
    """A repository with one commit, of a predictor."""
    folder = tmp_path / "code"
    folder.mkdir()
    (folder / "my_model.py").write_text(FUNCTION)
    git(folder, "init", "-q")
    git(folder, "add", "my_model.py")
    git(folder, "commit", "-q", "-m", "A predictor")
    return folder


def test_commit_of_a_checkout_is_recorded_and_whether_the_code_is_in_it(checkout):
    code = checkout / "my_model.py"
    commit = git(checkout, "rev-parse", "HEAD")
    clean = {"checkout": {"commit": commit, "dirty": False}}
    assert record.checkout(code) == clean
    (checkout / "results.json").write_text("{}")  # no part of the code
    assert record.checkout(code) == clean
    code.write_text(FUNCTION + "\n# changed\n")
    assert record.checkout(code) == {"checkout": {"commit": commit, "dirty": True}}
    code.write_text(FUNCTION)
    for name in ("other.py", "my_mode[l].py"):  # as a pattern, my_model.py has that name
        other = checkout / name
        other.write_text(FUNCTION)
        assert record.checkout(other)["checkout"]["dirty"] is True


def test_outside_of_a_checkout_no_commit_is_recorded(predictor_file, tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert record.checkout(predictor_file(FUNCTION)) == {}


def test_without_git_no_commit_is_recorded(checkout, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert record.checkout(checkout / "my_model.py") == {}


FAMILY = """
from pathlib import Path
FACTORS = {"small": 1, "large": 2}
def META(variant): return {"name": f"Family, {variant}", "authors": FACTORS[variant] * "A. "}
class Loaded:
    def __init__(self, *given): self.given = given
    def predict(self, meshes): return self.given
def load(device, seed, variant): return Loaded(device, seed, variant)
"""


def test_variant_of_a_file_is_loaded_by_its_name(load):
    loaded = load(FAMILY, variant=":large", device="cuda", seed=3)
    assert loaded.predict([]) == ("cuda", 3, "large")
    assert loaded.meta == {"name": "Family, large", "kind": "learned", "authors": "A. A. "}
    assert loaded.seeded
    assert not loaded.trained
    without_meta = load(FAMILY.replace("def META", "def other"), variant=":small")
    assert without_meta.meta["name"] == "my_model small"


def test_variant_and_training_are_asked_for_by_name(load):
    code = FAMILY.replace("seed, variant): return", "seed, variant, training): return")
    code = code.replace("Loaded(device, seed, variant)", "Loaded(variant, training)")
    loaded = load(code, variant=":small", training="2.0/genus")
    assert loaded.predict([]) == ("small", "2.0/genus")
    assert loaded.trained


@pytest.mark.parametrize(
    "helper", ["from json import load", "def load(path): pass", "def load(path, variant): pass"]
)
@pytest.mark.parametrize("door", [FUNCTION, CLASS], ids=["function", "class"])
def test_a_helper_named_load_is_nothing_to_a_file_with_another_door(load, helper, door):
    assert not load(f"{helper}\n{door}").seeded


def test_file_whose_name_no_result_can_hold_is_refused(predictor_file):
    path = predictor_file(FUNCTION)
    path = path.rename(path.with_name("mo\u0308del.py"))
    with pytest.raises(PredictorError, match=r"has letters that are not composed \(NFC\): rename"):
        predictor.check_file(path)


def test_an_error_whose_message_fails_or_is_long_is_one_short_line():
    class Silent(Exception):
        def __str__(self):
            raise KeyError

    assert predictor.described(Silent()) == "Silent: its message cannot be read: KeyError"
    for long in ("word " * 10_000, "x" * 10_000):
        line = predictor.described(ValueError(long))
        assert line.startswith(f"ValueError: {long[:400]}")
        assert len(line) < 600


@pytest.mark.parametrize("shape", ["", "(1.5,)", "(float('nan'),)", "(-5,)", "(10**30,)", "5"])
def test_parameters_that_are_no_arrays_are_named(load, shape):
    part = f"type('Part', (), {{'shape': {shape}}})" if shape else "3"
    code = "class Predictor:\n    def predict(self, meshes): pass\n"
    code += f"    def parameters(self): return [{part}]\n"
    with pytest.raises(PredictorError, match=r"parameters\(\) of a Predictor must give tensors"):
        load(code)


@pytest.mark.parametrize(
    ("code", "name", "message"),
    [
        (FAMILY, "my_model.py", r"is a family of predictors: name one, my_model\.py:NAME"),
        (FAMILY, "my_model.py:huge", r"failed to load: KeyError: 'huge' \(my_model.py:4"),
        (FAMILY, "other.py:large", r"there is no file .*other\.py$"),
        (FUNCTION, "my_model.py:large", r"has no variants: leave out :large"),
        (LOAD, "my_model.py:large", r"has no variants: leave out :large"),
        (
            FAMILY.replace("def META", "def other") + "def META(variant): return [variant]\n",
            "my_model.py:large",
            "META must be a dict, got list",
        ),
    ],
)
def test_variant_that_is_not_there_is_one_line(predictor_file, code, name, message):
    path = predictor_file(code).with_name(name)
    with pytest.raises(PredictorError, match=message):
        predictor.load(path)


def test_sources_of_a_variant_are_its_own_weights(predictor_file, tmp_path):
    path = predictor_file(FAMILY)
    (tmp_path / "my_model").mkdir()
    for name in ("small", "large"):
        (tmp_path / "my_model" / f"{name}.npz").write_bytes(name.encode())
    path = path.with_name("my_model.py:large")
    sources = predictor.sources(path, predictor.load(path).roots)
    assert set(sources) == {"my_model.py", "my_model/large.npz"}


def test_a_link_is_named_as_the_file_that_it_leads_to(predictor_file, tmp_path):
    path = predictor_file(FAMILY)
    for name in ("link.py", "link.py:large"):
        (tmp_path / "link.py").unlink(missing_ok=True)
        (tmp_path / "link.py").symlink_to(path)
        assert predictor.code_name(tmp_path / name) == name.replace("link", "my_model")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "link.py").symlink_to(predictor_file(FUNCTION))
    (tmp_path / "my_model").symlink_to(tmp_path / "elsewhere")
    assert predictor.sources(tmp_path / "elsewhere" / "link.py", []) == ["my_model.py"]


def test_file_whose_name_has_a_colon_is_a_file(predictor_file):
    path = predictor_file(FUNCTION, "my:model.py")
    assert predictor.split(path) == (path, "")
    assert predictor.load(path).predict([]) == "function"


def test_an_error_names_the_innermost_line_of_its_authors_modules(predictor_file):
    beside = "import numpy as np\n\ndef f():\n    return np.ones(2) @ np.ones(3)\n"
    predictor_file(beside, "beside.py")
    path = predictor_file("import beside\n\ndef predict(meshes):\n    return beside.f()\n")
    loaded = predictor.load(path)
    with pytest.raises(ValueError, match="matmul") as caught:
        loaded.predict([])
    line = predictor.described(caught.value, path)
    assert line.endswith(" (beside.py:4: in f: return np.ones(2) @ np.ones(3))")
