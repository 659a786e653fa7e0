# PYTHON_ARGCOMPLETE_OK
"""The entry of the command line: ``synthnet`` and ``python -m synthnet``."""

from synthnet import processes


def run() -> int:
    """Run the command line; Ctrl-C is one line at any time, also while modules are imported."""
    message = "interrupted; finished shards are kept, run the same command to go on"
    return processes.run("synthnet", _main, message)


def _main() -> int:
    from synthnet.commands.cli import main

    return main()


if __name__ == "__main__":
    raise SystemExit(run())
