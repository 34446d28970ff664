# SPDX-License-Identifier: BSD-3-Clause
"""Files that are read, changed and written."""

from __future__ import annotations

import os
from typing import Any, Optional

from . import _tokid
from ._errors import warn, writing
from ._typing import PathLike


class FileLock:
    """Holds a file, such as that of an `UpdateState`: nobody else who asks for its lock has it meanwhile.

    `tokid.update` of a file, ``tokid update`` and ``tokid identify --state`` ask for the lock by themselves. Hold it
    where you read a state, change it and save it in steps of your own::

        with tokid.FileLock("state.h5") as held:
            state = tokid.UpdateState.load(held)
            model = tokid.update(state, u, y)
            model.state.save(held)

    Locks work between processes, threads and machines that share the folder. A process that dies loses its locks.

    Parameters
    ----------
    path : path
        The file; it need not exist yet.
    wait : float, optional
        Seconds to wait where somebody else has it, with a `TokidWarning` that says who.

    Raises
    ------
    IoError
        Where somebody else has it for longer, or the file system lets nothing be locked; an OSError.
    """

    __slots__ = ("__weakref__", "_core", "_path")

    def __init__(self, path: PathLike, *, wait: float = 60.0) -> None:
        with writing(path) as file:
            self._path = file
            self._core: Optional[_tokid.FileLock] = _tokid.FileLock.take(
                file, limit=float(wait), waits=lambda text: warn([text])
            )

    def release(self) -> None:
        """Lets others have the file. The end of a ``with`` block does it, too."""
        self._core = None

    def __enter__(self) -> FileLock:
        return self

    def __exit__(self, *unused: Any) -> None:
        self.release()

    def __fspath__(self) -> str:
        return self._path

    def __repr__(self) -> str:
        return f"<tokid.FileLock: {os.fspath(self)!r}, {'released' if self._core is None else 'held'}>"

    def _held(self) -> _tokid.FileLock:
        if self._core is None:
            raise ValueError(f"{self._path}: the lock was released before, one that is held needed")
        return self._core
