# PYTHON_ARGCOMPLETE_OK
"""The entry of the command line: ``synthnet`` and ``python -m synthnet``."""

from synthnet import processes


def run() -> int:
    """Run the command line; Ctrl-C is one line at any time, also while modules are imported."""
    return processes.run("synthnet", _main)


def _main() -> int:
    from synthnet.commands.cli import main

    return main()


if __name__ == "__main__":
    raise SystemExit(run())
