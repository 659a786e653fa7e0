"""The plan of the house: which room may import which."""

import ast
import re
from fnmatch import fnmatch
from pathlib import Path

import eigbench
import pytest

import synthnet

# A room imports the ground and the rooms before it. Rooms of one line do not import each other.
SYNTHNET = (
    "mesh",
    "spectrum",
    "families",
    "recipe",
    "store",
    "build",
    "verify loaders pictures adapters",
    "terminal",
    "commands",
)
EIGBENCH = ("scoring", "results", "running", "scaling", "board", "site", "commands")
# The ground: files in no room, which every room may import, and which import no room.
GROUND = {
    "synthnet": {"arrays", "errors", "kernels", "processes", "types", "version"},
    "eigbench": {"errors", "outside"},
}
# Doors: public names of what lies in a room. Rooms do not use them.
DOORS = {
    "synthnet": {"__init__", "__main__", "pyg", "torch"},
    "eigbench": {"__init__", "__main__", "losses", "metrics"},
}

PLANS = {"synthnet": SYNTHNET, "eigbench": EIGBENCH}
ROOTS = {"synthnet": Path(synthnet.__file__).parent, "eigbench": Path(eigbench.__file__).parent}
FILES = sorted(
    (package, path.relative_to(root).as_posix())
    for package, root in ROOTS.items()
    for path in root.rglob("*.py")
)
MODULES = {
    f"{package}.{file.removesuffix('.py').replace('/', '.')}".removesuffix(".__init__"): file
    for package, file in FILES
}
# What is ours, and what of it each package may import.
OURS = {"synthnet", "eigbench", "baselines", "evidence", "tests"}
PACKAGES = {"synthnet": {"synthnet"}, "eigbench": {"synthnet", "eigbench"}}


def level(package, room):
    """Return a room's line in the plan; -1 is the ground."""
    if room in GROUND[package]:
        return -1
    if room in DOORS[package]:
        return len(PLANS[package])
    return next(i for i, line in enumerate(PLANS[package]) if room in line.split())


def room_of(file):
    return file.split("/")[0].removesuffix(".py")


def imports_of(package, file):
    """Full names of what a file imports: in functions, for types, and by a string too."""
    for node in ast.walk(ast.parse((ROOTS[package] / file).read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and "/" in MODULES.get(node.value, ""):
            yield str(node.value)


def test_every_file_is_in_a_room_and_every_room_has_files():
    for package, plan in PLANS.items():
        rooms = {room for line in plan for room in line.split()}
        filled = {room_of(file) for owner, file in FILES if owner == package}
        assert filled == rooms | GROUND[package] | DOORS[package]


def drawn():
    """Return the first words of the map's drawing: synthnet's column, and eigbench's."""
    text = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text()
    match = re.search(r"```text\n(synthnet/ .*?)```", text, re.DOTALL)
    assert match is not None
    first, *lines = match[1].split("\n")
    middle = first.index("benchmark/eigbench/")
    columns = ([line[:middle] for line in lines], [line[middle:] for line in lines])
    return tuple(
        [
            word
            for line in column
            if re.match(r"  [a-z]", line)  # deeper lines go on with the sentence before
            for word in (
                line.split() if len(re.findall(r"\w  +\w", line)) > 1 else line.split()[:1]
            )
        ]
        for column in columns
    )


def test_the_map_draws_these_rooms_in_this_order():
    for plan, column in zip(PLANS.values(), drawn(), strict=True):
        rooms = [room for line in plan for room in line.split()]
        assert [word for word in column if word not in ("ground", "doors")] == rooms
        assert column[0] == "ground"
        assert column[-1] == "doors"


def test_imports_are_seen():
    assert "synthnet.errors.RecipeError" in imports_of("synthnet", "recipe/drawing.py")
    assert "synthnet.loaders.hf" in imports_of("synthnet", "__init__.py")  # by a string


@pytest.mark.parametrize(("package", "file"), FILES)
def test_rooms_import_only_the_rooms_before_them(package, file):
    room = room_of(file)
    here = level(package, room)
    for name in imports_of(package, file):
        owner, _, rest = name.partition(".")
        assert owner not in OURS or owner in PACKAGES[package], f"{file} imports {name}"
        if owner == package:
            imported = room_of(rest.replace(".", "/"))
            there = level(package, imported)
            both_ground = there == here == -1
            assert there < here or imported == room or both_ground, f"{file} imports {name}"


def test_files_of_a_room_import_each_other_in_no_circle():
    edges = {
        module: {
            name if name in MODULES else name.rpartition(".")[0]
            for name in imports_of(module.partition(".")[0], file)
        }
        & MODULES.keys() - {module}
        for module, file in MODULES.items()
    }
    done = set()

    def visit(module, path):
        assert module not in path, " -> ".join([*path[path.index(module) :], module])
        if module not in done:
            for name in sorted(edges[module]):
                visit(name, (*path, module))
            done.add(module)

    for module in sorted(edges):
        visit(module, ())
    assert len(done) == len(FILES)


def reached(module):
    """Return the modules of eigbench that a module imports, and those that these import."""
    ours = {name for name in MODULES if name.startswith("eigbench.")}
    seen = set()
    left = [module]
    while left:
        for name in imports_of("eigbench", MODULES[left.pop()]):
            new = {name, name.rpartition(".")[0]} & ours - seen
            seen |= new
            left += new
    return seen


def test_nothing_past_a_result_can_run_a_predictor():
    evaluate = "eigbench.running.evaluate"
    running = {f"eigbench.running.{name}" for name in ("predictor", "worker", "process")}
    assert reached("eigbench.commands.evaluate") >= running | {evaluate}
    assert reached("eigbench.commands.scaling") >= running
    for command in ("score", "compare", "submit", "board"):
        assert not reached(f"eigbench.commands.{command}") & (running | {evaluate})


def test_tests_of_every_room_are_collected(pytestconfig):
    """Pytest goes into no directory named build, unless it is told otherwise."""
    folders = {
        folder.name
        for root in (*ROOTS.values(), Path(__file__).parents[1])
        for folder in root.rglob("*/")
    }
    skipped = pytestconfig.getini("norecursedirs")
    assert {"build", "spectrum", "board"} <= folders
    assert not {name for name in folders for pattern in skipped if fnmatch(name, pattern)}
