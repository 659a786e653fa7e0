"""Print what many meshes would cost: the measured build of 1.0 times the ratio of the shapes."""

import argparse
import json
from pathlib import Path

MEASURED = Path(__file__).parent.parent / "docs" / "data" / "build-1.0.json"


def main() -> None:
    """Read the measurement and print one line a quantity."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--meshes", type=int, default=1_000_000)
    parser.add_argument("--cores", type=int, default=64)
    options = parser.parse_args()
    report = json.loads(MEASURED.read_text())
    drawn = sum(row["drawn"] for row in report["families"])
    core_hours = sum(row["core_seconds"] for row in report["families"]) / 3600
    ratio = options.meshes / drawn
    print(f"measured    {drawn:,} meshes of {report['version']}: {core_hours:.2f} core-hours,")
    print(f"            {report['bytes'] / 1e9:.2f} GB")
    print(f"ratio       {ratio:.1f}")
    print(f"core-hours  {core_hours * ratio:.1f}")
    print(f"hours       {core_hours * ratio / options.cores:.2f} on {options.cores} cores")
    print(f"GB          {report['bytes'] * ratio / 1e9:.1f}")


if __name__ == "__main__":
    main()
