# SPDX-License-Identifier: BSD-3-Clause
"""Packages that tokid does without until they are needed."""

from __future__ import annotations

import importlib
from typing import Any


def need(module: str, what: str, install: str) -> Any:
    """The module, or an ImportError that says what to install."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != module.split(".")[0]:
            raise  # there, but not whole
        raise ImportError(f"{what} needs {module.split('.')[0]}: pip install {install}", name=error.name) from None
