# SPDX-License-Identifier: BSD-3-Clause
"""Pictures: what they draw is what the tool's report page draws, from the same model and data."""

import html
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
import tokid
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from tokid import plot

ROOT = Path(__file__).resolve().parents[2]
TOKID = os.environ.get("TOKID", str(ROOT / "build" / "bin" / "tokid"))
DT = 0.05
# The page rounds to six digits, which changes a number by at most 5e-6 of it.
SIX_DIGITS = 5.1e-6


@pytest.fixture(scope="module")
def data():
    ensemble = tokid.example("oscillator", experiments=12, steps=30, measurement_noise=0.02, seed=2)
    motion = np.sin(np.arange(30) / 5)[:, np.newaxis]
    return tokid.Ensemble(
        ensemble.u + motion,
        ensemble.y + 3 * motion,
        dt=DT,
        initial_state="zero",
        input_names=["force", "torque"],
        output_names=["angle", "rate"],
        input_units=["N", "N m"],
        output_units=["rad", "rad/s"],
    )


@pytest.fixture(scope="module")
def model():
    ensemble = tokid.example("oscillator", experiments=60, steps=30, measurement_noise=0.02)
    motion = np.sin(np.arange(30) / 5)[:, np.newaxis]
    return tokid.identify(
        ensemble.u + motion,
        ensemble.y + 3 * motion,
        dt=DT,
        states=4,
        lags=3,
        smoothing=0.0,
        refine=False,
        weighting="one-step",
        nominal="mean",
        initial_state="zero",
    )


@pytest.fixture(scope="module")
def exact():
    """No noise; the state dimension grows at the beginning and shrinks at the end."""
    return tokid.identify(tokid.example("oscillator", experiments=30, steps=30))


def page_of(model, data, folder):
    model.save(folder / "model.npz")
    data.save(folder / "data.npz")
    subprocess.run(
        [TOKID, "report", folder / "model.npz", folder / "data.npz", "-o", folder / "page.html"],
        check=True,
        capture_output=True,
    )
    text = (folder / "page.html").read_text()
    return json.loads(re.search(r'id="report-data"[^>]*>(.*?)</script>', text, re.DOTALL)[1]), html.unescape(text)


@pytest.fixture(scope="module")
def page(model, data, tmp_path_factory):
    return page_of(model, data, tmp_path_factory.mktemp("page"))[0]


@pytest.fixture(scope="module")
def exact_page(exact, tmp_path_factory):
    return page_of(
        exact, tokid.example("oscillator", experiments=4, steps=30, seed=2), tmp_path_factory.mktemp("exact")
    )[0]


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def numbers(values):
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def line(ax, label):
    found = [line for line in ax.lines if line.get_label() == label]
    assert len(found) == 1, [line.get_label() for line in ax.lines]
    return found[0]


def same(ax, label, x, values):
    """A line has the page's numbers, which are rounded to six digits."""
    drawn = line(ax, label)
    np.testing.assert_allclose(drawn.get_xdata(), x, rtol=1e-12)
    np.testing.assert_allclose(
        drawn.get_ydata(), numbers(values), rtol=SIX_DIGITS, atol=1e-12 * np.nanmax(np.abs(numbers(values)))
    )


# ---- the curves ----


@pytest.mark.parametrize("output", [0, 1])
@pytest.mark.parametrize("n", [0, 7, None])
def test_outputs_and_errors(model, data, page, n, output):
    traces = page["traces"]
    shown = traces["experiments"][traces["first"] if n is None else n]  # all twelve are on the page, in their order
    k = numbers(traces["x"])
    ax = plot.outputs(model, data, experiment=n, output=output)
    assert isinstance(ax, Axes)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Time [s]", ["angle [rad]", "rate [rad/s]"][output])
    assert ax.get_title(loc="left") == shown["label"]
    same(ax, "Measured", k * DT, shown["y"][output])
    same(ax, "Simulated", k * DT, shown["simulated"][output])
    same(ax, "One-step prediction", k * DT, shown["predicted"][output])
    same(ax, "Nominal", k * DT, traces["nominal"]["y"][output])
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "Measured",
        "Simulated",
        "One-step prediction",
        "Nominal",
    ]

    ax = plot.errors(model, data, experiment=n, output=output, over="step")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Step", ["angle [rad]", "rate [rad/s]"][output])
    same(ax, "Measured − simulated", k, shown["simulation_error"][output])
    same(ax, "Measured − predicted", k, shown["prediction_error"][output])


def test_outputs_of_unknown_initial_states():
    model = tokid.example_system("oscillator", steps=30, measurement_noise=0.1)
    data = tokid.example("oscillator", experiments=5, steps=30, measurement_noise=0.1, initial_state="unknown")
    ax = plot.outputs(model, data, experiment=2)
    simulated, predicted = line(ax, "Simulated").get_ydata(), line(ax, "One-step prediction").get_ydata()
    np.testing.assert_array_equal(predicted, model.predict(data)[2, :, 0])
    from_zero = model.simulate(data, np.zeros(4))[2, :, 0]
    assert np.nanstd(simulated - data.y[2, :, 0]) < 0.5 * np.std(from_zero - data.y[2, :, 0])


def test_departures_from_the_nominal_trajectory(model, data):
    ax = plot.outputs(model, data, experiment=3, departures=True)
    np.testing.assert_array_equal(line(ax, "Measured").get_ydata(), data.y[3, :, 0] - model.y_nominal[:, 0])
    np.testing.assert_allclose(line(ax, "Simulated").get_ydata(), model.simulate(data)[3, :, 0] - model.y_nominal[:, 0])
    assert len(ax.lines) == 3


def test_inputs(model, data, page):
    shown = page["traces"]["experiments"][4]
    ax = plot.inputs(model, data, experiment=4, input="torque")
    assert ax.get_ylabel() == "torque [N m]" and line(ax, "Measured").get_drawstyle() == "steps-post"
    same(ax, "Measured", np.arange(30) * DT, shown["u"][1])
    same(ax, "Nominal", np.arange(30) * DT, page["traces"]["nominal"]["u"][1])
    held = plot.inputs(model, data.u, input=1)
    np.testing.assert_array_equal(line(held, "Measured").get_ydata(), data.u[0, :, 1])


@pytest.mark.parametrize("which", ["noisy", "exact"])
def test_singular_values(model, exact, page, exact_page, which):
    chosen, shown = (model, page["sigma"]) if which == "noisy" else (exact, exact_page["sigma"])
    ax = plot.singular_values(chosen, over="step")
    mesh = ax.collections[0]
    values = np.ma.filled(mesh.get_array(), np.nan).reshape(
        shown["rows"], len(shown["log"])
    )  # flat before matplotlib 3.8
    for s, column in enumerate(shown["log"]):
        found = values[: len(column), s]
        np.testing.assert_allclose(100 * np.log10(found), numbers(column), atol=0.51)  # whole hundredths
        floor = 1e-16 * max(values[np.isfinite(values)])
        np.testing.assert_array_equal(found[found > floor], chosen.singular_values[s][: len(found)][found > floor])
        assert np.isnan(values[len(column) :, s]).all()
    order, edges, _ = ax.patches[0].get_data()
    np.testing.assert_array_equal(order - 0.5, shown["order"])
    np.testing.assert_array_equal(edges, np.arange(31) - 0.5)
    assert ax.get_ylim() == (shown["rows"] + 0.5, 0.5)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Step", "Singular value")
    # Rounding errors are grey, all others on the scale.
    grey = np.array([140, 148, 158, 255]) / 255
    shades = mesh.cmap(mesh.norm(mesh.get_array())).reshape(-1, 4)
    rounding = np.array(
        [
            value is None or value < shown["rounding"]
            for column in np.array([list(c) + [1e9] * (shown["rows"] - len(c)) for c in shown["log"]]).T
            for value in column
        ]
    )
    present = np.isfinite(values).ravel()
    assert (present & ~rounding).any() and (which == "noisy" or (present & rounding).any())
    np.testing.assert_allclose(shades[present & rounding], np.tile(grey, (np.sum(present & rounding), 1)), atol=1e-3)
    assert (np.abs(shades[present & ~rounding] - grey).max(axis=1) > 0.02).all()


def test_regressions(exact, exact_page):
    shown = exact_page["per_step"]
    k = numbers(shown["x"])
    same(plot.condition(exact), "_child0", k * DT, shown["condition"])
    assert plot.condition(exact).get_yscale() == "log"
    ax = plot.ranks(exact)
    for label, key in (("Rank", "rank"), ("Unknowns", "unknowns"), ("Lag order", "lags"), ("States", "states")):
        same(ax, label, k * DT, shown[key])


def test_step_error(model, data, page):
    ax = plot.step_error(model, data)
    same(ax, "_child0", numbers(page["step_error"]["x"]) * DT, page["step_error"]["value"])
    assert ax.get_ylabel() == "One-step error / spread"


def complex_of(lists):
    return [numbers(values)[::2] + 1j * numbers(values)[1::2] for values in lists]


def sorted_poles(values):
    return np.sort_complex(np.round(values, 4))


@pytest.mark.parametrize("which", ["noisy", "exact"])
def test_poles(model, exact, page, exact_page, which):
    chosen, shown = (model, page["poles"]) if which == "noisy" else (exact, exact_page["poles"])
    ax = plot.poles(chosen)
    for label, key in (("Open loop, A", "open"), ("With the observer, A + GC", "closed")):
        drawn = line(ax, label)
        found, wanted = drawn.get_xdata() + 1j * drawn.get_ydata(), complex_of(shown[key])
        # Eigenvalues of a deadbeat observer are as exact as the root of rounding errors.
        exactness = SIX_DIGITS * max(1, *(abs(at).max() for at in wanted)) if key == "open" or which == "noisy" else 1e-3
        for values, at in zip(np.split(found, len(wanted)), wanted):
            assert np.abs(values[:, None] - at[None, :]).min(axis=1).max() < exactness
            assert np.abs(values[:, None] - at[None, :]).min(axis=0).max() < exactness
    assert ax.get_aspect() == 1.0 and (ax.get_xlabel(), ax.get_ylabel()) == ("Real part", "Imaginary part")
    assert ax.patches[0].radius == 1

    ax = plot.pole_radius(chosen, over="step")
    np.testing.assert_array_equal(line(ax, "Open loop").get_xdata(), shown["k"])
    np.testing.assert_allclose(
        line(ax, "Open loop").get_ydata(), [np.abs(v).max() for v in complex_of(shown["open"])], rtol=SIX_DIGITS
    )
    np.testing.assert_allclose(
        line(ax, "With the observer").get_ydata(),
        [np.abs(v).max() for v in complex_of(shown["closed"])],
        rtol=1e-3 if which == "exact" else SIX_DIGITS,
    )


def test_poles_of_one_step_stand_out(model):
    ax = plot.poles(model, k=12)
    frame = model.frame("reference")
    drawn = line(ax, "Open loop, A")
    np.testing.assert_allclose(
        np.sort_complex(drawn.get_xdata() + 1j * drawn.get_ydata()),
        np.sort_complex(np.linalg.eigvals(frame.A[12])),
        atol=1e-9,
    )
    assert ax.get_title(loc="left") == "Step 12, 0.6 s"
    with pytest.raises(ValueError, match="k: 99 found, one of the steps with eigenvalues"):
        plot.poles(model, k=99)


@pytest.mark.parametrize("which", ["noisy", "exact"])
def test_gains_and_state_matrix(model, exact, page, exact_page, which):
    chosen, shown = (model, page) if which == "noisy" else (exact, exact_page)
    for draw, key, name in ((plot.gains, "gain", "G"), (plot.state_matrix, "A", "A")):
        ax, table = draw(chosen), shown[key]
        assert len(ax.lines) == table["rows"] * table["cols"]
        scale = np.nanmax(np.abs([numbers(values) for values in table["values"]]))
        for entry, values in enumerate(table["values"]):
            drawn = line(ax, f"{name}({entry // table['cols'] + 1},{entry % table['cols'] + 1})")
            np.testing.assert_allclose(drawn.get_xdata(), numbers(table["x"]) * DT)
            np.testing.assert_allclose(drawn.get_ydata(), numbers(values), rtol=SIX_DIGITS, atol=1e-12 * scale)
    assert [one.get_label() for one in plot.gains(chosen, rows=[2]).lines] == ["G(3,1)", "G(3,2)"]


def test_whiteness(model, data, page):
    shown = page["whiteness"]
    lags = np.arange(1, 1 + model.validate(data).whiteness.bound.size)
    ax = plot.whiteness(model, data)
    for j, name in enumerate(["angle", "rate"]):
        same(ax, name, lags, shown["correlation"][j])
    same(ax, "99 % bound", lags, shown["bound"])
    np.testing.assert_array_equal(line(ax, "_").get_ydata(), -line(ax, "99 % bound").get_ydata())
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("Lag [steps]", "Correlation")
    validation = model.validate(data, whiteness_lags=4)
    np.testing.assert_array_equal(
        line(plot.whiteness(validation), "y2").get_ydata(), validation.whiteness.correlation[:, 1]
    )
    assert (
        f"p = {validation.whiteness.p:.3g}" in plot.whiteness(validation).get_title(loc="left")
        or validation.whiteness.p < 0.001
    )
    with pytest.raises(ValueError, match="u, y: found beside a Validation"):
        plot.whiteness(validation, data)


def test_arrays_and_tables_in_place_of_an_ensemble(model, data):
    wanted = line(plot.outputs(model, data, experiment=3, output="rate"), "Simulated").get_ydata()
    table = data.to_dataframe().rename(columns={"force": "u1", "torque": "u2", "angle": "y1", "rate": "y2"})
    for ax in (
        plot.outputs(model, data.u, data.y, experiment=3, output="y2"),
        plot.outputs(model, data.u[3], data.y[3], output=1),
        plot.outputs(model, table, experiment=3, output="y2"),
    ):
        np.testing.assert_allclose(line(ax, "Simulated").get_ydata(), wanted, rtol=1e-12)


# ---- manners ----


def everything(model, data, ax=None):
    axes = iter(ax if ax is not None else [None] * 13)
    return [
        plot.outputs(model, data, ax=next(axes)),
        plot.errors(model, data, ax=next(axes)),
        plot.inputs(model, data, ax=next(axes)),
        plot.singular_values(model, ax=next(axes)),
        plot.condition(model, ax=next(axes)),
        plot.ranks(model, ax=next(axes)),
        plot.step_error(model, data, ax=next(axes)),
        plot.poles(model, ax=next(axes)),
        plot.poles(model, k=9, ax=next(axes)),
        plot.pole_radius(model, ax=next(axes)),
        plot.gains(model, ax=next(axes)),
        plot.state_matrix(model, ax=next(axes)),
        plot.whiteness(model, data, ax=next(axes)),
    ]


def test_given_axes_are_used_and_nothing_else_is_touched(model, data):
    before = dict(matplotlib.rcParams)
    figure = Figure(figsize=(18, 24), layout="constrained")  # not one of pyplot's
    given = list(figure.subplots(5, 3).ravel())[:13]
    returned = everything(model, data, given)
    assert all(a is b for a, b in zip(returned, given))
    assert plt.get_fignums() == []
    assert dict(matplotlib.rcParams) == before
    for ax in given:
        assert ax.get_xlabel() and ax.get_ylabel()
        assert to_hex(ax.get_facecolor()) == "#ffffff"


def test_new_figures_are_of_their_own(model, data):
    other, ax = plt.subplots()
    returned = everything(model, data)
    assert len({id(axes.figure) for axes in returned}) == 13 and not ax.has_data()


def test_images_hold_the_curves(model, data):
    """Every picture renders, and each curve's colour is seen in it."""
    for ax in everything(model, data, [Figure(figsize=(5, 3.5)).subplots() for _ in range(13)]):
        buffer = io.BytesIO()
        ax.figure.savefig(buffer, dpi=40, format="png")
        buffer.seek(0)
        pixels = (plt.imread(buffer)[:, :, :3] * 255).round().astype(int).reshape(-1, 3)
        solid = {
            to_hex(one.get_color())
            for one in ax.lines
            if one.get_linestyle() == "-"
            and one.get_alpha() is None
            and len(one.get_xdata()) > 2
            and one.get_linewidth() > 1
        }
        for colour in solid:
            wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
            assert (np.abs(pixels - wanted).max(axis=1) < 60).any(), (ax.get_ylabel(), colour)
        assert len(np.unique(pixels, axis=0)) > 20


def test_colours_are_those_of_the_page(model):
    css = (ROOT / "src" / "report" / "assets" / "page.css").read_text()
    light, dark = re.findall(r"^:root[^{]*{(.*?)}", css, re.DOTALL | re.MULTILINE)
    for colours, block in ((plot.COLOURS, light), (plot.DARK_COLOURS, dark)):
        named = {name.removeprefix("c-"): value for name, value in re.findall(r"--([\w-]+): (#\w{6})", block)}
        for name, value in colours.items():
            assert value == named[name], name
    with plt.style.context("dark_background"):
        assert plot.gains(model, rows=[0]).lines[0].get_color() == plot.DARK_COLOURS["blue"]
    assert plot.gains(model, rows=[0]).lines[0].get_color() == plot.COLOURS["blue"]


def test_pyplot_is_not_imported_before_it_is_needed():
    code = "import sys, tokid.plot; assert 'matplotlib' in sys.modules and 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_can_not_be_drawn(data):
    known, exact = tokid.example_system("oscillator", steps=30), tokid.example("oscillator", experiments=12, steps=30)
    with pytest.raises(ValueError, match="the model has no singular values"):
        plot.singular_values(known)
    with pytest.raises(ValueError, match="the model has no condition numbers"):
        plot.condition(known)
    with pytest.raises(ValueError, match="output: 'speed' found, one of 'angle', 'rate' needed"):
        plot.outputs(known, data, output="speed")
    with pytest.raises(ValueError, match="experiment: 12 found, a whole number from 0 to 11 needed"):
        plot.outputs(known, data, experiment=12)
    model = tokid.identify(exact, states=4, lags=2)
    for draw in (plot.outputs, plot.errors, plot.inputs, plot.step_error):
        with pytest.raises(ValueError, match="over: 'days' found, one of 'time', 'step' needed"):
            draw(model, exact, over="days")
    for draw in (plot.singular_values, plot.condition, plot.ranks, plot.pole_radius, plot.gains, plot.state_matrix):
        with pytest.raises(ValueError, match="over: 'days' found, one of 'time', 'step' needed"):
            draw(model, over="days")
    with pytest.raises(ValueError, match="u: none found, experiments needed beside a model"):
        plot.whiteness(known)
    with pytest.raises(ValueError, match=r"whiteness: not tested \(the innovations are at rounding level\)"):
        plot.whiteness(known, exact)
    static = tokid.Model.from_matrices(
        [np.zeros((0, 0))] * 5, [np.zeros((0, 1))] * 5, [np.zeros((1, 0))] * 5, [np.ones((1, 1))] * 5
    )
    with pytest.raises(ValueError, match="the model has no states, and therefore neither gains nor A"):
        plot.gains(static)
    with pytest.raises(ValueError, match="there are no eigenvalues"):
        plot.poles(static)
    assert plt.get_fignums() == []  # no empty figure stays behind


def test_eigenvalues_that_overflow_are_left_out():
    def model(huge):
        gains = [np.full((1, 1), 1e200 if k in huge else 0.1) for k in range(30)]
        return tokid.Model.from_matrices(
            [np.full((1, 1), 0.5)] * 30, [np.ones((1, 1))] * 30, [np.full((1, 1), 1e200)] * 30, G=gains
        )

    # Gains of 0.1 make eigenvalues that are large and finite, 1e200 by 1e200 is neither.
    drawn = [line(plot.poles(model(huge)), "Open loop, A").get_xdata() for huge in ((), {7})]
    assert len(drawn[1]) == len(drawn[0]) - 1
    radius = line(plot.pole_radius(model({7}), over="step"), "Open loop").get_ydata()
    assert np.flatnonzero(np.isnan(radius)).tolist() == [7]
    with pytest.raises(ValueError, match="there are no eigenvalues"):
        plot.poles(model(range(30)))
