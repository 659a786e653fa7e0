"""Run the command line: ``python -m synthnet``."""

from synthnet.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
