"""The outcome of checks: how many things each looked at, and what differed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from synthnet.store.storage import Location


@dataclass(frozen=True, slots=True)
class Check:
    """The outcome of one check: how many things were looked at, and what differed."""

    name: str
    examined: int
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class VerifyReport:
    """All checks of a dataset."""

    directory: Location
    checks: tuple[Check, ...]

    @property
    def problems(self) -> tuple[str, ...]:
        """Everything that differed."""
        return tuple(problem for check in self.checks for problem in check.problems)


class Findings:
    """Collects what the checks of a dataset find, by the name of the check."""

    def __init__(self, names: Iterable[str]) -> None:
        self.problems: dict[str, list[str]] = {name: [] for name in names}
        self.examined = dict.fromkeys(self.problems, 0)

    def add(self, name: str, problems: Iterable[str], examined: int = 1) -> None:
        """Count what a check has looked at, and keep what differed."""
        self.problems[name] += problems
        self.examined[name] += examined

    def report(self, directory: Location) -> VerifyReport:
        """Return the report on the dataset in a directory."""
        checks = (
            Check(name, self.examined[name], tuple(problems))
            for name, problems in self.problems.items()
        )
        return VerifyReport(directory, tuple(checks))
