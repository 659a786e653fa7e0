"""What verifies a row: its code, found again by its digests, and meshes that nobody has seen.

The code gets the public meshes and the fresh ones in one run, batches of either in one secret
order, so it trains once and is not told which of the two a mesh is of. Each batch has a time: code
that looks public meshes up takes longer for the fresh ones.
"""

import secrets
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from eigbench.errors import EigbenchError, ResultError
from eigbench.results.sources import digest, git, modules
from eigbench.results.submission import Submission
from eigbench.running import record
from eigbench.running.evaluate import Evaluation
from eigbench.running.meshes import Instances
from eigbench.scoring import scores, targets, truth
from eigbench.scoring.training import on_imports
from eigbench.scoring.truth import Truth
from synthnet import store
from synthnet.families import FAMILIES
from synthnet.families.limits import Limit
from synthnet.store import StoredDataset
from synthnet.verify import seal

LONGER = 3.0  # times as long as public meshes would take: no other load explains that
ENOUGH = 5  # batches of each kind: of fewer, their times say nothing
APART = 100  # meshes that are asked by themselves, each of another surface
FRESH = "fresh/"  # before the ids of fresh shapes: the public ones may have the same


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
        files = [f":(top,glob)**/{name}" for name in row.result["model"]["sources"]]
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


class Draws:
    """A fresh sealed draw of each version, which all rows of one command share.

    Its salt is forgotten at once.
    """

    def __init__(self, share: float, folder: Path) -> None:
        self.share = share  # surfaces of each family, as a share of the version's
        self.folder = folder  # an empty directory, which is to be removed when all is done
        self.made: dict[str, StoredDataset] = {}
        self.limits: dict[str, dict[str, Limit]] = {}  # of each version, by group

    def of(self, version: str) -> StoredDataset:
        """Return the draw of a version; the first time, draw and label it."""
        if version not in self.made:
            salt = secrets.token_bytes(seal.SALT_BYTES)
            resolved = seal.sealed_recipe(version, salt, share=self.share)
            seal.make(resolved, root=self.folder)
            self.made[version] = store.open_dataset(resolved.version, self.folder)
        return self.made[version]

    def surfaces(self, public: Truth, fresh: Truth) -> Truth:
        """Return the labels of fresh meshes with the spectra of their surfaces, each found once."""
        limits = self.limits.setdefault(public.version, {})
        group = dict(zip(fresh.shapes.tolist(), fresh.groups.tolist(), strict=True))
        for sample in self.of(public.version).samples():
            mine = group.get(sample.spec.id)
            if mine is not None and mine not in limits:
                family = FAMILIES[sample.spec.family]
                limits[mine] = family.limit_spectrum(sample.spec.parameters)
        return targets.of_surfaces(fresh, {id: limits[mine] for id, mine in group.items()})

    def labels(self, public: Truth) -> Truth:
        """Return the labels of a draw under the protocol of public ones.

        Where the protocol holds something out, it is this part of the draw that is tested.
        """
        return truth.of_dataset(self.of(public.version), "test", public.protocol)


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
    for path in sorted(folder.rglob(file)):
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


def mixed(public: Truth, fresh: Truth) -> Truth:
    """Return public instances and, behind them, fresh ones, as those of one split.

    Both must have the trainings of one protocol, and be of one target.
    """
    bars = public.bars
    return replace(
        public,
        ids=(*public.ids, *_named(fresh.ids)),
        shapes=np.array([*public.shapes, *_named(fresh.shapes)]),
        groups=np.array([*public.groups, *_named(fresh.groups)]),
        families=np.concatenate([public.families, fresh.families]),
        trainings=np.concatenate([public.trainings, fresh.trainings]),
        eigenvalues=np.concatenate([public.eigenvalues, fresh.eigenvalues]),
        bars=None if bars is None else np.concatenate([bars, fresh.tolerance]),
    )


def batch_size(declared: int, fresh: Truth) -> int:
    """Return how many meshes a call gets: as declared, or fewer, so that times can be compared."""
    return max(1, min(declared, len(set(fresh.shapes.tolist())) // (2 * ENOUGH)))


def one_per_surface(truth: Truth) -> NDArray[np.int64]:
    """Return instances that have no surface in common, drawn anew, all of one training set."""
    rng = np.random.default_rng(secrets.randbits(128))
    order = rng.permutation(np.flatnonzero(truth.trainings == rng.choice(truth.trainings)))
    return order[np.sort(np.unique(truth.groups[order], return_index=True)[1])][:APART]


def better_among_others(
    targeted: Sequence[Truth],
    chosen: NDArray[np.int64],
    among: NDArray[np.float64],
    apart: NDArray[np.float64],
) -> list[str]:
    """Return what shows that meshes are answered better among others of their surfaces.

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
        with_others, alone = scores.of_metric(labels, both, "rpd")
        if record.larger(alone, with_others):
            lines.append(
                f"a mesh by itself is answered with an RPD of {alone.mean():.3g} against the "
                f"{every.target}, and of {with_others.mean():.3g} among other meshes of its "
                "surface: it is not predicted from the mesh alone"
            )
    return lines


def slower(evaluation: Evaluation, instances: Instances, truth: Truth, public: int) -> str:
    """Return what shows that fresh meshes take longer than public ones of as many vertices; or "".

    What a batch takes is a constant and a multiple of its vertices, by those of public meshes. The
    first one of each process may compile code and does not count, nor do copies of shapes. The
    evaluation is of both sets: the first ``public`` instances are the public ones.
    """
    vertices = instances.vertices(truth.ids)
    of_batches = np.array([vertices[chosen].sum() for _, chosen in evaluation.asked])
    fresh = np.array([chosen[0] >= public for _, chosen in evaluation.asked])
    counts = evaluation.new & ~evaluation.opening
    if min((counts & fresh).sum(), (counts & ~fresh).sum()) < ENOUGH:
        return ""
    terms = np.stack([np.ones(len(of_batches)), of_batches], axis=1)
    fitted, _ = nnls(terms[counts & ~fresh], evaluation.seconds[counts & ~fresh])
    expected = float((terms[counts & fresh] @ fitted).sum())
    ratio = float(evaluation.seconds[counts & fresh].sum()) / expected
    if ratio <= LONGER:
        return ""
    return (
        f"meshes that nobody has seen take {ratio:.1f} times as long as public ones of as many "
        "vertices: it knows these"
    )


def mixed_meshes(public: Instances, fresh: Instances) -> Instances:
    """Return the meshes of :func:`mixed`."""
    return Instances(
        {**public.shapes, **{f"{FRESH}{id}": mesh for id, mesh in fresh.shapes.items()}},
        {**public.isometries, **{f"{FRESH}{id}": each for id, each in fresh.isometries.items()}},
    )


def _named(ids: Iterable[str]) -> list[str]:
    """Return the ids of fresh shapes as no public shape has them."""
    return [f"{FRESH}{id}" for id in ids]
