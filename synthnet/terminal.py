"""What both command lines share: parser, completion, errors, exit code, answers, progress."""

import argparse
import io
import json
import math
import os
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from synthnet.errors import suggestion
from synthnet.processes import more_memory

LOGGED = 5.0  # seconds between lines that say what is being done, in a log
WRONG_INPUT = 2  # exit code if the input, the directory or the machine is unsuitable
UNSUITABLE = (ValueError, OSError, MemoryError)  # is one line, beside a package's own errors

Commands: TypeAlias = "argparse._SubParsersAction[Any]"


class Parser(argparse.ArgumentParser):
    """A parser that prints an error as one line and accepts no abbreviated options."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **options})

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse the command line; what is not known is an error of this parser, a command's too."""
        self._check_options(sys.argv[1:] if args is None else args)
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return options, unknown

    def _check_options(self, words: Sequence[str]) -> None:
        """Refuse an unknown option first: else what it was to give would be said to be missing."""
        known = self._option_string_actions
        for word in words:
            if word == "--" or (self._subparsers is not None and not word.startswith("-")):
                return  # what follows are no options, or those of a command
            name = word.partition("=")[0]
            if name.startswith("--") and " " not in name and name not in known:
                self.error(f"unrecognized arguments: {word}{self._hint(name)}")

    def _hint(self, option: str) -> str:
        """Return what may have been meant by an unknown option."""
        known = self._option_string_actions
        if option == "--version" and "--dataset" in known:
            return "; did you mean --dataset?"
        groups = [] if self._subparsers is None else self._subparsers._group_actions
        commands = [command for group in groups for command in dict(group.choices or {}).values()]
        if any(option in command._option_string_actions for command in commands):
            return "; it is an option of commands: put it after the command's name"
        return suggestion(option, known)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Say which of the choices may have been meant."""
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            known = [str(choice) for choice in action.choices or ()]
            error.message += suggestion(str(value), known)
            raise

    def exit(self, status: int = 0, message: str | None = None) -> NoReturn:
        """Exit, after help or a version has been printed: that may fail too."""
        problem = _flush()
        if problem is not None and not isinstance(problem, BrokenPipeError):
            status, message = WRONG_INPUT, f"{self.prog}: {in_words(problem)}\n"
        super().exit(status, message)

    def error(self, message: str) -> NoReturn:
        """Print the error and how to get help, and exit."""
        self.exit(WRONG_INPUT, f"{self.prog}: {message} (`{self.prog} --help` shows how)\n")


class DatasetName(argparse.Action):
    """Keep the dataset's name, given by a word or an option, and refuse a second one."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Keep the name."""
        first = getattr(namespace, "named", values)
        if first != values:
            parser.error(f"two datasets are named, {first} and {values}: name one")
        namespace.version = namespace.named = values


def add_command(
    commands: Commands,
    name: str,
    run: Callable[[argparse.Namespace], int],
    text: str,
    example: str = "",
) -> argparse.ArgumentParser:
    """Add a command, with an example and the options that all commands of both programs have."""
    command: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text)
    command.epilog = f"example: {command.prog} {example}".rstrip()
    command.set_defaults(run=run)
    command.add_argument("--json", action="store_true", help="print machine-readable JSON")
    command.add_argument(
        "--traceback", action="store_true", help="on an error, also print the Python traceback"
    )
    return command


def complete_with(
    action: argparse.Action, names: Callable[[argparse.Namespace], Iterable[str]]
) -> None:
    """Let the shell complete an argument by names; they are looked up when it asks."""

    def completer(parsed_args: argparse.Namespace, **_: Any) -> list[str]:
        return list(names(parsed_args))

    action.completer = completer  # type: ignore[attr-defined]  # argcomplete's name for it


def parse(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Parse the command line, or answer the shell that asks how it may go on."""
    _open_streams()
    if "_ARGCOMPLETE" in os.environ:  # set by the function that the shell calls at a tab
        from argcomplete import autocomplete
        from argcomplete.finders import safe_actions

        safe_actions.add(DatasetName)  # so that completers see which is named
        autocomplete(parser)
    return parser.parse_args(arguments)


def run(program: str, options: argparse.Namespace, *expected: type[Exception]) -> int:
    """Run the command of parsed options and return its exit code.

    An error that is expected, by a wrong value or of the system too, is one line; with
    ``--traceback`` the lines of code come before it.
    """
    wrong: tuple[type[Exception], ...] = (*UNSUITABLE, *expected)
    code, problem = 0, None
    try:
        _check_working_directory()
        code = options.run(options)
    except wrong as error:
        problem = error
    unwritten = _flush()
    if problem is None or (isinstance(problem, OSError) and problem.filename is None):
        problem = unwritten or problem  # what a print raises says no file
    if isinstance(problem, BrokenPipeError):
        sys.stderr.close()  # the reader of a pipe has gone: nothing is left to say
        return code
    return code if problem is None else report(program, options, problem)


def at_least(least: int) -> Callable[[str], int]:
    """Return what reads a number of the command line that has a least value."""

    def number(text: str) -> int:
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"must be at least {least}, got {value}")
        return value

    number.__name__ = "int"  # argparse's name for what is no number at all
    return number


def above_zero(text: str) -> float:
    """Return a number of the command line that is above zero."""
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"must be above 0, got {value:g}")
    return value


above_zero.__name__ = "float"  # argparse's name for what is no number at all


def _open_streams() -> None:
    """Let what is printed go nowhere where a stream is closed, and no character keep it back."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # print would take the other one
            nowhere = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - it stays open
            setattr(sys, name, nowhere)
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # as stderr does


def _flush() -> OSError | None:
    """Write what is still to be printed; return the error if it cannot be written.

    Standard output is closed then, or Python would try again when it ends, and exit with 120.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        with suppress(OSError):
            sys.stdout.close()
        return type(error)(error.errno, error.strerror, "standard output")
    return None


def report(program: str, options: argparse.Namespace, error: Exception) -> int:
    """Say what is wrong on one line, after the lines of code if they are wanted; return 2."""
    if options.traceback:
        traceback.print_exception(error)
    sys.stderr.write(f"{program}: {in_words(error)}\n")
    return WRONG_INPUT


def _check_working_directory() -> None:
    """Raise ValueError where another process has removed it: relative paths lead nowhere."""
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise ValueError("the working directory was removed: change to another one") from error


def in_words(error: Exception) -> str:
    """Return an error on one line; of the system's, the file and what is wrong with it."""
    if isinstance(error, MemoryError):
        return f"out of memory: {more_memory('close other programs, or take less at once')}"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def print_json(value: Any) -> None:
    """Print a value as the commands' ``--json`` does; a number that is not finite is null."""
    sys.stdout.write(json.dumps(_without_infinities(value), indent=1, allow_nan=False) + "\n")


def _without_infinities(value: Any) -> Any:
    """Return a value with None for numbers that are not finite, which JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _without_infinities(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_without_infinities(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_answer(options: argparse.Namespace, value: Any, text: str) -> None:
    """Print what a command answers: a value with ``--json``, else text."""
    if options.json:
        print_json(value)
    else:
        sys.stdout.write(f"{text}\n")


class Rate(ProgressColumn):
    """A column of how many of something are done per second, since the first was begun."""

    def __init__(self, of: str) -> None:
        super().__init__()
        self.of = of

    def render(self, task: Task) -> Text:
        """Return the rate, or nothing before the first is done."""
        seconds = task.finished_time or task.elapsed
        if not task.completed or not seconds:
            return Text("")
        return Text(f"{task.completed / seconds:7.1f} {self.of}/s", style="cyan")


class _Bars(Progress):
    """Bars that leave no empty line in a log where none of them was shown."""

    def stop(self) -> None:
        """Stop; rich ends the last line of a log, whether there is one or not."""
        if self.tasks and self.live.is_started:
            super().stop()
        else:
            self.live.stop()


@contextmanager
def at_work() -> Iterator[Callable[[str], None]]:
    """Show what is being done, on standard error: in a terminal at once, in a log now and then.

    Yield a function that takes what it is.
    """
    console, doing, ended = Console(stderr=True), [""], threading.Event()
    with console.status("") as status:

        def say(what: str) -> None:
            doing[0] = what
            status.update(escape(what))

        def log() -> None:
            said = ""
            while not ended.wait(LOGGED):
                if doing[0] != said:
                    said = doing[0]
                    sys.stderr.write(f"{said}\n")
                    sys.stderr.flush()

        if not console.is_terminal:
            threading.Thread(target=log, daemon=True).start()
        try:
            yield say
        finally:
            ended.set()


def progress(text: str, console: Console | None = None, *, of: str = "meshes") -> Progress:
    """Return bars with counts and rates of something, on standard error, after a text."""
    return _Bars(
        TextColumn(text),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(of),
        TimeRemainingColumn(),
        console=console or Console(stderr=True),
    )
