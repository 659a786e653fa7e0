"""Pictures of shapes as PNG: a mesh, its spectrum and its eigenfunctions; sheets of meshes."""

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from synthnet import spectrum
from synthnet.arrays import Floats
from synthnet.errors import needed_by
from synthnet.pictures.palette import BLUE, GREY
from synthnet.pictures.raster import View, render
from synthnet.store.files import write_bytes
from synthnet.types import Mesh, Sample

with needed_by("drawing"):
    import matplotlib as mpl
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

DOTS = 150  # an inch
ACROSS = 5  # so many eigenfunctions, or meshes of a sheet, make a row
TOP, BELOW = 3.9, 2.15  # inches: height of the mesh and its spectrum, and of a row below
SMALL = (480 / DOTS, 360 / DOTS)  # inches: of a mesh alone
WIDTH, KEY = 9.0, 0.3  # inches; the key says what the colours mean
KEY_TEXT = "eigenfunctions: negative blue, positive orange, paler towards zero, a line at zero"
CAPTION_LINE = 0.135  # inches
LETTER = 0.1  # inches: a little more than the mean width of a title's letter
TEXTS = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
ON_NOTHING: dict[Any, Any] = {
    "savefig.transparent": True,
    **dict.fromkeys(TEXTS, GREY),
}  # Matplotlib's settings
Box: TypeAlias = tuple[float, float, float, float]  # inches: left, bottom, width and height
SIGN = 0.5  # of the largest magnitude: a function is positive at the first vertex above it


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of a sheet: meshes in a row, and the inches of each mesh's picture."""

    across: int = ACROSS
    width: float = WIDTH / ACROSS
    height: float = 1.5


SHEET = Layout()


@dataclass(frozen=True, slots=True)
class Colouring:
    """What a mesh is coloured by: a function at its vertices, its name, and the view."""

    values: Floats
    text: str
    view: View | None = None


def check_name(path: Path) -> None:
    """Raise ValueError if a path does not end in ``.png``."""
    if path.suffix.lower() != ".png":
        raise ValueError(f"the picture's name must end in .png, got {path}")


def draw_sample(
    sample: Sample, path: Path, *, eigenfunctions: int = ACROSS, edges: bool = False
) -> None:
    """Draw a shape beside its eigenvalues, its first eigenfunctions below, and write a PNG.

    Parameters
    ----------
    sample : Sample
        The shape; its eigenfunctions are computed anew.
    path : Path
        Where to write.
    eigenfunctions : int
        How many to draw.
    edges : bool
        Whether to draw the edges of the mesh.

    Raises
    ------
    ValueError
        If the path does not end in ``.png``, or there are not so many eigenfunctions.
    SpectrumError
        If the eigenfunctions cannot be computed.
    BuildError
        If the file cannot be written.
    """
    check_name(path)
    write_bytes(path, picture_of_sample(sample, eigenfunctions=eigenfunctions, edges=edges))


def picture_of_sample(
    sample: Sample, *, eigenfunctions: int = 0, edges: bool = False, transparent: bool = False
) -> bytes:
    """Return the picture of :func:`draw_sample` as the bytes of a PNG, on white or on nothing."""
    rows = -(-eigenfunctions // ACROSS)
    high = TOP + rows * BELOW + (KEY if rows else 0)
    with plain_style(transparent=transparent):
        figure = Figure(figsize=(WIDTH, high), dpi=DOTS)
        _picture(figure, (0.0, high - TOP, 4.9, TOP - 0.55), sample.mesh, edges=edges)
        facts = f"{len(sample.mesh.vertices):,} vertices, {len(sample.mesh.faces):,} triangles"
        _text(figure, 2.45, high - 0.2, sample.spec.id)
        _text(figure, 2.45, high - 0.42, facts, size=8, quiet=True)
        _bars(figure, (5.55, high - TOP + 0.6, 3.2, TOP - 1.15), sample.eigenvalues)
        if rows:
            _eigenfunctions(figure, sample.mesh, eigenfunctions, high - TOP)
            _text(figure, WIDTH / 2, KEY / 2, KEY_TEXT, size=8, quiet=True)
        return _png(figure)


def _eigenfunctions(figure: Figure, mesh: Mesh, count: int, top: float) -> None:
    computed = spectrum.compute(mesh, count)
    wide = WIDTH / ACROSS
    for number, function in enumerate(signed(computed.eigenvectors).T):
        title = eigenvalue_text(number + 1, computed.eigenvalues[number])
        row, column = divmod(number, ACROSS)
        below = top - (row + 1) * BELOW
        box = (column * wide, below, wide, BELOW - 0.4)
        _picture(figure, box, mesh, colouring=Colouring(function, title))
        _text(figure, (column + 0.5) * wide, below + BELOW - 0.2, title, formulas=True)


def eigenvalue_text(index: int, value: float) -> str:
    """Return the formula of an eigenvalue of an index, counted from 1 after zero."""
    return f"$\\lambda_{{{index}}}$ = {value:.4g}"


def picture_of_mesh(mesh: Mesh) -> bytes:
    """Return a picture of a mesh with its edges as the bytes of a PNG."""
    with plain_style():
        figure = Figure(figsize=SMALL, dpi=DOTS)
        _picture(figure, (0, 0, *SMALL), mesh, edges=True)
        return _png(figure)


def picture_of_sheet(
    meshes: Sequence[Mesh | None],
    captions: Sequence[Sequence[str]],
    title: str = "",
    *,
    edges: bool = False,
    layout: Layout = SHEET,
    colourings: Sequence[Colouring] = (),
    transparent: bool = False,
) -> bytes:
    """Return a contact sheet as the bytes of a PNG.

    Parameters
    ----------
    meshes : sequence of Mesh or None
        What to draw, row by row; ``None`` leaves a gap.
    captions : sequence of sequence of str
        Lines under each mesh, the first its name.
    title : str
        Of the sheet.
    edges : bool
        Whether to draw the edges of the meshes.
    layout : Layout
        How large, and how many in a row.
    colourings : sequence of Colouring
        An eigenfunction of each mesh, which names its eigenvalue as well; none if it is empty.
    transparent : bool
        Whether there is nothing behind the meshes, in place of white.

    Raises
    ------
    ValueError
        If there are no meshes.
    """
    if not meshes:
        raise ValueError("a contact sheet needs at least 1 mesh, got 0")
    across = min(layout.across, len(meshes))
    rows = -(-len(meshes) // across)
    lines_below = max(map(len, captions)) + bool(colourings)
    tall = layout.height + 0.1 + CAPTION_LINE * lines_below
    head = 0.42 if title else 0.0
    width = max(across * layout.width, LETTER * len(title))
    high = rows * tall + head
    margin = (width - across * layout.width) / 2
    with plain_style(transparent=transparent):
        figure = Figure(figsize=(width, high), dpi=DOTS)
        _text(figure, width / 2, high - 0.22, title, size=10)
        for number, (mesh, lines) in enumerate(zip(meshes, captions, strict=True)):
            row, column = divmod(number, across)
            left, under = margin + column * layout.width, high - head - row * tall - layout.height
            box, x = (left, under, layout.width, layout.height), left + layout.width / 2
            colouring = colourings[number] if colourings else None
            if mesh is not None:
                _picture(figure, box, mesh, colouring=colouring, edges=edges)
            for below, text in enumerate(lines):
                y = under - (below + 0.6) * CAPTION_LINE
                _text(figure, x, y, text, size=6.5, quiet=below > 0)
            if colouring is not None:
                y = under - (len(lines) + 0.6) * CAPTION_LINE
                _text(figure, x, y, colouring.text, size=6.5, quiet=True, formulas=True)
        return _png(figure)


def coloured_by(mesh: Mesh, index: int, view: View | None = None) -> Colouring:
    """Return the eigenfunction of an index, counted from 1 after the constant, to colour a mesh."""
    computed = spectrum.compute(mesh, index)
    text = eigenvalue_text(index, computed.eigenvalues[index - 1])
    return Colouring(signed(computed.eigenvectors)[:, index - 1], text, view)


def signed(eigenvectors: Floats) -> Floats:
    """Return eigenfunctions, the columns, with signs that do not depend on the last bits.

    The first vertex at which a function reaches half its largest magnitude is positive.

    Examples
    --------
    >>> signed(np.array([[0.1, 0.3], [-0.5, 0.1], [0.4, -0.4]])).tolist()
    [[-0.1, 0.3], [0.5, 0.1], [-0.4, -0.4]]
    """
    large = np.abs(eigenvectors) >= SIGN * np.abs(eigenvectors).max(axis=0)
    first = np.take_along_axis(eigenvectors, large.argmax(axis=0)[None], axis=0)
    return np.asarray(eigenvectors * np.where(first < 0, -1.0, 1.0))


@contextmanager
def plain_style(*, transparent: bool = False) -> Iterator[None]:
    """Draw in plain settings; a user's own style would change the picture.

    On nothing, all text and axes are of a grey that can be read on light and on dark pages.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({"font.family": "DejaVu Sans", "font.size": 9})
        if transparent:
            mpl.rcParams.update(ON_NOTHING)
        yield


def _axes(figure: Figure, box: Box) -> Axes:
    return figure.add_axes(tuple(np.array(box) / np.tile(figure.get_size_inches(), 2)))


def _picture(
    figure: Figure,
    box: Box,
    mesh: Mesh,
    *,
    colouring: Colouring | None = None,
    edges: bool = False,
) -> None:
    """Draw a mesh in a box of a figure."""
    axes = _axes(figure, box)
    axes.set_axis_off()
    width, height = round(box[2] * DOTS), round(box[3] * DOTS)
    values, view = (colouring.values, colouring.view) if colouring else (None, None)
    transparent = bool(mpl.rcParams["savefig.transparent"])
    pixels = render(
        mesh, width, height, view=view, values=values, edges=edges, transparent=transparent
    )
    axes.imshow(pixels, interpolation="nearest", aspect="auto")


def _text(
    figure: Figure,
    x: float,
    y: float,
    text: str,
    *,
    size: float = 9,
    quiet: bool = False,
    formulas: bool = False,
) -> None:
    """Write text around a point of a figure, in inches from its lower left corner.

    A dollar sign begins a formula only if ``formulas`` is set: imported names may contain some.
    """
    wide, high = figure.get_size_inches()
    drawn = figure.text(x / wide, y / high, text, ha="center", va="center", size=size)
    if quiet and not mpl.rcParams["savefig.transparent"]:
        drawn.set_color("0.35")
    drawn.set_parse_math(formulas)


def _bars(figure: Figure, box: Box, eigenvalues: Floats) -> None:
    axes = _axes(figure, box)
    numbers = np.arange(1, len(eigenvalues) + 1)
    axes.bar(numbers, eigenvalues, color=BLUE, width=0.6)
    axes.set_xticks(numbers)
    axes.set_xlabel("index")
    axes.set_ylabel("eigenvalue (1/length²)")
    axes.set_title("Laplace-Beltrami eigenvalues after zero", fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)


def _png(figure: Figure) -> bytes:
    FigureCanvasAgg(figure)
    written = io.BytesIO()
    figure.savefig(written, format="png", dpi=DOTS, metadata={"Software": None})
    return written.getvalue()


def notebook_picture(shown: Mesh | Sample) -> bytes | None:
    """Return what a notebook shows: a mesh with its edges, a sample beside its spectrum.

    Nothing is shown of a mesh without faces.
    """
    if isinstance(shown, Sample):
        return picture_of_sample(shown)
    return picture_of_mesh(shown) if len(shown.faces) else None
