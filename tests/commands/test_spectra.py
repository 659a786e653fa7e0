"""``synthnet spectrum`` and ``synthnet certify`` on files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from synthnet.commands import cli
from synthnet.commands.spectra import read_answer
from synthnet.spectrum import Operator, compute

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs the command line: exit code, stdout and stderr."""

    def command(*words: object) -> tuple[int, str, str]:
        code = cli.main([str(word) for word in words])
        out, err = capsys.readouterr()
        return code, out, err

    return command


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """A sphere as PLY, the same as STL, whose corners are apart, and a file that is none."""
    sphere = trimesh.creation.icosphere(subdivisions=2)
    paths = [tmp_path / name for name in ("a.ply", "b.stl", "c.obj")]
    for path in paths[:2]:
        sphere.export(path)
    paths[2].write_text("v nothing\n")
    return paths


def test_spectra_of_files_are_shown_written_and_certified(
    run: Run, files: list[Path], tmp_path: Path
) -> None:
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
    assert len(rows) == 2
    for row in rows:
        np.testing.assert_allclose(np.array(row.split(",")[3:], float), expected, rtol=1e-6)
    for file in files[:2]:
        code, printed, _ = run("certify", file, out)
        assert code == 0
        assert printed.startswith("certified: 12 eigenvalues within 1e-06")
    code, printed, _ = run("spectrum", files[0], "--json")
    (facts,) = json.loads(printed)
    assert code == 0
    assert facts["eigenvalues"] == pytest.approx(expected[:10].tolist(), rel=1e-6)
    assert max(facts["error_bound"]) < 1e-9


def test_files_have_other_operators(run: Run, files: list[Path], tmp_path: Path) -> None:
    answer = tmp_path / "lumped.csv"
    code, _, _ = run("spectrum", files[0], "-k", 5, "--mass", "lumped", "--out", answer)
    assert code == 0
    values = [float(value) for value in answer.read_text().splitlines()[1].split(",")[3:]]
    expected = compute(trimesh.load(files[0]), 5, operator=Operator(mass="lumped")).eigenvalues
    np.testing.assert_allclose(values, expected, rtol=1e-9)
    assert run("certify", files[0], answer)[0] == 1
    assert run("certify", files[0], answer, "--mass", "lumped")[0] == 0
    code, _, err = run("spectrum", files[0], "--boundary", "dirichlet")
    assert code == 2
    assert "a.ply: the mesh is closed: it has no boundary" in err
    code, _, err = run("spectrum", files[0], "--elements", "tufted", "--mass", "mean")
    assert code == 2
    assert err == "synthnet: tufted elements have no mean mass: lumped only: leave --mass out\n"


def test_an_answer_is_judged(run: Run, files: list[Path], tmp_path: Path) -> None:
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
    ],
)
def test_an_answer_is_read_whole(text: str, values: list[float], tmp_path: Path) -> None:
    answer = tmp_path / "answer.csv"
    answer.write_bytes(text.encode())
    assert read_answer(answer, Path("a.ply")).tolist() == values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no numbers"),
        ("names, only\n", "holds no numbers"),
        ("1.0\nabc\n", "row 2: 'abc' is no number"),
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
        (b"\xff\xfe", "is no text"),
    ],
)
def test_an_answer_that_cannot_be_read_is_one_line(
    text: str | bytes, message: str, run: Run, files: list[Path], tmp_path: Path
) -> None:
    answer = tmp_path / "answer.csv"
    answer.write_bytes(text if isinstance(text, bytes) else text.encode())
    code, out, err = run("certify", files[0], answer)
    assert code == 2
    assert out == ""
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_mesh_as_it_stands_says_what_would_mend_it(run: Run, files: list[Path]) -> None:
    code, _, err = run("spectrum", files[1], "--no-repair", "-k", 3)
    assert code == 0 or "without --no-repair it may be mended" in err
    code, _, err = run("certify", files[0].with_name("none.ply"), files[2])
    assert code == 2
