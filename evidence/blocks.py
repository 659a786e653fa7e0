"""The generated blocks of the pages: a table of what stands where, and how it is filled.

A block stands between ``<!-- begin NAME -->`` and ``<!-- end NAME -->`` of a page. It is a pure
function of files of docs/data, so it can be checked without measuring anything again.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from eigbench.board.markdown import marked

from evidence import DOCS, ROOT, numbers
from synthnet.store.files import write_text


@dataclass(frozen=True, slots=True)
class Block:
    """What a block is made from.

    Attributes
    ----------
    data
        Names of files of docs/data, without their suffix.
    render
        The module and the function that make the Markdown from the contents of these files.
    inline
        Whether the block stands within a paragraph.
    """

    data: tuple[str, ...]
    render: str
    inline: bool = False

    def text(self) -> str:
        """Return what stands between the marks."""
        text = rendered(self.render, self.data)
        return text if self.inline else f"\n{text}\n"


def rendered(render: str, data: Iterable[str]) -> Any:
    """Return what a module's function makes of the contents of files of docs/data."""
    module, _, function = render.partition(".")
    return getattr(import_module(f"evidence.{module}"), function)(*map(numbers.read, data))


CARDS = {"1.0": "dataset-card", "2.0": "dataset-card-2.0", "2.1": "dataset-card-2.1"}
OF_EVERY_CARD = {
    "composition": ("build", "card.composition"),
    "parameters": ("shapes", "shapes.parameter_table"),
    "sizes": ("shapes", "shapes.size_table"),
    "rejections": ("shapes", "shapes.rejections"),
    "splits": ("shapes", "shapes.split_table"),
}
# The key is the page in docs/ and the name in its marks.
LIMITS = ("limits-1.0", "limits-2.0", "limits-2.1")
BLOCKS = {
    "cite/entries": Block(("build-1.0", "build-2.0", "build-2.1"), "card.citations"),
    "clusters/million": Block(("build-1.0",), "card.many_meshes"),
    "clusters/memory": Block(("build-memory",), "build_memory.table"),
    "concepts/surfaces": Block(("surfaces",), "card.surfaces"),
    "concepts/weyl": Block(("concepts",), "concepts.weyl_caption"),
    "concepts/drums": Block(("concepts",), "concepts.drums_caption"),
    "concepts/mesh-error": Block(("concepts",), "concepts.errors_caption"),
    **{
        f"{page}/{name}": Block((f"{data}-{version}",), render)
        for version, page in CARDS.items()
        for name, (data, render) in OF_EVERY_CARD.items()
    },
    "dataset-card/split-cones": Block(("flaws-1.0",), "flaws.split_cones", inline=True),
    "dataset-card/inverted-cones": Block(("flaws-1.0",), "flaws.inverted_cones", inline=True),
    "dataset-card/below-20-db": Block(("limits-1.0",), "limits.below_20_db", inline=True),
    "dataset-card/cost": Block(("build-cost", "build-full", "loading-1.0"), "card.cost"),
    "dataset-card-2.1/real": Block((), "real_sets.more_families"),
    "dataset-card-2.1/changes": Block((), "real_sets.changes", inline=True),
    "dataset-card-2.0/family-trainings": Block(
        ("shapes-2.0",), "shapes.family_trainings", inline=True
    ),
    "dataset-card-2.0/folds": Block(("folds-2.0",), "folds.table"),
    "faq/takes": Block(("build-1.0", "build-2.0", "build-2.1"), "card.takes", inline=True),
    "faults/claim": Block(("faults",), "faults.claim", inline=True),
    "faults/faults": Block(("faults",), "faults.table"),
    "import/packages": Block(("packages",), "packages.table"),
    "import/labelled": Block(("packages",), "packages.claim", inline=True),
    "import/real-sets": Block((), "real_sets.table"),
    "labels/solver-claim": Block(("solver",), "solver.claim", inline=True),
    "labels/solver": Block(("solver",), "solver.table"),
    "labels/start": Block(("start",), "start.claim", inline=True),
    "labels/growth": Block(("growth",), "growth.table"),
    "labels/agreement": Block(LIMITS, "limits.agreement", inline=True),
    "labels/limits": Block(LIMITS, "limits.table"),
    "labels/failing": Block(LIMITS, "limits.failing_labels"),
    "learned/ablation": Block(("ritz-mlp",), "ritz_mlp.variants_table"),
    "learned/left-out": Block(("ritz-mlp",), "ritz_mlp.left_out_table"),
    "learned/pair": Block(("two-numbers",), "two_numbers.pair", inline=True),
    "learned/left": Block(("two-numbers",), "two_numbers.left", inline=True),
    "learned/accurate": Block((), "learned.accurate_table"),
    "learned/shares": Block((), "learned.share_table"),
    "learned/variants": Block(("two-numbers",), "two_numbers.table"),
    "learned/points": Block((), "learned.points_table"),
    "learned/held-out": Block((), "learned.held_out_table"),
    "real-shapes/ablation": Block(("multilevel",), "multilevel.variants"),
    "real-shapes/parts": Block(("parts",), "parts.table"),
    "real-shapes/sharp-bounds": Block(("thin-meshes",), "thin_meshes.sharp_bounds", inline=True),
    "real-shapes/loose": Block(("thin-meshes",), "thin_meshes.loose_bounds", inline=True),
    "real-shapes/thin": Block(("thin-meshes",), "thin_meshes.table"),
    "real-shapes/large": Block(("multilevel",), "multilevel.large_meshes"),
    "scaling/answer": Block((), "scaling_gain.answer", inline=True),
    "scaling/gain": Block((), "scaling_gain.table"),
    "start/full-runs": Block(("build-1.0", "build-2.0", "build-2.1"), "card.full_runs"),
    "spectrum/peers": Block(("peers",), "peers.table"),
    "spectrum/missed": Block(("missed",), "missed.table"),
    "spectrum/peers-long": Block(("peers",), "peers.long", inline=True),
    "spectrum/peers-claim": Block(("peers",), "peers.claim", inline=True),
    "spectrum/operators": Block(("operators",), "operators.table"),
    "submit/ratios": Block(("ratios",), "ratios.table"),
    "submit/call": Block((), "harness_overhead.call", inline=True),
    "README/paper-speed": Block(("gcn",), "paper_speed.short", inline=True),
    "README/installation": Block(("installation",), "installation.sizes", inline=True),
    "submit/overhead": Block(("harness-overhead",), "harness_overhead.table"),
}
PAGE = "reproduction"  # a page that is generated as a whole, with its pictures
# Blocks that another command writes.
ELSEWHERE = dict.fromkeys(("README/finding", "README/leaderboard"), "eigbench leaderboard")


def page_of(name: str) -> tuple[Path, str]:
    """Return the page of a block, and the name in its marks."""
    page, _, mark = name.partition("/")
    return (ROOT if page == "README" else DOCS) / f"{page}.md", mark


def fill(names: Iterable[str], *, check: bool = False) -> list[str]:
    """Write blocks into their pages, and return the names of those that had to change.

    Parameters
    ----------
    names
        Of :data:`BLOCKS`, or :data:`PAGE`.
    check
        Whether to write nothing.

    Raises
    ------
    ValueError
        If a page does not have the marks of a block exactly once; that page is left as it is.
    """
    stale = []
    for name in names:
        if name == PAGE:
            from evidence import reproduction  # with torch and Matplotlib, which no block needs

            stale += [name] if reproduction.fill(check=check) else []
            continue
        page, mark = page_of(name)
        old = page.read_text()
        try:
            new = marked(old, mark, BLOCKS[name].text())
        except ValueError as error:
            raise ValueError(f"{page} has {error}") from error
        if new != old:
            stale.append(name)
            if not check:
                write_text(page, new)
    return stale
