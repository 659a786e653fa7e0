"""Every process notices an interrupt, and a worker ends when its parent is gone.

An exception that a signal raises inside a destructor or a C extension's callback is printed
or dropped there, and the program continues. So Ctrl-C, and SIGTERM as schedulers send it,
are also recorded, and long loops check the record.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing import connection
from types import FrameType

EXIT_CODE = 130  # by the shell's convention 128 + SIGINT; for SIGTERM too: both are interruptions

_seen = threading.Event()


def notice_interrupts() -> None:
    """From now on record Ctrl-C and SIGTERM, and raise ``KeyboardInterrupt``."""
    for number, default in (
        (signal.SIGINT, signal.default_int_handler),
        (signal.SIGTERM, signal.SIG_DFL),
    ):
        if signal.getsignal(number) == default:
            signal.signal(number, _notice)


def raise_if_interrupted() -> None:
    """Raise ``KeyboardInterrupt`` if Ctrl-C has been pressed, or SIGTERM sent.

    Raises
    ------
    KeyboardInterrupt
        If it has.
    """
    if _seen.is_set():
        raise KeyboardInterrupt


def _notice(number: int, frame: FrameType | None) -> None:
    _seen.set()
    raise KeyboardInterrupt


def follow_parent() -> None:
    """From now on end this process when its parent is gone, whatever it is doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)
