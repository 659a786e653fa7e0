"""Create a virtual environment that has pip, on any machine with Python 3.11 or newer.

Debian and Ubuntu move ``ensurepip`` out of Python into the package python3-venv. Where
that is not installed ``python3 -m venv`` fails; this script then downloads a pinned pip
from the package index, over a connection whose certificate is checked, checks its digest
and installs it. It needs nothing but the standard library.

Usage: ``python3 scripts/make_venv.py DIRECTORY``
"""

from __future__ import annotations  # so that an old Python gets as far as its message

import hashlib
import html.parser
import http.client
import os
import ssl
import subprocess
import sys
import tempfile
import urllib.parse
import urllib.request
from pathlib import Path
from typing import NoReturn

PYTHON = (3, 11)
WHEEL = "pip-26.3-py3-none-any.whl"
SHA256 = "f3b60b20ffaadd4415ed7957212a38ac63fa4c5fa375bd0f4a797777940fad13"
TIMEOUT = 60  # seconds without a byte from the index


def fail(message: str) -> NoReturn:
    """Print in one line what is wrong, and stop."""
    print(f"make_venv: {message}", file=sys.stderr)
    sys.exit(2)


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command and capture what it prints."""
    return subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False
    )


def make(directory: Path) -> None:
    """Create the environment; do nothing if it is there and has pip."""
    python = directory / "bin" / "python"
    if python.exists() and run(python, "-m", "pip", "--version").returncode == 0:
        return
    if run(sys.executable, "-m", "venv", directory).returncode == 0:
        return
    done = run(sys.executable, "-m", "venv", "--without-pip", directory)
    if done.returncode != 0:
        reason = (done.stderr or done.stdout).strip().splitlines()[-1:]
        fail(f"cannot create {directory}: {''.join(reason)}")
    index = os.environ.get("PIP_INDEX_URL") or "https://pypi.org/simple"
    try:
        wheel = download_pip(index)
    except (OSError, ValueError, http.client.HTTPException) as error:
        host = urllib.parse.urlsplit(index).hostname or index
        if isinstance(getattr(error, "reason", None), ssl.SSLCertVerificationError):
            fail(
                f"cannot check the certificate of the package index {host}: install "
                "ca-certificates or python3-venv, or set PIP_CERT or SSL_CERT_FILE to a file "
                "of certificates"
            )
        fail(f"cannot get pip from the package index {host}: {error}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, WHEEL)
        file.write_bytes(wheel)
        # A wheel is a zip file, which Python can run; this is pip installing itself.
        # --ignore-installed overwrites what an interrupted installation left there.
        pip = (python, file / "pip", "--isolated", "install", "--no-index")
        done = run(*pip, "--ignore-installed", file)
    if done.returncode != 0:
        fail(f"cannot install {WHEEL}: {done.stderr.strip()}")


def download_pip(index: str) -> bytes:
    """Return the pinned wheel of pip from a package index, its digest checked."""
    context = ssl.create_default_context(cafile=os.environ.get("PIP_CERT") or None)

    def get(url: str) -> tuple[str, bytes]:
        with urllib.request.urlopen(url, timeout=TIMEOUT, context=context) as answer:
            return answer.url, answer.read()

    page, text = get(index.rstrip("/") + "/pip/")
    links = Links()
    links.feed(text.decode())
    for link in links.targets:
        url = urllib.parse.urldefrag(urllib.parse.urljoin(page, link)).url
        if url.endswith("/" + WHEEL):
            wheel = get(url)[1]
            if hashlib.sha256(wheel).hexdigest() != SHA256:
                raise ValueError(f"its {WHEEL} has the wrong SHA-256 digest")
            return wheel
    raise ValueError(f"it does not list {WHEEL}")


class Links(html.parser.HTMLParser):
    """The targets of the links of a page, in ``targets``."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep the target of an ``<a>``."""
        if tag == "a":
            self.targets += [url for name, url in attrs if name == "href" and url]


if __name__ == "__main__":
    if sys.version_info < PYTHON:
        running, needed = (".".join(map(str, v[:2])) for v in (sys.version_info, PYTHON))
        fail(f"Python {needed} or newer is needed, and {sys.executable} is {running}")
    if len(sys.argv) != 2:
        fail("usage: make_venv.py DIRECTORY")
    make(Path(sys.argv[1]))
