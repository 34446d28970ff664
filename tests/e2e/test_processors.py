# SPDX-License-Identifier: BSD-3-Clause
"""Every instruction set of a processor gives the same files, byte for byte."""

import os
import platform
import re

# Exact data; noise, with EM; few experiments; one model for all steps; and what is computed from models.
CALLS = """
example oscillator -o exact.h5 --experiments 50 --steps 30
example oscillator -o few.h5 --experiments 10 --steps 8 --measurement-noise 0.1
example rotating-tube -o noisy.h5 --experiments 30 --steps 10 --measurement-noise 0.01 --process-noise 0.01
identify exact.h5 -o exact-model.h5
identify few.h5 -o few-model.h5
identify few.h5 -o periodic-model.h5 --period 1 --states 4
identify noisy.h5 -o model.h5
validate model.h5 noisy.h5
predict model.h5 noisy.h5 -o predictions.h5
modes exact-model.h5 -o modes.csv
lqr model.h5 -o controller.h5
""".strip().splitlines()

# Without fused operations, other versions of exp, log, sin … in glibc differ in the last bit. Modes use them.
OLD_LIBRARY = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}
ALIKE_TO_ROUNDING = {"modes.csv"}


def files(tokid, folder, **environment):
    folder.mkdir()
    printed = [tokid(*call.split(), cwd=folder, env={**os.environ, **environment}).stdout for call in CALLS]
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    return {**found, "printed": re.sub(r" in [\d.]+ s$", "", "".join(printed), flags=re.MULTILINE)}


def levels(tokid):
    """The instruction sets of this machine."""
    result = tokid("--version", env={**os.environ, "TOKID_SIMD": "none"}, status=2)
    return re.fullmatch(r"tokid: TOKID_SIMD: 'none' found, .*: ([\w, ]+)", result.stderr.strip())[1].split(", ")


def test_every_instruction_set_gives_the_same_bytes(tokid, tmp_path):
    found = levels(tokid)
    assert found[0] == "baseline" and (platform.machine() != "x86_64" or len(found) >= 2)
    best = files(tokid, tmp_path / "best", TOKID_SIMD=found[-1])
    assert len(best) == len(CALLS)  # validate writes no file
    for level in found[:-1]:
        of_level = files(tokid, tmp_path / level, TOKID_SIMD=level)
        assert [name for name in best if of_level[name] != best[name]] == [], level
    of_library = files(tokid, tmp_path / "library", **OLD_LIBRARY)
    assert {name for name in best if of_library[name] != best[name]} <= ALIKE_TO_ROUNDING
