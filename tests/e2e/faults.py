# SPDX-License-Identifier: BSD-3-Clause
"""Faults of the system, at a chosen call by seccomp, or of space: what preexec_fn of subprocess takes."""

import ctypes
import errno
import os
import platform
import resource
import struct
import tempfile

import pytest

# Numbers of the calls; each name stands for all that the C library may use for it.
CALLS = {
    "x86_64": {"fsync": [74], "linkat": [265], "rename": [82, 264, 316], "openat": [257]},
    "aarch64": {"fsync": [82], "linkat": [37], "rename": [38, 276], "openat": [56]},
}.get(platform.machine())

# For the environment of a process that is killed or may not write: it must not cut off what `make coverage` counts. Where
# nothing can be made at all, libgcov says so among the messages of the tool.
_elsewhere = tempfile.TemporaryDirectory(prefix="tokid-counts-")
UNCOUNTED = {"GCOV_PREFIX": _elsewhere.name}

LOAD, EQUAL, ANY_BIT, RETURN = 0x20, 0x15, 0x45, 0x06
KILL, ALLOW, FAIL = 0x80000000, 0x7FFF0000, 0x00050000
NUMBER, THIRD_ARGUMENT = 0, 32  # where a filter finds them
UNNAMED = 0o20000000  # of O_TMPFILE, without O_DIRECTORY


def _install(program):
    code = b"".join(struct.pack("HBBI", *step) for step in program)
    steps = ctypes.create_string_buffer(code, len(code))

    class Program(ctypes.Structure):
        _fields_ = [("count", ctypes.c_ushort), ("steps", ctypes.c_void_p)]

    filter = Program(len(program), ctypes.cast(steps, ctypes.c_void_p))
    libc = ctypes.CDLL(None, use_errno=True)
    no_new_privileges, set_seccomp, by_filter = 38, 22, 2
    if libc.prctl(no_new_privileges, 1, 0, 0, 0) or libc.prctl(set_seccomp, by_filter, ctypes.byref(filter), 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _needed():
    if CALLS is None:
        pytest.skip(f"no numbers of system calls for {platform.machine()}")


def dying_at(name):
    """The process dies, without a chance to clean up, at its first call of this name."""
    _needed()

    def install():
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        program = [(LOAD, 0, 0, NUMBER)]
        for number in CALLS[name]:
            program += [(EQUAL, 0, 1, number), (RETURN, 0, 0, KILL)]
        _install([*program, (RETURN, 0, 0, ALLOW)])

    return install


def failing_at(name, error):
    """Every call of this name fails."""
    _needed()

    def install():
        program = [(LOAD, 0, 0, NUMBER)]
        for number in CALLS[name]:
            program += [(EQUAL, 0, 1, number), (RETURN, 0, 0, FAIL | error)]
        _install([*program, (RETURN, 0, 0, ALLOW)])

    return install


def without_unnamed_files():
    """As on a file system that knows no O_TMPFILE, such as NFS."""
    _needed()

    def install():
        (number,) = CALLS["openat"]
        _install([(LOAD, 0, 0, NUMBER), (EQUAL, 0, 3, number), (LOAD, 0, 0, THIRD_ARGUMENT), (ANY_BIT, 0, 1, UNNAMED),
                  (RETURN, 0, 0, FAIL | errno.EOPNOTSUPP), (RETURN, 0, 0, ALLOW)])

    return install


def room(size):
    """No file grows beyond so many bytes. The same as a full disk, everywhere."""

    def install():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        os.environ.update(UNCOUNTED)

    return install
