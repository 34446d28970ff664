#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""One identification, for ../measured.py to measure the peak memory of: memory.py CONTENDER DATA.npz

Without a contender ("nothing"), it loads what all of them need.
"""

import os
import sys

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

from types import SimpleNamespace  # noqa: E402 - after the number of threads is set

import numpy as np  # noqa: E402

from contenders import CONTENDERS  # noqa: E402

name, path = sys.argv[1:]
with np.load(path) as file:
    data = SimpleNamespace(u=file["u"], y=file["y"], free_y=file["free_y"], dt=float(file["dt"]))
if name != "nothing":
    CONTENDERS[name](data)
