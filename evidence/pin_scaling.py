"""Pin meshes, labels and limits of the scaling track: benchmark/eigbench/scaling/surfaces.parquet.

    python scripts/pin_scaling.py 1000 10000

    python scripts/pin_scaling.py 100000 1000000

What is pinned already stays as it is; each mesh is written as soon as it is done, so an
interrupted run goes on where it stopped. The limit of a surface is computed with its first mesh.
`eigbench scaling --verify` makes all anew and compares.
"""

import argparse
import time
from pathlib import Path

from eigbench.scaling import surfaces

TARGET = Path(__file__).parent.parent / "benchmark" / "eigbench" / "scaling" / surfaces.PINS


def main() -> None:
    """Add what is missing."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sizes", nargs="+", type=int, choices=surfaces.SIZES, metavar="SIZE")
    sizes = parser.parse_args().sizes
    found = dict(surfaces.read())
    limits = {one.surface: (one.limit, one.limit_error) for one in found.values()}
    for size in sorted(set(sizes)):
        for surface in surfaces.SURFACES:
            if (surface, size) in found:
                continue
            started = time.perf_counter()
            one = surfaces.make(surface, size, limits.get(surface))
            limits[surface] = one.limit, one.limit_error
            found[surface, size] = one
            surfaces.write(TARGET, found.values())
            took = time.perf_counter() - started
            print(
                f"{surface}, {one.vertices:,} vertices: {took:.1f} s, residual "
                f"{one.certificate.residual:.0e}, discretisation error "
                f"{100 * one.discretisation_error:.2g} %, limit good to "
                f"{100 * (one.limit_error / one.limit).max():.1g} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
