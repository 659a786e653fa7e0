"""Print what many meshes would cost: the measured build of 1.0 times the ratio of the shapes.

For a million meshes, docs/clusters.md gets the numbers too.
"""

import argparse
import json
from pathlib import Path

from synthnet.store.files import write_marked

DOCS = Path(__file__).parent.parent / "docs"
MEASURED, PAGE = DOCS / "data" / "build-1.0.json", DOCS / "clusters.md"
MILLION = 1_000_000


def cost(report: dict, meshes: int, cores: int) -> str:
    """Return the measured cost and that of so many meshes."""
    drawn = sum(row["drawn"] for row in report["families"])
    hours = sum(row["core_seconds"] for row in report["families"]) / 3600
    ratio = meshes / drawn
    return (
        f"Measured: {drawn:,} meshes of {report['version']} in {hours:.2f} core-hours, "
        f"{report['bytes'] / 1e9:.2f} GB.\n"
        f"{meshes:,} meshes: {hours * ratio:.1f} core-hours ({60 * hours * ratio / cores:.0f} "
        f"minutes on {cores} cores), {report['bytes'] * ratio / 1e9:.0f} GB.\n"
    )


def main() -> None:
    """Read the measurement and print what it says."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshes", type=int, default=MILLION)
    parser.add_argument("--cores", type=int, default=64)
    options = parser.parse_args()
    text = cost(json.loads(MEASURED.read_text()), options.meshes, options.cores)
    print(text, end="")
    if options.meshes == MILLION:
        write_marked(PAGE, million=f"\n{text}")


if __name__ == "__main__":
    main()
