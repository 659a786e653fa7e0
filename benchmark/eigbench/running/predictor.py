"""A predictor in one file: how it is found, and what it must be.

A file defines one of these; they are checked in this order:

1. a function ``predict(meshes)`` that returns an array of shape (B, 10);
2. a class ``Predictor`` with such a method, made without arguments, or else by a ``load``;
3. a function ``load(device, seed)`` that returns an object with such a method. If it has a
   parameter ``training``, that names what the predictor is to have been trained on, ``1.0/grouped``
   or ``2.0/family/pretzel``: the version and the ``protocol`` of :class:`synthnet.pyg.SynthNet`.
   If it has a parameter ``variant``, the file is a family of predictors, each of them named as
   ``FILE.py:NAME``; then ``META`` may be a function of the name;
4. a ``torch.nn.Module`` named ``model`` (an instance, or a class made without arguments)
   that maps a PyG batch to (B, 10), and, if it needs one, a ``transform`` of
   ``Data(pos, face)``.

Loading runs the file's code.
"""

import glob
import importlib.util
import inspect
import linecache
import math
import os
import sys
import sysconfig
import textwrap
import traceback
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import index
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench import outside
from eigbench.errors import PredictorError
from eigbench.scoring import metrics
from eigbench.scoring.names import TARGETS, nameless
from eigbench.scoring.training import DEFAULT
from synthnet import arrays
from synthnet.errors import install, missing, suggestion
from synthnet.types import Mesh

META_KEYS = (
    *("name", "kind", "authors", "paper", "licence"),
    *("training_data", "training_cost", "hardware", "target"),
)
META_LENGTH = 300
KINDS = ("trivial", "classical", "learned")
NOT_THEIRS = ("__main__", "__mp_main__", "eigbench", "synthnet")  # modules of no predictor
MOST_PARAMETERS = 10**15
LONGEST_MESSAGE = 500  # letters of an error's
LONGEST_LINE = 80  # letters of a line of code in a message


@dataclass(frozen=True, slots=True)
class Predictor:
    """A loaded predictor."""

    #: From a sequence of meshes (float64 vertices, int64 faces) to whatever the file's
    #: code answers; :func:`checked` says if that is (B, k) good eigenvalues.
    predict: Callable[[Sequence[Mesh]], Any]
    meta: dict[str, str]  #: the file's ``META``, with a name and a kind in any case
    #: Numbers in what ``parameters()`` gives, tensors (frozen too) or arrays; ``None`` where
    #: there is no such method.
    parameters: int | None
    seeded: bool = False  #: whether it was made with a seed, by ``load(device, seed)``
    #: Whether with the name of a training set too, by ``load(device, seed, training)``.
    trained: bool = False
    #: The file's directory, and those that its code has put on ``sys.path``. What it imports
    #: from there is a part of it.
    roots: tuple[Path, ...] = ()


def split(path: Path) -> tuple[Path, str]:
    """Return the file and the name of ``FILE.py:NAME``; the name is empty for a file alone."""
    name, colon, variant = path.name.rpartition(":")
    if not colon or path.is_file():
        return path, ""
    return path.with_name(name), variant


def code_name(path: Path) -> str:
    """Return the name of a predictor's code in a result; a link's is that of what it leads to."""
    file, variant = split(path)
    return ":".join(filter(None, [file.resolve().name, variant]))


def check_file(path: Path) -> None:
    """Check that there is a Python file at a path, or at that of ``FILE.py:NAME``.

    Raises
    ------
    PredictorError
        If there is none.
    """
    file, _ = split(path)
    if file.is_dir():
        raise PredictorError(f"{file} is a directory: name the predictor's file in it")
    if not file.is_file():
        raise PredictorError(missing(file))
    if file.suffix != ".py":
        raise PredictorError(f"{file} is no Python file: its name must end in .py")
    if problem := outside.strange_name(path.name):
        raise PredictorError(f"the name {path.name!a} has {problem}: rename the file")


def load(path: Path, *, device: str = "cpu", seed: int = 0, training: str = DEFAULT) -> Predictor:
    """Load the predictor of a file, or of ``FILE.py:NAME``. This runs the file's code.

    Raises
    ------
    PredictorError
        If there is no such file, its code fails, or it has none of the four doors, or no variants.
    """
    file, variant = split(path)
    before = set(sys.path)
    module = _module(file)
    arguments = {"training": training, "variant": variant}
    loaded = _through_a_door(module, file, device, seed, arguments)
    added = (Path(directory).resolve() for directory in sys.path if directory not in before)
    return replace(loaded, roots=(file.resolve().parent, *added))


def _through_a_door(
    module: ModuleType, path: Path, device: str, seed: int, arguments: Mapping[str, str]
) -> Predictor:
    """Return the predictor of a module, by the first door that it has.

    ``arguments`` are those that a function ``load`` may take besides device and seed.
    """
    try:
        function, kind = getattr(module, "predict", None), getattr(module, "Predictor", None)
        loader = getattr(module, "load", None)
        if isinstance(kind, type) and callable(loader) and not _made_alone(kind):
            kind = None  # what ``load`` returns
        if callable(function) or isinstance(kind, type):
            loader = None  # beside them it may be anything
        asked = _asked(loader, arguments, path)
        meta = _meta(module, path, arguments["variant"])
        if callable(function):
            return Predictor(function, meta, None)
        if isinstance(kind, type):
            return _of_object(kind(), meta, path)
        if callable(loader):
            made = _of_object(loader(device, seed, **asked), meta, path)
            return replace(made, seeded=True, trained="training" in asked)
        if (model := getattr(module, "model", None)) is not None:
            return _of_torch(model, getattr(module, "transform", None), meta, device, path)
    except PredictorError:
        raise
    except ModuleNotFoundError as error:
        raise _lacking(path, error) from error
    except BaseException as error:  # Ctrl-C does not come here, only what the code raises
        raise PredictorError(f"{path} failed to load: {described(error, path)}") from error
    raise PredictorError(
        f"{path} has no predictor: define predict(meshes), a class Predictor, "
        "load(device, seed) or a torch module named model"
    )


def _made_alone(kind: type) -> bool:
    """Return whether a class can be made without arguments, as far as its signature says."""
    try:
        inspect.signature(kind).bind()
    except TypeError:
        return False
    except ValueError:  # it has no signature
        pass
    return True


def _asked(loader: Any, arguments: Mapping[str, str], path: Path) -> dict[str, str]:
    """Return those of the arguments that ``load`` takes; a variant must be among them.

    A function, if it is one, must take a device and a seed besides.
    """
    try:
        signature = inspect.signature(loader)
    except (TypeError, ValueError):  # it is no function, or one without a signature
        signature = inspect.Signature()
    parameters, variant = signature.parameters, arguments["variant"]
    if variant and "variant" not in parameters:
        raise PredictorError(f"{path} has no variants: leave out :{variant}")
    if not variant and "variant" in parameters:
        raise PredictorError(f"{path} is a family of predictors: name one, {path.name}:NAME")
    asked = {name: value for name, value in arguments.items() if name in parameters}
    try:
        if inspect.isfunction(loader):
            signature.bind("cpu", 0, **asked)
    except TypeError as error:
        raise PredictorError(
            f"{path}: load{signature} cannot be called as load(device, seed): {error}"
        ) from error
    return asked


def sources(path: Path, roots: Sequence[Path]) -> list[str]:
    """Return the files that a predictor is made of, relative to its directory.

    These are its file, each module it has imported from ``roots``, and what lies beside one of
    them under the same name: ``my_model.safetensors`` and all that is in ``my_model/``, of a
    package all but the modules that it has not imported; of a variant,
    ``my_models/NAME.safetensors``. Other files that it reads are not seen.
    """
    path, variant = split(path)
    path = path.resolve()
    root = path.parent
    files = _beside(path)
    files |= _beside(root / path.stem / variant) if variant else _data(root / path.stem)
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and _is_theirs(name, file, roots):
            module_file = Path(file).resolve()
            files |= _beside(module_file)
            files |= _data(module_file.parent) if module_file.stem == "__init__" else set()
    return sorted(Path(os.path.relpath(file, root)).as_posix() for file in files)


def _is_theirs(module: str, file: str, roots: Sequence[Path]) -> bool:
    """Return whether a module was written with a predictor: it lies in a root, not in a library."""
    source = Path(file)  # relative for modules that are no files: torch has some
    if module.split(".")[0] in NOT_THEIRS or not source.is_absolute() or source.suffix != ".py":
        return False
    source = source.resolve()
    libraries = (Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))
    installed = any(source.is_relative_to(library.resolve()) for library in libraries)
    return not installed and any(source.is_relative_to(folder) for folder in roots)


def _beside(path: Path) -> set[Path]:
    """Return the files of a path's name, whatever their suffix."""
    name = glob.escape(path.name.removesuffix(".py"))
    return {file for file in path.parent.glob(f"{name}.*") if file.is_file()}


def _data(folder: Path) -> set[Path]:
    """Return the files below a folder that are no code: code counts once it is imported.

    Nor are they reached by a link, or hidden, or compiled.
    """
    if folder.is_symlink():
        return set()
    return {
        file
        for file in folder.rglob("*")
        if file.suffix != ".py"
        and not any(p.startswith((".", "__pycache__")) for p in file.relative_to(folder).parts)
        and file.is_file()
        and not file.is_symlink()
    }


def as_array(answer: Any) -> NDArray[Any]:
    """Return an answer as an array in memory; a tensor is fetched from its device.

    Raises
    ------
    PredictorError
        If it is no array.
    """
    try:
        array = arrays.as_array(answer)
    except (TypeError, ValueError) as error:
        raise PredictorError(f"the answer cannot be taken: {described(error)}") from error
    if array.dtype.hasobject and array.ndim == 0:
        if answer is None:
            raise PredictorError("predict returned None: end it with `return`, and the eigenvalues")
        raise PredictorError(
            f"predict returned a {type(answer).__name__}, it must return an array "
            "of shape (B, k): k eigenvalues for each of B meshes"
        )
    return array


def checked(values: NDArray[Any], count: int, k: int) -> NDArray[np.float64]:
    """Return an answer as float64, or say what is wrong with it.

    Values that are not finite or not positive are let through: they are scored as they
    are, and reported at the end.

    Raises
    ------
    PredictorError
        If it is no real numeric array of shape (count, k).

    Examples
    --------
    >>> checked(np.array([[2, 2, 6]]), count=1, k=3)
    array([[2., 2., 6.]])
    >>> checked(np.array([2.0, 2.0, 6.0]), count=1, k=3)
    Traceback (most recent call last):
    eigbench.errors.PredictorError: the answer has shape (3,), it must be (1, 3)
    """
    if values.dtype.kind == "c":
        raise PredictorError("the answer is complex, eigenvalues are real")
    if values.dtype.kind not in "fiu":
        raise PredictorError(f"the answer has dtype {values.dtype}, it must be real numbers")
    if values.shape != (count, k):
        hint = ": leave the zero out" if metrics.has_zero(values, count, k) else ""
        raise PredictorError(
            f"the answer has shape {values.shape}, it must be ({count}, {k}){hint}"
        )
    with np.errstate(over="ignore"):  # a longdouble beyond float64 becomes infinite
        return values.astype(np.float64)


def _module(path: Path) -> ModuleType:
    check_file(path)
    path = path.resolve()
    sys.path.insert(0, str(path.parent))  # siblings can be imported
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise PredictorError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    try:
        spec.loader.exec_module(module)
    except ModuleNotFoundError as error:
        raise _lacking(path, error) from error
    except BaseException as error:  # Ctrl-C does not come here, only what the code raises
        raise PredictorError(f"{path} failed to load: {described(error, path)}") from error
    return module


def _lacking(path: Path, error: ModuleNotFoundError) -> PredictorError:
    command = install(str(error.name))
    return PredictorError(
        f"{path} needs the package {error.name}, which is not installed: {command}"
    )


def _meta(module: ModuleType, path: Path, variant: str) -> dict[str, str]:
    given = getattr(module, "META", {})
    if variant and callable(given):
        given = given(variant)
    if not isinstance(given, dict):
        raise PredictorError(f"{path}: META must be a dict, got {type(given).__name__}")
    name = " ".join(filter(None, [path.stem, variant]))
    return checked_meta({"name": name, "kind": "learned", **given}, path)


def checked_meta(given: Mapping[Any, Any], path: Path) -> dict[str, str]:
    """Return a predictor's META as text, or say what is wrong with it.

    Raises
    ------
    PredictorError
        If a key or the kind is unknown, something is too long, no single line, or looks like
        another text, or no file can have the name.
    """
    unknown = sorted(map(str, set(given) - set(META_KEYS)))
    if unknown:
        raise PredictorError(
            f"{path}: META has the unknown key {', '.join(unknown)}; "
            f"it may have {', '.join(META_KEYS)}{suggestion(unknown[0], META_KEYS)}"
        )
    for key, value in given.items():
        if not isinstance(value, (str, int, float)):
            raise PredictorError(
                f"{path}: META {key} must be text, got {type(value).__name__}: "
                f"{'leave it out' if value is None else 'write it as one line'}"
            )
    # A letter with an accent may be one character or two: results hold the first
    meta = {key: unicodedata.normalize("NFC", str(value)) for key, value in given.items()}
    if not 1 <= len(meta["name"]) <= 80:
        raise PredictorError(f"{path}: META name must have 1 to 80 characters")
    for key, value in meta.items():
        if len(value) > META_LENGTH or len(value.splitlines()) > 1:
            raise PredictorError(
                f"{path}: META {key} must be one line of at most {META_LENGTH} characters"
            )
        if problem := outside.strange(value) or (nameless(value) if key == "name" else ""):
            raise PredictorError(f"{path}: META {key} has {problem}")
    for key, known in (("kind", KINDS), ("target", TARGETS)):
        if key in meta and meta[key] not in known:
            raise PredictorError(
                f"{path}: META {key} must be one of {', '.join(known)}, got {meta[key]!r}"
                f"{suggestion(meta[key], known)}"
            )
    return meta


def _of_object(thing: Any, meta: dict[str, str], path: Path) -> Predictor:
    if not callable(getattr(thing, "predict", None)):
        raise PredictorError(f"{path}: a {type(thing).__name__} has no method predict(meshes)")
    parameters = _count(thing) if hasattr(thing, "parameters") else None
    return Predictor(thing.predict, meta, parameters)


def _of_torch(
    model: Any, transform: Any, meta: dict[str, str], device: str, path: Path
) -> Predictor:
    import torch
    from torch_geometric.data import Batch, Data

    model = model() if isinstance(model, type) else model
    if not isinstance(model, torch.nn.Module):
        raise PredictorError(f"{path}: model must be a torch.nn.Module, got {type(model).__name__}")
    model = model.to(device).eval()

    def predict(meshes: Sequence[Mesh]) -> Any:
        items = []
        for mesh in meshes:
            data = Data(
                pos=torch.tensor(mesh.vertices, dtype=torch.float32),
                face=torch.tensor(mesh.faces.T, dtype=torch.int64),
            )
            items.append(data if transform is None else transform(data))
        with torch.inference_mode():
            return model(Batch.from_data_list(items).to(device))

    return Predictor(predict, meta, _count(model))


def _count(thing: Any) -> int:
    wrong = f"parameters() of a {type(thing).__name__} must give tensors or arrays"
    try:
        count = index(sum(math.prod(parameter.shape) for parameter in thing.parameters()))
    except (AttributeError, TypeError) as error:
        raise PredictorError(f"{wrong}: {described(error)}") from error
    if not 0 <= count <= MOST_PARAMETERS:
        raise PredictorError(f"{wrong}: their shapes make {count:,} numbers")
    return count


def described(error: BaseException, path: Path | None = None) -> str:
    """Return an error on one line; with a predictor's file, the innermost line of its author's."""
    try:
        message = " ".join(str(error).split())
    except BaseException as another:  # noqa: BLE001 - its author's code
        message = f"its message cannot be read: {type(another).__name__}"
    if len(message) > LONGEST_MESSAGE:
        message = f"{message[:LONGEST_MESSAGE]} …"
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    line = "" if path is None else _own_line(error, path.resolve())
    return f"{text} ({line})" if line else text


def _own_line(error: BaseException, path: Path) -> str:
    """Return the innermost line that an error came through of a file, or of modules beside it.

    As ``my_model.py:12: in predict: x = y / 0``, and empty if there is none.
    """
    for frame, number in reversed(list(traceback.walk_tb(error.__traceback__))):
        code = frame.f_code
        file = Path(code.co_filename)
        if file != path and not _is_theirs(
            frame.f_globals.get("__name__", ""), code.co_filename, [path.parent]
        ):
            continue
        name = os.path.relpath(file.resolve(), path.parent)
        inside = "" if code.co_name == "<module>" else f" in {code.co_name}:"
        line = textwrap.shorten(linecache.getline(code.co_filename, number), LONGEST_LINE)
        return f"{name}:{number}:{inside} {line}".rstrip(": ")
    return ""
