"""The scaling track: the fixed meshes, running a predictor over them, and what the page says."""

import copy
import hashlib
import itertools
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from eigbench.board import leaderboard, scaling_page
from eigbench.errors import EigbenchError, PredictorError, ResultError
from eigbench.scaling import results as scaling_results
from eigbench.scaling import run as scaling_run
from eigbench.scaling import scores as scaling_scores
from eigbench.scaling import surfaces
from eigbench.scaling.results import Scaled
from eigbench.scaling.run import Settings

from evidence import scaling_gain
from synthnet.families import FAMILIES
from synthnet.mesh import geometry

ONE = {"ellipsoid": surfaces.SURFACES["ellipsoid"]}
TWO = {**ONE, "open_cylinder": surfaces.SURFACES["open_cylinder"]}

EIGHTY = """
import numpy as np

META = {"name": "Eighty", "kind": "trivial"}

def predict(meshes):
    return np.tile(80.0 + np.arange(10), (len(meshes), 1))
"""
# Something happens on meshes of more than 5,000 vertices: those of 10,000, and not the warm-up.
AT_TEN_THOUSAND = """
import os, time
import numpy as np

def predict(meshes):
    if len(meshes[0].vertices) > 5000:
        {}
    return np.ones((len(meshes), 10))
"""


@pytest.fixture
def only(monkeypatch):
    """Return a function that leaves only some surfaces in the set, and LaPy out: it takes long."""

    def choose(chosen):
        monkeypatch.setattr(surfaces, "SURFACES", chosen)
        monkeypatch.setattr(surfaces, "TIMED_BESIDE", 0)

    return choose


# --- the set ---------------------------------------------------------------------------


def test_small_meshes_are_pinned_and_their_labels_solved_anew_agree():
    assert len(surfaces.SURFACES) == 6
    for size, surface in itertools.product((1_000, 10_000), surfaces.SURFACES):
        assert list(surfaces.differences(surfaces.pinned(surface, size))) == []


@pytest.mark.parametrize("surface", surfaces.SURFACES)
def test_a_mesh_is_the_same_each_time_and_has_the_size_and_topology_of_its_surface(surface):
    mesh, again = surfaces.mesh(surface, 1_000), surfaces.mesh(surface, 1_000)
    assert np.array_equal(mesh.vertices, again.vertices)
    assert np.array_equal(mesh.faces, again.faces)
    assert 0.9 * 1_000 < len(mesh.vertices) < 1.3 * 1_000
    facts = geometry.MeshFacts(mesh)
    topology = FAMILIES[surface].topology(surfaces.spec(surface, 1_000).parameters)
    assert facts.euler_characteristic == topology.euler_characteristic
    assert facts.is_closed == (topology.boundaries == 0)


@pytest.mark.parametrize("surface", surfaces.SURFACES)
def test_labels_approach_the_spectrum_of_the_surface_like_h_squared(surface):
    coarse, fine = (surfaces.pinned(surface, size) for size in (1_000, 10_000))
    errors = coarse.discretisation_error / fine.discretisation_error
    order = np.log(errors) / np.log(np.sqrt(fine.vertices / coarse.vertices))
    assert 1.8 < order < 2.3
    assert (fine.label > fine.limit).all()  # inscribed meshes and conforming functions, both above
    finest = surfaces.pinned(surface, 1_000_000)  # whose error decides who wins
    assert (finest.limit_error / finest.limit).mean() < 0.1 * finest.discretisation_error


def test_limit_by_extrapolation_is_the_closed_form(monkeypatch):
    known, error = surfaces.limit("open_cylinder")
    assert not error.any()
    family = replace(FAMILIES["open_cylinder"], limit=None)
    monkeypatch.setattr(surfaces, "FAMILIES", {"open_cylinder": family})
    monkeypatch.setattr(surfaces, "LEVELS", (1, 2, 3))  # as in the pins, 16 times coarser
    estimate, bound = surfaces.limit("open_cylinder")
    assert (np.abs(estimate - known) <= bound).all()
    np.testing.assert_allclose(estimate, known, rtol=1e-6)


def test_pins_survive_being_written_in_any_order(tmp_path):
    pins = list(surfaces.read().values())
    paths = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    for path, rows in zip(paths, (pins, pins[::-1]), strict=True):
        surfaces.write(path, rows)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_another_mesh_is_refused():
    expected = surfaces.pinned("ellipsoid", 1_000)
    other = surfaces.mesh("ellipsoid", 1_000)
    other.vertices[0] *= 1.1
    with pytest.raises(EigbenchError, match=r"ellipsoid-1000 is not the mesh .*vertices differ by"):
        surfaces.check(expected, other)
    with pytest.raises(EigbenchError, match=r"ellipsoid-1000 is not the mesh .*faces differ"):
        surfaces.check(expected, surfaces.mesh("ellipsoid", 10_000))


def test_what_is_not_in_the_set_or_not_pinned_is_said(monkeypatch):
    with pytest.raises(EigbenchError, match=r"has no cube at 1,000 vertices: its surfaces are ell"):
        surfaces.pinned("cube", 1_000)
    monkeypatch.setattr(surfaces, "read", dict)
    with pytest.raises(
        EigbenchError, match=r"blob at 1,000 vertices is not pinned: python -m evidence"
    ):
        surfaces.pinned("blob", 1_000)


# --- running ---------------------------------------------------------------------------


@pytest.fixture
def out(tmp_path):
    return tmp_path / "scaling.json"


def test_a_run_writes_what_the_schema_wants(printed, refused, predictor_file, out, monkeypatch):
    monkeypatch.setattr(surfaces, "SURFACES", ONE)
    command = ["scale", predictor_file(EIGHTY), "--sizes", 1000, "--out", out]
    assert printed(*command).startswith("Eighty, one mesh a call\n")
    (mesh,) = scaling_results.read(out).meshes.values()
    assert (mesh["surface"], mesh["size"], mesh["outcome"]) == ("ellipsoid", 1000, "answered")
    assert mesh["eigenvalues"] == [80.0 + i for i in range(10)]
    assert len(mesh["seconds"]) == scaling_run.REPEATS
    assert mesh["reference_seconds"] > 0
    label = surfaces.pinned("ellipsoid", 1000).label
    assert scaling_scores.error(mesh) == np.mean(np.abs(np.arange(80, 90) - label) / label)
    err = refused(*command)
    assert "is there already: --resume adds what it lacks, or give another" in err


@pytest.mark.parametrize(
    ("happens", "outcome", "detail"),
    [
        ("time.sleep(60)", "over time", "more than 2 s on the batch of 1"),
        (
            "kept = np.ones(2**27); time.sleep(60)",
            "over memory",
            r"more than 0\.25 GiB .*: raise --memory-limit",
        ),
        ("os._exit(3)", "died", "exit code 3"),
        ("raise ValueError('too many\\nvertices')", "failed", "ValueError: too many vertices"),
        ("return -np.ones((1, 10))", "failed", "not finite and positive"),
    ],
)
def test_what_goes_wrong_at_one_size_loses_only_that(
    predictor_file, out, only, happens, outcome, detail
):
    only(ONE)
    code = predictor_file(AT_TEN_THOUSAND.format(happens))
    settings = Settings(time_limit=2.0, memory_limit=0.25)
    result = scaling_run.run(code, [10_000, 1_000], settings, out)
    assert [mesh["outcome"] for mesh in result["meshes"]] == ["answered", outcome]
    assert re.search(detail, result["meshes"][1]["detail"])
    assert result["meshes"][1]["eigenvalues"] is None
    assert scaling_results.read(out).result == result
    cell = scaling_scores.medians(Scaled(result, out), 10_000)
    failure = {"over time": "over 2 s", "over memory": "over 0.25 GiB"}.get(outcome, outcome)
    assert (cell.answered, cell.total, cell.failures) == (0, 1, (failure,))


@pytest.mark.slow
def test_resume_adds_what_is_missing_and_tries_again_what_a_higher_limit_allows(
    predictor_file, out, only, monkeypatch
):
    only(TWO)
    monkeypatch.setattr(scaling_run, "ENOUGH", 1.0)
    code = predictor_file(AT_TEN_THOUSAND.format("time.sleep(1.5)"))
    asked = []

    def run(limit, *sizes):
        asked.clear()
        settings = Settings(time_limit=limit, resume=True)
        return scaling_run.run(code, sizes, settings, out, asked.append)

    run(0.5, 1_000)
    assert asked == ["ellipsoid-1000", "open_cylinder-1000"]
    first = json.loads(out.read_text())["meshes"]
    run(0.5, 1_000, 10_000)
    assert asked == ["ellipsoid-10000", "open_cylinder-10000"]
    run(0.5, 1_000, 10_000)
    assert asked == []
    result = run(30.0, 1_000, 10_000)
    assert asked == ["ellipsoid-10000", "open_cylinder-10000"]
    assert result["meshes"][-1]["outcome"] == "answered"
    assert result["meshes"][:2] == first


def test_a_higher_limit_drops_no_mesh_that_is_not_chosen(predictor_file, out, only):
    only(ONE)
    code = predictor_file(AT_TEN_THOUSAND.format("time.sleep(60)"))
    first = scaling_run.run(code, [10_000], Settings(time_limit=1.0), out)["meshes"]
    assert [mesh["outcome"] for mesh in first] == ["over time"]
    scaling_run.run(code, [1_000], Settings(time_limit=2.0, resume=True), out)
    both = scaling_results.read(out).result["meshes"]
    assert [mesh["outcome"] for mesh in both] == ["answered", "over time"]
    assert both[1:] == first


def test_resume_refuses_what_other_code_or_settings_have_made(predictor_file, out, only):
    only(ONE)
    code = predictor_file(EIGHTY)
    scaling_run.run(code, [1_000], Settings(), out)
    with pytest.raises(EigbenchError, match=r"made with another threads \(cost\): give another"):
        scaling_run.run(code, [1_000], Settings(threads=2, resume=True), out)
    code.write_text(EIGHTY + "\n# a comment\n")
    scaling_run.run(code, [1_000], Settings(resume=True), out)
    code.write_text(EIGHTY + "\nCHANGED = 1\n")
    with pytest.raises(EigbenchError, match=r"made with another sources \(model\): give another"):
        scaling_run.run(code, [1_000], Settings(resume=True), out)


def test_pins_are_read_by_path(monkeypatch):
    # As synthnet's own, see pins.shipped_table
    sources = []
    read_table = surfaces.pins.pq.read_table
    monkeypatch.setattr(
        surfaces.pins.pq, "read_table", lambda source: sources.append(source) or read_table(source)
    )
    surfaces.read.cache_clear()
    assert surfaces.read()
    assert [type(source) for source in sources] == [type(Path())]


def test_failure_of_lapy_is_said_and_loses_no_mesh(predictor_file, out, only, monkeypatch):
    only(TWO)
    monkeypatch.setattr(surfaces, "TIMED_BESIDE", 1_000)
    lapy = predictor_file("def predict(meshes): raise ValueError('no')", "lapy.py")
    monkeypatch.setattr(scaling_run, "REFERENCE_FILE", lapy)
    code = predictor_file(EIGHTY)
    for done in (["ellipsoid"], ["ellipsoid", "open_cylinder"]):
        with pytest.raises(
            PredictorError, match=r"^LaPy, timed .* ValueError: no.*: --resume goes"
        ):
            scaling_run.run(code, [1_000], Settings(resume=True), out)
        meshes = scaling_results.read(out).meshes
        assert [surface for surface, _ in meshes] == done
        assert all(mesh["outcome"] == "answered" for mesh in meshes.values())
        assert all(mesh["reference_seconds"] is None for mesh in meshes.values())


def test_an_interrupted_run_keeps_what_it_has(predictor_file, out, only):
    only(TWO)

    def stop(name):
        if name.startswith("open_cylinder"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scaling_run.run(predictor_file(EIGHTY), [1_000], Settings(), out, stop)
    assert list(scaling_results.read(out).meshes) == [("ellipsoid", 1_000)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing.py"], "eigbench: there is no file missing.py"),
        (["missing.py", "--out", "a.txt"], "eigbench: --out must end in .json, got a.txt"),
        (["missing.py", "--sizes", "50"], "invalid choice: 50"),
        (["missing.py", "--time-limit", "0"], "must be above 0, got 0"),
    ],
)
def test_wrong_arguments_are_one_line(refused, arguments, message):
    assert message in refused("scale", *arguments)


def test_a_predictor_that_cannot_do_a_small_mesh_leaves_no_result(refused, predictor_file, out):
    code = predictor_file("import numpy as np\ndef predict(meshes):\n    return np.ones((1, 9))\n")
    err = refused("scale", code, "--sizes", 1000, "--out", out)
    assert err.startswith("eigbench: the answer has shape (1, 9), it must be (1, 10)")
    assert not out.exists()


def test_scaling_lists_and_verifies(eigbench, printed, monkeypatch, only):
    only(ONE)
    out = printed("scaling", "--verify", "--sizes", 1000)
    assert "1 meshes and their labels are the pinned ones" in out
    pins = {key: replace(pin, vertices=7) for key, pin in surfaces.read().items()}
    monkeypatch.setattr(surfaces, "read", lambda: pins)
    code, out, _ = eigbench("scaling", "--verify", "--sizes", 1000, "--json")
    assert code == 1
    assert json.loads(out)["findings"] == ["ellipsoid-1000: 1,002 vertices instead of 7"]


# --- the page --------------------------------------------------------------------------


NOWHERE = "solver.** Nowhere: no prediction wins at any size."
TIMES = {1_000: 0.01, 10_000: 1.0}  # of an exact solver, in seconds


@pytest.fixture
def rows(make_scaled):
    """Two solvers; a prediction 0.5 % off, better than meshes of 1,000 vertices; one far off."""
    return [
        make_scaled("Exact", {1_000: (0.1, 1.0), 10_000: (1.0, 1.0)}),
        make_scaled("Exact too", {1_000: (0.2, 1 + 1e-11), 10_000: (9.0, None)}),
        make_scaled("Near", {1_000: (0.01, 1.005), 10_000: (0.02, 1.005)}),
        make_scaled("Far | off", {1_000: (0.001, 2.0)}),
        make_scaled("Slow", {10_000: (5.0, 1.001)}),
    ]


@pytest.fixture
def exact(make_scaled):
    """An exact solver for each size."""
    return {size: make_scaled(f"Exact {size}", {size: (time, 1.0)}) for size, time in TIMES.items()}


def section_of(rows):
    return "\n".join(scaling_page.section(rows)[0])


def page_of(rows):
    return scaling_page.section(rows)[1][scaling_page.PAGE]


def test_a_prediction_wins_where_it_is_faster_and_its_error_near_the_discretisation_error(rows):
    small, large = (scaling_scores.verdict(rows, size) for size in (1_000, 10_000))
    assert (small.solver, small.seconds, small.compared) == ("Exact", 0.1, 6)
    assert small.wins == {"near": 6}
    assert large.wins == {}  # 0.5 % is more than twice the error of such meshes
    text = page_of(rows)
    wins = text.partition("| model | kind | 1,000, of 6 | 10,000, of 6 |\n")[2]
    assert wins.splitlines()[1:3] == ["| Near | classical | 6 | – |", ""]
    assert (
        "- 10,000 vertices, discretisation error 0.122 %: the fastest exact solver (mostly Exact) "
        "takes 1,000 ms. Not run: Far \\| off.\n" in text
    )


def test_what_is_nearer_than_the_label_wins_until_a_finer_mesh_is_as_good_and_faster(
    make_scaled, exact
):
    solver = list(exact.values())

    def wins(time, factor):
        near = make_scaled("Near", {1_000: (time, factor)}, of="limit")
        return scaling_scores.verdict([near, *solver], 1_000).wins

    assert wins(0.9, 1.0) == {"near": 6}  # 90 times slower than the solver on the same mesh
    assert wins(1.1, 1.0) == {}  # and slower than the solver on the finest
    assert wins(0.001, 1.1) == {}  # ten per cent are more than twice the error of the mesh


def test_a_fine_mesh_that_is_solved_faster_than_a_coarse_one_decides_for_both(make_scaled):
    slow = make_scaled("Slow", {1_000: (1.0, 1.0)})
    fast = make_scaled("Fast", {10_000: (0.1, 1.0)})
    near = make_scaled("Near", {1_000: (0.5, 1.001)})
    assert scaling_scores.verdict([slow, near], 1_000).wins == {"near": 6}
    assert scaling_scores.verdict([slow, fast, near], 1_000).wins == {}


def test_what_is_all_but_exact_is_a_prediction(make_scaled):
    fit = make_scaled("Fit", {10_000: (0.5, 1 + 5e-7)})  # as a basis of polynomials on an ellipsoid
    solver = make_scaled("Solver", {10_000: (1.0, 1 + 1e-11)})
    verdict = scaling_scores.verdict([fit, solver], 10_000)
    assert (verdict.solver, verdict.seconds) == ("Solver", 1.0)
    assert verdict.wins == {"fit": 6}


def test_a_prediction_does_not_win_where_a_coarser_mesh_is_as_good_and_faster(make_scaled, exact):
    # An error below the mesh's own, on every surface
    near = make_scaled("Near", {10_000: (0.5, 1.0007)})
    alone = scaling_scores.verdict([near, exact[10_000]], 10_000)
    assert alone.wins == {"near": 6}
    both = scaling_scores.verdict([near, *exact.values()], 10_000)
    assert both.wins == {"near": 1}  # elsewhere 0.07 % more costs half a second
    for surface in surfaces.SURFACES:  # by hand: slope of log time over log error
        small, large = (surfaces.pinned(surface, size).discretisation_error for size in TIMES)
        t, own = TIMES.values()
        distance = scaling_scores.distance(near.meshes[surface, 10_000])
        slope = np.log(own / t) / np.log(small / large)
        equal = scaling_scores.equal_seconds(surface, TIMES, distance)
        assert equal == pytest.approx(own * (large / distance) ** slope)
        assert scaling_scores.equal_seconds(surface, TIMES, 2 * small) == pytest.approx(t / 2)
        for nearer in (large / 2, 0.0):
            assert scaling_scores.equal_seconds(surface, TIMES, nearer) == pytest.approx(own)


def test_the_gain_of_a_winner_is_what_its_error_costs_the_solver(make_scaled, exact):
    near = make_scaled("Near", {1_000: (0.5, 1.0)}, of="limit")  # nearer than on any mesh
    nearly = make_scaled("Nearly", {1_000: (0.9, 1.0)}, of="limit")
    far = make_scaled("Far", {1_000: (0.001, 1.1)}, of="limit")
    rows = [near, nearly, far, *exact.values()]
    expected = ["1,000", "Near", "exact", "500.00", "> 1,000", "> 2.0"]
    assert scaling_gain.lines(rows) == [expected]
    assert scaling_gain.sentence(rows) == (
        "on most of the surfaces, untrained rows do so at 1,000 vertices, trained rows do so at no "
        "size."
    )
    none = scaling_gain.sentence([*exact.values()])
    assert none == "on most of the surfaces, untrained and trained rows do so at no size."
    own = make_scaled("Own", {1_000: (0.0025, 1 - 1e-6)})  # as the label: the solver takes 0.01 s
    (line,) = scaling_gain.lines([own, *exact.values()])
    assert line == ["1,000", "Own", "1.155 %", "2.50", "10.00", "4.0"]


def test_page_says_what_was_not_run_and_what_took_too_long(rows):
    text = section_of(rows)
    lines = {line.split(" | ")[0][2:]: line for line in text.splitlines() if line.startswith("| ")}
    main = text.partition("| model | kind | 1,000: error")[2].partition("\n\n")[0]
    assert "| Exact too | classical | 1.155 % | 200.00 | over 600 s | over 600 s |" in main
    assert re.search(r"\| Slow \| classical \| not run \| not run \| 0\.\d{3} % \| 5,000 \|", main)
    assert re.search(r"\| Far \\\| off \| classical \| \d+\.\d+ % \| 1\.00 \| not run \| not", main)
    assert "Slow" in lines
    against_mesh = page_of(rows).partition("### Against the mesh\n")[2].splitlines()
    assert "| Exact too | exact | over 600 s |" in against_mesh
    assert "| Slow | not run | 0.100 % |" in against_mesh
    assert r"| Far \| off | 100.000 % | not run |" in against_mesh


def test_json_has_the_medians_of_each_row_and_nothing_for_what_took_too_long(rows):
    board = json.loads(scaling_page.section(rows)[1][scaling_page.JSON])
    by_name = {row["name"]: row for row in board["rows"]}
    assert set(by_name) == {row.name for row in rows}
    near = by_name["Near"]["sizes"]["10000"]
    assert near["error"] == pytest.approx(0.005)
    assert near["seconds"] == 0.02
    late = by_name["Exact too"]["sizes"]["10000"]
    assert (late["answered"], late["error"]) == (0, None)
    assert late["failures"] == ["over 600 s"]
    assert "10000" not in by_name["Far | off"]["sizes"]
    path = next(row.path for row in rows if row.name == "Near")
    assert by_name["Near"]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_page_without_a_solver_or_a_winner_says_so(make_scaled):
    alone = make_scaled("Near", {1_000: (0.01, 1.005)})
    assert "nothing can be said" in section_of([alone])
    assert NOWHERE in section_of([alone, make_scaled("Exact", {1_000: (0.001, 1.0)})])
    assert scaling_page.section([]) == ([], {})


def test_page_says_nowhere_where_only_a_coarser_mesh_is_as_good_and_faster(make_scaled, exact):
    near = make_scaled("Near", {10_000: (0.95, 1.0007)})
    rows = [near, *exact.values()]
    for surface in surfaces.SURFACES:  # faster and near enough to the surface on every one
        own = surfaces.pinned(surface, 10_000).discretisation_error
        assert scaling_scores.distance(near.meshes[surface, 10_000]) < 2 * own
    assert scaling_scores.verdict(rows, 10_000).wins == {}
    assert NOWHERE in section_of(rows)


def test_times_of_two_machines_are_not_compared(make_scaled):
    rows = [
        make_scaled("Exact", {1_000: (0.1, 1.0)}),
        make_scaled("Near", {1_000: (0.01, 1.005)}, hardware="another"),
    ]
    text = section_of(rows)
    assert text.count("### Scaling: ") == 2
    assert "nothing can be said" in text
    assert NOWHERE in text
    assert "| Near | 0.500 % |" in page_of(rows)


def test_what_an_error_costs_the_solver_is_on_the_line_between_the_sizes(make_scaled, exact):
    times = scaling_scores.exact_seconds([*exact.values()])
    assert times == dict.fromkeys(surfaces.SURFACES, TIMES)

    def equal(factor, of="label", size=1_000):
        row = make_scaled("Row", {size: (0.5, factor)}, of=of)
        return scaling_scores.equal(row, size, times)

    t, own = TIMES.values()

    def both(side, seconds):
        sides = [scaling_scores.Median(side, pytest.approx(s)) for s in (seconds, seconds / 0.5)]
        return scaling_scores.Equal(*sides)

    assert equal(1.0) == both("", t)
    assert equal(1.0, size=10_000) == both("", own)
    assert equal(1.0, of="limit") == both("> ", own)
    assert equal(3.0) == both("< ", t)
    errors = [
        [surfaces.pinned(surface, size).discretisation_error for size in TIMES]
        for surface in surfaces.SURFACES
    ]
    between = equal(1 + np.sqrt(np.prod(np.median(errors, axis=0))), of="limit")
    assert between.seconds.side == ""
    assert t < between.seconds.value < own
    nothing = scaling_scores.equal(make_scaled("Row", {1_000: (0.5, 1.0)}), 1_000, {})
    for median in (nothing.seconds, nothing.gain):
        assert (median.side, np.isnan(median.value)) == ("", True)


@pytest.mark.parametrize(
    ("coarser", "finer", "expected"),
    [
        (0, 2, ""),  # the median is among the four that are known
        (2, 0, ""),
        (3, 0, "< "),
        (1, 3, "> "),
        (3, 3, "> "),  # the mean of the two in the middle has no upper bound
    ],
)
def test_what_an_error_costs_has_the_side_that_the_surfaces_bear_out(
    make_scaled, exact, coarser, finer, expected
):
    times = scaling_scores.exact_seconds([*exact.values()])
    worse, within, nearer = (
        make_scaled("Row", {1_000: (0.5, factor)}, of=of).result["meshes"]
        for factor, of in ((3.0, "label"), (1.0, "label"), (1.0, "limit"))
    )
    known = len(within) - finer
    row = make_scaled("Row", {1_000: (0.5, 1.0)})
    row.result["meshes"] = worse[:coarser] + within[coarser:known] + nearer[known:]
    found = scaling_scores.equal(row, 1_000, times)
    for median in (found.seconds, found.gain):
        assert median.value > 0
        assert median.side == expected


def test_an_upper_bound_counts_the_times_that_are_known_and_longer(make_scaled, exact):
    times = scaling_scores.exact_seconds([*exact.values()])
    t, own = TIMES.values()
    row = make_scaled("Row", {1_000: (0.5, 3.0)})  # worse than on the coarsest mesh
    fine = make_scaled("Row", {10_000: (0.5, 1.0)}).result["meshes"]
    row.result["meshes"][3:] = [mesh | {"size": 1_000} for mesh in fine[3:]]
    found = scaling_scores.equal(row, 1_000, times).seconds
    assert found == scaling_scores.Median("< ", pytest.approx((t + own) / 2))


def test_page_and_figure_are_the_same_in_any_order(rows):
    expected = leaderboard.generate([], [], rows)
    files = [scaling_page.FIGURE, scaling_page.PAGE, scaling_page.JSON, Path("LEADERBOARD.md")]
    assert list(expected) == files
    for order in list(itertools.permutations(rows))[::40]:
        again = [copy.deepcopy(row) for row in order]
        for row in again:
            row.result["meshes"].reverse()
        assert leaderboard.generate([], [], again) == expected


def test_submit_places_a_result_and_the_board_is_checked(eigbench, refused, rows, tmp_path):
    board = tmp_path / "board"
    for row in rows:
        assert eigbench("submit", row.path, "--board", board)[0] == 0
    assert not (board / leaderboard.RESULTS).exists()  # a board may be of this track alone
    assert eigbench("leaderboard", "--board", board)[0] == 0
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 0
    location = board / scaling_results.FOLDER / "near.json"
    assert location.read_bytes() == rows[2].path.read_bytes()
    changed = json.loads(rows[2].path.read_text())
    changed["meshes"][0]["seconds"] = [0.5]
    rows[2].path.write_text(json.dumps(changed))
    err = refused("submit", rows[2].path, "--board", board)
    assert "is there already: give --replace, or another name in META" in err
    assert eigbench("submit", rows[2].path, "--board", board, "--replace")[0] == 0
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 1
    location.rename(location.with_name("other.json"))
    assert "other.json belongs at" in refused("leaderboard", "--board", board)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda r: r.update(scaling_version=1),
            "made by an earlier eigbench: evaluate its predictor again",
        ),
        (lambda r: r["meshes"][0].update(digest="0" * 32), "its ellipsoid-1000 is not the mesh"),
        (lambda r: r["meshes"][0].update(surface="cube"), "has no cube at 1,000 vertices"),
        (lambda r: r["meshes"][0].update(outcome="died"), "is died, its numbers say otherwise"),
        (lambda r: r["meshes"][0].update(cpu_seconds=[]), "wall times and CPU times of other num"),
        (lambda r: r["meshes"].append(r["meshes"][0]), "has ellipsoid-1000 twice"),
        (lambda r: r["meshes"][0]["eigenvalues"].__setitem__(0, -1), "at meshes/0/eigenvalues/0"),
        (lambda r: r["model"].pop("sources"), "'sources' is a required property"),
    ],
)
def test_a_damaged_result_is_refused(make_scaled, change, message):
    row = make_scaled("Near", {1_000: (0.01, 1.005)})
    result = copy.deepcopy(row.result)
    change(result)
    row.path.write_text(json.dumps(result))
    with pytest.raises(ResultError, match=message):
        scaling_results.read(row.path)
