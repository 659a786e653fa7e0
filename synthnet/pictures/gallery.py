"""Contact sheets: shapes of a family from all over its parameters, or one shape of each family."""

import os
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata
from scipy.stats.qmc import Halton

from synthnet import recipe, store
from synthnet.arrays import Floats
from synthnet.build import filters
from synthnet.errors import suggestion
from synthnet.families import FAMILIES
from synthnet.pictures import draw
from synthnet.recipe.drawing import draw_shape
from synthnet.recipe.plan import plan_shards
from synthnet.types import Mesh, ShapeSpec

LINE, NO_BREAK = 36, "\u00a0"  # letters in a line of a caption; a space that no line breaks at
MOST = 5000  # shapes of a family to choose from; only scaled versions have more
HIDDEN = ("seed", "sha256", "error_bound")  # parameters that say nothing to a reader


@dataclass(frozen=True, slots=True)
class Candidates:
    """The shapes a sheet of a family is chosen from.

    Parameters
    ----------
    family : str
        The family.
    total : int
        How many shapes the version has of it.
    specs : tuple of ShapeSpec
        These, or the first :data:`MOST`, in the order of the version.
    varying : tuple of str
        The parameters that all of them have and that differ between them.
    """

    family: str
    total: int
    specs: tuple[ShapeSpec, ...]
    varying: tuple[str, ...]


def candidates(
    version: str, family: str | None = None, root: str | os.PathLike[str] | None = None
) -> list[Candidates]:
    """Return the shapes of each family of a version, or of one family, or of one file.

    They are drawn from the recipe, so the version need not be built; an import, which has no
    recipe, is read; a family of it has no shapes if all its files were rejected.

    Raises
    ------
    ValueError
        If the version has no such family.
    RecipeError
        If there is no such version.
    """
    stored = store.open_unversioned(version, root)
    if stored is not None:
        kept = _by_family(stored.specs())
        families = (shard.family for shard in stored.manifest.shards)
        shapes = {name: kept.get(name, []) for name in families}
        totals = {name: len(specs) for name, specs in shapes.items()}
        if family is not None and family not in totals and stored.id_of(family) != family:
            spec = stored.find(family).spec  # it is the file of a shape
            return [Candidates(spec.family, totals[spec.family], (spec,), ("file",))]
    else:
        definition = recipe.load(version)
        shapes = _drawn(definition, family)
        totals = {name: definition.drawn(name) for name in definition.families}
    if family is not None and family not in totals:
        if family in recipe.available():
            raise ValueError(f"{family} is a version, and no family: add --dataset before it")
        others = [name for name in recipe.available() if family in recipe.load(name).families]
        hint = f"; it is in {others[0]}: --dataset {others[0]}" if others else ""
        raise ValueError(
            f"{version} has no family {family!r}: choose one of {', '.join(totals)}"
            f"{hint or suggestion(family, totals)}"
        )
    return [
        Candidates(name, totals[name], tuple(specs), _varying(specs))
        for name, specs in shapes.items()
        if family in (None, name)
    ]


def _drawn(definition: recipe.Recipe, family: str | None) -> dict[str, list[ShapeSpec]]:
    if definition.base != definition.version:  # its shapes depend on the splits
        return _by_family(shape.spec for plan in plan_shards(definition) for shape in plan.shapes)
    names = [name for name in definition.families if family in (None, name)]
    first = {name: definition.families[name].count if definition.scale else 0 for name in names}
    return {
        name: [
            draw_shape(definition, name, first[name] + number)
            for number in range(min(definition.drawn(name), MOST))
        ]
        for name in names
    }


def _by_family(specs: Iterable[ShapeSpec]) -> dict[str, list[ShapeSpec]]:
    families: dict[str, list[ShapeSpec]] = {}
    for spec in specs:
        families.setdefault(spec.family, []).append(spec)
    return families


def chosen(
    version: str, among: Candidates, count: int, root: str | os.PathLike[str] | None = None
) -> Iterator[tuple[ShapeSpec, Mesh]]:
    """Make the meshes of ``count`` shapes from all over the family's parameters.

    The first is in the middle of them all. A shape that a filter refuses is passed over.
    """
    stored = store.open_unversioned(version, root)
    thresholds = None if stored is not None else recipe.load(version).filters
    made = 0
    for number in spread(_ranks(among), count):
        if made == count:
            return
        spec = among.specs[number]
        if stored is not None:
            mesh = stored.find(spec.id).mesh
        else:
            family = FAMILIES[spec.family]
            mesh = family.generate(spec.parameters).stored()
            assert thresholds is not None
            if filters.check_mesh(mesh, thresholds, family.topology(spec.parameters)):
                continue
        made += 1
        yield spec, mesh


def sheet(
    shapes: Sequence[tuple[ShapeSpec, Mesh]],
    varying: Sequence[str],
    title: str,
    *,
    edges: bool = False,
    transparent: bool = False,
) -> bytes:
    """Return a contact sheet as the bytes of a PNG: under each shape its id and parameters.

    Parameters
    ----------
    shapes : sequence of ShapeSpec and Mesh
        In the order of the sheet.
    varying : sequence of str
        The parameters to name.
    title, edges, transparent
        As for :func:`synthnet.pictures.draw.picture_of_sheet`.
    """
    captions = [caption(spec, varying) for spec, _ in shapes]
    meshes = [mesh for _, mesh in shapes]
    return draw.picture_of_sheet(meshes, captions, title, edges=edges, transparent=transparent)


def caption(spec: ShapeSpec, varying: Sequence[str]) -> list[str]:
    """Return the lines under a shape: its id, and its parameters of the names given."""
    parts = []
    for name in varying:
        value = spec.parameters[name]
        form = {float: ".3g", int: ","}.get(type(value), "")
        parts.append(f"{name} {value:{form}}".replace(" ", NO_BREAK))
    return [spec.id, *textwrap.wrap(", ".join(parts), LINE)]


def spread(points: Floats, count: int) -> list[int]:
    """Return an order of points of the unit cube, the first ``count`` from all over it.

    A point of Halton's sequence, moved so that it begins in the middle of the cube, takes the
    nearest point that is left, the first of equally near ones.

    Parameters
    ----------
    points : ndarray of shape (n, d)
        A point each row.
    count : int
        How many to spread out; the others follow in their order.

    Examples
    --------
    >>> spread(np.array([[0.0], [0.1], [0.5], [0.6], [1.0]]), 3)
    [2, 0, 3, 1, 4]
    """
    order: list[int] = []
    left = np.ones(len(points), dtype=np.bool_)
    dimensions = max(points.shape[1], 1)
    targets = (Halton(dimensions, scramble=False).random(min(count, len(points))) + 0.5) % 1
    for target in targets[:, : points.shape[1]]:
        away = np.where(left, np.linalg.norm(points - target, axis=1), np.inf)
        order.append(int(away.argmin()))
        left[order[-1]] = False
    return order + np.flatnonzero(left).tolist()


def _varying(specs: Sequence[ShapeSpec]) -> tuple[str, ...]:
    """Return the parameters that differ; the repairs of a mesh are parameters of that mesh only."""
    if not specs:
        return ()
    shared = set.intersection(*(set(spec.parameters) for spec in specs)).difference(HIDDEN)
    names = [name for name in specs[0].parameters if name in shared]
    return tuple(n for n in names if len({spec.parameters[n] for spec in specs}) > 1)


def _ranks(among: Candidates) -> Floats:
    """Return the ranks of the parameters that are numbers, between 0 and 1, one row per shape."""
    columns = [[spec.parameters[name] for spec in among.specs] for name in among.varying]
    numbers = [(rankdata(c) - 0.5) / len(c) for c in columns if not isinstance(c[0], str)]
    return np.stack(numbers, axis=1) if numbers else np.zeros((len(among.specs), 0))
