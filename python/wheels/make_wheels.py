#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Wheels that any Linux with glibc 2.28 installs: make_wheels.py SOURCE DIRECTORY [--all]

Without --all the wheel of this machine's Python is made and tried in an environment of its own; with it those of every
supported Python, for x86_64 and aarch64. The compiler is zig of PyPI: it has the C library of any age and its own C++
library. The other libraries come from Debian (target.py) and are linked statically, so that a wheel needs nothing but
NumPy. Needs apt and Debian's mirror.
"""

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

from debian import Debian, need, run
from target import BINARIES, DEBIAN_NAMES, GLIBC, HERE, SOURCES, Target, cmake_build

sys.path.append(str(HERE.parents[1] / "cmake"))
sys.path.append(str(HERE.parents[1] / "release"))
import sbom
from make_packages import environment_of


def without_python_path():
    """Nothing here may see the package of a build tree."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def program_of_this_machine(version):
    """A Python of that version, on the path or of pyenv."""
    for folder in (*os.environ["PATH"].split(os.pathsep), *Path.home().glob(f".pyenv/versions/{version}.*/bin")):
        program = Path(folder) / f"python{version}"
        # One of pyenv on the path may be there only to say that there is none.
        if program.exists() and subprocess.run([program, "-c", ""], capture_output=True, check=False).returncode == 0:
            return program
    return None


@dataclass(frozen=True)
class Python:
    """One that a wheel is compiled for. Its headers come from the package libpythonX.Y-dev of a release of Debian, or from
    a Python of this machine where no release has it."""

    tag: str
    version: str
    release: str | None
    nanobind: str | None = None  # instead of that of requirements.txt

    def headers(self, target, debian):
        general = target.root / "usr/include"
        target.unpack(debian, "libcrypt-dev", "trixie")  # Python.h includes crypt.h before 3.11
        if self.release:
            # Debian's pyconfig.h includes that of the processor from the general folder.
            target.unpack(debian, f"libpython{self.version}-dev", self.release)
            return [general / f"python{self.version}", general]
        # These do not differ between processors of 64 bits.
        return [self.include_of_this_machine(), general]

    def include_of_this_machine(self):
        """None where there is no such Python with its headers."""
        program = program_of_this_machine(self.version)
        ask = "import sysconfig; print(sysconfig.get_path('include'))"
        include = Path(run(program, "-c", ask, env=without_python_path()).strip()) if program else None
        return include if include and (include / "Python.h").exists() else None


# nanobind compiles for the stable ABI from Python 3.12 on: that wheel serves all later ones. Its newest version does not
# know Python 3.9 any more, which RHEL 9 and Debian 11 come with.
PYTHONS = (Python("cp312-abi3", "3.13", "trixie"), Python("cp311-cp311", "3.11", "bookworm"),
           Python("cp310-cp310", "3.10", None), Python("cp39-cp39", "3.9", "bullseye", nanobind="2.15.0"))


def of_this_machine():
    minor = sys.version_info.minor
    return next(python for python in PYTHONS
                if python.tag.startswith("cp312" if minor >= 12 else f"cp3{minor}-")), platform.machine()


def fresh(directory):
    venv.create(directory, clear=True, with_pip=True)
    return directory / "bin" / "python"


class Maker:
    def __init__(self, source, directory):
        self.source = source
        self.directory = directory
        run(sys.executable, source / "tests/set_up.py", directory / "tools", HERE / "requirements.txt",
            env=without_python_path())
        self.tools = directory / "tools/bin/python"
        self.zig = self._ask("import ziglang; print(ziglang.__path__[0])") / "zig"
        self.debian = Debian(directory / "debian", sorted({*SOURCES.values(), *BINARIES.values(),
                                                           *(python.release for python in PYTHONS if python.release)}),
                             DEBIAN_NAMES.values())
        self.targets = {}

    def _pip(self, *words):
        run(self.tools, "-m", "pip", "--quiet", "--disable-pip-version-check", *words, env=without_python_path())

    def _ask(self, script):
        return Path(run(self.tools, "-c", script, env=without_python_path()).strip())

    def target(self, machine):
        """With its libraries, and what a wheel carries of them."""
        if machine not in self.targets:
            target = Target(machine, self.directory / machine, self.zig)
            parts = target.build_libraries(self.debian)
            target.build_library(self.source)
            self.targets[machine] = target, parts
        return self.targets[machine]

    def _nanobind(self, version):
        """Where that of PyPI is, with its files for CMake."""
        if version is None:
            return self._ask("import nanobind; print(nanobind.__path__[0])")
        folder = self.directory / f"nanobind-{version}"
        if not folder.exists():
            self._pip("install", "--no-deps", "--ignore-requires-python", "--target", folder, f"nanobind=={version}")
        return folder / "nanobind"

    def extension(self, python, machine, goal="_tokid"):
        """The folder with the extension module, and its stub where that is the goal: only this machine's can be loaded."""
        target, _ = self.target(machine)
        version = python.tag.split("-")[0].removeprefix("cp")
        binary = target.directory / python.tag
        include = ";".join(map(str, python.headers(target, self.debian)))
        cmake_build(self.source, binary, *target.options, "-DTOKID_USE_INSTALLED=ON", f"-DCMAKE_MODULE_PATH={HERE}",
                    f"-DPython_EXECUTABLE={self.tools}", f"-DPython_INCLUDE_DIRS={include}",
                    f"-DPython_VERSION={python.version}", f"-DPython_SOABI=cpython-{version}-{machine}-linux-gnu",
                    f"-Dnanobind_DIR={self._nanobind(python.nanobind)}/cmake",
                    # For nanobind: Python.h of the stable ABI does not include it, nor does zig's C++ library.
                    "-DCMAKE_CXX_FLAGS=-include stdio.h",
                    f"-DCMAKE_MODULE_LINKER_FLAGS=-Wl,--version-script={HERE / 'exports.map'}", target=goal)
        return binary / "python/tokid"

    def pure(self):
        """The files of a wheel but those that are compiled: modules, metadata, licence."""
        folder = self.directory / "pure"
        shutil.rmtree(folder, ignore_errors=True)
        self._pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, self.source,
                  "--config-settings", "wheel.cmake=false", "--config-settings", "wheel.py-api=py3",
                  "--config-settings", f"build-dir={folder / 'build'}")
        (wheel,) = folder.glob("*.whl")
        run(self.tools, "-m", "zipfile", "--extract", wheel, folder / "files")
        return folder / "files"

    def parts(self, python, machine):
        """What the wheel carries: name, version, package URL, what becomes of it, file of its licence."""
        for name, version, use, licence in self.target(machine)[1]:
            yield name, version, f"pkg:deb/debian/{name}@{sbom.quote(version)}", use, licence
        zig = self._version("ziglang")
        for name, folder in (("libc++", "libcxx"), ("libc++abi", "libcxxabi"), ("libunwind", "libunwind")):
            licence = self.zig.parent / "lib" / folder / "LICENSE.TXT"
            yield name, zig, f"pkg:pypi/ziglang@{zig}#lib/{folder}", "linked statically", licence
        yield "ziglang", zig, f"pkg:pypi/ziglang@{zig}", "its run-time library is linked statically", self.zig.parent / "LICENSE"
        nanobind = python.nanobind or self._version("nanobind")
        site = self._nanobind(python.nanobind).parent
        licence = next((site / f"nanobind-{nanobind}.dist-info").rglob("LICENSE"))
        yield "nanobind", nanobind, f"pkg:pypi/nanobind@{nanobind}", "linked statically", licence

    def _version(self, name):
        return str(self._ask(f"from importlib.metadata import version; print(version('{name}'))"))

    def wheel(self, python, machine, pure, extension, stub):
        files = self.directory / "files"
        shutil.rmtree(files, ignore_errors=True)
        shutil.copytree(pure, files)
        (module,) = extension.glob("_tokid*.so")
        shutil.copy(module, files / "tokid")
        shutil.copy(stub, files / "tokid")
        (info,) = files.glob("*.dist-info")
        # pip puts what is there where the programs of its environment are.
        scripts = info.with_suffix(".data") / "scripts"
        scripts.mkdir(parents=True)
        shutil.copy(self.target(machine)[0].tool, scripts)
        platform_tag = f"manylinux_{GLIBC.replace('.', '_')}_{machine}"
        (info / "WHEEL").write_text("Wheel-Version: 1.0\nGenerator: tokid make_wheels\nRoot-Is-Purelib: false\n"
                                    f"Tag: {python.tag}-{platform_tag}\n")
        self._describe(info, list(self.parts(python, machine)))
        for old in self.directory.glob(f"tokid-*-{python.tag}-{platform_tag}.whl"):
            old.unlink()
        run(self.tools, "-m", "wheel", "pack", files, "--dest-dir", self.directory, env=environment_of(self.source))
        (wheel,) = self.directory.glob(f"tokid-*-{python.tag}-{platform_tag}.whl")
        self.check(wheel, module)
        return wheel

    def _describe(self, info, parts):
        """Licences, and what the wheel consists of (PEP 770)."""
        licences = info / "licenses" / "third-party"
        licences.mkdir(parents=True)
        for name, _, _, _, licence in parts:
            if licence:
                shutil.copy(licence, licences / f"{name}.txt")
        (licences / "README.txt").write_text(
            "The compiled module and the tool of this wheel contain these libraries. Each file is the licence of one of them;\n"
            "that of Boost asks for no copy beside compiled code.\n"
            "Sources of a Debian package: apt-get source NAME=VERSION, versions are in ../../sboms/tokid.cdx.json.\n"
            "`make wheels` of tokid's sources makes this wheel, with changed libraries, too.\n")
        components = [{"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl,
                       "scope": "required", "properties": [{"name": "tokid:use", "value": use}]}
                      for name, version, purl, use, _ in parts]
        components += [sbom.uplot(self.source), *sbom.python_packages(self.source)]
        (info / "sboms").mkdir()
        sbom.write(self.source, components, info / "sboms" / "tokid.cdx.json")

    def check(self, wheel, module):
        """It is as portable as its tag says, has its command, and exports nothing but Python's entry."""
        need_command(wheel)
        shown = json.loads(run(self.tools, "-m", "auditwheel", "show", "--json", wheel))
        oldest = re.fullmatch(r"manylinux_(\d+)_(\d+)_\w+", shown["overall_tag"])
        need(oldest and tuple(map(int, oldest.groups())) <= tuple(map(int, GLIBC.split("."))) and not shown["unsupported_isa"],
             f"{wheel.name}: auditwheel finds {shown['overall_tag']}: {shown['versioned_symbols']} {shown['external_libs']}")
        symbols = run("readelf", "--dyn-syms", "--wide", module)
        exported = [name for _, section, name in re.findall(r"(GLOBAL|WEAK)\s+\w+\s+(\w+)\s+(\S+)$", symbols, re.MULTILINE)
                    if section != "UND"]
        need(exported == ["PyInit__tokid"], f"{module.name} exports {exported}, PyInit__tokid alone expected")


def need_command(wheel):
    """The command line tool, as a program for the processor that the tag of the wheel names."""
    machine = wheel.stem.split("-")[-1].split("_", 3)[3]
    number = {"x86_64": 62, "aarch64": 183}[machine]  # of ELF
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        tools = [name for name in names if re.fullmatch(r"tokid-[^/]+\.data/scripts/tokid", name)]
        need(len(tools) == 1, f"{wheel.name} has {len(tools)} command line tools tokid, one needed")
        head = archive.read(tools[0])[:20]
        need(head[:4] == b"\x7fELF" and int.from_bytes(head[18:20], "little") == number,
             f"{wheel.name}: {tools[0]} is no program for {machine}")
        need(int.from_bytes(head[16:18], "little") == 3,  # ET_DYN
             f"{wheel.name}: {tools[0]} is not position-independent. Link it with -pie")
        need(archive.getinfo(tools[0]).external_attr >> 16 & 0o111, f"{wheel.name}: {tools[0]} is not executable")
        need("tokid/__main__.py" in names, f"{wheel.name} has no tokid/__main__.py, which python -m tokid runs")


def attempt(wheel, directory):
    python = fresh(directory / "trial")
    run(python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", wheel, env=without_python_path())
    run(python, HERE / "trial.py", cwd=directory, env=without_python_path())


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("source", type=Path)
    options.add_argument("directory", type=Path)
    options.add_argument("--all", action="store_true")
    given = options.parse_args()
    directory = given.directory.resolve()
    directory.mkdir(parents=True, exist_ok=True)
    maker = Maker(given.source.resolve(), directory)
    pure = maker.pure()

    python, machine = of_this_machine()
    here = maker.extension(python, machine, "_tokid_stub")
    stub = here / "_tokid.pyi"
    wheel = maker.wheel(python, machine, pure, here, stub)
    attempt(wheel, directory)
    print(os.path.relpath(wheel))
    for other, elsewhere in [(p, m) for m in DEBIAN_NAMES for p in PYTHONS] if given.all else []:
        if (other, elsewhere) == (python, machine):
            continue
        if other.release is None and other.include_of_this_machine() is None:
            print(f"no wheel for Python {other.version}: no python{other.version} with headers on this machine")
            continue
        print(os.path.relpath(maker.wheel(other, elsewhere, pure, maker.extension(other, elsewhere), stub)))


if __name__ == "__main__":
    main()
