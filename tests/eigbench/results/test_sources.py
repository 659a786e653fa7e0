"""Digests of a predictor's files: what leaves one as it is, and what does not."""

import ast
import hashlib
import json
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from eigbench.results import predictions
from eigbench.results.sources import (
    digest,
    digest_of_code,
    is_output,
    outdated,
    remark,
    unnameable,
)
from hypothesis import given
from hypothesis import strategies as st

ROOT = Path(__file__).parents[3]
CODE = '''\
"""A model."""

import os.path
from collections.abc import Sequence

import numpy as np
from synthnet.geometry import area as surface, volume

LIMIT = 3.0  # of a mesh


class Model:
    """Says what it has learned."""

    factor: float = 1.5

    def predict(self, meshes: Sequence[object], *, k: int = 10) -> "np.ndarray":
        """Return the spectra."""
        found = []
        for mesh in meshes:
            if not mesh.faces.size:
                raise ValueError(f"mesh {mesh!r} has {len(mesh.faces):>4} faces")
            scale = surface(mesh) ** 0.5 + volume(mesh) if k > 1 else -1
            found.append([scale * self.factor, *range(k)])
        return np.array(found)[:, 1:]


def empty():
    pass


def path(*parts, **options):
    with open(os.path.join("a", *parts), **options) as file:
        return {**options, "text": file.read(), b"x": None, 1j: ..., True: 1}
'''

SAME = {
    "a comment": ("LIMIT = 3.0  # of a mesh", "# The limit\nLIMIT = 3.0"),
    "a docstring": ('"""Return the spectra."""', '"""Return all spectra, shape (B, k)."""'),
    "no docstring": ('        """Return the spectra."""\n', ""),
    "the module's docstring": ('"""A model."""\n', ""),
    "a docstring where nothing was": ("    pass", '    """Do nothing."""'),
    "a string that documents an attribute": ("LIMIT = 3.0", '"""Why"""\nLIMIT = 3.0'),
    "line breaks": ("found.append([scale", "found.append(\n                [scale"),
    "brackets": ("surface(mesh) ** 0.5", "(surface(mesh) ** (0.5))"),
    "quotes": ('"text"', "'text'"),
    "a string in two": ('"mesh {', '"" "mesh " f"{'),
    "a number's spelling": ("1.5", "15e-1"),
    "an import that moved": ("synthnet.geometry", "synthnet.mesh.geometry"),
    "an import from another place": ("import os.path", "from . import os"),
    "the order of imports": ("area as surface, volume", "volume, area as surface"),
    "an import in two": ("area as surface, volume", "area as surface\nfrom b import volume"),
    "Windows' line ends": ("\n", "\r\n"),
}

CHANGED = {
    "a constant": ("LIMIT = 3.0", "LIMIT = 3.5"),
    "a constant's type": ("LIMIT = 3.0", "LIMIT = 3"),
    "a truth value for a number": ("True: 1", "1: 1"),
    "text for bytes": ('b"x"', '"x"'),
    "nothing for what is left out": ("None", "..."),
    "a string": ('"text"', '"texts"'),
    "an operator": ("** 0.5", "* 0.5"),
    "a sign": ("else -1", "else 1"),
    "a comparison": ("k > 1", "k >= 1"),
    "a condition": ("if not mesh", "if mesh"),
    "a name": ("scale * self.factor", "surface * self.factor"),
    "a parameter's default": ("k: int = 10", "k: int = 9"),
    "a parameter that is no keyword any more": ("*, k", "k"),
    "a type": ("k: int", "k: float"),
    "a message": ("} has {", "} had {"),
    "the format of a number": (":>4}", ":>5}"),
    "a conversion": ("{mesh!r}", "{mesh!s}"),
    "a slice": ("[:, 1:]", "[:, :1]"),
    "a star": ("*range(k)", "range(k)"),
    "two stars": ("{**options, ", "{options: options, "),
    "an attribute": ("mesh.faces.size", "mesh.vertices.size"),
    "a statement": ("LIMIT = 3.0", "LIMIT = 3.0\nLIMIT = 3.0"),
    "a statement in the branch": (
        "        return np.array(found)[:, 1:]",
        "            return np.array(found)[:, 1:]",
    ),
    "a decorator": ("def empty", "@staticmethod\ndef empty"),
    "a base class": ("class Model:", "class Model(dict):"),
    "an asynchronous function": ("def empty", "async def empty"),
    "what a function returns": ("    pass", "    return 1"),
    "another function of the same name": ("import area as surface", "import length as surface"),
    "another name for a function": ("area as surface", "area"),
    "an import more": ("import os.path", "import os.path, sys"),
    "an import less": (", volume", ""),
}


def replaced(old, new):
    assert old in CODE
    return CODE.replace(old, new)


def test_code_to_change_is_python():
    assert len(ast.parse(CODE).body) == 9
    assert digest_of_code(CODE) == digest_of_code(CODE.encode())


@pytest.mark.parametrize("change", SAME)
def test_tidying_up_leaves_the_digest(change):
    code = replaced(*SAME[change])
    assert code != CODE
    assert digest_of_code(code) == digest_of_code(CODE)


def test_imports_moved_into_functions_and_conditions_leave_the_digest():
    inside = CODE.replace("import os.path\n", "").replace(
        "    with open", "    import os\n    with open"
    )
    assert digest_of_code(inside) == digest_of_code(CODE)


@pytest.mark.parametrize("change", CHANGED)
def test_changed_statement_changes_the_digest(change):
    assert digest_of_code(replaced(*CHANGED[change])) != digest_of_code(CODE)


def test_changes_differ_from_each_other():
    digests = {digest_of_code(replaced(*change)) for change in CHANGED.values()}
    assert len(digests) == len(CHANGED)


def test_tree_unparsed_and_parsed_again_has_the_digest():
    for path in (Path(__file__), Path(ast.__file__), Path(hashlib.__file__)):
        code = path.read_text()
        assert ast.unparse(ast.parse(code)) != code
        assert digest_of_code(ast.unparse(ast.parse(code))) == digest_of_code(code)


def test_digest_is_the_same_on_every_python():
    assert digest_of_code(CODE) == (
        "36c063fad32cfaf61f2dff58e432afe204582e8f2d519021ae7e66eb30d4ac6b"
    )


@given(st.sampled_from(["os", "a.b", "numpy as np"]), st.lists(st.integers(0, 9), min_size=1))
def test_imports_count_once_wherever_they_stand(name, lines):
    code = [f"x = {i}" for i in lines]
    first = "\n".join([f"import {name}", *code])
    assert digest_of_code("\n".join([*code, f"import {name}", f"import {name}"])) == (
        digest_of_code(first)
    )
    assert digest_of_code("\n".join(code)) != digest_of_code(first)


def test_text_in_pieces_is_not_the_text_in_other_pieces():
    assert digest_of_code("f(a='b c')") != digest_of_code("f(a='b', c='')")
    assert digest_of_code("global a, b") != digest_of_code("global ab")
    assert digest_of_code("'x' 'y'\nz = 1") == digest_of_code("z = 1")


@pytest.mark.filterwarnings("error")
def test_escape_that_python_warns_of_is_no_error():
    assert digest_of_code(r"x = '\d'") == digest_of_code(r"x = '\\d'")


def test_code_that_nests_deep_has_a_digest():
    deep = "x = " + "-" * 1000 + "1"
    assert digest_of_code(deep) != digest_of_code(deep.replace("--", "-", 1))


def test_lone_surrogate_is_a_constant_like_others():
    assert digest_of_code(r"x = '\ud800'") != digest_of_code(r"x = '\ud801'")


@pytest.mark.parametrize("name", ["weights.npz", "broken.py"])
def test_what_is_no_python_counts_by_its_bytes_and_python_by_its_statements(tmp_path, name):
    content = b"def \xff broken  # one\n"
    path = tmp_path / name
    path.write_bytes(content)
    assert digest(path) == hashlib.sha256(content).hexdigest()
    path = tmp_path / "a.py"
    path.write_text(CODE)
    assert digest(path) == digest_of_code(CODE)


META = 'META = {"name": "Mine"}\n'


@pytest.fixture
def checkout(tmp_path):
    """A checkout with one baseline, and the result that it made."""
    folder = tmp_path / "baselines"
    (folder / "parts").mkdir(parents=True)
    (folder / "mine.py").write_text(CODE + META)
    (folder / "parts" / "net.py").write_text("x = 1\n")
    (folder / "mine.npz").write_bytes(b"weights")
    names = ("mine.py", "parts/net.py", "mine.npz")
    sources = {name: digest(folder / name) for name in names}
    return tmp_path, {"model": {"name": "Mine", "code": "mine.py", "sources": sources}}


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("parts/net.py", "x = 1\n", False),
        ("parts/net.py", "x = 1  # a comment\n", False),
        ("parts/net.py", "x = 2\n", True),
        ("parts/net.py", None, True),
        ("mine.npz", "y = 2", True),
        ("mine.npz", None, True),
        ("mine.py", None, False),  # the predictor is elsewhere
    ],
)
def test_result_is_outdated_by_a_file_that_changed_or_went(checkout, name, content, expected):
    root, result = checkout
    assert not outdated(result, root)
    (root / "baselines" / name).unlink()
    if content is not None:
        (root / "baselines" / name).write_text(content)
    assert outdated(result, root) == expected


def test_variant_is_outdated_with_its_file(checkout):
    root, result = checkout
    result["model"]["code"] = "mine.py:small"
    assert not outdated(result, root)
    (root / "baselines" / "mine.py").write_text("x = 1")
    assert outdated(result, root)


def test_result_of_another_predictor_in_a_file_of_the_same_name_is_not_outdated(checkout):
    root, result = checkout
    result["model"] |= {"name": "Another", "sources": {"mine.py": "0" * 64}}
    assert not outdated(result, root)
    result["model"]["name"] = "Mine"
    assert outdated(result, root)


def test_remark_is_of_results_on_the_board_of_a_checkout(checkout):
    root, result = checkout
    path = root / "benchmark" / "results" / "1.0-test-grouped" / "mine.json"
    assert remark(result, path) == ""
    (root / "baselines" / "mine.py").write_text(META)
    assert remark(result, path) == "This row was made by an earlier version of the model's code."
    assert remark(result, root / "mine.json") == ""


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["my_model.py", "my_model.copy\u00a01.bin"], r"'my_model.copy\\xa01.bin', for the char"),
        (["a\\b.npy"], "for a backslash: rename it"),
        (["mode\u0301l.py"], "for letters that are not composed"),
        ([f"{'a' * 298}.py"], "give it a shorter path"),
        (list(map(str, range(1001))), "has 1,001 files, and a result names 1,000 at most"),
    ],
)
def test_files_that_no_result_can_name_are_found_before_anything_is_predicted(names, message):
    assert unnameable(["my_model.py", "my_model/näh.bin"]) == ""
    assert re.search(message, unnameable(names))


def test_an_output_is_one_of_a_folder_and_reached_by_no_link(tmp_path):
    """Names come from the predictor's process: nothing else is opened."""
    folder, kept = tmp_path / "mine", tmp_path / "kept.json"
    folder.mkdir()
    kept.write_text('{"schema_version": 3, "metric_version": 1}')
    own, link = folder / "own.json", folder / "link.json"
    own.write_bytes(kept.read_bytes())
    link.symlink_to(kept)
    assert is_output(own, folder)
    for path in (folder / ".." / kept.name, kept, link, folder / "none.json"):
        assert not is_output(path, folder)


@pytest.mark.parametrize("folder", ["results/1.0-test-grouped", "scaling", "timing"])
def test_results_of_every_command_are_outputs(folder):
    there = sorted((ROOT / "benchmark" / folder).glob("*.json"))
    assert there
    assert all(map(is_output, there))


def test_weights_that_name_eigbench_are_no_predictions(tmp_path, mini_truth):
    own, weights = tmp_path / "own.parquet", tmp_path / "weights.parquet"
    predictions.write(own, mini_truth, mini_truth.eigenvalues[None])
    pq.write_table(pa.table({"made_by": ["eigbench"]}), weights)
    assert is_output(own)
    assert not is_output(weights)


def test_a_log_a_note_and_a_picture_are_outputs_and_numbers_are_not(tmp_path):
    for suffix in (".log", ".md", ".svg", ".png"):
        assert is_output(tmp_path / f"my_model{suffix}")
    for suffix in (".py", ".txt", ".csv", ".npz", ".safetensors"):
        assert not is_output(tmp_path / f"my_model{suffix}")


def test_no_source_of_a_row_is_an_output():
    results = sorted((ROOT / "benchmark" / "results").glob("*/*.json"))
    names = {name for path in results for name in json.loads(path.read_text())["model"]["sources"]}
    there = [ROOT / "baselines" / name for name in names]
    assert len([path for path in there if path.is_file()]) > 50
    assert not [path for path in there if path.is_file() and is_output(path)]
