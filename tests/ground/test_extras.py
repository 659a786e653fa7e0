"""What an installation without extras can do, and the line it gives where an extra is missing."""

import ast
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from eigbench.errors import PredictorError
from eigbench.running import predictor
from eigbench.running.process import REFERENCE_FILE

from synthnet.errors import OPTIONAL, MissingPackageError, install, needed_by

ROOT = Path(__file__).parents[2]
FOLDERS = {"synthnet": ROOT / "synthnet", "eigbench": ROOT / "benchmark" / "eigbench"}

# Modules that cannot be imported without an extra, and their line.
LINES = {
    "eigbench.losses": "eigbench.losses needs PyTorch: pip install 'synthnet[torch]'",
    "eigbench.scoring.losses": "eigbench.losses needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.adapters.diffusionnet": (
        "synthnet.adapters.diffusionnet needs PyTorch: pip install 'synthnet[torch]'"
    ),
    "synthnet.adapters.pyg": "synthnet.adapters.pyg needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.adapters.sklearn": (
        "synthnet.adapters.sklearn needs scikit-learn: pip install 'synthnet[baselines]'"
    ),
    "synthnet.loaders.pyg": "synthnet.pyg needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.loaders.gradients": "synthnet.torch needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.loaders.fingerprint": "synthnet.pyg needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.loaders.transformed": "synthnet.pyg needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.pictures.draw": "drawing needs Matplotlib: pip install 'synthnet[pictures]'",
    "synthnet.pictures.gallery": "drawing needs Matplotlib: pip install 'synthnet[pictures]'",
    "synthnet.pyg": "synthnet.pyg needs PyTorch: pip install 'synthnet[torch]'",
    "synthnet.torch": "synthnet.torch needs PyTorch: pip install 'synthnet[torch]'",
}
A_PREDICTOR = "eigbench.running.reference"  # its own process says what it lacks

# Code that needs an extra when it runs, and its line.
USES = {
    "import synthnet; synthnet.load_dataset('1.0-mini')": (
        "synthnet.load_dataset needs datasets: pip install 'synthnet[datasets]'"
    ),
    "from synthnet.families import primitives; primitives.box(width=1, height=1, depth=1)": (
        "building shapes needs Open3D: pip install 'synthnet[build]'"
    ),
    "from synthnet.verify import shapes; shapes.lapy_eigenvalues(None, 10)": (
        "checking labels needs LaPy: pip install 'synthnet[verify]'"
    ),
    "from synthnet.build import workers; workers.dask_cluster('tcp://127.0.0.1:1').__enter__()": (
        "--engine dask needs distributed: pip install 'synthnet[dask]'"
    ),
    "from synthnet.build import workers; workers.mpi_processes()": (
        "--engine mpi needs mpi4py: pip install 'synthnet[mpi]'"
    ),
    "from synthnet.store import storage; storage.location('s3://bucket/file').read_bytes()": (
        "cannot read s3://bucket/file: pip install 'synthnet[s3]'"
    ),
    "from synthnet.spectrum import Operator, compute\n"
    "triangle = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]\n"
    "compute(triangle, 1, operator=Operator(elements='tufted'))": (
        "the tufted Laplacian needs robust_laplacian: pip install 'synthnet[robust]'"
    ),
    "from eigbench.board import figures; figures.style().__enter__()": (
        "drawing needs Matplotlib: pip install 'synthnet[pictures]'"
    ),
}

# Commands that need an extra, and the end of their line.
COMMANDS = {
    "synthnet build 1.0-mini": (
        "synthnet: building shapes needs Open3D: pip install 'synthnet[build]'"
    ),
    "synthnet gallery --dataset 1.0-mini --png x.png": (
        "synthnet: drawing needs Matplotlib: pip install 'synthnet[pictures]'"
    ),
    "synthnet build --engine mpi": (
        "synthnet: --engine mpi needs mpi4py: pip install 'synthnet[mpi]'"
    ),
    "eigbench check predictor.py": (
        "eigbench: building shapes needs Open3D: pip install 'synthnet[build]'"
    ),
}

BLOCK = f"""
import importlib, json, sys
sys.path[:0] = {[str(path.parent) for path in FOLDERS.values()]!r}

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name in {sorted(OPTIONAL)!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocker())
"""


def run(code, cwd):
    """Run code in a process in which no optional package can be imported."""
    return subprocess.run(
        [sys.executable, "-c", BLOCK + code], capture_output=True, text=True, check=False, cwd=cwd
    )


def modules():
    names = (
        ".".join((package, *path.relative_to(folder).with_suffix("").parts))
        for package, folder in FOLDERS.items()
        for path in folder.rglob("*.py")
    )
    return sorted(name.removesuffix(".__init__") for name in names)


def test_only_the_modules_that_need_an_extra_fail_to_import_without_it(tmp_path):
    names = [name for name in modules() if name != A_PREDICTOR]
    assert len(names) > 100
    code = f"""
lines = {{}}
for name in {names!r}:
    try:
        importlib.import_module(name)
    except ImportError as error:
        lines[name] = str(error)
print(json.dumps(lines))
"""
    done = run(code, tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == LINES


def loaded(code, cwd):
    """Return what code loads that is not Python's own, by its top name."""
    code = f"before = {{*sys.modules}}\n{code}\nprint(json.dumps([*{{*sys.modules}} - before]))"
    done = run(code, cwd)
    assert done.returncode == 0, done.stderr
    return {name.partition(".")[0] for name in json.loads(done.stdout)} - sys.stdlib_module_names


def test_import_of_the_package_loads_nothing_and_the_spectrum_only_what_computes(tmp_path):
    """How long both take: ``python -m evidence measure start``."""
    assert loaded("import synthnet", tmp_path) == {"synthnet"}
    spectrum = loaded("import synthnet.spectrum", tmp_path)
    assert {"synthnet", "numpy", "numba", "scipy"} <= spectrum
    assert not spectrum & {*OPTIONAL, "pyarrow", "pandas", "fsspec", "rich", "tabulate"}


def test_code_that_needs_an_extra_names_it_in_one_line(tmp_path):
    code = f"""
from synthnet.errors import MissingPackageError
lines = {{}}
for use in {list(USES)!r}:
    try:
        exec(use)
    except MissingPackageError as error:
        lines[use] = str(error)
print(json.dumps(lines))
"""
    done = run(code, tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == USES


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_that_needs_an_extra_exits_with_2_and_one_line(command, tmp_path):
    program, *arguments = command.split()
    code = f"""
from {program}.commands.cli import main
raise SystemExit(main({[*arguments]!r}))
"""
    (tmp_path / "predictor.py").write_text("def predict(meshes): return []\n")
    done = run("import os; os.environ['SYNTHNET_HOME'] = 'home'" + code, tmp_path)
    assert done.returncode == 2, done.stderr
    assert done.stderr.strip().splitlines() == [COMMANDS[command]]


def test_lapy_beside_a_predictor_is_missed_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "lapy", None)
    line = r"needs the package lapy, which is not installed: pip install 'synthnet\[verify\]'$"
    with pytest.raises(PredictorError, match=line):
        predictor.load(REFERENCE_FILE)


def test_extras_are_those_of_the_project_and_all_has_every_one_but_what_is_gpl():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    named = {extra for _, extra in OPTIONAL.values()}
    assert named == extras.keys() - {"all", "dev", "docs", "site"}
    free = [name for name in extras if name in named - {"cholmod"}]  # whose wheel holds GPL code
    assert extras["all"] == [f"synthnet[{','.join(free)}]"]


def test_other_packages_and_other_errors_are_left_alone():
    with pytest.raises(ModuleNotFoundError, match="no_such_thing"), needed_by("this"):
        import no_such_thing  # noqa: F401
    with pytest.raises(ZeroDivisionError), needed_by("this"):
        _ = 1 / 0
    line = "this needs PyTorch Geometric: "
    with pytest.raises(MissingPackageError, match=line) as caught, needed_by("this"):
        raise ModuleNotFoundError(name="torch_geometric.data")
    assert isinstance(caught.value.__cause__, ModuleNotFoundError)
    assert install("cv2") == "pip install it"


def test_a_package_that_is_there_and_broken_is_not_said_to_be_missing():
    line = r"^drawing needs Matplotlib, which is installed and cannot be imported: no libfreetype$"
    with pytest.raises(MissingPackageError, match=line), needed_by("drawing"):
        raise ImportError("no libfreetype", name="matplotlib.ft2font")
    with pytest.raises(ImportError, match=r"^cannot import name"), needed_by("drawing"):
        raise ImportError("cannot import name 'a'", name="synthnet.mesh")
    with pytest.raises(MissingPackageError, match=r"^the inner"), needed_by("the outer"):  # noqa: SIM117
        with needed_by("the inner"):
            raise ModuleNotFoundError(name="lapy")


def test_the_advice_to_install_an_extra_is_written_once():
    files = [path for folder in FOLDERS.values() for path in folder.rglob("*.py")]
    assert len(files) > 100
    advising = {
        path.name
        for path in files
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and "pip install 'synthnet" in str(node.value)
    }
    assert advising == {"errors.py"}
