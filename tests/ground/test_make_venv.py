"""The script that makes a virtual environment checks whom it takes pip from."""

import importlib.util
import ssl
import subprocess
import urllib.error
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "make_venv.py"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Load the script as on a machine that lacks python3-venv."""
    spec = importlib.util.spec_from_file_location("make_venv", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    def run(*command: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 0 if "--without-pip" in command else 1, "", "")

    monkeypatch.setattr(module, "run", run)
    monkeypatch.setenv("PIP_INDEX_URL", "https://index.example/simple")
    monkeypatch.delenv("PIP_CERT", raising=False)
    return module


@pytest.fixture
def refusal(
    script: ModuleType, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[[], str]:
    """Return a function that runs the script, which must refuse: what it says."""

    def run() -> str:
        with pytest.raises(SystemExit) as stopped:
            script.make(tmp_path / "venv")
        assert stopped.value.code == 2
        return capsys.readouterr().err

    return run


def test_an_unknown_certificate_is_refused_in_one_line(
    script: ModuleType, refusal: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    contexts: list[ssl.SSLContext] = []

    def urlopen(url: str, *, timeout: float, context: ssl.SSLContext) -> Any:
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


def test_an_index_that_does_not_answer_is_named(
    script: ModuleType, refusal: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def urlopen(*_: Any, **options: Any) -> Any:
        raise urllib.error.URLError("timed out")

    monkeypatch.setattr(script.urllib.request, "urlopen", urlopen)
    assert "cannot get pip from the package index index.example: " in refusal()


def test_a_certificate_file_that_is_missing_is_an_error(
    refusal: Callable[[], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PIP_CERT", str(tmp_path / "none.pem"))
    assert "No such file" in refusal()
