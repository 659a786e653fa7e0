"""What a process asks of the Linux kernel for itself, and calls that it gives up.

It gives them up for all that it starts, too. A filter of seccomp(2) looks at the number of each
call. No privilege is needed.
"""

from __future__ import annotations

import ctypes
import errno
import platform
import struct
from collections.abc import Iterable, Mapping

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36
PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER = 38, 22, 2
# What a step of a filter does, and what becomes of a call.
LOAD, EQUAL, GREATER, RETURN = 0x20, 0x15, 0x25, 0x06
ALLOW, REFUSE = 0x7FFF0000, 0x00050000 | errno.EACCES
X32 = 0x40000000  # from here on, x86-64 has a second set of calls

# How the kernel names a machine, and the numbers of its calls.
ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7, "riscv64": 0xC00000F3}
SOCKETS = {  # socket, io_uring_setup, which makes sockets too
    "x86_64": (41, 425),
    "aarch64": (198, 425),
    "riscv64": (198, 425),
}
_GENERIC = (194, 190, 186, 180, 217, 218, 219)
# shmget, semget, msgget, mq_open, add_key, request_key, keyctl: what they make outlives a process
KEEPING = {
    "x86_64": (29, 64, 68, 240, 248, 249, 250),
    "aarch64": _GENERIC,
    "riscv64": _GENERIC,
}


def libc() -> ctypes.CDLL:
    """Return the C library of this process; what a call of it said is at ``ctypes.get_errno``."""
    return ctypes.CDLL(None, use_errno=True)


def prctl(option: int, *arguments: int | bytes) -> int:
    """Ask something of the kernel for this process, see prctl(2); it has refused if this is not 0.

    All arguments that are not given are 0, as some options need it.
    """
    return int(libc().prctl(option, *arguments, *(4 - len(arguments)) * (0,)))


def refuse(*kinds: Mapping[str, tuple[int, ...]]) -> None:
    """Let this process and all that it starts make no call of some kinds: they fail with EACCES.

    Nor do they gain a privilege by starting a program. On a machine whose calls are not known here,
    nothing is refused.

    Raises
    ------
    OSError
        If the kernel has no such filters.
    """
    machine = platform.machine()
    if machine not in ARCHITECTURES:
        return
    program = _program(ARCHITECTURES[machine], [call for kind in kinds for call in kind[machine]])
    filters = ctypes.create_string_buffer(program)
    described = struct.pack("@HP", len(program) // 8, ctypes.addressof(filters))
    if prctl(PR_SET_NO_NEW_PRIVS, 1) or prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, described):
        raise OSError(ctypes.get_errno(), "calls of the system could not be given up")


def _program(architecture: int, calls: Iterable[int]) -> bytes:
    """Return the steps of a filter that refuses some calls, eight bytes each."""
    refused = tuple(calls)
    last = len(refused) + 1  # steps from before the first of them to the one that refuses
    steps = [
        (LOAD, 0, 0, 4),  # the architecture
        (EQUAL, 1, 0, architecture),
        (RETURN, 0, 0, REFUSE),
        (LOAD, 0, 0, 0),  # the call's number
        (GREATER, last, 0, X32 - 1),
        *((EQUAL, last - 1 - i, 0, call) for i, call in enumerate(refused)),
        (RETURN, 0, 0, ALLOW),
        (RETURN, 0, 0, REFUSE),
    ]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)
