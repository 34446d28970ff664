# SPDX-License-Identifier: BSD-3-Clause
"""The version stands in CMakeLists.txt; what repeats it says the same. Other systems get the tree of a commit."""

import io
import re
import sys
import tarfile
import tomllib

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "release"))
sys.path.insert(0, str(ROOT / "python" / "wheels"))
import portability
from make_packages import changes
from make_wheels import PYTHONS


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
    ("README.md", r"find_package\(tokid (\S+) REQUIRED\)"),
    ("tests/install/consumer/CMakeLists.txt", r"set\(requested (\S+) CACHE"),
])
def test_version_to_ask_for(version, name, pattern):
    assert re.findall(pattern, text_of(name)) == [version.rpartition(".")[0]]


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
        assert f"`{tag}`" in text_of("docs/python.md")
