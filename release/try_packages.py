#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Installs the packages on a Debian that has nothing else: try_packages.py SOURCE PACKAGES DIRECTORY

debootstrap makes that Debian in DIRECTORY/root, from the mirror that this machine's apt uses, of this machine's release.
There: apt installs the package, the tool recomputes the paper and identifies a model, and nothing is left when it is
removed; the archive runs with the libraries that the release notes list; a program is built with libtokid-dev. Before that:
lintian finds no error, and CITATION.cff is valid. Needs root, and takes some minutes.
"""

import json
import os
import re
import shutil
import sys
import venv
from pathlib import Path

from machine import Machine, Steps, need, run
from make_packages import dependencies


def try_tool(machine, tool):
    """The paper's numbers, and a model that is right."""
    machine("rm", "-rf", "/tmp/tried")
    machine("mkdir", "/tmp/tried")
    printed = machine(tool, "paper", "-o", "/tmp/tried/paper")
    agreement = re.search(r"(\d+) of (\d+) printed numbers agree", printed)
    need(agreement and agreement[1] == agreement[2], printed)
    made = {file.name for file in (machine.root / "tmp/tried/paper").iterdir() if file.stat().st_size > 0}
    need({"paper.html", "paper.json"} <= made, f"paper made {made}")
    data, fresh, model = (f"/tmp/tried/{name}" for name in ("data.h5", "fresh.mat", "model.npz"))
    machine(tool, "example", "oscillator", "-o", data, "--experiments", "60", "--steps", "40")
    machine(tool, "example", "oscillator", "-o", fresh, "--experiments", "10", "--steps", "40", "--seed", "2")
    machine(tool, "identify", data, "-o", model, "--report", "/tmp/tried/page.html")
    fits = json.loads(machine(tool, "validate", model, fresh, "--json"))["simulation_fit"]
    need(min(fits) > 99.99, f"fits {fits}")
    return agreement[0]


def main():
    source, packages, directory = (Path(word).resolve() for word in sys.argv[1:4])
    (tool,), (development,), (archive,) = (
        list(packages.glob(name)) for name in ("tokid_*.deb", "libtokid-dev_*.deb", "*.tar.gz"))
    need(os.geteuid() == 0, "root is needed for debootstrap and chroot")
    done = Steps()

    run("sha256sum", "--check", "--quiet", "SHA256SUMS", cwd=packages)
    found = run("lintian", "--allow-root", "--fail-on", "error", tool, development).splitlines()
    done(f"lintian: no error, {sum(line.startswith('W:') for line in found)} warnings")

    environment = directory / "venv"
    venv.create(environment, clear=True, with_pip=True)
    run(environment / "bin/pip", "install", "--quiet", "--disable-pip-version-check", "cffconvert==2.0.0")
    run(environment / "bin/cffconvert", "--validate", "--infile", source / "CITATION.cff")
    done("CITATION.cff is valid")

    machine = Machine(directory / "root")
    for file in (tool, development, archive):
        shutil.copy(file, machine.root / "tmp")
    before = machine.files()
    done(f"a Debian of {len(before)} files")

    machine.install(f"/tmp/{tool.name}")
    done(f"installed {tool.name}, {tool.stat().st_size / 1e6:.1f} MB")
    done(f"it runs: {try_tool(machine, 'tokid')}")
    machine("apt-get", "purge", "--yes", "--autoremove", "tokid")
    left = machine.files() ^ before
    need(not left, f"left after it was removed: {sorted(left)}")
    done("removed, nothing is left")

    machine.install(*dependencies(tool))  # what the release notes list
    machine("tar", "--extract", "--file", f"/tmp/{archive.name}", "--directory", "/opt")
    folder = archive.name.removesuffix(".tar.gz")
    machine("mv", f"/opt/{folder}", "/opt/moved")
    done(f"unpacked {archive.name}, {archive.stat().st_size / 1e6:.1f} MB, with its libraries")
    done(f"it runs: {try_tool(machine, '/opt/moved/bin/tokid')}")

    machine.install(f"/tmp/{tool.name}", f"/tmp/{development.name}", "g++", "cmake", "make")
    shutil.copytree(source / "tests/install/consumer", machine.root / "tmp/consumer")
    machine("cmake", "-S", "/tmp/consumer", "-B", "/tmp/consumer/build")
    machine("cmake", "--build", "/tmp/consumer/build")
    machine("/tmp/consumer/build/consumer")
    done(f"a program was built with {development.name}")
    shutil.rmtree(machine.root)


if __name__ == "__main__":
    main()
