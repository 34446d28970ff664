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
import platform
import re
import shutil
import subprocess
import sys
import time
import venv
from pathlib import Path

from make_packages import dependencies

# What apt and dpkg keep for themselves, and what programs leave in /tmp
NOT_OURS = ("proc", "tmp", "var/cache", "var/lib/apt", "var/lib/dpkg", "var/log")


def run(*words, **options):
    """Its output; all of it is shown where it fails."""
    done = subprocess.run([str(word) for word in words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, check=False, **options)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\n{' '.join(map(str, words))}: exit code {done.returncode}")
    return done.stdout


def need(condition, text):
    if not condition:
        sys.exit(f"failed: {text}")


def mirror(release):
    """Of this machine's apt."""
    lines = run("apt-get", "indextargets", "--format", "$(SITE) $(RELEASE)", "Created-By: Packages").splitlines()
    sites = [site for site, name in map(str.split, lines) if name == release]
    need(sites, f"no source of apt for {release}")
    return sites[0]


class Machine:
    """A Debian in a folder; processes in it see nothing else of this machine but the network."""

    def __init__(self, root):
        self.root = root
        release = platform.freedesktop_os_release()["VERSION_CODENAME"]
        shutil.rmtree(root, ignore_errors=True)
        root.parent.mkdir(parents=True, exist_ok=True)
        run("debootstrap", "--variant=minbase", release, root, mirror(release))
        (root / "etc/apt/apt.conf.d/99acquire").write_text(run("apt-config", "dump", "Acquire"))
        self("apt-get", "update")

    def __call__(self, *words):
        kept = {name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}
        environment = kept | {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LC_ALL": "C.UTF-8",
                              "DEBIAN_FRONTEND": "noninteractive"}
        # Of a mount namespace of its own nothing is left behind, whatever happens.
        enter = 'mount -t proc proc "$0/proc" && exec chroot "$0" "$@"'
        return run("unshare", "--mount", "sh", "-c", enter, self.root, *words, env=environment)

    def install(self, *packages):
        self("apt-get", "install", "--yes", "--no-install-recommends", *packages)

    def files(self):
        found = set()
        for folder, folders, files in os.walk(self.root):
            here = Path(folder).relative_to(self.root)
            folders[:] = [name for name in folders if str(here / name) not in NOT_OURS]
            found |= {str(here / name) for name in (*folders, *files)}
        return found

    def try_tool(self, tool):
        """The paper's numbers, and a model that is right."""
        self("rm", "-rf", "/tmp/tried")
        self("mkdir", "/tmp/tried")
        printed = self(tool, "paper", "-o", "/tmp/tried/paper")
        agreement = re.search(r"(\d+) of (\d+) printed numbers agree", printed)
        need(agreement and agreement[1] == agreement[2], printed)
        made = {file.name for file in (self.root / "tmp/tried/paper").iterdir() if file.stat().st_size > 0}
        need({"paper.html", "paper.json", "figure-1.svg"} <= made, f"paper made {made}")
        data, fresh, model = (f"/tmp/tried/{name}" for name in ("data.h5", "fresh.mat", "model.npz"))
        self(tool, "example", "oscillator", "-o", data, "--experiments", "60", "--steps", "40")
        self(tool, "example", "oscillator", "-o", fresh, "--experiments", "10", "--steps", "40", "--seed", "2")
        self(tool, "identify", data, "-o", model, "--report", "/tmp/tried/page.html")
        fits = json.loads(self(tool, "validate", model, fresh, "--json"))["simulation_fit"]
        need(min(fits) > 99.99, f"fits {fits}")
        return agreement[0]


class Steps:
    """Prints each with its time."""

    def __init__(self):
        self.begin = time.monotonic()

    def __call__(self, text):
        now = time.monotonic()
        print(f"{now - self.begin:6.1f} s  {text}", flush=True)
        self.begin = now


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
    done(f"it runs: {machine.try_tool('tokid')}")
    machine("apt-get", "purge", "--yes", "--autoremove", "tokid")
    left = machine.files() ^ before
    need(not left, f"left after it was removed: {sorted(left)}")
    done("removed, nothing is left")

    machine.install(*dependencies(tool))  # what the release notes list
    machine("tar", "--extract", "--file", f"/tmp/{archive.name}", "--directory", "/opt")
    folder = archive.name.removesuffix(".tar.gz")
    machine("mv", f"/opt/{folder}", "/opt/moved")
    done(f"unpacked {archive.name}, {archive.stat().st_size / 1e6:.1f} MB, with its libraries")
    done(f"it runs: {machine.try_tool('/opt/moved/bin/tokid')}")

    machine.install(f"/tmp/{tool.name}", f"/tmp/{development.name}", "g++", "cmake", "make")
    shutil.copytree(source / "tests/install/consumer", machine.root / "tmp/consumer")
    machine("cmake", "-S", "/tmp/consumer", "-B", "/tmp/consumer/build")
    machine("cmake", "--build", "/tmp/consumer/build")
    machine("/tmp/consumer/build/consumer")
    done(f"a program was built with {development.name}")
    shutil.rmtree(machine.root)


if __name__ == "__main__":
    main()
