#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the notebooks of the examples, which hold the scripts cell by cell: python3 examples/python/notebooks.py

A line "# %%" begins a cell of code, "# %% [markdown]" one of text in comments; editors know these marks, too. The
notebooks are kept without outputs: nothing is in them that is not in the scripts.
"""

import json
import re
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
SCRIPTS = sorted(path for path in FOLDER.glob("*.py") if path.read_text(encoding="utf-8").startswith("# %%"))


def cells(script):
    """Kind and text of each cell."""
    for part in re.split(r"^# %%", script, flags=re.MULTILINE)[1:]:
        mark, _, text = part.partition("\n")
        if mark.strip() == "[markdown]":
            yield "markdown", re.sub(r"^# ?", "", text.strip("\n"), flags=re.MULTILINE)
        else:
            yield "code", text.strip("\n")


def notebook(script):
    """The file (nbformat 4.5) as text."""
    content = []
    for number, (kind, text) in enumerate(cells(script), 1):
        cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": text.splitlines(keepends=True)}
        content.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
                "language_info": {"name": "python"}}
    whole = {"cells": content, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for path in SCRIPTS:
        path.with_suffix(".ipynb").write_text(notebook(path.read_text(encoding="utf-8")), encoding="utf-8")
        print(path.with_suffix(".ipynb"))
