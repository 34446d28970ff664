# SPDX-License-Identifier: BSD-3-Clause
"""The plots of the report page, with matplotlib.

Every function draws into `ax`, or into a new figure without it, and returns the Axes. The colours are those of the
report page. People with a colour vision deficiency can distinguish them. On dark Axes, they are the colours of the dark
page. The functions change no style, no rcParams and no current Axes.

Parameters that several functions share:

over : {"time", "step"}, default "time"
    Quantity on the horizontal axis: time [s] or step number.
initial_state : {"auto", "zero", "unknown"}, default "auto"
    States at step 0. Unknown states are estimated from the first samples.
ax : matplotlib.axes.Axes, optional
    Axes to draw into; by default those of a new figure.

>>> import tokid
>>> data = tokid.example("oscillator", experiments=60, steps=40, measurement_noise=0.01)
>>> model = tokid.identify(data, states=4, lags=2, smoothing=0.0, refine=False)
>>> tokid.plot.outputs(model, data).figure.savefig("outputs.png")
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _axes, _plot_data, _tokid
from ._axes import COLOURS, DARK_COLOURS, StepPlot
from ._ensemble import Ensemble
from ._model import Model
from ._optional import need
from ._options import integer
from ._samples import named
from ._typing import Array, ArrayLike
from .results import Validation

need("matplotlib", "tokid.plot", "tokid[plot]")

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    from matplotlib.axes import Axes  # type: ignore[import-not-found, unused-ignore]

    Data = Union[ArrayLike, Ensemble, pandas.DataFrame]

__all__ = [
    "COLOURS",
    "DARK_COLOURS",
    "condition",
    "errors",
    "gains",
    "inputs",
    "outputs",
    "pole_radius",
    "poles",
    "ranks",
    "singular_values",
    "state_matrix",
    "step_error",
    "whiteness",
]

_GREY = "#8c949e"  # of singular values that are rounding errors

# The same limits as on the report page
_MOST_SINGULAR_VALUES = 32
_MOST_STATES = 12


# ---- outputs, errors, inputs ----


def outputs(
    model: Model,
    u: Data,
    y: Optional[ArrayLike] = None,
    *,
    experiment: Optional[int] = None,
    output: Union[int, str] = 0,
    departures: bool = False,
    over: str = "time",
    initial_state: str = "auto",
    ax: Optional[Axes] = None,
) -> Axes:
    """Plot an output: measured, simulated, and predicted one step ahead.

    Parameters
    ----------
    model : Model
        The model.
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, or DataFrame
        Experiments.
    experiment : int, optional
        Row of the experiment; by default the one with the median error.
    output : int or str, default 0
        Number or name of the output.
    departures : bool, default False
        Show departures from the nominal trajectory. A large nominal trajectory can hide all errors.
    over, initial_state, ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> ax = tokid.plot.outputs(model, data, output="y2")
    >>> ax.get_ylabel()
    'y2'
    """
    found = _plot_data.output_curves(model, u, y, experiment, output, initial_state)
    plot = StepPlot(ax, over, found.dt, np.arange(len(found.measured)))
    shift: Any = found.nominal if departures and found.nominal is not None else 0.0
    few: dict[str, Any] = {"marker": ".", "markersize": 5} if len(found.measured) <= 100 else {}
    plot.line(found.measured - shift, "measured", 1.2, "Measured", **few)
    plot.line(found.simulated - shift, "blue", 1.8, "Simulated")
    plot.line(found.predicted - shift, "orange", 1.4, "One-step prediction", linestyle=_axes.DASHES[1])
    if found.nominal is not None and not departures:
        plot.line(found.nominal, "faint", 1.2, "Nominal", linestyle=_axes.DASHES[2])
    return plot.finish(found.name, found.title, legend=True)


def errors(
    model: Model,
    u: Data,
    y: Optional[ArrayLike] = None,
    *,
    experiment: Optional[int] = None,
    output: Union[int, str] = 0,
    over: str = "time",
    initial_state: str = "auto",
    ax: Optional[Axes] = None,
) -> Axes:
    """Plot the errors of the simulation and of the one-step prediction of an output.

    The parameters are those of `outputs`.

    Examples
    --------
    >>> ax = tokid.plot.errors(model, data, experiment=3)
    """
    found = _plot_data.output_curves(model, u, y, experiment, output, initial_state)
    plot = StepPlot(ax, over, found.dt, np.arange(len(found.measured)), height=2.6)
    plot.line(found.measured - found.simulated, "blue", 1.5, "Measured − simulated")
    plot.line(found.measured - found.predicted, "orange", 1.3, "Measured − predicted")
    return plot.finish(found.name, found.title, legend=True)


def inputs(
    model: Model,
    u: Data,
    *,
    experiment: int = 0,
    input: Union[int, str] = 0,
    departures: bool = False,
    over: str = "time",
    ax: Optional[Axes] = None,
) -> Axes:
    """Plot an input, constant between steps, and the nominal input.

    The parameters are those of `outputs`. The default experiment is the first one.

    Examples
    --------
    >>> ax = tokid.plot.inputs(model, data, experiment=3, input="u2")
    """
    core, _ = model._data(u, None)
    data = Ensemble._of(core)
    names, units = _plot_data.channel_names(model, data, "input")
    i = _plot_data.channel("input", input, names)
    n = integer("experiment", experiment, 0, data.experiments - 1)
    plot = StepPlot(ax, over, data.dt, np.arange(data.steps), height=2.6)
    nominal = _plot_data.nominal_trajectory(model, "u", data.steps, data.inputs)
    shift: Any = nominal[:, i] if departures and nominal is not None else 0.0
    plot.line(data.u[n, :, i] - shift, "green", 1.5, "Measured", drawstyle="steps-post")
    beside_nominal = nominal is not None and not departures
    if nominal is not None and beside_nominal:
        plot.line(nominal[:, i], "faint", 1.2, "Nominal", linestyle=_axes.DASHES[2])
    return plot.finish(named(names[i], units[i]), f"Experiment {data._core.experiment(n)}", legend=beside_nominal)


# ---- order ----


def singular_values(model: Model, *, over: str = "time", colorbar: bool = True, ax: Optional[Axes] = None) -> Axes:
    """Plot the singular values of the Hankel matrix of each step, and the state dimension.

    They measure the effect of the past on the future. Bright colours are large values, dark colours small ones, and
    grey are rounding errors. A sharp change of colour at the line shows the order clearly. At most the 32 largest
    values are drawn.

    Parameters
    ----------
    model : Model
        An identified model.
    colorbar : bool, default True
        Draw the scale beside the plot.
    over, ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If the model has no singular values, because tokid did not identify it.

    Examples
    --------
    >>> ax = tokid.plot.singular_values(model)
    """
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Patch
    from matplotlib.patheffects import Normal, Stroke

    sigma = model.singular_values
    rows = min(_MOST_SINGULAR_VALUES, max((len(values) for values in sigma), default=0))
    if rows == 0:
        raise ValueError("the model has no singular values, because tokid did not identify it")
    plot = StepPlot(ax, over, model.dt, _steps_of(model), height=min(4.4, 2.2 + 0.16 * rows))
    ax = plot.ax

    # If inputs move no state, all singular values are rounding errors. The scale is then the Markov parameter D.
    finite = [float(np.abs(matrix).max()) for matrix in (*model.D, *sigma) if matrix.size and np.isfinite(matrix).all()]
    scale = max(finite, default=0.0) or 1.0
    values = np.full((rows, model.steps), np.nan)
    for s, column in enumerate(sigma):
        count = min(rows, len(column))
        values[:count, s] = np.maximum(column[:count], 1e-17 * scale)
    known = values[np.isfinite(values)]
    sizes = known[known >= 1e-12 * scale]
    most = 10.0 ** math.ceil(math.log10(sizes.max())) if sizes.size else scale
    least = min(10.0 ** math.floor(math.log10(sizes.min())), most / 10) if sizes.size else most / 10
    least = max(least, 1e-12 * scale)  # smaller values are grey

    edges = plot.x(np.arange(model.k_begin, model.k_end + 1) - 0.5)
    ax.grid(False)
    mesh = ax.pcolormesh(
        edges,
        np.arange(rows + 1) + 0.5,
        np.ma.masked_invalid(values),
        norm=LogNorm(least, most),
        cmap=colormaps["viridis"].with_extremes(under=_GREY, bad=(0, 0, 0, 0)),
        rasterized=True,
    )
    line = ax.stairs(
        model.state_dim[:-1] + 0.5,
        edges,
        baseline=None,
        color=plot.colours["orange"],
        linewidth=2.0,
        label="Number of states",
    )
    line.set_path_effects([Stroke(linewidth=4.5, foreground=plot.colours["surface"]), Normal()])
    handles: list[Any] = [line]
    if sizes.size < known.size:
        handles.append(Patch(color=_GREY, label="Rounding errors"))
    ax.set_ylim(rows + 0.5, 0.5)
    _axes.whole_ticks(ax.yaxis)
    ax.legend(handles=handles, loc="lower right", framealpha=0.9, fontsize="small")
    if colorbar:
        ax.figure.colorbar(mesh, ax=ax, label="Size", pad=0.02)
    return plot.finish("Singular value")


# ---- regressions ----


def _steps_of(model: Model) -> Any:
    return np.arange(model.k_begin, model.k_end)


def _known(values: Any, what: str) -> Array:
    if not len(values):
        raise ValueError(f"the model has no {what}, because tokid did not identify it")
    return np.asarray(values, dtype=np.float64)


def condition(model: Model, *, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Plot the condition number of the regression of each step. It measures how strongly errors may be amplified.

    Parameters
    ----------
    model : Model
        An identified model.
    over, ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If the model has no condition numbers.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    values = _known(model.condition, "condition numbers")
    plot = StepPlot(ax, over, model.dt, _steps_of(model), height=2.6)
    values = np.where(values > 0, values, np.nan)
    plot.ax.set_yscale("log")
    if not np.nanmax(values, initial=0.0) > 1e3 * np.nanmin(values, initial=np.inf):  # decades alone are too few ticks
        plot.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        plot.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        plot.ax.yaxis.set_minor_formatter(NullFormatter())
    plot.line(values, "blue", 1.5, marker="." if len(values) <= 100 else None)
    return plot.finish("Condition number")


def ranks(model: Model, *, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Plot the rank of the regression of each step, its number of unknowns, the lag order and the state dimension.

    With full rank, the regression determines all unknowns of a step. The parameters are those of `condition`.
    """
    rank = _known(model.rank, "ranks")
    plot = StepPlot(ax, over, model.dt, _steps_of(model), height=2.6)
    states = model.state_dim[:-1]
    curves: list[tuple[str, Any, str, float, Any]] = [("Rank", rank, "blue", 1.6, "-")]
    if len(model.lags):
        window = model.lags * (model.inputs + model.outputs) if model.method in ("tvera", "regression") else states
        curves.insert(0, ("Unknowns", model.inputs + window, "faint", 4.0, "-"))
        curves.append(("Lag order", model.lags, "orange", 1.6, "-"))
    curves.append(("States", states, "green", 1.6, _axes.DASHES[1]))
    for label, values, colour, width, dash in curves:
        plot.line(values, colour, width, label, linestyle=dash, drawstyle="steps-post")
    plot.ax.set_ylim(bottom=0)
    _axes.whole_ticks(plot.ax.yaxis)
    return plot.finish("Number", legend=True, beside=len(curves))


def step_error(
    model: Model,
    u: Data,
    y: Optional[ArrayLike] = None,
    *,
    over: str = "time",
    initial_state: str = "auto",
    ax: Optional[Axes] = None,
) -> Axes:
    """Plot the RMS one-step error of each step over experiments and outputs, relative to the spread of the outputs.

    The parameters are those of `outputs`.
    """
    core, _ = model._data(u, y, outputs=True)
    data = Ensemble._of(core)
    predicted = model.predict(data, initial_state=initial_state)
    values = _plot_data.root_mean_square(_plot_data.relative_errors(model, data, predicted), (0, 2))
    plot = StepPlot(ax, over, data.dt, np.arange(data.steps), height=2.6)
    plot.line(values, "orange", 1.5, marker="." if len(values) <= 100 else None)
    plot.ax.set_ylim(bottom=0)
    return plot.finish("One-step error / spread")


# ---- eigenvalues and matrices ----


def poles(model: Model, *, k: Optional[int] = None, ax: Optional[Axes] = None) -> Axes:
    """Plot the eigenvalues of A (open loop) and of A + GC (with the observer) of all steps in the complex plane.

    They depend on the coordinates, which are those of the reference frame. If this frame does not reach half of the
    steps, they are those of the smooth frame. Eigenvalues alone do not decide the stability of a time-varying system.

    Parameters
    ----------
    model : Model
        The model.
    k : int, optional
        A step to highlight.
    ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If no step has eigenvalues, or step k has none.

    Examples
    --------
    >>> ax = tokid.plot.poles(model, k=20)
    """
    from matplotlib.patches import Circle

    steps, opened, closed = _plot_data.eigenvalues(model)
    if k is not None and integer("k", k, 0) not in steps:
        raise ValueError(f"k: {k} found, one of the steps with eigenvalues, {steps[0]} to {steps[-1]}, needed")
    ax = _axes.axes(ax, 5.0, 5.0)
    colours = _axes.colours(ax)
    every = np.concatenate([*opened, *closed])
    sizes = np.sort(np.abs(every))
    extent = min(4.0, max(1.12, 1.06 * float(sizes[min(len(sizes) - 1, math.floor(0.995 * len(sizes)))])))

    ax.axhline(0, color=colours["faint"], linewidth=0.8)
    ax.axvline(0, color=colours["faint"], linewidth=0.8)
    ax.add_patch(Circle((0, 0), 1, fill=False, edgecolor=colours["muted"], linewidth=1.3, label="_Unit circle"))
    alpha = min(0.55, max(0.12, 60 / len(steps))) if k is not None or len(steps) > 100 else 0.75
    for label, lists, colour, marker, size in (
        ("Open loop, A", opened, colours["orange"], "o", 4.5),
        ("With the observer, A + GC", closed, colours["blue"], "D", 4.0),
    ):
        values = np.concatenate(lists)
        every_step: dict[str, Any] = {"markersize": size, "markeredgewidth": 0, "color": colour, "alpha": alpha}
        shown = label if k is None else f"_{label}"
        ax.plot(values.real, values.imag, linestyle="none", marker=marker, label=shown, **every_step)
        if k is not None:
            values = lists[int(np.flatnonzero(steps == k)[0])]
            ax.plot(
                np.clip(values.real, -extent, extent),
                np.clip(values.imag, -extent, extent),
                linestyle="none",
                marker=marker,
                markersize=10 if marker == "o" else 9,
                markerfacecolor=(1, 1, 1, 0.4),
                markeredgecolor=colour,
                markeredgewidth=2.0,
                clip_on=False,
                zorder=2.5,  # above the other steps
                label=label,
            )
    if k is not None:
        ax.set_title(f"Step {k}, {k * model.dt:.4g} s", loc="left", fontsize="medium")
    outside = int(np.sum((np.abs(every.real) > extent) | (np.abs(every.imag) > extent)))
    if outside:
        ax.annotate(
            f"{outside} of {len(every)} outside, up to {sizes[-1]:.3g}",
            (0.02, 0.02),
            xycoords="axes fraction",
            fontsize="small",
            color=colours["muted"],
        )
    ax.set_xlim(-extent, extent)
    ax.set_ylim(-extent, extent)
    ax.set_aspect("equal")
    ax.set_xlabel("Real part")
    ax.set_ylabel("Imaginary part")
    ax.legend(loc="upper right", framealpha=0.8, fontsize="small")
    return ax


def pole_radius(model: Model, *, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Plot the largest magnitude of the eigenvalues of A and of A + GC over the steps.

    Parameters
    ----------
    model : Model
        The model.
    over, ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> ax = tokid.plot.pole_radius(model)
    """
    k, opened, closed = _plot_data.eigenvalues(model)
    plot = StepPlot(ax, over, model.dt, np.arange(k[0], k[-1] + 1))
    for label, lists, colour, dash in (
        ("Open loop", opened, "orange", "-"),
        ("With the observer", closed, "blue", _axes.DASHES[1]),
    ):
        values = np.full(len(plot.k), np.nan)
        values[k - k[0]] = [float(np.abs(found).max()) for found in lists]
        plot.line(values, colour, 1.6, label, linestyle=dash)
    plot.ax.axhline(1, color=plot.colours["faint"], linewidth=1.2, label="Unit circle")
    plot.ax.set_ylim(bottom=0)
    return plot.finish("Largest magnitude of the eigenvalues", legend=True)


def _entries(
    model: Model, name: str, begin: int, end: int, rows: Optional[Sequence[int]], over: str, ax: Any, label: str
) -> Axes:
    matrices = getattr(model, name)[begin - model.k_begin : end - model.k_begin]
    n, columns = model.states, model.outputs if name == "G" else model.states
    if not n:
        raise ValueError("the model has no states, and therefore neither gains nor A")
    chosen = range(min(n, _MOST_STATES)) if rows is None else [integer("rows", row, 0, n - 1) for row in rows]
    plot = StepPlot(ax, over, model.dt, np.arange(begin, end))
    drawn = [(i, j) for i in chosen for j in range(min(columns, _MOST_STATES))]
    for count, (i, j) in enumerate(drawn):
        values = [a[i, j] if i < a.shape[0] and j < a.shape[1] else np.nan for a in matrices]
        colour, dash = _axes.style(count)
        plot.line(values, colour, 1.4, f"{name}({i + 1},{j + 1})", linestyle=dash)
    return plot.finish(label, legend=True, beside=len(drawn))


def gains(model: Model, *, rows: Optional[Sequence[int]] = None, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Plot the entries of the observer gain G over the steps.

    The frame is that of `poles`. The curves of a system that varies smoothly should be smooth; scatter is noise.

    Parameters
    ----------
    model : Model
        The model.
    rows : sequence of int, optional
        Rows of G to draw, from 0; by default the first 12.
    over, ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> ax = tokid.plot.gains(model, rows=[0])
    >>> [line.get_label() for line in ax.lines]
    ['G(1,1)', 'G(1,2)']
    """
    frame = _plot_data.pole_frame(model)
    return _entries(frame.model, "G", frame.begin, frame.end, rows, over, ax, "Observer gain G")


def state_matrix(
    model: Model, *, rows: Optional[Sequence[int]] = None, over: str = "time", ax: Optional[Axes] = None
) -> Axes:
    """Plot the entries of A over the steps in the smooth frame. The parameters are those of `gains`."""
    smooth = model if model.frame_name == "smooth" or not model.states else model.frame("smooth")
    return _entries(smooth, "A", model.k_begin, model.k_end, rows, over, ax, "A, smooth frame")


# ---- whiteness ----


def whiteness(
    model: Union[Model, Validation],
    u: Optional[Data] = None,
    y: Optional[ArrayLike] = None,
    *,
    lags: int = _tokid.test_lags,
    initial_state: str = "auto",
    ax: Optional[Axes] = None,
) -> Axes:
    """Plot the correlation of the innovations of each output with those of earlier steps, and its 99 % bound.

    The innovations of a correct observer are not correlated.

    Parameters
    ----------
    model : Model or Validation
        The model, or a result of `Model.validate`.
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, or DataFrame
        Experiments, for a model.
    lags : int, default 5
        Number of lags to test.
    initial_state, ax
        As described for `tokid.plot`.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        If whiteness was not tested, because there are too few samples or the innovations are rounding errors.

    Examples
    --------
    >>> ax = tokid.plot.whiteness(model, data)
    """
    names: Optional[list[str]] = None
    if isinstance(model, Validation):
        if u is not None or y is not None:
            raise ValueError("u, y: found beside a Validation, which already has its data")
        validation = model
    else:
        if u is None:
            raise ValueError("u: none found, experiments needed beside a model")
        core, _ = model._data(u, y, outputs=True)
        names = _plot_data.channel_names(model, Ensemble._of(core), "output")[0]
        validation = model.validate(
            Ensemble._of(core), whiteness_lags=integer("lags", lags, 1), initial_state=initial_state
        )
    white = validation.whiteness
    if math.isnan(white.p) or not len(white.correlation):
        raise ValueError(f"whiteness: {validation.conclusions['whiteness'].text}")
    ax = _axes.axes(ax, height=3.0)
    colours = _axes.colours(ax)
    correlation, x = white.correlation, np.arange(1, len(white.bound) + 1)
    drawn = min(correlation.shape[1], _MOST_STATES)
    ax.axhline(0, color=colours["faint"], linewidth=0.8)
    for sign, label in ((1, "99 % bound"), (-1, "_")):
        ax.plot(x, sign * white.bound, color=colours["faint"], linestyle=_axes.DASHES[1], linewidth=1.3, label=label)
    for j in range(drawn):
        colour, dash = _axes.style(j)
        label = names[j] if names else f"y{j + 1}"
        values = correlation[:, j]
        ax.plot(x, values, color=colours[colour], linestyle=dash, linewidth=1.4, marker="o", markersize=5, label=label)
    most = 1.15 * max(0.02, float(np.nanmax(np.abs(correlation))), float(np.nanmax(white.bound)))
    ax.set_xlim(0.5, len(x) + 0.5)
    ax.set_ylim(-most, most)
    _axes.whole_ticks(ax.xaxis)
    ax.set_xlabel("Lag [steps]")
    ax.set_ylabel("Correlation")
    probability = "p < 0.0001" if white.p < 1e-4 else f"p = {white.p:.3g}"
    ax.set_title(f"Whiteness of the innovations, {probability}", loc="left", fontsize="medium")
    _axes.draw_legend(ax, drawn + 1 if correlation.shape[1] > 4 else 0)
    return ax
