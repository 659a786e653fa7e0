# PYTHON_ARGCOMPLETE_OK
"""The entry of the command line: ``synthnet`` and ``python -m synthnet``."""

import sys

from synthnet.processes import EXIT_CODE, notice_interrupts


def run() -> int:
    """Run the command line; Ctrl-C is one line at any time, also while modules are imported."""
    notice_interrupts()
    try:
        from synthnet.commands.cli import main

        return main()
    except KeyboardInterrupt:
        sys.stderr.write(
            "synthnet: interrupted; finished shards are kept, run the same command to go on\n"
        )
        return EXIT_CODE


if __name__ == "__main__":
    raise SystemExit(run())
