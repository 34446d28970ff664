#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The files of a release, from a build directory: make_packages.py SOURCE BUILD DIRECTORY

DIRECTORY gets the packages for Debian, the archive, SHA256SUMS, and RELEASE_NOTES.md: what CHANGELOG.md says of this
version, or of what is not released yet, and what the archive needs.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path


def output(*words, **options):
    """All that it prints, which is shown where it fails."""
    done = subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          check=False, **options)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}{' '.join(map(str, words))}: exit code {done.returncode}")
    return done.stdout


def version_of(build):
    cache = (build / "CMakeCache.txt").read_text()
    return re.search(r"^CMAKE_PROJECT_VERSION:STATIC=(.+)$", cache, re.MULTILINE)[1]


def environment_of(source):
    """With the time of the last commit for that of the packages: the same sources make the same packages."""
    if not (source / ".git").exists() or "SOURCE_DATE_EPOCH" in os.environ:
        return os.environ
    return os.environ | {"SOURCE_DATE_EPOCH": output("git", "-C", source, "log", "-1", "--format=%ct").strip()}


def changes(text, version):
    """The section of that version, or of what is not released yet."""
    sections = re.split(r"^## \[([^\]]+)\].*\n", text, flags=re.MULTILINE)
    found = dict(zip(sections[1::2], sections[2::2]))
    return (found.get(version) or found["Unreleased"]).strip()


def dependencies(package):
    """The names of the packages that one for Debian depends on."""
    return re.findall(r"(?:^|, )([^ ,\n]+)", output("dpkg-deb", "--field", package, "Depends"))


def main():
    source, build, directory = (Path(word).resolve() for word in sys.argv[1:4])
    version = version_of(build)
    shutil.rmtree(directory, ignore_errors=True)
    output("cpack", "--config", build / "CPackConfig.cmake", "-G", "DEB;TGZ", "-B", directory,
           env=environment_of(source))
    shutil.rmtree(directory / "_CPack_Packages")

    files = sorted(directory.iterdir())
    sums = "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files)
    (directory / "SHA256SUMS").write_text(sums)
    (package,) = directory.glob("tokid_*.deb")
    (archive,) = directory.glob("*.tar.gz")
    libraries = ", ".join(dependencies(package))
    (directory / "RELEASE_NOTES.md").write_text(
        f"# tokid {version}\n\n{changes((source / 'CHANGELOG.md').read_text(), version)}\n\n### Files\n\n"
        f"- `apt-get install ./{package.name}` installs the tool, the library, and the functions for MATLAB and\n"
        f"  Octave; with `libtokid-dev` beside it, what programs need that are built with the library.\n"
        f"- `{archive.name}` runs wherever it is unpacked, and needs the Debian packages\n  {libraries}.\n\n"
        f"```\n{sums}```\n")
    for file in sorted(directory.iterdir()):
        print(f"{file.stat().st_size:>10,} bytes  {os.path.relpath(file)}")


if __name__ == "__main__":
    main()
