"""docs/pictures/architecture.svg: the rooms of the tests' plan, and which imports which."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from html import escape
from textwrap import wrap

from evidence import DOCS
from synthnet.store.files import write_text
from tests.ground import test_imports as house

TARGET = DOCS / "pictures" / "architecture.svg"
COLUMN, GAP, EDGE = 440, 60, 10  # pixels: a package, between packages, around the drawing
LINE, LETTER = 16, 6.3  # pixels: height of a line of text, mean width of a letter of 12 pixels
STEP = 34  # pixels between two rows, for the arrows
NAME = 30  # pixels: of a box, above its words
# The boxes are light with dark words, and what stands outside of them is grey: both can be read on
# a light page and on a dark one.
STYLE = """
text { font: 12px sans-serif; fill: #22272e }
.name { font: bold 15px sans-serif }
.outside { fill: #7a828c }
.box { fill: #e4f0f9; stroke: #0072b2 }
.ground { fill: #f3f3f3; stroke: #7a828c; stroke-dasharray: 4 3 }
.arrow { fill: none; stroke: #7a828c; stroke-width: 1.6; marker-end: url(#head) }
.head { fill: #7a828c }
"""

Box = tuple[float, float, float, float]  # left, top, width, height


def draw_architecture() -> None:
    """Write the drawing."""
    write_text(TARGET, drawing())


def drawing() -> str:
    """Return the SVG: one column per package, one row per line of its plan, arrows for imports."""
    parts, bottom = [], 0.0
    for number, package in enumerate(house.PLANS):
        left = EDGE + number * (COLUMN + GAP)
        column, height = drawn_package(package, left)
        parts += column
        bottom = max(bottom, height)
    across, middle = EDGE + COLUMN, bottom / 2
    parts.append(arrow(across + GAP - 4, middle, across + 4, middle))
    parts += text(across + GAP / 2, middle + LINE, ["imports"], "outside")
    width = 2 * EDGE + COLUMN * len(house.PLANS) + GAP * (len(house.PLANS) - 1)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {bottom + EDGE:.0f}">',
            f"<style>{STYLE}</style>",
            '<marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" '
            'markerHeight="7" orient="auto"><path class="head" d="M0 0 10 5 0 10z"/></marker>',
            *parts,
            "</svg>\n",
        ]
    )


def drawn_package(package: str, left: float) -> tuple[list[str], float]:
    """Return the parts of a package's column, and where it ends."""
    plan = [line.split() for line in house.PLANS[package]]
    parts = text(left + COLUMN / 2, EDGE + LINE, [f"{package}/"], "name outside")
    top = EDGE + 1.8 * LINE
    ground = sorted(house.GROUND[package])
    parts += box((left, top, COLUMN, 44), "ground", [f"{' · '.join(ground)}: for all"], "ground")
    top += 44 + STEP
    boxes: dict[str, Box] = {}
    for line in plan:
        wide = (COLUMN - 12 * (len(line) - 1)) / len(line)
        words = {room: wrap(says(package, room), int((wide - 16) / LETTER)) for room in line}
        high = NAME + LINE * max(map(len, words.values()))
        for number, room in enumerate(line):
            boxes[room] = (left + number * (wide + 12), top, wide, high)
            parts += box(boxes[room], room, words[room], "box")
        top += high + STEP
    doors = sorted(house.DOORS[package] - {"__init__", "__main__"})
    words = [f"{' · '.join(f'{package}.{door}' for door in doors)}: public names of a room"]
    parts += box((left, top, COLUMN, 44), "doors", words, "ground")
    behind = [arrow(*between(boxes[a], boxes[b])) for a, b in needed(arrows(package))]
    return behind + parts, top + 44  # an arrow that passes a room passes behind its box


def says(package: str, room: str) -> str:
    """Return the first line of the docstring of a room, which is a folder or a file."""
    folder = house.ROOTS[package] / room
    source = (folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")).read_text()
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]


@cache
def arrows(package: str) -> tuple[tuple[str, str], ...]:
    """Return which room imports which, in the order of the plan."""
    order = [room for line in house.PLANS[package] for room in line.split()]
    imports = {
        (house.room_of(file), name.split(".")[1])
        for owner, file in house.FILES
        if owner == package
        for name in house.imports_of(owner, file)
        if name.startswith(f"{package}.")
    }
    known = [(a, b) for a, b in imports if a != b and {a, b} <= {*order}]
    return tuple(sorted(known, key=lambda pair: [order.index(room) for room in pair]))


def needed(pairs: tuple[tuple[str, str], ...]) -> Iterator[tuple[str, str]]:
    """Yield the arrows that do not follow from others.

    Examples
    --------
    >>> list(needed((("b", "a"), ("c", "a"), ("c", "b"))))
    [('b', 'a'), ('c', 'b')]
    """
    below: Mapping[str, set[str]] = {a: {b for x, b in pairs if x == a} for a, _ in pairs}

    def reached(room: str) -> set[str]:
        near = below.get(room, set())
        return near.union(*map(reached, near))

    for a, b in pairs:
        if not any(b in reached(other) for other in below[a] - {b}):
            yield a, b


def between(lower: Box, upper: Box) -> tuple[float, float, float, float]:
    """Return where an arrow from one box up to another begins and ends."""
    low, high = max(lower[0], upper[0]), min(lower[0] + lower[2], upper[0] + upper[2])
    middle = (low + high) / 2
    return middle, lower[1], middle, upper[1] + upper[3] + 2


def arrow(*ends: float) -> str:
    """Return an arrow: x and y of its beginning and of its end."""
    x, y, to_x, to_y = (round(end, 1) for end in ends)
    return f'<path class="arrow" d="M{x:g} {y:g} {to_x:g} {to_y:g}"/>'


def box(where: Box, name: str, words: list[str], kind: str) -> list[str]:
    """Return a box with its name and its words."""
    x, y, width, height = (round(number, 1) for number in where)
    rectangle = (
        f'<rect class="{kind}" x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="6"/>'
    )
    middle = x + width / 2
    return [
        rectangle,
        *text(middle, y + 19, [name], "name"),
        *text(middle, y + NAME + 5, words, ""),
    ]


def text(x: float, y: float, lines: list[str], kind: str) -> list[str]:
    """Return lines of text around x, the first on the height y."""
    return [
        f'<text class="{kind}" text-anchor="middle" x="{x:.1f}" y="{y + LINE * number:.1f}">'
        f"{escape(line)}</text>"
        for number, line in enumerate(lines)
    ]
