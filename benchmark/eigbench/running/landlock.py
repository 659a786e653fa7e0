"""Landlock: a process gives up, for itself and all that it starts, what it need not reach.

Three calls of the Linux kernel (landlock(7)) by ctypes, since 5.13: a set of rules is made, paths
are added to it, and the process is held to it. A filter of its calls (:mod:`.calls`) keeps it from
making sockets, and what outlives it. No privilege is needed, and no mount.
"""

import ctypes
import json
import os
import platform
import struct
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from eigbench.running import calls

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # the same numbers on every machine
VERSION, PATH_BENEATH = 1, 1
CAPABILITIES, NO_SETS = struct.pack("=Ii", 0x20080522, 0), bytes(24)  # root may look past Landlock
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE, IOCTL_DEV = 0, 1, 2, 3, 14, 15  # bits
RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}  # by the kernel's version: how many bits it knows
NETWORK_SINCE, SCOPED_SINCE = 4, 6  # connecting and listening by TCP; signals to others

READ = 1 << EXECUTE | 1 << READ_FILE | 1 << READ_DIR
OF_FILES = 1 << EXECUTE | 1 << WRITE_FILE | 1 << READ_FILE | 1 << TRUNCATE | 1 << IOCTL_DEV


def version() -> int:
    """Return the version of Landlock that the kernel has; 0 where there is none."""
    if sys.platform != "linux" or platform.machine() not in calls.ARCHITECTURES:
        return 0
    return max(int(calls.libc().syscall(CREATE_RULESET, None, 0, VERSION)), 0)


def enter(note: Path) -> None:
    """Hold this process to what a file lists, in a directory that it names.

    Its JSON has the arguments of :func:`restrict`, and a ``directory``. A process that runs several
    threads must not be held: the kernel holds only one.
    """
    grants = json.loads(note.read_text())
    os.chdir(grants.pop("directory"))
    restrict(**{name: [Path(path) for path in paths] for name, paths in grants.items()})


def restrict(shown: Iterable[Path], listed: Iterable[Path], writable: Sequence[Path]) -> None:
    """Hold this process to some paths, to no network, and to what ends with it.

    ``shown`` are files, and directories with all below them, that may be read and executed;
    ``listed`` are directories whose names may be read, and those of all directories below them;
    ``writable`` may be written to as well, directories with all below them.

    Raises
    ------
    OSError
        If the kernel refuses.
    """
    kernel = version()
    every = (1 << RIGHTS[min(kernel, max(RIGHTS))]) - 1
    facts = [every]
    if kernel >= NETWORK_SINCE:
        facts.append(0b11)
    if kernel >= SCOPED_SINCE:
        facts.append(0b11)  # sockets without a path, and signals
    attribute = struct.pack(f"={len(facts)}Q", *facts)
    rules = _call(CREATE_RULESET, attribute, len(attribute), 0)
    granted = ((shown, READ & every), (listed, 1 << READ_DIR), (writable, every))
    for paths, rights in granted:
        for path in paths:
            _allow(rules, path, rights)
    calls.refuse(calls.SOCKETS, calls.KEEPING)  # Landlock knows TCP alone
    if calls.libc().capset(CAPABILITIES, NO_SETS):
        raise OSError(ctypes.get_errno(), "privileges could not be given up")
    _call(RESTRICT_SELF, rules, 0)
    os.close(rules)


def _allow(rules: int, path: Path, rights: int) -> None:
    try:
        beneath = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except FileNotFoundError:
        return  # what is not there need not be shown
    try:
        rights &= -1 if path.is_dir() else OF_FILES
        _call(ADD_RULE, rules, PATH_BENEATH, struct.pack("=Qi", rights, beneath), 0)
    finally:
        os.close(beneath)


def _call(number: int, *arguments: int | bytes) -> int:
    wide = (ctypes.c_long(a) if isinstance(a, int) else a for a in arguments)
    done = calls.libc().syscall(ctypes.c_long(number), *wide)
    if done < 0:
        raise OSError(ctypes.get_errno(), f"Landlock's call {number} was refused")
    return int(done)
