"""Tests of `synthnet verify` and of the pins: everything that was tampered with is found."""

import dataclasses
import json
import re
import shutil
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet as pq
import pytest

from synthnet import recipe, spectrum, store
from synthnet.commands import cli
from synthnet.errors import MissingPackageError, RecipeError, StoreError
from synthnet.recipe.plan import plan_shards
from synthnet.store import pins, unpacked
from synthnet.types import Mesh, Rejection
from synthnet.verify import checks, files, shapes
from synthnet.verify.checks import verify, verify_files

VERSION = "1.0-mini"
FAMILY = "split_cone"  # small meshes
SHARD = f"shards/{FAMILY}-0000.parquet"
EXAMINED = {
    "manifest": 1,
    "digests": 11,
    "shards": 11,
    "recipe": 335,
    "meshes": 335,
    "certificates": 335,
    "pins": 335,
    "labels": 12,
    "limits": 335,
    "unpacked": 0,
}


@pytest.fixture(scope="session")
def fixture_pins(mini_home):
    """The pins of the fixture itself."""
    samples = store.open_dataset(VERSION, mini_home).samples()
    return {sample.spec.id: pins.pin(sample) for sample in samples}


def remembered(function, key):
    """Return the function, called once for each key of its arguments."""
    known = {}

    def once(*arguments):
        name = key(*arguments)
        if name not in known:
            known[name] = function(*arguments)
        return known[name]

    return once


@pytest.fixture(scope="module", autouse=True)
def meshes_are_made_and_counted_once():
    """Of 1.0-mini the meshes take two seconds and counts five, and most tests here want them."""
    made = remembered(
        shapes.generated_anew, lambda spec: json.dumps([spec.family, dict(spec.parameters)])
    )
    counted = remembered(
        spectrum.count_below,
        lambda mesh, *shifts: (mesh.vertices.tobytes(), mesh.faces.tobytes(), shifts),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shapes, "generated_anew", made)
        patch.setattr(shapes.spectrum, "count_below", counted)
        yield


@pytest.fixture
def pinned(fixture_pins, monkeypatch):
    """Let the repository pin the fixture, so that nothing but the tampering differs."""
    monkeypatch.setattr(pins, "read", lambda version: fixture_pins)


def problems(report):
    """The checks that found something."""
    return {check.name: check.problems for check in report.checks if check.problems}


def tamper(home, change):
    """Rewrite a shard and its digest in the manifest, as someone who covers his tracks."""
    directory = home / VERSION
    manifest = store.open_dataset(VERSION, home).manifest
    samples = change(list(store.read_samples(directory / SHARD)))
    digest = manifest.recipe_digest
    record = store.write_shard(directory / SHARD, samples, [], family=FAMILY, recipe_digest=digest)
    alter_manifest(home, dataclasses.asdict(record))
    shutil.rmtree(directory / "limits", ignore_errors=True)  # they would tell: of another shard


def alter_manifest(home, of_shard=None, **changes):
    """Rewrite the manifest, with its digest, and what it says of the shard."""
    manifest = store.open_dataset(VERSION, home).manifest
    shards = tuple(
        dataclasses.replace(s, **of_shard or {}) if s.file == SHARD else s for s in manifest.shards
    )
    manifest = dataclasses.replace(manifest, shards=shards, **changes)
    store.write_manifest(home / VERSION, manifest)


def tamper_first(home, change):
    """Tamper with the first sample of a shard, and return its id."""

    def altered(samples):
        return [dataclasses.replace(samples[0], **change(samples[0])), *samples[1:]]

    tamper(home, altered)
    return next(store.read_samples(home / VERSION / SHARD)).spec.id


@pytest.fixture
def failed(mini_copy, pinned, run):
    """Return a function that verifies the copy, which must fail: what the checks have found."""

    def verified():
        where = ["--version", VERSION, "--out", mini_copy]
        code, out, _ = run("verify", *where, "--sample", 0, "--json")
        printed = json.loads(out)
        assert (code, printed["ok"]) == (1, False)
        return {c["check"]: c["problems"] for c in printed["checks"] if c["problems"]}

    return verified


# The fixture as it is


def test_fresh_build_passes_every_check(mini_home):
    counted = []
    report = verify(
        VERSION, root=mini_home, sample=12, on_shard=lambda done, of: counted.append((done, of))
    )
    assert problems(report) == {}
    assert [(c.name, c.examined) for c in report.checks] == [*EXAMINED.items()]
    assert counted == [(n, 11) for n in range(1, 12)]
    assert report.directory == mini_home / VERSION


def test_every_check_is_explained_on_the_command_line(mini_home, capsys):
    assert list(checks.CHECKS) == [*EXAMINED]
    cli.main(["verify", "--version", VERSION, "--out", str(mini_home), "--sample", "0"])
    printed = capsys.readouterr().out
    assert all(what in printed for what in checks.CHECKS.values())


@pytest.mark.slow
def test_sample_is_drawn_by_its_seed(mini_home, monkeypatch):
    seen = []

    def count(mesh, k):
        seen.append(len(mesh.vertices))
        return np.ones(k)

    monkeypatch.setattr(shapes, "lapy_eigenvalues", count)
    draws = []
    for seed in (0, 0, 1):
        seen.clear()
        verify(VERSION, root=mini_home, sample=20, seed=seed)
        draws.append(list(seen))
    assert draws[0] == draws[1] != draws[2]
    assert [len(draw) for draw in draws] == [20, 20, 20]
    seen.clear()
    report = verify(VERSION, root=mini_home, sample=1000)
    assert len(seen) == 335  # every shape once, when more are asked for
    messages = problems(report)["labels"]
    assert sum("off LaPy's" in problem for problem in messages) == 335
    assert sum("LaPy has" in problem for problem in messages) > 300  # ones are below most shifts


def test_version_that_is_not_built_says_so(tmp_path):
    with pytest.raises(StoreError, match="no finished dataset in"):
        verify(VERSION, root=tmp_path)
    with pytest.raises(RecipeError, match="unknown version '3'"):
        verify("3", root=tmp_path)


def test_manifest_of_another_version_than_its_recipe_is_found(mini_home):
    manifest = store.open_dataset(VERSION, mini_home).manifest
    assert [*files.check_manifest(manifest, recipe.load(VERSION))] == []
    other = dataclasses.replace(manifest, version="1.0-mini-sealed-0123456789ab")
    (problem,) = files.check_manifest(other, recipe.load(VERSION))
    assert problem == f"manifest: of {other.version}, its recipe of {VERSION}"


def test_a_missing_lapy_is_said_before_anything_is_read(mini_home, monkeypatch):
    monkeypatch.setitem(sys.modules, "lapy", None)
    monkeypatch.setattr(checks, "_verify_drawn", None)
    with pytest.raises(MissingPackageError, match=r"^checking labels needs LaPy"):
        verify(VERSION, root=mini_home)


def test_version_without_pins_is_not_verified(failed, monkeypatch):
    monkeypatch.setattr(pins, "read", lambda version: None)
    remedy = "run `python -m evidence pin version 1.0`"
    assert failed() == {"pins": [f"the repository pins nothing for 1.0: {remedy}"]}


def test_a_build_is_advised_only_where_it_makes_something_anew(mini_copy, monkeypatch, run):
    def advice():
        code, out, _ = run("verify", VERSION, "--out", mini_copy, "--sample", 0)
        assert code == 1
        return out.partition("DIFFERENT\n")[2]

    monkeypatch.setattr(pins, "read", lambda version: None)
    assert advice() == ""
    (mini_copy / VERSION / SHARD).unlink()
    assert advice().startswith(
        f"run `synthnet build {VERSION} --out {mini_copy}`: it makes damaged"
    )


# Tampering that leaves traces in the files


@pytest.fixture
def shard(mini_copy):
    return mini_copy / VERSION / SHARD


def test_altered_byte_is_found(shard, failed):
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    failures = failed()
    assert failures["digests"][0].startswith(f"{SHARD}: SHA-256 is ")
    assert f"{shard} is damaged" in failures["shards"][0]
    assert len(failures["recipe"]) == 20  # the shapes of that shard are lost
    assert "manifest" not in failures


def test_altered_footer_is_found(shard, failed):
    content = shard.read_bytes()
    assert b"parquet-cpp-arrow" in content
    shard.write_bytes(content.replace(b"parquet-cpp-arrow", b"parquet-cpp-ARROW"))
    assert list(failed()) == ["digests"]


def test_truncated_shard_is_found(shard, failed):
    shard.write_bytes(shard.read_bytes()[:-1])
    assert list(failed()) == ["digests", "shards", "recipe", "pins"]


def test_removed_shard_is_found(shard, failed):
    shard.unlink()
    failures = failed()
    assert failures["digests"] == [f"{SHARD}: missing"]
    assert "is missing: run `synthnet build` again" in failures["shards"][0]
    assert f"{FAMILY}-00000: neither stored nor rejected" in failures["recipe"]


def test_files_alone_are_verified_on_request(mini_copy, shard, run):
    arguments = ["verify", "--files", "--version", VERSION, "--out", mini_copy]
    assert run(*arguments)[0] == 0
    shard.write_bytes(b"no Parquet")
    code, out, _ = run(*arguments, "--json")
    assert code == 1
    problems = {c["check"]: c["problems"] for c in json.loads(out)["checks"]}
    assert list(problems) == ["manifest", "digests", "shards", "limits", "unpacked"]
    assert SHARD in problems["digests"][0]
    assert SHARD in problems["shards"][0]


# Tampering that covers its tracks: shard and manifest agree


@pytest.mark.usefixtures("pinned")
def test_tampering_with_nothing_changes_nothing(mini_home, mini_copy):
    tamper(mini_copy, lambda samples: samples)
    for name in (SHARD, "manifest.json"):
        mine, original = (home / VERSION / name for home in (mini_copy, mini_home))
        assert mine.read_bytes() == original.read_bytes()


def only(array, place):
    """Ones at a place of an array, and zeros elsewhere."""
    return np.arange(len(array)).reshape(-1, *[1] * (array.ndim - 1)) == place


def eigenvalues(change):
    return lambda s: {"eigenvalues": change(s.eigenvalues)}


def vertices(change):
    return lambda s: {"mesh": Mesh(change(s.mesh.vertices), s.mesh.faces)}


def faces(change):
    return lambda s: {"mesh": Mesh(s.mesh.vertices, change(s.mesh.faces))}


def certificate(change):
    return lambda s: {"certificate": dataclasses.replace(s.certificate, **change(s))}


def missing(lost):
    """Leave an eigenvalue out of a label, under a true certificate of eleven."""

    def change(s):
        beyond = spectrum.compute(s.mesh, 12)
        proof = dataclasses.replace(beyond.certificate, residual=s.certificate.residual)
        label = np.delete(beyond.eigenvalues, lost)[:10]
        return {"eigenvalues": label, "certificate": proof}

    return change


OFF = "eigenvalues differ by {} relative, more than 1e-06"
MOVED = "a vertex is {} of the size off, more than 1e-06"
FACTS = "id, parameters, splits or faces differ from the pinned ones"
UNCOVERED = r"\d+ eigenvalues counted below \S+ do not cover the label's 10 up to \S+"
COUNTED = r"\d+ eigenvalues are below \S+, the certificate has \d+"
SURPLUS = r"1[01] eigenvalues are below \S+, the label has \d+"

# How a sample is changed, and by each check that tells what it says, one pattern a problem.
TAMPERED = {
    "an eigenvalue": (
        eigenvalues(lambda e: e * (1 + 1e-5 * only(e, 3))),
        {"pins": [OFF.format("1e-05")]},
    ),
    **{
        f"an eigenvalue of {value}": (
            eigenvalues(lambda e, value=value: np.where(only(e, 0), value, e)),
            {"pins": [OFF.format(off)]},
        )
        for value, off in {np.nan: "nan", np.inf: "inf", -1.0: "1.3", 0.0: "1"}.items()
    },
    "an eigenvalue less": (
        eigenvalues(lambda e: e[:-1]),
        {"pins": ["9 eigenvalues instead of 10"]},
    ),
    "a vertex": (
        vertices(lambda v: v + np.float32(0.01) * only(v, 5)),
        {
            "meshes": [MOVED.format("0.01")],
            "pins": [r"vertices differ by \S+ of their size, more than 1e-06"],
        },
    ),
    "a vertex, too little for the moments": (
        vertices(lambda v: v + np.float32(4e-6) * np.abs(v).max() * (only(v, 5) & only(v.T, 2).T)),
        {"meshes": [MOVED.format("4e-06")]},
    ),
    "two vertices swapped": (
        vertices(lambda v: v[[*range(5), 9, *range(6, 9), 5, *range(10, len(v))]]),
        {
            "meshes": [MOVED.format(r"\S+")],
            "certificates": [COUNTED, SURPLUS],
            "pins": [r"vertices differ by \S+ of their size, more than 1e-06"],
        },
    ),
    "a face turned": (
        faces(lambda f: np.where(only(f, 7), f[:, ::-1], f)),
        {"meshes": ["faces differ from those generated anew"], "pins": [FACTS]},
    ),
    "a count too small": (
        certificate(lambda s: {"count": s.certificate.count - 1}),
        {"certificates": [UNCOVERED, COUNTED]},
    ),
    "a count too large": (
        certificate(lambda s: {"count": s.certificate.count + 1}),
        {"certificates": [COUNTED]},
    ),
    "a shift that does not reach the label": (
        certificate(lambda s: {"shift": float(s.eigenvalues[-1]) * (1 - 1e-6)}),
        {"certificates": [UNCOVERED, COUNTED]},
    ),
    **{
        f"a residual of {residual}": (
            certificate(lambda s, residual=residual: {"residual": residual}),
            {"certificates": [f"residual is {residual:.3g}, not between 0 and 1e-06"]},
        )
        for residual in (2e-6, np.nan, -1e-9)
    },
    **{
        f"eigenvalue {lost} left out under a true certificate": (
            missing(lost),
            {"certificates": [SURPLUS], "pins": [OFF.format(r"\S+")]},
        )
        for lost in (1, 4)
    },
    "the split": (
        lambda s: {"split": "test" if s.split == "train" else "train"},
        {"recipe": ["splits differ from the recipe's"], "pins": [FACTS]},
    ),
    "a split of the paper": (
        lambda s: {"paper_splits": (*s.paper_splits[1:], "nowhere")},
        {"recipe": ["splits differ from the recipe's"], "pins": [FACTS]},
    ),
    "a parameter": (
        lambda s: {
            "spec": dataclasses.replace(s.spec, parameters={**s.spec.parameters, "height": 1.25})
        },
        {
            "recipe": ["parameters differ from the recipe's draw"],
            "meshes": [MOVED.format(r"\S+")],
            "pins": [FACTS],
        },
    ),
    "the isometries": (
        lambda s: {"isometries": s.isometries * 1.001},
        {"recipe": ["isometries differ from the recipe's draw"]},
    ),
}


@pytest.mark.parametrize("what", TAMPERED)
def test_tampering_with_a_sample_is_found(what, mini_copy, failed):
    change, told = TAMPERED[what]
    id = tamper_first(mini_copy, change)
    problems = failed()
    assert list(problems) == list(told)
    for check, patterns in told.items():
        for problem, pattern in zip(problems[check], patterns, strict=True):
            assert re.fullmatch(f"{id}: {pattern}", problem)


@pytest.mark.usefixtures("pinned")
def test_altered_eigenvalue_is_found_by_the_labels(mini_copy, monkeypatch):
    too_little_for_the_pins = eigenvalues(lambda e: e * (1 + 1e-7 * only(e, 3)))
    id = tamper_first(mini_copy, too_little_for_the_pins)
    monkeypatch.setattr(checks, "_choose", lambda *_: {id})
    report = verify(VERSION, root=mini_copy)
    assert problems(report) == {"labels": (f"{id}: label is 1e-07 off LaPy's, more than 1e-08",)}
    assert {c.name: c.examined for c in report.checks}["labels"] == 1


def stored_ids(shard):
    return [sample.spec.id for sample in store.read_samples(shard)]


def test_foreign_shape_is_found(mini_copy, shard, failed):
    taken = {s.spec.id for plan in plan_shards(recipe.load(VERSION)) for s in plan.shapes}
    foreign = next(id for i in range(999) if (id := f"{FAMILY}-{i:05d}") not in taken)
    first = stored_ids(shard)[0]
    tamper_first(mini_copy, lambda s: {"spec": dataclasses.replace(s.spec, id=foreign)})
    assert failed() == {
        "recipe": [f"{foreign}: not drawn by the recipe", f"{first}: neither stored nor rejected"],
        "pins": [
            f"{foreign}: stored here, but the pinned build rejected it",
            f"{first}: missing here, but the pinned build kept it",
        ],
    }


def test_dropped_row_is_found(mini_copy, shard, failed):
    dropped = stored_ids(shard)[0]
    tamper(mini_copy, lambda samples: samples[1:])
    failures = failed()
    assert failures["manifest"] == [
        f"manifest: {FAMILY} has 19 shapes kept or rejected and 20 drawn, the recipe draws 20"
    ]
    assert failures["recipe"] == [f"{dropped}: neither stored nor rejected"]


def test_repeated_row_is_found(mini_copy, shard, failed):
    lost = stored_ids(shard)[-1]
    tamper(mini_copy, lambda samples: [samples[0], *samples[:-1]])
    assert failed()["recipe"] == [f"{lost}: neither stored nor rejected"]


def test_row_dropped_as_if_it_had_been_rejected_is_found(mini_copy, shard, failed):
    dropped = stored_ids(shard)[0]
    tamper(mini_copy, lambda samples: samples[1:])
    made_up = Rejection(dropped, FAMILY, "residual", "made up")
    alter_manifest(mini_copy, {"rejections": (made_up,)})
    assert failed()["pins"] == [f"{dropped}: rejected here, but the pinned build kept it"]


# Tampering with the manifest


@pytest.mark.parametrize("what", ["rows", "vertices", "faces"])
def test_altered_count_of_a_shard_is_found(what, mini_copy, failed):
    manifest = store.open_dataset(VERSION, mini_copy).manifest
    (true,) = (getattr(s, what) for s in manifest.shards if s.file == SHARD)
    alter_manifest(mini_copy, {what: true + 1})
    failures = failed()
    (problem,) = failures["shards"]
    assert problem == f"{SHARD}: {true} {what}, the manifest has {true + 1}"
    assert ("manifest" in failures) == (what == "rows")


def test_altered_count_of_a_family_is_found(mini_copy, failed):
    drawn = store.open_dataset(VERSION, mini_copy).manifest.drawn
    alter_manifest(mini_copy, drawn={**drawn, FAMILY: 21})
    assert failed() == {
        "manifest": [
            f"manifest: {FAMILY} has 20 shapes kept or rejected and 21 drawn, the recipe draws 20"
        ]
    }


def test_altered_recipe_digest_is_found(mini_copy, failed):
    alter_manifest(mini_copy, recipe_digest="0" * 64)
    assert failed() == {"manifest": ["manifest: made from another recipe than this release's"]}


@pytest.mark.usefixtures("pinned")
def test_command_lists_what_differs_up_to_a_limit(mini_copy, capsys):
    tamper(mini_copy, lambda samples: samples[8:])
    arguments = ["verify", "--version", VERSION, "--out", str(mini_copy), "--sample", "0"]
    assert cli.main([*arguments, "--limit", "3"]) == 1
    out = capsys.readouterr().out
    assert len([line for line in out.splitlines() if line.startswith("  ")]) == 4
    assert "more (--limit shows more)" in out
    assert f"\n{VERSION} in {mini_copy / VERSION}: DIFFERENT\n" in out
    assert cli.main([*arguments, "--limit", "100"]) == 1
    assert capsys.readouterr().out.count("neither stored nor rejected") == 8


# Pins


def test_pins_come_back(fixture_pins, tmp_path):
    path = tmp_path / "9.9.lock.parquet"
    pins.write(path, fixture_pins.values())
    before = path.read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pins.resources, "files", lambda package: tmp_path)
        stored = pins.read("9.9")
    assert list(stored) == list(fixture_pins)
    for id, pin in fixture_pins.items():
        assert (stored[id].id, stored[id].digest) == (pin.id, pin.digest)
        assert stored[id].moments.tobytes() == pin.moments.tobytes()
        assert stored[id].eigenvalues.tobytes() == pin.eigenvalues.tobytes()
        assert list(pins.differences(stored[id], pin)) == []
    pins.write(path, stored.values())
    assert path.read_bytes() == before


def test_pins_are_read_by_path(monkeypatch):
    # Reading an open Python file aborted one process in ten as it ended, see shipped_table.
    read_table = Mock(side_effect=pq.read_table)
    monkeypatch.setattr(pins.pq, "read_table", read_table)
    assert pins._pins(pins.labels_file("1.0"))  # read() may have read them before
    assert pins.read_limits("1.0")
    assert [type(call.args[0]) for call in read_table.call_args_list] == [type(Path())] * 2


def test_version_without_a_lock_has_no_pins():
    assert pins.read("no such version") is None


def test_repository_pins_what_is_built(fixture_pins):
    pinned = pins.read("1.0")
    drawn = [s.spec.id for plan in plan_shards(recipe.load("1.0")) for s in plan.shapes]
    assert set(pinned) <= set(drawn)
    assert len(pinned) > 16_000
    for id, pin in fixture_pins.items():
        assert list(pins.differences(pin, pinned[id])) == []


@pytest.fixture
def pin(tiny_samples):
    return pins.pin(tiny_samples["torus"][0])


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("which", [0, 9])
def test_eigenvalues_are_compared_within_the_tolerance(pin, which, sign):
    for factor, expected in ((0.9, []), (1.1, ["eigenvalues differ by 1.1e-06 relative"])):
        change = 1 + sign * factor * pins.TOLERANCE * (np.arange(10) == which)
        changed = dataclasses.replace(pin, eigenvalues=pin.eigenvalues * change)
        assert [d.split(",")[0] for d in pins.differences(changed, pin)] == expected


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("which", range(6))
def test_moments_are_compared_within_the_tolerance(pin, which, sign):
    size = np.sqrt(pin.moments[3:].sum())  # root mean square distance from the origin
    unit = size if which < 3 else size**2
    for factor, expected in ((0.9, []), (1.1, ["vertices differ by 1.1e-06 of their size"])):
        change = sign * factor * pins.TOLERANCE * unit * (np.arange(6) == which)
        changed = dataclasses.replace(pin, moments=pin.moments + change)
        assert [d.split(",")[0] for d in pins.differences(changed, pin)] == expected


def test_moments_by_hand(tiny_samples):
    vertices = np.array([[2, 0, 0], [0, 4, 0], [0, 0, -1]], np.float32)
    mesh = Mesh(vertices, np.array([[0, 1, 2]], np.int32))
    sample = dataclasses.replace(tiny_samples["torus"][0], mesh=mesh)
    w = [1, 1.6180339887498949, 1.2360679774997898]  # 1, 1 + 0.618..., 1 + 1.236... - 1
    total = sum(w)
    expected = np.array([2 * w[0], 4 * w[1], -w[2], 4 * w[0], 16 * w[1], w[2]]) / total
    np.testing.assert_allclose(pins.moments(sample), expected, rtol=1e-14)


def test_digest_is_of_all_that_is_exact(tiny_samples):
    sample = tiny_samples["torus"][0]
    spec, mesh = sample.spec, sample.mesh
    same = [
        dataclasses.replace(sample, eigenvalues=sample.eigenvalues + 1, trivial=1.0),
        dataclasses.replace(sample, mesh=Mesh(mesh.vertices + 1, mesh.faces.astype(np.int64))),
    ]
    parameters = {**spec.parameters, "tube_radius": 0.5}
    other = [
        dataclasses.replace(sample, spec=dataclasses.replace(spec, id="torus-00009")),
        dataclasses.replace(sample, spec=dataclasses.replace(spec, parameters=parameters)),
        dataclasses.replace(sample, spec=dataclasses.replace(spec, group="x")),
        dataclasses.replace(sample, split="nowhere"),
        dataclasses.replace(sample, paper_splits=()),
        dataclasses.replace(sample, mesh=Mesh(mesh.vertices, mesh.faces[::-1])),
        dataclasses.replace(sample, mesh=Mesh(np.vstack([mesh.vertices] * 2), mesh.faces)),
    ]
    assert {pins.digest(s) for s in same} == {pins.digest(sample)}
    digests = [pins.digest(s) for s in other]
    assert len({pins.digest(sample), *digests}) == 1 + len(other)


def test_what_was_unpacked_is_verified_to_the_last_byte(mini_copy):
    dataset = store.open_dataset(VERSION, mini_copy)
    where = unpacked.folder(dataset) / "any"
    where.mkdir(parents=True)
    for name in ("index.json", "large.bin"):
        (where / name).write_bytes(name.encode())
    unpacked.write_contents(where, dataset, by_item=(".bin",))

    def checked():
        (check,) = (c for c in verify_files(VERSION, root=mini_copy).checks if c.name == "unpacked")
        return check.examined, check.problems

    assert checked() == (1, ())
    (where / "large.bin").write_bytes(b"large.bit")
    problem = f"{where / 'large.bin'} is damaged (its SHA-256 is another)"
    assert checked() == (1, (f"{problem}: it is unpacked anew when it is opened",))
    (where / unpacked.CONTENTS).write_text("{}")
    examined, (problem,) = checked()
    assert examined == 1
    assert problem.startswith(f"{where / unpacked.CONTENTS} is damaged (")
