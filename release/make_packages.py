#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Packages, from a build directory: make_packages.py SOURCE BUILD DIRECTORY

DIRECTORY gets the packages for Debian, the archive, SHA256SUMS, and RELEASE_NOTES.md: what CHANGELOG.md says of this
version, or of what is not released yet, and what the archive needs.
"""

import hashlib
import os
import re
import shutil
import sys
from pathlib import Path

from machine import run

sys.path.append(str(Path(__file__).resolve().parents[1] / "cmake"))
from sbom import version_of


def environment_of(source):
    """With the time of the last commit for that of the packages: the same sources make the same packages."""
    if not (source / ".git").exists() or "SOURCE_DATE_EPOCH" in os.environ:
        return os.environ
    return os.environ | {"SOURCE_DATE_EPOCH": run("git", "-C", source, "log", "-1", "--format=%ct").strip()}


def changes(text, version):
    """The section of that version, or of what is not released yet."""
    sections = re.split(r"^## \[([^\]]+)\].*\n", text, flags=re.MULTILINE)
    found = dict(zip(sections[1::2], sections[2::2]))
    return (found.get(version) or found["Unreleased"]).strip()


def dependencies(package):
    """The names of the packages that one for Debian depends on."""
    return re.findall(r"(?:^|, )([^ ,\n]+)", run("dpkg-deb", "--field", package, "Depends"))


def descriptions(packages):
    """What the release notes say of the packages and of the archive in a folder."""
    (tool,), (archive,) = packages.glob("tokid_*.deb"), packages.glob("tokid-*-linux-*.tar.gz")
    return [f"`apt-get install ./{tool.name}` installs the tool, the library, and the functions for MATLAB and\n"
            f"  Octave; with `libtokid-dev` beside it, what programs need that are built with the library.",
            f"`{archive.name}` runs wherever it is unpacked, and needs the Debian packages\n"
            f"  {', '.join(dependencies(tool))}."]


def sums(files):
    """What `sha256sum --check` reads."""
    return "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in sorted(files))


def write_notes(source, directory, lines):
    """RELEASE_NOTES.md: the changes, LINES about the files of DIRECTORY, and the sums of these files."""
    version = version_of(source)
    items = "".join(f"- {line}\n" for line in lines)
    (directory / "RELEASE_NOTES.md").write_text(
        f"# tokid {version}\n\n{changes((source / 'CHANGELOG.md').read_text(), version)}\n\n### Files\n\n{items}\n"
        f"```\n{sums(directory.iterdir())}```\n")


def show(directory):
    for file in sorted(directory.iterdir()):
        print(f"{file.stat().st_size:>10,} bytes  {os.path.relpath(file)}")


def main():
    source, build, directory = (Path(word).resolve() for word in sys.argv[1:4])
    shutil.rmtree(directory, ignore_errors=True)
    run("cpack", "--config", build / "CPackConfig.cmake", "-G", "DEB;TGZ", "-B", directory, env=environment_of(source))
    shutil.rmtree(directory / "_CPack_Packages")
    listed = sums(directory.iterdir())
    write_notes(source, directory, descriptions(directory))
    (directory / "SHA256SUMS").write_text(listed)
    show(directory)


if __name__ == "__main__":
    main()
