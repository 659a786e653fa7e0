"""Tests of all disk access: shards, manifest, directories, full and damaged disks."""

import ast
import dataclasses
import errno
import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import platformdirs
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import synthnet
from synthnet import store
from synthnet.errors import BuildError, DamagedError, StoreError
from synthnet.store import files
from synthnet.types import Certificate, Manifest, Mesh, Rejection, Sample, ShapeSpec, ShardRecord

REJECTION = Rejection("torus-00007", "torus", "degenerate_face", "20 of 1,200 faces — flat")


def write(path, samples, rejections=()):
    path.parent.mkdir(parents=True, exist_ok=True)
    family = samples[0].spec.family if samples else "torus"
    return store.write_shard(path, samples, rejections, family=family, recipe_digest="d" * 64)


def exact(sample):
    """Everything in a sample, arrays with dtype, shape and bytes, numbers with their type."""
    spec = sample.spec
    values = [spec.id, spec.family, spec.index, spec.group, sample.split, sample.paper_splits]
    values += [(name, type(v), v) for name, v in spec.parameters.items()]
    values += [sample.trivial, sample.certificate]
    mesh = sample.mesh
    arrays = (mesh.vertices, mesh.faces, sample.eigenvalues, sample.isometries)
    return values + [(a.dtype.str, a.shape, np.ascontiguousarray(a).tobytes()) for a in arrays]


@pytest.fixture
def torus_shard(tiny_samples, tmp_path):
    path = tmp_path / "shards" / "torus-0000.parquet"
    write(path, tiny_samples["torus"], (REJECTION,))
    return path


# Shards


@pytest.mark.parametrize("family", ["torus", "tetrahedron", "split_cone", "sphere"])
def test_samples_come_back_exactly(family, tiny_samples, tmp_path):
    path, samples = tmp_path / "shards" / "a.parquet", tiny_samples[family]
    write(path, samples)
    assert list(map(exact, store.read_samples(path))) == list(map(exact, samples))


def test_awkward_numbers_come_back_exactly(tmp_path):
    vertices = np.array([[-0.0, 1e-45, 3.4e38], [1 / 3, 0.1, -1], [0, 1, 2]], np.float32)
    sample = Sample(
        spec=ShapeSpec("sphere-00003", "sphere", 3, {"radius": 1.0, "n": 1, "x": 0.1 + 0.2}, "é"),
        mesh=Mesh(vertices, np.array([[0, 1, 2]], np.int32)),
        eigenvalues=np.array([5e-324, 0.1 + 0.2, 1e308]),
        trivial=-1.1e-17,
        certificate=Certificate(4, 1 / 3, float(np.nextafter(1, 2))),
        isometries=np.array([np.eye(3), -np.eye(3) / 3]),
        split="validation",
        paper_splits=("train", "test"),
    )
    write(tmp_path / "shards" / "a.parquet", [sample])
    (stored,) = store.read_samples(tmp_path / "shards" / "a.parquet")
    assert exact(stored) == exact(sample)
    assert [type(v) for v in stored.spec.parameters.values()] == [float, int, float]
    assert np.signbit(stored.mesh.vertices[0, 0])


def test_record_says_what_is_in_the_shard(tiny_samples, tmp_path):
    path = tmp_path / "shards" / "torus-0000.parquet"
    record = write(path, tiny_samples["torus"], (REJECTION,))
    assert record == ShardRecord(
        file="shards/torus-0000.parquet",
        family="torus",
        sha256=files.sha256(path),
        size=len(path.read_bytes()),
        rows=4,
        vertices=4 * 8 * 6,  # a vertex for each of 8 x 6 steps around the torus
        faces=4 * 2 * 8 * 6,
        rejections=(REJECTION,),
    )
    assert store.read_record(path, "d" * 64) == record


def test_same_samples_give_the_same_bytes_also_read_and_written_again(
    torus_shard, tiny_samples, tmp_path
):
    other = tmp_path / "other" / torus_shard.name
    read = list(store.read_samples(torus_shard))
    for samples, same in ((tiny_samples["torus"], True), (read, True), (read[:-1], False)):
        write(other, samples, (REJECTION,))
        assert (other.read_bytes() == torus_shard.read_bytes()) == same


def test_labels_are_read_without_the_meshes(torus_shard, monkeypatch):
    expected = [(s.spec, s.eigenvalues.tolist()) for s in store.read_samples(torus_shard)]
    monkeypatch.setattr(store.shards, "Mesh", None)
    read = [(spec, label.tolist()) for spec, label in store.read_labels(torus_shard)]
    assert read == expected


def test_shard_of_rejections_only(tmp_path):
    path = tmp_path / "shards" / "torus-0000.parquet"
    record = write(path, [], (REJECTION,))
    assert (record.rows, record.vertices, record.faces) == (0, 0, 0)
    assert record.rejections == (REJECTION,)
    assert list(store.read_samples(path)) == []
    assert store.read_record(path, "d" * 64) == record


def test_shard_columns_are_plain_parquet(torus_shard):
    table = pq.read_table(torus_shard)
    assert table.schema.names == store.SCHEMA.names
    assert table.schema.field("vertices").type == pa.list_(pa.list_(pa.float32(), 3))
    assert {
        pq.ParquetFile(torus_shard).metadata.row_group(0).column(i).compression
        for i in range(len(store.SCHEMA))
    } == {"ZSTD"}


def test_missing_shard_says_what_to_do(tmp_path):
    with pytest.raises(DamagedError, match=r"a\.parquet is missing: run `synthnet build` again"):
        store.read_table(tmp_path / "a.parquet")


def test_shard_of_another_schema_is_refused(tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"id": ["torus-00000"]}), path)
    with pytest.raises(StoreError, match="has another schema: remove it and build again"):
        store.read_table(path)


def test_shard_of_another_recipe_is_refused(torus_shard):
    with pytest.raises(StoreError, match=r"belongs to another recipe: remove .* or choose another"):
        store.read_record(torus_shard, "e" * 64)


def test_shard_of_other_shapes_than_planned_is_damaged(torus_shard):
    record = store.read_record(torus_shard, "d" * 64)
    ids = [sample.spec.id for sample in store.read_samples(torus_shard)]
    ids += [rejection.id for rejection in record.rejections]
    assert store.read_record(torus_shard, "d" * 64, ids[::-1]) == record
    for others in (ids[1:], [*ids[1:], "torus-99999"], [*ids, "torus-99999"]):
        with pytest.raises(StoreError, match=r"\(it holds other shapes than it should\)"):
            store.read_record(torus_shard, "d" * 64, others)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.5, 0.9, 0.99, 0.9999])
def test_truncated_shard_is_damaged(torus_shard, share):
    content = torus_shard.read_bytes()
    torus_shard.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DamagedError, match=r"is damaged .*: remove it and run .* again") as caught:
        list(store.read_samples(torus_shard))
    assert "\n" not in str(caught.value)
    with pytest.raises(DamagedError, match="is damaged"):
        store.read_record(torus_shard, "d" * 64)


def flipped(shard, part, seed):
    """Alter a bit of the data or of the footer of a shard, again and again; yield which byte."""
    good = shard.read_bytes()
    footer = len(good) - 8 - int.from_bytes(good[-8:-4], "little")
    start, stop = (0, footer) if part == "data" else (footer, len(good))
    rng = np.random.default_rng(seed)
    for position in rng.choice(np.arange(start, stop), 150, replace=False):
        bad = bytearray(good)
        bad[position] ^= 1 << rng.integers(8)
        shard.write_bytes(bad)
        yield int(position)


@pytest.mark.parametrize("part", ["data", "footer"])
def test_flipped_byte_never_gives_other_data(torus_shard, part):
    samples = [exact(s) for s in store.read_samples(torus_shard)]
    messages = []
    for position in flipped(torus_shard, part, seed=20240726):
        try:
            stored = [exact(s) for s in store.read_samples(torus_shard)]
        except StoreError as error:
            messages.append(str(error))
        else:
            assert stored == samples, f"byte {position} changed the data unnoticed"
    assert len(messages) > 50
    assert not any("\n" in message for message in messages)


@pytest.mark.parametrize("part", ["data", "footer"])
def test_altered_shard_is_never_taken_for_a_finished_one(torus_shard, part):
    # A build that goes on keeps what read_record accepts, and must end with the same bytes.
    refused = 0
    for _ in flipped(torus_shard, part, seed=20240727):
        with pytest.raises(StoreError, match=r"\A[^\n]+\Z"):
            store.read_record(torus_shard, "d" * 64)
        refused += 1
    assert refused == 150


# Manifest


@pytest.fixture
def manifest(tiny, torus_shard):
    record = store.read_record(torus_shard, "d" * 64)
    return Manifest(
        version="tiny",
        recipe_digest="d" * 64,
        recipe=tiny.to_dict(),
        drawn={"torus": 5},
        shards=(record,),
        packages={"python": "3.11.7"},
    )


@pytest.fixture
def written(manifest, tmp_path):
    """The file of the manifest."""
    store.write_manifest(tmp_path, manifest)
    return tmp_path / "manifest.json"


def test_manifest_comes_back(manifest, written):
    stored = store.read_manifest(written.parent)
    assert stored == manifest
    assert (stored.rows, stored.rejections) == (4, (REJECTION,))


def test_manifest_is_json_with_a_schema_version(manifest, written):
    content = json.loads(written.read_text())
    assert content["schema_version"] == store.SCHEMA_VERSION
    assert content["shards"][0]["sha256"] == manifest.shards[0].sha256
    assert content["shards"][0]["rejections"][0]["reason"] == "degenerate_face"


def test_no_manifest_is_none(tmp_path):
    assert store.read_manifest(tmp_path) is None
    assert store.read_manifest(tmp_path / "nothing" / "here") is None


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"3", b"null", b"{}", b'{"schema_version": 2}', b"\0", b"\xff\xfe\x80"],
)
def test_damaged_manifest_is_refused(content, tmp_path):
    (tmp_path / "manifest.json").write_bytes(content)
    with pytest.raises(DamagedError, match=r"manifest\.json is damaged .*: remove it") as caught:
        store.read_manifest(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("apart", [7, pytest.param(1, marks=pytest.mark.slow)])
def test_every_altered_byte_of_a_manifest_is_refused(apart, written, tmp_path):
    whole = written.read_bytes()
    assert len(whole) > 100 * apart
    for at in range(0, len(whole), apart):
        byte = whole[at]
        blank = bytes([byte]).isspace()
        for other in set(b" \n\r\t") - {byte} if blank else {byte ^ 1}:
            written.write_bytes(whole[:at] + bytes([other]) + whole[at + 1 :])
            with pytest.raises(StoreError):
                store.read_manifest(tmp_path)
    for text in (whole[:-1], whole + b"\n", json.dumps(json.loads(whole)).encode()):
        written.write_bytes(text)
        with pytest.raises(DamagedError, match="its bytes are not those of its content"):
            store.read_manifest(tmp_path)


@pytest.mark.parametrize("key", [f.name for f in dataclasses.fields(Manifest)])
def test_manifest_that_lacks_a_key_is_refused(key, written, tmp_path):
    content = json.loads(written.read_text())
    del content[key]
    written.write_text(json.dumps(content))
    with pytest.raises(DamagedError, match=f"is damaged .*{key}"):
        store.read_manifest(tmp_path)


@pytest.mark.attack
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.update(version="../1.0"), r"'../1.0' is no name"),
        (lambda m: m.update(version=1.0), "1.0 is no str"),
        (lambda m: m.update(recipe_digest="d" * 63), "'d+' is no SHA-256"),
        (lambda m: m.update(recipe=[]), r"\[\] is no dict"),
        (lambda m: m.update(drawn={"..": 1, **m["drawn"]}), "'..' is no name"),
        (lambda m: m.update(drawn={"a/b": 1, **m["drawn"]}), "'a/b' is no name"),
        (lambda m: m["drawn"].update(torus=-1), "-1 is no number of something"),
        (lambda m: m.update(packages={"numpy": 2}), "2 is no str"),
        (lambda m: m.update(surprise=1), "unexpected keyword argument 'surprise'"),
        (lambda m: m["shards"][0].update(file="/etc/passwd"), "'/etc/passwd' is no file of a"),
        (lambda m: m["shards"][0].update(file="shards/../x-0000.parquet"), "is no file of a shard"),
        (lambda m: m["shards"][0].update(file="torus-0000.parquet"), "is no file of a shard"),
        (lambda m: m["shards"][0].update(sha256=None), "None is no SHA-256"),
        (lambda m: m["shards"][0].update(rows=True), "True is no number of something"),
        (lambda m: m["shards"][0].update(family="cone"), "of a family that was not drawn"),
        (
            lambda m: m["shards"][0]["rejections"].append(
                {"id": 1, "family": "torus", "reason": "", "detail": ""}
            ),
            "1 is no str",
        ),
    ],
)
def test_manifest_is_read_by_its_schema(change, message, written, tmp_path):
    """Each forgery has a whole digest of its own."""
    content = json.loads(written.read_text())
    del content[store.DIGEST]
    change(content)
    written.write_text(store.with_digest(content))
    with pytest.raises(DamagedError, match=rf"is damaged \(.*{message}"):
        store.read_manifest(tmp_path)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda path: path.write_text("[" * 100_000), DamagedError, "is damaged"),
        (os.mkfifo, DamagedError, "it is no file"),
        (Path.mkdir, StoreError, r"manifest\.json"),
    ],
    ids=["nested without end", "a pipe", "a directory"],
)
def test_manifest_that_is_no_file_or_nested_without_end(make, error, message, tmp_path):
    make(tmp_path / "manifest.json")
    with pytest.raises(error, match=message):
        store.read_manifest(tmp_path)


def test_manifest_of_another_schema_version_is_refused(written, tmp_path):
    written.write_text(written.read_text().replace('"schema_version": 2', '"schema_version": 1'))
    with pytest.raises(StoreError, match="has schema version 1, this synthnet reads 2: remove"):
        store.read_manifest(tmp_path)


# A finished dataset


@pytest.fixture
def dataset(tiny, tiny_samples, tmp_path):
    directory = tmp_path / "tiny"
    records = [
        write(directory / "shards" / f"{family}-0000.parquet", samples)
        for family, samples in tiny_samples.items()
    ]
    records[0] = dataclasses.replace(records[0], rejections=(REJECTION,))
    drawn = {name: tiny.drawn(name) for name in tiny.families}
    manifest = Manifest("tiny", "d" * 64, tiny.to_dict(), drawn, tuple(records), {})
    store.write_manifest(directory, manifest)
    return store.open_dataset("tiny", tmp_path)


def test_samples_of_a_dataset_come_in_order_and_each_is_found(dataset, tiny_samples):
    written = [s for samples in tiny_samples.values() for s in samples]
    assert len(written) == 10
    assert list(map(exact, dataset.samples())) == list(map(exact, written))
    assert [p.name for p in dataset.paths()] == [f"{name}-0000.parquet" for name in tiny_samples]
    for sample in written:
        assert exact(dataset.find(sample.spec.id)) == exact(sample)


UNKNOWN_FAMILY = r"no shape .*: an id is a family \(torus, .*\) and a num"


@pytest.mark.parametrize(
    ("id", "message"),
    [
        ("torus-00007", "torus-00007 was rejected by degenerate_face: 20 of"),
        ("torus-00099", "no shape 'torus-00099' in tiny: `synthnet info tiny --ids` lists them"),
        *((id, UNKNOWN_FAMILY) for id in ("dodecahedron-00000", "torus", "", "-", "../x")),
    ],
)
def test_find_of_what_is_not_there_says_why(id, message, dataset):
    with pytest.raises(StoreError, match=message):
        dataset.find(id)


def test_dataset_that_is_not_built_says_how_to_build_it(tmp_path):
    message = rf"no finished dataset in .*: run `synthnet build 1\.0 --out {tmp_path}`"
    with pytest.raises(StoreError, match=message):
        store.open_dataset("1.0", tmp_path)


# Where it is


def test_home_is_the_argument_then_the_variable_then_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("SYNTHNET_HOME", str(tmp_path / "variable"))
    assert store.home(tmp_path / "argument") == tmp_path / "argument"
    assert store.home(str(tmp_path / "argument")) == tmp_path / "argument"
    assert store.home() == tmp_path / "variable"
    monkeypatch.setenv("SYNTHNET_HOME", "")
    assert store.home() == Path(platformdirs.user_cache_dir("synthnet"))
    monkeypatch.delenv("SYNTHNET_HOME")
    assert store.home() == Path(platformdirs.user_cache_dir("synthnet"))
    assert store.dataset_directory("1.0", tmp_path) == tmp_path / "1.0"


def test_home_expands_the_tilde(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert store.home("~/data") == tmp_path / "data"
    monkeypatch.setenv("SYNTHNET_HOME", "~/other")
    assert store.home() == tmp_path / "other"


# A disk that cannot be written or is full


@pytest.fixture(params=["below a file", "in /proc", "in a closed directory"])
def unwritable(request, tmp_path):
    if request.param == "below a file":
        (tmp_path / "file").write_text("no directory")
        return tmp_path / "file" / "home"
    if request.param == "in /proc":
        if not Path("/proc/self").exists():
            pytest.skip("this system has no /proc")
        return Path("/proc/synthnet")
    if os.geteuid() == 0:
        pytest.skip("root may write into a closed directory")
    (tmp_path / "closed").mkdir(mode=0o500)
    return tmp_path / "closed" / "home"


def test_directory_that_cannot_be_made_is_named(unwritable):
    remedy = r"choose another directory with --out or [^\n]*"
    line = rf"\Acannot write to {unwritable} [^\n]*: {remedy}\Z"
    with pytest.raises(BuildError, match=line):
        files.make_directory(unwritable)


def test_manifest_below_a_file_is_not_a_crash(unwritable):
    # `synthnet build --out README.md/x` asks for the manifest before it makes a directory.
    assert store.read_manifest(unwritable) is None


def test_directory_that_can_be_written_is_left_empty(tmp_path):
    files.make_directory(tmp_path / "a" / "b")
    files.make_directory(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def failing(number):
    """Return a function that the system lets down."""

    def fail(*_, **__):
        raise OSError(number, os.strerror(number))

    return fail


def full_disk(table, path, **options):
    path.write_bytes(b"the first half")
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def test_full_disk_is_said_and_nothing_is_left(torus_shard, tiny_samples, monkeypatch):
    before = torus_shard.read_bytes()
    monkeypatch.setattr(pq, "write_table", full_disk)
    with pytest.raises(BuildError, match=r"no space left for .*: free some and run the same") as e:
        write(torus_shard, tiny_samples["torus"][:1])
    assert "\n" not in str(e.value)
    assert "what is finished is kept" in str(e.value)
    assert [p.name for p in torus_shard.parent.iterdir()] == [torus_shard.name]
    assert torus_shard.read_bytes() == before


def test_other_trouble_of_the_disk_is_said_and_nothing_is_left(tmp_path):
    def broken(partial):
        partial.write_bytes(b"the first half")
        raise OSError(errno.EIO, "Input/output error")

    with pytest.raises(BuildError, match=r"cannot write .*a\.json .*Input/output error"):
        files.write_atomically(tmp_path / "a.json", broken)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("problem", [ValueError, KeyboardInterrupt])
def test_nothing_is_left_whatever_is_raised(problem, tmp_path):
    def broken(partial):
        partial.write_bytes(b"the first half")
        raise problem

    with pytest.raises(problem):
        files.write_atomically(tmp_path / "a.json", broken)
    assert list(tmp_path.iterdir()) == []


def test_text_is_utf8_whatever_the_locale(tmp_path):
    code = "import sys, pathlib; from synthnet.store import files, storage; "
    code += (
        "[m.write_text(pathlib.Path(sys.argv[1], m.__name__), chr(955)) for m in (files, storage)]"
    )
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    subprocess.run([sys.executable, "-c", code, tmp_path], env=environment, check=True)
    written = sorted(tmp_path.iterdir())
    assert [path.name for path in written] == ["synthnet.store.files", "synthnet.store.storage"]
    assert [path.read_bytes() for path in written] == ["λ".encode()] * 2


def test_really_full_disk(tiny_samples, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    if mount is None or os.geteuid() != 0:
        pytest.skip("only root can mount a small disk")
    options = [mount, "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)]
    mounted = subprocess.run(options, capture_output=True, check=False, text=True)
    if mounted.returncode:
        pytest.skip(f"cannot mount a small disk: {mounted.stderr.strip()}")
    try:
        rng = np.random.default_rng(0)  # noise, so that compression does not make it fit
        (first, *_) = tiny_samples["torus"]
        noise = Mesh(rng.random((20_000, 3), np.float32), first.mesh.faces)
        write(disk / "shards" / "small.parquet", [first])
        with pytest.raises(BuildError, match=r"no space left for .*: free some and run the same"):
            write(disk / "shards" / "big.parquet", [dataclasses.replace(first, mesh=noise)])
        assert [p.name for p in (disk / "shards").iterdir()] == ["small.parquet"]
        assert exact(next(store.read_samples(disk / "shards" / "small.parquet"))) == exact(first)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_directory_is_made_in_place_or_not_at_all(tmp_path):
    def good(partial):
        (partial / "new").touch()

    def full(partial):
        (partial / "half").touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def is_whole():
        return (folder / "new").exists()

    folder = tmp_path / "place"
    with pytest.raises(BuildError, match="no space left"):
        files.make_in_place(folder, is_whole, full)
    assert not folder.exists()
    folder.mkdir()
    (folder / "old").touch()
    (tmp_path / ".place.partial").mkdir()  # left by a process that was killed
    with pytest.raises(BuildError, match="no space left"):
        files.make_in_place(folder, is_whole, full)
    assert [p.name for p in folder.iterdir()] == ["old"]
    files.make_in_place(folder, is_whole, good)
    assert [p.name for p in folder.iterdir()] == ["new"]
    files.make_in_place(folder, is_whole, full)  # it is complete: nothing is done
    assert {p.name for p in tmp_path.iterdir()} <= {"place", ".place.lock"}


# Locks


ELSEWHERE = r"choose another --out or \$SYNTHNET_HOME on a local disk, or a URL$"


@pytest.mark.parametrize("wait", [False, True])
@pytest.mark.parametrize(
    ("number", "line"),
    [
        *((number, rf"has no locks \(.*\): {ELSEWHERE}") for number in files.NO_LOCKS),
        (errno.EIO, r"cannot write .*\.lock \(Input/output error\)$"),
    ],
)
def test_lock_that_the_system_refuses(number, line, wait, tmp_path, monkeypatch):
    monkeypatch.setattr("fcntl.flock", failing(number))
    with pytest.raises(BuildError, match=line), files.locked(tmp_path / ".lock", wait=wait):
        pass


def test_lock_of_another_user(tmp_path, monkeypatch):
    path = tmp_path / ".lock"
    path.touch()
    monkeypatch.setattr(files.filelock.FileLock, "acquire", failing(errno.EACCES))
    for name in (path.owner(), "another user"):
        if name == "another user":
            path.unlink()
        place = f"cannot lock {tmp_path}: {path} is {name}'s"
        remedy = rf"{place}, choose another --out or \$SYNTHNET_HOME"
        with pytest.raises(BuildError, match=remedy), files.locked(path, wait=True):
            pass


def test_lock_says_who_holds_it(tmp_path):
    path = tmp_path / ".lock"

    def message():
        with pytest.raises(BuildError) as caught, files.locked(path, wait=False):
            pass
        return str(caught.value)

    with files.locked(path, wait=False):
        assert path.read_text() == f"{socket.gethostname()} {os.getpid()}\n"
        own = f"is writing to {tmp_path} (process {os.getpid()}): wait for it (--wait)"
        assert own in message()
        path.write_text("elsewhere\n")  # written by nobody, or by half
        assert f"is writing to {tmp_path}: wait for it (--wait)" in message()
        # A server of files may keep the lock of a machine that died.
        path.write_text("elsewhere 4242\n")
        gone = f"(process 4242 on elsewhere; if that is gone, remove {path})"
        assert f"is writing to {tmp_path} {gone}: wait" in message()
        path.unlink()  # as the message says
        with files.locked(path, wait=False):
            pass
    assert subprocess.run(["flock", "-n", str(path), "true"], check=False).returncode == 0


def test_lock_holds_on_a_full_disk(tmp_path, monkeypatch):
    path = tmp_path / ".lock"
    monkeypatch.setattr(Path, "write_text", failing(errno.ENOSPC))
    other = r"is writing to \S+: wait for it"
    with (
        files.locked(path, wait=False),
        pytest.raises(BuildError, match=other),
        files.locked(path, wait=False),
    ):
        pass


def test_partial_files_are_removed_and_nothing_else(tmp_path):
    for name in (".a.parquet.123.partial", "a.parquet", "b.partial", ".lock"):
        (tmp_path / name).touch()
    files.remove_partial_files(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"a.parquet", "b.partial", ".lock"}


# No pickle

UNSAFE = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve"}
PACKAGE = Path(synthnet.__file__).parent


def unsafe_lines(source):
    """Lines that import a pickle, load by torch, or let NumPy load or save one."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        bad = any(name.split(".")[0] in UNSAFE for name in names)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            keywords = {k.arg: ast.unparse(k.value) for k in node.keywords}
            owner, name = ast.unparse(node.func.value), node.func.attr
            bad |= owner in {"np", "numpy"} and (
                name in {"load", "save"} and keywords.get("allow_pickle") != "False"
            )
            bad |= owner in {"torch", "fs", "pd", "pandas"} and name in {
                "load", "save", "torch_load", "torch_save", "read_pickle"
            }  # fmt: skip
            bad |= owner == "self" and name in {"load", "save", "collate"}  # of InMemoryDataset
        if bad:
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from joblib import load",
        "np.load('a.npy')",
        "np.load('a.npy', allow_pickle=True)",
        "np.save('a.npy', x)",
        "torch.load('a.pt')",
        "self.load('a.pt')",
    ],
)
def test_the_search_for_pickles_finds(source):
    assert unsafe_lines(f"x = 1\n{source}\n") == [2]


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.stem)
def test_nothing_is_loaded_by_pickle(path):
    assert unsafe_lines(path.read_text()) == []
