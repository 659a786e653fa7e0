# PYTHON_ARGCOMPLETE_OK
"""Run the command line: ``python -m eigbench``, and the script ``eigbench``.

The process of a predictor imports this module anew, so it imports nothing by itself: the
predictor's peak memory would have the command line's packages in it.
"""


def run() -> int:
    """Run the command line and return its exit code."""
    from synthnet import processes

    return processes.run("eigbench", _main)


def _main() -> int:
    from eigbench.commands.cli import main

    return main()


if __name__ == "__main__":
    raise SystemExit(run())
