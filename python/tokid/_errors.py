# SPDX-License-Identifier: BSD-3-Clause
"""What can go wrong, and what is worth a word."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable

from ._tokid import IoError as IoError

IoError.__module__ = "tokid"  # as users know it

_PACKAGE = os.path.dirname(os.path.abspath(__file__)) + os.sep


class TokidWarning(UserWarning):
    """What a user should know about a result: the tool's warnings, with the same texts."""


def warn(texts: Iterable[str]) -> None:
    """Issues each text as a TokidWarning of the line outside this package that made the call."""
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and os.path.abspath(frame.f_code.co_filename).startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    for text in texts:
        warnings.warn(text, TokidWarning, stacklevel=level)
