"""Tests of sealed sets: one salt, one set; nothing of it is told; all that is changed is seen."""

import dataclasses
import hashlib
import json
import shutil
import stat

import pytest

from synthnet import recipe, store
from synthnet.build.jobs import Watcher
from synthnet.build.versions import build, ensure_built
from synthnet.errors import BuildError, DamagedError, RecipeError, SealError, StoreError
from synthnet.recipe import plan
from synthnet.recipe.drawing import draw_shape, draw_shapes
from synthnet.recipe.plan import plan_shards
from synthnet.store import files, pins
from synthnet.verify import seal
from synthnet.verify.unseal import verify_sealed
from tests.conftest import only_line
from tests.datasets import contents

SALT = bytes(range(32))
OTHER = bytes(range(1, 33))
WHOLE = (pytest.param(version, marks=pytest.mark.slow) for version in ("1.0", "2.0"))
each_version = pytest.mark.parametrize("version", [*WHOLE, "1.0-mini", "2.0-mini"])
DISCRETE = {"sphere", "split_sphere"}  # whose parameters are whole numbers


@pytest.fixture
def home_copy(sealed_set, tmp_path):
    """Directory with a copy of the sealed set that a test may damage."""
    shutil.copytree(sealed_set.home, tmp_path / "home")
    return tmp_path / "home"


def shapes(version, salt=SALT, **terms):
    sealed_version = seal.sealed_recipe(version, salt, **terms)
    return [shape.spec for shard in plan_shards(sealed_version) for shape in shard.shapes]


def written(path, content):
    """A seal file that is whole, whatever it says."""
    content = {key: value for key, value in content.items() if key != "sha256"}
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    path.write_text(json.dumps({**content, "sha256": digest}, indent=1) + "\n")
    return path


# The salt


@pytest.mark.attack
def test_new_salt_is_secret_random_and_never_overwritten(tmp_path):
    first, second = tmp_path / "one", tmp_path / "two"
    for path in (first, second):
        seal.make_salt(path)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert len(seal.read_salt(path)) == 32
    assert first.read_bytes() != second.read_bytes()
    before = first.read_bytes()
    with pytest.raises(SealError, match="is there already, and no salt is overwritten"):
        seal.make_salt(first)
    assert first.read_bytes() == before


def test_salt_that_can_neither_be_written_nor_read(tmp_path):
    with pytest.raises(BuildError, match=r"there is no directory .*nowhere, make it first"):
        seal.make_salt(tmp_path / "nowhere" / "salt")
    with pytest.raises(SealError, match=r"cannot read the salt .*Is a directory"):
        seal.read_salt(tmp_path)


def test_salt_is_read_whatever_its_end(tmp_path):
    path = tmp_path / "salt"
    for end in ("", "\n", "\r\n"):
        path.write_bytes(seal.salt_text(SALT).strip().encode() + end.encode())
        assert seal.read_salt(path) == SALT


MARK = seal.SALT_MARK.encode()
HEX = SALT.hex().encode()


@pytest.mark.attack
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "there is no salt .*: `synthnet seal --new-salt` makes one"),
        (b"", "is no salt: that is one line"),
        (b"correct horse battery staple", "`synthnet seal --new-salt` alone makes one"),
        (HEX, "is no salt"),  # some digest, or a salt that somebody thought of
        (b"deadbeef" * 8, "is no salt"),
        (MARK + HEX[:-2], "is no salt"),
        (MARK + HEX + b"00", "is no salt"),
        (MARK + HEX.upper(), "is no salt"),
        (MARK + b" " + HEX, "is no salt"),
        (MARK + HEX + b"\n" + MARK + HEX, "is no salt"),
        (b"synthnet-salt-2:" + HEX, "is no salt"),
        (b"\xff\x00" * 40, "is no salt"),
        (b"0" * 10**6, "is no salt"),
    ],
)
def test_salt_that_will_not_do(content, message, tmp_path):
    if content is not None:
        (tmp_path / "salt").write_bytes(content)
    with pytest.raises(SealError, match=message):
        seal.read_salt(tmp_path / "salt")


@pytest.mark.attack
def test_salt_that_others_may_read_draws_no_set(run, tmp_path):
    path = tmp_path / "salt"
    seal.make_salt(path)
    path.chmod(0o640)
    where = ["--salt-file", path, "--out", tmp_path / "home"]
    line = only_line(*run("seal", "--version", "1.0-mini", *where, "--commitment"))
    assert f"others may read the salt {path} (mode 640): make another one" in line
    path.chmod(0o600)
    assert run("seal", "--version", "1.0-mini", *where, "--commitment")[0] == 0


# The recipe that a salt draws


def test_commitment_and_seed_are_the_documented_hashes():
    sealed_version = seal.sealed_recipe("1.0-mini", SALT, beacon="round 7")
    digest = recipe.load("1.0-mini").digest
    ending = f'"digest":"{digest}","of":"1.0-mini","share":0.1}}'

    def hashed(purpose, text):
        head = f"synthnet seal/1 {purpose}\n{hashlib.sha256(text.encode()).hexdigest()}\n"
        return hashlib.sha256(head.encode() + SALT).hexdigest()

    assert sealed_version.sealed.commitment == hashed("commitment", "{" + ending)
    assert sealed_version.seed == int(hashed("seed", '{"beacon":"round 7",' + ending), 16)
    assert sealed_version.version == f"1.0-mini-sealed-{sealed_version.sealed.commitment[:12]}"


def test_spelling_of_a_beacon_gives_no_choice():
    first, second = (
        seal.sealed_recipe("1.0-mini", SALT, beacon=beacon) for beacon in ("Round  7", "round 7 ")
    )
    assert first == second


def test_every_term_changes_commitment_and_seed_and_the_beacon_the_seed_alone():
    made = [
        seal.sealed_recipe("1.0-mini", SALT),
        seal.sealed_recipe("1.0-mini", OTHER),
        seal.sealed_recipe("1.0-mini", SALT + b"\0"),
        seal.sealed_recipe("1.0-mini", SALT, share=0.2),
        seal.sealed_recipe("1.0-small", SALT),
    ]
    assert len({r.sealed.commitment for r in made if r.sealed}) == len(made)
    assert len({r.seed for r in made}) == len({r.digest for r in made}) == len(made)
    lit = seal.sealed_recipe("1.0-mini", SALT, beacon="round 7")
    assert lit.version == made[0].version
    assert lit.seed != made[0].seed
    assert lit.digest != made[0].digest


@each_version
def test_sealed_set_has_its_share_of_every_family_and_all_in_the_test_split(version):
    base, sealed_version = recipe.load(version), seal.sealed_recipe(version, SALT)
    planned = [shape for shard in plan_shards(sealed_version) for shape in shard.shapes]
    for family in base.families:
        members = [s.spec for s in planned if s.spec.family == family]
        surfaces = max(1, round(0.1 * (base.drawn(family) // base.copies)))
        assert len(members) == sealed_version.drawn(family) == base.copies * surfaces
        each = [{s.group for s in members[i :: base.copies]} for i in range(base.copies)]
        assert all(groups == each[0] for groups in each)  # every size of every surface
    assert {shape.split for shape in planned} == {"test"}
    assert {split for shape in planned for split in shape.paper_splits} <= {"test"}
    assert sealed_version.label == base.label
    assert sealed_version.filters == base.filters


@each_version
def test_no_shape_is_the_versions_own_or_that_of_another_salt(version):
    public = draw_shapes(recipe.load(version))
    own, others = shapes(version), shapes(version, OTHER)
    ids = [{s.id for s in specs} for specs in (public, own, others)]
    assert [len(i) for i in ids] == [len(public), len(own), len(others)]
    assert len(set.union(*ids)) == sum(map(len, ids))
    groups = {s.group for s in public}
    assert not groups & {s.group for s in own + others}
    assert not {s.group for s in own if s.family not in DISCRETE} & {s.group for s in others}


def test_what_was_left_out_is_what_the_draw_has_in_common_with_the_version():
    sealed_version = seal.sealed_recipe("1.0", SALT)
    public = {s.group for s in draw_shapes(recipe.load("1.0")) if s.family == "split_sphere"}
    drawn = [draw_shape(sealed_version, "split_sphere", i) for i in range(2000)]
    new = [s for s in drawn if s.group not in public][:250]
    assert len(new) < new[-1].index  # or nothing is tested
    kept = [s for s in shapes("1.0") if s.family == "split_sphere"]
    assert [(s.index, s.group) for s in kept] == [(s.index, s.group) for s in new]


def test_family_without_other_shapes_is_refused(monkeypatch):
    monkeypatch.setattr(plan, "MOST_TRIES", 3)
    with pytest.raises(RecipeError, match=r"only 3 of 4 shapes could be .*: take a smaller share"):
        shapes("1.0-mini")


@pytest.mark.parametrize(
    ("version", "terms", "error", "message"),
    [
        ("3.0", {}, RecipeError, "unknown version '3.0'"),
        ("1.0-x2", {}, RecipeError, "1.0-x2 is scaled: seal what it came from"),
        ("1.0-sealed-0123456789ab", {}, RecipeError, "is a sealed set: it is drawn from its salt"),
        ("1.0", {"share": 0.0}, SealError, "--share must be above 0, at most 1, got 0"),
        ("1.0", {"share": float("nan")}, SealError, "--share must be above 0, at most 1, got nan"),
        ("1.0", {"beacon": "п 7"}, SealError, "--beacon must be 1 to 1000 printable ASCII letters"),
        ("1.0", {"beacon": ""}, SealError, "--beacon must be 1 to 1000 printable ASCII letters"),
        ("1.0", {"beacon": "a\nb"}, SealError, r"on one line, got 'a\\\\nb'"),
        ("1.0", {"beacon": "a" * 1001}, SealError, "--beacon must be 1 to 1000"),
    ],
)
def test_what_cannot_be_sealed(version, terms, error, message):
    with pytest.raises(error, match=message):
        seal.sealed_recipe(version, SALT, **terms)


def test_plan_of_sealed_shapes_is_for_sealed_recipes():
    with pytest.raises(ValueError, match=r"1.0 is not sealed"):
        plan.sealed_shapes(recipe.load("1.0"))


def test_recipe_file_is_never_sealed():
    with pytest.raises(RecipeError, match="a recipe file is not sealed"):
        recipe.parse("schema = 1\nsealed = 1")


# The set and the file


@pytest.mark.slow
def test_two_workers_make_the_same_bytes(sealed_set, tmp_path):
    made, _ = seal.make(sealed_set.recipe, root=tmp_path, workers=2)
    assert made == sealed_set.seal
    assert contents(tmp_path / made.dataset) == contents(sealed_set.home / made.dataset)


class Stopped(Watcher):
    """Presses Ctrl-C when the third shard is on disk."""

    count = 0

    def finished(self, plan, result):
        self.count += 1
        if self.count == 3:
            raise KeyboardInterrupt


@pytest.mark.slow
def test_interrupted_build_goes_on(sealed_set, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        seal.make(sealed_set.recipe, root=tmp_path, workers=1, watcher=Stopped())
    with pytest.raises(StoreError, match=r"the sealed set .* is not in "):
        seal.open_checked(sealed_set.seal, tmp_path)
    made, report = seal.make(sealed_set.recipe, root=tmp_path, workers=1)
    assert report.reused >= 3
    assert made == sealed_set.seal
    assert contents(tmp_path / made.dataset) == contents(sealed_set.home / made.dataset)


def test_directory_is_private(sealed_set):
    directory = sealed_set.home / sealed_set.seal.dataset
    assert stat.S_IMODE(directory.stat().st_mode) == 0o700
    assert stat.S_IMODE((directory / "manifest.json").stat().st_mode) == 0o600
    shards = [path for path in directory.rglob("*.parquet") if path.stat().st_mode & 0o077]
    assert shards == []  # by processes that had the mode from the first byte


def test_seal_tells_no_salt_seed_id_parameter_or_label(sealed_set):
    text = sealed_set.published.read_text().lower()
    dataset = seal.open_checked(sealed_set.seal, sealed_set.home)
    sealed_version = seal.recipe_of(dataset)
    salt = seal.read_salt(sealed_set.salt).hex()
    secrets = [salt, str(sealed_version.seed), f"{sealed_version.seed:x}"]
    for sample in dataset.samples():
        tail = sample.spec.id.rpartition("-")[2]
        secrets += [tail, sample.spec.group, pins.digest(sample)]
        secrets += [repr(v) for v in sample.spec.parameters.values() if isinstance(v, float)]
        secrets += [repr(v)[:8] for v in sample.eigenvalues.tolist()]
    secrets = [secret for secret in secrets if secret != "1.0"]  # the version's name, and a radius
    assert len(secrets) > 100
    assert [secret for secret in secrets if secret.lower() in text] == []


def test_seal_says_what_the_set_is(sealed_set):
    record = sealed_set.seal
    dataset = store.open_dataset(record.dataset, sealed_set.home)
    assert seal.read(sealed_set.published) == record
    assert record.drawn == dict.fromkeys(recipe.load("1.0-mini").families, 1)
    assert sum(record.kept.values()) == dataset.manifest.rows
    assert record.recipe_digest == dataset.manifest.recipe_digest
    assert (record.beacon, record.share) == ("round 7", 0.01)
    assert record.version_digest == recipe.load("1.0-mini").digest


def test_digest_of_the_meshes_cannot_be_tried_without_the_seed(sealed_set):
    dataset = store.open_dataset(sealed_set.seal.dataset, sealed_set.home)
    sealed_version = seal.recipe_of(dataset)
    assert seal.digest(dataset, sealed_version.seed) == sealed_set.seal.meshes
    assert seal.digest(dataset, sealed_version.seed + 1) != sealed_set.seal.meshes


def test_no_byte_of_the_file_can_be_altered(sealed_set, tmp_path):
    path, whole = tmp_path / "seal.json", sealed_set.published.read_bytes()
    assert len(whole) > 1000
    for location in range(len(whole)):
        path.write_bytes(whole[:location] + bytes([whole[location] ^ 1]) + whole[location + 1 :])
        with pytest.raises(SealError):
            seal.read(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 2}, "has schema version 2, this synthnet reads 1"),
        ({"dataset": "1.0-sealed-0123456789ab"}, "contradicts itself"),
        ({"commitment": "0" * 64}, "contradicts itself"),
        ({"commitment": "0"}, "is no seal: commitment is no SHA-256"),
        ({"share": "0.1"}, "is no seal: share is '0.1'"),
        ({"beacon": 7}, "is no seal: beacon is 7"),
        ({"drawn": []}, r"is no seal: drawn is \[\]"),
        ({"seed": 1}, "is no seal: .*unexpected keyword argument 'seed'"),
    ],
)
def test_file_that_is_no_seal(change, message, sealed_set, tmp_path):
    content = {**json.loads(sealed_set.published.read_text()), **change}
    with pytest.raises(SealError, match=message):
        seal.read(written(tmp_path / "seal.json", content))


@pytest.mark.parametrize("text", ["", "[]", "{}", "null", '{"schema_version": 1}'])
def test_file_of_something_else(text, tmp_path):
    (tmp_path / "seal.json").write_text(text)
    with pytest.raises(SealError, match="is no seal: "):
        seal.read(tmp_path / "seal.json")


def test_file_that_cannot_be_read(tmp_path):
    with pytest.raises(SealError, match="there is no seal "):
        seal.read(tmp_path / "seal.json")
    with pytest.raises(SealError, match=r"cannot read the seal .*Is a directory"):
        seal.read(tmp_path)


def test_seal_is_written_once(sealed_set, tmp_path):
    path = tmp_path / "seal.json"
    for _ in range(2):
        seal.write(path, sealed_set.seal)
    assert path.read_bytes() == sealed_set.published.read_bytes()
    other = dataclasses.replace(sealed_set.seal, packages={"synthnet": "0.0"})
    with pytest.raises(SealError, match="is not this seal: nothing is overwritten"):
        seal.write(path, other)
    assert path.read_bytes() == sealed_set.published.read_bytes()


# Where it is built it is a dataset like any other


def test_sealed_set_is_opened_by_its_name_and_is_no_version(sealed_set):
    name = sealed_set.seal.dataset
    dataset = ensure_built(name, sealed_set.home)
    assert dataset.manifest.version == name
    assert name not in recipe.available()
    sealed_version = seal.recipe_of(dataset)
    assert sealed_version.digest == dataset.manifest.recipe_digest


def test_sealed_set_is_read_by_pyg_and_datasets(home_copy, sealed_set):
    name = sealed_set.seal.dataset
    pyg = pytest.importorskip("synthnet.pyg")
    items = pyg.SynthNet(home_copy, name, split="test", augment=False)
    labels = [s.eigenvalues for s in store.open_dataset(name, home_copy).samples()]
    assert [item.y[0, 0].item() for item in items] == pytest.approx([y[0] for y in labels])
    with pytest.raises(StoreError, match="no shape in the split train: a sealed set is all split="):
        pyg.SynthNet(home_copy, name)


def test_commands_on_a_built_version_take_its_name(sealed_set, run):
    where = ["--version", sealed_set.seal.dataset, "--out", sealed_set.home]
    code, out, _ = run("info", *where, "--ids")
    assert (code, len(out.splitlines())) == (0, 10)
    assert run("show", out.splitlines()[4], *where)[0] == 0
    assert run("verify", *where, "--sample", 1)[0] == 0
    assert run("verify", *where, "--files")[0] == 0
    assert sealed_set.seal.dataset in run("versions", "--out", sealed_set.home)[1]


@pytest.mark.parametrize("arguments", [["info"], ["verify"], ["show", "torus-0"], ["build"]])
def test_where_it_is_not_built_one_line_says_so(arguments, sealed_set, run, tmp_path):
    name = sealed_set.seal.dataset
    line = only_line(*run(*arguments, "--version", name, "--out", tmp_path))
    assert f"{name} is " in line
    assert "`synthnet verify --sealed`" in line


def test_python_says_so_too(sealed_set, tmp_path):
    with pytest.raises(StoreError, match=f"the sealed set .* is not in {tmp_path}"):
        ensure_built(sealed_set.seal.dataset, tmp_path)


def test_manifest_without_a_recipe_is_no_sealed_set(home_copy, sealed_set):
    dataset = store.open_dataset(sealed_set.seal.dataset, home_copy)
    bare = dataclasses.replace(dataset.manifest, recipe={})
    with pytest.raises(DamagedError, match="is no sealed set"):
        seal.recipe_of(store.StoredDataset(dataset.directory, bare))


def test_set_at_a_url_is_refused():
    sealed_version = seal.sealed_recipe("1.0-mini", SALT)
    with pytest.raises(StoreError, match="is not on this machine"):
        seal.make(sealed_version, root="memory://somewhere")


def test_one_salt_has_no_second_set(sealed_set, run):
    where = ["--salt-file", sealed_set.salt, "--share", 0.01, "--beacon", "another round"]
    line = only_line(*run("seal", "--version", "1.0-mini", *where, "--out", sealed_set.home))
    assert f"{sealed_set.seal.dataset} of another recipe" in line


# What was changed is noticed


def changed(value):
    """Another value of the same kind."""
    if isinstance(value, dict):
        return {**value, "torus": value.get("torus", 0) + 1}
    if isinstance(value, float):
        return value / 2
    return value[:-1] + ("0" if value[-1] != "0" else "1")


FIELDS = [f.name for f in dataclasses.fields(seal.Seal) if f.name not in ("dataset", "packages")]


@pytest.mark.parametrize("field", FIELDS)
def test_forged_seal_is_noticed_with_the_set_and_with_the_salt(field, sealed_set, tmp_path):
    content = json.loads(sealed_set.published.read_text())
    content[field] = "1.0-small" if field == "version" else changed(content[field])
    content["dataset"] = f"{content['version']}-sealed-{content['commitment'][:12]}"
    forged = seal.read(written(tmp_path / "seal.json", content))
    with pytest.raises((SealError, StoreError)):
        seal.open_checked(forged, sealed_set.home)
    salt = seal.read_salt(sealed_set.salt)
    try:
        report = verify_sealed(forged, salt, root=sealed_set.home, sample=0)
    except SealError as error:
        assert field in ("version", "version_digest")
        assert "the seal is of 1.0" in str(error)  # noqa: PT017 - either way it is noticed
    else:
        assert len(report.problems) == 1
        assert report.problems[0].startswith(("commitment: ", "seal: "))


def relabelled(home, name):
    """Change a label and all digests that tell of it."""
    directory = home / name
    manifest = store.open_dataset(name, home).manifest
    records = []
    for shard in manifest.shards:
        if shard.family == "torus":
            samples = list(store.read_samples(directory / shard.file))
            samples = [dataclasses.replace(s, eigenvalues=s.eigenvalues * 1.01) for s in samples]
            digest = manifest.recipe_digest
            shard = store.write_shard(
                directory / shard.file, samples, [], family="torus", recipe_digest=digest
            )
        records.append(shard)
    store.write_manifest(directory, dataclasses.replace(manifest, shards=tuple(records)))


def test_labels_changed_with_all_their_digests_are_noticed(sealed_set, home_copy):
    relabelled(home_copy, sealed_set.seal.dataset)
    report = verify_sealed(sealed_set.seal, seal.read_salt(sealed_set.salt), root=home_copy)
    assert any("off LaPy's" in problem for problem in report.problems)


def test_damaged_shard_is_noticed(sealed_set, home_copy):
    path = home_copy / sealed_set.seal.dataset / "shards" / "torus-0000.parquet"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(DamagedError, match="is damaged: remove it and seal again"):
        seal.open_checked(sealed_set.seal, home_copy)


@pytest.mark.slow
def test_another_set_under_the_name_is_noticed(sealed_set, home_copy):
    name = sealed_set.seal.dataset
    sealed_version = seal.recipe_of(store.open_dataset(name, home_copy))
    shutil.rmtree(home_copy / name)
    other = dataclasses.replace(sealed_version, seed=sealed_version.seed + 1)
    build(other, root=home_copy, workers=1)
    with pytest.raises(SealError, match="is not the set that was sealed: seal: its recipe digest"):
        seal.open_checked(sealed_set.seal, home_copy)


# The commands


@pytest.mark.slow
def test_whole_season(run, tmp_path):
    salt, published = tmp_path / "salt.txt", tmp_path / "seal.json"
    draw = ["seal", "--version", "1.0-mini", "--salt-file", salt, "--share", 0.01]
    code, out, _ = run(*draw, "--new-salt", "--commitment", "--out", tmp_path / "home")
    commitment = out.strip()
    assert code == 0
    assert not (tmp_path / "home").exists()
    draw += ["--beacon", "round 7 of drand", "--publish", published, "--workers", 1]
    code, out, _ = run(*draw, "--out", tmp_path / "home")
    assert code == 0
    assert f"publish     {published}" in out
    first = published.read_bytes()
    assert seal.read(published).commitment == commitment
    code, out, err = run(*draw, "--out", tmp_path / "home", "--json")
    printed = json.loads(out)
    assert code == 0
    assert printed["commitment"] == commitment
    assert seal.read_salt(salt).hex() not in out + err
    assert published.read_bytes() == first
    where = ["verify", "--sealed", published, "--salt-file", salt, "--workers", 1]
    code, out, _ = run(*where, "--out", tmp_path / "elsewhere")
    assert code == 0
    assert out.rstrip().endswith(": verified")
    code, out, _ = run(*where, "--out", tmp_path / "elsewhere", "--json", "--sample", 2)
    printed = json.loads(out)
    assert (code, printed["ok"], printed["version"]) == (0, True, seal.read(published).dataset)
    examined = {check["check"]: check["examined"] for check in printed["checks"]}
    assert (examined["commitment"], examined["seal"], examined["labels"]) == (1, 10, 2)


def test_wrong_salt_is_a_difference_and_builds_nothing(sealed_set, run, tmp_path):
    (tmp_path / "salt").write_text(seal.salt_text(OTHER))
    where = ["--salt-file", tmp_path / "salt", "--out", tmp_path / "home"]
    code, out, _ = run("verify", "--sealed", sealed_set.published, *where)
    assert code == 1
    (line,) = (line for line in out.splitlines() if line.startswith("  "))
    assert "another salt, or the seal was altered" in line
    assert "DIFFERENT" in out
    assert not (tmp_path / "home").exists()


def test_seal_of_another_version_or_release_is_one_line(sealed_set, run, tmp_path):
    content = json.loads(sealed_set.published.read_text())
    forged = written(tmp_path / "a.json", {**content, "version_digest": "0" * 64})
    salt = ["--salt-file", sealed_set.salt, "--out", tmp_path]
    line = only_line(*run("verify", "--sealed", forged, *salt))
    assert "the seal is of 1.0-mini with the recipe 000000000000…, here it is " in line
    assert "install synthnet 0.1.0" in line
    name = f"9.9-sealed-{content['commitment'][:12]}"
    forged = written(tmp_path / "b.json", {**content, "version": "9.9", "dataset": name})
    assert "unknown version '9.9'" in only_line(*run("verify", "--sealed", forged, *salt))
    (tmp_path / "c.json").write_text(sealed_set.published.read_text()[:-9])
    assert "is no seal" in only_line(*run("verify", "--sealed", tmp_path / "c.json", *salt))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["verify", "--sealed", "seal.json"], "--sealed and --salt-file go together"),
        (["verify", "--salt-file", "salt"], "--sealed and --salt-file go together"),
        (["verify", "--workers", "1"], "--workers is for --sealed"),
        (["verify", "--sealed", "s", "--salt-file", "f", "--files"], "--files is for a built"),
        (["verify", "--sealed", "s", "--version", "1.0"], "not allowed with argument"),
        (["verify", "--sealed", "s", "--salt-file", "f"], "there is no seal s"),
        (["seal", "--version", "1.0-mini"], "arguments are required: --salt-file"),
        (["seal", "--salt-file", "nowhere"], "there is no salt nowhere"),
        (["seal", "--salt-file", "f", "--share", "half"], "invalid float value: 'half'"),
    ],
)
def test_wrong_arguments(arguments, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in only_line(*run(*arguments))


def test_no_salt_is_made_for_what_cannot_be_sealed(run, tmp_path):
    where = ["--salt-file", tmp_path / "salt", "--new-salt", "--out", tmp_path]
    assert "--share must be" in only_line(*run("seal", *where, "--share", "2"))
    assert "unknown version" in only_line(*run("seal", *where, "--version", "3.0"))
    assert "must be at least 1, got 0" in only_line(*run("seal", *where, "--workers", "0"))
    assert list(tmp_path.iterdir()) == []


def test_no_salt_and_no_other_file_is_overwritten(sealed_set, run, tmp_path):
    salt, published = tmp_path / "salt", tmp_path / "seal.json"
    files.write_secret(salt, seal.salt_text(OTHER))
    where = ["seal", "--version", "1.0-mini", "--salt-file", salt, "--out", tmp_path / "home"]
    line = only_line(*run(*where, "--new-salt"))
    assert "is there already, and no salt is overwritten" in line
    for text in ("something else", sealed_set.published.read_text()):
        published.write_text(text)
        line = only_line(*run(*where, "--publish", published))
        assert "is there and is not this seal: nothing is overwritten" in line
        assert published.read_text() == text
    assert salt.read_text() == seal.salt_text(OTHER)
    assert not (tmp_path / "home").exists()


def test_secret_that_cannot_be_written_whole_leaves_nothing(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(BuildError, match="no space left for"):
        files.write_secret(tmp_path / "salt", "text")
    assert list(tmp_path.iterdir()) == []
