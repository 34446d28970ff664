# SPDX-License-Identifier: BSD-3-Clause
"""The pictures of the report page with matplotlib.

Every function draws into `ax`, or into a new figure where none is given, and returns the Axes. The colours are those of
the page, which people with a colour vision deficiency can tell apart; on dark Axes those of its dark form. Nothing that
belongs to others is changed: no style, no rcParams, no current Axes of another figure.

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
from ._axes import COLOURS, DARK_COLOURS
from ._ensemble import Ensemble
from ._model import Model
from ._optional import need
from ._options import integer
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

_GREY = "#8c949e"  # singular values that are rounding errors

# As many as on the page
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
    """An output: measured, simulated from the inputs alone, and predicted one step ahead.

    Parameters
    ----------
    model : Model
        The model.
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, or DataFrame
        Experiments.
    experiment : int, optional
        Row of the experiment; by default that of the median error.
    output : int or str, default 0
        The output, by its number or its name.
    departures : bool, default False
        Show departures from the nominal trajectory, which may be so large that it hides every error.
    over : {"time", "step"}, default "time"
        What the horizontal axis shows.
    initial_state : {"auto", "zero", "unknown"}, default "auto"
        States at step 0; unknown ones are estimated from the first samples.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> ax = tokid.plot.outputs(model, data, output="y2")
    >>> ax.get_ylabel()
    'y2'
    """
    found = _plot_data.outcome(model, u, y, initial_state)
    data = found.data
    names, units = _plot_data.channel_names(model, data, "output")
    j = _plot_data.channel("output", output, names)
    n, label = _plot_data.chosen_experiment(model, found, experiment)
    steps, ax = _axes.Steps(over, data.dt), _axes.axes(ax)
    colours = _axes.colours(ax)
    k = np.arange(data.steps)
    x = steps(k)
    nominal = _plot_data.nominal_trajectory(model, "y", data.steps, data.outputs)
    less: Any = nominal[:, j] if departures and nominal is not None else 0.0
    few: dict[str, Any] = {"marker": ".", "markersize": 5} if data.steps <= 100 else {}
    _axes.line(ax, x, data.y[n, :, j] - less, label="Measured", color=colours["measured"], linewidth=1.2, **few)
    _axes.line(ax, x, found.simulated[n, :, j] - less, label="Simulated", color=colours["blue"], linewidth=1.8)
    _axes.line(
        ax,
        x,
        found.predicted[n, :, j] - less,
        label="One-step prediction",
        color=colours["orange"],
        linewidth=1.4,
        linestyle=_axes.DASHES[1],
    )
    if nominal is not None and not departures:
        grey = {"color": colours["faint"], "linewidth": 1.2, "linestyle": _axes.DASHES[2]}
        _axes.line(ax, x, nominal[:, j], label="Nominal", **grey)
    ax.set_ylabel(_axes.named(names[j], units[j]))
    ax.set_title(label, loc="left", fontsize="medium")
    steps.finish(ax, k)
    _axes.legend(ax)
    return ax


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
    """What simulation and one-step prediction leave of an output.

    The parameters are those of `outputs`.

    Examples
    --------
    >>> ax = tokid.plot.errors(model, data, experiment=3)
    """
    found = _plot_data.outcome(model, u, y, initial_state)
    data = found.data
    names, units = _plot_data.channel_names(model, data, "output")
    j = _plot_data.channel("output", output, names)
    n, label = _plot_data.chosen_experiment(model, found, experiment)
    steps, ax = _axes.Steps(over, data.dt), _axes.axes(ax, height=2.6)
    colours = _axes.colours(ax)
    k = np.arange(data.steps)
    measured = data.y[n, :, j]
    simulated, predicted = measured - found.simulated[n, :, j], measured - found.predicted[n, :, j]
    _axes.line(ax, steps(k), simulated, label="Measured − simulated", color=colours["blue"], linewidth=1.5)
    _axes.line(ax, steps(k), predicted, label="Measured − predicted", color=colours["orange"], linewidth=1.3)
    ax.set_ylabel(_axes.named(names[j], units[j]))
    ax.set_title(label, loc="left", fontsize="medium")
    steps.finish(ax, k)
    _axes.legend(ax)
    return ax


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
    """An input, held from step to step, beside the nominal one.

    The parameters are those of `outputs`, but for the experiment, which is the first one by default.

    Examples
    --------
    >>> ax = tokid.plot.inputs(model, data, experiment=3, input="u2")
    """
    core, _ = model._data(u, None)
    data = Ensemble._of(core)
    names, units = _plot_data.channel_names(model, data, "input")
    i = _plot_data.channel("input", input, names)
    n = integer("experiment", experiment, 0, data.experiments - 1)
    steps, ax = _axes.Steps(over, data.dt), _axes.axes(ax, height=2.6)
    colours = _axes.colours(ax)
    k = np.arange(data.steps)
    nominal = _plot_data.nominal_trajectory(model, "u", data.steps, data.inputs)
    less: Any = nominal[:, i] if departures and nominal is not None else 0.0
    _axes.line(
        ax,
        steps(k),
        data.u[n, :, i] - less,
        label="Measured",
        color=colours["green"],
        linewidth=1.5,
        drawstyle="steps-post",
    )
    if nominal is not None and not departures:
        grey = {"color": colours["faint"], "linewidth": 1.2, "linestyle": _axes.DASHES[2]}
        _axes.line(ax, steps(k), nominal[:, i], label="Nominal", **grey)
        _axes.legend(ax)
    ax.set_ylabel(_axes.named(names[i], units[i]))
    ax.set_title(f"Experiment {data._core.experiment(n)}", loc="left", fontsize="medium")
    steps.finish(ax, k)
    return ax


# ---- order ----


def singular_values(model: Model, *, over: str = "time", colorbar: bool = True, ax: Optional[Axes] = None) -> Axes:
    """Singular values of the Hankel matrix of each step, with the number of states in use.

    They say what the past can do to the future: dark is small, bright is large, grey no more than rounding errors. A
    fall of brightness across the line says that the order is clear. Of more than 32 the largest 32 are drawn.

    Parameters
    ----------
    model : Model
        An identified model.
    over : {"time", "step"}, default "time"
        What the horizontal axis shows.
    colorbar : bool, default True
        Draw the scale beside the plot.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        Where the model carries no singular values: it was not identified by tokid.

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
        raise ValueError("the model carries no singular values: it was not identified by tokid")
    steps, ax = _axes.Steps(over, model.dt), _axes.axes(ax, height=min(4.4, 2.2 + 0.16 * rows))
    colours = _axes.colours(ax)

    # Where nothing moves, all singular values are rounding errors of D, which is a Markov parameter as they are.
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
    least = max(least, 1e-12 * scale)  # beneath it is grey

    edges = steps(np.arange(model.k_begin, model.k_end + 1) - 0.5)
    colour_map = colormaps["viridis"].with_extremes(under=_GREY, bad=(0, 0, 0, 0))
    ax.grid(False)
    mesh = ax.pcolormesh(
        edges,
        np.arange(rows + 1) + 0.5,
        np.ma.masked_invalid(values),
        norm=LogNorm(least, most),
        cmap=colour_map,
        rasterized=True,
    )
    line = ax.stairs(
        model.state_dim[:-1] + 0.5,
        edges,
        baseline=None,
        color=colours["orange"],
        linewidth=2.0,
        label="Number of states",
    )
    line.set_path_effects([Stroke(linewidth=4.5, foreground=colours["surface"]), Normal()])
    handles: list[Any] = [line]
    if sizes.size < known.size:
        handles.append(Patch(color=_GREY, label="Rounding errors"))
    ax.set_ylim(rows + 0.5, 0.5)
    _axes.whole_ticks(ax.yaxis)
    ax.set_ylabel("Singular value")
    steps.finish(ax, None)
    ax.legend(handles=handles, loc="lower right", framealpha=0.9, fontsize="small")
    if colorbar:
        ax.figure.colorbar(mesh, ax=ax, label="Size", pad=0.02)
    return ax


# ---- regressions ----


def _per_step(model: Model, values: Any, what: str) -> tuple[Any, Array]:
    if not len(values):
        raise ValueError(f"the model carries no {what}: it was not identified by tokid")
    return np.arange(model.k_begin, model.k_end), np.asarray(values, dtype=np.float64)


def condition(model: Model, *, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Condition number of the regression of each step: how much noise and rounding errors may be magnified.

    Parameters
    ----------
    model : Model
        An identified model.
    over : {"time", "step"}, default "time"
        What the horizontal axis shows.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        Where the model carries none.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    k, values = _per_step(model, model.condition, "condition numbers")
    steps, ax = _axes.Steps(over, model.dt), _axes.axes(ax, height=2.6)
    values = np.where(values > 0, values, np.nan)
    ax.set_yscale("log")
    if not np.nanmax(values, initial=0.0) > 1e3 * np.nanmin(values, initial=np.inf):  # decades alone would be too few
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.yaxis.set_minor_formatter(NullFormatter())
    marker = "." if len(k) <= 100 else None
    _axes.line(ax, steps(k), values, color=_axes.colours(ax)["blue"], linewidth=1.5, marker=marker)
    ax.set_ylabel("Condition number")
    steps.finish(ax, k)
    return ax


def ranks(model: Model, *, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Rank of the regression of each step beside the number of its unknowns, the lag order and the number of states.

    Full rank says that all unknowns of a step could be told apart. The parameters are those of `condition`.
    """
    k, rank = _per_step(model, model.rank, "ranks")
    steps, ax = _axes.Steps(over, model.dt), _axes.axes(ax, height=2.6)
    colours = _axes.colours(ax)
    states = model.state_dim[:-1]
    curves: list[tuple[str, Any, str, float, Any]] = [("Rank", rank, "blue", 1.6, "-")]
    if len(model.lags):
        window = model.lags * (model.inputs + model.outputs) if model.method == "tvera" else states
        curves.insert(0, ("Unknowns", model.inputs + window, "faint", 4.0, "-"))
        curves.append(("Lag order", model.lags, "orange", 1.6, "-"))
    curves.append(("States", states, "green", 1.6, _axes.DASHES[1]))
    for label, values, colour, width, dash in curves:
        _axes.line(
            ax,
            steps(k),
            np.asarray(values, dtype=np.float64),
            label=label,
            color=colours[colour],
            linewidth=width,
            linestyle=dash,
            drawstyle="steps-post",
        )
    ax.set_ylim(bottom=0)
    _axes.whole_ticks(ax.yaxis)
    ax.set_ylabel("Number")
    steps.finish(ax, k)
    _axes.legend(ax, len(curves))
    return ax


def step_error(
    model: Model,
    u: Data,
    y: Optional[ArrayLike] = None,
    *,
    over: str = "time",
    initial_state: str = "auto",
    ax: Optional[Axes] = None,
) -> Axes:
    """One-step error of each step over the spread of the outputs: root mean square over experiments and outputs.

    The parameters are those of `outputs`.
    """
    core, _ = model._data(u, y, outputs=True)
    data = Ensemble._of(core)
    predicted = model.predict(data, initial_state=initial_state)
    values = _plot_data.root_mean_square(_plot_data.relative_errors(model, data, predicted), (0, 2))
    steps, ax = _axes.Steps(over, data.dt), _axes.axes(ax, height=2.6)
    k = np.arange(data.steps)
    marker = "." if len(k) <= 100 else None
    _axes.line(ax, steps(k), values, color=_axes.colours(ax)["orange"], linewidth=1.5, marker=marker)
    ax.set_ylim(bottom=0)
    ax.set_ylabel("One-step error / spread")
    steps.finish(ax, k)
    return ax


# ---- eigenvalues and matrices ----


def poles(model: Model, *, k: Optional[int] = None, ax: Optional[Axes] = None) -> Axes:
    """Eigenvalues of A (open loop) and of A + GC (with the observer) of all steps in the complex plane.

    They need coordinates: those of the reference frame, or of the smooth one where it does not reach far enough. In a
    time varying system they do not decide stability by themselves.

    Parameters
    ----------
    model : Model
        The model.
    k : int, optional
        A step whose eigenvalues are strong; all others are faint.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        Where no step has eigenvalues, or k is not one that has them.

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
    alpha = min(0.55, max(0.12, 60 / len(steps)))
    kinds = (("Open loop, A", opened, "orange", "o"), ("With the observer, A + GC", closed, "blue", "D"))
    for label, lists, colour, marker in kinds:
        values = np.concatenate(lists)
        ax.plot(
            values.real,
            values.imag,
            linestyle="none",
            marker=marker,
            markersize=4.5 if marker == "o" else 4.0,
            markeredgewidth=0,
            color=colours[colour],
            alpha=alpha if k is not None or len(steps) > 100 else 0.75,
            label=label if k is None else f"_{label}",
        )
    if k is not None:
        at = int(np.flatnonzero(steps == k)[0])
        for label, lists, colour, marker in kinds:
            values = lists[at]
            ax.plot(
                np.clip(values.real, -extent, extent),
                np.clip(values.imag, -extent, extent),
                linestyle="none",
                marker=marker,
                markersize=10 if marker == "o" else 9,
                markerfacecolor=(1, 1, 1, 0.4),
                markeredgecolor=colours[colour],
                markeredgewidth=2.0,
                clip_on=False,
                label=label,
            )
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
    """Largest magnitude of the eigenvalues of A and of A + GC over the steps.

    Parameters
    ----------
    model : Model
        The model.
    over : {"time", "step"}, default "time"
        What the horizontal axis shows.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    >>> ax = tokid.plot.pole_radius(model)
    """
    k, opened, closed = _plot_data.eigenvalues(model)
    steps, ax = _axes.Steps(over, model.dt), _axes.axes(ax)
    colours = _axes.colours(ax)
    every = np.arange(k[0], k[-1] + 1)
    for label, lists, colour, dash in (
        ("Open loop", opened, "orange", "-"),
        ("With the observer", closed, "blue", _axes.DASHES[1]),
    ):
        values = np.full(len(every), np.nan)
        values[k - k[0]] = [float(np.abs(found).max()) for found in lists]
        _axes.line(ax, steps(every), values, label=label, color=colours[colour], linewidth=1.6, linestyle=dash)
    ax.axhline(1, color=colours["faint"], linewidth=1.2, label="Unit circle")
    ax.set_ylim(bottom=0)
    ax.set_ylabel("Largest magnitude of the eigenvalues")
    steps.finish(ax, k)
    _axes.legend(ax)
    return ax


def _entries(
    model: Model, name: str, begin: int, end: int, rows: Optional[Sequence[int]], over: str, ax: Any, label: str
) -> Axes:
    matrices = getattr(model, name)[begin - model.k_begin : end - model.k_begin]
    n, columns = model.states, model.outputs if name == "G" else model.states
    if not n:
        raise ValueError("the model has no states: it has neither gains nor A")
    chosen = range(min(n, _MOST_STATES)) if rows is None else [integer("rows", row, 0, n - 1) for row in rows]
    steps, ax = _axes.Steps(over, model.dt), _axes.axes(ax)
    colours = _axes.colours(ax)
    k = np.arange(begin, end)
    count = 0
    for i in chosen:
        for j in range(min(columns, _MOST_STATES)):
            values = np.array([a[i, j] if i < a.shape[0] and j < a.shape[1] else np.nan for a in matrices])
            _axes.line(
                ax,
                steps(k),
                values,
                label=f"{name}({i + 1},{j + 1})",
                color=colours[_axes.PALETTE[count % len(_axes.PALETTE)]],
                linestyle=_axes.DASHES[count // len(_axes.PALETTE) % len(_axes.DASHES)],
                linewidth=1.4,
            )
            count += 1
    ax.set_ylabel(label)
    steps.finish(ax, k)
    _axes.legend(ax, count)
    drawn: Axes = ax
    return drawn


def gains(model: Model, *, rows: Optional[Sequence[int]] = None, over: str = "time", ax: Optional[Axes] = None) -> Axes:
    """Entries of the observer gain G over the steps.

    In the reference frame, or in the smooth one where it does not reach far enough. A system that varies smoothly should
    show smooth curves: what scatters is noise.

    Parameters
    ----------
    model : Model
        The model.
    rows : sequence of int, optional
        Rows of G that are drawn, counted from 0; by default the first 12.
    over : {"time", "step"}, default "time"
        What the horizontal axis shows.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

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
    """Entries of A over the steps in the smooth frame. The parameters are those of `gains`."""
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
    """Correlation of each output's innovations with those some steps before, with its 99 % bound.

    An observer that is right leaves innovations without memory.

    Parameters
    ----------
    model : Model or Validation
        The model, or what `Model.validate` has found already.
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, or DataFrame
        Experiments, beside a model.
    lags : int, default 5
        Lags that are tested.
    initial_state : {"auto", "zero", "unknown"}, default "auto"
        States at step 0.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default in a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    ValueError
        Where whiteness was not tested: too few samples, or innovations at rounding level.

    Examples
    --------
    >>> ax = tokid.plot.whiteness(model, data)
    """
    names: Optional[list[str]] = None
    if isinstance(model, Validation):
        if u is not None or y is not None:
            raise ValueError("u, y: found beside a Validation, which is of its own data")
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
        why = "too few samples" if validation.noisy else "the innovations are at rounding level"
        raise ValueError(f"whiteness: not tested, {why}")
    ax = _axes.axes(ax, height=3.0)
    colours = _axes.colours(ax)
    correlation, x = white.correlation, np.arange(1, len(white.bound) + 1)
    ax.axhline(0, color=colours["faint"], linewidth=0.8)
    ax.plot(x, white.bound, color=colours["faint"], linestyle=_axes.DASHES[1], linewidth=1.3, label="99 % bound")
    ax.plot(x, -white.bound, color=colours["faint"], linestyle=_axes.DASHES[1], linewidth=1.3, label="_")
    for j in range(min(correlation.shape[1], _MOST_STATES)):
        ax.plot(
            x,
            correlation[:, j],
            color=colours[_axes.PALETTE[j % len(_axes.PALETTE)]],
            linestyle=_axes.DASHES[j // len(_axes.PALETTE) % len(_axes.DASHES)],
            linewidth=1.4,
            marker="o",
            markersize=5,
            label=names[j] if names else f"y{j + 1}",
        )
    most = 1.15 * max(0.02, float(np.nanmax(np.abs(correlation))), float(np.nanmax(white.bound)))
    ax.set_xlim(0.5, len(x) + 0.5)
    ax.set_ylim(-most, most)
    _axes.whole_ticks(ax.xaxis)
    ax.set_xlabel("Lag [steps]")
    ax.set_ylabel("Correlation")
    probability = "p < 0.0001" if white.p < 1e-4 else f"p = {white.p:.3g}"
    ax.set_title(f"Whiteness of the innovations, {probability}", loc="left", fontsize="medium")
    _axes.legend(ax, min(correlation.shape[1], _MOST_STATES) + 1 if correlation.shape[1] > 4 else 0)
    return ax
