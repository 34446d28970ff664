# SPDX-License-Identifier: BSD-3-Clause
"""Objects as the bytes of a file, for pickle."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


def bytes_of(save: Callable[[str], Any]) -> bytes:
    """The bytes of the file that `save` writes."""
    with tempfile.TemporaryDirectory() as directory:
        file = os.path.join(directory, "pickled.npz")
        save(file)
        with open(file, "rb") as stream:
            return stream.read()


def from_bytes(load: Callable[[str], T], content: bytes) -> T:
    """The object that `load` reads from a file with these bytes."""
    with tempfile.TemporaryDirectory() as directory:
        file = os.path.join(directory, "pickled.npz")
        with open(file, "wb") as stream:
            stream.write(content)
        return load(file)
