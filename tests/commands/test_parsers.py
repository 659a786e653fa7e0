"""What every command of both programs has: found in the parsers, so none can be forgotten."""

import argparse
import os
import re
import shlex
import subprocess
import sys

import eigbench.commands.cli
import pytest

import synthnet.commands.cli
from synthnet.terminal import Parser

PROGRAMS = {
    "synthnet": synthnet.commands.cli._parser,
    "eigbench": eigbench.commands.cli._parser,
}


def commands_of(parser):
    (commands,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return dict(commands.choices)


PARSERS = {
    parser.prog: parser
    for make in PROGRAMS.values()
    for parser in (make(), *commands_of(make()).values())
}
COMMANDS = {name: parser for name, parser in PARSERS.items() if " " in name}
every_command = pytest.mark.parametrize("name", COMMANDS)


def test_there_are_commands():
    assert {"synthnet build", "synthnet versions", "eigbench submit"} < COMMANDS.keys()
    assert all(type(parser) is Parser for parser in PARSERS.values())


@pytest.mark.parametrize("name", PARSERS)
def test_help_has_an_example_that_is_understood(name):
    examples = re.findall(r"^example: (.*)$", PARSERS[name].epilog or "", re.MULTILINE)
    assert len(examples) == 1
    program, *words = shlex.split(examples[0])
    assert f"{examples[0]} ".startswith(f"{name} ")
    assert callable(PROGRAMS[program]().parse_args(words).run)


@every_command
def test_help_says_what_the_command_is_for(name):
    program, _, command = name.partition(" ")
    parser = PARSERS[name]
    assert parser.description
    listed = " ".join(PARSERS[program].format_help().split())
    assert f"{command} {parser.description.replace('%%', '%')}" in listed


@every_command
def test_help_says_every_default(name):
    actions = COMMANDS[name]._actions
    optional = [action for action in actions if action.nargs != 0 and not action.required]
    assert len(actions) > 2  # --help, --json and --traceback take no value
    for action in optional:
        what = f"{name} {action.option_strings or action.dest}"
        text = str(action.help) % {**vars(action), "prog": name}
        assert "(default: " in text, what
        if isinstance(action.default, int | float | str) and action.default != argparse.SUPPRESS:
            shown = re.search(r"\(default: ([^\s;,)]+)", text)
            assert shown is not None
            assert shown[1] == f"{action.default}".removesuffix(".0" * (shown[1].isdigit())), what


@every_command
def test_a_misspelt_option_is_guessed_and_the_commands_help_named(name, capsys):
    parser = COMMANDS[name]
    options = [o for a in parser._actions for o in a.option_strings if o.startswith("--")]
    assert {"--json", "--traceback"} <= {*options}
    for option in options:
        with pytest.raises(SystemExit) as stopped:
            parser.parse_args([f"{option}x"])
        assert stopped.value.code == 2
        line = f"{name}: unrecognized arguments: {option}x; did you mean {option}? "
        assert capsys.readouterr().err == f"{line}(`{name} --help` shows how)\n"


@every_command
def test_one_word_names_a_dataset(name):
    options = {o for a in COMMANDS[name]._actions for o in a.option_strings}
    assert ("--version" in options) <= ("--dataset" in options)
    if "--dataset" in options:
        assert options & {"--root", "--out"}


# Completion, as argcomplete asks for it

SPHERES = [f"sphere-0000{number}" for number in (0, 1, 2, 4, 7)]  # of 1.0-mini


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("synthnet bui", ["build"]),
        ("synthnet info 1.0-", ["1.0-mini", "1.0-small"]),
        ("synthnet info --data", ["--dataset"]),
        ("synthnet show --dataset 2.0-m", ["2.0-mini"]),
        ("synthnet show --dataset 1.0-mini --out {home} sphere-0000", SPHERES),
        ("synthnet gallery --dataset 1.0-mini tor", ["torus"]),
        ("synthnet build --engine da", ["dask"]),
        ("eigbench lead", ["leaderboard"]),
        ("eigbench evaluate a.py --dataset 1.0-", ["1.0-mini", "1.0-small"]),
        ("eigbench evaluate a.py --dataset 2.0 --protocol gen", ["genus"]),
        ("eigbench compare a b --target sur", ["surface"]),
        ("eigbench submit --dry", ["--dry-run"]),
    ],
)
def test_the_shell_completes(line, expected, mini_home, environment, tmp_path):
    text, answer = line.format(home=mini_home), tmp_path / "answer"
    program = text.partition(" ")[0]
    asking = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_SUPPRESS_SPACE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "COMP_LINE": text,
        "COMP_POINT": str(len(text)),
        "COMP_TYPE": "",
        "SYNTHNET_HOME": str(tmp_path),
    }
    done = subprocess.run(
        [sys.executable, "-m", program],
        env={**os.environ, **environment, **asking},
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert {word.strip() for word in answer.read_text().split("\n")} == {*expected}, done.stderr
    assert done.stdout == ""
