"""Tests of the one door to Open3D, and of the stand-ins for libraries not installed."""

import subprocess
import sys

import pytest

from synthnet.mesh import open3d


def run(code):
    """Run code in a fresh interpreter, which has loaded nothing yet."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_load_open3d_gives_a_working_module():
    o3d = open3d.load_open3d()
    box = o3d.geometry.TriangleMesh.create_box()
    assert len(box.vertices) == 8
    hull, _ = box.subdivide_midpoint(2).compute_convex_hull()
    assert len(hull.vertices) == 8
    assert open3d.load_open3d() is o3d


def test_importing_the_door_does_not_import_open3d():
    code = "import sys, synthnet.mesh.open3d; print('open3d' in sys.modules)"
    assert run(code) == "False"


@pytest.mark.skipif(sys.platform != "linux", reason="stand-ins are ELF files")
@pytest.mark.parametrize("version", ["", "SYNTHNET_1.0"])
def test_stand_in_is_found_by_name_and_returns_zero(version):
    code = f"""
import ctypes
from synthnet.mesh.open3d import _load_stand_in

names = [f"synthnet_function_{{i}}" for i in range(50)]
for number in "12":  # two, because they must not be taken for each other
    _load_stand_in("libsynthnet_standin_test.so." + number, names, {version!r})
    names.append("synthnet_only_in_second")
first = ctypes.CDLL("libsynthnet_standin_test.so.1")
second = ctypes.CDLL("libsynthnet_standin_test.so.2")
print({{second[name]() for name in names}}, hasattr(first, names[-1]))
"""
    assert run(code) == "{0} False"


@pytest.mark.skipif(sys.platform != "linux", reason="stand-ins are ELF files")
def test_open3d_works_with_stand_ins_for_all_libraries():
    # As on a server that has none of them: no library counts as present.
    code = """
from synthnet.mesh import open3d

open3d._loadable = lambda name: name.startswith("/") and open3d.ctypes.CDLL(name)
box = open3d.load_open3d().geometry.TriangleMesh.create_box().subdivide_midpoint(2)
hull, _ = box.compute_convex_hull()
libraries = ("libEGL.so", "libGL.so", "libX11.so", "libudev.so", "libidn2.so")
maps = open("/proc/self/maps").read()
print(len(hull.vertices), [name for name in libraries if "memfd:" + name not in maps])
"""
    assert run(code) == "8 []"
