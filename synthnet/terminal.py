"""The parser, exit code, guesses and progress column that both command lines share."""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from rich.progress import ProgressColumn, Task
from rich.text import Text

WRONG_INPUT = 2  # exit code if the input, the directory or the machine is unsuitable


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a question to add to a message on an unknown word: which known one was meant.

    Examples
    --------
    >>> suggestion("1.0-mni", ["1.0", "1.0-mini"]), suggestion("frobnicate", ["build"])
    ('; did you mean 1.0-mini?', '')
    """
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else ""


class Parser(argparse.ArgumentParser):
    """A parser that prints an error as one line and accepts no abbreviated options."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **options})

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse the command line; what is not known is an error of this parser, a command's too."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            known = [name for action in self._actions for name in action.option_strings]
            guess = suggestion(unknown[0].partition("=")[0], known)
            self.error(f"unrecognized arguments: {' '.join(unknown)}{guess}")
        return found, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Say which of the choices may have been meant."""
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            known = [str(choice) for choice in action.choices or ()]
            error.message += suggestion(str(value), known)
            raise

    def error(self, message: str) -> NoReturn:
        """Print the error and how to get help, and exit."""
        self.exit(WRONG_INPUT, f"{self.prog}: {message} (`{self.prog} --help` shows how)\n")


class Rate(ProgressColumn):
    """A column of meshes per second since the family's first shard began."""

    def render(self, task: Task) -> Text:
        """Return the rate, or nothing before the first mesh is done."""
        seconds = task.finished_time or task.elapsed
        if not task.completed or not seconds:
            return Text("")
        return Text(f"{task.completed / seconds:7.1f} meshes/s", style="cyan")
