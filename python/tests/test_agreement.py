# SPDX-License-Identifier: BSD-3-Clause
"""What tokid identifies beside what programs of others identify from the same data.

With TOKID_UPDATE_DOCS=1 in the environment, the figures in docs/agreement.md are written anew instead of compared.
"""

import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
from itertools import zip_longest
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import tokid

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "bench"))
import numpy_tokid

DOCUMENT = ROOT / "docs" / "agreement.md"
EPS = np.finfo(float).eps

pytestmark = pytest.mark.filterwarnings("ignore:initial states are unknown")


# ---- systems and data ----


def system_of(states, inputs, outputs, rng):
    """A, B, C, D, of spectral radius 0.9."""
    a = rng.normal(size=(states, states))
    shapes = ((states, inputs), (outputs, states), (outputs, inputs))
    return (0.9 * a / np.abs(np.linalg.eigvals(a)).max(), *(rng.normal(size=shape) for shape in shapes))


def experiments(system, number, steps, rng, noise=(0.0, 0.0), start=1.0):
    """u and y: white inputs, white noise of the states and of the outputs, initial states of the size `start`.

    `system` has the matrices of all steps, or system(k) those of step k.
    """
    matrices = system if callable(system) else lambda k: system
    (states, inputs), outputs = matrices(0)[1].shape, len(matrices(0)[2])
    u, y = rng.normal(size=(number, steps, inputs)), np.empty((number, steps, outputs))
    x = start * rng.normal(size=(number, states))
    for k in range(steps):
        a, b, c, d = matrices(k)
        y[:, k] = x @ c.T + u[:, k] @ d.T + noise[1] * rng.normal(size=(number, outputs))
        x = x @ a.T + u[:, k] @ b.T + noise[0] * rng.normal(size=x.shape)
    return u, y


VARYING_STEPS, VARYING_LAGS = 30, 3


@functools.cache
def varying_data(start):
    """40 experiments with noise on a system that is another at every step."""
    rng = np.random.default_rng(1)
    first, last = (system_of(4, 2, 2, rng) for _ in range(2))

    def system(k):
        return tuple(np.cos(0.05 * k) * p + np.sin(0.05 * k) * q for p, q in zip(first, last))

    return experiments(system, 40, VARYING_STEPS, rng, (0.1, 0.1), start)


ARX_LAGS = 4


@functools.cache
def arx_data():
    """One output: arx has no model in which an output depends on the past of another."""
    rng = np.random.default_rng(7)
    return experiments(system_of(3, 2, 1, rng), 6, 60, rng, (0.1, 0.1))


STEPS = 80  # SLICOT 5.9 wants records of 2 s (m + r + 1) - 1 steps for n4sid, whose s is twice the number of states
EXACT_SHAPES = [(2, 1, 1), (3, 1, 2), (4, 2, 2)]  # states, inputs, outputs


@functools.cache
def exact_case(shape):
    """A system, and experiments on it without noise."""
    rng = np.random.default_rng(shape)
    system = system_of(*shape, rng)
    return system, *experiments(system, 5, STEPS, rng)


NOISY_CASES = [(draw, *shape) for shape in (*EXACT_SHAPES, (5, 2, 1)) for draw in range(2)]
NOISY_EXPERIMENTS = 8


@functools.cache
def noisy_case(case):
    """A system with its Kalman filter, experiments with noise of a fifth of the outputs, fresh ones from rest."""
    rng = np.random.default_rng(case)
    system = a, _, c, _ = system_of(*case[1:], rng)
    noise = (0.2, 0.2 * experiments(system, 20, 100, rng)[1].std())
    q, r = (np.square(size) * np.eye(len(matrix)) for size, matrix in zip(noise, (a, c)))
    p = scipy.linalg.solve_discrete_are(a.T, c.T, q, r)
    gain = a @ p @ c.T @ np.linalg.inv(c @ p @ c.T + r)
    return ((*system, gain), experiments(system, NOISY_EXPERIMENTS, STEPS, rng, noise),
            experiments(system, 20, 100, rng, noise, start=0.0))


# ---- models ----


def matrices_of(model, k):
    """A, B, C, D and the Kalman gain, which is -G."""
    *system, gain = (getattr(model, name)[k] for name in "ABCDG")
    return (*system, -gain)


def coefficients(model, k, lags):
    """Those of the GTV-ARX model of a step, as `windows` has the regressors, out of its observer."""
    _, _, row, d, _ = matrices_of(model, k)
    blocks = [d]
    for j in range(k - 1, k - lags - 1, -1):
        a, b, c, d, gain = matrices_of(model, j)
        blocks.insert(0, np.hstack([row @ (b - gain @ d), row @ gain]))
        row = row @ (a - gain @ c)
    return np.hstack(blocks)


def pulse_response(a, b, c, d, steps):
    """(m, r, steps), as python-control has it."""
    response = [d]
    for _ in range(steps - 1):
        response.append(c @ b)
        b = a @ b
    return np.stack(response, axis=2)


def predicted(a, b, c, d, gain, u, y):
    """One step ahead from rest; simulated where the gain is zero."""
    found, x = np.empty_like(y), np.zeros((len(u), len(a)))
    for k in range(u.shape[1]):
        found[:, k] = x @ c.T + u[:, k] @ d.T
        x = x @ a.T + u[:, k] @ b.T + (y[:, k] - found[:, k]) @ gain.T
    return found


# ---- least squares ----


def windows(u, y, k, lags):
    """The regressors of step k, oldest first, a row for each experiment."""
    past = [samples[:, j] for j in range(k - lags, k) for samples in (u, y)]
    return np.hstack([*past, u[:, k]])


def condition(matrix, rank=None):
    s = scipy.linalg.svdvals(matrix)
    return s[0] / s[len(s) - 1 if rank is None else rank - 1]


def largest(difference, wanted):
    return np.abs(difference).max() / np.abs(wanted).max()


# ---- the control package of Octave ----


@functools.cache
def octave():
    """The answers of control_package.m, all from one start of Octave, and the versions."""
    program = os.environ.get("TOKID_OCTAVE") or shutil.which("octave-cli")
    if not program:
        pytest.fail("Octave is needed: octave-cli on the path, or its path in TOKID_OCTAVE")
    data = {"arx": (arx_data(), "arx", ARX_LAGS)}
    data |= {("exact", shape): (exact_case(shape)[1:], "n4sid", shape[0]) for shape in EXACT_SHAPES}
    data |= {("noisy", case): (noisy_case(case)[1], "n4sid", case[1]) for case in NOISY_CASES}
    requests = np.empty(len(data), object)
    requests[:] = [dict(u=u, y=y, method=method, order=float(order)) for (u, y), method, order in data.values()]
    with tempfile.TemporaryDirectory() as folder:
        files = {"REQUESTS": f"{folder}/requests.mat", "ANSWERS": f"{folder}/answers.mat"}
        scipy.io.savemat(files["REQUESTS"], {"requests": requests})
        script = Path(__file__).with_name("control_package.m")
        done = subprocess.run([program, "--no-gui", "--no-init-file", "--no-history", script], env=os.environ | files,
                              stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        answers = scipy.io.loadmat(files["ANSWERS"], simplify_cells=True)
    return dict(zip(data, answers["answers"])) | {"versions": answers["versions"]}


def by_n4sid(name, states, inputs, outputs):
    """A, B, C, D, K."""
    sizes = ((states, states), (states, inputs), (outputs, states), (outputs, inputs), (states, outputs))
    return tuple(np.reshape(octave()[name][letter], size) for letter, size in zip("ABCDK", sizes))


# ---- what has to agree to rounding: the largest relative difference, and its bound ----


def all_coefficients():
    """The full number of states realises the coefficients themselves, so that noise is no obstacle."""
    u, y = varying_data(1.0)
    p = VARYING_LAGS
    model = tokid.identify(u, y, initial_state="unknown", nominal="none", smoothing=0, weighting="one-step",
                           refine=False, lags=p, states=2 * p)
    pairs = []
    for k in range(2 * p, VARYING_STEPS):  # the model begins with step p
        w = windows(u, y, k, p)
        wanted = scipy.linalg.lstsq(w, y[:, k])[0].T
        residual = np.linalg.norm(y[:, k] - w @ wanted.T) / np.linalg.norm(y[:, k])
        # What the perturbation of a least-squares problem by rounding is bounded by.
        bound = EPS * condition(w) * (1 + condition(w) * residual)
        pairs.append((largest(coefficients(model, k - p, p) - wanted, wanted), bound))
    return max(pairs, key=lambda pair: pair[0] / pair[1])


@functools.cache
def model_of_paper():
    u, y = varying_data(0.0)
    return tokid.identify(u, y, initial_state="zero", nominal="none", smoothing=0, method="tvera", lags=VARYING_LAGS,
                          states=2 * VARYING_LAGS)


def residual_covariances():
    u, y = varying_data(0.0)
    pairs = []
    for k in range(VARYING_LAGS, VARYING_STEPS):
        w = windows(u, y, k, VARYING_LAGS)
        residuals = y[:, k] - w @ np.linalg.lstsq(w, y[:, k], rcond=None)[0]
        wanted = residuals.T @ residuals / (len(w) - w.shape[1])
        # Residuals are differences of outputs; sums of as many products as there are experiments.
        bound = EPS * len(w) * np.linalg.norm(y[:, k]) / np.linalg.norm(residuals)
        pairs.append((largest(model_of_paper().innovation_cov[k] - wanted, wanted), bound))
    return max(pairs, key=lambda pair: pair[0] / pair[1])


def whole_method():
    u, y = varying_data(0.0)
    with tempfile.TemporaryDirectory() as folder:
        data, script, own = (f"{folder}/{name}.npz" for name in ("data", "script", "own"))
        np.savez(data, u=u, y=y, dt=1.0)
        numpy_tokid.identify(data, script, VARYING_LAGS, 2 * VARYING_LAGS)
        model_of_paper().save(own)
        difference = numpy_tokid.difference_of_files(script, own)
    # Pulse responses are sums of products of coefficients, which carry the errors of the worst regression.
    worst = max(condition(windows(u, y, k, VARYING_LAGS)) for k in range(VARYING_LAGS, VARYING_STEPS))
    return difference, EPS * worst * u.shape[2] * VARYING_LAGS


def arx_coefficients():
    u, y = arx_data()
    p = ARX_LAGS
    model = tokid.identify(u, y, period="invariant", initial_state="unknown", nominal="none", weighting="one-step",
                           refine=False, lags=p, states=p)
    found = coefficients(model, p, p)[0]
    w = np.vstack([windows(u, y, k, p) for k in range(p, y.shape[1])])
    step = u.shape[2] + 1
    inputs = [np.append(found[i:-2:step], found[i - 2])[::-1] for i in range(2)]
    found = np.concatenate([found[2:-2:step][::-1], *inputs])  # in the order of control_package.m
    wanted = octave()["arx"]["coefficients"]
    return largest(found - wanted, wanted), EPS * condition(w) ** 2  # of several records, arx has the normal equations


def pulses_of_n4sid(shape):
    system, u, y = exact_case(shape)
    model = tokid.identify(u, y, period="invariant", initial_state="unknown", nominal="none")
    assert model.states == shape[0]
    rows = 2 * shape[0]  # block rows of n4sid, where they are not given
    hankel = np.vstack([windows(u, y, k, rows)[:, :-shape[1]] for k in range(rows, y.shape[1])])
    bound = EPS * hankel.shape[1] * condition(hankel, rows * shape[1] + shape[0])
    true, found, wanted = (pulse_response(*matrices[:4], 30) for matrices in (
        system, matrices_of(model, -1), by_n4sid(("exact", shape), *shape)))
    assert largest(found - true, true) <= bound
    return largest(found - wanted, wanted), bound


def eigenvalues_of_n4sid(shape):
    system, u, y = exact_case(shape)
    model = tokid.identify(u, y, period="invariant", initial_state="unknown", nominal="none")
    found, wanted = (np.sort_complex(np.linalg.eigvals(matrices[0])) for matrices in (
        matrices_of(model, -1), by_n4sid(("exact", shape), *shape)))
    # That of the pulse responses, and what the theorem of Bauer and Fike makes of it.
    return largest(found - wanted, wanted), pulses_of_n4sid(shape)[1] * np.linalg.cond(np.linalg.eig(system[0])[1])


def markov_parameters():
    """All of one record from rest, whose inputs are equations for as many parameters as there are steps."""
    rng = np.random.default_rng(3)
    *system, gain = *system_of(2, 1, 1, rng), np.zeros((2, 1))
    u = rng.normal(size=(1, 30, 1))
    u[0, 0] = 5.0  # these equations are triangular, with this diagonal
    y = predicted(*system, gain, u, np.zeros((1, 30, 1)))
    model = tokid.identify(u, y, period="invariant", initial_state="zero", nominal="none")
    wanted = control.markov(y[0].T, u[0].T)
    found = pulse_response(*matrices_of(model, -1)[:4], 30)[0, 0]
    return largest(found - wanted, wanted), EPS * 30 * condition(scipy.linalg.toeplitz(u[0, :, 0], np.zeros(30)))


@functools.cache
def pulse_experiments():
    """A pulse on each input, as ensemble; the realisation of them by ERA; how that is conditioned."""
    rng = np.random.default_rng(4)
    system = system_of(4, 2, 3, rng)
    u = np.zeros((2, 30, 2))
    u[[0, 1], 0, [0, 1]] = 1.0
    y = predicted(*system, np.zeros((4, 3)), u, np.zeros((2, 30, 3)))
    realised, s = control.eigensys_realization(y.transpose(2, 0, 1), 4, m=6, n=6)
    return system, (u, y), realised, EPS * len(s) * s[0] / s[3]


def era_of_pulses():
    _, (u, y), realised, bound = pulse_experiments()
    model = tokid.identify(u, y, period="invariant", initial_state="zero", nominal="none")
    assert model.states == 4
    found, wanted = (pulse_response(*matrices, 30) for matrices in (
        matrices_of(model, -1)[:4], (realised.A, realised.B, realised.C, realised.D)))
    return largest(found - wanted, wanted), bound


def era_of_repeated_experiments():
    """The generalised realisation of a system that does not vary: every step is that of ERA."""
    system, _, realised, bound = pulse_experiments()
    u, y = experiments(system, 40, 30, np.random.default_rng(5), start=0.0)
    model = tokid.identify(u, y, initial_state="zero", nominal="none", method="tvera")
    found, wanted = (np.sort_complex(np.linalg.eigvals(a)) for a in (model.A[15], realised.A))
    return largest(found - wanted, wanted), bound * np.linalg.cond(np.linalg.eig(system[0])[1])


def shape_in_words(states, inputs, outputs):
    return f"{states} states, {inputs} input{'s'[:inputs > 1]}, {outputs} output{'s'[:outputs > 1]}"


EXACT = {
    ("GTV-ARX coefficients of all steps, with noise", "`scipy.linalg.lstsq`"): all_coefficients,
    ("Covariances of the residuals", "`numpy.linalg.lstsq`"): residual_covariances,
    ("Pulse responses by the method of the paper, with noise", "[numpy_tokid.py](../bench/numpy_tokid.py)"):
        whole_method,
    ("ARX coefficients of six records, with noise", "`arx`"): arx_coefficients,
    **{(f"{what} of five records, {shape_in_words(*shape)}", "`n4sid`"): functools.partial(compare, shape)
       for shape in EXACT_SHAPES
       for what, compare in (("Pulse responses", pulses_of_n4sid), ("Eigenvalues", eigenvalues_of_n4sid))},
    ("30 Markov parameters of one record", "`control.markov`"): markov_parameters,
    ("Pulse responses of pulse experiments", "`control.eigensys_realization`"): era_of_pulses,
    ("Eigenvalues of one step by TVERA", "`control.eigensys_realization`"): era_of_repeated_experiments,
}


@pytest.mark.parametrize("name", EXACT, ids=" by ".join)
def test_agrees_to_rounding(name):
    difference, bound = EXACT[name]()
    assert 0 < bound < 1e-9
    assert difference <= bound


# ---- what need not agree: errors on fresh experiments ----


def root_mean_squares(matrices, u, y):
    """Of simulations and of predictions by one step, outputs over their standard deviations."""
    *system, gain = matrices
    gains = (np.zeros_like(gain), gain)
    return np.array([np.sqrt(np.mean(((predicted(*system, g, u, y) - y) / y.std((0, 1))) ** 2)) for g in gains])


@functools.cache
def excess(case):
    """[%] What tokid and n4sid lose to the true system and its Kalman filter, (tokid, n4sid) x (simulation, one step).

    And what is expected: of an efficient estimate of d parameters from M samples the mean square is larger by d / M.
    """
    truth, (u, y), fresh = noisy_case(case)
    states, inputs, outputs = case[1:]
    model = tokid.identify(u, y, period="invariant", initial_state="unknown", nominal="none", states=states)
    best, *found = (root_mean_squares(matrices, *fresh) for matrices in (
        truth, matrices_of(model, -1), by_n4sid(("noisy", case), *case[1:])))
    parameters = states * (inputs + 2 * outputs) + outputs * inputs
    return 100 * (np.array(found) / best - 1), 100 * parameters / (2 * y.size)


@pytest.mark.parametrize("case", NOISY_CASES, ids=str)
def test_not_worse_than_n4sid_with_noise(case):
    (tokid_s, n4sid_s), expected = excess(case)
    # Two efficient estimates may differ by as much as either is expected to lose.
    assert (tokid_s <= n4sid_s + expected).all()


def test_better_than_n4sid_on_the_whole():
    tokid_s, n4sid_s = np.median([excess(case)[0] for case in NOISY_CASES], axis=0)
    assert (tokid_s <= n4sid_s).all()


# ---- docs/agreement.md ----


def tables():
    """Name and lines of each."""
    versions = octave()["versions"]
    yield "programs", ["| program | version |", "| --- | --- |", *(f"| {name} | {version} |" for name, version in [
        ("tokid", tokid.__version__), ("GNU Octave", versions["octave"]), ("its control package", versions["control"]),
        ("NumPy", np.__version__), ("SciPy", scipy.__version__), ("python-control", control.__version__)])]
    results = [(*name, *compare()) for name, compare in EXACT.items()]
    yield "exact", ["| result of tokid | other program | largest difference | bound |", "| --- | --- | ---: | ---: |",
                    *(f"| {what} | {other} | {found:.1e} | {bound:.1e} |" for what, other, found, bound in results)]
    rows = [(shape_in_words(*case[1:]), *excess(case)[0].T.ravel(), excess(case)[1]) for case in NOISY_CASES]
    rows.append(("median", *np.median([row[1:] for row in rows], axis=0)))
    yield "noisy", ["| system | simulation: tokid | simulation: n4sid | one step: tokid | one step: n4sid | expected |",
                    "| --- | ---: | ---: | ---: | ---: | ---: |",
                    *(" | ".join([f"| {name}", *(f"{value:.2f}" for value in values)]) + " |"
                      for name, *values in rows)]


NUMBER = re.compile(r"-?\d+\.\d+(?:e-\d+)?")


def same_bound(shown, found):
    """A difference and its bound: the difference belongs to the machine, whose BLAS rounds in its own way."""
    return len(found) == 2 and found[0] <= found[1] and shown[1] / 10 <= found[1] <= 10 * shown[1]


def same_losses(shown, found):
    """What is lost, in percent: the last digit belongs to the machine."""
    return np.allclose(found, shown, rtol=0.02, atol=0.05)


def alike(shown, found, same):
    """The same words, and numbers that are the same as far as they can be."""
    if NUMBER.sub("#", shown) != NUMBER.sub("#", found):
        return False
    shown, found = ([float(number) for number in NUMBER.findall(line)] for line in (shown, found))
    return not shown or same(shown, found)


@pytest.mark.parametrize(("found", "same"), [
    ("3.5e-15 | 5.7e-14", True), ("5.6e-14 | 5.7e-14", True), ("4.0e-17 | 5.7e-14", True), ("3.5e-15 | 5.6e-13", True),
    ("5.8e-14 | 5.7e-14", False), ("3.5e-15 | 5.8e-13", False), ("3.5e-15 | 5.6e-15", False), ("3.5e-15", False)])
def test_exact_figures_are_compared_by_their_bounds(found, same):
    assert alike("3.5e-15 | 5.7e-14", found, same_bound) == same


def test_document():
    text = updated = DOCUMENT.read_text(encoding="utf-8")
    for name, lines in tables():
        table = re.search(rf"(<!-- table: {name} -->\n)(.*?)<!-- end -->", updated, re.DOTALL)
        if os.environ.get("TOKID_UPDATE_DOCS") == "1":
            updated = "\n".join([updated[:table.end(1)] + lines[0], *lines[1:], updated[table.end(2):]])
        elif name != "programs":
            for shown, found in zip_longest(table[2].splitlines(), lines, fillvalue=""):
                assert alike(shown, found, same_bound if name == "exact" else same_losses), f"shown: {shown}\nfound: {found}"
    if updated != text:
        DOCUMENT.write_text(updated, encoding="utf-8")
        pytest.skip("docs/agreement.md written anew")
