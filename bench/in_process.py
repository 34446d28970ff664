#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""tokid's Python package beside packages that do the same, in one process, on arrays in memory.

    in_process.py numpy EXPERIMENTS STEPS | em | n4sid     [--repetitions R] [--quick] [--octave PROGRAM]

Prints a JSON object. A competitor that is not installed is left out of it, and "missing" says why. Every function is
called once before it is measured, and the functions take turns. One thread, processor seconds and wall time. em and
n4sid have their sizes from docs/performance.md.
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy is loaded

import argparse
import gc
import importlib.metadata
import json
import subprocess
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
import numpy_em
import numpy_tokid
import tokid

HERE = Path(__file__).resolve().parent
LAGS = 2  # of the example, in both
LONG = 10  # [s] of processor time, after which a function is not repeated


def measured(functions, repetitions):
    """{name: {"cpu": [s], "wall": [s]}} of functions without arguments, which take turns and were called before.

    What takes long is repeated less often.
    """
    found = {name: {"cpu": [], "wall": []} for name in functions}
    for _ in range(repetitions):
        for name, function in functions.items():
            if sum(found[name]["cpu"]) > LONG:
                continue
            gc.collect()
            wall, cpu = time.perf_counter(), time.process_time()
            result = function()
            found[name]["cpu"].append(time.process_time() - cpu)
            found[name]["wall"].append(time.perf_counter() - wall)
            del result
    return found


def agree(what, difference, bound):
    if not difference <= bound:
        raise SystemExit(f"{what} differ by {difference:.1e}, at most {bound:.0e} is expected")


def beside_numpy(call):
    """The example without noise, from arrays to a model, with the same lag order."""
    data = tokid.example("oscillator", experiments=call.experiments, steps=call.steps)
    u, y, dt = np.array(data.u, order="C"), np.array(data.y, order="C"), data.dt
    del data

    def by_tokid():
        model = tokid.identify(u, y, dt=dt, lags=LAGS)
        return {name: getattr(model, name) for name in "ABCDG"}

    def validated_by_numpy():
        model = numpy_tokid.model_of(u, y, LAGS)
        return numpy_tokid.validate(model, u, y)

    difference = numpy_tokid.largest_difference(by_tokid(), numpy_tokid.model_of(u, y, LAGS))
    validated_by_numpy()
    agree("pulse responses of tokid and NumPy", difference, 1e-8)
    return {"times": measured({"tokid": by_tokid, "numpy": lambda: numpy_tokid.model_of(u, y, LAGS),
                               "numpy_validated": validated_by_numpy}, call.repetitions),
            "pulse_response_difference": difference, "experiments": call.experiments, "steps": call.steps}


def per_iteration(run, iterations, repetitions):
    """Seconds of one iteration: run(2 K) less run(K), over K, and the same for both."""
    run(1)
    found = measured({"once": lambda: run(iterations), "twice": lambda: run(2 * iterations)}, repetitions)
    return {clock: [(b - a) / iterations for a, b in zip(found["once"][clock], found["twice"][clock])]
            for clock in ("cpu", "wall")}


def dynamax_em(start, v, y):
    """EM of dynamax for a number of iterations, compiled once: what its fit_em does, which compiles at every call."""
    import jax
    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from dynamax.linear_gaussian_ssm import LinearGaussianSSM

    states, outputs, inputs = len(start.F), y.shape[2], v.shape[2]
    ssm = LinearGaussianSSM(states, outputs, inputs, has_dynamics_bias=False, has_emissions_bias=False)
    start = numpy_em.Parameters(*map(jnp.array, start))
    first, properties = ssm.initialize(
        initial_mean=start.mean, initial_covariance=start.cov, dynamics_weights=start.F, dynamics_input_weights=start.B,
        dynamics_covariance=start.Q, emission_weights=start.H, emission_input_weights=start.D,
        emission_covariance=start.R)
    emissions, all_inputs = jnp.array(y.transpose(1, 0, 2)), jnp.array(v.transpose(1, 0, 2))

    @jax.jit
    def iterate(parameters):
        statistics, likelihoods = jax.vmap(lambda e, i: ssm.e_step(parameters, e, i))(emissions, all_inputs)
        following, _ = ssm.m_step(parameters, properties, statistics, None)
        return following._replace(initial=parameters.initial), likelihoods.sum()  # the initial state is known

    def run(iterations):
        parameters, likelihoods = first, []
        for _ in range(iterations):
            parameters, likelihood = iterate(parameters)
            likelihoods.append(likelihood)
        return [float(value) for value in likelihoods]
    return run


def em(call):
    """One iteration of EM with n = 4: N = 50, T = 200 of the example with noise."""
    experiments, steps, iterations = (10, 30, 3) if call.quick else (50, 200, 50)
    data = tokid.example("oscillator", experiments=experiments, steps=steps, seed=1, process_noise=0.02,
                         measurement_noise=0.05)
    varying = tokid.identify(data, states=4, lags=4, smoothing=100.0, method="subspace", refine=False)
    invariant = tokid.identify(data, states=4, lags=4, method="subspace", refine=False, period="invariant")

    def by_tokid(model, smoothing, period, iterations):
        refined = model.refine(data, smoothing=smoothing, period=period, iterations=iterations, tolerance=0.0,
                               accelerate=False, warm_up=False)
        return refined.refinement

    y, u = (np.ascontiguousarray(np.swapaxes(x, 0, 1)) for x in (data.y, data.u))
    v = np.concatenate([np.zeros_like(u[:1]), u[:-1]])  # u_{k-1} moves the state to step k
    rng = np.random.default_rng(1)
    start = numpy_em.Parameters(np.zeros(4), 0.01 * np.eye(4), 0.9 * np.linalg.qr(rng.standard_normal((4, 4)))[0],
                                rng.standard_normal((4, 2)), 0.1 * np.eye(4), rng.standard_normal((2, 4)),
                                np.zeros((2, 2)), 0.1 * np.eye(2))

    def by_numpy(iterations):
        parameters, likelihoods = start, []
        for _ in range(iterations):
            parameters, likelihood = numpy_em.iterate(parameters, v, y)
            likelihoods.append(likelihood)
        return likelihoods

    runs = {"tokid": lambda count: by_tokid(varying, 100.0, None, count),
            "tokid_invariant": lambda count: by_tokid(invariant, np.inf, "invariant", count), "numpy": by_numpy}
    missing = {}
    try:
        runs["dynamax"] = dynamax_em(start, v, y)
        ours, theirs = (np.array(run(2 * iterations)) for run in (by_numpy, runs["dynamax"]))
        # dynamax adds 1e-9 to the diagonals of what it solves.
        agree("log-likelihoods of NumPy and dynamax", np.abs(ours / theirs - 1).max(), 1e-5)
    except ImportError as error:
        missing["dynamax"] = str(error)
    return {"times": {name: per_iteration(run, iterations, call.repetitions) for name, run in runs.items()},
            "missing": missing, "experiments": experiments, "steps": steps, "iterations": iterations}


def records(system, noise, steps, rng):
    """u and y (T, ...) of one record."""
    A, B, C, D = system
    u = rng.standard_normal((steps, B.shape[1]))
    w = noise[0] * rng.standard_normal((steps, len(A)))
    y = u @ D.T + noise[1] * rng.standard_normal((steps, len(C)))
    x = np.zeros(len(A))
    for k in range(steps):
        y[k] += C @ x
        x = A @ x + B @ u[k] + w[k]
    return u, y


def kalman_gain(A, C, Q, R, S):
    """K of the observer x_{k+1} = A x + B u + K (y - C x - D u)."""
    from scipy.linalg import solve_discrete_are
    P = solve_discrete_are(A.T, C.T, Q, R, s=S)
    return np.linalg.solve(C @ P @ C.T + R, (A @ P @ C.T + S).T).T


def one_step_error(A, B, C, D, K, u, y):
    """Root mean square of the errors of one-step prediction, over all outputs."""
    x, squares = np.zeros(len(A)), 0.0
    for input_, output in zip(u, y):
        error = output - C @ x - D @ input_
        squares += error @ error
        x = A @ x + B @ input_ + K @ error
    return float(np.sqrt(squares / y.size))


def nfoursid_model(u, y, states, rows):
    """A, B, C, D and the Kalman gain of the covariances by nfoursid."""
    import pandas
    from nfoursid.nfoursid import NFourSID
    inputs, outputs = ([f"{letter}{i}" for i in range(x.shape[1])] for letter, x in (("u", u), ("y", y)))
    frame = pandas.DataFrame(np.hstack([u, y]), columns=inputs + outputs)
    method = NFourSID(frame, output_columns=outputs, input_columns=inputs, num_block_rows=rows)
    method.subspace_identification()
    model, covariance = method.system_identification(rank=states)
    m = len(outputs)
    R, S, Q = covariance[:m, :m], covariance[m:, :m], covariance[m:, m:]
    return model.a, model.b, model.c, model.d, kalman_gain(model.a, model.c, Q, R, S)


def octave_n4sid(program, u, y, states, repetitions):
    """The model, the times and the versions of n4sid in Octave."""
    from scipy.io import loadmat, savemat
    with tempfile.TemporaryDirectory() as folder:
        files = {"DATA": f"{folder}/data.mat", "ANSWER": f"{folder}/answer.mat"}
        savemat(files["DATA"], {"u": u, "y": y, "order": float(states), "repetitions": float(repetitions)})
        subprocess.run([program, "--no-gui", "--no-init-file", "--no-history", HERE / "n4sid.m"], check=True,
                       env=os.environ | files, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        answer = loadmat(files["ANSWER"], simplify_cells=True)
    model = tuple(np.atleast_2d(answer[name]) for name in "ABCDK")
    times = {clock: np.atleast_1d(answer[clock]).tolist() for clock in ("cpu", "wall")}
    return model, times, answer["versions"]


def n4sid(call):
    """One record of a time-invariant system with noise, whose order is given."""
    steps = 600 if call.quick else 4000
    rng = np.random.default_rng(3)
    A = rng.standard_normal((4, 4))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    system = (A, *(rng.standard_normal(shape) for shape in ((4, 2), (2, 4), (2, 2))))
    noise = (0.3, 1.0)
    (u, y), fresh = (records(system, noise, steps, rng) for _ in range(2))
    covariances = (noise[0]**2 * np.eye(4), noise[1]**2 * np.eye(2), np.zeros((4, 2)))
    truth = (*system, kalman_gain(A, system[2], *covariances))

    def by_tokid(**options):
        model = tokid.identify(u, y, dt=1.0, period="invariant", states=4, **options)
        return (*(getattr(model, name)[-1] for name in "ABCD"), -model.G[-1])

    functions, missing, versions = {"tokid": by_tokid, "tokid_no_refine": lambda: by_tokid(refine=False)}, {}, {}
    try:
        nfoursid_model(u, y, 4, 10)
        functions["nfoursid"] = lambda: nfoursid_model(u, y, 4, 10)
        versions["nfoursid"] = importlib.metadata.version("nfoursid")
    except ImportError as error:
        missing["nfoursid"] = str(error)
    models = {name: function() for name, function in functions.items()}
    times = measured(functions, call.repetitions)
    try:
        models["octave"], times["octave"], found = octave_n4sid(call.octave, u, y, 4, call.repetitions)
        versions["octave"] = f"{found['octave']}, control {found['control']}"
    except (ImportError, OSError, subprocess.CalledProcessError) as error:
        missing["octave"] = getattr(error, "stderr", None) or str(error)
    best = one_step_error(*truth, *fresh)
    excess = {name: one_step_error(*model, *fresh) / best - 1 for name, model in models.items()}
    return {"times": times, "excess": excess, "steps": steps, "missing": missing, "versions": versions}


PARTS = {"numpy": beside_numpy, "em": em, "n4sid": n4sid}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=list(PARTS))
    parser.add_argument("experiments", type=int, nargs="?", default=50)
    parser.add_argument("steps", type=int, nargs="?", default=200)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--octave", default="octave-cli")
    call = parser.parse_args()
    warnings.simplefilter("ignore", tokid.TokidWarning)
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # one core also for packages with threads of their own
    print(json.dumps(PARTS[call.part](call)))


if __name__ == "__main__":
    main()
