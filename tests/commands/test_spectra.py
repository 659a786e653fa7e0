"""``synthnet spectrum`` and ``synthnet certify`` on files."""

import csv
import json
import os
import re
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from evidence.operators import square
from evidence.thin_meshes import thin
from synthnet import terminal
from synthnet.commands.spectra import read_answer
from synthnet.mesh.reading import Reader
from synthnet.spectrum import Operator, compute
from tests.conftest import only_line


@pytest.fixture
def files(tmp_path):
    """A sphere as PLY, the same as STL, whose corners are apart, and a file that is none."""
    sphere = trimesh.creation.icosphere(subdivisions=2)
    paths = [tmp_path / name for name in ("a.ply", "b.stl", "c.obj")]
    for path in paths[:2]:
        sphere.export(path)
    paths[2].write_text("v nothing\n")
    return paths


def test_no_mesh_is_overwritten_by_its_spectrum(run, files):
    before = files[0].read_bytes()
    line = only_line(*run("spectrum", files[0], "--out", files[0]))
    assert line == f"synthnet: --out must end in .csv, got {files[0]}"
    assert files[0].read_bytes() == before


def test_a_place_that_cannot_be_written_is_named_before_the_work(run, files, monkeypatch):
    monkeypatch.setattr("synthnet.commands.spectra._result", None)
    line = only_line(*run("spectrum", files[0], "--out", "/proc/nowhere/spectra.csv"))
    assert line.startswith("synthnet: cannot write to /proc/nowhere (")


def test_spectra_that_cannot_be_written_are_shown(run, files, tmp_path):
    out = tmp_path / "spectra.csv"
    out.mkdir()
    code, table, err = run("spectrum", files[0], "--out", out)
    assert code == 2
    assert table.splitlines()[2].startswith("a.ply")
    assert "written to" not in table
    assert err == f"synthnet: cannot write {out} (Is a directory)\n"


def test_spectra_of_files_are_shown_written_and_certified(run, printed, files, tmp_path):
    out = tmp_path / "made" / "spectra.csv"
    code, table, err = run("spectrum", *files, "-k", 12, "--out", out)
    assert code == 2  # of the third; the others are kept
    assert "c.obj" in table
    assert "no spectrum" in table
    assert "merged vertices" in table
    assert "c.obj: line 1" in err
    sphere = trimesh.creation.icosphere(subdivisions=2)
    expected = compute(sphere, 12).eigenvalues
    header, *rows = out.read_text().splitlines()
    assert header.startswith("file,vertices,components,lambda_1,")
    assert header.endswith(",lambda_12,elements,mass,boundary")
    assert len(rows) == 2
    for row in rows:
        cells = row.split(",")
        np.testing.assert_allclose(np.array(cells[3:15], float), expected, rtol=1e-6)
        assert cells[15:] == ["linear", "consistent", "neumann"]
    for file in files[:2]:
        judged = printed("certify", file, out)
        assert judged.startswith("certified: 12 eigenvalues within 1e-06")
    (facts,) = json.loads(printed("spectrum", files[0], "--json"))
    assert facts["eigenvalues"] == pytest.approx(expected[:10].tolist(), rel=1e-6)
    assert max(facts["error_bound"]) < 1e-9


def test_files_have_other_operators(run, files, tmp_path):
    answer = tmp_path / "lumped.csv"
    assert run("spectrum", files[0], "-k", 5, "--mass", "lumped", "--out", answer)[0] == 0
    cells = answer.read_text().splitlines()[1].split(",")
    values = [float(value) for value in cells[3:8]]
    assert cells[8:] == ["linear", "lumped", "neumann"]
    expected = compute(trimesh.load(files[0]), 5, operator=Operator(mass="lumped")).eigenvalues
    np.testing.assert_allclose(values, expected, rtol=1e-9)
    assert only_line(*run("certify", files[0], answer)).endswith("give --mass lumped")
    assert run("certify", files[0], answer, "--mass", "lumped")[0] == 0
    code, _, err = run("spectrum", files[0], "--boundary", "dirichlet")
    assert code == 2
    assert "a.ply: the mesh is closed: it has no boundary" in err
    line = only_line(*run("spectrum", files[0], "--elements", "tufted", "--mass", "mean"))
    assert line == "synthnet: tufted elements have no mean mass: lumped only: leave --mass out"


def test_answers_name_their_operator(run, printed, files, tmp_path):
    answer = tmp_path / "answer.csv"
    options = ["--elements", "delaunay", "--mass", "mean"]
    expected = {"elements": "delaunay", "mass": "mean", "boundary": "neumann"}
    (facts,) = json.loads(printed("spectrum", files[0], *options, "--json", "--out", answer))
    assert facts["operator"] == expected
    (row,) = csv.DictReader(answer.read_text().splitlines())
    assert expected.items() <= row.items()
    judged = json.loads(printed("certify", files[0], answer, *options, "--json"))
    assert judged["operator"] == expected


def test_an_infinite_bound_is_null_in_json(run, tmp_path):
    thin = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1e-10 0\n0 1e-10 0\n3 0 1 2\n3 0 2 3\n"
    (tmp_path / "thin.off").write_text(thin)
    options = ["-k", 2, "--elements", "delaunay", "--no-repair", "--json"]
    code, printed, _ = run("spectrum", tmp_path / "thin.off", *options)
    assert code == 0
    (facts,) = json.loads(printed, parse_constant=pytest.fail)  # Infinity is none of JSON's
    assert facts["error_bound"] == [None, None]


def test_an_answer_is_judged(run, files, tmp_path):
    values = compute(trimesh.load(files[0]), 8).eigenvalues
    answer = tmp_path / "answer.csv"
    answer.write_text("eigenvalue\n" + "\n".join(map(str, [0.0, *np.delete(values, 1)])))
    code, printed, _ = run("certify", files[0], answer)
    assert code == 1
    assert printed.startswith("1 missed below ")
    answer.write_text(", ".join(map(str, values * 1.02)))
    code, printed, _ = run("certify", files[0], answer, "--json")
    assert code == 1
    assert [row["index"] for row in json.loads(printed)["off"]] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert run("certify", files[0], answer, "--tolerance", 0.05)[0] == 0


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("\ufeff1.5\n2.5\n", [1.5, 2.5]),
        ("\ufeff# two of them\r\n1.5, 2.5\r\n", [1.5, 2.5]),
        ('"eigenvalue"\n"1.5"\n2.5e0\n', [1.5, 2.5]),
        ("\ufefffile,lambda_1,lambda_2\nelsewhere/a.ply,1.5,2.5\n", [1.5, 2.5]),
        ("1.5 " * 50_000, [1.5] * 50_000),  # csv takes no field of so many characters
        # Of several columns that of the eigenvalues counts.
        ("index,eigenvalue\n1,2.5\n2,3.5\n", [2.5, 3.5]),
        ("Eigenvalue,error\n2.5,1e-3\n3.5,1e-3\n", [2.5, 3.5]),
        ("lambda_1,lambda_2\n2.5,3.5\n", [2.5, 3.5]),
        (",lambda_1,lambda_2\n0,2.5,3.5\n", [2.5, 3.5]),
        ("# index, of all\n2.5\n3.5\n", [2.5, 3.5]),
        ("# eigenvalues of a ball\n2.5, 3.5\n", [2.5, 3.5]),
        ("index eigenvalue\n1 2.5\n2 3.5\n", [2.5, 3.5]),
        ("# index\teigenvalue\n1\t2.5\n2\t3.5\n", [2.5, 3.5]),
        ("# index,eigenvalue\n1,2.5\n2,3.5\n", [2.5, 3.5]),
        ("k,lambda,error\n1,2.5,\n2,3.5,\n", [2.5, 3.5]),
        ("eigenvalue,\t\n2.5,\t\n\t\n3.5,\t\n", [2.5, 3.5]),
        ("eigenvalue,\u00a0\n2.5,\u00a0\n3.5,\u00a0\n", [2.5, 3.5]),
        ("file,lambda_1\nb/a.ply,9\na.ply,1.5\n", [1.5]),
        ("id, file, lambda_1, lambda_2\n0, a.ply, 1.5, 2.5\n", [1.5, 2.5]),
        ('"file", "vertices", "lambda_1"\n"a.ply", 42, 1.5\n', [1.5]),
        ("file,lambda_1,mass,boundary\na.ply,1.5,3.2,\n", [1.5]),  # in kilograms
    ],
)
def test_an_answer_is_read_whole(text, values, tmp_path):
    answer = tmp_path / "answer.csv"
    answer.write_bytes(text.encode())
    assert read_answer(answer, Path("a.ply"), Operator()).tolist() == values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no numbers"),
        ("names, only\n", "holds no numbers"),
        ("1.0\nabc\n", "row 2: 'abc' is no number"),
        ("2,01;2,01\n", "'01;2' is no number: separate numbers by commas or spaces"),
        ("eigenvalue\n\n1.0\nabc\n", "row 4: 'abc' is no number"),
        ("1.0, inf", "row 1: inf is not finite"),
        ("Infinity\n1.0\n", "row 1: Infinity is not finite"),
        ("2.046D0\n1.0\n", "row 1: '2.046D0' is no number"),
        ('"2,046"\n', "row 1: '2,046' is no number"),
        ('{"eigenvalues": [1.0]}', "is no number"),
        ("2" * 200_000, "222 is not finite"),
        ("file,lambda_1\na.ply,1\nb.ply,x\nc.ply," + "2" * 200_000, "is no table of `synthnet"),
        ("file,lambda_1\nb.ply,1\n\na.ply,x\n", "row 4: 'x' is no number"),
        ("file,lambda_1\nother.ply,2\n", "has 0 rows of a.ply, where one is needed"),
        ("file,lambda_1\nb/a.ply,1\nc/a.ply,2\n", "has 2 rows of a.ply, where one is needed: give"),
        (b"\xff\xfe", "is no text"),
        ("index,value\n1,2.5\n2,3.5\n", "several columns, index, value: name one 'eigenvalue'"),
        ("index,eigenvalue\n1,2.5\n3.5\n", "give each row a cell of every column"),
        (
            "file,lambda_1,elements,mass,boundary\na.ply,1,tufted,lumped,neumann\n",
            "row 2: eigenvalues of another operator: give --elements tufted --mass lumped",
        ),
    ],
)
def test_an_answer_that_cannot_be_read_is_one_line(text, message, run, files, tmp_path):
    answer = tmp_path / "answer.csv"
    answer.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert message in only_line(*run("certify", files[0], answer))


FLAT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"
FIN = "v 0 0 1\nf 2 3 5\n"  # a third triangle at the edge of the two


@pytest.mark.parametrize(
    ("text", "options", "helps"),
    [
        (FLAT + "v 9 9 9\n", [], True),  # a vertex without a triangle
        (FLAT + "f 1 2 2\n", [], True),
        (FLAT + FIN + "v 9 9 9\n", [], False),  # no surface, whatever is mended
        (FLAT, ["-k", 4], False),
        (FLAT + FIN + "v 9 9 9\n", ["--elements", "tufted"], True),
        (FLAT, ["--elements", "tufted", "-k", 4], False),
    ],
)
def test_repair_is_named_where_it_would_help_alone(text, options, helps, run, tmp_path):
    file = tmp_path / "flat.obj"
    file.write_text(text)
    code, _, err = run("spectrum", file, "--no-repair", "-k", 1, *options)
    assert code == 2
    assert err.startswith(f"synthnet: {file}: ")
    assert ("without --no-repair" in err) == helps
    assert "repair=True" not in err


def test_an_eigenvalue_that_rounding_has_spoilt_is_named_on_standard_error(run, tmp_path):
    file = tmp_path / "needles.off"
    needles = thin(10**-9.5, "needles", seed=0)
    trimesh.Trimesh(needles.vertices, needles.faces, process=False).export(file, digits=17)
    code, _, err = run("spectrum", file, "--no-repair", "-k", 4)
    assert code == 0
    (line,) = err.splitlines()
    assert line.startswith(f"synthnet: {file}: rounding on thin triangles may have moved λ1 = ")


@pytest.mark.parametrize("options", [[], ["--no-repair"]])
def test_all_eigenvalues_of_a_mesh_are_had_and_judged(options, run, files, tmp_path):
    n, answer = 162, tmp_path / "answer.csv"
    code, _, err = run("spectrum", files[0], "-k", n - 1, "--out", answer, *options)
    assert (code, err) == (0, "")
    values = answer.read_text().splitlines()[1].split(",")[3 : n + 2]
    answer.write_text("\n".join(["0", *values]))
    assert run("certify", files[0], answer, *options)[0] == 0
    code, _, err = run("spectrum", files[0], "-k", n, *options)
    assert code == 2
    assert err.endswith(
        f"k must be between 1 and {n - 1} for {n} vertices, got {n}: give -k {n - 1} at most\n"
    )


def test_quadratic_elements_have_more_eigenvalues_than_vertices(run, tmp_path):
    file = tmp_path / "flat.obj"
    file.write_text(FLAT)
    code, printed, err = run("spectrum", file, "-k", 8, "--elements", "quadratic", "--json")
    assert (code, err) == (0, "")
    assert len(json.loads(printed)[0]["eigenvalues"]) == 8  # of 4 vertices and 5 edges


def book():
    """Three squares that share an edge."""
    page = square(4)
    x, y, _ = page.vertices.T
    angles = 2 * np.pi * np.arange(3) / 3
    sheets = [np.stack([np.cos(a) * x, np.sin(a) * x, y], axis=1) for a in angles]
    faces = [page.faces + sheet * len(x) for sheet in range(3)]
    # Trimesh merges equal positions.
    return trimesh.Trimesh(np.concatenate(sheets), np.concatenate(faces))


def test_three_sheets_that_meet_have_one_tufted_spectrum_in_any_format(run, tmp_path):
    pytest.importorskip("robust_laplacian")
    spectra = {}
    for name in ("book.off", "book.stl"):
        book().export(tmp_path / name)
        code, printed, err = run("spectrum", tmp_path / name, "--elements", "tufted", "--json")
        assert (code, err) == (0, "")
        (spectra[name],) = json.loads(printed)
    assert spectra["book.off"]["repairs"] == {}
    assert spectra["book.stl"]["repairs"] == {"merged vertices": 3 * 96 - 65}
    assert spectra["book.stl"]["eigenvalues"] == pytest.approx(
        spectra["book.off"]["eigenvalues"], rel=1e-5
    )


def test_warnings_name_options(run, files, tmp_path):
    answer = tmp_path / "answer.csv"
    answer.write_text("1.0\n")
    for words in (["certify", files[1], answer], ["spectrum", files[1], "-k", 1]):
        _, _, err = run(*words, "--no-repair")
        assert "is a component by itself; without --no-repair they are joined\n" in err
        assert "UserWarning" not in err
    (tmp_path / "fans.obj").write_text(FLAT + "v 2 1 0\nv 2 2 0\nf 4 5 6\n")
    _, _, err = run("spectrum", tmp_path / "fans.obj", "-k", 1, "--no-repair")
    assert err.endswith("which is no surface; without --no-repair they are parted\n")
    book().export(tmp_path / "book.off")
    _, _, err = run("certify", tmp_path / "book.off", answer, "--no-repair")
    assert err.startswith(f"synthnet: {tmp_path / 'book.off'}: 4 edges have more than two faces")
    assert err.endswith(", --elements tufted takes the mesh as it is\n")


def test_a_refusal_of_no_manifold_names_the_elements_that_take_it(run, tmp_path):
    book().export(tmp_path / "book.off")
    code, _, err = run("spectrum", tmp_path / "book.off")
    assert code == 2
    assert "`synthnet import --cut-fins` may cut them, --elements tufted takes the mesh" in err


def test_a_k_that_no_file_has_costs_nothing(run, files, tmp_path):
    out, k = tmp_path / "spectra.csv", 10**15  # so many names fit in no memory
    code, table, err = run("spectrum", files[0], "-k", k, "--out", out)
    assert (code, err.count("k must be between 1 and")) == (2, 1)
    assert err.endswith(": give -k 161 at most\n")
    assert f"λ{k}" in table
    assert out.read_text() == "file,vertices,components,elements,mass,boundary\n"


def test_a_missing_mesh_is_one_line(run, files, tmp_path):
    answer = tmp_path / "answer.csv"
    answer.write_text("1.0\n")
    line = only_line(*run("certify", files[0].with_name("none.ply"), answer))
    assert f"there is no file {files[0].with_name('none.ply')}" in line
    code, _, err = run("spectrum", files[0].with_name("a.pyl"))  # whatever its name says
    assert (code, err.count("there is no file")) == (2, 1)
    assert err.endswith("did you mean a.ply?\n")


def test_a_name_that_is_not_utf8_loses_no_file(run, files, tmp_path):
    other = Path(os.fsdecode(os.fsencode(tmp_path) + b"/b\xff.ply"))
    other.write_bytes(files[0].read_bytes())
    out = tmp_path / "spectra.csv"
    assert run("spectrum", other, files[0], "--out", out)[0] == 0
    rows = list(csv.reader(out.read_text().splitlines()))
    assert [Path(row[0]).name for row in rows[1:]] == ["b\\udcff.ply", "a.ply"]
    assert rows[1][1:] == rows[2][1:]


def test_a_pipe_is_not_waited_for(run, tmp_path):
    os.mkfifo(tmp_path / "a.obj")
    code, _, err = run("spectrum", tmp_path / "a.obj")
    assert code == 2
    assert err.endswith("a.obj: a pipe or a device: save it to a file\n")


def test_a_file_that_cannot_be_looked_at_loses_no_other(run, files, tmp_path):
    code, table, err = run("spectrum", tmp_path / f"{'a' * 300}.obj", files[0])
    assert code == 2
    first, second = table.splitlines()[2:]
    assert first.endswith("no spectrum")
    assert second.startswith("a.ply")
    assert err.endswith("a.obj: cannot be opened (File name too long)\n")


def test_a_solve_that_memory_does_not_hold_loses_no_other_file(run, files, monkeypatch):
    def exhausted(mesh, *arguments, **options):
        raise MemoryError

    monkeypatch.setattr("synthnet.commands.spectra.compute", exhausted)
    code, table, err = run("spectrum", *files[:2])
    assert code == 2
    assert table.count("no spectrum") == 2
    assert err.count("out of memory: ") == 2


def interrupting(method, name):
    """Return a method of reading that is interrupted, as by Ctrl-C, at a file's name."""

    def read(reader, file):
        if file.name == name:
            raise KeyboardInterrupt
        return method(reader, file)

    return read


@pytest.mark.parametrize(("stopped", "kept"), [("b.stl", 1), ("a.ply", 0)])
def test_an_interrupt_loses_no_finished_spectrum(stopped, kept, run, files, tmp_path, monkeypatch):
    monkeypatch.setattr(Reader, "triangles", interrupting(Reader.triangles, stopped))
    out, partial = tmp_path / "spectra.csv", tmp_path / "spectra.partial.csv"
    out.write_text("a whole table of an earlier run")
    code, table, err = run("spectrum", *files[:2], "--out", out)
    assert code == 130
    assert err == "synthnet: interrupted\n"
    assert table.count("a.ply") == kept
    assert out.read_text() == "a whole table of an earlier run"
    assert partial.exists() == bool(kept)
    assert (f"written to {partial}: 1 of 2 files" in table) == bool(kept)
    if kept:
        rows = csv.DictReader(partial.read_text().splitlines())
        assert [row["file"] for row in rows] == [str(files[0])]


def test_a_log_says_which_file_it_is_at(run, files, monkeypatch):
    def slow(reader, file):
        time.sleep(0.3)
        return read(reader, file)

    read = Reader.triangles
    monkeypatch.setattr(Reader, "triangles", slow)
    monkeypatch.setattr(terminal, "LOGGED", 0.1)
    _, _, err = run("spectrum", *files[:2])
    assert list(dict.fromkeys(err.splitlines())) == ["a.ply (1 of 2)", "b.stl (2 of 2)"]


def test_polygons_that_were_cut_by_ears_are_a_repair_as_in_an_import(run, tmp_path):
    arrow = tmp_path / "arrow.obj"
    arrow.write_text("v 0 0 0\nv 1 0 0\nv .3 .3 0\nv 0 1 0\nf 2 3 4 1\n")
    for options in ([], ["--no-repair"], ["--elements", "tufted"]):
        _, out, _ = run("spectrum", arrow, "-k", 2, "--json", *options)
        assert json.loads(out)[0]["repairs"] == {"clipped polygons": 1}


def test_vertices_of_no_triangle_are_left_out_of_tufted_elements(run, printed, tmp_path):
    flat, loose = tmp_path / "flat.obj", tmp_path / "loose.obj"
    flat.write_text(FLAT + FIN)
    loose.write_text(FLAT + FIN + "v 9 9 9\n")
    how = ["-k", 3, "--elements", "tufted", "--json"]
    one, other = json.loads(printed("spectrum", flat, loose, *how))
    assert one["eigenvalues"] == other["eigenvalues"]
    assert (one["repairs"], other["repairs"]) == ({}, {"loose vertices": 1})


@pytest.mark.parametrize("tolerance", ["-1", "0", "nan", "0.6", "inf"])
def test_a_tolerance_that_is_none_is_not_said_of_the_mesh(tolerance, run, files, tmp_path):
    line = only_line(*run("certify", files[0], tmp_path / "none.csv", "--tolerance", tolerance))
    assert re.search(f"argument --tolerance: must be (above 0|at most 0.5), got {tolerance}", line)


def test_certify_has_the_remedies_of_the_command(run, tmp_path):
    loose, answer = tmp_path / "loose.obj", tmp_path / "answer.csv"
    loose.write_text(FLAT + "v 9 9 9\n")
    answer.write_text("1.0\n")
    line = only_line(*run("certify", loose, answer, "--no-repair"))
    remedy = "without --no-repair what can be mended is"
    assert line == f"synthnet: {loose}: 1 vertices belong to no triangle; {remedy}"
