# SPDX-License-Identifier: BSD-3-Clause
"""How axes, lines and legends of plots look."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Optional

import numpy as np

from ._options import choice
from ._typing import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes  # type: ignore[import-not-found, unused-ignore]

# Those of src/report/assets/chart_colours.css
COLOURS = {
    "surface": "#ffffff",
    "measured": "#333d49",
    "blue": "#0072b2",
    "orange": "#d05a00",
    "green": "#008a63",
    "purple": "#8a4fb5",
    "pink": "#c0568f",
    "sky": "#2f9bd6",
    "yellow": "#a98600",
    "faint": "#88939f",
    "muted": "#56616f",
}
DARK_COLOURS = {
    "surface": "#191f27",
    "measured": "#d5dce5",
    "blue": "#56b4e9",
    "orange": "#f5964b",
    "green": "#3fc79a",
    "purple": "#c29be6",
    "pink": "#ec94c0",
    "sky": "#9ad7f7",
    "yellow": "#ead35b",
    "faint": "#697686",
    "muted": "#9fabba",
}
PALETTE = ("blue", "orange", "green", "purple", "pink", "sky", "yellow", "measured")
DASHES: tuple[Any, ...] = ("-", (0, (5, 3)), (0, (1.5, 2)), (0, (7, 2.5, 1.5, 2.5)))


def axes(ax: Optional[Axes], width: float = 7.0, height: float = 3.4) -> Any:
    """Those given, or of a new figure, with a grid."""
    if ax is None:
        from matplotlib import pyplot

        _, ax = pyplot.subplots(figsize=(width, height), layout="constrained")
    ax.grid(True, color=colours(ax)["faint"], alpha=0.25, linewidth=0.8)
    ax.set_axisbelow(True)
    return ax


def colours(ax: Any) -> dict[str, str]:
    """Those for a light or for a dark background."""
    from matplotlib.colors import to_rgba

    red, green, blue, alpha = to_rgba(ax.get_facecolor())
    if alpha < 0.5 and ax.figure is not None:
        red, green, blue, alpha = to_rgba(ax.figure.get_facecolor())
    dark = alpha >= 0.5 and 0.299 * red + 0.587 * green + 0.114 * blue < 0.5
    return DARK_COLOURS if dark else COLOURS


def named(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


class Steps:
    """Steps on the horizontal axis, by their time or by their number."""

    def __init__(self, over: str, dt: float) -> None:
        self._unit = choice("over", over, {"time": dt, "step": 1.0})
        self.label = "Time [s]" if over == "time" else "Step"

    def __call__(self, steps: Any) -> Array:
        return np.asarray(steps, dtype=np.float64) * self._unit

    def finish(self, ax: Any, steps: Any) -> None:
        ax.set_xlabel(self.label)
        if self.label == "Step":
            whole_ticks(ax.xaxis)


def whole_ticks(axis: Any) -> None:
    """Ticks at whole numbers alone."""
    axis.get_major_locator().set_params(integer=True)


def legend(ax: Any, beside: int = 0) -> None:
    """In the plot, or beside it where so many entries would cover curves."""
    if beside:
        ax.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            frameon=False,
            fontsize="small",
            ncols=math.ceil(beside / 12),
            columnspacing=1.0,
            handlelength=1.6,
            borderaxespad=0.2,
        )
    else:
        ax.legend(loc="best", framealpha=0.8, fontsize="small")


def _lone(values: Array) -> list[int]:
    """Lone samples between gaps, which would vanish from a line."""
    known = np.isfinite(values)
    before, after = np.append(False, known[:-1]), np.append(known[1:], False)
    return [int(i) for i in np.flatnonzero(known & ~before & ~after)]


def line(ax: Any, x: Array, values: Array, **options: Any) -> None:
    lone = _lone(values)
    if lone and "marker" not in options:
        options.update(marker=".", markevery=lone)
    ax.plot(x, values, **options)
