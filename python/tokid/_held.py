# SPDX-License-Identifier: BSD-3-Clause
"""Properties that show what the core of an object holds."""

from __future__ import annotations

from typing import Any, Callable, Generic, Optional, TypeVar, overload

import numpy as np

T = TypeVar("T")


def read_only(value: Any) -> Any:
    """The value with read-only arrays. Each access makes a copy, and a change of the copy would have no effect."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, list) and any(isinstance(entry, np.ndarray) for entry in value):
        return tuple(map(read_only, value))
    return value


class Held(property, Generic[T]):
    """A read-only property with the value `read(core, name)`; by default the attribute of the core with its name.

    Its arrays are read-only, too, unless they are `writable` views of the core.
    """

    def __init__(self, doc: str, read: Callable[[Any, str], T] = getattr, *, writable: bool = False) -> None:
        super().__init__()
        self.__doc__ = doc  # set here: the constructor of property would take the docstring of this class
        self._read = read
        self._writable = writable

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type, /) -> Held[T]: ...
    @overload
    def __get__(self, instance: Any, owner: Optional[type] = None, /) -> T: ...
    def __get__(self, instance: Any, owner: Optional[type] = None, /) -> Any:
        if instance is None:
            return self
        value = self._read(instance._core, self._name)
        return value if self._writable else read_only(value)
