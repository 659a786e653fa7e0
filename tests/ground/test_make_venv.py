"""The script that makes a virtual environment checks whom it takes pip from."""

import importlib.util
import ssl
import subprocess
import urllib.error
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "make_venv.py"


@pytest.fixture
def script(monkeypatch):
    """Load the script as on a machine that lacks python3-venv."""
    spec = importlib.util.spec_from_file_location("make_venv", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def run(*command):
        return subprocess.CompletedProcess(command, 0 if "--without-pip" in command else 1, "", "")

    monkeypatch.setattr(module, "run", run)
    monkeypatch.setenv("PIP_INDEX_URL", "https://index.example/simple")
    monkeypatch.delenv("PIP_CERT", raising=False)
    return module


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
    contexts = []

    def urlopen(url, *, timeout, context):
        contexts.append(context)
        raise urllib.error.URLError(ssl.SSLCertVerificationError(1, "unknown issuer"))

    monkeypatch.setattr(script.urllib.request, "urlopen", urlopen)
    assert refusal() == (
        "make_venv: cannot check the certificate of the package index index.example: install "
        "ca-certificates or python3-venv, or set PIP_CERT or SSL_CERT_FILE to a file of "
        "certificates\n"
    )
    (context,) = contexts
    assert context.verify_mode == ssl.CERT_REQUIRED
    assert context.check_hostname


def test_an_index_that_does_not_answer_is_named(script, refusal, monkeypatch):
    def urlopen(*_, **options):
        raise urllib.error.URLError("timed out")

    monkeypatch.setattr(script.urllib.request, "urlopen", urlopen)
    assert "cannot get pip from the package index index.example: " in refusal()


def test_a_certificate_file_that_is_missing_is_an_error(refusal, monkeypatch, tmp_path):
    monkeypatch.setenv("PIP_CERT", str(tmp_path / "none.pem"))
    assert "No such file" in refusal()
