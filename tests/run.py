#!/usr/bin/env python3
"""Runs the tests of a build directory and ends with the line 'N passed, N failed'.

    tests/run.py BUILD [--as LEVEL] [argument of ctest ...]

With --as avx2, sse4 or baseline, tokid, NumPy, OpenBLAS and the C library compute as on a processor without newer
instructions.

Every GoogleTest case and every pytest case counts as one; what else ctest runs (the examples, the installed package)
counts as one each. The exit status is 0 if something passed and nothing failed.
"""

import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path


NEWER = {"avx2": (["AVX512F", "AVX512CD", "AVX512_SKX", "AVX512_CLX", "AVX512_CNL", "AVX512_ICL", "AVX512_SPR",
                  "X86_V4"], ["AVX512F"], "Haswell")}
NEWER["sse4"] = (["AVX2", "FMA3", "AVX", "F16C", "X86_V3", *NEWER["avx2"][0]], ["AVX", "AVX2", "FMA", "FMA4", "AVX512F"], "Nehalem")
NEWER["baseline"] = (["SSE41", "SSE42", "POPCNT", "SSSE3", *NEWER["sse4"][0]], NEWER["sse4"][1], "Prescott")


def processor(level):
    """The environment for a processor of this level: what its instructions are, for each of the libraries."""
    numpy, libc, openblas = NEWER[level]
    return {"TOKID_SIMD": level, "NPY_DISABLE_CPU_FEATURES": " ".join(numpy), "OPENBLAS_CORETYPE": openblas,
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join("-" + name for name in libc),
            "PYTHONWARNINGS": "ignore:During parsing environment variable"}  # NumPy, of features that it has no code for


def outcome(case):
    if case.find("failure") is not None or case.find("error") is not None:
        return "failed"
    return "skipped" if case.find("skipped") is not None else "passed"


def pytest_cases(report):
    """Name and outcome of each case in a JUnit report of pytest; none where the file is missing or broken."""
    try:
        cases = ElementTree.parse(report).iter("testcase")
    except (OSError, ElementTree.ParseError):
        return []
    # A test that passes and whose clean-up then fails is listed twice: the worse of the two counts.
    found = {}
    for case in cases:
        name = f"{case.get('classname')}.{case.get('name')}"
        found[name] = max(found.get(name, ""), outcome(case), key=["", "passed", "skipped", "failed"].index)
    return list(found.items())


def main():
    build, words = Path(sys.argv[1]), sys.argv[2:]
    environment = dict(os.environ)
    if words[:1] == ["--as"]:
        environment.update(processor(words[1]))
        words = words[2:]
    reports = (build / "reports").resolve()
    shutil.rmtree(reports, ignore_errors=True)
    reports.mkdir(parents=True)
    at_once = 3 * os.cpu_count()  # many of them wait: for a browser, for files to be safe, for processes to kill
    status = subprocess.run(
        ["ctest", "--test-dir", build, "--progress", "--output-on-failure", "--no-tests=error", "--no-label-summary",
         "--parallel", str(at_once), "--output-junit", reports / "ctest.xml", *words],
        stdin=subprocess.DEVNULL, check=False, env=environment).returncode

    results = []
    for test in ElementTree.parse(reports / "ctest.xml").iter("testcase"):
        name, ended = test.get("name"), test.get("status")
        ended = {"run": "passed", "fail": "failed"}.get(ended, "skipped" if outcome(test) == "skipped" else "failed")
        cases = pytest_cases(reports / f"{name}.xml")
        # pytest itself may fail without a failed case: count that too.
        if ended == "failed" and all(result != "failed" for _, result in cases) or not cases:
            cases.append((name, ended))
        results += cases

    count = {word: sum(result == word for _, result in results) for word in ("passed", "failed", "skipped")}
    for word in ("skipped", "failed"):
        if count[word]:
            print(f"\n{word}:", *(name for name, result in results if result == word), sep="\n  ")
    print(f"\n{count['passed']} passed, {count['failed']} failed"
          + (f", {count['skipped']} skipped" if count["skipped"] else ""), flush=True)
    return 0 if status == 0 and count["passed"] and not count["failed"] else 1


if __name__ == "__main__":
    sys.exit(main())
