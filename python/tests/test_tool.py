# SPDX-License-Identifier: BSD-3-Clause
"""The same data give the same bytes, by the tool and by the package."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import tokid
import tokid.__main__
from tokid import _tokid

pytestmark = pytest.mark.filterwarnings("ignore::tokid.TokidWarning")


def same_bytes(a, b):
    return a.read_bytes() == b.read_bytes()


@pytest.fixture
def files(tmp_path, tool):
    tool("example", "oscillator", "-o", tmp_path / "exact.npz", "--experiments", 40, "--steps", 30)
    noise = ["--process-noise", 0.02, "--measurement-noise", 0.05]
    tool("example", "oscillator", "-o", tmp_path / "noisy.npz", "--experiments", 40, "--steps", 30, "--seed", 3, *noise)
    tool("example", "rotating-tube", "-o", tmp_path / "free.h5", "--experiments", 24, "--steps", 25, "--initial-state",
         "unknown", "--free-responses", 4)
    return tmp_path


def test_examples(files, tmp_path):
    tokid.example("oscillator", experiments=40, steps=30).save(tmp_path / "a.npz")
    assert same_bytes(tmp_path / "a.npz", files / "exact.npz")
    tokid.example("oscillator", experiments=40, steps=30, seed=3, process_noise=0.02, measurement_noise=0.05).save(
        tmp_path / "b.npz"
    )
    assert same_bytes(tmp_path / "b.npz", files / "noisy.npz")
    tokid.example("rotating-tube", experiments=24, steps=25, initial_state="unknown", free_responses=4).save(
        tmp_path / "c.h5"
    )
    assert same_bytes(tmp_path / "c.h5", files / "free.h5")


@pytest.mark.parametrize(
    "name, flags, options",
    [
        ("exact.npz", [], {}),
        ("exact.npz", ["--frame", "smooth", "--hold-out", 0.2], {"frame": "smooth", "hold_out": 0.2}),
        ("exact.npz", ["--states", 3, "--lags", 3, "--method", "tvera", "--nominal", "mean", "--frame", "reference",
                       "--reference-step", 5],
         {"states": 3, "lags": 3, "method": "tvera", "nominal": "mean", "frame": "reference", "reference_step": 5}),
        ("exact.npz", ["--initial-state", "unknown", "--method", "subspace"],
         {"initial_state": "unknown", "method": "subspace"}),
        ("free.h5", [], {}),
        ("noisy.npz", ["--threads", 2], {}),
        ("noisy.npz", ["--no-refine", "--smoothing", 0.3, "--weighting", "many-steps"],
         {"refine": False, "smoothing": 0.3, "weighting": "many-steps"}),
        ("noisy.npz", ["--time-invariant", "--states", 4], {"period": "invariant", "states": 4}),
        ("noisy.npz", ["--period", 15, "--no-refine"], {"period": 15, "refine": False}),
        ("noisy.npz", ["--smoothing", "infinity", "--refine", "--states", 3],
         {"smoothing": np.inf, "refine": True, "states": 3}),
    ],
)
def test_identify(files, tool, name, flags, options):
    report = tool("identify", files / name, "-o", files / "tool.npz", "--json", *flags)
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        model = tokid.identify(tokid.Ensemble.load(files / name), **options)
    model.save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")
    found = model.identification
    told = [_tokid.in_python(text) for text in report["warnings"]]
    assert [str(w.message) for w in issued] == told == list(model.warnings) == found.warnings
    assert {w.category for w in issued} <= {tokid.TokidWarning}
    assert (found.lags, found.min_experiments, found.held_out) == (
        report["lags"], report["min_experiments"], report["evaluated_on"] == "held_out")
    assert found.validation.one_step.fit.tolist() == report["one_step_fit"]
    assert found.validation.simulation.fit.tolist() == report["simulation_fit"]


def test_arrays_give_the_same_as_files(files, tool):
    with np.load(files / "exact.npz") as arrays:
        u, y, dt = arrays["u"], arrays["y"], float(arrays["dt"])
    tool("identify", files / "exact.npz", "-o", files / "tool.npz")
    for order in "CF":
        model = tokid.identify(np.asarray(u, order=order), np.asarray(y, order=order), dt=dt, initial_state="zero")
        asked = tokid.identify(tokid.Ensemble(u, y, dt=dt, initial_state="zero"))
        assert np.array_equal(model.A.stack(), asked.A.stack())
        asked.save(files / "python.npz")
        assert same_bytes(files / "tool.npz", files / "python.npz")


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_files_of_both(files, tool, extension):
    """What Python writes the tool reads, and the other way round."""
    model = tokid.identify(tokid.Ensemble.load(files / "exact.npz"))
    model.save(files / ("python" + extension))
    tool("convert", files / ("python" + extension), files / "back.npz")
    model.save(files / "python.npz")
    assert same_bytes(files / "back.npz", files / "python.npz")
    tool("convert", files / "back.npz", files / ("tool" + extension))
    again = tokid.load(files / ("tool" + extension))
    assert isinstance(again, tokid.Model)
    again.save(files / "again.npz")
    assert same_bytes(files / "again.npz", files / "python.npz")
    tool("convert", files / "free.h5", files / ("converted" + extension))
    ensemble = tokid.load(files / ("converted" + extension))
    assert isinstance(ensemble, tokid.Ensemble)
    ensemble.save(files / "free_again.h5")
    assert same_bytes(files / "free_again.h5", files / "free.h5")


def test_csv_and_mat73(files, tool):
    data = tokid.Ensemble.load(files / "noisy.npz")
    data.save(files / "a.csv")
    tool("convert", files / "noisy.npz", files / "b.csv")
    assert same_bytes(files / "a.csv", files / "b.csv")
    swapped = tokid.load(files / "a.csv", inputs=["y1"], outputs=["u1", "u2"])
    assert isinstance(swapped, tokid.Ensemble)
    assert (swapped.inputs, swapped.outputs, swapped.output_names) == (1, 2, ["u1", "u2"])
    assert np.array_equal(swapped.y, data.u)
    data.save(files / "a.mat", mat73=True)
    assert (files / "a.mat").read_bytes().startswith(b"MATLAB 7.3")


def test_outputs(files, tool):
    data = tokid.Ensemble.load(files / "noisy.npz")
    model = tokid.identify(data, refine=False, hold_out=0.2)
    model.save(files / "model.npz")
    for words, y in [
        (["simulate"], model.simulate(data)),
        (["predict"], model.predict(data)),
        (["predict", "--horizon", 7], model.predict(data, horizon=7)),
    ]:
        tool(words[0], files / "model.npz", files / "noisy.npz", "-o", files / "out.npz", *words[1:])
        with np.load(files / "out.npz") as out:
            assert np.array_equal(out["y"], y, equal_nan=True), words
    unknown = tokid.Ensemble.load(files / "free.h5")
    tube = tokid.identify(unknown, method="subspace")
    tube.save(files / "tube.npz")
    tool("simulate", files / "tube.npz", files / "free.h5", "-o", files / "out.npz", "--estimate-state")
    with np.load(files / "out.npz") as out:
        assert np.array_equal(out["y"], tube.simulate(unknown, estimate_state=True), equal_nan=True)


def test_validate_and_cross_validate(files, tool):
    data = tokid.Ensemble.load(files / "noisy.npz")
    model = tokid.identify(data, refine=False, states=4, lags=3)
    model.save(files / "model.npz")
    told = tool("validate", files / "model.npz", files / "noisy.npz", "--horizon", 5, "--cross-validate", 3, "--json")
    found = model.validate(data, horizon=5)
    cross = model.cross_validate(data, folds=3, horizon=5)
    assert [found.simulation.fit.tolist(), found.one_step.fit.tolist(), found.horizon.fit.tolist()] == [
        told["simulation_fit"], told["one_step_fit"], told["horizon_fit"]]
    assert [found.squares.ratio, found.squares.p, found.whiteness_p, found.independence.p, found.feedback.p] == [
        told["nis"], told["nis_p"], told["whiteness_p"], told["independence_p"], told["feedback_p"]]
    assert (found.whiteness.over, found.first_predicted) == (told["tested_over"], told["first_predicted"])
    assert found.warnings + cross.warnings == told["warnings"]
    assert cross.one_step.fit.tolist() == told["cross_validation"]["one_step_fit"]
    assert cross.horizon_spread.tolist() == told["cross_validation"]["horizon_fit_spread"]
    assert [f.experiments for f in cross.folds] == [f["experiments"] for f in told["cross_validation"]["per_fold"]]
    same = tokid.cross_validate(data, folds=3, horizon=5, refine=False, states=4, lags=3)
    assert same.simulation.fit.tolist() == told["cross_validation"]["simulation_fit"]


def test_refine(files, tool):
    data = tokid.Ensemble.load(files / "noisy.npz")
    model = tokid.identify(data, refine=False, states=4)
    model.save(files / "model.npz")
    told = tool("refine", files / "model.npz", files / "noisy.npz", "-o", files / "tool.npz", "--iterations", 8,
                "--smoothing", 0.1, "--json")
    refined = model.refine(data, iterations=8, smoothing=0.1)
    refined.save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")
    found = refined.refinement
    assert found.log_likelihood.tolist() == told["log_likelihood"]
    assert found.after.simulation.fit.tolist() == told["after"]["simulation_fit"]
    assert (found.reason, found.choice, found.warnings) == ("as asked", None, told["warnings"])
    assert refined.log_likelihood(data).sum() == pytest.approx(found.log_likelihood[-1], rel=1e-6)
    tool("refine", files / "model.npz", files / "noisy.npz", "-o", files / "tool.npz", "--iterations", 3,
         "--period", 1)
    assert not any(d.any() for d in model.refine(data, iterations=1, smoothing=0.1, feedthrough=False).D)
    with pytest.raises(ValueError, match="feedthrough: 'no' found"):
        model.refine(data, feedthrough="no")
    model.refine(data, iterations=3, period="invariant").save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")


def test_confidence(files, tool):
    data = tokid.Ensemble.load(files / "noisy.npz")
    model = tokid.identify(data, states=4, method="tvera", lags=4)
    model.save(files / "model.npz")
    tool("confidence", files / "model.npz", files / "noisy.npz", "-o", files / "tool.npz", "--level", 0.9)
    bounds = model.confidence(data, level=0.9)
    bounds.save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")
    with np.load(files / "tool.npz") as saved:
        for name in saved.files:
            if name == "markov":
                assert np.array_equal(saved[name], bounds.markov.interval.estimate, equal_nan=True)
    assert bounds.replicates == 200 and bounds.markov.interval.lower.shape == (30, bounds.markov.band + 1, 2, 2)
    assert bounds.simulated.estimate.shape == (40, 30, 2)
    spectrum = bounds.spectrum
    assert spectrum.eigenvalues.dtype == complex and spectrum.simple.dtype == bool
    assert spectrum.eigenvalues.shape == spectrum.real.lower.shape == (len(spectrum.simple), 4)
    begin, eigenvalues = model.closed_loop_spectrum()
    assert begin == spectrum.begin
    assert np.allclose(np.sort(np.abs(eigenvalues)), np.sort(np.abs(spectrum.eigenvalues)), atol=1e-9)
    tool("confidence", files / "model.npz", files / "noisy.npz", "-o", files / "tool.npz", "--replicates", 5,
         "--seed", 7, "--band", 3)
    model.confidence(data, replicates=5, seed=7, band=3).save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")


def test_plan(files, tool):
    sizes = ["--states", 4, "--inputs", 2, "--outputs", 2, "--steps", 25]
    told = tool("plan", *sizes, "-o", files / "tool.npz", "--amplitude", "0.5,2", "--noise", "0.01:0.1", "--seed", 4,
                "--json")
    plan = tokid.plan(states=4, inputs=2, outputs=2, steps=25, amplitude=[0.5, 2.0], noise=(0.01, 0.1), seed=4)
    plan.save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")
    assert (plan.minimum, plan.recommended, plan.reasons, plan.kind) == (
        told["minimum"], told["recommended"], told["reasons"], told["kind"])
    assert plan.experiments == told["experiments"] and plan.u.shape == (plan.experiments, 25, 2)
    model = tokid.identify(tokid.Ensemble.load(files / "exact.npz"))
    model.save(files / "model.npz")
    told = tool("plan", "--model", files / "model.npz", "-o", files / "tool.npz", "--experiments", 15, "--kind", "binary",
                "--json")
    plan = tokid.plan(model, experiments=15, kind="binary")
    plan.save(files / "python.npz")
    assert same_bytes(files / "tool.npz", files / "python.npz")
    assert plan.output_peak.tolist() == told["output_peak"] and plan.rank == told["rank"]


def test_update(files, tool):
    first, more = tokid.Ensemble.load(files / "noisy.npz").split(0.25)
    first.save(files / "first.npz")
    more.save(files / "more.npz")
    tool("identify", files / "first.npz", "-o", files / "model.npz", "--no-refine", "--state", files / "tool.h5")
    before = tokid.identify(first, refine=False, keep_state=True)
    before.state.save(files / "python.h5")
    assert same_bytes(files / "tool.h5", files / "python.h5")
    told = tool("update", files / "tool.h5", files / "more.npz", "-o", files / "all.npz", "--json")
    after = tokid.update(before.state, more)
    after.save(files / "python.npz")
    assert same_bytes(files / "all.npz", files / "python.npz")
    assert after.updated.experiments == told["experiments"] == 40
    assert after.updated.added.experiments == [10] and before.state.experiments == 30
    assert after.updated.added.simulation.fit.tolist() == told["simulation_fit"]
    # By files; the state is one.
    by_file = tokid.update(files / "python.h5", [files / "more.npz"])
    assert same_bytes(files / "tool.h5", files / "python.h5")
    by_file.save(files / "python.npz")
    assert same_bytes(files / "all.npz", files / "python.npz")
    state = tokid.UpdateState.load(files / "python.h5")
    assert (state.experiments, state.steps, state.inputs, state.outputs) == (40, 30, 2, 2)
    with pytest.warns(tokid.TokidWarning, match="all 10 experiments are in the state file already. Nothing is added"):
        again = tokid.update(state, more)
    assert again.updated.added.known == [list(range(10))] and again.updated.added.experiments == [0]
    assert again.updated.experiments == 40 and np.isnan(again.updated.added.one_step.fit).all()


def test_report(files, tool):
    data = tokid.Ensemble.load(files / "exact.npz")
    tool("identify", files / "exact.npz", "-o", files / "model.npz", "--hold-out", 0.2, "--report", files / "tool.html")
    model = tokid.identify(data, hold_out=0.2, report=files / "python.html")
    named = (files / "python.html").read_text()
    assert "<html" in named and len(named) == pytest.approx(len((files / "tool.html").read_text()), rel=0.01)
    told = tool("report", files / "model.npz", files / "noisy.npz", "-o", files / "tool.html", "--horizon", 4)
    fresh = tokid.Ensemble.load(files / "noisy.npz")
    verdict = model.report(fresh, path=files / "python.html", horizon=4, model_name="model.npz", data_name="noisy.npz")
    assert same_bytes(files / "tool.html", files / "python.html")
    for words in (verdict.trust, verdict.summary, *verdict.reasons):
        assert words in " ".join(told.split())  # the tool breaks lines


def test_stream(files, tool):
    tokid.example("oscillator", experiments=30, steps=120).save(files / "long.h5")
    tool("identify", files / "long.h5", "-o", files / "tool.h5", "--block", 40)
    found = tokid.identify_file(files / "long.h5", files / "python.h5", block=40)
    assert same_bytes(files / "tool.h5", files / "python.h5")
    assert (found.block, found.blocks, found.states) == (40, 3, 4) and found.overlap > 0
    with pytest.raises(tokid.IoError):
        tokid.identify_file(files / "exact.npz", files / "python.h5")


@pytest.fixture
def package(tmp_path):
    """A package in another place: package(folder) makes folder/tokid, and returns a call of its python -m tokid. It has
    no more than the module that runs then."""

    def make(folder):
        (folder / "tokid").mkdir(parents=True)
        (folder / "tokid" / "__init__.py").touch()
        (folder / "tokid" / "__main__.py").symlink_to(Path(tokid.__main__.__file__).resolve())

        def call(*words):
            # Without the packages of this environment, among which another tokid may be installed.
            return subprocess.run([sys.executable, "-S", "-m", "tokid", *map(str, words)], check=False, text=True,
                                  capture_output=True, env={**os.environ, "PYTHONPATH": str(folder)}, cwd=tmp_path, timeout=120)

        return call

    return make


@pytest.mark.parametrize("folder, program", [
    ("target", "target/bin/tokid"),  # pip install --target
    ("build/python", "build/bin/tokid"),  # the build tree
])
def test_python_runs_the_tool_of_its_package(package, tmp_path, tool, folder, program):
    run = package(tmp_path / folder)
    (tmp_path / program).parent.mkdir(parents=True)
    (tmp_path / program).symlink_to(os.environ["TOKID"])
    if folder == "build/python":
        (tmp_path / "build/CMakeCache.txt").touch()
    done = run("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, tool("--version"), "")
    assert run("example", "oscillator", "-o", "a b.npz", "--experiments", 40, "--steps", 30).returncode == 0
    tool("example", "oscillator", "-o", tmp_path / "c.npz", "--experiments", 40, "--steps", 30)
    assert same_bytes(tmp_path / "a b.npz", tmp_path / "c.npz")
    wrong = run("identify", "none.npz", "-o", "model.npz")
    assert wrong.returncode == 2 and "none.npz" in wrong.stderr  # the exit code of the tool


def test_python_runs_the_tool_with_which_the_package_was_linked(package, tmp_path, tool):
    run = package(tmp_path / "target")
    (tmp_path / "target/tokid/installed-tool.txt").write_text(os.environ["TOKID"] + "\n")
    assert run("--version").stdout == tool("--version")


@pytest.mark.parametrize("program, mode", [("bin/tokid", 0o755), ("target/bin/tokid", 0o644)])
def test_python_runs_no_foreign_program(package, tmp_path, program, mode):
    """A program two folders above the package belongs to it only in a build tree."""
    run = package(tmp_path / "target")
    (tmp_path / program).parent.mkdir(parents=True)
    (tmp_path / program).write_text("#!/bin/sh\necho foreign\n")
    (tmp_path / program).chmod(mode)
    done = run("--version")
    assert (done.returncode, done.stdout) == (1, "") and "no command line tool was installed" in done.stderr


def test_python_says_that_the_tool_is_missing(package, tmp_path):
    done = package(tmp_path / "target")("--version")
    assert done.returncode == 1 and done.stdout == ""
    assert f"no command line tool was installed with the package in {tmp_path / 'target' / 'tokid'}." in done.stderr
    assert "Install the package again, or build the tool from source: make build" in done.stderr


def test_the_tool_that_pip_installed_is_found(tmp_path, monkeypatch):
    """By the list of files of the package, from Python's folder of packages to that of its programs."""
    site = tmp_path / "lib/python3/site-packages"
    (site / "tokid-1.2.3.dist-info").mkdir(parents=True)
    (site / "tokid-1.2.3.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: tokid\nVersion: 1.2.3\n")
    (site / "tokid-1.2.3.dist-info/RECORD").write_text("tokid/__init__.py,,\n../../../bin/tokid,,\n")
    monkeypatch.syspath_prepend(str(site))
    found = [path.resolve() for path in tokid.__main__.places(site / "tokid")]
    assert found == [site / "bin" / "tokid", tmp_path / "bin" / "tokid"]
    other = tokid.__main__.places(tmp_path / "other" / "tokid")  # not the package that pip lists
    assert other == [tmp_path / "other" / "bin" / "tokid"]


def test_import_runs_no_code_beside_the_data(tmp_path):
    """Python would take modules from the folder in which it starts."""
    (tmp_path / "pandas.py").write_text("raise SystemExit(7)\n")
    (tmp_path / "a.csv").write_text("t;u;y\n0,0;1;2\n0,1;2;3\n0,2;3;4\n")
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run([os.environ["TOKID"], "import", "a.csv", "a.npz"], cwd=tmp_path, env=environment, check=False,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert np.load(tmp_path / "a.npz")["u"].ravel().tolist() == [1, 2, 3]
