"""The process between the harness and a predictor: what the predictor starts ends with it.

It starts the predictor's process and waits. Processes that a predictor leaves behind become its
children (on Linux), so that none escapes: all of them are killed when the predictor's own ends,
when the harness says so by SIGTERM, and when the harness is gone.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from pathlib import Path
from types import FrameType

from eigbench.running import calls, landlock

HELD = "held"  # in place of Landlock's rules
PACKAGES = "EIGBENCH_PACKAGES"  # a variable: a directory of packages that come before the others


def main() -> None:
    """Run a predictor's process that is given the descriptor of a socket; exit as it does.

    With a second argument it is in a sandbox: :data:`HELD` in one of bubblewrap, or else the file
    of Landlock's rules, to which it first holds itself. Nothing that it makes there outlives it.
    """
    descriptor, *sandbox = sys.argv[1:]
    if sandbox == [HELD]:
        calls.refuse(calls.KEEPING)
    elif sandbox:
        landlock.enter(Path(sandbox[0]))
    _find_packages()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the harness, which ends this
    if sys.platform == "linux":
        calls.prctl(calls.PR_SET_CHILD_SUBREAPER, 1)
        calls.prctl(calls.PR_SET_PDEATHSIG, signal.SIGTERM)
    signal.signal(signal.SIGTERM, _stop)
    predictor = os.fork()
    if predictor == 0:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        from eigbench.running.worker import work

        work(int(descriptor))
        sys.exit(0)
    os.close(int(descriptor))
    ended, status = os.wait()
    while ended != predictor:  # a process that the predictor has left behind
        ended, status = os.wait()
    end_children()
    code = os.waitstatus_to_exitcode(status)
    if code < 0:  # ended by a signal: so does this, for the harness to see
        signal.signal(-code, signal.SIG_DFL) if -code != signal.SIGKILL else None
        os.kill(os.getpid(), -code)
    sys.exit(code)


def _find_packages() -> None:
    """Let packages of the predictor's own be found, here and in what it starts.

    Not before this process is held: a package may run code as soon as Python finds it.
    """
    if packages := os.environ.get(PACKAGES):
        sys.path.insert(0, packages)
        rest = os.environ.get("PYTHONPATH", "")
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (packages, rest)))


def end_children() -> None:
    """Kill all processes below this one."""
    import psutil

    own = psutil.Process()
    with contextlib.suppress(ChildProcessError):  # there is none left
        while True:
            for child in own.children(recursive=True):
                with contextlib.suppress(psutil.NoSuchProcess):
                    child.kill()
            os.wait()


def _stop(number: int, frame: FrameType | None) -> None:
    end_children()
    os._exit(128 + number)


if __name__ == "__main__":
    main()
