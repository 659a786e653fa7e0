"""The one door through which the package imports Open3D, and meshes there and back.

Open3D's library is linked against a display stack (libEGL, libGL, libX11), libusb,
libudev and libidn2, and the loader wants all of them before the first line of Open3D
runs. A server without a display lacks some, and ``pip`` cannot bring most of them.
We only use Open3D's geometry, which calls none of them, so:

* libusb comes from the PyPI package ``libusb_package``;
* every other library that is absent is replaced by an empty *stand-in*: a shared object
  of a few kilobytes, built in memory, whose functions do nothing and return 0.

Libraries that the machine has are always used as they are. Once stand-ins are loaded,
Open3D cannot open a window or render in that process.
"""

import ctypes
import functools
import importlib
import os
import platform
import struct
import sys
import types
from typing import Any

import numpy as np

from synthnet.errors import MissingPackageError, install, needed_by
from synthnet.processes import more_memory
from synthnet.types import Mesh

# What libOpen3D.so.0.20 takes from each library, as listed by
#   readelf --wide --dyn-syms libOpen3D.so.0.20 | grep UND
# A line each, library:version:names; the version is the one the symbols must carry, if
# any. Open3D is linked with BIND_NOW, so with one name too few its import fails. libEGL
# and libGL come first, lest a real one meet a stand-in for the libX11 below it.
_NEEDED = """
libEGL.so.1::eglBindAPI eglChooseConfig eglCreateContext eglCreatePbufferSurface \
eglDestroyContext eglDestroySurface eglGetDisplay eglGetProcAddress eglInitialize \
eglMakeCurrent eglQueryString eglSwapBuffers eglTerminate
libGL.so.1::glBindTexture glBlendFunc glClear glClearColor glClearDepth glColorMask \
glDeleteTextures glDepthFunc glDisable glDrawArrays glEnable glFinish glGenTextures \
glLineWidth glPixelStorei glPointSize glPolygonMode glPolygonOffset glReadBuffer \
glReadPixels glTexImage2D glTexParameteri glViewport glXGetClientString \
glXGetProcAddressARB glXQueryVersion
libX11.so.6::XFlush XSendEvent
libudev.so.1:LIBUDEV_183:udev_device_get_action udev_device_get_property_value \
udev_device_get_sysname udev_device_new_from_syspath udev_device_unref \
udev_enumerate_add_match_subsystem udev_enumerate_get_list_entry udev_enumerate_new \
udev_enumerate_scan_devices udev_enumerate_unref udev_list_entry_get_name \
udev_list_entry_get_next udev_monitor_enable_receiving udev_monitor_get_fd \
udev_monitor_filter_add_match_subsystem_devtype udev_monitor_new_from_netlink \
udev_monitor_receive_device udev_monitor_unref udev_new udev_unref
libidn2.so.0:IDN2_0.0.0:idn2_check_version idn2_free idn2_lookup_ul idn2_to_unicode_8z8z
"""

# The ELF machine number and the code of `return 0`, for each processor we support.
_MACHINES = {
    "x86_64": (62, bytes.fromhex("31c0c3")),  # xor eax, eax; ret
    "aarch64": (183, bytes.fromhex("000080d2c0035fd6")),  # mov x0, #0; ret
}


@functools.cache
def load_open3d() -> types.ModuleType:
    """Import Open3D, on machines without a display too.

    Raise MissingPackageError if Open3D, or a library it needs, is missing.
    """
    try:
        if sys.platform == "linux" and platform.machine() in _MACHINES:
            _load_libusb()
            for line in _NEEDED.split("\n")[1:-1]:
                soname, version, names = line.split(":")
                if not _loadable(soname):
                    _load_stand_in(soname, names.split(), version)
        with needed_by("building shapes"):
            return importlib.import_module("open3d")
    except MissingPackageError:
        raise
    except (ImportError, OSError) as error:
        raise MissingPackageError(
            f"Open3D cannot be imported ({error}): "
            + more_memory(f"{install('open3d')} brings it with the USB library that it needs")
        ) from error


def from_open3d(triangle_mesh: Any) -> Mesh:
    """Copy an ``open3d.geometry.TriangleMesh`` into a float64 mesh."""
    return Mesh(
        np.array(triangle_mesh.vertices, dtype=np.float64),
        np.array(triangle_mesh.triangles, dtype=np.int64),
    )


def to_open3d(mesh: Mesh) -> Any:
    """Copy a mesh into an ``open3d.geometry.TriangleMesh``."""
    o3d = load_open3d()
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.array(mesh.vertices, dtype=np.float64, order="C")),
        o3d.utility.Vector3iVector(np.array(mesh.faces, dtype=np.int32, order="C")),
    )


def subdivide(mesh: Mesh, times: int) -> Mesh:
    """Split every triangle into four by its edges' midpoints, ``times`` times.

    Examples
    --------
    >>> len(subdivide(Mesh(np.eye(3), np.array([[0, 1, 2]])), 2).faces)
    16
    """
    return from_open3d(to_open3d(mesh).subdivide_midpoint(times)) if times else mesh


def decimate(mesh: Mesh, faces: int) -> Mesh:
    """Simplify a mesh to about ``faces`` triangles by quadric decimation.

    It has float64 vertices and int64 faces, and no degenerate triangles or unused vertices; a mesh
    that has no more triangles is returned as it is.

    Examples
    --------
    >>> grid = subdivide(Mesh(np.eye(3), np.array([[0, 1, 2]])), 3)
    >>> len(grid.faces), len(decimate(grid, 16).faces) <= 16
    (64, True)
    """
    if len(mesh.faces) <= faces:
        return mesh
    simple = to_open3d(mesh).simplify_quadric_decimation(target_number_of_triangles=faces)
    simple.remove_degenerate_triangles()
    simple.remove_unreferenced_vertices()
    return from_open3d(simple)


def _loadable(library: str) -> bool:
    """Load a shared library by name or path; return whether that worked."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _load_libusb() -> None:
    """Load the libusb that pip brought; without it, Open3D looks for the system's."""
    try:
        path = importlib.import_module("libusb_package").get_library_path()
    except ImportError:
        return
    if path is not None:
        _loadable(str(path))


def _load_stand_in(soname: str, names: list[str], version: str) -> None:
    """Build a stand-in library and load it, after which the loader knows its name."""
    fd = os.memfd_create(soname)
    with open(fd, "wb", closefd=False) as file:
        file.write(_stand_in(soname, names, version))
    # The descriptor stays open for good: the loader remembers the library by this path
    # too, and a second library under a reused number would be taken for the first.
    ctypes.CDLL(f"/proc/self/fd/{fd}")


def _stand_in(soname: str, names: list[str], version: str) -> bytes:
    """Return an ELF shared object whose functions ``names`` all return 0."""
    machine, code = _MACHINES[platform.machine()]
    count, start = len(names) + 1, 64 + 4 * 56  # symbols; headers, then the code
    strings = b"\0" + "\0".join([soname, version, *names, ""]).encode()
    offsets = [strings.index(b"\0%b\0" % n.encode()) + 1 for n in (soname, version, *names)]
    symbols = bytes(24)  # entry 0 of a symbol table is empty
    for offset in offsets[2:]:
        symbols += struct.pack("<IBBHQQ", offset, 0x12, 0, 1, start, len(code))
    # One hash bucket that chains all symbols, so every name's hash leads to it.
    table = struct.pack(f"<{3 + count}I", 1, count, 1, 0, *range(2, count), 0)
    parts = {4: table, 5: strings, 6: symbols}  # HASH, STRTAB, SYMTAB
    tags = {14: offsets[0], 10: len(strings), 11: 24}  # SONAME, STRSZ, SYMENT
    if version:  # a caller that asks for a version aborts on a library that has none
        digest = 0  # the ELF standard's hash of the version's name
        for byte in version.encode():
            digest = (digest << 4) + byte
            digest = (digest ^ (digest >> 24 & 0xF0)) & 0x0FFFFFFF
        parts[0x6FFFFFF0] = struct.pack(f"<{count}H", 0, *[2] * len(names))  # VERSYM
        parts[0x6FFFFFFC] = struct.pack("<4H5I", 1, 0, 2, 1, digest, 20, 0, offsets[1], 0)
        tags[0x6FFFFFFD] = 1  # VERDEFNUM, of the VERDEF above
    blob = bytes(start) + code
    for tag, part in parts.items():
        blob += bytes(-len(blob) % 8)
        tags[tag] = len(blob)
        blob += part
    blob += bytes(-len(blob) % 8)
    dynamic = b"".join(struct.pack("<QQ", *tag) for tag in (*tags.items(), (0, 0)))

    # Two segments, because the loader writes to the dynamic section and some kernels
    # refuse memory that is writable and executable. 64 KiB is the largest page size.
    page, end, size = 0x10000, len(blob), len(dynamic)
    header = b"\x7fELF\2\1\1".ljust(16, b"\0") + struct.pack(
        "<2HI3QI6H", 3, machine, 1, 0, 64, 0, 0, 64, 56, 4, 64, 0, 0
    )
    for segment in (  # type, flags, offset, two addresses, two sizes, alignment
        (1, 5, 0, 0, 0, end, end, page),  # LOAD, read and execute
        (1, 6, end, page + end, page + end, size, size, page),  # LOAD, read and write
        (2, 6, end, page + end, page + end, size, size, 8),  # DYNAMIC
        (0x6474E551, 6, 0, 0, 0, 0, 0, 16),  # GNU_STACK: no executable stack, please
    ):
        header += struct.pack("<2I6Q", *segment)
    return header + blob[start:] + dynamic
