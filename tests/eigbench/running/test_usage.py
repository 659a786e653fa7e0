"""Where processor time and memory of a predictor are read."""

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from eigbench.running import usage
from eigbench.running.usage import ControlGroup, Usage, directory_of

V2 = "31 23 0:27 {root} {point} rw,nosuid - cgroup2 cgroup2 rw\n"
V1 = "29 23 0:25 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n"


@pytest.mark.parametrize(
    ("groups", "root", "point", "expected"),
    [
        ("0::/user.slice/a.scope", "/", "/sys/fs/cgroup", "/sys/fs/cgroup/user.slice/a.scope"),
        ("0::/", "/", "/sys/fs/cgroup", "/sys/fs/cgroup"),
        ("4:memory:/a\n0::/b", "/", "/sys/fs/cgroup/unified", "/sys/fs/cgroup/unified/b"),
        ("0::/docker/1/a", "/docker/1", "/sys/fs/cgroup", "/sys/fs/cgroup/a"),
        ("0::/../other", "/", "/sys/fs/cgroup", None),
        ("0::/a", "/docker/1", "/sys/fs/cgroup", None),
        ("4:memory:/a", "/", "/sys/fs/cgroup", None),
    ],
)
def test_the_directory_of_a_control_group(groups, root, point, expected):
    mounts = V1 + V2.format(root=root, point=point)
    assert directory_of(groups + "\n", mounts) == (expected and Path(expected))
    assert directory_of(groups + "\n", V1) is None


def test_where_none_may_be_made_there_is_none(tmp_path, monkeypatch):
    monkeypatch.setattr(usage, "own_directory", lambda: tmp_path / "missing")
    assert ControlGroup.make() is None
    monkeypatch.setattr(usage, "own_directory", lambda: tmp_path)  # not of such a file system
    assert ControlGroup.make() is None
    assert list(tmp_path.iterdir()) == []


def test_groups_of_processes_that_are_gone_are_swept(tmp_path):
    gone = subprocess.Popen(["true"])
    gone.wait()
    names = [f"eigbench-{gone.pid}-0", f"eigbench-{os.getpid()}-0", "eigbench-other-0", "user"]
    for name in names:
        (tmp_path / name).mkdir()
    usage.sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names[1:])


def test_a_control_group_ends_with_all_that_runs_in_it():
    if (group := ControlGroup.make()) is None:
        pytest.skip("this process may not make a control group")
    code = "import time; print(1, flush=True); time.sleep(600)"
    command = group.command([sys.executable, "-c", code])
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert group.cpu_seconds() > 0
        group.remove()
        assert process.wait(5) < 0
    with pytest.raises(FileNotFoundError):
        group.cpu_seconds()


def test_memory_is_the_groups_where_the_system_counts_it(tmp_path):
    own = Usage(psutil.Process(), ControlGroup(tmp_path))
    assert own.counted_by() == {"processor_time": "control group", "memory": "process tree"}
    (tmp_path / "memory.peak").write_text("12345678\n")
    assert own.peak_bytes() == 12345678
    assert own.counted_by() == {"processor_time": "control group", "memory": "control group"}
