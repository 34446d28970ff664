# SPDX-License-Identifier: BSD-3-Clause
"""tokid export: the C code, compiled and run, against `tokid predict` and recursions in NumPy.

TOKID_EXPORT_MODELS in the environment is the number of random models of test_random_models, which prints the worst
differences with `-s`.
"""

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from conftest import ROOT
import support

STRICT = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]
OK, EARLY, ENDED, BAD_SAMPLE, OVERFLOW = range(5)
EPSILON = {"double": np.finfo(float).eps, "float": np.finfo(np.float32).eps}


def compiled(folder, sources, *flags, compiler="gcc"):
    """The functions of the sources, which the other compiler has to accept, too."""
    for program in ("gcc", "clang"):
        if not shutil.which(program):
            pytest.fail(f"{program} not found. On Debian: gcc clang")
    library = folder / f"{Path(sources[0]).stem}{len(list(folder.glob('*.so')))}.so"  # a process loads a name once
    sources, other = list(map(str, sources)), {"gcc": "clang", "clang": "gcc"}[compiler]
    subprocess.run([other, *STRICT, "-fsyntax-only", *sources], check=True)
    subprocess.run([compiler, *STRICT, *(flags or ["-O2"]), "-shared", "-fPIC", *sources, "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


class Code:
    """The functions of an exported model."""

    def __init__(self, library, name, model, precision="double"):
        self.type = np.dtype(precision if precision == "double" else "float32")
        self.states, (self.outputs, _) = max(model["A"].shape[-1], 1), model["C"].shape[1:]
        self.inputs = model["B"].shape[-1]
        self._init, self._step = library[f"{name}_init"], library[f"{name}_step"]
        self._control = getattr(library, f"{name}_control", None)
        self.memory = np.zeros(4096, np.uint8)
        self.prediction, self.innovation = np.empty((2, self.outputs), self.type)
        self.reset()

    def reset(self):
        self.memory[:] = 255
        self._init(self.pointer(self.memory))

    @staticmethod
    def pointer(array):
        return ctypes.c_void_p(array.ctypes.data)

    @property
    def x(self):
        return self.memory.view(self.type)[:self.states]

    def step(self, u, y):
        self.prediction[:] = self.innovation[:] = 77
        u, y = np.ascontiguousarray(u, self.type), np.ascontiguousarray(y, self.type)
        return self._step(*map(self.pointer, (self.memory, u, y, self.prediction, self.innovation)))

    def control(self):
        u = np.full(self.inputs, 77, self.type)
        return self._control(self.pointer(self.memory), self.pointer(u)), u

    def predict(self, u, y):
        """(T, m), NaN where the status is not OK."""
        found = np.full(y.shape, np.nan)
        for k in range(len(y)):
            if self.step(u[k], y[k]) == OK:
                found[k] = self.prediction
        return found


def random_model(rng, kind, n, m, r, steps=24):
    """A model with an observer whose state error decays. `kind`: varying, periodic, invariant or dimensions."""
    count = {"invariant": 1, "periodic": 5}.get(kind, steps)
    dims, empty = np.full(count + 1, n), False
    if kind == "dimensions":
        empty = rng.random() < 0.5  # begins with no state
        dims = np.minimum(np.arange(count + 1) + (not empty), n)
        dims[count // 2] = max(n - 1, 0)
    A = 0.9 * np.linalg.qr(rng.standard_normal((count, n, n)))[0]
    model = {"A": A, "B": rng.standard_normal((count, n, r)), "C": rng.standard_normal((count, m, n)),
             "D": rng.standard_normal((count, m, r)), "G": 0.05 * rng.standard_normal((count, n, m)), "dt": 0.1}
    # |A + G C| must stay below 1, so that neither the states nor the rounding errors grow
    for s in range(count):
        model["G"][s] *= min(1.0, 0.05 / max(np.linalg.norm(model["G"][s] @ model["C"][s], 2), 1e-9))
    for s in range(count):
        for name in "ABG":
            model[name][s, dims[s + 1]:] = 0
        for name in "AC":
            model[name][s, :, dims[s]:] = 0
    model["state_dim"] = dims
    model["k_begin"] = 0
    if kind in ("periodic", "invariant"):
        model["period"] = count
    elif not empty and rng.random() < 0.3:
        model["k_begin"] = 3
    if rng.random() < 0.7:
        root = rng.standard_normal((count, m, m))
        model["innovation_cov"] = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(m)
    if rng.random() < 0.7:
        nominal = int(rng.integers(1, steps))
        if kind not in ("periodic", "invariant"):
            nominal = model["k_begin"] + count
        model["u_nominal"], model["y_nominal"] = rng.standard_normal((nominal, r)), rng.standard_normal((nominal, m))
    model["initial_state"] = "zero"
    if model["k_begin"] > 0 or (not empty and rng.random() < 0.5):
        model["initial_state"] = "unknown"
        model["x0_mean"], model["x0_cov"] = rng.standard_normal(dims[0]), np.eye(dims[0])
    return model


def grid():
    for kind in ("varying", "periodic", "invariant", "dimensions"):
        for n in range(1, 9):
            for m in range(1, 4):
                for r in range(1, 4):
                    yield kind, n, m, r


def test_random_models(tokid, tmp_path):
    """Equal to the predictions of the tool, with missing outputs, within the bound of docs/how-to/deploy.md and of the header: eps x
    number of products x size. The observer's state error decays by at least 5 % in each step, so the sum of the rounding
    errors of all steps is at most 1 / (1 - 0.95) = 20 steps' worth."""
    rng = np.random.default_rng(31)
    sizes = list(grid())
    count = int(os.environ.get("TOKID_EXPORT_MODELS", "24"))
    steps, worst = 30, {"double": 0.0, "float": 0.0}
    relative = {"double": 0.0, "float": 0.0}
    jobs = []
    for i in range(count):
        kind, n, m, r = sizes[i * 37 % len(sizes)]  # 37 is prime to the number of sizes
        model = random_model(rng, kind, n, m, r)
        file = tmp_path / f"m{i}.npz"
        np.savez(file, **model)
        u, y = rng.standard_normal((1, steps, r)), rng.standard_normal((1, steps, m))
        if i % 2:
            y[rng.random(y.shape) < 0.2] = np.nan
        np.savez(tmp_path / f"d{i}.npz", u=u, y=y, dt=0.1, initial_state=model["initial_state"])
        tokid("predict", file, tmp_path / f"d{i}.npz", "-o", tmp_path / f"p{i}.npz")
        for precision, flag in (("double", []), ("float", ["--float"])):
            tokid("export", file, "-o", tmp_path / f"{precision}{i}.c", *flag)
        jobs.append((model, u[0], y[0], np.load(tmp_path / f"p{i}.npz")["y"][0]))
    compared = 0
    for begin in range(0, count, 25):
        for precision in worst:
            names = {i: f"{precision}{i}" for i in range(begin, min(begin + 25, count))}
            library = compiled(tmp_path, [tmp_path / f"{name}.c" for name in names.values()], "-O1")
            for i, name in names.items():
                model, u, y, expected = jobs[i]
                found = Code(library, name, model, precision).predict(u, y)
                assert np.array_equal(np.isnan(found), np.isnan(expected)), name
                assert not np.isnan(expected).all(), name
                varies = len(set(model["state_dim"])) > 1
                assert ("number of states varies" in (tmp_path / f"{name}.h").read_text()) == varies
                compared += np.sum(~np.isnan(expected))
                n, (m, r) = model["A"].shape[-1], (y.shape[1], u.shape[1])
                size = max(np.nanmax(np.abs(v)) for v in (expected, y, u))
                error = np.nanmax(np.abs(found - expected))
                worst[precision] = max(worst[precision], error / np.nanmax(np.abs(expected)))
                relative[precision] = max(relative[precision], error / size / EPSILON[precision])
                share = 20 * (n + m + r) * EPSILON[precision] * max(1, np.abs(model["C"]).sum(-1).max())
                assert error <= share * size, (name, error, share)
                header = (tmp_path / f"{name}.h").read_text()
                assert f"max(1, |C|) = {share:.1e} times" in header
                assert "This model meets it: the largest |A + G C| is 0." in header
    print(f"\n{count} models, {compared} predictions: worst difference relative to the largest output {worst}, in eps "
          f"{relative}")
    assert worst["double"] <= 1e-12
    assert worst["float"] > 1e-9  # it is float


@pytest.fixture(scope="module")
def folder(tokid, tmp_path_factory):
    return support.identified(tokid, tmp_path_factory.mktemp("export"), 40)


def save(folder, model, **changes):
    model = {name: value for name, value in {**model, **changes}.items() if value is not None}
    np.savez(folder / "changed.npz", **model)
    return folder / "changed.npz"


def test_status_of_steps(tokid, folder):
    rng = np.random.default_rng(1)
    model = random_model(rng, "varying", 3, 2, 2, steps=6)
    model.update(k_begin=2, initial_state="unknown", x0_mean=np.array([1.0, -2.0, 0.5]), x0_cov=np.eye(3),
                 u_nominal=rng.standard_normal((8, 2)), y_nominal=rng.standard_normal((8, 2)))
    tokid("export", save(folder, model), "-o", folder / "status.c")
    code = Code(compiled(folder, [folder / "status.c"]), "status", model)
    u, y = rng.standard_normal((9, 2)), rng.standard_normal((9, 2))
    assert np.array_equal(code.x, model["x0_mean"])
    for k in range(2):
        assert code.step(u[k], y[k]) == EARLY and np.all(code.prediction == 77)
        assert np.array_equal(code.x, model["x0_mean"])
    for bad_u, bad_y in ([np.nan, 0], [0, 0]), ([0, np.inf], [0, 0]), ([0, 0], [-np.inf, 0]):
        before = code.memory.copy()
        assert code.step(bad_u, bad_y) == BAD_SAMPLE and np.array_equal(before, code.memory)
        assert np.all(code.prediction == 77)
    for k in range(2, 8):
        assert code.step(u[k], y[k]) == OK
        assert np.allclose(code.innovation, y[k] - code.prediction, rtol=0, atol=1e-14)
    before = code.memory.copy()
    assert code.step(u[8], y[8]) == ENDED and np.array_equal(before, code.memory)
    code.reset()
    assert np.array_equal(code.x, model["x0_mean"]) and code.step(u[0], y[0]) == EARLY
    # null pointers
    code.step(u[1], y[1])
    assert code._step(*map(code.pointer, (code.memory, u[2], y[2])), None, None) == OK


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("kind", ["varying", "dimensions"])
def test_overflow(tokid, folder, kind, precision):
    """Whatever the samples are: with OK everything is finite, with OVERFLOW the state is as it was, and another try of
    the same step goes on as if nothing had happened."""
    rng = np.random.default_rng(6)
    model = random_model(rng, kind, 4, 3, 2)
    root = rng.standard_normal((24, 3, 3))
    model.update(k_begin=0, initial_state="zero", x0_mean=None, x0_cov=None,
                 innovation_cov=root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3),
                 u_nominal=rng.standard_normal((24, 2)), y_nominal=rng.standard_normal((24, 3)))
    file, name = save(folder, model), f"large_{kind}_{precision}"
    tokid("lqr", file, "--input-weight", 1e-4, "--input-rate-weight", 1e-4, "-o", folder / "c.npz")  # large gains
    tokid("export", file, "--controller", folder / "c.npz", "-o", folder / f"{name}.c",
          *(["--float"] if precision == "float" else []))
    library = compiled(folder, [folder / f"{name}.c"])
    tried, plain = (Code(library, name, model, precision) for _ in range(2))
    largest, seen = float(np.finfo(tried.type).max), set()
    for k in range(24):
        status, u = tried.control()
        assert status == OK and np.isfinite(u).all()
        for _ in range(8):
            large = [rng.choice([0, 0.1, 1], size) * largest * rng.choice([-1, 1], size) for size in (2, 3)]
            large[1][rng.random(3) < 0.3] = np.nan
            before = tried.memory.copy()
            status = tried.step(*large)
            seen.add(status)
            if status == OVERFLOW:
                assert np.array_equal(tried.memory, before)
                assert np.all(tried.prediction == 77) and np.all(tried.innovation == 77)
                continue
            assert status == OK and np.isfinite(tried.x).all() and np.isfinite(tried.prediction).all()
            assert np.array_equal(np.isnan(tried.innovation), np.isnan(large[1]))
            assert not np.isinf(tried.innovation).any()
            tried.memory[:] = before
            tried.x[:] = largest * rng.uniform(-1, 1, 4)
            status, u = tried.control()
            seen.add(("control", status))
            assert np.isfinite(u).all() and status in (OK, OVERFLOW)
            if status == OVERFLOW:
                assert np.array_equal(u, model["u_nominal"][k].astype(tried.type))
            tried.memory[:] = before
        u, y = rng.standard_normal(2), rng.standard_normal(3)
        assert tried.step(u, y) == plain.step(u, y) == OK
        assert np.array_equal(tried.memory, plain.memory) and np.array_equal(tried.prediction, plain.prediction)
    assert seen == {OK, OVERFLOW, ("control", OK), ("control", OVERFLOW)}


def test_missing_outputs(tokid, folder):
    """Missing innovations are S_qo S_oo^-1 e_o, or zero without a covariance; they are NaN in the result."""
    rng = np.random.default_rng(2)
    model = random_model(rng, "varying", 3, 3, 1, steps=8)
    root = rng.standard_normal((8, 3, 3))
    model.update(k_begin=0, initial_state="zero", u_nominal=None, y_nominal=None, x0_mean=None, x0_cov=None)
    for covariance in (root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3), None):
        name = "missing" + ("x" if covariance is None else "")
        tokid("export", save(folder, model, innovation_cov=covariance), "-o", folder / f"{name}.c")
        code = Code(compiled(folder, [folder / f"{name}.c"]), name, model)
        x = np.zeros(3)
        for k in range(8):
            u, y = rng.standard_normal(1), rng.standard_normal(3)
            y[[q for q in range(3) if k >> q & 1]] = np.nan
            assert code.step(u, y) == OK
            e = y - model["C"][k] @ x - model["D"][k] @ u
            assert np.allclose(code.innovation, e, rtol=0, atol=1e-13, equal_nan=True)
            q, o = np.isnan(e), ~np.isnan(e)
            e[q] = 0
            if name == "missing" and o.any():
                e[q] = covariance[k][np.ix_(q, o)] @ np.linalg.solve(covariance[k][np.ix_(o, o)], e[o])
            x = model["A"][k] @ x + model["B"][k] @ u - model["G"][k] @ e
            assert np.allclose(code.x, x, rtol=0, atol=1e-12)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_estimates_for_any_units_and_correlations(tokid, folder, precision):
    """Standard deviations from 1e-30 to 1e30, and correlations that differ from one by less than float resolves. The
    state of this model is the innovation.

    A solution of F s = e of the smallest norm, with rows F of the covariance's root, has errors of eps x cond(F) x |s|.
    The correlations themselves are known to the eps of double, and the condition of their matrix is cond(F)^2."""
    rng = np.random.default_rng(7)
    m, steps = 3, 120
    apart = 10.0 ** -rng.integers(0, 9, steps)
    root = np.ones((steps, m, 1)) * rng.standard_normal((steps, 1, m))
    root = root / np.linalg.norm(root, axis=2, keepdims=True) + apart[:, None, None] * rng.standard_normal((steps, m, m))
    units = 10.0 ** rng.integers(-30, 31, (steps, m))
    covariance = units[:, :, None] * (root @ root.transpose(0, 2, 1)) * units[:, None, :]
    covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
    zeros = np.zeros((steps, m, m))
    model = {"A": zeros, "B": zeros[:, :, :1], "C": zeros, "D": zeros[:, :, :1], "G": zeros - np.eye(m), "dt": 0.1,
             "innovation_cov": covariance, "initial_state": "zero", "state_dim": np.full(steps + 1, m), "k_begin": 0}
    name = f"units_{precision}"
    tokid("export", save(folder, model), "-o", folder / f"{name}.c", *(["--float"] if precision == "float" else []))
    code, eps, worst = Code(compiled(folder, [folder / f"{name}.c"]), name, model, precision), EPSILON[precision], 0
    for k in range(steps):
        y = (units[k] * (root[k] @ rng.standard_normal(m))).astype(code.type)
        q = np.isin(np.arange(m), rng.permutation(m)[:1 + k % (m - 1)])
        y[q] = np.nan
        assert code.step([0], y) == OK
        assert np.array_equal(code.x[~q], y[~q])
        deviation = np.sqrt(np.diag(covariance[k]))
        values, vectors = np.linalg.eigh(covariance[k] / np.outer(deviation, deviation))
        F = np.hstack([vectors * np.sqrt(np.maximum(values, 0)), np.sqrt(m * eps) * np.eye(m)])
        s = np.linalg.lstsq(F[~q], y[~q].astype(float) / deviation[~q], rcond=None)[0]
        condition = np.linalg.cond(F[~q])
        error = np.max(np.abs(code.x[q].astype(float) / deviation[q] - F[q] @ s))
        bound = (eps * condition + EPSILON["double"] * condition**2) * np.linalg.norm(s)
        worst = max(worst, error / bound)
    print(f"\nworst error of an estimate, relative to the bound: {worst}")
    assert worst <= 20  # some ten sums of at most three products
    assert np.sum(apart < 1e-4) > 20


@pytest.mark.parametrize("rates", [False, True])
@pytest.mark.parametrize("kind", ["varying", "periodic", "invariant", "dimensions"])
def test_controller(tokid, folder, kind, rates):
    rng = np.random.default_rng(3)
    model = random_model(rng, kind, 3, 2, 2)
    model.update(k_begin=0, initial_state="zero", x0_mean=None, x0_cov=None,
                 u_nominal=rng.standard_normal((24, 2)), y_nominal=rng.standard_normal((24, 2)))
    for begin, end in ((0, 20), (4, 24)):
        file = save(folder, model)
        tokid("lqr", file, "--begin", begin, "--end", end, "-o", folder / "c.npz",
              *(["--input-rate-weight", 0.3] if rates else []))
        law = dict(np.load(folder / "c.npz"))
        law["feedforward"] = rng.standard_normal((end - begin, 2))
        if begin > 0:
            np.savez(folder / "c.npz", **law)
        else:
            law["feedforward"][:] = 0
        name = f"{kind}{rates}{begin}"
        tokid("export", file, "--controller", folder / "c.npz", "-o", folder / f"{name}.c")
        code = Code(compiled(folder, [folder / f"{name}.c"]), name, model)
        previous, end_of_model = np.zeros(2), 30 if "period" in model else 24
        for k in range(30):
            nominal = model["u_nominal"][k] if k < 24 else None
            status, u = code.control()
            if k >= end_of_model:
                assert status == ENDED and np.all(u == 77)
                break
            if begin <= k < end:
                s = k - begin
                states = law["state_dim"][s]
                expected = law["feedforward"][s] - law["controller_gain"][s][:, :states] @ code.x[:states]
                if rates:
                    expected -= law["input_gain"][s] @ previous
                assert status == OK and np.allclose(u, nominal + expected, rtol=1e-12, atol=1e-12)
            else:
                assert status == (EARLY if k < begin else ENDED)
                if nominal is not None:
                    assert np.array_equal(u, nominal)
            u = np.clip(u, -2, 2)  # the law continues from the inputs that were applied
            if nominal is not None:
                previous = u - nominal if k >= begin else np.zeros(2)
            assert code.step(u, rng.standard_normal(2)) == OK


COUNTER = r"""
struct Counted {
  double value; static long mul, add, div;
  Counted(double v = 0) : value(v) {}
  operator double() const { return value; }
  Counted& operator+=(Counted b) { ++add; value += b.value; return *this; }
  Counted& operator-=(Counted b) { ++add; value -= b.value; return *this; }
  Counted& operator/=(Counted b) { ++div; value /= b.value; return *this; }
};
long Counted::mul = 0; long Counted::add = 0; long Counted::div = 0;
static Counted operator*(Counted a, Counted b) { ++Counted::mul; return a.value * b.value; }
static Counted operator+(Counted a, Counted b) { ++Counted::add; return a.value + b.value; }
static Counted operator-(Counted a, Counted b) { ++Counted::add; return a.value - b.value; }
static Counted operator/(Counted a, Counted b) { ++Counted::div; return a.value / b.value; }
static Counted operator*(double a, Counted b) { return Counted(a) * b; }
static bool operator==(Counted a, Counted b) { return a.value == b.value; }
static bool operator>(Counted a, int b) { return a.value > b; }
static bool operator>=(Counted a, double b) { return a.value >= b; }
static bool operator<=(Counted a, double b) { return a.value <= b; }
"""
COUNTS = r"""
extern "C" void counts(int missing, int control, long *found) { /* bit j of `missing`: output j is missing */
  counted_state state; Counted u[4] = {1, 2, 3, 4}, y[4] = {1, 2, 3, 4}, p[4], e[4];
  counted_init(&state);
  for (int j = 0; j < 4; ++j) if (missing >> j & 1) y[j] = NAN;
  for (int k = 0; k < 4; ++k) counted_step(&state, u, y, p, e);
  Counted::mul = Counted::add = Counted::div = 0;
  if (control) CONTROL; else counted_step(&state, u, y, p, e);
  found[0] = Counted::mul; found[1] = Counted::add; found[2] = Counted::div; found[3] = sizeof(state);
}
"""


@pytest.mark.parametrize("nominal", [False, True])
@pytest.mark.parametrize("n, m, r", [(4, 2, 2), (3, 3, 1), (5, 1, 3), (2, 4, 2)])
def test_operations_are_those_that_run(tokid, folder, n, m, r, nominal):
    """The code, compiled as C++ with numbers that count."""
    rng = np.random.default_rng(4)
    model = random_model(rng, "varying", n, m, r)
    model.update(k_begin=0, initial_state="zero", x0_mean=None, x0_cov=None, u_nominal=None, y_nominal=None,
                 innovation_cov=np.eye(m) + 0.5 * np.ones((24, m, m)))
    if nominal:
        model.update(u_nominal=rng.standard_normal((24, r)), y_nominal=rng.standard_normal((24, m)))
    tokid("lqr", save(folder, model), "--input-rate-weight", 1, "-o", folder / "c.npz")
    report = tokid.json("export", folder / "changed.npz", "--controller", folder / "c.npz", "-o", folder / "counted.c")
    header, source = (folder / "counted.h").read_text(), (folder / "counted.c").read_text()
    header, replaced = re.subn("typedef double counted_real;", "typedef Counted counted_real;", header)
    source, included = re.subn('#include "counted.h"', lambda _: header, source)
    assert replaced == included == 1
    code = folder / "counted.cpp"
    code.write_text("#include <cmath>\n#include <cfloat>\n" + COUNTER + source +
                    COUNTS.replace("CONTROL", "counted_control(&state, u)"))
    library = folder / f"counted{n}{m}{r}{nominal}.so"
    subprocess.run(["g++", "-w", "-fpermissive", "-shared", "-fPIC", code, "-o", library], check=True)
    counts = ctypes.CDLL(str(library)).counts

    def run(missing, control=0):
        found = (ctypes.c_long * 4)()
        counts(missing, control, found)
        return dict(zip(("multiplications", "additions", "divisions"), found)), found[3]

    plain, size = run(0)
    assert plain == report["operations"] and size > 0
    assert run(0, 1)[0] == report["operations_control"]
    patterns = [run(pattern)[0] for pattern in range(2**m)]  # every set of missing outputs
    for name, most in report["operations_missing"].items():
        assert max(count[name] for count in patterns) == most


def test_sizes_are_those_of_the_object(tokid, folder):
    """Equal steps are stored once: the tables of a periodic model do not grow with its length."""
    rng = np.random.default_rng(5)
    model = random_model(rng, "varying", 4, 2, 2)
    model.update(k_begin=0, initial_state="zero", x0_mean=None, x0_cov=None, u_nominal=None, y_nominal=None,
                 innovation_cov=np.eye(2) + np.zeros((24, 1, 1)))
    same = {name: np.repeat(model[name][:3], 8, axis=0) for name in "ABCDG"}
    for name, changes, stored in (("all", {}, 24), ("few", same, 3), ("one", {name: np.repeat(model[name][:1], 24, 0)
                                                                             for name in "ABCDG"}, 1)):
        for precision in ("double", "float"):
            report = tokid.json("export", save(folder, model, **changes), "-o", folder / f"{name}.c",
                                *(["--float"] if precision == "float" else []))
            assert report["stored_steps"] == stored and report["precision"] == precision
            subprocess.run(["gcc", *STRICT, "-fno-stack-protector", "-c", folder / f"{name}.c", "-o", folder / "size.o"],
                           check=True)
            symbols = subprocess.run(["nm", "-S", folder / "size.o"], capture_output=True, text=True, check=True).stdout
            assert sum(int(line.split()[1], 16) for line in symbols.splitlines() if re.search(" r ", line)) == \
                report["table_bytes"]
            assert not re.search(" U ", symbols)  # calls nothing
            header = (folder / f"{name}.h").read_text()
            assert f"Tables: {report['table_bytes']} bytes" in header
            assert f"State: {report['state_bytes']} bytes" in header
            test = folder / f"size_{name}_{precision}.c"
            test.write_text(f'#include "{name}.h"\nint size(void) {{ return (int)sizeof({name}_state); }}\n')
            assert compiled(folder, [test]).size() == report["state_bytes"]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("flags", [["-O0"], ["-O2"], ["-O3", "-march=native"]])
def test_identified_model(tokid, folder, flags, compiler):
    """A model of noisy data, exported from all formats, compiled in the strictest way."""
    tokid("predict", folder / "model.npz", folder / "data.npz", "-o", folder / "predicted.npz")
    data, expected = np.load(folder / "data.npz"), np.load(folder / "predicted.npz")["y"]
    texts = set()
    for extension in ("npz", "h5", "mat"):
        tokid("convert", folder / "model.npz", folder / f"copy.{extension}")
        tokid("export", folder / f"copy.{extension}", "-o", folder / "plain.c", "--name", "my_plant")
        texts.add((folder / "plain.c").read_text())
    assert len(texts) == 1
    library = compiled(folder, [folder / "plain.c"], *flags, compiler=compiler)
    model = support.load(folder / "model.npz")
    for n in range(5):
        found = Code(library, "my_plant", model).predict(data["u"][n], data["y"][n])
        support.assert_close(found, expected[n], 1e-12)


def test_the_header_says_if_rounding_errors_may_exceed_the_bound(tokid, folder):
    model = random_model(np.random.default_rng(3), "varying", 3, 2, 2, steps=6)
    model["A"][4] *= 1.3
    closed = model["A"] + model["G"] @ model["C"]
    tokid("export", save(folder, model), "-o", folder / "slow.c")
    header = " ".join((folder / "slow.h").read_text().split())
    largest = max(np.linalg.norm(step, 2) for step in closed)
    assert largest > 0.95
    assert f"does not meet it: the largest |A + G C| is * {largest:.3g}. Rounding errors may" in header


def test_flags_that_ignore_missing_samples_are_refused(tokid, folder):
    tokid("export", folder / "model.npz", "-o", folder / "fast.c")
    for compiler in ("gcc", "clang"):
        for flag in ("-ffast-math", "-ffinite-math-only"):
            done = subprocess.run([compiler, flag, "-fsyntax-only", folder / "fast.c"], stderr=subprocess.PIPE, text=True, check=False)
            assert done.returncode != 0
            assert "Missing samples are NaN, which -ffast-math" in done.stderr
        subprocess.run([compiler, "-O3", "-fno-finite-math-only", "-fsyntax-only", folder / "fast.c"], check=True)


def test_names_in_comments(tokid, folder):
    """Names that would end a comment, or that a compiler warns of, do no harm."""
    model = support.load(folder / "model.npz")
    names = ["a */ int x; /* b", "tri??/graph \\"]
    file = save(folder, model, input_names=names, output_names=["\u202eturned", "gr\u00fcn"],
                input_units=["N", ""], output_units=["m\\", "rad"])
    tokid("export", file, "-o", folder / "names.c")
    compiled(folder, [folder / "names.c"])
    header = (folder / "names.h").read_text()
    assert "y[1]  gr\u00fcn [rad]" in header and "u[0]  a * / int x; / * b [N]" in header


def test_names_that_differ_in_case(tokid, folder):
    """A program can include both headers."""
    for file, name in (("one", "plant"), ("two", "Plant"), ("three", "plant_H")):
        tokid("export", folder / "model.npz", "--name", name, "-o", folder / f"{file}.c")
    (folder / "all.c").write_text(
        '#include "one.h"\n#include "two.h"\n#include "three.h"\n#include "one.h"\n'
        "int sizes(void) { return plant_states + 10 * Plant_states + 100 * plant_H_states; }\n")
    assert compiled(folder, [folder / f"{file}.c" for file in ("all", "one", "two", "three")]).sizes() == 444


@pytest.mark.parametrize("name", ["1st", "a b", "_x", "x-y", "x;y", "gr\u00fcn", "x" * 65])
def test_bad_names(tokid, folder, name):
    refused = tokid("export", folder / "model.npz", "--name", name, "-o", folder / "no.c", status=2)
    assert refused.stderr.startswith("tokid: name: ") and "needed" in refused.stderr
    assert not (folder / "no.c").exists() and not (folder / "no.h").exists()


def test_refusals(tokid, folder):
    model = support.load(folder / "model.npz")

    def refused(message, *words, output="no.c"):
        stderr = tokid("export", *words, "-o", folder / output, status=2).stderr
        assert message in stderr and not list(folder.glob("no.*")), stderr

    refused("extension '.h' found, .c needed", folder / "model.npz", output="no.h")
    refused("that #include may not accept", folder / "model.npz", output='no"x.c')
    refused("name: '2no' found", folder / "model.npz", output="2no.c")
    refused("model.npz", folder / "model.npz", "--controller", folder / "model.npz")
    refused("unknown initial state", save(folder, model, initial_state="unknown", x0_mean=None, x0_cov=None))
    refused("model: innovation_cov is no covariance at step 0", save(folder, model, innovation_cov=-model["innovation_cov"]))
    refused("in single precision", save(folder, model, B=1e39 * model["B"]), "--float")
    tokid("lqr", folder / "model.npz", "-o", folder / "c.npz")
    law = dict(np.load(folder / "c.npz"))
    save(folder, model, **{name: model[name][:20] for name in ("A", "B", "C", "D", "G", "innovation_cov")},
         state_dim=model["state_dim"][:21], **dict.fromkeys(("Q", "R", "K", "singular_values", "condition", "rank", "lags")))
    refused("model: steps", folder / "changed.npz", "--controller", folder / "c.npz")
    tokid("identify", folder / "data.npz", "-o", folder / "other.npz", "--states", 4, "--frame", "smooth", "--quiet")
    refused("model: other matrices", folder / "other.npz", "--controller", folder / "c.npz")
    law["u_nominal"] = law["u_nominal"] + 1
    np.savez(folder / "c2.npz", **law)
    refused("controller: another nominal input", folder / "model.npz", "--controller", folder / "c2.npz")


def test_start_from_zero(tokid, folder):
    """An unknown initial state counts as zero on demand, and the header says so."""
    model = support.load(folder / "model.npz")
    file = save(folder, model, initial_state="unknown", x0_mean=None, x0_cov=None)
    tokid("export", file, "-o", folder / "zero.c", "--start-from-zero")
    tokid("export", folder / "model.npz", "-o", folder / "known.c", "--name", "zero")
    assert "starts from zero" in (folder / "zero.h").read_text()
    code = [(folder / name).read_text().replace(name[:-2] + ".h", "") for name in ("zero.c", "known.c")]
    assert code[0] == code[1]


def test_files_appear_together(tokid, folder):
    """If the header can't be written, the source is not written either."""
    (folder / "both.h").mkdir()
    tokid("export", folder / "model.npz", "-o", folder / "both.c", status=2)
    assert not (folder / "both.c").exists()


def test_loop_of_the_documents(tokid, tmp_path):
    """The program of docs/how-to/deploy.md closes the loop as the law in NumPy does."""
    page = (ROOT / "docs/how-to/deploy.md").read_text()
    for line in re.findall(r"^\$ tokid (.*)$", page, re.MULTILINE):
        tokid(*line.split(), cwd=tmp_path)
    (tmp_path / "main.c").write_text(re.search(r"^```c\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[1])
    subprocess.run(["gcc", *STRICT, "main.c", "observer.c", "-o", "main"], cwd=tmp_path, check=True)
    y = np.load(tmp_path / "data.npz")["y"][0]
    text = "".join(f"{a!r} {b!r}\n" for a, b in y.tolist())
    shown = subprocess.run([tmp_path / "main"], input=text, capture_output=True, text=True, check=True).stdout
    found = np.array([line.split() for line in shown.splitlines()], float)
    tokid("convert", tmp_path / "model.npz", tmp_path / "model.h5")
    with h5py.File(tmp_path / "model.h5") as model, h5py.File(tmp_path / "controller.h5") as law:
        x, held, expected = np.zeros(4), np.zeros(2), []
        for k in range(60):
            A, B, C, D, G = (model[name][k] for name in "ABCDG")
            held = -law["controller_gain"][k] @ x - law["input_gain"][k] @ held
            expected.append(held)
            x = A @ x + B @ held - G @ (y[k] - C @ x - D @ held)
    support.assert_close(found, np.array(expected), 1e-8)  # nine digits are printed


TARGET = r"""
#include <stdio.h>
#include "target.h"
#ifdef __arm__
extern void _start(void);
static void reset(void)
{
  *(volatile unsigned *)0xE000ED88 |= 0xFu << 20; /* CPACR: switches the floating-point unit on */
  __asm__ volatile("dsb\n isb");
  _start();
}
__attribute__((section(".vectors"), used)) static void (*const vectors[])(void) = {(void (*)(void))0x20400000, reset};
#endif
static const target_real u[STEPS][target_inputs] = { U }, y[STEPS][target_outputs] = { Y };
int main(void)
{
  target_state state;
  target_real prediction[target_outputs], input[target_inputs];
  int k, j;
  target_init(&state);
  for (k = 0; k < STEPS; ++k) {
    if (target_control(&state, input) != target_ok) return 1;
    if (target_step(&state, u[k], y[k], prediction, 0) != target_ok) return 2;
    for (j = 0; j < target_outputs; ++j) printf("%.17g ", (double)prediction[j]);
    for (j = 0; j < target_inputs; ++j) printf("%.17g ", (double)input[j]);
    printf("\n");
  }
  return 0;
}
"""
CORTEX_M4 = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "--specs=rdimon.specs",
             "-Wl,--section-start=.vectors=0"]
EMULATED = ["qemu-system-arm", "-M", "mps2-an386", "-semihosting", "-nographic", "-kernel"]


@pytest.mark.parametrize("precision", ["double", "float"])
def test_on_a_microcontroller(tokid, folder, precision):
    """The same numbers as on this machine, from a Cortex-M4 in QEMU, whose hardware computes with float alone."""
    for program in ("arm-none-eabi-gcc", "qemu-system-arm"):
        if not shutil.which(program):
            pytest.fail(f"{program} not found. On Debian: gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm")
    tokid("lqr", folder / "model.npz", "--input-rate-weight", 0.1, "-o", folder / "c.npz")
    tokid("export", folder / "model.npz", "--controller", folder / "c.npz", "-o", folder / "target.c",
          *(["--float"] if precision == "float" else []))
    data = np.load(folder / "data.npz")
    u, y = data["u"][1], data["y"][1].copy()
    y[5, 0] = y[9] = np.nan

    def table(values):
        rows = (", ".join("0.0 / 0.0" if np.isnan(value) else repr(value) for value in row) for row in values.tolist())
        return ", ".join("{" + row + "}" for row in rows)

    program = TARGET.replace("STEPS", str(len(u)))
    (folder / "main.c").write_text(program.replace("U }", table(u) + " }").replace("Y }", table(y) + " }"))
    shown = []
    for compiler, run in ((["gcc", *STRICT], ["./here"]),
                          (["arm-none-eabi-gcc", *STRICT, *CORTEX_M4], [*EMULATED, "there.elf"])):
        subprocess.run([*compiler, "-O2", "main.c", "target.c", "-o", run[-1]], cwd=folder, check=True)
        result = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=True, timeout=120,
                                stdin=subprocess.DEVNULL)
        shown.append(np.array([line.split() for line in result.stdout.splitlines()], float))
    assert shown[0].shape == (len(u), 4) and np.isfinite(shown[0]).all()
    # Fused products may round differently: a few units in the last place for each of at most 8 products
    support.assert_close(shown[1], shown[0], 20 * 8 * EPSILON[precision])


TIMED = r"""
#include <stdio.h>
#include <time.h>
#include "timed.h"
#define STEPS 40
static double seconds(int control, int missing)
{
  static timed_real y[timed_outputs];
  timed_real u[timed_inputs] = {0}, prediction[timed_outputs];
  timed_state state;
  double least = 1e9, used;
  int attempt, run, k;
  clock_t begin;
  y[0] = missing ? (timed_real)(0.0 / 0.0) : (timed_real)0.1;
  for (attempt = 0; attempt < 7; ++attempt) {
    begin = clock();
    for (run = 0; run < 5000; ++run) {
      timed_init(&state);
      for (k = 0; k < STEPS; ++k) {
        if (control && timed_control(&state, u) != timed_ok) return -1;
        if (timed_step(&state, u, y, prediction, 0) != timed_ok) return -1;
      }
    }
    used = (double)(clock() - begin) / CLOCKS_PER_SEC / 5000 / STEPS;
    if (used < least) least = used;
  }
  return least;
}
int main(void)
{
  printf("%.17g %.17g %.17g\n", seconds(0, 0), seconds(0, 1), seconds(1, 0));
  return 0;
}
"""


@pytest.mark.parametrize("precision", ["double", "float"])
def test_time_of_a_step(tokid, folder, precision):
    """Prints processor times with `-s`. Some 100 operations take less than a microsecond on any machine of today."""
    tokid("lqr", folder / "model.npz", "--input-rate-weight", 0.1, "-o", folder / "c.npz")
    tokid("export", folder / "model.npz", "--controller", folder / "c.npz", "-o", folder / "timed.c",
          *(["--float"] if precision == "float" else []))
    (folder / "main.c").write_text(TIMED)
    subprocess.run(["gcc", *STRICT, "-O2", "main.c", "timed.c", "-o", "timed"], cwd=folder, check=True)
    shown = subprocess.run([folder / "timed"], capture_output=True, text=True, check=True).stdout
    step, missing, control = (1e9 * float(word) for word in shown.split())
    subprocess.run(["arm-none-eabi-gcc", *STRICT, *CORTEX_M4[:4], "-O2", "-c", "timed.c", "-o", "timed.o"], cwd=folder,
                   check=True)
    sizes = subprocess.run(["arm-none-eabi-nm", "-S", folder / "timed.o"], capture_output=True, text=True, check=True).stdout
    code = sum(int(line.split()[1], 16) for line in sizes.splitlines() if re.search(" [tT] ", line))
    print(f"\n{precision}: a step {step:.1f} ns, with a missing output {missing:.1f} ns, with the controller {control:.1f} "
          f"ns; {code} bytes of code for a Cortex-M4")
    assert 0 < step < 1000 and 0 < missing < 1000 and 0 < control < 1000
    assert 0 < code < 4096
