"""Declared and verified rows: what a verification covers, who is ranked, what is found."""

import contextlib
import copy
import dataclasses
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from eigbench import results
from eigbench.board import leaderboard, ranking
from eigbench.commands import verify_row
from eigbench.errors import EigbenchError, PredictionsError, ResultError
from eigbench.results import predictions, submission, verification
from eigbench.results.sources import digest
from eigbench.running import box, packages, rerun, unseen
from eigbench.running.evaluate import Evaluation
from eigbench.running.meshes import Instances
from eigbench.running.process import Loaded, Status
from eigbench.scoring import bootstrap, targets, truth
from eigbench.site import rows as site_rows

from synthnet import recipe
from synthnet.types import Mesh
from tests.conftest import only_line
from tests.eigbench.conftest import changed, git

SAID = {
    "date": "2026-11-24",
    "by": "A maintainer",
    "commit": None,
    "machine": "this one",
    "sandbox": "bubblewrap",
    "packages": {"numpy": "2.0.0"},
    "scores": {"surface": None, "mesh": {"mean": 1.0, "low": 0.9, "high": 1.1, "declared": 1.0}},
    "sealed": {"share": 0.1, "shapes": 9, "instances": 9, "mean": 1.0, "low": 0.9, "high": 1.1},
}


BOXED = pytest.mark.skipif(box.available() == box.NONE, reason="no sandbox works here")


def said_of(result):
    """What a verification says of a result, with the scores that this declares."""
    said = copy.deepcopy(SAID)
    for target, scored in result["scores"].items():
        declared = None if scored is None else scored["overall"]["rpd"]["mean"]
        again = {"mean": declared, "low": declared, "high": declared, "declared": declared}
        said["scores"][target] = scored and again
    return said


def as_verified(result, **changes):
    made = {**copy.deepcopy(result), "verified": {**said_of(result), **changes}}
    made["verified"]["digest"] = verification.digest(made)
    return made


@pytest.fixture
def verified(make_submission, mini_truth):
    """The path of a result that says it is verified."""
    path = make_submission("Verified", 1.1 * mini_truth.eigenvalues)
    results.write(path, as_verified(results.read(path)))
    return path


@pytest.mark.attack
def test_a_verification_of_other_scores_is_none(verified):
    result = results.read(verified)
    scores = copy.deepcopy(result["verified"]["scores"])
    scores["mesh"].update(mean=0.01, low=0.009, high=0.011)
    forged = as_verified(result, scores=scores)  # with a digest of its own
    verified.write_text(json.dumps(forged))
    with pytest.raises(ResultError, match=r"says of its verification was altered"):
        submission.read(verified)


@pytest.mark.attack
def test_a_verified_result_is_not_submitted(verified, refused, tmp_path):
    err = refused("submit", verified, "--board", tmp_path / "board")
    assert "says that it is verified, and a submitted row is not" in err


@pytest.mark.attack
@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("verified", "scores", "mesh", "mean"), 0.5),
        (("verified", "by"), "Another"),
        (("verified", "sandbox"), "landlock"),
        (("model", "sources", "weyl.py"), "0" * 64),
        (("predictions", "sha256"), "0" * 64),
        (("dataset", "split_digest"), "0" * 64),
        (("model", "name"), "Another"),
        (("model", "kind"), "classical"),
        (("cost", "ms_per_mesh_mean"), 0.5),
    ],
)
def test_a_verification_covers_what_it_says_and_what_it_is_of(verified, keys, value):
    result = json.loads(verified.read_text())
    level = result
    for key in keys[:-1]:
        level = level[key]
    assert level[keys[-1]] != value
    level[keys[-1]] = value
    verified.write_text(json.dumps(result))
    with pytest.raises(ResultError, match="its verification was altered"):
        results.read(verified)


@pytest.fixture
def keys(tmp_path):
    """Two new keys of SSH, and a checkout that allows the first of them."""
    if shutil.which("ssh-keygen") is None:
        pytest.skip("OpenSSH is not installed")
    made = [tmp_path / name for name in ("mine", "other")]
    for key in made:
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)]
        subprocess.run(command, check=True)
    signers = tmp_path / verification.SIGNERS
    signers.parent.mkdir()
    public = made[0].with_suffix(".pub").read_text()
    signers.write_text(f'"A maintainer" {public}')
    return made


@pytest.mark.attack
@pytest.mark.parametrize("name", ["A maintainer", "Another"])
def test_where_signers_are_named_one_of_them_must_have_signed(verified, keys, tmp_path, name):
    mine, other = keys
    result = as_verified(results.read(verified), by=name)
    verification.check(result, verified)  # without signers nothing is asked
    with pytest.raises(ResultError, match="is not signed: verify it again with --key"):
        verification.check(result, verified, tmp_path)
    for key in (mine, other):
        signature = verification.sign(result["verified"]["digest"], key)
        result["verified"]["signature"] = signature
        if key is mine and name == "A maintainer":
            results.write(verified, result)
            verification.check(results.read(verified), verified, tmp_path)
        else:
            with pytest.raises(ResultError, match="its signature is none of"):
                verification.check(result, verified, tmp_path)


@pytest.mark.attack
def test_code_that_ran_without_a_sandbox_is_not_verified(verified):
    result = as_verified(results.read(verified), sandbox="none")
    verified.write_text(json.dumps(result))
    with pytest.raises(ResultError, match="at verified/sandbox: 'none' is not one of"):
        results.read(verified)


@pytest.mark.attack
def test_a_signature_of_another_digest_is_none(verified, keys, tmp_path):
    result = results.read(verified)
    result["verified"]["signature"] = verification.sign("0" * 64, keys[0])
    with pytest.raises(ResultError, match="its signature is none of"):
        verification.check(result, verified, tmp_path)


def test_a_key_that_cannot_sign_is_one_line(tmp_path):
    with pytest.raises(EigbenchError, match=r"^--key .* cannot sign: "):
        verification.sign("0" * 64, tmp_path / "none")


def test_verified_rows_are_ranked_and_declared_ones_stand_below(make_submission, mini_truth):
    labels = mini_truth.eigenvalues
    paths = {f: make_submission(f"Times {f}", f * labels) for f in (1.0, 1.1, 1.2, 1.3)}
    rows = {factor: submission.read(path) for factor, path in paths.items()}
    before = ranking.ranked(list(rows.values()))
    assert [row.shown_rank for row in before] == ["exact", "1", "2", "3"]
    for factor in (1.1, 1.3):
        results.write(paths[factor], as_verified(results.read(paths[factor])))
        rows[factor] = submission.read(paths[factor])
    after = ranking.ranked(list(rows.values()))
    assert [(row.submission.name, row.shown_rank) for row in after] == [
        ("Times 1.1", "1"),
        ("Times 1.3", "2"),
        ("Times 1.0", "declared"),
        ("Times 1.2", "declared"),
    ]
    pages = leaderboard.generate(list(rows.values()), [])
    page = pages[leaderboard.BOARDS / "1.0-mini-test-grouped-mesh.md"]
    assert re.search(r"^\| declared \| Times 1\.0 \|.*not verified", page, flags=re.M)
    section = page.partition("## Verified")[2].partition("\n## ")[0].splitlines()
    assert [line for line in section if line.startswith("| Times")] == [
        "| Times 1.1 | 0.4762 ± 0.0000 | 1.0000 ± 0.1000 | 9 | 2026-11-24 |",
        "| Times 1.3 | 1.3043 ± 0.0000 | 1.0000 ± 0.1000 | 9 | 2026-11-24 |",
        "| Times 1.0 | not verified | not verified | not verified | not verified |",
        "| Times 1.2 | not verified | not verified | not verified | not verified |",
    ]
    assert "2 of 4 rows are verified." in pages[Path(leaderboard.PAGE)]
    exported = json.loads(pages[leaderboard.BOARDS / "1.0-mini-test-grouped-mesh.json"])["rows"]
    shown = [(row["verified"], row["cost"], row["speed_against_lapy"]) for row in exported]
    assert [words[0] for words in shown] == [True, True, False, False]
    assert all(cost["ms_per_mesh"] > 0 and speed > 0 for _, cost, speed in shown[:2])
    assert shown[2:] == 2 * [(False, None, None)]
    opened = [site_rows.content(row, "a board", None, "{}")["tables"] for row in after]
    costs = [[table["title"] for table in tables].count("Cost") for tables in opened]
    assert costs == [1, 1, 0, 0]


def test_declared_rows_do_not_widen_the_ranks_of_verified_ones(make_row, mini_truth, monkeypatch):
    monkeypatch.setattr(bootstrap, "two_sided", lambda means: 0.03)
    verified, *others = (
        make_row(f"Times {f}", f * mini_truth.eigenvalues) for f in (1.1, 1.2, 1.3, 1.4)
    )
    rows = [changed(row, "verified") for row in (verified, others[0])]
    ranks = [row.shown_rank for row in ranking.ranked([*rows, *others[1:]])]
    assert ranks == ["1", "2", "declared", "declared"]


@pytest.mark.attack
def test_spectra_that_are_labels_to_the_bit_are_counted(mini_truth):
    answers = np.stack([mini_truth.eigenvalues * (1 + 1e-15), mini_truth.eigenvalues * 1.1])
    answers[0, :2] = np.nextafter(mini_truth.eigenvalues[:2], 0)
    answers[1, 7] = mini_truth.eigenvalues[7]
    same = int((answers[0] == mini_truth.eigenvalues).all(axis=1).sum()) + 1
    assert predictions.looked_up("learned", mini_truth, answers).startswith(
        f"{same} of 612 spectra"
    )
    assert predictions.looked_up("classical", mini_truth, answers) == ""
    assert predictions.looked_up("learned", mini_truth, 1.1 * answers) == ""


@pytest.mark.attack
def test_spectra_of_surfaces_to_the_bit_are_computed_by_nobody(mini_truth):
    surfaces = targets.at(mini_truth, "surface")
    answers = surfaces.eigenvalues[None] * (1 + 1e-12)
    answers[0, 5] = surfaces.eigenvalues[5]
    for kind in ("classical", "learned"):
        found = predictions.looked_up(kind, surfaces, answers)
        assert found == (
            "1 of 306 spectra are those of the surfaces to the last bit: no mesh shows these so "
            "exactly"
        )
        assert predictions.looked_up(kind, surfaces, 1.1 * answers) == ""


@pytest.mark.attack
def test_score_and_submit_flag_them(eigbench, make_submission, mini_truth, tmp_path):
    path = make_submission("Looked up", mini_truth.eigenvalues)
    code, _, stderr = eigbench("score", path.with_suffix(".parquet"), "--dataset", "1.0-mini")
    assert code == 0
    assert "306 of 306 spectra are the labels to the last bit" in stderr
    code, _, stderr = eigbench("submit", path, "--board", tmp_path)
    assert (code, "to the last bit" in stderr) == (0, True)


ADDRESSES = ("evil @ file:///tmp/evil.tar.gz", "evil @ https://example.org/evil-1-py3-none-any.whl")
PATHS = ("/tmp/evil", "./evil", "file:///tmp/evil", "-r list.txt", "--index-url=x")
HEADER = """# /// script
# requires-python = ">=3.11"
# dependencies = [{0}]
# ///
"""


def test_the_code_of_a_row_is_found_by_its_digests(weyl, tmp_path):
    row = submission.read(weyl.out)
    for folder, text in (("a", "x = 1\n"), ("b", weyl.code.read_text() + "# a comment\n")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "weyl.py").write_text(text)
    assert rerun.code_in(tmp_path, row) == tmp_path / "b" / "weyl.py"
    with pytest.raises(ResultError, match=r"has no weyl\.py with the code and weights"):
        rerun.code_in(tmp_path / "a", row)


def test_code_that_does_not_parse_or_is_a_package_is_found_too(weyl, tmp_path):
    """What it imports has to be named if it is a file of the predictor's folder, else not."""
    row = submission.read(weyl.out)
    texts = {
        "weyl.py": weyl.code.read_text(),
        "odd.py": "not Python",
        "parts/__init__.py": "import types, weyl\n",  # the library's, not the file beside it
        "parts/types.py": "",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    row = changed(row, "model", sources={name: digest(tmp_path / name) for name in texts})
    assert rerun.code_in(tmp_path, row) == tmp_path / "weyl.py"
    (tmp_path / "types").mkdir()
    (tmp_path / "types" / "__init__.py").write_text("")
    with pytest.raises(ResultError, match=r"has no weyl\.py with the code"):
        rerun.code_in(tmp_path, row)


@pytest.mark.parametrize("name", ["weyl.py", "weyl[v2].py"])
def test_the_code_of_a_row_is_taken_from_the_last_commit_that_still_has_it(weyl, tmp_path, name):
    def commit(text):
        (board / name).write_text(text)
        git(board, "add", name)
        git(board, "commit", "-q", "-m", "Weyl")
        return git(board, "rev-parse", "HEAD")

    def taken(row):
        folder = tmp_path / "commits"
        with contextlib.closing(rerun.Checkouts(board, None, folder)) as checkouts:
            path, commit = checkouts.code(row)
            return path.read_text(), commit

    board = tmp_path / "board"
    board.mkdir()
    git(board, "init", "-q")
    code = weyl.code.read_text()
    made_by = commit(code)
    sources = {name: digest(board / name)}
    row = changed(submission.read(weyl.out), "model", code=name, sources=sources)
    row = changed(row, "checkout", commit=made_by, dirty=False)
    tidy = commit(f"# tidied up\n{code}")
    assert taken(row) == (f"# tidied up\n{code}", tidy)
    commit(f"{code}\nCHANGED = True\n")
    assert taken(row) == (code, made_by)
    # Moved into a file that the result does not name: the digest is the same
    beside = board / "numpy.py"
    beside.write_text("")
    git(board, "add", beside.name)
    moved = commit(code)
    assert taken(row) == (code, made_by)
    named = changed(row, "model", sources={**sources, "numpy.py": digest(beside)})
    git(board, "rm", "-q", beside.name)
    commit(f"{code}\nCHANGED = True\n")
    assert taken(named) == (code, moved)  # of all its files, not of the first alone
    assert len(git(board, "worktree", "list").splitlines()) == 1
    unnamed = changed(row, "checkout", commit=None, dirty=True)
    assert taken(unnamed) == (f"# tidied up\n{code}", tidy)  # the history of its files has it
    assert list((tmp_path / "commits").glob("*")) == []
    message = rf"has the code and weights that .* names: {re.escape(name)}: fetch"
    with pytest.raises(ResultError, match=message):
        taken(changed(row, "model", sources={name: "0" * 64}))


def test_a_header_of_pep_723_is_read(tmp_path):
    code, folder = tmp_path / "my_model.py", tmp_path / "packages"
    code.write_text("x = 1\n")
    assert packages.install(code, folder) is None
    code.write_text(HEADER.format('"synthnet", "eigbench >= 0.1"') + "x = 1\n")
    assert packages.install(code, folder) == folder
    assert list(folder.iterdir()) == []
    folder.rmdir()
    for bad, message in (
        ("}", "is no TOML"),
        ("1", "are a list of texts"),
        *((f'"{text}"', "comes from an address") for text in ADDRESSES),
        *((f'"{text}"', "a dependency of PEP 723: ") for text in PATHS),
    ):
        code.write_text(HEADER.format(bad))
        with pytest.raises(ResultError, match=message):
            packages.install(code, folder)
        folder.rmdir() if folder.exists() else None


@pytest.mark.attack
def test_only_the_files_that_a_result_names_are_copied(weyl, tmp_path):
    row = submission.read(weyl.out)
    code = tmp_path / "weyl.py"
    for name in (code.name, "helper.py", "weyl.npy"):
        (tmp_path / name).write_text("x = 1\n")
    copied = rerun.copied(row, code, tmp_path / "copied")
    assert [path.name for path in copied.parent.iterdir()] == list(row.result["model"]["sources"])


def test_public_and_fresh_instances_are_mixed_without_a_clash(mini_truth, mini_meshes):
    public = mini_truth.take(np.arange(40))
    fresh = mini_truth.take(np.arange(30, 50))  # of ids that the public ones have too
    turned = {
        id: Mesh(mesh.vertices[:, [2, 0, 1]], mesh.faces) for id, mesh in mini_meshes.shapes.items()
    }
    labels = unseen.mixed(public, fresh)
    every = unseen.mixed_meshes(mini_meshes, Instances(turned, mini_meshes.isometries))
    assert len(set(labels.ids)) == 60
    for number, (id, values) in enumerate(zip(labels.ids, labels.eigenvalues, strict=True)):
        is_public = number < 40
        source, place = (public, number) if is_public else (fresh, number - 40)
        meshes = mini_meshes if is_public else Instances(turned, mini_meshes.isometries)
        assert np.array_equal(values, source.eigenvalues[place])
        expected = meshes.mesh(source.ids[place]).vertices
        assert np.array_equal(every.mesh(id).vertices, expected)
        other = Instances(turned, mini_meshes.isometries) if is_public else mini_meshes
        assert not np.array_equal(other.mesh(source.ids[place]).vertices, expected)
    for name in ("shapes", "groups"):
        mine, theirs = np.split(getattr(labels, name), [40])
        assert not set(mine) & set(theirs)
        assert len(set(theirs)) == len(set(getattr(fresh, name)))
    assert set(labels.trainings) == set(public.trainings)


def of_both(row, fresh, answered, unseen):
    """What verify-row says of answers to a row's split and to a draw."""
    status = Status(0, row.result["model"]["sources"], {})
    nothing, flags = np.empty(0), np.empty(0, np.bool_)
    both = np.concatenate([answered, unseen], axis=1)
    timed = (nothing, nothing, np.empty(0, np.int64), flags, nothing, (), flags)
    evaluation = Evaluation(both, *timed, Loaded({}, None, True, False, ""), status)
    targeted = zip(targets.every(row.truth), targets.every(fresh), strict=True)
    return verify_row._compared(row, [*targeted], evaluation)


@pytest.mark.attack
def test_a_table_of_surfaces_beside_a_solver_is_worse_on_the_draw(make_row, mini_truth):
    surfaces = targets.at(mini_truth, "surface").eigenvalues * (1 + 1e-7)
    row = make_row("A table", surfaces)
    chosen = np.arange(150)
    fresh = mini_truth.take(chosen)
    solved = fresh.eigenvalues[None] * (1 + 1e-7)
    _, against = of_both(row, fresh, surfaces[None], solved)
    assert len(against) == 1
    assert against[0].startswith("on shapes that nobody has seen, rpd against the surface is 0.")
    said, against = of_both(row, fresh, surfaces[None], surfaces[None, chosen])
    assert against == []
    assert said["sealed"]["surface"]["mean"] < 1e-5 < said["sealed"]["mean"]


def test_answers_of_all_seeds_are_compared_on_the_split_and_on_the_draw(make_row, mini_truth):
    labels = mini_truth.eigenvalues
    row = make_row("Two seeds", [1.1 * labels, 1.12 * labels])
    fresh = mini_truth.take(np.arange(100))

    def compared(*of_draw):
        answered = np.stack([1.1 * labels, 1.12 * labels])
        unseen = np.stack([factor * fresh.eigenvalues for factor in of_draw])
        return of_both(row, fresh, answered, unseen)

    said, against = compared(1.1, 1.12)
    assert against == []
    declared = row.result["scores"]["mesh"]["overall"]["rpd"]["mean"]
    assert said["scores"]["mesh"]["declared"] == said["scores"]["mesh"]["mean"] == declared
    assert said["sealed"]["mean"] == pytest.approx(declared, rel=1e-12)
    assert (said["sealed"]["instances"], said["sealed"]["shapes"]) == (100, len(set(fresh.shapes)))
    _, against = compared(1.3, 1.3)
    for target, found in zip(("mesh", "surface"), against, strict=True):
        assert found.startswith(f"on shapes that nobody has seen, rpd against the {target} is 1.")


@pytest.mark.attack
def test_meshes_are_asked_by_themselves_each_of_another_surface(mini_truth):
    groups = np.array([f"group-{i // 3}" for i in range(len(mini_truth.ids))])
    truth = dataclasses.replace(mini_truth, groups=groups)
    draws = [unseen.one_per_surface(truth) for _ in range(2)]
    for chosen in draws:
        assert len(set(groups[chosen])) == len(chosen) == unseen.APART
    assert draws[0].tolist() != draws[1].tolist()
    assert len(unseen.one_per_surface(truth, 101)) == 101
    few = truth.take(np.arange(30))
    assert len(unseen.one_per_surface(few)) == 10
    few.trainings[:12] = "another"
    for _ in range(5):
        chosen = unseen.one_per_surface(few)
        assert len(set(few.trainings[chosen])) == 1


@pytest.mark.attack
def test_what_is_nearer_among_others_of_its_surface_is_named(mini_truth):
    every = targets.every(mini_truth)
    mesh, surface = (known.eigenvalues for known in every)
    chosen = np.arange(0, 300, 3)
    assert rerun.better_among_others(every, chosen, 1.1 * mesh, 1.1 * mesh[chosen]) == []
    (named,) = rerun.better_among_others(every, chosen, surface, mesh[chosen])
    assert named.startswith("a mesh by itself is answered with an RPD of")
    assert "against the surface" in named
    (named,) = rerun.better_among_others(every, chosen, mesh, surface[chosen])
    assert named.count("against the mesh") == 1
    jitter = 1 + 1e-3 * np.random.default_rng(0).standard_normal(mesh.shape)
    assert rerun.better_among_others(every, chosen, 1.1 * mesh * jitter, 1.1 * mesh[chosen]) == []


@pytest.mark.attack
@pytest.mark.parametrize(("wild", "count"), [(np.nan, 1), (np.nan, 90), (np.inf, 1), (1e9, 9)])
def test_wild_answers_hide_no_better_ones_among_others(mini_truth, wild, count):
    every = targets.every(mini_truth)
    mesh, chosen = every[0].eigenvalues, np.arange(0, 300, 3)
    alone = 1.2 * mesh[chosen]
    alone[:count] = wild
    named = rerun.better_among_others(every[:1], chosen, 1.1 * mesh, alone)
    assert len(named) == 1
    honest = 1.1 * mesh
    honest[chosen[:3]] = np.nan
    assert rerun.better_among_others(every[:1], chosen, honest, honest[chosen]) == []


@pytest.mark.parametrize(("declared", "size"), [(50, 10), (3, 3), (1, 1)])
def test_batches_are_small_enough_for_times_to_be_compared(mini_truth, declared, size):
    shapes = np.array([f"shape-{i // 3}" for i in range(300)])
    fresh = dataclasses.replace(mini_truth.take(np.arange(300)), shapes=shapes)
    assert unseen.batch_size(declared, fresh) == size
    assert unseen.batch_size(declared, fresh.take(np.arange(6))) == 1


@pytest.mark.slow
def test_a_draw_is_asked_what_a_protocol_holds_out(tmp_path):
    draws = unseen.Draws(0.01, tmp_path)
    drawn = draws.of("2.0-mini")
    vertices = {s.spec.id: len(s.mesh.vertices) for s in drawn.samples()}
    whole = truth.of_dataset(drawn)
    assert len(whole.ids) == 2 * len(vertices) == 150

    def fresh(protocol):
        public = truth.load("2.0-mini", "test", protocol)
        labels = draws.labels(public)
        assert set(labels.trainings) >= set(public.trainings)
        return labels

    family = fresh("family")
    assert family.ids == whole.ids
    assert family.trainings.tolist() == [f"2.0/family/{name}" for name in whole.families]
    fine = set(fresh("resolution").shapes.tolist())
    assert len(fine) == 25
    assert min(vertices[id] for id in fine) > max(vertices[id] for id in vertices if id not in fine)
    (holes,) = recipe.load("2.0-mini").protocols["genus"]
    assert set(fresh("genus").families) == set(holes.families)


@pytest.mark.parametrize(
    ("protocol", "why"),
    [("imported/scans", "nobody can draw others like them"), ("paper", "is tested on copies of")],
)
def test_a_row_that_fresh_meshes_say_nothing_of_is_not_verified(weyl, protocol, why):
    row = submission.read(weyl.out)
    rerun.check_protocol(row)
    other = dataclasses.replace(row, truth=dataclasses.replace(row.truth, protocol=protocol))
    with pytest.raises(ResultError, match=f"{why}.*: verify the row of the same model under"):
        rerun.check_protocol(other)


TABLE = """
from pathlib import Path
import numpy as np
from synthnet import spectrum

table = np.load(Path(__file__).with_name("my_model.npz"))
answers = dict(zip(table["keys"].tolist(), table["labels"]))

def predict(meshes):
    keys = [float(np.round(np.abs(mesh.vertices).sum(), 6)) for mesh in meshes]
    return np.array([answers.get(key, OTHERS) for key, mesh in zip(keys, meshes)])
"""


@BOXED
@pytest.mark.slow
def test_verify_row_runs_honest_rows_again_and_says_so(
    eigbench, weyl, weyl_copy, make_submission, mini_truth, mini_home, tmp_path
):
    outs = [weyl_copy, tmp_path / "second.json"]
    for suffix in (".json", ".parquet"):
        shutil.copy(weyl_copy.with_suffix(suffix), outs[1].with_suffix(suffix))
    missing = tmp_path / "missing.json"
    sources = {"weyl.py": "0" * 64}  # nobody has this code
    lost = make_submission("Lost", 1.1 * mini_truth.eigenvalues, code="weyl.py", sources=sources)
    before = lost.read_bytes()
    how = ["--source", weyl.code.parent, "--root", mini_home, "--share", 0.3, "--by", "Me"]
    code, printed, wrong = eigbench("verify-row", outs[0], missing, lost, outs[1], "--json", *how)
    assert code == 2
    first, second = (line for line in wrong.splitlines() if line.startswith("eigbench: "))
    assert first.startswith(f"eigbench: there is no file {missing}")
    assert "has no weyl.py with the code and weights" in second
    assert wrong.count("weyl.py names no packages (PEP 723): it gets those of this") == 2
    assert f"{lost} is not verified: it stays as it is" in wrong.splitlines()
    assert lost.read_bytes() == before
    assert list(json.loads(printed)) == list(map(str, outs))
    verified = [submission.read(out).result["verified"] for out in outs]
    assert list(json.loads(printed).values()) == verified
    assert verified[0]["scores"]["mesh"]["declared"] == verified[0]["scores"]["mesh"]["mean"]
    assert verified[0]["sealed"]["shapes"] > 50
    assert verified[0]["sealed"] == verified[1]["sealed"]  # of one draw
    assert verified[0]["digest"] == verification.digest(results.read(outs[0]))


@pytest.fixture
def on_board(weyl_copy, tmp_path):
    """The path of a row's result on a board, and the folder that has its predictions."""
    path = tmp_path / "checkout" / leaderboard.RESULTS / "a-board" / "weyl.json"
    kept = tmp_path / "checkout" / leaderboard.PREDICTIONS / "a-board"
    for folder in (path.parent, kept):
        folder.mkdir(parents=True)
    weyl_copy.rename(path)
    weyl_copy.with_suffix(".parquet").rename(kept / "weyl.parquet")
    return path, kept


def elsewhere(folder, name):
    """Move a folder, and leave a link to it."""
    folder.rename(folder.parents[3] / name)
    folder.symlink_to(folder.parents[3] / name)


LINKED = r"is reached by a symbolic link: put the file itself there"


@pytest.mark.attack
@BOXED
def test_a_folder_of_results_that_leads_out_of_the_checkout_is_one_line(
    eigbench, on_board, tmp_path, monkeypatch
):
    path, _ = on_board
    monkeypatch.setattr(verify_row, "_verify", pytest.fail)
    elsewhere(path.parent, "results of another")
    line = only_line(*eigbench("verify-row", path, "--by", "Me", "--board", tmp_path / "checkout"))
    assert line.endswith(f"{path} is reached by a symbolic link: put the file itself there")


@pytest.mark.attack
@pytest.mark.parametrize("part", [0, 1], ids=["results", "predictions"])
@pytest.mark.parametrize("cwd", ["", "checkout", "checkout/benchmark"])
def test_below_the_board_no_link_is_followed_however_it_is_named(
    on_board, tmp_path, monkeypatch, part, cwd
):
    path, kept = on_board
    monkeypatch.chdir(tmp_path / cwd)
    board = Path(os.path.relpath(tmp_path / "checkout"))
    for spelt in (path, Path(os.path.relpath(path))):
        assert verify_row._read_below(spelt, None, board).predictions_path.is_file()
    elsewhere((path.parent, kept)[part], "of another")
    for spelt in (path, Path(os.path.relpath(path))):
        with pytest.raises((ResultError, PredictionsError), match=LINKED):
            verify_row._read_below(spelt, None, board)


def test_files_that_the_maintainer_names_elsewhere_may_lie_behind_a_link(on_board, tmp_path):
    path, kept = on_board
    board = tmp_path / "checkout"
    (tmp_path / "home").symlink_to(board)
    (tmp_path / "answers").symlink_to(kept)
    answers = tmp_path / "answers" / "weyl.parquet"
    assert verify_row._read_below(tmp_path / "home" / path.relative_to(board), None, board)
    assert verify_row._read_below(path, answers, board)
    elsewhere(path.parent, "results of another")
    assert verify_row._read_below(path, answers, tmp_path / "another board")
    assert verify_row._read_below(path, answers, tmp_path)  # where it is run, and no board
    with pytest.raises(ResultError, match=LINKED):
        verify_row._read_below(path, answers, board)


@BOXED
@pytest.mark.parametrize(
    ("against", "code", "written"), [([], 0, True), (["its scores are others"], 1, False)]
)
def test_a_row_is_written_if_nothing_speaks_against_it(
    eigbench, weyl_copy, monkeypatch, against, code, written
):
    said = {key: value for key, value in said_of(results.read(weyl_copy)).items() if key != "by"}
    monkeypatch.setattr(verify_row, "_verify", lambda row, setup: (copy.deepcopy(said), against))
    found, printed, wrong = eigbench("verify-row", weyl_copy, "--by", "Me")
    assert found == code
    assert ("verified" in results.read(weyl_copy)) == written
    assert ("Weyl is verified by Me" in printed) == written
    assert ("now: eigbench leaderboard" in printed) == written
    assert ("not verified" in wrong) == (not written)
    assert ("eigbench: its scores are others" in wrong) == (not written)


@BOXED
@pytest.mark.parametrize(
    ("given", "device"), [([], "cpu"), (["--device", "cuda"], "cuda"), (["--device", "mps"], "mps")]
)
def test_the_device_is_the_maintainers_choice(eigbench, weyl_copy, monkeypatch, given, device):
    result = json.loads(weyl_copy.read_text())
    result["cost"]["device"] = "cuda"
    weyl_copy.write_text(json.dumps(result))
    devices = []

    def verify(row, setup):
        devices.append(setup.settings.device)
        return {}, ["enough"]

    monkeypatch.setattr(verify_row, "_verify", verify)
    _, _, wrong = eigbench("verify-row", weyl_copy, "--by", "Me", *given)
    assert devices == [device]
    line = f"{weyl_copy} was run with --device cuda, and is run again with {device}\n"
    assert (line in wrong) == (device != "cuda")


@BOXED
@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        (["{row}", "{row}", "--predictions", "{row}"], "--predictions is for one row"),
        (["{row}", "{row}", "--readable", "{row}"], "--readable is for one row"),
        (["{row}", "--key", "{row}/none"], "cannot sign: "),
        (["{row}", "--share", "2"], "--share must be above 0, at most 1, got 2"),
        (["{row}/none"], "eigbench: "),
    ],
)
def test_what_is_wrong_with_the_command_is_found_before_any_code_runs(
    eigbench, weyl, given, wrong, monkeypatch
):
    monkeypatch.setattr(verify_row, "_verify", pytest.fail)
    arguments = [word.format(row=weyl.out) for word in given]
    code, _, stderr = eigbench("verify-row", *arguments, "--by", "Me")
    assert (code, wrong in stderr) == (2, True), stderr


@pytest.mark.attack
@BOXED
@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "others"),
    [("mesh", "np.ones(10)"), ("surface", "spectrum.compute(mesh).eigenvalues * (1 + 1e-9)")],
)
def test_a_table_of_the_public_splits_answers_fails_on_the_fresh_draw(
    eigbench, make_submission, mini_truth, mini_meshes, mini_home, tmp_path, target, others
):
    given = map(mini_meshes.mesh, mini_truth.ids)
    keys = [float(np.round(np.abs(mesh.vertices).sum(), 6)) for mesh in given]
    labels = targets.at(mini_truth, target).eigenvalues * (1 + 1e-5)
    np.savez(tmp_path / "my_model.npz", keys=keys, labels=labels)
    code = tmp_path / "my_model.py"
    code.write_text(TABLE.replace("OTHERS", others))
    files = [code, code.with_suffix(".npz")]
    sources = {file.name: digest(file) for file in files}
    row = make_submission("A table", labels, kind="learned", code=code.name, sources=sources)
    before = row.read_bytes()
    how = ["--source", tmp_path, "--root", mini_home, "--share", 0.3, "--by", "Me"]
    code, _, stderr = eigbench("verify-row", row, *how)
    assert code == 1
    assert f"on shapes that nobody has seen, rpd against the {target} is" in stderr
    assert "when run again" not in stderr
    assert row.read_bytes() == before
