# SPDX-License-Identifier: BSD-3-Clause
"""Types of arguments and results."""

from __future__ import annotations

import os
from typing import Any, Callable, Union

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IndexArray = npt.NDArray[np.int64]
ArrayLike = npt.ArrayLike
PathLike = Union[str, "os.PathLike[str]"]
# False: nothing. True: a bar. A callable gets the finished share of the work, from 0 to 1.
Progress = Union[bool, Callable[[float], Any]]
