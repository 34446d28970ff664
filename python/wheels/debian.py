# SPDX-License-Identifier: BSD-3-Clause
"""Packages of several releases of Debian and for other processors, unpacked into folders. Nothing is installed: the apt
of this machine serves with its mirror, but with lists and settings of its own."""

import os
import shutil
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "release"))
from machine import mirror, need, run

KEYS = "/usr/share/keyrings/debian-archive-keyring.gpg"


class Debian:
    def __init__(self, directory, releases, architectures):
        self.directory = directory
        for folder in ("lists/partial", "archives/partial", "packages", "sources"):
            (directory / folder).mkdir(parents=True, exist_ok=True)
        site = mirror()
        (directory / "sources.list").write_text("".join(
            f"{kind} [signed-by={KEYS}] {site} {release} main\n" for release in releases for kind in ("deb", "deb-src")))
        (directory / "status").touch()
        names = "; ".join(f'"{name}"' for name in architectures)
        (directory / "apt.conf").write_text(f"""
Dir::State::lists "{directory}/lists";
Dir::State::status "{directory}/status";
Dir::Cache "{directory}";
Dir::Etc::sourcelist "{directory}/sources.list";
Dir::Etc::sourceparts "/dev/null";
APT::Architectures {{ {names}; }};
APT::Sandbox::User "root";
Acquire::Languages "none";
""")
        self._environment = os.environ | {"APT_CONFIG": str(directory / "apt.conf")}
        self._run("apt-get", "update", cwd=directory)

    def _run(self, *words, cwd):
        return run(*words, cwd=cwd, env=self._environment)

    def source(self, package, release):
        """The folder of a source package, with Debian's changes, and its version."""
        target = self.directory / "sources" / f"{package}-{release}"
        if not target.exists():
            partial = target.with_suffix(".partial")
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir()
            self._run("apt-get", "source", "--target-release", release, package, cwd=partial)
            (unpacked,) = (path for path in partial.iterdir() if path.is_dir())
            unpacked.rename(target)
        version = run("dpkg-parsechangelog", "--file", target / "debian/changelog", "--show-field", "Version")
        return target, version.strip()

    def unpack(self, package, release, architecture, target):
        """The files of a binary package below the folder target; its version."""
        folder = self.directory / "packages" / f"{package}-{release}-{architecture}"
        if not list(folder.glob("*.deb")):
            folder.mkdir(exist_ok=True)
            # As on a machine of that processor: the packages that are for all of them are for this one then.
            self._run("apt-get", "-o", f"APT::Architecture={architecture}", "download", f"{package}/{release}", cwd=folder)
        (file,) = folder.glob("*.deb")
        run("dpkg-deb", "--extract", file, target)
        return run("dpkg-deb", "--field", file, "Version").strip()
