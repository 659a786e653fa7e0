import ast
from collections.abc import Iterator
from pathlib import Path

import eigbench
import pytest

import synthnet

ROOT = Path(synthnet.__file__).parent
# A room imports rooms of lower levels only, but level 0, whose rooms import each other.
LEVELS = {
    **dict.fromkeys(
        [
            "errors",
            "types",
            "version",
            "versions",
            "_open3d",
            "distributions",
            "files",
            "formats",
            "interrupts",
            "workers",
            "recipe",
            "storage",
            "geometry",
            "limits",
            "raster",
            "solver",
        ],
        0,
    ),
    **dict.fromkeys(
        ["families", "filters", "repair", "reading", "spectrum", "augment", "splits", "store"], 1
    ),
    **dict.fromkeys(["plan", "pins", "draw", "discretisation", "croissant"], 2),
    **dict.fromkeys(["build", "gallery"], 3),
    **dict.fromkeys(["mapped", "hf", "estimates", "importing", "seal"], 4),
    **dict.fromkeys(["pyg", "verify", "__init__"], 5),
    **dict.fromkeys(["report", "unseal"], 6),
    **dict.fromkeys(["seal_commands", "show_commands"], 7),
    "cli": 8,
    "__main__": 9,
}
# In a notebook a mesh and a sample draw themselves, when they are shown and not before.
UPWARDS = {("types", "draw")}
MODULES = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.py"))


EIGBENCH = Path(eigbench.__file__).parent
# The same for the benchmark: a module imports modules of lower levels only.
EIGBENCH_LEVELS = {
    **dict.fromkeys(["__init__", "scaling.__init__", "site.__init__"], 0),
    **dict.fromkeys(["errors", "markdown", "metrics", "training"], 0),
    **dict.fromkeys(["losses", "truth", "meshes", "predictor", "physics", "reference"], 1),
    "scaling.surfaces": 1,
    **dict.fromkeys(["predictions", "scores", "noise", "results", "worker"], 2),
    **dict.fromkeys(["process", "submission", "tables"], 3),
    **dict.fromkeys(["evaluate", "ranking", "scaling.results"], 4),
    **dict.fromkeys(["record", "generalisation", "page", "scaling.scores"], 5),
    **dict.fromkeys(["figures", "scaling.run"], 6),
    **dict.fromkeys(["scaling.figure", "error_figures"], 7),
    "scaling.page": 8,
    "leaderboard": 9,
    **dict.fromkeys(["site.bundle", "site.columns", "site.shapes"], 10),
    **dict.fromkeys(["site.boards", "site.rows", "site.scaling"], 11),
    "site.write": 12,
    **dict.fromkeys(["predictor_commands", "board_commands", "scaling.commands"], 13),
    "cli": 14,
    "__main__": 15,
}


def room_of(file: str) -> str:
    return file.split("/")[0].removesuffix(".py")


def imports_of(file: str, root: Path = ROOT) -> Iterator[str]:
    """Full names of what a file imports anywhere, in functions too."""
    for node in ast.walk(ast.parse((root / file).read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_every_module_has_a_level_and_every_level_a_module() -> None:
    assert {room_of(file) for file in MODULES} == set(LEVELS)


@pytest.mark.parametrize("file", MODULES)
def test_rooms_import_lower_rooms_only(file: str) -> None:
    room = room_of(file)
    for name in imports_of(file):
        package, *rest = name.split(".")
        if package == "synthnet":
            if (room, rest[0]) in UPWARDS:
                continue
            level = LEVELS[rest[0]]
            assert level < LEVELS[room] or level == 0 or rest[0] == room, f"imports {name}"


@pytest.mark.parametrize("file", MODULES)
def test_only_pyg_imports_torch_and_none_the_benchmark(file: str) -> None:
    packages = {name.split(".")[0] for name in imports_of(file)}
    assert file == "pyg.py" or not packages & {"torch", "torch_geometric"}
    assert not packages & {"eigbench", "baselines", "benchmark"}


def test_every_module_of_the_benchmark_has_a_level() -> None:
    names = (path.relative_to(EIGBENCH).with_suffix("") for path in EIGBENCH.rglob("*.py"))
    assert {".".join(name.parts) for name in names} == set(EIGBENCH_LEVELS)


def of_the_benchmark(module: str) -> Iterator[tuple[str, str]]:
    """Packages that a module of the benchmark imports, with the module if it is one of its own."""
    for name in imports_of(f"{module.replace('.', '/')}.py", EIGBENCH):
        package, *rest = name.split(".")
        inner = rest[0] if rest and rest[0] not in ("scaling", "site") else ".".join(rest[:2])
        yield package, inner if package == "eigbench" else ""


@pytest.mark.parametrize("module", EIGBENCH_LEVELS)
def test_modules_of_the_benchmark_import_lower_ones_and_never_the_baselines(module: str) -> None:
    for package, inner in of_the_benchmark(module):
        assert package != "baselines"
        if package == "eigbench":
            assert EIGBENCH_LEVELS[inner] < EIGBENCH_LEVELS[module], f"imports {inner}"
        if package in ("torch", "torch_geometric"):
            assert module in ("losses", "predictor", "worker")


def reached(module: str) -> set[str]:
    """Modules of the benchmark that a module imports, and those that these import."""
    found, left = set(), [module]
    while left:
        for package, inner in of_the_benchmark(left.pop()):
            if package == "eigbench" and inner not in found:
                found.add(inner)
                left.append(inner)
    return found


def test_nothing_past_a_result_can_run_a_predictor() -> None:
    running = {"predictor", "worker", "process", "evaluate"}
    assert reached("predictor_commands") >= running
    assert reached("scaling.commands") >= running - {"evaluate"}
    assert not reached("board_commands") & running
