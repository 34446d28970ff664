# SPDX-License-Identifier: BSD-3-Clause
"""The functions for MATLAB and Octave, in Octave: every `function case_…` in tests/matlab is a test of its own."""

import os
import re
import shutil
import subprocess

import pytest
from conftest import ROOT

TESTS = ROOT / "tests" / "matlab"
CASES = [pytest.param(file.stem, name, id=f"{file.stem[5:]}-{name[5:]}") for file in sorted(TESTS.glob("test_*.m"))
         for name in re.findall(r"^function (case_\w+)\(\)", file.read_text(encoding="utf-8"), re.MULTILINE)]


@pytest.fixture
def octave(tokid, tmp_path):
    """Runs Octave with the package on its path, in a folder of the test's own; temporary files must be gone at the end."""
    program = os.environ.get("TOKID_OCTAVE") or shutil.which("octave-cli")
    if not program:
        pytest.fail("Octave is needed: octave-cli on the path, or its path in TOKID_OCTAVE")
    work, temporary = tmp_path / "it's work", tmp_path / "it's temporary"
    work.mkdir()
    temporary.mkdir()
    environment = {**os.environ, "TOKID": tokid.executable, "TMPDIR": str(temporary), "HOME": str(tmp_path),
                   "LC_ALL": "C.UTF-8", "PATHS": os.pathsep.join(map(str, (ROOT / "matlab", TESTS)))}

    def run(code, **changes):
        code = "addpath(getenv('PATHS'));\n" + code
        result = subprocess.run([program, "--no-gui", "--no-init-file", "--no-site-file", "--no-history", "--eval", code],
                                cwd=work, env={**environment, **changes}, stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", check=False)
        assert result.returncode == 0, result.stdout
        assert not list(temporary.iterdir())
        return result.stdout

    run.folder = work
    return run


@pytest.mark.parametrize("file,case", CASES)
def test_case(octave, file, case):
    octave(f"{file}('{case}')")
