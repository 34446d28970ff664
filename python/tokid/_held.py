# SPDX-License-Identifier: BSD-3-Clause
"""Properties that show what the core of an object holds."""

from __future__ import annotations

from typing import Any, Callable, Generic, Optional, TypeVar, overload

T = TypeVar("T")


class Held(property, Generic[T]):
    """A read-only property with the value `read(core, name)`; by default the attribute of the core with its name."""

    def __init__(self, doc: str, read: Callable[[Any, str], T] = getattr) -> None:
        super().__init__()
        self.__doc__ = doc  # set here: the constructor of property would take the docstring of this class
        self._read = read

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type, /) -> Held[T]: ...
    @overload
    def __get__(self, instance: Any, owner: Optional[type] = None, /) -> T: ...
    def __get__(self, instance: Any, owner: Optional[type] = None, /) -> Any:
        return self if instance is None else self._read(instance._core, self._name)
