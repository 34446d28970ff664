# SPDX-License-Identifier: BSD-3-Clause
"""The functions for MATLAB and Octave, in Octave: every `function case_…` in tests/matlab is a test of its own.

With TOKID_UPDATE_DOCS=1 in the environment, the outputs in docs/matlab.md are written anew instead of compared.
"""

import ctypes
import os
import re
import shutil
import subprocess
from itertools import zip_longest

import pytest
from conftest import ROOT
from perturbation import SEED
from test_docs import anew, same
from test_docs import run as run_tool

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


def compare_with_c(folder, text):
    """The function in C of the page computes the inputs of the loop in Octave, which are in loop.txt."""
    code = re.search(r"^```c\n(.*?)^```", text, re.MULTILINE | re.DOTALL)[1]
    (folder / "machine.c").write_text(code, encoding="utf-8")
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-shared", "-fPIC", "-o", "machine.so", "machine.c",
                    "observer.c", "-lm"], cwd=folder, check=True)
    control = ctypes.CDLL(str(folder / "machine.so")).machine_control
    loop = [[float(word) for word in line.split()] for line in (folder / "loop.txt").read_text().splitlines()]
    assert len(loop) == 40
    pair = ctypes.c_double * 2
    u_last, y_last, u = pair(), pair(), pair()
    largest = max(abs(number) for row in loop for number in row[:2])
    assert largest > 0
    for k, row in enumerate(loop):
        assert control(int(k == 0), u_last, y_last, u) == 0
        assert max(abs(u[0] - row[0]), abs(u[1] - row[1])) < 1e-9 * largest
        u_last, y_last = pair(*row[:2]), pair(*row[2:])


def run_blocks(octave, page, first, after=""):
    """The blocks of a page from `first` on run one after the other, and print what stands below them."""
    text = updated = page.read_text(encoding="utf-8")
    blocks = list(re.finditer(r"^```matlab\n(.*?)^```\n(?:```\n(.*?)^```\n)?", text, re.MULTILINE | re.DOTALL))[first:]
    mark = "-- next block --"
    perturb = f"perturb({SEED});\n" if SEED else ""
    code = f"\ndisp('{mark}')\n".join(["", *(match[1] + perturb for match in blocks), after])
    printed = octave(code).split(mark + "\n")[1:-1]
    assert len(printed) == len(blocks)
    for match, found in zip(blocks, printed):
        if os.environ.get("TOKID_UPDATE_DOCS") == "1":
            lines = "".join(line + "\n" for line in anew((match[2] or "").splitlines(), found.splitlines()))
            output = f"```\n{lines}```\n" if match[2] is not None else ""
            updated = updated.replace(match[0], f"```matlab\n{match[1]}```\n{output}")
            continue
        for shown, now in zip_longest((match[2] or "").splitlines(), found.splitlines(), fillvalue=""):
            assert same(shown, now), f"shown:   {shown}\nprinted: {now}"
    if updated != text:
        page.write_text(updated, encoding="utf-8")
        pytest.skip(f"{page.name} written anew")
    return blocks


def test_guide(octave):
    """The first block of the guide is the path, which is set here."""
    loop = "dlmwrite('loop.txt', [applied, measured], 'delimiter', ' ', 'precision', '%.17g')"
    assert len(run_blocks(octave, GUIDE, 1, after=loop)) >= 12
    compare_with_c(octave.folder, GUIDE.read_text(encoding="utf-8"))


def test_control(tokid, octave):
    """The blocks of the page use the model of its first session."""
    page = ROOT / "docs" / "how-to" / "control.md"
    for command in re.findall(r"^\$ (tokid .*)$", page.read_text(encoding="utf-8"), re.MULTILINE)[:2]:
        status, printed = run_tool(tokid, command, octave.folder)
        assert status == 0, printed
    assert len(run_blocks(octave, page, 0)) == 1


@pytest.mark.parametrize("nominal", ["none", "mean"])
def test_loop_of_formats(octave, nominal):
    """The loop of formats.md simulates a model as tokid.simulate does, also with a nominal trajectory."""
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    loop = re.search(r"^```matlab\n(model = load\(.*?)^```", text, re.MULTILINE | re.DOTALL)[1]
    octave(f"""data = tokid.example_data('oscillator', 'experiments', 30, 'steps', 14, 'initial_state', 'zero');
data.u = data.u + 3 * strcmp('{nominal}', 'mean');
data.y = data.y + 5 * strcmp('{nominal}', 'mean');
tokid.write('model.mat', tokid.identify(data, 'lags', 2, 'states', 4, 'nominal', '{nominal}', 'initial_state', 'zero'));
u = squeeze(data.u(2, :, :));
{loop}
assert(isfield(model, 'u_nominal') == strcmp('{nominal}', 'mean'))
near(y, squeeze(tokid.simulate(model, data.u(2, :, :))), 1e-9)
""")
