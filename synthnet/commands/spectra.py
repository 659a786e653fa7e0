"""``synthnet spectrum`` and ``synthnet certify``: spectra of mesh files, and judgements of them."""

import argparse
import csv
import io
import math
import re
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tabulate import tabulate

from synthnet import terminal
from synthnet.arrays import Floats
from synthnet.errors import SpectrumError, SynthNetError, counted, missing, printable
from synthnet.mesh.formats import SUFFIXES, UnreadableError, kind_of
from synthnet.mesh.geometry import MeshFacts
from synthnet.mesh.reading import Reader
from synthnet.mesh.repair import Refused, Repaired, welded, without_loose_vertices
from synthnet.spectrum import Operator, certify, compute, discretise, repaired
from synthnet.spectrum.fem import REMEDY
from synthnet.spectrum.operators import BOUNDARIES, MASSES, SHARES
from synthnet.spectrum.sheets import JOINED, PARTED
from synthnet.spectrum.verdict import LOOSEST
from synthnet.store.files import make_parent, write_text
from synthnet.terminal import Commands, above_zero, at_least, print_json
from synthnet.types import Mesh, Spectrum

VALUES = ("eigenvalue", "eigenvalues", "lambda", "λ")  # the name of their column
SHOWN = 6  # so many eigenvalues fit in a row of the terminal
NUMBER = re.compile(r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|nan|inf(?:inity)?)", re.IGNORECASE)
CELL = re.compile(r'"[^"]*"|[^\s,]+')  # no field of csv, which may have 131,072 characters at most
BESIDE = ' \t"'  # what may stand beside the words of a cell
FORMATS = f"a mesh: {', '.join(SUFFIXES)}, or one of these .gz"


class AnswerError(SynthNetError):
    """A file of eigenvalues cannot be read, or does not say which are those of a mesh."""


class OperatorError(SynthNetError):
    """These elements have no such mass matrix."""


@dataclass(frozen=True, slots=True)
class FileSpectrum:
    """The spectrum of a file's mesh, or why it has none."""

    file: Path
    spectrum: Spectrum | None = None
    vertices: int = 0
    repairs: Mapping[str, int] = field(default_factory=dict)
    problem: str = ""
    warnings: tuple[str, ...] = ()


def add(commands: Commands) -> None:
    """Add the commands."""
    sub = terminal.add_command(
        commands,
        "spectrum",
        run_spectrum,
        "compute the certified spectra of mesh files",
        "bunny.ply cow.obj -k 50 --out spectra.csv",
    )
    sub.add_argument("files", nargs="+", type=Path, metavar="FILE", help=FORMATS)
    sub.add_argument(
        "-k",
        type=at_least(1),
        default=10,
        metavar="K",
        help="eigenvalues after the zeros (default: %(default)s)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="CSV",
        help="write all of them here, one row per file (default: only print the first)",
    )
    _of_mesh_options(sub)
    sub = terminal.add_command(
        commands,
        "certify",
        run_certify,
        "judge the eigenvalues that another solver gave for a mesh file",
        "bunny.ply answer.csv --tolerance 1e-4",
    )
    sub.add_argument("mesh", type=Path, metavar="FILE", help=FORMATS)
    sub.add_argument(
        "answer",
        type=Path,
        metavar="CSV",
        help="its eigenvalues: numbers, or what `synthnet spectrum --out` writes",
    )
    sub.add_argument(
        "--tolerance",
        type=_tolerance,
        default=1e-6,
        metavar="T",
        help="relative distance within which an eigenvalue is right (default: %(default)g)",
    )
    _of_mesh_options(sub)


def _tolerance(text: str) -> float:
    """Return a tolerance of the command line."""
    value = above_zero(text)
    if value > LOOSEST:
        raise argparse.ArgumentTypeError(f"must be at most {LOOSEST}, got {value:g}")
    return value


_tolerance.__name__ = "float"  # argparse's name for what is no number at all


def _of_mesh_options(command: argparse.ArgumentParser) -> None:
    """Add what both commands can be told about the mesh and its operator."""
    command.add_argument(
        "--boundary",
        choices=BOUNDARIES,
        default="neumann",
        help="condition on the whole boundary (default: %(default)s)",
    )
    command.add_argument(
        "--mass",
        choices=tuple(SHARES),
        help="mass matrix; mean is the average of the other two (default: consistent, lumped for "
        "tufted)",
    )
    command.add_argument(
        "--elements",
        choices=tuple(MASSES),
        default="linear",
        help="finite elements; curved: on triangles bent to the surface that the mesh samples; "
        "tufted: for non-manifold meshes, taken as they are, but for the corners of STL "
        "(default: %(default)s)",
    )
    command.add_argument(
        "--no-repair",
        dest="repair",
        action="store_false",
        help="take the triangles as they stand in the file (default: repaired as `synthnet import` "
        "does, which the table says)",
    )


def run_spectrum(options: argparse.Namespace) -> int:
    """Compute spectra, print their table and write them."""
    if options.out is not None and options.out.suffix != ".csv":
        raise AnswerError(f"--out must end in .csv, got {options.out}")
    operator = _operator(options)
    if options.out is not None:
        make_parent(options.out)
    results: list[FileSpectrum] = []
    try:
        results.extend(_results(options, operator))
    except KeyboardInterrupt:  # what is finished is kept, and a whole table of an earlier run
        if results:
            out = options.out and options.out.with_suffix(".partial.csv")
            _finish(results, options, operator, out)
        raise
    _finish(results, options, operator, options.out)
    return terminal.WRONG_INPUT if any(result.problem for result in results) else 0


def _results(options: argparse.Namespace, operator: Operator) -> Iterator[FileSpectrum]:
    """Yield the spectrum of each file, and show how far it is."""
    with Reader() as reader, terminal.at_work() as say:
        for number, file in enumerate(options.files, start=1):
            say(f"{printable(file.name)} ({number} of {len(options.files)})")
            yield _result(reader, file, options.k, operator, mended=options.repair)


def _finish(
    results: list[FileSpectrum], options: argparse.Namespace, operator: Operator, out: Path | None
) -> None:
    """Write the spectra to a file, if one is wanted, and print their table."""
    written = ""
    try:
        if out is not None:
            write_text(out, _as_csv(results, options.k, operator))
            count = f"{len(results)} of {counted(len(options.files), 'file')}"
            written = f"\n\nwritten to {out}{'' if out == options.out else f': {count}'}"
    finally:  # the work is shown, though the disk may be full
        _print(results, options, operator, written)


def _print(
    results: list[FileSpectrum], options: argparse.Namespace, operator: Operator, written: str
) -> None:
    """Print the table, and what there is to say of each file."""
    facts = [_facts(result, operator) for result in results]
    terminal.print_answer(options, facts, _table(results, options.k) + written)
    for result in results:
        if result.spectrum is not None and result.spectrum.components > 1:
            print(_of_components(result.file, result.spectrum.components), file=sys.stderr)
        for message in (*result.warnings, *filter(None, [result.problem])):
            print(f"synthnet: {_as_utf8(result.file)}: {message}", file=sys.stderr)


def run_certify(options: argparse.Namespace) -> int:
    """Judge an answer: exit code 0 if it is certified, 1 if not."""
    operator = _operator(options)
    answer = read_answer(options.answer, options.mesh, operator)
    with Reader() as reader, terminal.at_work() as say:
        say(f"counting eigenvalues of {options.mesh}")
        try:
            state = _mesh(reader, options.mesh, operator, mended=options.repair)
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always")
                verdict = certify(
                    state.mesh, answer, tolerance=options.tolerance, operator=operator
                )
            pieces = MeshFacts(state.mesh).n_components
        except (UnreadableError, Refused, SpectrumError) as error:
            raise AnswerError(f"{options.mesh}: {error}") from error
        except ValueError as error:
            hint = _hint(state.mesh, options.mesh, operator, mended=options.repair)
            said = f"{options.mesh}: {_by_command(str(error))}{hint}"
            raise AnswerError(said) from error
    if options.json:
        print_json(
            {
                "certified": verdict.certified,
                "tolerance": verdict.tolerance,
                "asked": verdict.asked,
                "zeros": verdict.zeros,
                "components": pieces,
                "shift": verdict.shift,
                "count": verdict.count,
                "missed": list(verdict.missed),
                "off": [
                    {"index": i, "answer": float(verdict.eigenvalues[i - 1]), "eigenvalue": true}
                    for i, true in verdict.off
                ],
                "repairs": state.repairs,
                "operator": _named(operator),
            }
        )
    else:
        print(verdict)
        if pieces > 1:
            print(_of_components(options.mesh, pieces))
        if state.repairs:
            print(f"of the mesh as repaired: {_said(state.repairs)}")
    for message in _by_options(warned):
        print(f"synthnet: {_as_utf8(options.mesh)}: {message}", file=sys.stderr)
    return 0 if verdict.certified else 1


def _of_components(file: Path, count: int) -> str:
    name = _as_utf8(file)
    return f"synthnet: {name} has {count:,} components, whose zero eigenvalues are left out"


def _mesh(reader: Reader, file: Path, operator: Operator, *, mended: bool) -> Repaired:
    """Read a mesh, and repair it if that is wanted.

    Tufted elements take a mesh that is no manifold, so of theirs only vertices without a triangle
    are left out, and an STL file's corners merged: no two of its triangles share one.
    """
    try:
        there, directory, other = file.exists(), file.is_dir(), not file.is_file()
    except OSError as error:  # a name that is too long, a folder that may not be entered
        raise UnreadableError(f"cannot be opened ({error.strerror})") from error
    if not there:
        raise UnreadableError(missing(file))
    if directory:
        raise UnreadableError("a directory: name files, or `synthnet import` it")
    if other:
        raise UnreadableError("a pipe or a device: save it to a file")
    read = reader.triangles(file)
    mesh = Mesh(read.vertices, read.faces)
    state = _mended(mesh, file, operator) if mended else Repaired(mesh)
    clipped = {"clipped polygons": read.clipped} if read.clipped else {}
    return replace(state, repairs=clipped | state.repairs)


def _mended(mesh: Mesh, file: Path, operator: Operator) -> Repaired:
    """Repair what was read of a file as its operator needs it."""
    if operator.elements == "tufted":
        soup = (kind_of(file.name) or "").startswith(".stl")
        return welded(mesh) if soup else without_loose_vertices(Repaired(mesh))
    try:
        return repaired(mesh)
    except Refused as error:
        if error.reason != "non_manifold_edge":
            raise
        detail = f"{error.detail}, --elements tufted takes the mesh as it is"
        raise Refused(error.reason, detail) from error


def _hint(mesh: Mesh, file: Path, operator: Operator, *, mended: bool) -> str:
    """Return that a repair would help a mesh that is taken as it stands; empty if it would not."""
    helps = not mended and _would_mend(mesh, file, operator)
    return "; without --no-repair what can be mended is" if helps else ""


def _would_mend(mesh: Mesh, file: Path, operator: Operator) -> bool:
    """Return whether a mesh has no such operator as it stands, and has it when it is repaired."""
    with warnings.catch_warnings(action="ignore"):
        try:
            discretise(mesh, operator)
        except ValueError:
            try:
                discretise(_mended(mesh, file, operator).mesh, operator)
            except (ValueError, Refused):
                return False
            return True
    return False


def _operator(options: argparse.Namespace) -> Operator:
    try:
        return Operator(options.boundary, options.mass, options.elements)
    except ValueError as error:
        raise OperatorError(f"{error}: leave --mass out") from error


def _result(
    reader: Reader, file: Path, k: int, operator: Operator, *, mended: bool
) -> FileSpectrum:
    """Compute a spectrum; whatever keeps it from having one is said."""
    try:
        return _solved(reader, file, k, operator, mended=mended)
    except (UnreadableError, Refused, SpectrumError, MemoryError) as error:
        return FileSpectrum(file, problem=terminal.in_words(error))


def _solved(
    reader: Reader, file: Path, k: int, operator: Operator, *, mended: bool
) -> FileSpectrum:
    """Compute a spectrum, or say what is wrong with k, the mesh or the operator."""
    state = _mesh(reader, file, operator, mended=mended)
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            spectrum = compute(
                state.mesh, k, operator=operator, sharp=operator.elements == "linear"
            )
    except ValueError as error:
        hint = _hint(state.mesh, file, operator, mended=mended)
        return FileSpectrum(file, problem=f"{_by_command(str(error))}{hint}")
    vertices = len(state.mesh.vertices)
    return FileSpectrum(file, spectrum, vertices, state.repairs, warnings=_by_options(warned))


def _by_options(warned: list[warnings.WarningMessage]) -> tuple[str, ...]:
    """Return warnings that name options of the command, where those of Python name arguments."""
    return tuple(
        str(warning.message)
        .replace(JOINED, "without --no-repair they are joined")
        .replace(PARTED, "without --no-repair they are parted")
        .replace('compute with Operator(elements="tufted")', "--elements tufted")
        for warning in warned
    )


def _by_command(message: str) -> str:
    """Return what is wrong with a mesh, with the remedy of the command in place of Python's."""
    message = message.replace(f": {REMEDY}", "")
    if bound := re.match(r"k must be between 1 and (\d+) for ", message):
        message += f": give -k {bound[1]} at most"
    return message


def _as_utf8(path: Path | str) -> str:
    """Return a path as UTF-8 has it, with bytes that are none escaped."""
    return str(path).encode("utf-8", "backslashreplace").decode()


def _said(repairs: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in repairs.items())


def _named(operator: Operator) -> dict[str, str]:
    """Return what an operator of the command is called."""
    return {name: str(getattr(operator, name)) for name in ("elements", "mass", "boundary")}


def _facts(result: FileSpectrum, operator: Operator) -> dict[str, object]:
    """Return what is known of a file, for JSON."""
    if result.spectrum is None:
        return {"file": str(result.file), "problem": result.problem}
    certificate = result.spectrum.certificate
    bound = certificate.error_bound
    return {
        "file": str(result.file),
        "vertices": result.vertices,
        "components": result.spectrum.components,
        "eigenvalues": result.spectrum.eigenvalues.tolist(),
        "error_bound": None if bound is None else bound.tolist(),
        "count": certificate.count,
        "shift": certificate.shift,
        "repairs": result.repairs,
        "operator": _named(operator),
    }


def _table(results: list[FileSpectrum], k: int) -> str:
    shown = min(k, SHOWN)
    rows = []
    for result in results:
        if result.spectrum is None:
            rows.append(
                [_as_utf8(result.file.name), "", "", *[""] * (shown + (k > shown)), "no spectrum"]
            )
            continue
        values = [f"{value:.6g}" for value in result.spectrum.eigenvalues]
        shortened = values if k == shown else [*values[: shown - 1], "…", values[-1]]
        facts = [f"{result.vertices:,}", str(result.spectrum.components)]
        rows.append([_as_utf8(result.file.name), *facts, *shortened, _said(result.repairs)])
    names = [f"λ{i}" for i in range(1, shown + 1)]
    names = names if k == shown else [*names[:-1], "", f"λ{k}"]
    headers = ["file", "vertices", "components", *names, "repaired"]
    return str(tabulate(rows, headers=headers, disable_numparse=True))


def _as_csv(results: list[FileSpectrum], k: int, operator: Operator) -> str:
    """Return one row per file: its vertices, components, eigenvalues to the last digit, operator.

    The columns of the operator are the last, so that eigenvalues stay where they always were. If no
    file has a spectrum, there are no columns of eigenvalues: k may be too large for any.
    """
    count = k if any(result.spectrum is not None for result in results) else 0
    names, text = _named(operator), io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    values = [f"lambda_{i}" for i in range(1, count + 1)]
    writer.writerow(["file", "vertices", "components", *values, *names])
    for result in results:
        if result.spectrum is not None:
            facts = [_as_utf8(result.file), result.vertices, result.spectrum.components]
            values = [repr(value) for value in result.spectrum.eigenvalues.tolist()]
            writer.writerow([*facts, *values, *names.values()])
    return text.getvalue()


def read_answer(path: Path, mesh: Path, operator: Operator) -> Floats:
    """Return the eigenvalues of a file.

    Numbers stand on lines or between commas, one line of names may come first. In a table with the
    columns ``file`` and ``lambda_1`` and so on, the row of the mesh counts; of columns with other
    names, the one that is named ``eigenvalue``. Raise AnswerError if the file cannot be read, holds
    no numbers, or no row of the mesh, or if that row names another operator.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise AnswerError(missing(path)) from error
    except OSError as error:
        raise AnswerError(f"{path} cannot be opened ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise AnswerError(f"{path} is no text: give numbers as CSV") from error
    rows = [(number, CELL.findall(line)) for number, line in enumerate(text.split("\n"), start=1)]
    rows = [(number, cells) for number, cells in rows if cells]
    first = text.strip().partition("\n")[0]
    names = [name.strip(BESIDE) for name in first.split(",")]
    if "file" in names and "lambda_1" in names:
        rows = [_of_mesh(text, mesh, path, operator)]
    elif _are_names(names):
        if len(names) > 1:  # an empty cell between commas is one
            split = [(number, line.split(",")) for number, line in enumerate(text.split("\n"), 1)]
            rows = [(n, [cell.strip() for cell in cells]) for n, cells in split]
            rows = [(n, cells) for n, cells in rows if any(cells)]
        else:
            names = CELL.findall(first)
        rows = _of_column([name.lstrip("# ") for name in names if name != "#"], rows[1:], path)
    values = list(_numbers(rows, path))
    if not values:
        raise AnswerError(f"{path} holds no numbers: give eigenvalues, one a line or by commas")
    return np.array(values)


def _of_column(
    names: list[str], rows: list[tuple[int, list[str]]], path: Path
) -> list[tuple[int, list[str]]]:
    """Return the cells of the column of eigenvalues; of one series of names, as λ1 and λ2, all.

    A line of words above a single column or a single row is no names of columns.
    """
    series = [i for i, name in enumerate(names) if re.fullmatch(r"(?i)(lambda|λ)_?\d+", name)]
    if series and all(len(cells) == len(names) for _, cells in rows):
        return [(number, [cells[i] for i in series]) for number, cells in rows]
    if len(rows) < 2 or all(len(cells) == 1 for _, cells in rows):
        return rows
    mine = [i for i, name in enumerate(names) if name.lower() in VALUES]
    if len(mine) != 1 or any(len(cells) != len(names) for _, cells in rows):
        raise AnswerError(
            f"{path} has rows of several columns, {', '.join(names)}: name one 'eigenvalue', and "
            "give each row a cell of every column"
        )
    return [(number, cells[mine[0] : mine[0] + 1]) for number, cells in rows]


def _are_names(cells: list[str]) -> bool:
    """Return whether a line's cells are names: words, or a comment; no numbers written otherwise.

    Examples
    --------
    >>> [_are_names([cell]) for cell in ("eigenvalue", "# 5 of them", "2.0D0", "Infinity")]
    [True, True, False, False]
    """
    words = [cell.split()[0] for cell in cells if cell.strip()]
    named = [word[0].isalpha() and not NUMBER.fullmatch(word) for word in words]
    return bool(words) and (words[0].startswith("#") or all(named))


def _of_mesh(text: str, mesh: Path, path: Path, operator: Operator) -> tuple[int, list[str]]:
    """Return the eigenvalues in a mesh's row of a table, and the number of its line.

    Of several rows with the mesh's name, that of its very path is its own.
    """
    reader = csv.reader(io.StringIO(text))
    try:
        names, *rows = [(reader.line_num, row) for row in reader if row]
    except csv.Error as error:
        raise AnswerError(f"{path} is no table of `synthnet spectrum --out` ({error})") from error
    header = [name.strip(BESIDE) for name in names[1]]
    columns = [i for i, name in enumerate(header) if name.startswith("lambda_")]
    file = header.index("file")
    whole = [(line, row) for line, row in rows if len(row) == len(header)]
    named = [(line, row) for line, row in whole if _is_named(row[file], mesh)]
    mine = [(line, row) for line, row in named if row[file] == _as_utf8(mesh)] or named
    if len(mine) != 1:
        which = ": give the path that stands in one of them" if mine else ""
        raise AnswerError(f"{path} has {len(mine)} rows of {mesh.name}, where one is needed{which}")
    ((line, row),) = mine
    of = dict(zip(header, (cell.strip(BESIDE) for cell in row), strict=True))
    known = {"elements": set(MASSES), "mass": set(SHARES), "boundary": set(BOUNDARIES)}
    asked = _named(operator)
    others = [f"--{o} {of[o]}" for o in known if of.get(o) in known[o] and of[o] != asked[o]]
    if others:
        raise AnswerError(
            f"{path}, row {line}: eigenvalues of another operator: give {' '.join(others)}"
        )
    return line, [row[i] for i in columns]


def _is_named(cell: str, mesh: Path) -> bool:
    """Return whether the last part of a cell's path is a mesh's name."""
    return Path(cell.strip(BESIDE)).name == _as_utf8(mesh.name).strip(BESIDE)


def _numbers(rows: list[tuple[int, list[str]]], path: Path) -> Iterator[float]:
    for number, cells in rows:
        for word in " ".join(cell.strip('"') for cell in cells).split():
            if not NUMBER.fullmatch(word):
                hint = ": separate numbers by commas or spaces" if ";" in word else ""
                raise AnswerError(f"{path}, row {number}: {word[:40]!r} is no number{hint}")
            if not math.isfinite(value := float(word)):
                raise AnswerError(f"{path}, row {number}: {word[:40]} is not finite")
            yield value
