# SPDX-License-Identifier: BSD-3-Clause
"""Warnings stop the build of tokid's developers, and nobody else's: another compiler may warn of correct code."""

import json
import os
import re
import subprocess

import pytest
from conftest import ROOT


# A preset has them on; none of them changes how the library is compiled.
UNUSED = [f"-DTOKID_{name}=OFF" for name in ("BUILD_TESTS", "BUILD_EXAMPLES", "BUILD_PYTHON", "WITH_MPI", "INSTALL")]


def strict_sources(build, argument):
    """Whether warnings are errors in sources of tokid, with this argument of cmake."""
    configured = subprocess.run(["cmake", "-B", build, "--log-level=WARNING", argument, *UNUSED], cwd=ROOT,
                                stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True)
    assert not configured.stderr  # no warning of CMake's either
    commands = json.loads((build / "compile_commands.json").read_text())
    own = [command for command in commands if command["file"].startswith(f"{ROOT}/src/")]
    assert len(own) > 20
    return {"-Werror" in command["command"].split() for command in own}


@pytest.mark.parametrize(("argument", "strict"), [
    ("-DCMAKE_BUILD_TYPE=Release", False), ("--preset=release", False), ("--preset=test", False),
    ("--preset=dev", True), ("--preset=asan", True)])
def test_warnings_are_errors_for_developers_alone(tmp_path, argument, strict):
    assert strict_sources(tmp_path, argument) == {strict}


def test_warnings_are_errors_for_the_check_of_a_submission():
    # make prints what it would do
    printed = subprocess.run([ROOT / ".ci" / "run"], env=os.environ | {"MAKEFLAGS": "n"}, stdin=subprocess.DEVNULL,
                             capture_output=True, text=True, check=True).stdout
    assert "-DTOKID_WARNINGS_AS_ERRORS=ON --preset test" in " ".join(printed.replace("\\\n", " ").split())


def test_names_of_arguments_have_no_spaces():
    """CLI11 2.4, of Debian 13, refuses such a name each time the tool starts. CLI11 2.1, of Debian 12, accepts it."""
    calls = [call for path in sorted((ROOT / "app").rglob("*.cpp"))
             for call in re.findall(r'\bcommand\.(?:argument|data)\(\s*"([^"]*)"', path.read_text(encoding="utf-8"))]
    assert len(calls) > 15 and {"MODEL", "IN...OUT"} <= set(calls)
    assert [name for name in calls if " " in name] == []
