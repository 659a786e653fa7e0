"""Files of predictions: exact round trips, and a strict join by id."""

import zipfile
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from eigbench.errors import PredictionsError
from eigbench.results import predictions

SUFFIXES = (".parquet", ".npz", ".csv")


@pytest.fixture(scope="module")
def split(mini_truth):
    return mini_truth.head(20)


@pytest.fixture(scope="module")
def values():
    rng = np.random.default_rng(0)
    return np.exp(rng.uniform(-20, 20, (20, 10)))


def save(path, ids, values, seeds=None):
    """Write a file as a user would."""
    values = np.asarray(values)
    more = {} if seeds is None else {"seed": list(seeds)}
    if path.suffix == ".parquet":
        pq.write_table(pa.table({"id": list(ids), "eigenvalues": values.tolist(), **more}), path)
    elif path.suffix == ".npz":
        assert seeds is None
        np.savez(path, ids=np.array(ids), eigenvalues=values)
    else:
        columns = {f"lambda_{i + 1}": values[:, i] for i in range(values.shape[1])}
        pd.DataFrame({"id": ids, **columns, **more}).to_csv(path, index=False)
    return path


def refuse(path, split, message):
    with pytest.raises(PredictionsError, match=message):
        predictions.read(path, split)


def shuffled(count):
    return np.random.default_rng(1).permutation(count)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_shuffled_rows_come_back_in_the_order_of_the_split(split, values, suffix, tmp_path):
    order = shuffled(20)
    path = save(tmp_path / f"p{suffix}", [split.ids[i] for i in order], values[order])
    answers = predictions.read(path, split)
    assert answers.shape == (1, 20, 10)
    assert answers.dtype == np.float64
    np.testing.assert_array_equal(answers[0], values)


def test_csv_keeps_every_bit(made_truth, tmp_path):
    rng = np.random.default_rng(3)
    truth = made_truth([f"s-{i}" for i in range(2000)], ["a"] * 2000, np.ones((2000, 10)))
    values = np.exp(rng.uniform(-20, 20, (2000, 10)))
    answers = predictions.read(save(tmp_path / "p.csv", truth.ids, values), truth)
    np.testing.assert_array_equal(answers[0], values)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_seeds_are_told_apart_and_sorted(split, values, suffix, tmp_path):
    order = shuffled(40)
    ids, seeds = np.array([*split.ids, *split.ids]), np.repeat([7, 3], 20)
    both = np.concatenate([values, 2 * values])
    path = save(tmp_path / f"p{suffix}", ids[order].tolist(), both[order], seeds[order].tolist())
    answers = predictions.read(path, split)
    np.testing.assert_array_equal(answers, [2 * values, values])


def test_written_file_is_read_back_exactly(split, values, tmp_path):
    runs = np.stack([values, values[::-1], -values])
    runs[2, 0, :3] = np.nan, np.inf, -np.inf
    predictions.write(tmp_path / "p.parquet", split, runs)
    np.testing.assert_array_equal(predictions.read(tmp_path / "p.parquet", split), runs)


def test_same_predictions_give_the_same_bytes(split, values, tmp_path):
    for name in ("a", "b"):
        predictions.write(tmp_path / f"{name}.parquet", split, values[None])
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


# Ids and values of a file, of those of the split, and what is said of it; {0} is the first id.
WRONG = {
    "an id missing": (lambda ids, v: (ids[1:], v[1:]), "lacks {0} .1.0-mini, test, grouped"),
    "an id of no split": (
        lambda ids, v: ([*ids, "cone-9/0"], [*v, v[0]]),
        "has ids that are not in the split: cone-9/0",
    ),
    "an id of another split": (
        lambda ids, v: (["cone-9/0", *ids[1:]], v),
        "lacks {0}, and has ids that are not in the split: cone-9/0 .1.0-mini, test, grouped",
    ),
    "an id twice": (
        lambda ids, v: ([*ids, ids[4]], [*v, v[4]]),
        "predicts twice {4} .*: give each id one row, or tell the runs apart by a column seed",
    ),
    "no instances": (
        lambda ids, v: ([id.partition("/")[0] for id in ids], v),
        "lacks {0}.* not in the split: .*: an id ends in the number of its instance, as {0}",
    ),
    "too few eigenvalues": (lambda ids, v: (ids, v[:, :9]), r"shape \(20, 9\)|lambda_10"),
    "too many eigenvalues": (
        lambda ids, v: (ids, np.hstack([v, v[:, :1]])),
        r"shape \(20, 11\), it must be \(20, 10\)$|lambda_11",
    ),
    "the zero": (
        lambda ids, v: (ids, np.hstack([1e-12 * v[:, :1], v])),
        r"shape \(20, 11\), it must be \(20, 10\): leave the zero out|lambda_11",
    ),
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("what", WRONG)
def test_file_that_is_not_of_the_split_is_refused(split, values, what, suffix, tmp_path):
    change, message = WRONG[what]
    path = save(tmp_path / f"p{suffix}", *change(split.ids, values))
    refuse(path, split, message.format(*split.ids))


class Unsearched(tuple):
    """Ids among which no id may be searched for: of unknown ones a file can have many."""

    def __contains__(self, id):
        raise AssertionError(id)


def test_unknown_ids_are_not_searched_for_one_by_one(split, values, tmp_path):
    path = save(tmp_path / "p.parquet", [f"cone-{i}" for i in range(20)], values)
    refuse(path, replace(split, ids=Unsearched(split.ids)), "not in the split: cone-0, cone-1, ")


def test_only_the_first_ids_are_named(split, values, mini_truth, tmp_path):
    path = save(tmp_path / "p.parquet", split.ids, values)
    lacked = [id for id in mini_truth.ids if id not in split.ids]
    message = rf"lacks {', '.join(lacked[:3])} and {len(lacked) - 3} more"
    refuse(path, mini_truth, message)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_seed_that_lacks_an_id_is_refused(split, values, suffix, tmp_path):
    path = save(
        tmp_path / f"p{suffix}",
        [*split.ids, *split.ids[:-1]],
        [*values, *values[:-1]],
        [0] * 20 + [1] * 19,
    )
    refuse(path, split, f"lacks {split.ids[-1]}")


def patched(change):
    """A good file whose bytes are changed."""

    def write(path, ids, values):
        save(path, ids, values)
        path.write_bytes(change(path.read_bytes()))

    return write


def changed_byte(path, ids, values):
    save(path, ids, values)
    content = bytearray(path.read_bytes())
    content[content.find(values.tobytes()[:16])] ^= 1
    path.write_bytes(content)


def bare_array(path, ids, values):
    with path.open("wb") as file:
        np.save(file, values)


def no_array(path, ids, values):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("ids.npy", "no array")


def other_columns(path, ids, values):
    frame = pd.DataFrame({"name": ids})
    frame.to_csv(path) if path.suffix == ".csv" else frame.to_parquet(path)


def cells(change):
    """A Parquet file with other cells of eigenvalues."""
    return lambda path, ids, values: pq.write_table(
        pa.table({"id": ids, "eigenvalues": change(values.tolist())}), path
    )


def no_rows(path, ids, values):
    columns = {"id": pa.array([], pa.string()), "eigenvalues": pa.array([], pa.list_(pa.float64()))}
    pq.write_table(pa.table(columns), path)


def with_mark(mark):
    """Return what writes a CSV with another mark between its columns."""

    def write(path, ids, values):
        save(path, ids, values)
        path.write_text(path.read_text().replace(",", mark))

    return write


# How a file is written, and what is said of it; {3} is the fourth id.
DAMAGED = [
    ("p.parquet", patched(lambda raw: raw[:-40]), "cannot be read"),
    ("p.npz", patched(lambda raw: raw[:-40]), "cannot be read"),
    ("p.csv", patched(lambda raw: raw + b",,\n"), "line 22 has 3 fields and the header 11"),
    ("p.npz", changed_byte, "cannot be read: .*CRC"),
    ("p.npz", bare_array, r"p\.npz cannot be read"),
    ("p.npz", no_array, r"p\.npz cannot be read"),
    ("p.npz", lambda path, ids, v: np.savez(path, eigenvalues=v), "it has no array ids"),
    ("p.npz", lambda path, ids, v: save(path, ids[0], v), r"\(20, 10\), it must be \(1, 10\)"),
    ("p.npz", lambda path, ids, v: save(path, ids, v + 1j), "have dtype complex128, they must be"),
    ("p.parquet", other_columns, "cannot be read"),
    ("p.csv", other_columns, "cannot be read"),
    ("p.csv", with_mark(";"), "has no column id: separate columns by commas, not by semicolons"),
    ("p.csv", with_mark("\t"), "has no column id: separate columns by commas, not by tabs"),
    ("p.csv", with_mark("|"), "has no column id: it has 'id|lambda_1|"),
    (
        "p.npz",
        lambda path, ids, v: np.savez(path, ids=np.array(ids, object), eigenvalues=v),
        r"ids\.npy has dtype object: .* or text, as \.astype\(str\) makes",
    ),
    ("p.csv", lambda path, ids, v: path.touch(), "has no column id: its first line is empty"),
    ("p.parquet", no_rows, "has no predictions"),
    ("p.parquet", cells(lambda v: [*v[:3], [1.0] * 5, *v[4:]]), "{3} has 5 eigenvalues, there are"),
    ("p.parquet", cells(lambda v: [*v[:3], None, *v[4:]]), "{3} has 0 eigenvalues, there are 10"),
    ("p.parquet", cells(lambda v: [{"lambda_1": 1.0}] * 20), "have type .*, they must be lists of"),
]


@pytest.mark.parametrize(("name", "write", "message"), DAMAGED)
def test_damaged_file_is_refused(split, values, name, write, message, tmp_path):
    write(tmp_path / name, list(split.ids), values)
    refuse(tmp_path / name, split, message.format(*split.ids))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_file_is_refused(split, suffix, tmp_path):
    refuse(tmp_path / f"p{suffix}", split, f"there is no file .*p{suffix}")


@pytest.mark.parametrize("name", ["p.json", "p", "p.parquet.zip", "p.PKL"])
def test_wrong_suffix_is_refused(split, name, tmp_path):
    refuse(tmp_path / name, split, r"must end in \.parquet, \.npz, \.csv")


@pytest.mark.parametrize("content", [b"", b"PAR1nothing", b"PK\x03\x04nothing", b"\xff\xfe\x00"])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_file_that_is_no_such_file_is_refused(split, suffix, content, tmp_path):
    (tmp_path / f"p{suffix}").write_bytes(content)
    refuse(tmp_path / f"p{suffix}", split, "cannot be read")


def test_changed_byte_of_a_written_file_never_passes_unseen(split, values, tmp_path):
    path = tmp_path / "p.parquet"
    predictions.write(path, split, values[None])
    content = path.read_bytes()
    assert len(content) > 700
    for position in range(0, len(content), 7):
        damaged = bytearray(content)
        damaged[position] ^= 0x10
        path.write_bytes(damaged)
        try:
            answers = predictions.read(path, split)
        except PredictionsError:
            continue
        np.testing.assert_array_equal(answers[0], values)  # a byte that says nothing


def test_pickled_npz_is_refused_and_not_run(split, values, tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    np.savez(tmp_path / "p.npz", ids=np.array([Bomb()], dtype=object), eigenvalues=values)
    refuse(tmp_path / "p.npz", split, "dtype object: arrays are of numbers or text")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize("seeds", [[0] * 19 + [None], [0.5] * 20], ids=["null", "half"])
@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
@pytest.mark.filterwarnings("default")
def test_seed_that_is_no_integer_is_refused(split, values, suffix, seeds, tmp_path):
    path = save(tmp_path / f"p{suffix}", split.ids, values, seeds)
    with pytest.raises(PredictionsError) as caught:
        predictions.read(path, split)
    assert "seed" in str(caught.value).replace(str(path), "")


@pytest.mark.parametrize(
    ("new", "message"),
    [
        (",0.1,1.5,", "line 4 has 12 fields and the header 11"),
        (",1,5,", "line 4 has 12 fields and the header 11"),  # a decimal comma
        (",", "line 4 has 10 fields and the header 11"),
        (",True,", "line 4: lambda_1 is 'True', it must be a number"),
        (",1_0,", "line 4: lambda_1 is '1_0', it must be a number"),
        (",nan ,", "line 4: lambda_1 is 'nan ', it must be a number"),
        (",+nan,", r"line 4: lambda_1 is '\+nan', it must be a number"),
        (',"1.5,', "line 4 has 2 fields"),  # a quote that does not end
        (",1\x005,", r"line 4 is no CSV: line contains NUL|line 4: lambda_1 is '1\\x005'"),
    ],
)
def test_row_of_a_csv_file_that_is_not_as_its_header_is_named(split, new, message, tmp_path):
    path = save(tmp_path / "p.csv", split.ids, np.tile(np.arange(1, 11) + 0.5, (20, 1)))
    head, first, second, *others = path.read_text().splitlines()
    assert second.count(",1.5,") == 1
    changed = second.replace(",1.5,", new)
    path.write_text("\n".join([head, " ", first, changed, *others]))
    refuse(path, split, f"cannot be read: ({message})")


@pytest.mark.parametrize("word", ["", "nan", "NA", "null"])
def test_an_eigenvalue_that_is_missing_is_nan(split, values, word, tmp_path):
    values[3, 4] = np.nan
    path = save(tmp_path / "p.csv", split.ids, values)
    assert path.read_text().count(",,") == 1  # as pandas writes it
    path.write_text(path.read_text().replace(",,", f",{word},"))
    np.testing.assert_array_equal(predictions.read(path, split)[0], values)
