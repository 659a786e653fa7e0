"""What verifies a row: its code, found again by its digests, and meshes that nobody has seen.

The code gets the public meshes and the fresh ones of ``unseen`` in one run, batches of either in
one secret order, so it trains once and is not told which of the two a mesh is of.
"""

import glob
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError, ResultError
from eigbench.results.sources import digest, git, modules
from eigbench.results.submission import Submission
from eigbench.running import record
from eigbench.scoring import scores
from eigbench.scoring.training import on_imports
from eigbench.scoring.truth import Truth


class Checkouts:
    """Where the code of rows is found."""

    def __init__(self, board: Path, source: Path | None, folder: Path) -> None:
        self.board = board  # the checkout that has the rows
        self.source = source  # a directory that has the code, in place of the board's commits
        self.folder = folder  # an empty directory for the files of commits

    def code(self, row: Submission) -> tuple[Path, str | None]:
        """Return the file with a row's code, and the commit that has it.

        The last commit comes first: what has moved since the row was made, and is still the same
        code by its digests, fits the packages that are installed. Then come the commit that the
        result names, and every one that has changed a file with a name of the row's files.

        Raises
        ------
        EigbenchError
            If no place has files with the digests that the row names.
        """
        if self.source is not None:
            return code_in(self.source, row), None
        for commit in self._commits(row):
            folder = self._files(commit)
            try:
                return code_in(folder, row), commit
            except ResultError:
                self._remove(folder)
        raise ResultError(
            f"no commit of {self.board.resolve()} has the code and weights that {row.result_path} "
            f"names: {', '.join(row.result['model']['sources'])}: fetch the one that has, or give "
            "--source DIR"
        )

    def _commits(self, row: Submission) -> list[str]:
        """Return the commits that may have a row's code, the likeliest first."""
        head = git(self.board, "rev-parse", "HEAD")
        named = row.result.get("checkout", {}).get("commit")
        if named and git(self.board, "cat-file", "-e", f"{named}^{{commit}}") is None:
            named = None  # it was not fetched
        names = map(glob.escape, row.result["model"]["sources"])
        files = [f":(top,glob)**/{name}" for name in names]
        history = git(self.board, "log", "--format=%H", "HEAD", "--", *files)
        return [*filter(None, dict.fromkeys((head, named, *(history or "").split())))]

    def _files(self, commit: str) -> Path:
        """Return a directory with the files of a commit."""
        folder = self.folder / commit
        if not folder.exists():
            added = self._worktree("add", "--quiet", "--detach", str(folder), commit)
            if added.returncode:
                raise EigbenchError(
                    f"cannot check out {commit[:12]} ({' '.join(added.stderr.split())[:200]}): "
                    "give --source DIR"
                )
        return folder

    def close(self) -> None:
        """Take the directories of commits out of git's list of working trees."""
        for folder in self.folder.glob("*"):
            self._remove(folder)

    def _remove(self, folder: Path) -> None:
        self._worktree("remove", "--force", str(folder))

    def _worktree(self, *command: str) -> subprocess.CompletedProcess[str]:
        line = ["git", "-C", str(self.board), "worktree", *command]
        return subprocess.run(line, capture_output=True, text=True, check=False)


def check_protocol(row: Submission) -> None:
    """Check that fresh meshes can be drawn that are like those a row is tested on.

    Raises
    ------
    ResultError
        If it is tested on an imported dataset, or under the protocol ``paper``.
    """
    if on_imports(row.truth.protocol):
        why = "is tested on imported meshes, and nobody can draw others like them"
    elif row.truth.protocol == "paper":
        why = "is tested on copies of shapes that it was trained on, as no fresh ones are"
    else:
        return
    raise ResultError(f"{row.result_path} {why}: verify the row of the same model under grouped")


def code_in(folder: Path, row: Submission) -> Path:
    """Return the predictor's file in a directory: of its name, with the digests of the result.

    None of its files may import one that the result does not name: since digests are blind to
    where a name is imported from, code that has moved into a new file has those of the old.

    Raises
    ------
    ResultError
        If there is none.
    """
    model = row.result["model"]
    file, _, variant = model["code"].partition(":")
    for path in sorted(folder.rglob(glob.escape(file))):
        here = {name: path.parent / name for name in model["sources"]}
        same = all(p.is_file() and digest(p) == model["sources"][n] for n, p in here.items())
        if same and not _unnamed(path.parent, here):
            return path.with_name(f"{file}:{variant}") if variant else path
    raise ResultError(
        f"{folder} has no {file} with the code and weights that {row.result_path} names: "
        f"{', '.join(model['sources'])}. Weights that lay elsewhere, shown by --readable, must lie "
        "beside the code"
    )


def _unnamed(folder: Path, files: Mapping[str, Path]) -> set[str]:
    """Return the files of a predictor's folder that its named files import, and that are not."""
    code = (path.read_bytes() for path in files.values() if path.suffix == ".py")
    imported = set().union(*map(modules, code))
    there = {name for module in imported for name in (f"{module}.py", f"{module}/__init__.py")}
    return {name for name in there - files.keys() if (folder / name).is_file()}


def copied(row: Submission, code: Path, folder: Path) -> Path:
    """Copy the files that the result names, and nothing else: it must need no others."""
    for name in row.result["model"]["sources"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(code.parent / name, folder / name)
    return folder / code.name


def better_among_others(
    targeted: Sequence[Truth],
    chosen: NDArray[np.int64],
    among: NDArray[np.float64],
    apart: NDArray[np.float64],
) -> list[str]:
    """Return what shows that meshes are answered better among others of their surfaces.

    An honest predictor answers a mesh alike both times, so errors may also be compared by which
    of two is larger: then a few wild answers, or such that are not finite, hide nothing.

    Parameters
    ----------
    targeted : sequence of Truth
        The same instances at each target.
    chosen : ndarray of int64
        Those that were asked by themselves, of a fresh process.
    among, apart : ndarray of float64
        The answers to all, (n, k), and those by themselves, (m, k).
    """
    lines = []
    for every in targeted:
        labels = every.take(chosen)
        both = np.stack([among[chosen], apart])
        errors = scores.of_metric(labels, both, "rpd")
        with_others, alone = np.where(np.isfinite(errors), errors, np.inf)
        finite = np.isfinite(errors).all(axis=0)
        larger = record.larger(alone[finite], with_others[finite])
        if larger or record.oftener_larger(alone, with_others):
            lines.append(
                f"a mesh by itself is answered with an RPD of {alone.mean():.3g} against the "
                f"{every.target}, and of {with_others.mean():.3g} among other meshes of its "
                "surface: it is not predicted from the mesh alone"
            )
    return lines
