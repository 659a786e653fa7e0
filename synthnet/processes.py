"""Ctrl-C, and SIGTERM as sent by schedulers, noticed even where the exception is lost.

An exception that a signal raises inside a destructor or a C extension's callback is
printed or dropped there, and the program goes on. So the signal is also written down, and
a long loop asks for it.
"""

import signal
import threading
from types import FrameType

EXIT_CODE = 130  # by the shell's convention 128 + SIGINT; for SIGTERM too: both are interruptions

_seen = threading.Event()


def notice_interrupts() -> None:
    """From now on write Ctrl-C and SIGTERM down, and raise ``KeyboardInterrupt``."""
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
