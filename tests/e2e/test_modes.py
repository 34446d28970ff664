# SPDX-License-Identifier: BSD-3-Clause
"""modes: the table, the file, JSON, intervals, and calls that are refused."""

import csv
import json

import numpy as np
import pytest
from scipy.linalg import expm

DT, STEPS, N, DAMPING = 0.05, 60, 30, 0.05


def frequency(k):
    """Of an oscillator whose stiffness grows [rad/s]."""
    return 4 + 0.2 * k * DT


def transition(w):
    return expm(DT * np.array([[0, 1], [-w * w, -2 * DAMPING * w]]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    directory, rng = tmp_path_factory.mktemp("modes"), np.random.default_rng(1)
    a = np.array([transition(frequency(k + 0.5)) for k in range(STEPS)])
    # Other coordinates at each step: the modes do not depend on them.
    t = rng.normal(size=(STEPS + 1, 2, 2)) + 2 * np.eye(2)
    inverse = np.linalg.inv(t)
    np.savez(directory / "truth.npz", A=t[1:] @ a @ inverse[:-1], B=t[1:] @ np.array([[0], [DT]]),
             C=np.array([[1, 0]]) @ inverse[:-1], D=np.zeros((STEPS, 1, 1)), G=np.zeros((STEPS, 2, 1)),
             state_dim=np.full(STEPS + 1, 2), k_begin=0, dt=DT, frame="raw", method="known", initial_state="zero")
    u, y, x = rng.normal(size=(N, STEPS, 1)), np.zeros((N, STEPS, 1)), np.zeros((N, 2))
    for k in range(STEPS):
        y[:, k, 0] = x[:, 0] + 0.01 * rng.normal(size=N) * DT
        x = x @ a[k].T + u[:, k] @ np.array([[0, DT]])
    np.savez(directory / "data.npz", u=u, y=y, dt=DT)
    return directory


@pytest.fixture(scope="module")
def identified(tokid, folder):
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--states", 2)
    return folder / "model.npz"


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def test_the_modes_of_the_truth(tokid, folder, tmp_path):
    found = tokid.json("modes", folder / "truth.npz", "-o", tmp_path / "modes.csv")
    begin, values = found["begin"], np.array(found["frequency"])
    steps = begin + np.arange(len(values))
    assert (begin, len(values), found["window"]) == (2, STEPS - 4, 4)
    # Damping ratios err in first order of the variation, frequencies by that times the damping ratio.
    most = 0.2 / frequency(0) ** 2
    np.testing.assert_allclose(values, np.repeat(frequency(steps)[:, None], 2, 1), rtol=DAMPING * most)
    np.testing.assert_allclose(found["damping"], DAMPING, atol=most)
    np.testing.assert_allclose(np.array(found["variation"])[3:-3], 0.2 / values[3:-3] ** 2, rtol=most)
    assert np.array(found["valid"]).all()
    np.testing.assert_allclose(np.hypot(found["poles_real"], found["poles_imag"]), values)
    table = rows(tmp_path / "modes.csv")
    assert [row["step"] for row in table] == list(steps)  # a pair is one mode
    np.testing.assert_allclose([row["time"] for row in table], steps * DT)
    np.testing.assert_array_equal([row["frequency"] for row in table], values[:, 0])
    np.testing.assert_allclose([row["hertz"] for row in table], values[:, 0] / (2 * np.pi))


def test_intervals(tokid, folder, identified, tmp_path):
    call = ["modes", identified, "--confidence", folder / "data.npz", "--replicates", 5]
    found = tokid.json(*call, "-o", tmp_path / "modes.csv", "--level", 0.95)
    assert (found["level"], found["replicates"]) == (0.95, 5)
    lower, upper = np.array(found["frequency_lower"]), np.array(found["frequency_upper"])
    assert np.all((lower < found["frequency"]) & (found["frequency"] < upper))
    for row, low, high in zip(rows(tmp_path / "modes.csv"), lower[:, 0], upper[:, 0]):
        assert (row["frequency_lower"], row["frequency_upper"]) == (low, high)
    wide, again = (np.array(tokid.json(*call, "--level", level)["frequency_upper"]) for level in (0.99, 0.95))
    assert np.all(wide > upper)
    assert np.array_equal(again, upper)  # the same seed


def test_the_printed_table(tokid, identified):
    text = tokid("modes", identified, "--at", "20,40").stdout
    lines = [line.split() for line in text.splitlines()]
    first, second = (line for line in lines if line[:1] in (["20"], ["40"]))  # such noise leaves an error of 2 %
    assert (first[1], second[1]) == ("1", "2")
    assert float(first[3]) == pytest.approx(frequency(20), rel=0.02)
    assert float(second[4]) == pytest.approx(frequency(40) / (2 * np.pi), rel=0.02)
    assert first[-1] == "yes"
    strict = tokid("modes", identified, "--at", "20", "--slow", 0.0001).stdout
    assert next(line for line in strict.splitlines() if line.split()[:1] == ["20"]).endswith("no")


def test_a_periodic_model_has_multipliers(tokid, folder, tmp_path):
    file = dict(np.load(folder / "truth.npz"))
    a = np.array([transition(4 + np.sin(2 * np.pi * k / 10)) for k in range(10)])
    file.update(A=a, B=np.tile([[0], [DT]], (10, 1, 1)), C=np.tile([[1.0, 0]], (10, 1, 1)), D=np.zeros((10, 1, 1)),
                G=np.zeros((10, 2, 1)), state_dim=np.full(11, 2), period=10)
    np.savez(tmp_path / "periodic.npz", **file)
    found = tokid.json("modes", tmp_path / "periodic.npz")
    assert (found["begin"], len(found["frequency"])) == (0, 10)
    product = np.linalg.multi_dot(a[::-1])
    values = np.array(found["multipliers_real"]) + 1j * np.array(found["multipliers_imag"])
    np.testing.assert_allclose(np.sort_complex(values), np.sort_complex(np.linalg.eigvals(product)), rtol=1e-10)
    text = tokid("modes", tmp_path / "periodic.npz").stdout
    assert f"Floquet        sizes of the multipliers over 10 steps: {abs(values[0]):.3g}" in text
    assert f"arguments of the multipliers [rad]: {np.angle(values[0]):.3g}, " in text and "by rounding" not in text
    assert np.all(np.array(found["multipliers_error"]) < 1e-10)
    # Coordinates of condition 1e8: rounding errors of the transitions reach the multipliers.
    t = np.array([[1, 1], [1, 1 + 1e-8]])
    file.update(A=t @ a @ np.linalg.inv(t), B=t @ file["B"], C=file["C"] @ np.linalg.inv(t))
    np.savez(tmp_path / "skewed.npz", **file)
    skewed = tokid.json("modes", tmp_path / "skewed.npz")
    assert np.max(skewed["multipliers_error"]) > 1e-10
    assert "relative errors of the multipliers by rounding: " in tokid("modes", tmp_path / "skewed.npz").stdout


def test_multipliers_have_intervals(tokid, tmp_path):
    rng, steps, period = np.random.default_rng(5), 40, 10
    a = np.array([transition(4 + np.sin(2 * np.pi * k / period)) for k in range(period)])
    u, y, x = rng.normal(size=(N, steps, 1)), np.zeros((N, steps, 1)), np.zeros((N, 2))
    for k in range(steps):
        y[:, k, 0] = x[:, 0] + 0.01 * rng.normal(size=N) * DT
        x = x @ a[k % period].T + u[:, k] @ np.array([[0, DT]])
    np.savez(tmp_path / "data.npz", u=u, y=y, dt=DT)
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--states", 2, "--period", period)
    call = ["modes", tmp_path / "model.npz", "--confidence", tmp_path / "data.npz", "--replicates", 30]
    found = tokid.json(*call)
    value = np.linalg.eigvals(np.linalg.multi_dot(a[::-1]))
    truth = np.log(value[np.argsort(-value.imag)]) / (period * DT)
    for name, wanted in (("real", truth.real), ("imag", truth.imag)):
        lower, middle, upper = (np.array(found[f"exponents_{name}{end}"]) for end in ("_lower", "", "_upper"))
        assert np.all((lower < middle) & (middle < upper) & (lower <= wanted) & (wanted <= upper))
        assert np.all(upper - lower < 0.05 * abs(truth[0]))  # as those of frequencies
    # What is printed is what is in the JSON, of however few replicates.
    call[-1] = 5
    found = tokid.json(*call)
    half = max(found["exponents_real_upper"][0] - found["exponents_real"][0],
               found["exponents_real"][0] - found["exponents_real_lower"][0])
    assert f"rates of growth [1/s]: {found['exponents_real'][0]:.3g} ± {half:.3g}, " in tokid(*call).stdout.replace("−", "-")


@pytest.mark.parametrize("options, said", [
    (["--at", "1"], "--at: 1 found, 2 to 57 needed: modes need the outputs of 4 steps around a step"),
    (["--at", "x"], "steps separated by commas needed"),
    (["--window", "3"], "window: 3 found, an even number of steps from 2 on needed for 2 states and 1 outputs"),
    (["-o", "modes.npz"], "extension '.npz' found, one of .csv needed to write a table"),
    (["--confidence", "truth.npz"], "truth.npz"),
    (["--level", "0.9"], "--level requires --confidence"),
    (["--replicates", "30"], "--replicates requires --confidence"),
    (["--seed", "2"], "--seed requires --confidence"),
])
def test_wrong_calls_are_refused(tokid, folder, options, said):
    result = tokid("modes", "truth.npz", *options, status=2, cwd=folder)
    assert said in result.stderr
    assert "\n" not in result.stderr.strip()


def test_json_is_one_object(tokid, folder):
    assert set(json.loads(tokid("modes", folder / "truth.npz", "--json").stdout)) >= {"frequency", "valid", "findings"}
