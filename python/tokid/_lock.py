# SPDX-License-Identifier: BSD-3-Clause
"""Locks for files that are read, changed and written."""

from __future__ import annotations

import os
from typing import Any, Optional

from . import _options, _tokid
from ._errors import warn, writing
from ._typing import PathLike


class FileLock:
    """A lock for a file, such as that of an `UpdateState`. One holder at a time can have the lock of a file.

    `tokid.update` of a file, ``tokid update`` and ``tokid identify --state`` take the lock themselves. Take it in a
    program that reads, changes and saves a state in separate steps. Otherwise the experiments of another program may be
    lost::

        with tokid.FileLock("state.h5") as held:
            state = tokid.UpdateState.load(held)
            model = tokid.update(state, u, y)
            model.state.save(held)

    Locks hold between processes, threads and machines that share the folder. A process that ends loses its locks.

    Parameters
    ----------
    path : path
        The file. It need not exist yet.
    wait : float, default 60.0
        Time to wait for another holder [s]. A `TokidWarning` says who has the lock.

    Raises
    ------
    IoError
        If another holder has the lock for longer, or the file system does not support locks. It is an OSError.
    """

    __slots__ = ("__weakref__", "_core", "_path")

    def __init__(self, path: PathLike, *, wait: float = 60.0) -> None:
        with writing(path) as file:
            self._path = file
            self._core: Optional[_tokid.FileLock] = _tokid.FileLock.take(
                file, limit=_options.number("wait", wait), waits=lambda text: warn([text])
            )

    def release(self) -> None:
        """Release the lock. The end of a ``with`` block releases it too."""
        self._core = None

    def __enter__(self) -> FileLock:
        return self

    def __exit__(self, *unused: Any) -> None:
        self.release()

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("a lock has one holder, so it can't be copied or pickled")

    def __fspath__(self) -> str:
        return self._path

    def __repr__(self) -> str:
        return f"<tokid.FileLock: {os.fspath(self)!r}, {'released' if self._core is None else 'held'}>"

    def _held(self) -> _tokid.FileLock:
        if self._core is None:
            raise ValueError(f"{self._path}: the lock was released before, a held lock needed")
        return self._core
