#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the notebooks of the examples, which hold the scripts cell by cell.

    python3 examples/python/notebooks.py                # after a change of text
    python3 examples/python/notebooks.py --run [NAME …] # after a change of code or results

A line "# %%" begins a cell of code, "# %% [markdown]" one of text in comments; editors know these marks, too. With
--run, the code is executed (it needs the packages of docs/requirements.txt), and the notebooks get its outputs, which
the site shows. Without it, a notebook keeps its outputs as long as its code is the same.
"""

import base64
import io
import json
import os
import re
import sys
import tempfile
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
    """The notebook (nbformat 4.5) of a script, without outputs."""
    content = []
    for number, (kind, text) in enumerate(cells(script), 1):
        cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": text.splitlines(keepends=True)}
        content.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))
    metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
                "language_info": {"name": "python"}}
    return {"cells": content, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def code(content):
    """The cells of code."""
    return [cell for cell in content["cells"] if cell["cell_type"] == "code"]


def keep_outputs(content, path):
    """Takes the outputs of the file at path, if its code is the same."""
    before = code(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else []
    if [cell["source"] for cell in before] == [cell["source"] for cell in code(content)]:
        for cell, old in zip(code(content), before):
            cell["outputs"] = old["outputs"]


def small(png):
    """A picture (PNG in base 64) with 256 colours, which a plot has at most, in a third of the bytes."""
    from PIL import Image

    image, out = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB"), io.BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(out, "png", optimize=True)
    return base64.b64encode(out.getvalue()).decode()


def execute(content):
    """Runs the code in a folder of its own. Keeps texts and pictures (PNG), but no messages."""
    import nbformat
    from nbclient import NotebookClient

    # A process of its own gets Matplotlib's settings from the environment.
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "matplotlibrc").write_text("figure.dpi: 110\nfont.family: DejaVu Sans\n", encoding="utf-8")
        os.environ["MATPLOTLIBRC"] = folder
        os.environ.pop("MPLBACKEND", None)  # the kernel's own, which keeps pictures
        made = nbformat.reads(json.dumps(content), as_version=4)  # which joins lines
        NotebookClient(made, timeout=1200, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    for cell, run in zip(code(content), code(made)):
        for output in run["outputs"]:
            if output["output_type"] == "stream" and output["name"] == "stdout":
                cell["outputs"].append({"name": "stdout", "output_type": "stream",
                                        "text": output["text"].splitlines(keepends=True)})
            elif "image/png" in output.get("data", {}):
                cell["outputs"].append({"data": {"image/png": small(output["data"]["image/png"])}, "metadata": {},
                                        "output_type": "display_data"})


def main():
    run, names = "--run" in sys.argv[1:], [name for name in sys.argv[1:] if name != "--run"]
    for path in SCRIPTS:
        if names and path.stem not in names:
            continue
        content = notebook(path.read_text(encoding="utf-8"))
        target = path.with_suffix(".ipynb")
        if run:
            execute(content)
        else:
            keep_outputs(content, target)
        target.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(target)


if __name__ == "__main__":
    main()
