# SPDX-License-Identifier: BSD-3-Clause
"""The functions for MATLAB and Octave, in Octave: every `function case_…` in tests/matlab is a test of its own.

With TOKID_UPDATE_DOCS=1 in the environment, the outputs in docs/matlab.md are written anew instead of compared.
"""

import os
import re
import shutil
import subprocess
from itertools import zip_longest

import pytest
from conftest import ROOT
from test_docs import run as run_tool
from test_docs import same

TESTS = ROOT / "tests" / "matlab"
CASES = [pytest.param(file.stem, name, id=f"{file.stem[5:]}-{name[5:]}") for file in sorted(TESTS.glob("test_*.m"))
         for name in re.findall(r"^function (case_\w+)\(\)", file.read_text(encoding="utf-8"), re.MULTILINE)]


@pytest.fixture
def octave(tokid, tmp_path):
    """Runs Octave with the package on its path in a folder of the test's own; no temporary file may be left."""
    program = os.environ.get("TOKID_OCTAVE") or shutil.which("octave-cli")
    if not program:
        pytest.fail("Octave is needed: octave-cli on the path, or its path in TOKID_OCTAVE")
    work, temporary = tmp_path / "it's work", tmp_path / "it's temporary"
    work.mkdir()
    temporary.mkdir()
    environment = {**os.environ, "TOKID": tokid.executable, "TMPDIR": str(temporary), "HOME": str(tmp_path),
                   "LC_ALL": "C.UTF-8", "PATHS": os.pathsep.join(map(str, (ROOT / "matlab", TESTS)))}

    def run(code):
        code = "addpath(getenv('PATHS'));\n" + code
        options = ["--no-gui", "--no-init-file", "--no-site-file", "--no-history"]
        result = subprocess.run([program, *options, "--eval", code], cwd=work, env=environment,
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                encoding="utf-8", check=False)
        assert result.returncode == 0, result.stdout
        assert not list(temporary.iterdir())
        return result.stdout

    run.folder = work
    return run


@pytest.mark.parametrize("file,case", CASES)
def test_case(octave, file, case):
    octave(f"{file}('{case}')")


def test_example(tokid, octave):
    """Ten lines of Octave simulate a model as the tool does."""
    example = ROOT / "examples" / "octave_read_model.m"
    text = example.read_text(encoding="utf-8")
    for command in re.findall(r"^%   (tokid .*)$", text, re.MULTILINE):
        status, printed = run_tool(tokid, command, octave.folder)
        assert status == 0, printed
    first = text.index("model = load(")
    assert text[first:text.index("\n\n", first)].count("\n") == 9
    printed = octave(f"source('{example}')")
    assert "20 experiments of 40 steps, 4 states" in printed
    assert float(re.search(r"from the tool: (\S+) of", printed)[1]) <= 1e-12


GUIDE = ROOT / "docs" / "matlab.md"


def test_guide(octave):
    """The blocks of the page run one after the other, and print what stands below them."""
    text = updated = GUIDE.read_text(encoding="utf-8")
    blocks = list(re.finditer(r"^```matlab\n(.*?)^```\n(?:```\n(.*?)^```\n)?", text, re.MULTILINE | re.DOTALL))
    mark = "-- next block --"
    code = f"disp('{mark}')\n".join(match[1] for match in blocks[1:])  # the first is the path, which is set here
    printed = octave(code).split(mark + "\n")
    assert len(printed) == len(blocks) - 1 >= 6
    for match, found in zip(blocks[1:], printed):
        if os.environ.get("TOKID_UPDATE_DOCS") == "1":
            output = f"```\n{found}```\n" if match[2] is not None else ""
            updated = updated.replace(match[0], f"```matlab\n{match[1]}```\n{output}")
            continue
        for before, now in zip_longest((match[2] or "").splitlines(), found.splitlines(), fillvalue=""):
            assert same(before, now), f"shown:   {before}\nprinted: {now}"
    if updated != text:
        GUIDE.write_text(updated, encoding="utf-8")
        pytest.skip("docs/matlab.md written anew")
