"""Files that are handed in to do harm: each is refused with one line, soon, and without memory.

All are read in one process of its own, which tells what it said, and what it took. The table is
`docs/threats.md`'s; `pytest -m attack` runs it, and those of the other tables there.
"""

import io
import json
import os
import resource
import socket
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from eigbench import results
from eigbench.board import leaderboard
from eigbench.errors import EigbenchError
from eigbench.results import predictions, submission, timing
from eigbench.scaling import results as scaling_results
from eigbench.scoring.truth import Truth

from synthnet.errors import SynthNetError

pytestmark = pytest.mark.attack

CHECKOUT = Path(__file__).parents[3]
RESULT = CHECKOUT / "benchmark/results/1.0-test-grouped/rayleigh-ritz-degree-5.json"
SCALED = CHECKOUT / "benchmark/scaling/rayleigh-ritz-degree-5.json"
TIMED = CHECKOUT / timing.FOLDER / "1.0.json"
SECONDS, MEGABYTES = 1.0, 200  # seconds of the processor: the slowest takes a seventh of one

IDS = [f"cone-{i:05d}/0" for i in range(20)]
VALUES = np.ones((20, 10))


def truth(version="made"):
    shapes = np.array([id.partition("/")[0] for id in IDS])
    trainings = np.full(20, "made/grouped")
    families = np.full(20, "cone")
    digest = "0" * 64
    return Truth(
        version, "test", "grouped", tuple(IDS), shapes, shapes, families, trainings, VALUES, digest
    )


# --- what is read, by the name of the file ---------------------------------------------

READERS = {
    "p.parquet": lambda path, below: predictions.read(path, truth(), below),
    "p.npz": lambda path, below: predictions.read(path, truth(), below),
    "p.csv": lambda path, below: predictions.read(path, truth(), below),
    "r.json": results.read,
    "r.remark.txt": submission._remark,
    "s.json": scaling_results.read,
    "1.0.json": lambda path, below: timing.read(below),
    "paper.json": lambda path, below: leaderboard.read_reported(below),
}
FOLDERS = {"1.0.json": timing.FOLDER, "paper.json": leaderboard.REPORTED}


def content(data):
    raw = data.encode() if isinstance(data, str) else data
    return lambda path: path.write_bytes(raw)


def listening(path):
    here = os.open(".", os.O_RDONLY)
    os.chdir(path.parent)  # a socket's path is short
    try:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    finally:
        os.fchdir(here)
        os.close(here)


def sparse(path):
    with path.open("wb") as file:
        file.truncate(2**40)


def link(target):
    return lambda path: path.symlink_to(target)


def folder_link(path):
    """The file's folder is a link to one beside it, which has a good file."""
    path.parent.rename(path.parent.with_name("elsewhere"))
    path.parent.symlink_to("elsewhere")
    parquet()(path)


def parquet(ids=IDS, values=None, *, patch=None, **how):
    def make(path):
        columns = {"id": ids, "eigenvalues": VALUES.tolist() if values is None else values}
        pq.write_table(pa.table(columns), path, **how)
        if patch is not None:
            path.write_bytes(patch(path.read_bytes()))

    return make


def renamed(raw):
    """The column of the eigenvalues has another name where its pages are described."""
    at = raw.rindex(b"eigenvalues")
    return raw[:at] + b"eigenvalueZ" + raw[at + 11 :]


def repeated(text, count):
    """A text that is stored once and told apart by numbers."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, np.int32)), pa.array([text]))


def npy(shape, dtype="<f8", data=None):
    """An NPY file whose header says what it likes."""
    file = io.BytesIO()
    header = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize if data is None else 0
    return file.getvalue() + (bytes(size) if data is None else data)


def npz(**arrays):
    def make(path):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, array in {"ids": npy((20,), "<U14"), **arrays}.items():
                archive.writestr(f"{name}.npy", array)

    return make


HEAD = "id," + ",".join(f"lambda_{i}" for i in range(1, 11))
LINE = "\n{}," + ",".join("1" * 10)


def csv(head=HEAD, lines=20, more=""):
    rows = "".join(LINE.format(IDS[i % 20]) for i in range(lines))
    return content(head + rows + more)


def changed(source, **changes):
    """A file of JSON with values at paths of keys changed, as its author hands it in."""

    def make(path):
        value = json.loads(source.read_text())
        value.pop("verified", None)  # by a maintainer, who would see the change in its digest
        for keys, new in changes.items():
            *way, last = [int(k) if k.isdigit() else k for k in keys.split("__")]
            level = value
            for key in way:
                level = level[key]
            level[last] = new(level[last]) if callable(new) else new
        path.write_text(json.dumps(value))

    return make


def result(**changes):
    return changed(RESULT, **changes)


def named(name):
    return result(model__name=name)


PARTIAL = '"partial": false'


def text(new):
    """A result with other text in one place."""

    def make(path):
        whole = RESULT.read_text()
        assert PARTIAL in whole
        path.write_text(whole.replace(PARTIAL, new, 1))

    return make


# By the name of the file: what it is, how it is made, and what is said of it.
CASES = {
    "p.parquet": [
        ("link", link("/etc/hostname"), "reached by a symbolic link"),
        ("linked-folder", folder_link, "reached by a symbolic link"),
        ("folder", Path.mkdir, "is no regular file"),
        ("parquet-rows", parquet([""] * 10**6, [[1.0]] * 10**6), "1,000,000 rows"),
        (
            "parquet-values-of-a-row",
            parquet(["a"], pa.array([np.zeros(2 * 10**7)]), compression="zstd"),
            "the column eigenvalues unpacks to more than it can have",
        ),
        (
            "parquet-values-under-another-name",
            parquet(["a"], pa.array([np.zeros(2 * 10**7)]), compression="zstd", patch=renamed),
            "columns whose names are not those of its schema",
        ),
        (
            "parquet-dictionary",
            parquet(repeated("a" * 10**7, 20), compression="zstd"),
            "the column id unpacks to more than it can have",
        ),
        ("parquet-text", parquet(repeated("a" * 2000, 20)), "a text of 2,000 bytes"),
        (
            "parquet-prefixes",
            parquet(
                [f"{'a' * 10**5}{i}" for i in range(20)],
                use_dictionary=False,
                column_encoding={"id": "DELTA_BYTE_ARRAY"},
            ),
            "is encoded as DELTA_BYTE_ARRAY",
        ),
        (
            "parquet-lengths",
            parquet(
                ["a"] * 20, use_dictionary=False, column_encoding={"id": "DELTA_LENGTH_BYTE_ARRAY"}
            ),
            "is encoded as DELTA_LENGTH_BYTE_ARRAY, which is not read: write it with a dictionary",
        ),
        (
            "parquet-footer-length",
            parquet(patch=lambda raw: raw[:-8] + b"\xff\xff\xff\x7fPAR1"),
            "no footer of Parquet, or one that is too long",
        ),
        (
            "parquet-footer-nested",
            content(b"PAR1" + b"\x1c" * 1000 + (1000).to_bytes(4, "little") + b"PAR1"),
            "a footer that is not Parquet's",
        ),
        ("parquet-columns", parquet(values=[{str(i): 1 for i in range(200)}] * 20), "col"),
        ("parquet-numbers-as-ids", parquet(range(20)), "they must be text"),
        ("parquet-seeds", parquet(IDS * 21, [[1.0] * 10] * 420), "420 rows"),
        (
            "parquet-of-another-split",
            lambda path: predictions.write(path, truth("other"), VALUES[None]),
            "it says that it is of other, test, grouped, not of made, test, grouped",
        ),
    ],
    "p.csv": [
        ("link-to-zero", link("/dev/zero"), "reached by a symbolic link"),
        ("socket", listening, "cannot be read"),
        ("sparse-terabyte", sparse, "1,099,511,627,776 bytes, at most"),
        ("csv-line", csv(more="\n" + "1" * 10**5), "a line of more than"),
        ("csv-head", csv(head="id" + ",a" * 5000), "columns, at most 100"),
        ("csv-rows", csv(lines=401), "more than 400 lines"),
        ("csv-column-twice", csv(head=HEAD + ",id"), "the column 'id' is there twice"),
        ("csv-bytes", content(b"\xff\xfe\x00"), "is no UTF-8: save it as UTF-8"),
        ("csv-words", csv(more=LINE.format("x").replace("1", "one")), "cannot be read"),
        ("csv-bidi", csv(more=LINE.format("a\u202eb")), r"not in the split: a\\u202eb"),
    ],
    "r.json": [
        ("link-to-nothing", link("nothing"), "reached by a symbolic link"),
        ("fifo-as-result", os.mkfifo, "is no regular file"),
        ("sparse-result", sparse, "1,099,511,627,776 bytes, at most"),
        ("json-400-digits", text(f'"a": {"9" * 400}'), "a number of 400 digits"),
        ("json-5000-digits", text(f'"a": {"9" * 5000}'), "a number of 5000 digits"),
        ("json-exponent", text('"a": 1e999'), "1e999 is too large a number"),
        ("json-deep", content(b"[" * 40_000), "JSON that is too deep"),
        ("json-levels", content("[" * 50 + "]" * 50), "JSON of more than 32 levels"),
        ("json-many", content(f"[{'0,' * 10**6}0]"), "JSON of more than 50,000 values"),
        # Few commas, and in each pair of them many lists
        (
            "json-nested",
            content(f"[{('[' * 300 + ']' * 300 + ',') * 6900}0]"),
            "JSON of more than 50,000 values",
        ),
        (
            "json-pairs",
            content(json.dumps({str(n): n for n in range(30_000)})),
            "more than 50,000 keys and values",
        ),
        ("json-errors", result(scores__mesh__per_index=[0] * 40_000), "is no result"),
        ("json-surrogate", named("a\ud800"), r"U\+D800, which cannot be printed"),
        ("json-nan", text('"a": NaN'), "NaN is no JSON number"),
        ("json-plus-infinity", text('"a": Infinity'), ": Infinity is no JSON number"),
        ("json-infinity", text('"a": -Infinity'), "-Infinity is no JSON number"),
        ("json-key-twice", text(PARTIAL + "," + PARTIAL), "'partial' is there twice"),
        ("json-utf-16", content("{}".encode("utf-16")), "cannot be read"),
        ("json-long-text", named("a" * 10**5), "a text of 100,000 characters"),
        # Texts
        ("bidi", named("Weyl\u202etxt"), r"U\+202E, which cannot be printed"),
        ("bidi-isolate", result(model__licence="\u2066MIT"), r"U\+2066"),
        ("terminal", named("Weyl\x1b[2J"), r"U\+001B"),
        ("two-lines", named("Weyl\n## 1st"), r"U\+000A"),
        ("no-width", named("Weyl\u200b"), r"U\+200B"),
        ("not-composed", named("Poincare\u0301"), r"not composed \(NFC\)"),
        ("unseen", named("Weyl\u3164"), r"U\+3164, which cannot be seen"),
        ("selector", result(model__licence="MIT\ufe0f"), r"U\+FE0F, which cannot be seen"),
        ("mark", named("Weyl\u0332"), r"the mark U\+0332, which does not compose with"),
        (
            "look-alike",
            named("W\u0435yl"),
            r"its model's name has the letter .* \(U\+0435\): a row's",
        ),
        ("script", named("Модель 5"), r"its model's name has the letter М \(U\+041C\): a row's"),
        ("bidi-in-a-key", result(environment={"\u202e": ""}), r"U\+202E"),
        ("code-elsewhere", result(model__code="../../.ssh/id"), "at model/code"),
        ("source-above", result(model__sources={"../a": "0" * 64}), "at model/sources"),
        ("source-absolute", result(model__sources={"/a": "0" * 64}), "at model/sources"),
        ("version-as-path", result(dataset__version="../1.0"), "at dataset/version"),
        # Numbers
        ("too-fast", result(cost__reference__ratio=lambda r: 100 * r), "LaPy's time and the"),
        ("quartiles", result(cost__ms_per_mesh=1e-9), "not between the quartiles"),
        ("cores", result(cost__cores_used=40.0), "40.0 cores used, of 2"),
        ("negative", result(cost__peak_memory_mb=-1), "at cost/peak_memory_mb"),
        ("endless", result(cost__ms_per_mesh_mean=1e30), "at cost/ms_per_mesh_mean"),
        ("timeless", result(cost__ms_per_mesh_mean=0), "at cost/ms_per_mesh_mean: 0 is less"),
        ("meshes", result(cost__reference__meshes=10**6), "LaPy is timed on more meshes"),
        ("shapes", result(dataset__shapes=10**5), "more shapes than instances"),
        ("instances", result(dataset__instances=10**5), "the families have 14886 instances"),
        ("parameters", result(model__parameters=10**20), "at model/parameters"),
        ("shares", result(physics__positive=1.5), "at physics/positive"),
        ("seeds", result(predictions__seeds=10**6), "at predictions/seeds"),
    ],
    "r.remark.txt": [
        ("link-as-remark", link("/etc/passwd"), "reached by a symbolic link"),
        ("remark-bidi", content("first\u202e"), r"U\+202E"),
        ("remark-bytes", content(b"\xff"), "is not UTF-8 text"),
        ("remark-size", content("a" * 10**6), "1,000,000 bytes, at most"),
    ],
    "1.0.json": [
        ("link-as-times", link(str(TIMED)), "reached by a symbolic link"),
        ("times-ratio", changed(TIMED, rows__3__cost__reference__ratio=9), "not in its int"),
        (
            "times-own",
            changed(TIMED, rows__3__cost__ms_per_mesh_mean=lambda m: m / 2),
            "its times give",
        ),
        (
            "times-batches",
            changed(TIMED, rows__3__cost__ms_by_batch=lambda all: [0 for _ in all]),
            "at rows/3/cost/ms_by_batch/0: 0 is less",
        ),
        ("times-keys", changed(TIMED, rows__3={}), "is a required property"),
    ],
    "paper.json": [
        ("link-as-paper", link(str(TIMED)), "reached by a symbolic link"),
        ("paper-keys", content("{}"), "is a required property"),
        ("paper-list", content("[]"), "is no result: at the top"),
    ],
    "p.npz": [
        ("fifo", os.mkfifo, "is no regular file"),
        ("npz-rows", npz(eigenvalues=npy((10**12, 10), data=b"")), "more than it can have"),
        ("npz-negative", npz(eigenvalues=npy((-20, 10), data=b"")), "cannot be read"),
        ("npz-pickle", npz(eigenvalues=npy((20, 10), "|O", b"cos\n")), "dtype object"),
        (
            "npz-bomb",
            npz(eigenvalues=npy((20, 10), data=bytes(5 * 10**7))),
            "another length than its header says",
        ),
        ("npz-short", npz(eigenvalues=npy((20, 10), data=b"")), "another length"),
        (
            "npz-text",
            npz(ids=npy((20,), "<U100000"), eigenvalues=npy((20, 10))),
            "more than it can have",
        ),
        ("npz-members", npz(**{f"a{i}": b"" for i in range(200)}), "at most 100 are read"),
    ],
    "s.json": [
        ("scaled-cores", changed(SCALED, cost__threads=0), "at cost/threads"),
        (
            "scaled-helpers",
            changed(SCALED, meshes__0__cpu_seconds=lambda all: [9e9 for _ in all]),
            "cores and declares 1 threads",
        ),
        (
            "scaled-late",
            changed(
                SCALED, meshes__0__time_limit=1e-9, meshes__0__seconds=lambda s: [9.0 for _ in s]
            ),
            "later than its time limit",
        ),
    ],
}
EACH = [(file, *case) for file, cases in CASES.items() for case in cases]


def path_of(folder, case, file):
    return folder / case / FOLDERS.get(file, Path("deep", "er")) / file


@pytest.fixture(scope="module")
def reports(tmp_path_factory, environment):
    """What the process that reads all of them says of each, by its case."""
    folder = tmp_path_factory.mktemp("attacks")
    for file, case, make, _ in EACH:
        path = path_of(folder, case, file)
        path.parent.mkdir(parents=True)
        make(path)
    done = subprocess.run(
        [sys.executable, __file__, folder],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return {line["case"]: line for line in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize(("case", "message"), [(case, message) for _, case, _, message in EACH])
def test_it_is_refused_with_one_line_soon_and_without_memory(reports, case, message):
    line = reports[case]
    assert line["message"] is not None, "it passed"
    with pytest.raises(EigbenchError, match=message):
        raise EigbenchError(line["message"])
    assert line["message"].isprintable()
    assert len(line["message"]) < 800
    assert line["seconds"] < SECONDS
    assert line["megabytes"] < MEGABYTES


@pytest.mark.parametrize("file", ["p.parquet", "p.npz", "p.csv"])
def test_a_good_file_passes(file, tmp_path):
    ids = npy((20,), "<U14", np.array(IDS, "<U14").tobytes())
    values = npy((20, 10))
    make = {"p.parquet": parquet(), "p.npz": npz(ids=ids, eigenvalues=values), "p.csv": csv()}
    make[file](tmp_path / file)
    assert predictions.read(tmp_path / file, truth()).shape == (1, 20, 10)


def test_good_results_and_times_pass(tmp_path):
    for source, read in ((RESULT, results.read), (SCALED, scaling_results.read)):
        changed(source)(tmp_path / "r.json")
        assert read(tmp_path / "r.json")
    (tmp_path / timing.FOLDER).mkdir(parents=True)
    changed(TIMED)(tmp_path / timing.FOLDER / "1.0.json")
    assert timing.read(tmp_path)["1.0"]


def test_nothing_is_written_or_removed_through_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    board = tmp_path / "board"
    board.mkdir()
    (board / "benchmark").symlink_to("../elsewhere")
    with pytest.raises(EigbenchError, match="benchmark is a symbolic link"):
        results.put([RESULT], [board / "benchmark" / "results" / "r.json"], board)
    assert not list((tmp_path / "elsewhere").iterdir())


def main(folder):
    """Read all cases, and print a line of JSON for each."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for file, case, _, _ in EACH:
        start, message = time.process_time(), None
        try:
            READERS[file](path_of(folder, case, file), folder / case)
        except (EigbenchError, SynthNetError) as error:
            message = str(error)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        facts = {"case": case, "message": message, "seconds": time.process_time() - start}
        print(json.dumps({**facts, "megabytes": grown / 2**10}), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]))
