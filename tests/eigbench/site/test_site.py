"""What `eigbench site` writes: boards, rows, meshes, and the folder itself."""

import base64
import json
import re
import shutil
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from eigbench.board import generalisation, leaderboard, ranking
from eigbench.board.markdown import cell
from eigbench.errors import EigbenchError
from eigbench.results import sources
from eigbench.results.verification import is_verified
from eigbench.scoring import truth
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.names import TARGETS
from eigbench.scoring.training import IMPORTED
from eigbench.site import boards, bundle, origin, rows, shapes, write
from eigbench.site.shapes import FACES, STEPS

from synthnet.mesh.open3d import decimate
from synthnet.types import Mesh
from synthnet.verify.shapes import generated_anew
from tests.eigbench.conftest import changed, git
from tests.eigbench.site.conftest import CHECKOUT

FIRST = ("index.html", "style.css", "page.js", "data.js")  # the chart and the first board follow
LARGEST = 400_000  # bytes of the first view


@pytest.fixture(params=["made", pytest.param("real", marks=pytest.mark.slow)])
def shown(request):
    """A board and the files of its page; that of this repository is large."""
    return [request.getfixturevalue(f"{request.param}_{kind}") for kind in ("board", "content")]


@pytest.fixture
def empty_board(tmp_path):
    """A board without rows."""
    (tmp_path / "benchmark" / "results").mkdir(parents=True)
    return tmp_path


def read(content, path):
    """What a script of the page hands to it."""
    match = re.fullmatch(r"eigbench\.put\((\".+?\"),(.+)\)\n", content[path].decode(), re.DOTALL)
    assert match, path
    assert json.loads(match[1]) == ("index" if path == "data.js" else path.removesuffix(".js"))
    return json.loads(match[2])


def whole(content, key):
    """A board with the columns that the page loads when they are asked for."""
    board, rest = (read(content, f"{folder}/{key}.js") for folder in ("boards", "columns"))
    assert not board["columns"].keys() & rest["columns"].keys()
    board["columns"] |= rest["columns"]
    for row in board["rows"]:
        row["cells"] |= rest["cells"][row["slug"]]
    return board | {"drops": rest["drops"]}


def first_view(content):
    key = read(content, "data.js")["datasets"][0]["boards"][0][0]
    return sum(len(content[path]) for path in [*FIRST, "chart.js", f"boards/{key}.js"])


def test_input_in_another_order_gives_the_same_bytes(made_board, made_content):
    submissions, reported, scaled = made_board
    again = write.files(submissions[::-1], reported[::-1], scaled[::-1])
    assert again == made_content


def test_first_view_is_small_and_the_rest_is_loaded_when_asked_for(shown):
    _, content = shown
    assert first_view(content) < LARGEST
    page = content["index.html"].decode()
    loaded = re.findall(r"<(?:script defer src|link rel=\"stylesheet\" href)=\"(.+?)\"", page)
    assert sorted(loaded) == sorted(set(FIRST) - {"index.html"})
    assert len(content["viewer.js"]) > 100_000  # not in the first view


def test_nothing_is_asked_of_another_host(made_content):
    page, style = (made_content[name].decode() for name in ("index.html", "style.css"))
    policy = re.search(r"Content-Security-Policy\" content=\"(.+?)\"", page)[1]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["default-src"] == "'none'"
    sources = {source for rule in rules.values() for source in rule.split()}
    assert sources == {"'none'", "'self'", "file:", "data:", "'unsafe-inline'"}
    assert "unsafe-inline" not in rules["script-src"]
    assert not re.search(r"(?:src|href)=\"(?:https?:)?//", page)
    assert "url(" not in style
    assert "@import" not in style


def test_licence_of_every_bundled_package_is_there(made_content):
    text = made_content["LICENSES.txt"].decode()
    titles = re.findall(r"^([@\w/.-]+) [\d.]+ \((.+)\)$", text, flags=re.M)
    assert {"three", "@observablehq/plot", "d3-scale"} <= {name for name, _ in titles}
    assert {licence for _, licence in titles} <= {"MIT", "ISC", "BSD-3-Clause"}
    assert text.count("ermission") >= len(titles)  # the texts, not the names alone


def both_targets(submissions):
    """The submissions beside every target that is known for them."""
    there = [submission.at(target) for target in TARGETS for submission in submissions]
    return [submission for submission in there if submission is not None]


def table(section, corner):
    """Return the lines of the first table with such a column: by model, the cells by column."""
    lines = iter(section.splitlines())
    head = next(line for line in lines if f"| {corner} |" in line)[2:-2].split(" | ")
    next(lines)  # the rule below the head
    own = takewhile(lambda line: line.startswith("|"), lines)
    cells = [dict(zip(head, line[2:-2].split(" | "), strict=True)) for line in own]
    by_model = {line.get("model", line[corner]): line for line in cells}
    assert len(by_model) == len(cells)
    return by_model


ON_THE_BOARD = {
    "rank": "rank",
    "rpd": METRICS["rpd"].heading,
    "psnr20": METRICS["psnr20"].heading,
    "ms": "ms per mesh",
    "lapy": "speed against LaPy",
    "training": "training set",
    "hardware": "hardware",
}


def test_every_row_is_there_with_the_numbers_of_the_leaderboard(shown):
    (submissions, reported, scaled), content = shown
    pages = leaderboard.generate(submissions, reported, scaled)
    assert submissions
    assert reported
    for submission in both_targets(submissions):
        key = f"{submission.board}-{submission.target}"
        board = whole(content, key)
        assert submission.slug in [row["slug"] for row in board["rows"]]
        if submission.truth.protocol not in boards.OF_ALL:
            continue  # below, with the rows that were not run anew
        main = table(pages[leaderboard.BOARDS / f"{key}.md"], "rank")
        assert set(main) == {cell(row["name"]) for row in board["rows"]}
        for row in board["rows"]:
            line = main[cell(row["name"])]
            assert line["kind"] == row["kind"]
            for key, heading in ON_THE_BOARD.items():
                where = submission.board, row["name"], key
                assert cell(row["cells"][key][0]) == line[heading], where
    titles = [table["title"] for table in read(content, "boards/reported.js")["tables"]]
    for paper in reported:
        assert titles == [table["title"] for table in paper["tables"]]


def test_what_is_held_out_has_the_numbers_of_the_generalisation_table(shown):
    (submissions, reported, scaled), content = shown
    pages = leaderboard.generate(submissions, reported, scaled)
    held_out = [
        submission
        for submission in both_targets(submissions)
        if submission.truth.protocol not in boards.OF_ALL
    ]
    assert held_out
    for submission in held_out:
        name = f"{submission.truth.version}-generalisation-{submission.target}"
        section = pages[leaderboard.BOARDS / f"{name}.md"]
        title = generalisation.title(submission.truth.protocol)
        for key in generalisation.SHOWN:
            lines = table(section, f"model (mean {METRICS[key].heading})")
            for row in read(content, f"boards/{submission.board}-{submission.target}.js")["rows"]:
                # Without the marks of remarks, which the page has as notes
                number = lines[cell(row["name"])][title].rstrip(" ⁰¹²³⁴⁵⁶⁷⁸⁹")
                score, drop = re.fullmatch(r"(.+?)(?: \(([+−±].+)\))?", number).groups()
                known = re.sub(
                    r" \([<\d. ]+\)$", "", row["cells"][key][0]
                )  # the deviation of seeds
                assert cell(known) == score, (submission.board, row["name"])
                if key == "rpd":
                    assert row["cells"]["drop"][0] == (drop or "none")


def test_every_table_of_a_board_is_a_view_of_the_page(made_board, made_content):
    key = "1.0-mini-test-grouped-mesh"
    details = leaderboard.generate(*made_board)[leaderboard.BOARDS / f"{key}.md"]
    board = whole(made_content, key)
    assert f"# {board['title']}\n" in details
    compared = []
    for group in board["groups"]:
        _, heading, part = details.partition(f"## {group['title']}\n")
        if not heading:
            continue  # a choice of the main table's columns, compared above
        lines = table(part, "model")
        compared.append(group["key"])
        for row in board["rows"]:
            line = lines[cell(row["name"])]
            for key in group["columns"]:
                assert line[cell(board["columns"][key]["title"])] == cell(row["cells"][key][0])
    families = [f"families-{key}" for key in ("invlap", "rpd", "psnr20")]
    assert compared == ["medians", "intervals", *families, "indices", "cost", "physics"]


def test_every_row_opens_to_its_shapes_and_their_meshes(shown):
    (submissions, _, _), content = shown
    assert submissions
    for submission in both_targets(submissions):
        key = f"{submission.board}-{submission.target}"
        board = whole(content, key)
        (row,) = (row for row in board["rows"] if row["slug"] == submission.slug)
        assert set(row["cells"]) == set(board["columns"])
        opened = read(content, f"rows/{key}/{submission.slug}.js")
        assert [shape["name"] for shape in opened["shapes"]] == ["worst", "median"]
        for shape in opened["shapes"]:
            if submission.truth.protocol.startswith(IMPORTED):
                assert (shape["mesh"], shape["why"]) == (None, rows.NO_MESH)
            else:
                assert f"{shape['mesh']}.js" in content


def test_every_model_has_a_page_with_its_ranks_and_the_differences_behind_them(shown):
    _, content = shown
    keys = [p[7:-3] for p in content if p.startswith("boards/") and "test" in p]
    assert keys
    for key in keys:
        ranked = read(content, f"boards/{key}.js")["rows"]
        unranked = {
            row["slug"] for row in ranked if row["cells"]["rank"][0] in ("exact", "declared")
        }
        for row in ranked:
            model = read(content, f"models/{row['slug']}.js")
            (here,) = (standing for standing in model["standings"] if standing["board"] == key)
            assert (model["name"], model["kind"]) == (row["name"], row["kind"])
            rank, place = row["cells"]["rank"]
            assert (here["rank"], here["of"]) == (rank, len(ranked) - len(unranked))
            assert here["cells"][0] == row["cells"]["rpd"][0]
            apart = {slug: facts for slug, *facts in model["apart"][key]}
            assert set(apart) == {other["slug"] for other in ranked} - {row["slug"]}
            beside = [facts for slug, facts in apart.items() if slug not in unranked]
            sure = [mean for _, mean, _, _, is_sure in beside if is_sure]
            best = 1 + sum(mean is not None and mean < 0 for mean in sure)
            assert place == {"exact": 0, "declared": None}.get(rank, best)
            for other, (_, mean, low, high, _) in apart.items():
                if mean is not None:
                    assert low <= high
                    theirs = read(content, f"models/{other}.js")["apart"][key]
                    back = next(facts for slug, *facts in theirs if slug == row["slug"])
                    assert back[1:4] == pytest.approx([-mean, -high, -low], abs=1e-12)


def test_a_row_says_where_it_comes_from(made_board, bundled, tmp_path):
    """Files are linked that are still what made the row; a day is said where git has it."""
    row = made_board[0][0]
    root = tmp_path / "checkout"
    path = root / "benchmark" / "results" / row.board / "one.json"
    code = root / "baselines"
    for folder in (path.parent, code):
        folder.mkdir(parents=True)
    (code / "one model.py").write_text("x = 1\n")
    (code / "net.safetensors").write_bytes(b"weights")
    (code / "changed.py").write_text("x = 2\n")
    made_by = {name: sources.digest(code / name) for name in ("one model.py", "net.safetensors")}
    model = {
        **row.result["model"],
        "code": "one model.py:large",
        "sources": {"changed.py": "0" * 64, **made_by},
        "training_data": "none & 50 %",
        "paper": "https://example.org/paper",
    }
    commit = {"commit": "0123456789abcdef", "dirty": True}
    result = {**row.result, "model": model, "checkout": commit}
    path.write_text("{}")
    known = dict(origin.facts(result, path, "https://example.org/{}"))
    assert known["code"] == [
        ("one model.py", "https://example.org/baselines/one%20model.py"),
        ("changed.py", None),
    ]
    assert known["weights"] == [
        ("net.safetensors", "https://example.org/baselines/net.safetensors")
    ]
    assert known["row by"] == [(origin.OWN, None)]
    assert known["training set"] == [("none & 50 %", None)]
    assert known["commit of the code"] == [("0123456789ab, with changes", None)]
    assert "result of" not in known  # no repository
    declared = {**result, "model": {**model, "authors": "A. Author"}}
    assert dict(origin.facts(declared, path, "{}"))["authors"] == [("A. Author", None)]
    foreign = {**result, "model": {**model, "sources": {"one model.py": "0" * 64}}}
    assert "row by" not in dict(origin.facts(foreign, path, "{}"))
    assert not is_verified(result)
    assert is_verified({**result, "verified": {"by": "a maintainer"}})
    entry = origin.bibtex(declared, path, "one", "synthNet 1.0")
    assert entry.startswith("@misc{eigbench-one,\n  title = {{")
    assert "author = {{A. Author}}" in entry
    assert "year" not in entry
    placed = replace(row, result=result, result_path=path, predictions_path=row.predictions_path)
    content = write.files([placed], [], [])
    assert content["code/baselines/one model.py"] == b"x = 1\n"
    assert "code/baselines/changed.py" not in content
    content = write.files([placed], [], [], code="https://example.org/{}")
    assert not any(name.startswith("code/") for name in content)


def test_the_day_of_a_result_is_that_of_its_commit(tmp_path):
    def day(name):
        origin._dates.cache_clear()
        return origin.date(folder / name)

    folder = tmp_path / "checkout" / "benchmark" / "results" / "board"
    folder.mkdir(parents=True)
    for name in ("one.json", "two.json", "new.json"):
        (folder / name).write_text(name)
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", folder / "one.json", folder / "two.json")
    git(tmp_path, "commit", "-qm", "rows")
    (folder / "two.json").write_text("again")
    git(tmp_path, "commit", "-qam", "a row again", day="2026-03-04")
    days = [day(name) for name in ("one.json", "two.json", "new.json")]
    assert days == ["2026-01-02", "2026-03-04", ""]
    (folder / "one.json").write_text("changed since")
    assert day("one.json") == ""
    shallow = tmp_path / "shallow"
    git(tmp_path, "clone", "-q", "--depth=1", f"file://{tmp_path}", shallow)
    there = shallow / folder.relative_to(tmp_path)
    assert origin.date(there / "two.json") == ""


def test_command_of_a_page_names_the_run_and_its_own_batches(made_board, bundled):
    far = made_board[0][3]
    timed = changed(far, "cost", batch_size=3)
    commands = read(write.files([timed], [], []), "models/far.js")["command"]
    assert commands["1.0-mini-test-grouped-mesh"] == (
        f"eigbench evaluate baselines/{far.result['model']['code']} "
        "--dataset 1.0-mini --protocol grouped --batch-size 10"
    )


def test_every_column_explains_itself(made_content):
    paths = [p for p in made_content if p.startswith("boards/") and "reported" not in p]
    assert len(paths) > 3
    for path in paths:
        key = Path(path).stem
        board = read(made_content, path) if key == "scaling" else whole(made_content, key)
        assert board["columns"]
        assert board["groups"]
        for column in board["columns"].values():
            assert len(column["help"]) > 20
        for group in board["groups"]:
            assert set(group["columns"]) <= set(board["columns"])


def test_protocols_stand_under_their_dataset(made_content):
    index = read(made_content, "data.js")
    by_dataset = {
        dataset["title"]: [key for key, _ in dataset["boards"]] for dataset in index["datasets"]
    }
    own = ("family", "resolution", "genus", "boundary")  # what is held out comes first
    assert next(iter(by_dataset)) == "synthNet 2.0-mini"  # whose first board the page opens with
    assert by_dataset == {
        "synthNet 1.0-mini": [f"1.0-mini-test-grouped-{target}" for target in TARGETS],
        "synthNet 2.0-mini": [
            *(f"2.0-mini-test-{name}-surface" for name in (*own, "grouped")),
            *(f"2.0-mini-test-{name}-mesh" for name in (*own, "imported-real-28", "grouped")),
        ],
        "Scaling track": ["scaling"],
        "Reported, not run here": ["reported"],
    }


def test_what_is_held_out_stands_beside_the_same_model_trained_on_everything(made_content):
    board = read(made_content, "boards/2.0-mini-test-genus-mesh.js")
    cells = {row["name"]: row["cells"] for row in board["rows"]}
    assert set(cells) == {"Solver", "Model"}  # Lazy was not run
    rpd, drop = 10 * 0.05 / 2.05, 10 * (0.05 / 2.05 - 0.01 / 2.01)
    assert cells["Model"]["rpd"][1] == pytest.approx(rpd, rel=1e-5)
    assert cells["Model"]["iid"][1] == pytest.approx(rpd - drop, rel=1e-5)
    assert cells["Model"]["drop"] == [f"+{drop:.4f}", pytest.approx(drop, rel=1e-5)]
    assert cells["Solver"]["rpd"][1] == pytest.approx(10 * 0.001 / 2.001, rel=1e-5)
    assert cells["Solver"]["iid"] == ["none", None]
    assert cells["Solver"]["drop"] == ["none", None]
    every = whole(made_content, "2.0-mini-test-grouped-mesh")
    groups = {group["key"]: group["columns"] for group in every["groups"]}
    assert cells["Model"]["psnr20"][0] == "100 % (0 % to 100 %)"  # of three surfaces
    model = next(row for row in every["rows"] if row["name"] == "Model")
    assert model["cells"]["psnr20-genus"][0] == "100 % (0 % to 100 %) (+0.00)"
    assert groups["protocols-rpd"][:2] == ["rpd-iid", "rpd-family"]
    lazy = next(row for row in every["rows"] if row["name"] == "Lazy")
    assert lazy["cells"]["rpd-genus"] == ["not run", None]
    (genus,) = (drop for drop in every["drops"]["rpd"] if drop["column"] == "rpd-genus")
    assert set(genus["scores"]) == {"solver", "model"}
    assert genus["scores"]["model"] == pytest.approx([rpd - drop, rpd], rel=1e-5)
    assert genus["scores"]["solver"][0] is None
    assert board["rest"]
    assert read(made_content, "columns/2.0-mini-test-genus-mesh.js")["drops"] == {}


def test_what_is_not_trained_is_scored_on_the_part_that_a_protocol_tests(made_board):
    genus = truth.load("2.0-mini", "test", "genus")
    (solver,) = (row for row in made_board[0] if row.name == "Solver")
    part = generalisation.rescored(solver, genus)
    assert part.truth.digest == genus.digest
    np.testing.assert_array_equal(part.predictions, generalisation.predicted(solver, genus))
    np.testing.assert_allclose(part.predictions[0], genus.eigenvalues * 1.001)
    assert part.result["dataset"]["instances"] == len(genus.ids)
    assert solver.truth.protocol == "grouped"  # it is as it was


def test_an_imported_mesh_is_not_shown_and_that_is_said(made_content):
    opened = read(made_content, "rows/2.0-mini-test-imported-real-28-mesh/model.js")
    for shape in opened["shapes"]:
        assert shape["mesh"] is None
        assert "its file is not part of this project" in shape["why"]
        assert len(shape["label"]) == len(shape["predicted"]) == 10
    assert not any("real-28" in path for path in made_content if path.startswith("meshes/"))


def test_scaling_has_each_size_and_says_what_took_too_long(made_content):
    board = read(made_content, "boards/scaling.js")
    slow = next(row for row in board["rows"] if row["name"] == "Slow solver")
    assert slow["cells"]["distance-10000"] == ["over 600 s", None]
    assert slow["cells"]["error-1000"] == ["exact", pytest.approx(1e-11, rel=1e-4)]
    assert slow["cells"]["lapy-1000"] == ["not run", None]
    near = next(row for row in board["rows"] if row["name"] == "Near")
    assert near["cells"]["error-1000"] == ["0.500 %", 0.005]
    assert near["cells"]["solver-1000"] == ["< 100.00", 100]  # no coarser mesh was solved
    assert board["rows"][0]["name"] == "Near"  # the fastest
    small, large = board["panels"]
    assert (small["size"], large["size"]) == (1_000, 10_000)
    assert {point["slug"] for point in small["points"]} == {"exact", "lapy", "near", "slow-solver"}
    assert {point["slug"] for point in large["points"]} == {"exact", "lapy", "near"}
    drawn = {point["slug"]: point for point in small["points"]}
    assert (drawn["lapy"]["speed"], drawn["exact"]["speed"], drawn["near"]["speed"]) == (1, 5, 50)
    assert (drawn["near"]["wins"], drawn["exact"]["wins"]) == (6, 0)
    (finer, _), (speed, own), (_, most) = small["border"]
    assert (finer, speed) == (0.5, 5)  # the exact solver's on meshes of 10,000, and on these
    assert most == pytest.approx(2 * own, rel=1e-5)
    assert drawn["exact"]["error"] == pytest.approx(own, rel=1e-5)
    (speed, own), (_, most) = large["border"]
    assert speed == 5
    assert most == pytest.approx(2 * own, rel=1e-5)
    opened = read(made_content, "rows/scaling/slow-solver.js")
    assert opened["tables"][0]["rows"][0][-1] == "over time"


# --- shapes ------------------------------------------------------------------------------


def test_worst_and_median_shape_are_those_of_the_plotted_spectra(made_board):
    submission = made_board[0][0]
    errors = ranking.per_mesh(submission, "rpd")
    assert rows.QUANTILES == {"worst": 1.0, "median": 0.5}
    chosen = rows.chosen(submission)
    assert errors[chosen["worst"]] == errors.max()
    assert errors[chosen["median"]] == np.sort(errors)[round(0.5 * (len(errors) - 1))]
    assert ranking.at_quantile(np.array([2.0, 1.0, 2.0, 1.0]), 1.0) == 2  # the last of the sorted


def test_a_mesh_is_the_one_of_the_dataset(mini_meshes, mini_truth):
    _, firsts = np.unique(mini_truth.families, return_index=True)
    assert len(firsts) == 10
    for i in firsts:
        mesh = generated_anew(shapes.spec_of(mini_truth, mini_truth.shapes[i]))
        kept = mini_meshes.mesh(mini_truth.ids[i])  # the shape, or a rotated copy of it
        np.testing.assert_array_equal(mesh.faces, kept.faces)
        edges = [np.diff(shape.vertices[shape.faces[:, :2]], axis=1) for shape in (mesh, kept)]
        np.testing.assert_allclose(*(np.linalg.norm(e, axis=2) for e in edges), rtol=1e-4)


def test_packed_mesh_is_within_half_a_step_of_the_mesh():
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 2, 0], [0, 0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    packed = shapes.packed(Mesh(vertices, faces))
    unpacked = np.frombuffer(base64.b64decode(packed["vertices"]), "<i2").reshape(-1, 3) / STEPS
    np.testing.assert_allclose(unpacked, (vertices - [2, 1, 0.5]) / 2, atol=0.5 / STEPS)
    kept = np.frombuffer(base64.b64decode(packed["faces"]), "<u2").reshape(-1, 3)
    np.testing.assert_array_equal(kept, faces)
    assert (packed["vertex_count"], packed["face_count"], packed["shown"]) == (4, 2, 2)
    assert not packed["wide"]


def test_a_large_mesh_is_simplified_the_same_each_time(mini_truth):
    spec = shapes.spec_of(replace(mini_truth, version="1.0"), "split_sphere-01742")
    mesh = generated_anew(spec)
    few = [decimate(mesh, 2_000) for _ in range(2)]
    assert len(few[0].faces) <= 2_000 < len(mesh.faces)
    np.testing.assert_array_equal(few[0].vertices, few[1].vertices)
    np.testing.assert_array_equal(few[0].faces, few[1].faces)
    assert decimate(mesh, len(mesh.faces)) is mesh
    packed = shapes.packed(mesh)
    assert packed["face_count"] == len(mesh.faces) > FACES >= packed["shown"]


# --- the folder --------------------------------------------------------------------------


@pytest.mark.slow
def test_command_writes_the_page_and_says_where(eigbench, real_content, tmp_path, monkeypatch):
    monkeypatch.chdir(CHECKOUT)
    code, out, err = eigbench("site", "--out", tmp_path / "page", "--docs", write.DOCS)
    assert code == 0, err
    assert re.search(r"rows: \d+; \d+ files, .* MB: open .*page/index\.html", out)
    assert [line.partition(" ")[0] for line in err.splitlines()] == ["eigbench:"] * err.count("\n")
    stages = [line.split()[1] for line in err.splitlines()]
    keys = [p for p in real_content if p.startswith("columns/")]
    assert stages == ["scoring", *["board"] * len(keys), "drawing", "writing"]
    there = tmp_path / "page"
    written = {p.relative_to(there).as_posix() for p in there.rglob("*") if p.is_file()}
    assert written == set(real_content)
    for path in written:
        assert (there / path).read_bytes() == real_content[path]
    assert [path.name for path in tmp_path.iterdir()] == ["page"]


@pytest.fixture
def page(made_content, tmp_path):
    """The folder of a page that was written; after the test nothing else is beside it."""
    write.write(tmp_path / "page", made_content)
    yield tmp_path / "page"
    assert [path.name for path in tmp_path.iterdir()] == ["page"]


def test_an_older_page_is_replaced_whole(made_content, page):
    write.write(page, {**made_content, "rows/old.js": b"old"})
    write.write(page, made_content)
    assert not (page / "rows" / "old.js").exists()


def test_a_run_that_fails_leaves_the_older_page(made_content, page, monkeypatch):
    calls = []

    def fail(self, data):
        calls.append(self)
        if len(calls) > 3:
            raise OSError(28, "No space left on device")
        return len(data)

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(EigbenchError, match=r"cannot write .*page \(No space left on device\)"):
        write.write(page, made_content)
    monkeypatch.undo()
    assert (page / "index.html").read_bytes() == made_content["index.html"]


def stop_at_move(monkeypatch, number, error):
    """Raise an error in place of a move of a directory, counted from one."""
    rename, calls = Path.rename, []

    def stop(self, target):
        calls.append(self)
        if len(calls) == number:
            raise error
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", stop)


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), KeyboardInterrupt()])
@pytest.mark.parametrize("number", [1, 2])
def test_a_run_that_is_stopped_at_a_move_leaves_the_older_page(
    made_content, page, monkeypatch, number, error
):
    stop_at_move(monkeypatch, number, error)
    with pytest.raises((EigbenchError, KeyboardInterrupt)):
        write.write(page, {**made_content, "data.js": b"new"})
    monkeypatch.undo()
    assert (page / "data.js").read_bytes() == made_content["data.js"]


def test_a_page_that_a_killed_run_left_beside_its_place_is_put_back(
    made_content, page, monkeypatch
):
    page.rename(page.with_name(f".page.{'0' * 32}.older"))
    monkeypatch.setattr(Path, "write_bytes", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):  # the next run does not even get as far as its moves
        write.write(page, made_content)
    monkeypatch.undo()
    assert (page / "data.js").read_bytes() == made_content["data.js"]


def test_two_runs_have_no_folder_in_common(made_content, tmp_path, monkeypatch):
    seen, write_bytes = [], Path.write_bytes

    def note(self, data):
        seen.append(next(folder for folder in self.parents if folder.parent == tmp_path))
        return write_bytes(self, data)

    monkeypatch.setattr(Path, "write_bytes", note)
    for _ in range(2):
        write.write(tmp_path / "my.page", made_content)
    assert len(set(seen)) == 2
    assert all(re.fullmatch(r"\.my\.page\.[0-9a-f]{32}\.partial", folder.name) for folder in seen)


@pytest.mark.parametrize("name", [".git/config", "CNAME", "rows/mine/notes.txt"])
def test_a_page_with_something_else_in_its_folder_is_not_replaced(made_content, page, name):
    mine = page / name
    mine.parent.mkdir(parents=True, exist_ok=True)
    mine.write_text("mine")
    named = name.partition("/")[0] if name.startswith(".git") else name
    with pytest.raises(
        EigbenchError,
        match=rf"page has {re.escape(named)}, which `eigbench site` did not write and would "
        "remove: move it elsewhere, or give another folder with --out$",
    ):
        write.write(page, made_content)
    assert mine.read_text() == "mine"


def test_a_folder_that_is_no_page_is_not_touched(refused, empty_board):
    mine = empty_board / "mine" / "index.html"
    mine.parent.mkdir()
    mine.write_text("mine")
    err = refused("site", "--board", empty_board, "--out", mine.parent)
    assert re.search(r"eigbench: .*mine exists and is no page of `eigbench site`, .* --out\n", err)
    assert mine.read_text() == "mine"


def test_scripts_that_were_not_bundled_are_one_line(refused, empty_board, tmp_path, monkeypatch):
    monkeypatch.setattr(bundle, "BUNDLE", tmp_path / "dist")
    err = refused("site", "--board", empty_board, "--out", tmp_path / "page")
    assert re.fullmatch(r"eigbench: .*dist has no index\.html: run `make page` .*\n", err)


@pytest.mark.parametrize(
    ("edit", "name"),
    [
        (lambda path: path.write_text("// another"), "src/dom.js"),
        (lambda path: path.write_text("// new"), "src/new.js"),
        (Path.unlink, "src/dom.js"),
    ],
    ids=["changed", "added", "removed"],
)
def test_scripts_of_other_sources_are_one_line(
    refused, bundled, empty_board, tmp_path, monkeypatch, edit, name
):
    page = tmp_path / "scripts"
    shutil.copytree(bundled.parent, page, ignore=shutil.ignore_patterns("node_modules"))
    monkeypatch.setattr(bundle, "BUNDLE", page / "dist")
    assert not bundle.stale()
    edit(page / name)
    err = refused("site", "--board", empty_board, "--out", tmp_path / "page")
    assert re.fullmatch(
        rf"eigbench: .*dist was not made from {name} as it is now: run `make page` .*\n", err
    )
    assert not (tmp_path / "page").exists()


def test_place_of_the_docs_is_checked_and_used(made_content):
    assert read(made_content, "data.js")["docs"] == "../docs/{}.md"
    assert read(write.files([], [], [], docs="/docs/{}/"), "data.js")["docs"] == "/docs/{}/"
    with pytest.raises(EigbenchError, match=r"--docs /docs/ must have \{\} where a name goes"):
        write.files([], [], [], docs="/docs/")
    with pytest.raises(EigbenchError, match=r"--code /code must have \{\} where a name goes"):
        write.files([], [], [], code="/code")


def test_place_of_the_docs_is_checked_before_the_scoring(
    refused, empty_board, tmp_path, monkeypatch
):
    monkeypatch.setattr(leaderboard, "read", lambda *_: pytest.fail("it was scored"))
    out = tmp_path / "page"
    err = refused("site", "--board", empty_board, "--out", out, "--docs", "/docs/")
    assert re.fullmatch(r"eigbench: --docs /docs/ must have \{\} .*\n", err)
    assert not out.exists()


def test_place_of_the_docs_is_seen_from_the_page(printed, bundled, empty_board, tmp_path):
    out = tmp_path / "a place" / "page"
    printed("site", "--board", empty_board, "--out", out)
    docs = read({"data.js": (out / "data.js").read_bytes()}, "data.js")["docs"]
    there = out / unquote(docs).format("metrics")
    assert there.resolve() == CHECKOUT / "docs" / "metrics.md"
    assert there.is_file()


def test_an_empty_board_is_a_page_that_says_so(bundled):
    content = write.files([], [], [])
    assert read(content, "data.js")["datasets"] == []
    assert set(content) == {*bundle.FILES, "data.js"}
