# SPDX-License-Identifier: BSD-3-Clause
"""The look of axes, lines and legends of plots."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Optional

import numpy as np

from ._options import choice
from ._typing import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes  # type: ignore[import-not-found, unused-ignore]

# The colours of src/report/assets/page.css, of the light and the dark page
_BOTH = {
    "surface": ("#ffffff", "#191f27"),
    "measured": ("#333d49", "#d5dce5"),
    "blue": ("#0072b2", "#56b4e9"),
    "orange": ("#d05a00", "#f5964b"),
    "green": ("#008a63", "#3fc79a"),
    "purple": ("#8a4fb5", "#c29be6"),
    "pink": ("#c0568f", "#ec94c0"),
    "sky": ("#2f9bd6", "#9ad7f7"),
    "yellow": ("#a98600", "#ead35b"),
    "faint": ("#88939f", "#697686"),
    "muted": ("#56616f", "#9fabba"),
}
COLOURS = {name: light for name, (light, _) in _BOTH.items()}
DARK_COLOURS = {name: dark for name, (_, dark) in _BOTH.items()}
PALETTE = ("blue", "orange", "green", "purple", "pink", "sky", "yellow", "measured")
DASHES: tuple[Any, ...] = ("-", (0, (5, 3)), (0, (1.5, 2)), (0, (7, 2.5, 1.5, 2.5)))


def axes(ax: Optional[Axes], width: float = 7.0, height: float = 3.4) -> Any:
    """The given Axes, or those of a new figure, with a grid."""
    if ax is None:
        from matplotlib import pyplot

        _, ax = pyplot.subplots(figsize=(width, height), layout="constrained")
    ax.grid(True, color=colours(ax)["faint"], alpha=0.25, linewidth=0.8)
    ax.set_axisbelow(True)
    return ax


def colours(ax: Any) -> dict[str, str]:
    """The colours for the light or dark background of the Axes."""
    from matplotlib.colors import to_rgba

    red, green, blue, alpha = to_rgba(ax.get_facecolor())
    if alpha < 0.5 and ax.figure is not None:
        red, green, blue, alpha = to_rgba(ax.figure.get_facecolor())
    dark = alpha >= 0.5 and 0.299 * red + 0.587 * green + 0.114 * blue < 0.5
    return DARK_COLOURS if dark else COLOURS


def whole_ticks(axis: Any) -> None:
    """Draw ticks only at whole numbers."""
    axis.get_major_locator().set_params(integer=True)


def draw_legend(ax: Any, beside: int = 0) -> None:
    """Draw the legend in the plot; with a number of entries `beside`, beside the plot, where it covers no curve."""
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


class StepPlot:
    """Axes with the steps `k` on the horizontal axis, by their time [s] or their number."""

    def __init__(self, ax: Optional[Axes], over: str, dt: float, k: Any, height: float = 3.4) -> None:
        self._unit = choice("over", over, {"time": dt, "step": 1.0})
        self._over = over
        self.k = k
        self.ax = axes(ax, height=height)
        self.colours = colours(self.ax)

    def x(self, steps: Any) -> Array:
        """The places of steps on the horizontal axis."""
        return np.asarray(steps, dtype=np.float64) * self._unit

    def line(self, values: Any, colour: str, width: float, label: Optional[str] = None, **options: Any) -> None:
        """Draw a value for each step. Single samples between gaps get a marker, because a line does not show them."""
        numbers = np.asarray(values, dtype=np.float64)
        known = np.isfinite(numbers)
        before, after = np.append(False, known[:-1]), np.append(known[1:], False)
        lone = [int(i) for i in np.flatnonzero(known & ~before & ~after)]
        if lone and "marker" not in options:
            options.update(marker=".", markevery=lone)
        self.ax.plot(self.x(self.k), numbers, color=self.colours[colour], linewidth=width, label=label, **options)

    def finish(self, ylabel: str, title: str = "", legend: bool = False, beside: int = 0) -> Axes:
        """Add the labels, the title, and a legend as in `draw_legend`, and return the Axes."""
        self.ax.set_ylabel(ylabel)
        if title:
            self.ax.set_title(title, loc="left", fontsize="medium")
        self.ax.set_xlabel("Time [s]" if self._over == "time" else "Step")
        if self._over == "step":
            whole_ticks(self.ax.xaxis)
        if legend:
            draw_legend(self.ax, beside)
        drawn: Axes = self.ax
        return drawn


def style(count: int) -> tuple[str, Any]:
    """The colour and the dash of a curve by its number. They repeat only after all combinations."""
    return PALETTE[count % len(PALETTE)], DASHES[count // len(PALETTE) % len(DASHES)]
