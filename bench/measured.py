# SPDX-License-Identifier: BSD-3-Clause
"""Runs a command and prints its wall time [s], CPU time [s] and peak memory [bytes] as JSON on the last line of stdout.

    python3 -S -E measured.py COMMAND ...

A process of its own, that imports next to nothing: what Linux reports as the peak of a process is at least the size of
the one that started it. The exit status is that of the command.
"""

import os
import sys
import time

begin = time.monotonic()
child = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ)
_, status, usage = os.wait4(child, 0)
wall = time.monotonic() - begin
print(f'\n{{"seconds": {wall:.6f}, "cpu_seconds": {usage.ru_utime + usage.ru_stime:.6f}, '
      f'"peak_bytes": {usage.ru_maxrss * 1024}}}', flush=True)
sys.exit(os.waitstatus_to_exitcode(status) % 256)
