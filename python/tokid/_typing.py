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


class ProgressShare(float):
    """The finished share of the work, from 0 to 1.

    Attributes
    ----------
    stage : str
        What tokid does now, such as "choosing lags and lambda"; empty for work of one stage.
    """

    stage: str = ""

    @classmethod
    def _of(cls, share: float, stage: str) -> ProgressShare:
        self = cls(share)
        self.stage = stage
        return self


# False: nothing. True: a bar. A callable gets the finished share of the work.
Progress = Union[bool, Callable[[ProgressShare], Any]]
