#!/usr/bin/env python3
"""Draws docs/images/result.svg from what the tool computes. Needs NumPy and Matplotlib; no test runs it.

    make build
    python3 docs/images/make_result.py [TOOL] [OUT]

TOOL is the tool (build/bin/tokid unless given), OUT the picture (result.svg beside this script; .png works too).
"""
# SPDX-License-Identifier: BSD-3-Clause

import io
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

INK, MUTED, RULE = "#24292f", "#6b7280", "#d5d9de"
OPEN, CLOSED = "#c2703d", "#1f5a94"
PUBLISHED = {34: (0.43716, -0.048167), 35: (0.31545, -0.097074), 36: (-0.14861, 0.048661)}  # (79)-(81)


def run(tool, directory):
    """The model that ten experiments and eight free responses give, fresh experiments, and its outputs for them."""
    def call(*arguments):
        subprocess.run([tool, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)

    data, model, fresh, simulated = (directory / f"{name}.npz" for name in ("data", "model", "fresh", "simulated"))
    call("example", "oscillator", "-o", data, "--experiments", 10, "--steps", 80, "--free-responses", 8)
    call("identify", data, "-o", model, "--lags", 2, "--states", 4)
    call("example", "oscillator", "-o", fresh, "--experiments", 10, "--steps", 80, "--seed", 2)
    call("simulate", model, fresh, "-o", simulated)
    return dict(np.load(model)), dict(np.load(fresh)), dict(np.load(simulated))


def in_reference_frame(model, rows):
    """A_k and A_k + G_k C_k of the steps that the frame of step 0 with so many block rows covers."""
    a, c, g = model["A"], model["C"], model["G"]

    def observability(k):
        blocks, transition = [], np.eye(a.shape[2])
        for j in range(k, k + rows):
            blocks.append(c[j] @ transition)
            transition = a[j] @ transition
        return np.vstack(blocks)

    projection = np.linalg.pinv(observability(0))
    # The last steps have fewer states: every step that the observability matrices use must have all of them.
    last = int(np.flatnonzero(model["state_dim"] == a.shape[2])[-1]) - rows + 1
    s = [projection @ observability(k) for k in range(last + 1)]
    open_loop = np.array([s[k + 1] @ a[k] @ np.linalg.inv(s[k]) for k in range(last)])
    closed_loop = np.array([s[k + 1] @ (a[k] + g[k] @ c[k]) @ np.linalg.inv(s[k]) for k in range(last)])
    return open_loop, closed_loop


def check(closed_loop):
    for k, published in PUBLISHED.items():
        values = np.linalg.eigvals(closed_loop[k])
        values = values[np.argsort(-abs(values))][:2].real
        assert np.allclose(values, published, rtol=2e-5), (k, values, published)


def plain(axes):
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(RULE)
    axes.tick_params(color=RULE, labelcolor=MUTED, labelsize=8.5, length=3)


def title(axes, text, note):
    axes.set_title(text, loc="left", fontsize=11, color=INK, fontweight="bold", pad=21)
    axes.annotate(note, (0, 1), xycoords="axes fraction", xytext=(0, 6), textcoords="offset points", fontsize=8.5,
                  color=MUTED)


def draw_plane(axes, open_loop, closed_loop):
    outer = np.linalg.eigvals(open_loop).ravel()
    inner = np.linalg.eigvals(closed_loop).ravel()
    angle = np.linspace(0, 2 * np.pi, 181)
    axes.axhline(0, color=RULE, lw=0.7, zorder=0)
    axes.axvline(0, color=RULE, lw=0.7, zorder=0)
    axes.plot(np.cos(angle), np.sin(angle), color=MUTED, lw=0.9, zorder=1)
    axes.plot(outer.real, outer.imag, "o", ms=3.0, mfc="none", mec=OPEN, mew=0.5, alpha=0.8)
    axes.plot(inner.real, inner.imag, "o", ms=3.0, mfc="none", mec=CLOSED, mew=0.5, alpha=0.8)
    axes.set_aspect("equal")
    axes.set_xlim(-1.15, 1.6)
    axes.set_ylim(-1.15, 1.15)
    axes.set_xticks([-1, 0, 1])
    axes.set_yticks([-1, 0, 1])
    axes.text(1.13, 0.23, "open loop\n$A_k$", color=OPEN, fontsize=9.5, ha="left")
    axes.text(0.12, 0.12, "closed loop\n$A_k + G_k C_k$", color=CLOSED, fontsize=9.5, ha="center")
    axes.text(-0.66, -0.66, "unit circle", color=MUTED, fontsize=8.5, ha="left", va="bottom")
    plain(axes)


def draw_closed_loop(axes, closed_loop, first):
    steps = np.arange(first, len(closed_loop))
    values = np.linalg.eigvals(closed_loop[first:])
    assert np.abs(values.imag).max() < 1e-6
    # Two of the four are zero at every step.
    largest = np.take_along_axis(values.real, np.argsort(-abs(values), axis=1), axis=1)[:, :2]
    largest.sort(axis=1)
    axes.axhline(0, color=CLOSED, lw=1.1, zorder=1)
    axes.vlines(steps, largest[:, 0], largest[:, 1], color=RULE, lw=0.8, zorder=0)
    axes.plot(steps, largest, "o", ms=2.6, color=CLOSED, mec="none")
    for k, published in PUBLISHED.items():
        axes.plot([k, k], published, "o", ms=7, mfc="none", mec=OPEN, mew=1.1)
    axes.annotate("published", (34, 0.43716), xytext=(8, 4), textcoords="offset points", color=OPEN, fontsize=9.5)
    axes.text(80.5, 0, "two at 0", color=CLOSED, fontsize=8.5, va="center")
    axes.set_ylim(-0.25, 0.53)
    axes.set_yticks([-0.2, 0, 0.2, 0.4])
    plain(axes)


def draw_outputs(axes, fresh, simulated):
    k = np.arange(fresh["y"].shape[1])
    axes.axhline(0, color=RULE, lw=0.7, zorder=0)
    for j, end in ((0, "$y_1$"), (1, "$y_2$")):
        measured, computed = fresh["y"][0, :, j], simulated["y"][0, :, j]
        axes.plot(k, measured, "o", ms=4.2, mfc="none", mec=OPEN, mew=0.8)
        axes.plot(k, computed, color=CLOSED, lw=1.2)
        axes.annotate(end, (k[-1], computed[-1]), xytext=(8, 0), textcoords="offset points", color=INK, fontsize=10,
                      va="center")
    axes.set_xlabel("step $k$", fontsize=9, color=MUTED)
    plain(axes)


def compact(svg):
    """The same picture in less text: coordinates to a twentieth of a point, repeated styles as classes."""
    def shorten(attribute):
        return re.sub(r"\d+\.\d{2,}", lambda number: f"{float(number[0]):.1f}", attribute[0])

    svg = re.sub(r' (?:x|y|d)="[^"]*"', shorten, svg)
    styles = {}
    svg = re.sub(r'(<use [^>]*)style="([^"]*)"',
                 lambda use: f'{use[1]}class="{styles.setdefault(use[2], f"s{len(styles)}")}"', svg)
    rules = "\n".join(f".{name} {{ {style} }}" for style, name in styles.items())
    svg = svg.replace("<defs>", f"<defs>\n<style>\n{rules}\n</style>", 1)
    return re.sub(r"\n +", "\n", svg)


def save(figure, out):
    if out.suffix == ".svg":
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        out.write_text(compact(text.getvalue()))
    else:
        figure.savefig(out, dpi=160)


def main():
    here = Path(__file__).resolve().parent
    tool = sys.argv[1] if len(sys.argv) > 1 else here.parents[1] / "build/bin/tokid"
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else here / "result.svg"
    with tempfile.TemporaryDirectory() as directory:
        model, fresh, simulated = run(Path(tool).resolve(), Path(directory))
    open_loop, closed_loop = in_reference_frame(model, rows=3)
    check(closed_loop)
    error = np.abs(fresh["y"] - simulated["y"]).max()
    first = 4  # the observer settles within the first 2p steps

    plt.rcParams.update({"font.family": "DejaVu Sans", "mathtext.fontset": "dejavusans", "svg.hashsalt": "tokid"})
    figure = plt.figure(figsize=(9.6, 4.55), facecolor="white")
    grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.18], left=0.04, right=0.93, top=0.878, bottom=0.105,
                               wspace=0.15, hspace=0.55)
    left, top, bottom = (figure.add_subplot(grid[cell]) for cell in ((slice(None), 0), (0, 1), (1, 1)))
    draw_plane(left, open_loop[first:], closed_loop[first:])
    left.set_anchor("N")
    title(left, "Eigenvalues, from ten experiments",
          f"steps {first} to {len(open_loop) - 1}, reference frame of step 0")
    draw_closed_loop(top, closed_loop, first)
    title(top, "Closed loop over time", "eigenvalues of $A_k + G_k C_k$, all real")
    draw_outputs(bottom, fresh, simulated)
    title(bottom, "Outputs for inputs never seen", "circles: experiment; lines: simulation; "
          f"largest difference ${error:.0e}".replace("e-", r" \cdot 10^{-") + "}$")
    for axes in (top, bottom):
        axes.set_xticks(range(0, 81, 20))
        axes.set_xlim(-1, 80)
    save(figure, out)


if __name__ == "__main__":
    main()
