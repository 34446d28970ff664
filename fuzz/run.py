#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""run.py BUILD SECONDS [TARGET ...]: every fuzzer for so long, as many at once as there are processors. Prints a line for
each; findings stay in BUILD/findings, and the status is 1 where there are any. What the fuzzers learn stays in
BUILD/corpus, from where the next run goes on.

A finding whose stack begins in the HDF5 library or in matio is counted by itself: those are the system's, as README.md
says, and the fuzzer goes on behind them."""

import concurrent.futures
import os
import re
import subprocess
import sys
from pathlib import Path

SEEDS = Path(__file__).parent / "corpus"
OPTIONS = ["-max_len=65536", "-timeout=20", "-rss_limit_mb=2048", "-detect_leaks=0"]
# What the sanitizers put in front of the function that is to blame
WRAPPERS = re.compile(r"interceptor|__asan|__sanitizer|fuzzer::|operator new|\bmalloc\b|\bcalloc\b|\brealloc\b|libc\.so|"
                      r"/sysdeps/|/fuzz_\w+\+0x\w+\) \(BuildId")


def whose(fuzzer, finding):
    """'hdf5_serial' or 'matio' where the stack of a finding begins in one of them, else 'tokid'."""
    result = subprocess.run([fuzzer, *OPTIONS, finding], capture_output=True, text=True, errors="replace", check=False,
                            env={**os.environ, "ASAN_OPTIONS": "fast_unwind_on_fatal=0"}, timeout=120)
    if result.returncode == 0:
        return "nothing when run alone"
    for frame in re.findall(r"^ +#\d+ 0x\w+ +(.*)$", result.stderr, re.MULTILINE):
        if library := re.search(r"lib(hdf5_serial|hdf5|matio)\.so", frame):
            return library.group(1)
        if not WRAPPERS.search(frame):
            return "tokid"
    return "tokid"


def run(build, seconds, name):
    fuzzer, learnt, findings = build / "bin" / f"fuzz_{name}", build / "corpus" / name, build / "findings" / name
    for folder in (learnt, findings):
        folder.mkdir(parents=True, exist_ok=True)
    result = subprocess.run(
        [fuzzer, *OPTIONS, f"-max_total_time={seconds}", "-fork=1", "-ignore_crashes=1", "-ignore_ooms=1",
         "-ignore_timeouts=1", f"-artifact_prefix={findings}/", learnt, SEEDS / name],
        capture_output=True, text=True, errors="replace", check=False)
    (findings.parent / f"{name}.log").write_text(result.stderr)
    counts = {}
    for finding in sorted(findings.iterdir()):
        owner = whose(fuzzer, finding)
        counts[owner] = counts.get(owner, 0) + 1
        if owner != "tokid":
            others = build / "findings-of-libraries" / name
            others.mkdir(parents=True, exist_ok=True)
            finding.rename(others / finding.name)
    runs = re.findall(r"^#(\d+): cov: (\d+)", result.stderr, re.MULTILINE) or [("0", "0")]
    failed = counts.get("tokid", 0) > 0 or runs[-1][0] == "0"
    told = ", ".join(f"{count} in {owner}" for owner, count in sorted(counts.items())) or "none"
    print(f"{name:16} {int(runs[-1][0]):>10} executions  {runs[-1][1]:>6} edges  findings: {told}", flush=True)
    return failed


def main():
    build, seconds = Path(sys.argv[1]).resolve(), int(sys.argv[2])
    names = sys.argv[3:] or [path.name for path in sorted(SEEDS.iterdir())]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        failed = sum(pool.map(lambda name: run(build, seconds, name), names))
    if failed:
        print(f"{failed} of {len(names)} with findings of tokid: see {build / 'findings'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
