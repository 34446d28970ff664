# SPDX-License-Identifier: BSD-3-Clause
"""Errors of files, and warnings."""

from __future__ import annotations

import errno
import os
import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from ._tokid import IoError as IoError

IoError.__module__ = "tokid"  # the module where users find it

_PACKAGE = os.path.dirname(os.path.abspath(__file__)) + os.sep


class _NamedFileError(IoError):
    """An IoError with errno and filename, whose text is that of the library."""

    def __str__(self) -> str:
        return str(self.strerror)


class _MissingFileError(_NamedFileError, FileNotFoundError):
    pass


class _ForbiddenFileError(_NamedFileError, PermissionError):
    pass


@contextmanager
def reading(path: Any) -> Iterator[str]:
    """The path of a file to read. For a missing or forbidden file, the error is also that of Python."""
    file = os.fsdecode(path)
    try:
        yield file
    except IoError as error:
        if not os.path.exists(file):
            raise _MissingFileError(errno.ENOENT, str(error), file) from None
        if not os.access(file, os.R_OK):
            raise _ForbiddenFileError(errno.EACCES, str(error), file) from None
        raise


@contextmanager
def writing(path: Any) -> Iterator[str]:
    """The path of a file to write. If the system refuses, the error is also that of Python, or has errno."""
    file = os.fsdecode(path)
    directory = os.path.dirname(os.path.realpath(file))
    try:
        yield file
    except IoError as error:
        if not os.path.isdir(directory):
            raise _MissingFileError(errno.ENOENT, str(error), file) from None
        if not os.access(file if os.path.exists(file) else directory, os.W_OK):
            raise _ForbiddenFileError(errno.EACCES, str(error), file) from None
        if error.errno and error.filename is None:
            raise _NamedFileError(error.errno, str(error), file) from None
        raise


class TokidWarning(UserWarning):
    """A finding that the user should know, with the text of a warning of the tool and the arguments of Python."""


def warn(texts: Iterable[str]) -> None:
    """Issue each text as a TokidWarning at the line outside this package that made the call."""
    level, frame = 1, sys._getframe(0)
    while frame.f_back is not None and os.path.abspath(frame.f_code.co_filename).startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    for text in texts:
        warnings.warn(text, TokidWarning, stacklevel=level)
