#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Installs the wheels where their users are: try_wheels.py BUILD WHEELS DIRECTORY

Debians that debootstrap makes in DIRECTORY, with the oldest and the newest Python of a wheel, and with those for arm64,
which QEMU runs; and the other Pythons of this machine. Each installs its wheel and NumPy with pip, tries all formats,
identifies the models that the tool of BUILD identifies (trial.py), and runs the tests of the package that need no more.
Needs root, and takes some minutes.
"""

import contextlib
import os
import shutil
import sys
from pathlib import Path

from debian import need, run
from make_wheels import HERE, PYTHONS, program_of_this_machine, without_python_path

from machine import Machine, Steps

TESTS = ("test_arrays.py", "test_model.py", "test_process.py")
# In QEMU: models are in the trial, too, and the paper's would take many minutes more; times say nothing there.
EMULATED_TESTS = ("test_arrays.py",)
# Name, release of Debian, second processor
MACHINES = (("debian11", "bullseye", None), ("debian13", "trixie", None),
            ("debian11-arm64", "bullseye", "arm64"), ("debian13-arm64", "trixie", "arm64"))
ENSEMBLES = {"exact": ("oscillator", "--experiments", "60", "--steps", "40"),
             "noisy": ("oscillator", "--experiments", "60", "--steps", "40", "--process-noise", "0.02",
                       "--measurement-noise", "0.05"),
             "tube": ("rotating-tube", "--experiments", "40", "--steps", "25")}


def make_reference(tool, folder):
    for name, words in ENSEMBLES.items():
        for seed in ("1", "2", "3"):
            data = folder / f"{name}-{seed}.h5"
            run(tool, "example", *words, "--seed", seed, "-o", data)
            # EM stops where the likelihood hardly grows, so that its models agree to that and no further.
            run(tool, "identify", "--no-refine", data, "-o", data.with_suffix(".model.h5"))


@contextlib.contextmanager
def emulation():
    """The kernel has QEMU start programs of arm64, in folders, too."""
    kernel = Path("/proc/sys/fs/binfmt_misc")
    if not (kernel / "register").exists():
        run("mount", "-t", "binfmt_misc", "binfmt_misc", kernel)
    added = not (kernel / "qemu-aarch64").exists()
    if added:
        (kernel / "register").write_text(Path("/usr/lib/binfmt.d/qemu-aarch64.conf").read_text().strip())
    try:
        yield
    finally:
        if added:
            (kernel / "qemu-aarch64").write_text("-1")


def try_in_debian(name, release, architecture, material, directory):
    machine = Machine(directory / name, release, architecture, keep=True)
    suffix = f":{architecture}" if architecture else ""
    # Of a second processor, python3-venv cannot be installed on Debian 13; NumPy needs libstdc++6, which is on every Debian,
    # but only that of the first one.
    machine.install(f"python3{suffix}", f"libstdc++6{suffix}", "python3-pip")
    shutil.rmtree(machine.root / "tmp/wheel", ignore_errors=True)
    shutil.copytree(material, machine.root / "tmp/wheel")
    machine("python3", "-m", "venv", "--clear", "--system-site-packages", "--without-pip", "/opt/trial")
    glibc = machine("ldd", "--version").splitlines()[0].split()[-1]
    return f"{name}, glibc {glibc}: {try_with('/opt/trial/bin/python', Path('/tmp/wheel'), machine, bool(architecture))}"


def try_here(version, material, directory):
    venv_of = directory / f"python{version}"
    run(program_of_this_machine(version), "-m", "venv", "--clear", venv_of)
    return f"this machine: {try_with(venv_of / 'bin/python', material, lambda *words: run(*words, env=without_python_path()), False)}"


def try_with(python, material, call, emulated):
    """What a Python finds in the folder of material, and what of it fails ends the program."""
    call(python, "-m", "pip", "install", "--disable-pip-version-check", "--only-binary", ":all:", "--no-index",
         "--find-links", material, "--no-deps", "tokid")
    # To compile every module of theirs would take minutes in QEMU.
    call(python, "-m", "pip", "install", "--disable-pip-version-check", "--only-binary", ":all:", "--no-compile", "numpy",
         "pytest")
    found = call(python, material / "trial.py", material / "reference").splitlines()[-1]
    tests = [material / "tests" / name for name in (EMULATED_TESTS if emulated else TESTS)]
    printed = call(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests).splitlines()[-1]
    return f"{found}; {printed}"


def main():
    build, wheels, directory = (Path(word).resolve() for word in sys.argv[1:4])
    need(os.geteuid() == 0, "root is needed for debootstrap and chroot")
    done = Steps()
    material = directory / "material"
    shutil.rmtree(material, ignore_errors=True)
    (material / "reference").mkdir(parents=True)
    (material / "tests").mkdir()
    make_reference(build / "bin/tokid", material / "reference")
    shutil.copy(HERE / "trial.py", material)
    for name in ("conftest.py", *TESTS):
        shutil.copy(HERE.parent / "tests" / name, material / "tests")
    for wheel in wheels.glob("*.whl"):
        shutil.copy(wheel, material)
    done("models by the tool of this machine")
    # The wheel of the stable ABI is compiled with a later Python than the oldest that it serves.
    for version, tag in (*((python.version, python.tag) for python in PYTHONS), ("3.12", "cp312-abi3")):
        if not program_of_this_machine(version):
            print(f"not tried: Python {version}, which is not on this machine")
        elif not list(wheels.glob(f"*-{tag}-*_x86_64.whl")):
            print(f"not tried: Python {version}, for which there is no wheel {tag}")
        else:
            done(try_here(version, material, directory))
    with emulation():
        for name, release, architecture in MACHINES:
            done(try_in_debian(name, release, architecture, material, directory))


if __name__ == "__main__":
    main()
