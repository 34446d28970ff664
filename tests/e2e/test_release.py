# SPDX-License-Identifier: BSD-3-Clause
"""The version stands in CMakeLists.txt; what repeats it says the same."""

import re
import sys
import tomllib

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "release"))
from make_packages import changes


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
