#!/usr/bin/env python3
"""Draws docs/images/paper-kalman-error.svg from the paper.json of the tool. Needs Matplotlib; no test runs it.

    make build
    python3 docs/images/make_paper.py [TOOL]

TOOL is the tool (build/bin/tokid unless given).
"""
# SPDX-License-Identifier: BSD-3-Clause

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from make_result import MUTED, RULE, plain, plt, save

HERE = Path(__file__).resolve().parent
COLOURS = ["#0072b2", "#d05a00", "#008a63", "#8a4fb5"]  # the first of the pages


def figures(tool):
    """Name of each figure of `tokid paper` → its data."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([tool, "paper", "-o", folder], check=True, stdout=subprocess.DEVNULL)
        return {figure["id"]: figure for figure in json.loads((Path(folder) / "paper.json").read_text())["figures"]}


def draw(axes, panel):
    for series in panel["series"]:
        axes.plot(series["x"], series["y"], "--" if series["mark"] == "dashed" else "-", label=series["name"],
                  color=COLOURS[series["colour"]], lw=1.6)
    axes.set_xticks(sorted({x for series in panel["series"] for x in series["x"]}))
    axes.set_yscale("log" if panel["y_log"] else "linear")
    axes.set_xlabel(panel["x_label"], color=MUTED)
    axes.set_ylabel(panel["y_label"], color=MUTED)
    axes.grid(color=RULE, lw=0.6)
    axes.legend(frameon=False, labelcolor=MUTED, fontsize=9)
    plain(axes)


def main():
    tool = Path(sys.argv[1] if len(sys.argv) > 1 else HERE.parents[1] / "build/bin/tokid").resolve()
    plt.rcParams.update({"font.family": "sans-serif", "font.size": 9.5, "svg.fonttype": "none", "svg.hashsalt": "tokid"})
    figure, axes = plt.subplots(figsize=(6.4, 3.4), facecolor="white", layout="constrained")
    draw(axes, figures(tool)["kalman-error"]["panels"][0])
    save(figure, HERE / "paper-kalman-error.svg")


if __name__ == "__main__":
    main()
