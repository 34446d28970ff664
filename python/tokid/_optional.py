# SPDX-License-Identifier: BSD-3-Clause
"""Optional packages, imported when they are needed."""

from __future__ import annotations

import importlib
from typing import Any


def need(module: str, what: str, install: str) -> Any:
    """Return the module. The ImportError of a missing package says what to install."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != module.split(".")[0]:
            raise  # the package is installed, but one that it needs is not
        raise ImportError(f"{what} needs {module.split('.')[0]}: pip install {install}", name=error.name) from None
