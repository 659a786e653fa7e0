"""What both command lines share: a parser, exit codes, and a column of progress."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from rich.progress import ProgressColumn, Task
from rich.text import Text

WRONG_INPUT = 2  # exit code where the input, the directory or the machine will not do


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, and that takes no abbreviated options."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **options})

    def error(self, message: str) -> NoReturn:
        """Print the error and where help is, and exit."""
        self.exit(WRONG_INPUT, f"{self.prog}: {message} (`{self.prog} --help` shows how)\n")


class Rate(ProgressColumn):
    """Meshes per second since the family's first shard began."""

    def render(self, task: Task) -> Text:
        """Return the rate, or nothing before there is one."""
        seconds = task.finished_time or task.elapsed
        if not task.completed or not seconds:
            return Text("")
        return Text(f"{task.completed / seconds:7.1f} meshes/s", style="cyan")
