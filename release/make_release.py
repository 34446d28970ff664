#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The files of a release in one folder: make_release.py begin|finish SOURCE BUILD

`begin` refuses changes that are not committed, and removes what earlier calls left in BUILD. Then make builds the parts:
packages, wheels, bill of materials and site. `finish` gathers them in BUILD/release-VERSION, with the sources, the release
notes and the sums of all files. It refuses a part that is missing and a commit other than that of `begin`.
"""

import re
import shutil
import sys
from pathlib import Path

from machine import need, run
from make_packages import descriptions, environment_of, show, sums, version_of, write_notes


def committed(source):
    """The commit of the tree, which has no other changes."""
    changed = run("git", "-C", source, "status", "--porcelain")
    need(not changed, f"a release is made of a commit, and these files differ from it:\n{changed}"
                      "Commit or remove them first.")
    return run("git", "-C", source, "rev-parse", "HEAD").strip()


def mark(build):
    """The file that names the commit while the parts are built."""
    return build / "release-commit"


def wheels(build, version):
    return sorted((build / "wheel").glob(f"tokid-{version}-*.whl"))


def begin(source, build):
    commit = committed(source)
    version = version_of(source)
    for folder in (build / f"release-{version}", build / "package", build / "docs" / "html"):
        shutil.rmtree(folder, ignore_errors=True)
    for file in (build / "tokid.cdx.json", *wheels(build, version)):
        file.unlink(missing_ok=True)
    build.mkdir(exist_ok=True)
    mark(build).write_text(commit)


def pack_site(source, html, archive):
    """The same pages make the same bytes: files in order, with the time of the commit, of no user."""
    time = environment_of(source)["SOURCE_DATE_EPOCH"]
    folder = archive.name.removesuffix(".tar.gz")
    run("tar", "--create", "--file", archive, "--use-compress-program", "gzip --no-name", "--sort=name", f"--mtime=@{time}",
        "--owner=0", "--group=0", "--numeric-owner", "--mode=u=rwX,go=rX", f"--transform=s,^{html.name},{folder},",
        "--directory", html.parent, html.name)


def finish(source, build):
    """The folder with the files. It appears when all of them are in it."""
    commit = committed(source)
    version = version_of(source)
    need(mark(build).exists() and mark(build).read_text() == commit,
         f"the parts in {build} are not those of commit {commit[:10]}. Call make release again.")
    packages, html, bill = build / "package", build / "docs" / "html", build / "tokid.cdx.json"
    for part, target in (((packages / "SHA256SUMS"), "package"), (bill, "sbom"), (html / "index.html", "docs")):
        need(part.exists(), f"{part} is missing: make {target} did not make it")
    carried = wheels(build, version)
    need(carried, f"{build / 'wheel'} has no wheel of {version}: make wheels did not make one")

    whole = build / f"release-{version}"
    directory = whole.with_name(f"{whole.name}.part")
    shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir()
    run("sha256sum", "--check", "--quiet", "SHA256SUMS", cwd=packages)
    of_packages = [packages / name for name in re.findall(r"  (\S+)$", (packages / "SHA256SUMS").read_text(), re.MULTILINE)]
    for file in (*of_packages, *carried):
        shutil.copy(file, directory)
    shutil.copy(bill, directory / f"tokid-{version}.cdx.json")
    pack_site(source, html, directory / f"tokid-{version}-site.tar.gz")
    run("git", "-C", source, "archive", "--format=tar.gz", f"--prefix=tokid-{version}/",
        f"--output={directory / f'tokid-{version}-source.tar.gz'}", commit)
    write_notes(source, directory, [
        *descriptions(packages),
        "`pip install FILE.whl` installs the Python package with its libraries, on any Linux with glibc 2.28 or later:\n"
        "  " + ", ".join(f"`{file.name}`" for file in carried) + ".",
        f"`tokid-{version}-site.tar.gz` has the documentation: open `index.html`.",
        f"`tokid-{version}.cdx.json` lists the libraries inside, with versions, in CycloneDX.",
        f"`tokid-{version}-source.tar.gz` has the sources, of commit {commit}."])
    (directory / "SHA256SUMS").write_text(sums(directory.iterdir()))
    shutil.rmtree(whole, ignore_errors=True)
    directory.rename(whole)
    mark(build).unlink()
    return whole


def main():
    step, source, build = sys.argv[1], *(Path(word).resolve() for word in sys.argv[2:4])
    if step == "begin":
        begin(source, build)
        return
    directory = finish(source, build)
    show(directory)
    version = version_of(source)
    if f"v{version}" not in run("git", "-C", source, "tag", "--points-at", "HEAD").split():
        print(f"This commit has no tag v{version}: the files are a trial, not a release.")


if __name__ == "__main__":
    main()
