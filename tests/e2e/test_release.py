# SPDX-License-Identifier: BSD-3-Clause
"""The version stands in CMakeLists.txt; what repeats it says the same. Other systems get the tree of a commit."""

import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "release"))
sys.path.insert(0, str(ROOT / "python" / "wheels"))
import make_release
import portability
from make_packages import changes, sums
from make_wheels import PYTHONS, need_command


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def version():
    return re.search(r"^project\(tokid VERSION (\d+\.\d+\.\d+) ", text_of("CMakeLists.txt"), re.MULTILINE)[1]


def test_version_of_the_tool(tokid, version):
    assert tokid("--version").stdout == f"tokid {version}\n"


def test_version_of_the_python_package(version):
    source = tomllib.loads(text_of("pyproject.toml"))["tool"]["scikit-build"]["metadata"]["version"]
    assert re.search(source["regex"], text_of(source["input"]))["value"] == version


def test_version_to_cite(version):
    assert re.findall(r"^version: (.*)$", text_of("CITATION.cff"), re.MULTILINE) == [version]


@pytest.mark.parametrize("name,pattern", [
    ("docs/how-to/cpp.md", r"find_package\(tokid (\S+) REQUIRED\)"),
    ("tests/install/consumer/CMakeLists.txt", r"set\(requested (\S+) CACHE"),
])
def test_version_to_ask_for(version, name, pattern):
    assert re.findall(pattern, text_of(name)) == [version.rpartition(".")[0]]


def test_version_of_the_recipes(version):
    assert json.loads(text_of("release/vcpkg/tokid/vcpkg.json"))["version"] == version
    assert re.findall(r'^context:\n  version: "(.*)"$', text_of("release/conda/recipe.yaml"), re.MULTILINE) == [version]


def test_one_description():
    description = tomllib.loads(text_of("pyproject.toml"))["project"]["description"]
    assert f'        DESCRIPTION "{description}")' in text_of("CMakeLists.txt")
    assert json.loads(text_of("release/vcpkg/tokid/vcpkg.json"))["description"] == description
    assert f"  summary: {description}\n" in text_of("release/conda/recipe.yaml")


def test_requirements_of_the_conda_recipe():
    """Those of the Python package, and what the top of CMakeLists.txt asks for."""
    recipe, project = text_of("release/conda/recipe.yaml"), tomllib.loads(text_of("pyproject.toml"))
    needed = [*project["build-system"]["requires"], *project["project"]["dependencies"]]
    for name, oldest in (re.fullmatch(r"([\w-]+)>=(\S+)", text).groups() for text in needed):
        assert f"    - {name} >={oldest}\n" in recipe
    cmake = text_of("CMakeLists.txt")
    for package, name in (("cmake_minimum_required(VERSION ", "cmake"), ("find_package(Eigen3 ", "eigen"),
                          ("find_package(Boost ", "libboost-headers")):
        oldest = re.search(re.escape(package) + r"([0-9.]+)", cmake)[1]
        assert re.search(rf"^    - {name} >={re.escape(oldest)}(,|$)", recipe, re.MULTILINE), name


def test_port_for_vcpkg(tokid, tmp_path):
    """The port configures with options that exist, and what it installs stands where vcpkg wants it."""
    library, packages = tmp_path / "libtokid.a", tmp_path / "packages"
    library.touch()
    done = subprocess.run(["cmake", "-DPORT=tokid", f"-DPORTFILE={ROOT / 'release/vcpkg/tokid/portfile.cmake'}",
                           "-DFEATURES=tool", f"-DROOT={tmp_path}", f"-DLIBRARY={library}", f"-DTOOL={tokid.executable}",
                           "-P", ROOT / "tests/e2e/vcpkg.cmake"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    files = {str(file.relative_to(packages)) for file in packages.rglob("*") if file.is_file()}
    assert {"lib/libtokid.a", "debug/lib/libtokid.a", "include/tokid/tokid.hpp", "tools/tokid/tokid",
            "share/tokid/tokidConfig.cmake", "share/tokid/copyright"} < files
    assert {name.split("/")[0] for name in files} == {"lib", "debug", "include", "tools", "share"}
    assert [name for name in files if name.startswith("debug")] == ["debug/lib/libtokid.a"]
    assert text_of("LICENSE") + text_of("NOTICE") == (packages / "share/tokid/copyright").read_text()
    for name in (name for name in files if name.endswith(".cmake")):
        text = (packages / name).read_text()
        assert str(tmp_path) not in text and str(ROOT) not in text, name
        assert set(re.findall(r'"\$\{_IMPORT_PREFIX\}/([^"]+\.a)"', text)) <= files


def test_version_in_the_changelog(version):
    """The newest section with a number is this version's; before the first release it is announced."""
    text = text_of("CHANGELOG.md")
    released = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - \d{4}-\d\d-\d\d$", text, re.MULTILINE)
    assert re.findall(r"^## \[(.*?)\]", text, re.MULTILINE) == ["Unreleased", *released]
    assert released[:1] == [version] or f"{version} when it is released" in changes(text, version)


def test_paper_to_cite():
    dois = re.findall(r"^    doi: (10\.\S+)$", text_of("CITATION.cff"), re.MULTILINE)
    assert len(dois) == 2 and f"https://doi.org/{dois[0]}" in text_of("README.md")


def test_release_notes():
    text = ("# Changelog\n\n## [Unreleased]\n\n- new\n\n## [1.1.0] - 2026-02-01\n\n- b [c]\n\n"
            "## [1.0.0] - 2026-01-01\n\n- a\n")
    assert changes(text, "1.1.0") == "- b [c]"
    assert changes(text, "1.0.0") == "- a"
    assert changes(text, "1.2.0") == "- new"


class Parts:
    """A repository of a few files, and made-up parts of a release of it in a build directory."""

    def __init__(self, directory):
        self.source, self.build = directory / "source", directory / "build"
        self.source.mkdir()
        self.git("init", "--quiet")
        (self.source / "CMakeLists.txt").write_text("project(tokid VERSION 1.2.3 LANGUAGES CXX)\n")
        (self.source / "CHANGELOG.md").write_text("## [Unreleased]\n\n## [1.2.3] - 2026-02-01\n\n- made\n")
        self.commit()

    def git(self, *words):
        return subprocess.run(["git", "-C", self.source, "-c", "user.name=n", "-c", "user.email=e@tokid.invalid", *words],
                              check=True, capture_output=True, text=True).stdout

    def commit(self):
        self.git("add", ".")
        self.git("commit", "--quiet", "--message", "Change something", "--allow-empty")
        return self.git("rev-parse", "HEAD").strip()

    def make(self, version="1.2.3"):
        """What `make package wheels sbom docs` would make."""
        packages, html = self.build / "package", self.build / "docs" / "html"
        control = self.build / "deb" / "DEBIAN" / "control"
        for folder in (packages, html / "deep", self.build / "wheel", control.parent):
            folder.mkdir(parents=True, exist_ok=True)
        control.write_text(f"Package: tokid\nVersion: {version}\nArchitecture: amd64\nMaintainer: n <e@tokid.invalid>\n"
                           "Depends: libone (>= 1), libtwo\nDescription: made up\n")
        subprocess.run(["dpkg-deb", "--build", "--root-owner-group", control.parents[1],
                        packages / f"tokid_{version}-1_amd64.deb"],
                       check=True, capture_output=True, env=os.environ | {"SOURCE_DATE_EPOCH": "1"})
        (packages / f"tokid-{version}-linux-x86_64.tar.gz").write_bytes(b"archive")
        (packages / "SHA256SUMS").write_text(sums(packages.iterdir()))
        (packages / "RELEASE_NOTES.md").write_text("of the packages alone")
        (html / "index.html").write_text("first page")
        (html / "deep" / "page.html").write_text("page")
        (self.build / "tokid.cdx.json").write_text("{}")
        (self.build / "wheel" / f"tokid-{version}-cp312-abi3-manylinux_2_28_x86_64.whl").write_bytes(b"wheel")

    def finish(self):
        return make_release.finish(self.source, self.build)


@pytest.fixture
def parts(tmp_path):
    parts = Parts(tmp_path)
    make_release.begin(parts.source, parts.build)
    parts.make()
    return parts


def test_release_has_every_part(parts):
    folder = parts.finish()
    assert folder == parts.build / "release-1.2.3"
    notes, listed = ((folder / name).read_text() for name in ("RELEASE_NOTES.md", "SHA256SUMS"))
    names = {"tokid_1.2.3-1_amd64.deb", "tokid-1.2.3-linux-x86_64.tar.gz", "tokid-1.2.3-source.tar.gz", "tokid-1.2.3.cdx.json",
             "tokid-1.2.3-site.tar.gz", "tokid-1.2.3-cp312-abi3-manylinux_2_28_x86_64.whl"}
    assert {file.name for file in folder.iterdir()} == names | {"RELEASE_NOTES.md", "SHA256SUMS"}
    digests = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names | {"RELEASE_NOTES.md"}}
    assert listed == "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    assert notes.startswith("# tokid 1.2.3\n\n- made\n") and "libone, libtwo" in notes
    assert parts.git("rev-parse", "HEAD").strip() in notes
    for name in names:
        assert f"{digests[name]}  {name}\n" in notes and notes.count(name) > 1
    for name, files in (("source", {"CMakeLists.txt", "CHANGELOG.md"}), ("site", {"index.html", "deep/page.html"})):
        with tarfile.open(folder / f"tokid-1.2.3-{name}.tar.gz") as archive:
            prefix = "tokid-1.2.3-site" if name == "site" else "tokid-1.2.3"
            assert {entry.name for entry in archive if entry.isfile()} == {f"{prefix}/{file}" for file in files}


def test_release_of_the_same_parts_has_the_same_bytes(parts):
    first = (parts.finish() / "SHA256SUMS").read_text()
    make_release.begin(parts.source, parts.build)
    assert not (parts.build / "release-1.2.3").exists()
    parts.make()
    assert (parts.finish() / "SHA256SUMS").read_text() == first


@pytest.mark.parametrize("part,target", [
    ("package/SHA256SUMS", "make package"),
    ("tokid.cdx.json", "make sbom"),
    ("docs/html/index.html", "make docs"),
    ("wheel/tokid-1.2.3-cp312-abi3-manylinux_2_28_x86_64.whl", "make wheels"),
])
def test_release_without_a_part(parts, part, target):
    (parts.build / part).unlink()
    with pytest.raises(SystemExit, match=target):
        parts.finish()
    assert not (parts.build / "release-1.2.3").exists()


def test_release_forgets_earlier_parts(parts):
    """Else those of another commit would be taken where a target made nothing."""
    parts.finish()
    make_release.begin(parts.source, parts.build)
    with pytest.raises(SystemExit, match="is missing"):
        parts.finish()
    assert not [file for file in parts.build.rglob("*") if file.suffix in (".whl", ".html", ".json")]


@pytest.mark.parametrize("name", ["CHANGELOG.md", "new.cpp"])
def test_release_of_changes_that_are_not_committed(parts, name):
    (parts.source / name).write_text("changed")
    for step in (make_release.begin, make_release.finish):
        with pytest.raises(SystemExit, match=name):
            step(parts.source, parts.build)


def test_release_of_parts_of_another_commit(parts):
    commit = parts.commit()
    with pytest.raises(SystemExit, match=f"not those of commit {commit[:10]}"):
        parts.finish()


def test_release_of_damaged_packages(parts):
    (parts.build / "package" / "tokid-1.2.3-linux-x86_64.tar.gz").write_bytes(b"cut")
    with pytest.raises(SystemExit, match="x86_64.tar.gz: FAILED"):
        parts.finish()


def test_other_systems_are_those_of_the_document():
    rows = re.findall(r"^\| `(\w+)` \|", text_of("docs/portability.md"), re.MULTILINE)
    assert rows == list(portability.ROWS)


def test_files_that_are_the_same_stay_as_they_are_in_another_system(tmp_path):
    def placed(**files):
        archive = io.BytesIO()
        with tarfile.open(fileobj=archive, mode="w") as tar:
            for name, text in files.items():
                entry = tarfile.TarInfo(f"src/{name}")
                entry.size, entry.mode = len(text), 0o755
                tar.addfile(entry, io.BytesIO(text))
        portability.place(archive.getvalue(), tmp_path)
        return {file.name: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}

    assert placed(one=b"1", two=b"2") == {"one": b"1", "two": b"2"}
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "object").touch()
    first = (tmp_path / "src" / "one").stat()
    assert placed(one=b"1", three=b"3") == {"one": b"1", "three": b"3", "object": b""}
    assert (tmp_path / "src" / "one").stat().st_mtime_ns == first.st_mtime_ns
    assert first.st_mode & 0o777 == 0o755


def test_wheels_for_every_python_that_is_promised():
    """nanobind has the stable ABI from 3.12 on; before that every version has a wheel of its own."""
    promised = tomllib.loads(text_of("pyproject.toml"))["project"]["requires-python"]
    oldest = int(re.fullmatch(r">=3\.(\d+)", promised)[1])
    tags = [python.tag for python in PYTHONS]
    assert sorted(tags) == sorted(["cp312-abi3", *(f"cp3{minor}-cp3{minor}" for minor in range(oldest, 12))])
    for tag in tags:
        assert f"`{tag}`" in text_of("docs/install.md")
    classifiers = tomllib.loads(text_of("pyproject.toml"))["project"]["classifiers"]
    named = re.findall(r"Programming Language :: Python :: 3\.(\d+)", "\n".join(classifiers))
    assert named == [str(minor) for minor in range(oldest, max(int(python.version[2:]) for python in PYTHONS) + 1)]


def program(machine, kind=3):
    """The first bytes of an ELF file for this processor. Its kind is 3 if the program is position-independent, else 2."""
    number = {"x86_64": 62, "aarch64": 183}[machine]
    return b"\x7fELF\2\1\1".ljust(16, b"\0") + kind.to_bytes(2, "little") + number.to_bytes(2, "little")


TOOL = "tokid-1.2.3.data/scripts/tokid"


@pytest.mark.parametrize("machine, files, mode, reason", [
    ("x86_64", {TOOL: program("x86_64"), "tokid/__main__.py": b""}, 0o755, None),
    ("aarch64", {TOOL: program("aarch64"), "tokid/__main__.py": b""}, 0o755, None),
    ("x86_64", {"tokid/__main__.py": b""}, 0o755, "0 command line tools tokid, one needed"),
    ("x86_64", {"tokid/tokid": program("x86_64"), "tokid/__main__.py": b""}, 0o755, "0 command line tools tokid, one needed"),
    ("aarch64", {TOOL: program("x86_64"), "tokid/__main__.py": b""}, 0o755, "no program for aarch64"),
    ("x86_64", {TOOL: b"#!/bin/sh", "tokid/__main__.py": b""}, 0o755, "no program for x86_64"),
    ("x86_64", {TOOL: program("x86_64", kind=2), "tokid/__main__.py": b""}, 0o755, "not position-independent"),
    ("x86_64", {TOOL: program("x86_64"), "tokid/__main__.py": b""}, 0o644, "not executable"),
    ("x86_64", {TOOL: program("x86_64")}, 0o755, "no tokid/__main__.py"),
])
def test_wheel_without_its_command_is_refused(tmp_path, machine, files, mode, reason):
    wheel = tmp_path / f"tokid-1.2.3-cp312-abi3-manylinux_2_28_{machine}.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)
            entry.external_attr = (0o100000 | mode) << 16
            archive.writestr(entry, content)
    if reason is None:
        need_command(wheel)
    else:
        with pytest.raises(SystemExit, match=reason):
            need_command(wheel)


def test_pip_install_of_the_source_builds_the_command():
    """python/tests/try_install.py installs such a package on an installed tokid, which has the command already."""
    settings = tomllib.loads(text_of("pyproject.toml"))["tool"]["scikit-build"]
    (target,) = settings["build"]["targets"]
    cmake = text_of("python/CMakeLists.txt")
    assert settings["cmake"]["define"]["TOKID_BUILD_TOOL"] == "ON"
    assert f"add_dependencies({target} tokid_tool)" in cmake
    assert 'set_target_properties(tokid_tool PROPERTIES INSTALL_RPATH "")' in cmake
    (component,) = settings["install"]["components"]
    assert f"install(TARGETS tokid_tool RUNTIME DESTINATION ${{SKBUILD_SCRIPTS_DIR}} COMPONENT {component})" in cmake
