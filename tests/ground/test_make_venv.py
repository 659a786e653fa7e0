"""The script that makes a virtual environment checks whom it takes pip from."""

import contextlib
import ssl
import subprocess
import urllib.error
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from scripts import make_venv


@pytest.fixture
def script(monkeypatch):
    """The script as on a machine that lacks python3-venv."""

    def run(*command):
        return subprocess.CompletedProcess(command, 0 if "--without-pip" in command else 1, "", "")

    monkeypatch.setattr(make_venv, "run", run)
    monkeypatch.setenv("PIP_INDEX_URL", "https://index.example/simple")
    monkeypatch.delenv("PIP_CERT", raising=False)
    return make_venv


@pytest.fixture
def refusal(script, capsys, tmp_path):
    """Return a function that runs the script, which must refuse: what it says."""

    def run():
        with pytest.raises(SystemExit) as stopped:
            script.make(tmp_path / "venv")
        assert stopped.value.code == 2
        return capsys.readouterr().err

    return run


def test_an_unknown_certificate_is_refused_in_one_line(script, refusal, monkeypatch):
    unknown = ssl.SSLCertVerificationError(1, "unknown issuer")
    urlopen = Mock(side_effect=urllib.error.URLError(unknown))
    monkeypatch.setattr(script.urllib.request, "urlopen", urlopen)
    assert refusal() == (
        "make_venv: cannot check the certificate of the package index index.example: install "
        "ca-certificates or python3-venv, or set PIP_CERT or SSL_CERT_FILE to a file of "
        "certificates\n"
    )
    urlopen.assert_called_once()
    options = urlopen.call_args.kwargs
    assert options["timeout"] == make_venv.TIMEOUT
    assert options["context"].verify_mode == ssl.CERT_REQUIRED
    assert options["context"].check_hostname


def test_an_index_that_does_not_answer_is_named(script, refusal, monkeypatch):
    silent = Mock(side_effect=urllib.error.URLError("timed out"))
    monkeypatch.setattr(script.urllib.request, "urlopen", silent)
    assert "cannot get pip from the package index index.example: " in refusal()


@pytest.mark.parametrize(
    ("page", "message"),
    [
        ('<a href="{wheel}">', "its {wheel} has the wrong SHA-256 digest"),
        ('<a href="../files/{wheel}#sha256=0">', "its {wheel} has the wrong SHA-256 digest"),
        ('<a href="pip-1.0-py3-none-any.whl">', "it does not list {wheel}"),
        ("{wheel}", "it does not list {wheel}"),
    ],
)
def test_pip_is_taken_by_its_name_and_digest_alone(script, refusal, monkeypatch, page, message):
    def urlopen(url, **_):
        body = b"another wheel" if url.endswith(script.WHEEL) else page.encode()
        return contextlib.closing(SimpleNamespace(url=url, read=lambda: body, close=lambda: None))

    page, message = (text.format(wheel=script.WHEEL) for text in (page, message))
    monkeypatch.setattr(script.urllib.request, "urlopen", urlopen)
    found = "cannot get pip from the package index index.example: "
    assert refusal() == f"make_venv: {found}{message}\n"


def test_a_certificate_file_that_is_missing_is_an_error(refusal, monkeypatch, tmp_path):
    monkeypatch.setenv("PIP_CERT", str(tmp_path / "none.pem"))
    assert "No such file" in refusal()
