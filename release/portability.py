#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Builds and tests the last commit on other systems: portability.py SOURCE DIRECTORY [--keep] [ROW ...]

A row of docs/portability.md is a Debian that debootstrap makes in DIRECTORY/ROW, with a compiler or for a processor. Its
line in that table is written anew, and DIRECTORY/ROW.log has what was printed. Needs root, and half an hour to hours for
each row.
"""

import argparse
import datetime
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
from pathlib import Path

from machine import Machine, need, run

TREE = "/usr/src/tokid"
BUILD = f"{TREE}/build"

# What the tests of whole programs take, which the rows of compilers and processors go without
NO_PROGRAMS = [f"-DTOKID_{name}=none" for name in ("PYTHON", "OCTAVE", "CHROMIUM")]

# Packages whose versions tell one system from another
TOLD = {"cmake": "CMake", "libeigen3-dev": "Eigen", "libhwy-dev": "Highway", "libhdf5-dev": "HDF5",
        "libmatio-dev": "matio", "python3-numpy": "NumPy", "openmpi-bin": "Open MPI", "octave": "Octave",
        "qemu-user": "QEMU"}

CROSS = {"CMAKE_SYSTEM_NAME": "Linux", "CMAKE_SYSTEM_PROCESSOR": "aarch64",
         "CMAKE_LIBRARY_ARCHITECTURE": "aarch64-linux-gnu", "CMAKE_CXX_COMPILER": "aarch64-linux-gnu-g++",
         "CMAKE_CROSSCOMPILING_EMULATOR": "/usr/bin/qemu-aarch64"}


class System:
    """One row: a Debian with the sources, and what was found in it, by column of the table."""

    def __init__(self, name, release, source, directory, architecture=None, keep=False):
        self.name, self.source = name, source
        self.log = directory / f"{name}.log"
        self.machine = Machine(directory / name, release, architecture, keep)
        self.log.unlink(missing_ok=True)
        self.found, self.failed = {}, False
        self.bare = not self.here(BUILD).exists()
        place(subprocess.run(["git", "-C", source, "archive", "HEAD"], check=True, stdout=subprocess.PIPE).stdout,
              self.here(TREE))
        measured = source.parent / "shared" / "data"  # no part of the project; its tests look there, and skip without
        if measured.exists():
            shutil.copytree(measured, self.here(TREE).parent / "shared" / "data", dirs_exist_ok=True)

    def here(self, path):
        return self.machine.root / str(path)[1:]

    def attempt(self, *words):
        """What it prints, and whether it succeeded."""
        try:
            printed, succeeded = self.machine(*words), True
        except SystemExit as failure:
            printed, succeeded = str(failure.code), False
        with self.log.open("a") as log:
            log.write(printed)
        return printed, succeeded

    def judge(self, column, *words):
        """Whether it succeeded; the table gets the counts of tests, and minutes where nothing was built before."""
        begin = time.monotonic()
        printed, succeeded = self.attempt(*words)
        counts = re.findall(r"^\d+ passed, \d+ failed.*$", printed, re.MULTILINE)
        minutes = f", {(time.monotonic() - begin) / 60:.0f} min" if self.bare else ""
        warned = len(set(re.findall(r"^\S+:\d+:\d+: warning: .*$", printed, re.MULTILINE)))
        warnings = f", {warned} warnings of the compiler" if warned else ""
        self.found[column] = (counts[-1] if counts else "passes" if succeeded else "fails") + warnings + minutes
        self.failed = self.failed or not succeeded
        print(f"{self.name}: {column}: {self.found[column]}", flush=True)
        return succeeded

    def unit_tests(self, *options):
        """With all that is built beside them."""
        configured = self.attempt("cmake", "--preset", "release", "-S", TREE, "-B", BUILD, "-DTOKID_BUILD_TESTS=ON",
                                  *NO_PROGRAMS, *options)[1]
        build_and_run = 'cmake --build "$0" && python3 "$1" "$0" --label-regex "unit|slow"'
        return configured and self.judge("tests", "sh", "-c", build_and_run, BUILD, f"{TREE}/tests/run.py")

    def tell(self, compiler):
        """The versions of what it consists of."""
        of = dict(re.findall(r'^(\w+)="?(.*?)"?$', self.here("/etc/os-release").read_text(), re.MULTILINE))
        number = self.here("/etc/debian_version").read_text().strip()
        self.found["system"] = f"Debian {number} ({of['VERSION_CODENAME']})"
        printed = self.attempt(compiler, "--version")[0].splitlines()[0]
        self.found["compiler"] = ("Clang " if "clang" in printed else "GCC ") + re.findall(r"\d+\.[\d.]*\d", printed)[-1]
        line = "--showformat=${Package}\t${Version}\t${db:Status-Status}\n"
        shown = self.attempt("dpkg-query", "--show", line, *TOLD)[0]
        numbers = re.findall(r"^(\S+)\t(?:\d+:)?(\d[\d.]*\d)\S*\tinstalled$", shown, re.MULTILINE)
        self.found["with"] = ", ".join(f"{TOLD[package]} {number}" for package, number in numbers)


def place(archive, target):
    """The files of a tar, and no others but those that were built. Files that are the same already keep their time."""
    files = set()
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        for member in filter(tarfile.TarInfo.isfile, tar):
            file, content = target / member.name, tar.extractfile(member).read()
            files.add(file)
            if not file.exists() or file.read_bytes() != content:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
            file.chmod(member.mode)
    for folder, folders, names in os.walk(target):
        folders[:] = [name for name in folders if not name.startswith("build")]
        for file in {Path(folder, name) for name in names} - files:
            file.unlink()


# ---- what is done in a system ----


def debian(system):
    """As a user does it, from nothing: the demo, then all tests."""
    system.machine.install("make")
    if system.judge("demo", "make", "-C", TREE, "demo"):
        system.judge("tests", "make", "-C", TREE, "test-all")
    system.tell("g++")


def clang(system, version):
    """The demo and the unit tests."""
    system.machine.install("make", f"clang-{version}", "libgtest-dev", "python3")
    if system.judge("demo", "env", f"CXX=clang++-{version}", "make", "-C", TREE, "demo"):
        system.unit_tests()
    system.tell(f"clang++-{version}")


def arm64(system):
    """The unit tests in an emulator, and models of both processors side by side."""
    named = re.search(r"^build_packages := ((?:.*\\\n)*.*)$", (system.source / "Makefile").read_text(), re.MULTILINE)[1]
    programs, headers = {"cmake", "ninja-build"}, {"libeigen3-dev", "libcli11-dev", "nlohmann-json3-dev"}
    libraries = set(named.replace("\\\n", " ").split()) - programs - headers - {"g++"} | {"libgtest-dev"}
    system.machine.install("g++-aarch64-linux-gnu", "qemu-user", "python3", *programs, *headers,
                           *(f"{name}:arm64" for name in sorted(libraries)))
    if system.unit_tests(*(f"-D{name}={value}" for name, value in CROSS.items())):
        native = System("debian13", "trixie", system.source, system.machine.root.parent, keep=True)
        native.machine.install("make")
        need(native.attempt("make", "-C", TREE, "build")[1], f"no build for this processor: {native.log}")
        system.found["tests"] += "; " + compare(native, system)
    system.tell("aarch64-linux-gnu-g++")
    system.found["system"] += ", arm64"


# Seeded ensembles from rest and not, and with noise
START = ((), ("--initial-state", "unknown"))
NOISE = ("--process-noise", "0.02", "--measurement-noise", "0.05")
ENSEMBLES = [(example, seed, options) for example in ("oscillator", "rotating-tube") for seed in (1, 2, 3)
             for options in (*START, NOISE)]


def compare(native, crossed):
    """Models that both processors identify from the same files: the same orders, and pulse responses that agree to 1e-12.
    Rounding errors of many steps of EM add up on any processor: with it, the models may differ by ten times as much as
    those of one processor from outputs with one rounding error more."""
    sys.path.insert(0, str(native.source / "tests" / "e2e"))
    import numpy as np
    from support import load, markov
    tools = {native: [f"{BUILD}/bin/tokid"], crossed: [CROSS["CMAKE_CROSSCOMPILING_EMULATOR"], f"{BUILD}/bin/tokid"]}
    data, rounded, model = "/tmp/data.npz", "/tmp/rounded.npz", "/tmp/model.npz"

    def identified(system, file, *options):
        system.machine(*tools[system], "identify", file, "-o", model, "--quiet", *options)
        path = system.here(model)
        found = load(path)
        return markov(path), [found["lags"].tolist(), found["state_dim"].tolist()], found["condition"].max()

    def difference(case, ours, theirs):
        need(ours[1] == theirs[1], f"{case}: other orders")
        found = abs(theirs[0] - ours[0]).max() / abs(ours[0]).max()
        print(f"{crossed.name}: {case}: condition {ours[2]:.0f}, difference {found:.1e}", flush=True)
        return found

    plain, refined = [], []
    for name, seed, options in ENSEMBLES:
        case = " ".join([name, "--seed", str(seed), *options])
        native.machine(*tools[native], "example", name, "-o", data, "--experiments", 60, "--steps", 40,
                       "--seed", seed, *options)
        shutil.copy(native.here(data), crossed.here(data))
        plain.append(difference(case, *(identified(system, data, "--no-refine") for system in tools)))
        if options == NOISE:
            arrays = load(native.here(data))
            signs = np.random.default_rng(seed).choice([-1, 1], arrays["y"].shape)
            np.savez(native.here(rounded), **arrays | {"y": arrays["y"] * (1 + np.finfo(float).eps * signs)})
            ours, theirs = (identified(system, data) for system in tools)
            refined.append((difference(f"{case}, EM", ours, theirs),
                            difference(f"{case}, EM, rounded", ours, identified(native, rounded))))
    need(max(plain) <= 1e-12, f"models of both processors differ by {max(plain):.1e}")
    need(all(found <= 10 * own for found, own in refined), f"models by EM differ by {refined}")
    found, own = max(refined)
    return (f"{len(plain)} models differ from those of x86-64 by at most {max(plain):.1e} (relative error of pulse "
            f"responses); with EM by at most {found:.1e}, while a rounding error in the outputs changes the pulse responses "
            f"by {own:.1e}")


ROWS = {  # the release, what is done there, a second architecture
    "debian12": ("bookworm", debian, None),
    "debian13": ("trixie", debian, None),
    "clang16": ("bookworm", lambda system: clang(system, 16), None),
    "clang19": ("trixie", lambda system: clang(system, 19), None),
    "arm64": ("trixie", arm64, "arm64"),
}


def record(page, system):
    """Its line in the table of the document."""
    system.found["commit"] = run("git", "-C", system.source, "rev-parse", "--short", "HEAD").strip()
    system.found["on"] = datetime.date.today().isoformat()
    columns = ("system", "compiler", "demo", "tests", "with", "commit", "on")
    line = " | ".join([f"| `{system.name}`", *(system.found.get(column, "") for column in columns)]) + " |\n"
    text = page.read_text(encoding="utf-8")
    page.write_text(re.sub(rf"^\| `{system.name}` \|.*\n", lambda _: line, text, flags=re.MULTILINE), encoding="utf-8")


def main():
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("source", type=Path)
    words.add_argument("directory", type=Path)
    words.add_argument("--keep", action="store_true", help="go on in systems that are there: no minutes then")
    words.add_argument("rows", nargs="*", metavar="ROW", help=f"all unless given: {', '.join(ROWS)}")
    given = words.parse_intermixed_args()
    source, directory = given.source.resolve(), given.directory.resolve()
    for name in given.rows:
        need(name in ROWS, f"no row {name}, one of {', '.join(ROWS)} needed")
    need(os.geteuid() == 0, "root is needed for debootstrap and chroot")

    failed = []
    for name in given.rows or ROWS:
        release, test, architecture = ROWS[name]
        system = System(name, release, source, directory, architecture, given.keep)
        test(system)
        record(source / "docs" / "portability.md", system)
        failed += [name] * system.failed
    need(not failed, f"{', '.join(failed)}: see {directory}")


if __name__ == "__main__":
    main()
