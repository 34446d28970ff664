# SPDX-License-Identifier: BSD-3-Clause
"""Channels that a model and its data both name are matched by name: no option, no order of columns."""

import numpy as np
import pytest
from support import load

NAMES = {"input_names": ["torque", "force"], "output_names": ["angle", "rate"], "output_units": ["rad", "rad/s"]}


@pytest.fixture(scope="module")
def named(tokid, oscillator, tmp_path_factory):
    """A model with names, of a .csv whose names need options, and fresh data with the same names in another order."""
    folder = tmp_path_factory.mktemp("named")
    data, fresh = load(oscillator / "data.npz"), load(oscillator / "fresh.npz")
    np.savez(folder / "data.npz", **{**data, **NAMES})
    np.savez(folder / "fresh.npz", **{**fresh, **NAMES})
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz")
    swapped = in_reverse(fresh)
    np.savez(folder / "swapped.npz", **swapped)
    np.savez(folder / "swapped_data.npz", **in_reverse(data))
    plain(folder / "fresh.csv", fresh, ["torque", "force", "angle", "rate"])
    plain(folder / "swapped.csv", swapped, ["force", "torque", "rate", "angle"])
    return folder


def in_reverse(data):
    return {**data, "u": data["u"][:, :, ::-1], "y": data["y"][:, :, ::-1],
            **{name: list(reversed(texts)) for name, texts in NAMES.items()}}


def plain(path, data, names):
    """A .csv without comments, as other programs write it."""
    lines = ["experiment,time," + ",".join(names)]
    for n, (u, y) in enumerate(zip(data["u"], data["y"])):
        for k, row in enumerate(np.concatenate([u, y], axis=1)):
            lines.append(f"{n},{k * float(data['dt'])!r}," + ",".join(repr(float(v)) for v in row))
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("fresh", ["swapped.npz", "fresh.csv", "swapped.csv"])
def test_validate_finds_the_channels_of_the_model(tokid, named, fresh):
    expected = tokid.json("validate", named / "model.npz", named / "fresh.npz")
    found = tokid.json("validate", named / "model.npz", named / fresh)
    assert found["output_names"] == ["angle", "rate"]
    assert found["warnings"] == []
    np.testing.assert_allclose(found["simulation_fit"], expected["simulation_fit"], rtol=1e-9)
    np.testing.assert_allclose(found["one_step_rmse"], expected["one_step_rmse"], rtol=1e-6)


@pytest.mark.parametrize("command", ["simulate", "predict"])
@pytest.mark.parametrize("fresh", ["swapped.npz", "fresh.csv", "swapped.csv"])
def test_outputs_are_those_of_the_model(tokid, named, tmp_path, command, fresh):
    for name in ("fresh.npz", fresh):
        tokid(command, named / "model.npz", named / name, "-o", tmp_path / f"{name}.out.npz")
    expected, found = load(tmp_path / "fresh.npz.out.npz"), load(tmp_path / f"{fresh}.out.npz")
    assert list(found["output_names"]) == NAMES["output_names"]
    np.testing.assert_allclose(found["y"], expected["y"], rtol=1e-12, atol=1e-12)


def test_refine_confidence_and_report_too(tokid, named, tmp_path):
    for data in ("data", "swapped_data"):
        tokid("confidence", named / "model.npz", named / f"{data}.npz", "-o", tmp_path / f"{data}.npz")
        tokid("refine", named / "model.npz", named / f"{data}.npz", "-o", tmp_path / f"refined_{data}.npz")
        page = tokid("report", named / "model.npz", named / f"{data}.npz", "-o", tmp_path / f"{data}.html").stdout
        assert "experiments that the model was identified from" in page
    for result in ("", "refined_"):
        expected, found = load(tmp_path / f"{result}data.npz"), load(tmp_path / f"{result}swapped_data.npz")
        for name in {"markov", "markov_lower", "A", "B", "C", "D"} & set(expected):
            np.testing.assert_allclose(found[name], expected[name], rtol=1e-9, atol=1e-12)


def test_update_takes_channels_by_name(tokid, named, tmp_path):
    for fresh in ("fresh.npz", "swapped.npz", "swapped.csv"):
        folder = tmp_path / fresh
        folder.mkdir()
        tokid("identify", named / "data.npz", "-o", folder / "model.npz", "--state", folder / "state.npz")
        tokid("update", folder / "state.npz", named / fresh, "-o", folder / "model.npz")
    expected = load(tmp_path / "fresh.npz" / "state.npz")["window_factors"]
    for fresh in ("swapped.npz", "swapped.csv"):
        found = load(tmp_path / fresh / "state.npz")["window_factors"]
        np.testing.assert_allclose(np.swapaxes(found, 1, 2) @ found, np.swapaxes(expected, 1, 2) @ expected,
                                   rtol=1e-9, atol=1e-9 * np.abs(expected).max() ** 2)


def test_channels_beside_those_of_the_model_are_left_out(tokid, named, tmp_path):
    fresh = load(named / "fresh.npz")
    noise = np.random.default_rng(1).standard_normal((*fresh["u"].shape[:2], 1))
    np.savez(tmp_path / "more.npz", **{**fresh, "u": np.concatenate([noise, fresh["u"]], axis=2),
                                       "input_names": ["wind", "torque", "force"]})
    expected = tokid.json("validate", named / "model.npz", named / "fresh.npz")
    assert tokid.json("validate", named / "model.npz", tmp_path / "more.npz")["simulation_fit"] == expected["simulation_fit"]


def test_other_names_are_reported_and_the_order_stands(tokid, named, tmp_path):
    fresh = load(named / "fresh.npz")
    np.savez(tmp_path / "other.npz", **{**fresh, "output_names": ["phi", "rate"]})
    found = tokid.json("validate", named / "model.npz", tmp_path / "other.npz")
    expected = tokid.json("validate", named / "model.npz", named / "fresh.npz")
    assert found["simulation_fit"] == expected["simulation_fit"]
    assert any("phi" in text and "angle" in text for text in found["warnings"])


def test_a_missing_column_is_named_by_the_options(tokid, named, tmp_path):
    text = (named / "fresh.csv").read_text().replace("torque", "moment", 1)
    (tmp_path / "fresh.csv").write_text(text)
    message = tokid("validate", named / "model.npz", tmp_path / "fresh.csv", status=2).stderr
    assert "moment" in message and "fresh.csv" in message
    # What is stated stands above the names of the model.
    tokid("validate", named / "model.npz", tmp_path / "fresh.csv", "--inputs", "moment,force", "--outputs", "angle,rate")


@pytest.mark.parametrize("command", ["validate", "predict"])
def test_a_horizon_over_all_steps_is_refused(tokid, oscillator, tmp_path, command):
    output = ["-o", tmp_path / "out.npz"] if command == "predict" else []
    for horizon in (40, 500):
        message = tokid(command, oscillator / "model.npz", oscillator / "fresh.npz", "--horizon", horizon, *output,
                        status=2).stderr
        assert f"horizon: {horizon} found" in message and "at most 39 needed" in message
    tokid(command, oscillator / "model.npz", oscillator / "fresh.npz", "--horizon", 39, *output)
    if command == "validate":
        tokid(command, oscillator / "model.npz", oscillator / "data.npz", "--cross-validate", 3, "--horizon", 40, status=2)
