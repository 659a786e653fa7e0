# PYTHON_ARGCOMPLETE_OK
"""Run the command line: ``python -m eigbench``, and the script ``eigbench``.

The process of a predictor imports this module anew, so it imports nothing by itself: the
predictor's peak memory would have the command line's packages in it.
"""

import sys


def run() -> int:
    """Run the command line and return its exit code."""
    from synthnet.processes import EXIT_CODE, notice_interrupts

    notice_interrupts()
    try:
        from eigbench.commands.cli import main

        return main()
    except KeyboardInterrupt:  # while modules are imported
        sys.stderr.write("eigbench: interrupted\n")
        return EXIT_CODE


if __name__ == "__main__":
    raise SystemExit(run())
