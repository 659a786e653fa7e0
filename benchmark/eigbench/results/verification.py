"""What makes a row *verified*: a maintainer has run its code again, and says what came of it.

A result without ``verified`` is *declared*: its scores follow from its predictions, and how these
were made is its author's word. The ``digest`` of ``verified`` covers it and all else in the result
but what is computed from the predictions anyway, so that neither can be edited or moved to another
row. Times stay those that the author has measured: `eigbench time` measures rows together.
Anyone can compute a digest: where a checkout names its maintainers' keys in :data:`SIGNERS`, in the
form of ssh-keygen(1), a board takes a verified row only if one of them has signed it.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from eigbench.errors import EigbenchError, ResultError

SIGNERS = Path("benchmark", "allowed_signers")
NAMESPACE = "eigbench"  # of ssh-keygen: a signature for something else is none for this
COMPUTED = ("schema_version", "metric_version", "scores")  # anew by `leaderboard --rescore`
SCORED_BY, SAME = "rpd", 1e-6  # relative: what another processor may make of a mean
BEGIN, END = (f"-----{word} SSH SIGNATURE-----" for word in ("BEGIN", "END"))
UNSIGNED = ("digest", "signature")


def is_verified(result: dict[str, Any]) -> bool:
    """Return whether a result says that a maintainer has run its code again."""
    return "verified" in result


def digest(result: dict[str, Any]) -> str:
    """Return the SHA-256 of what was verified, and of what it was verified for."""
    verified = {key: value for key, value in result["verified"].items() if key not in UNSIGNED}
    covered = {key: value for key, value in result.items() if key not in COMPUTED}
    covered["verified"] = verified
    text = json.dumps(covered, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def check(result: dict[str, Any], path: Path, root: Path | None = None) -> None:
    """Check what a result says of its verification; nothing if it says nothing.

    Raises
    ------
    ResultError
        If its digest is of something else, or ``root`` names signers and none of them signed it.
    """
    if not is_verified(result):
        return
    verified = result["verified"]
    if verified["digest"] != digest(result) or not _of_these_scores(result):
        raise ResultError(f"{path}: what it says of its verification was altered: verify it again")
    if root is None or not (root / SIGNERS).is_file():
        return
    if "signature" not in verified:
        raise ResultError(f"{path} is not signed: verify it again with --key")
    with tempfile.NamedTemporaryFile("w", suffix=".sig") as file:
        file.write("\n".join([BEGIN, *textwrap.wrap(verified["signature"], 70), END, ""]))
        file.flush()
        who = ["-I", verified["by"], "-n", NAMESPACE, "-s", file.name]
        command = ["ssh-keygen", "-Y", "verify", "-f", str(root / SIGNERS), *who]
        done = _run(command, verified["digest"])
    if done.returncode:
        raise ResultError(f"{path}: its signature is none of {verified['by']} in {SIGNERS}")


def _of_these_scores(result: dict[str, Any]) -> bool:
    """Return whether the scores of a result are within the intervals of those run again."""
    for target, again in result["verified"]["scores"].items():
        scored = result["scores"].get(target)
        if (scored is None) != (again is None):
            return False
        if scored is not None and not within(scored["overall"][SCORED_BY]["mean"], again):
            return False
    return True


def within(declared: float | None, again: dict[str, float | None]) -> bool:
    """Return whether a mean is in the interval of the mean when run again, or equals it."""
    mean, low, high = (again[key] for key in ("mean", "low", "high"))
    if declared is None or mean is None or low is None or high is None:
        return declared is None and mean is None
    return low <= declared <= high or bool(np.isclose(declared, mean, rtol=SAME, atol=1e-12))


def sign(digest: str, key: Path) -> str:
    """Return the signature of a digest by an SSH key, one line of Base64.

    Raises
    ------
    EigbenchError
        If there is no such key, or it cannot sign.
    """
    done = _run(["ssh-keygen", "-Y", "sign", "-f", str(key), "-n", NAMESPACE], digest)
    if done.returncode:
        raise EigbenchError(f"--key {key} cannot sign: {' '.join(done.stderr.split())[:200]}")
    return "".join(line for line in done.stdout.split("\n") if line not in (BEGIN, END))


def _run(command: list[str], given: str) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, input=given, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise EigbenchError("ssh-keygen is not installed: install OpenSSH") from error
