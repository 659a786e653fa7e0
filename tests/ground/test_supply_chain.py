"""What the workflows may do and run, and that what is installed has one version."""

import json
import platform
import re
import subprocess
import sys
import venv
from pathlib import Path

import pytest
import yaml

from scripts import hash_pins

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
# And nothing else may write.
WRITES = {"pages.yml": {"publish": {"pages": "write", "id-token": "write"}}}


@pytest.mark.attack
@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_may_read_alone(path):
    workflow = yaml.safe_load(path.read_text())
    assert workflow["permissions"] == {"contents": "read"}
    jobs = workflow["jobs"]
    permissions = {name: job["permissions"] for name, job in jobs.items() if "permissions" in job}
    assert permissions == WRITES.get(path.name, {})
    for name in permissions:  # who may write runs no code of a package
        assert [step for step in jobs[name]["steps"] if "run" in step] == []


@pytest.mark.attack
@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_actions_are_named_by_commit_and_leave_no_token(path):
    lines = [line for line in path.read_text().splitlines() if "uses:" in line]
    assert lines
    for line in lines:
        assert re.search(r"uses: [\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+$", line), line
    for job in yaml.safe_load(path.read_text())["jobs"].values():
        for step in job["steps"]:
            if step.get("uses", "").startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False


def test_every_package_has_one_version():
    text = (ROOT / "constraints.txt").read_text()
    lines = [line for line in text.splitlines() if line[:1] != "#"]
    assert [line for line in lines if not re.fullmatch(r"[\w.-]+==[\w.]+", line)] == []
    assert len(hash_pins.pins()) == len(lines)


@pytest.mark.attack
@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="CI runs on Linux, x86-64"
)
def test_ci_installs_every_package_but_pytorch_by_its_digests():
    entry = re.compile(r"(\S+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n")
    about, text = (ROOT / ".ci" / "hashes.txt").read_text().split("\n", 1)
    assert about == hash_pins.ABOUT
    assert entry.sub("", text) == ""
    versions = {name: version for name, version, _ in entry.findall(text)}
    assert versions == hash_pins.wanted(), "run scripts/hash_pins.py"
    assert len(versions) > 100


@pytest.mark.attack
@pytest.mark.parametrize("path", [ROOT / ".ci" / "run", *WORKFLOWS], ids=lambda path: path.name)
def test_nothing_but_the_installer_installs_packages(path):
    """It has the digests; a workflow that installs in another way has none."""
    installer = (ROOT / ".ci" / "install").read_text()
    by_digest = installer.index("pip install --quiet --require-hashes --no-deps -r .ci/hashes.txt")
    assert by_digest < installer.index("PIP_NO_BUILD_ISOLATION=false make")
    assert len(re.findall(r"pip3? install|make .*\.installed", installer)) == 2
    text = path.read_text()
    assert ".ci/install" in text or "run: bash .ci/run" in text
    assert not re.search(r"pip3? install|\buv\b|make_venv", text)


@pytest.mark.parametrize(
    ("file", "fits"),
    [
        ("a_b-1.0-py3-none-any.whl", True),
        ("A.B-1.0-cp311-cp311-manylinux_2_28_x86_64.whl", True),
        ("a-b-1.0.tar.gz", True),
        ("a_b-1.0-cp311-cp311-win_amd64.whl", False),
        ("a_b-1.0-cp311-cp311-manylinux_2_28_aarch64.whl", False),
        ("a_b-1.0.1-py3-none-any.whl", False),
        ("a-b-c-1.0.tar.gz", False),
    ],
)
def test_the_files_of_a_version_for_ci(file, fits):
    assert hash_pins.taken(file, "a-b", "1.0") is fits


@pytest.mark.slow
def test_the_list_of_packages_has_the_pinned_versions(tmp_path):
    """The tool checks what it writes against the schema of CycloneDX."""
    out = tmp_path / "sbom.json"
    venv.create(tmp_path / "venv", with_pip=True)
    python = str(tmp_path / "venv" / "bin" / "python")
    packages = ["-c", str(ROOT / "constraints.txt"), "cyclonedx-bom"]
    subprocess.run([python, "-m", "pip", "install", "-q", *packages], check=True)
    command = [python, "-m", "cyclonedx_py", "environment", "--output-reproducible"]
    project = ["--pyproject", str(ROOT / "pyproject.toml"), "--output-file", str(out)]
    subprocess.run([*command, *project, sys.executable], check=True, capture_output=True)
    bill = json.loads(out.read_text())
    assert bill["bomFormat"] == "CycloneDX"
    listed = {re.sub("[-_.]+", "-", c["name"]).lower(): c["version"] for c in bill["components"]}
    expected = hash_pins.pins()
    for name in ("numpy", "scipy", "numba", "pyarrow"):
        assert listed[name] == expected[name]
