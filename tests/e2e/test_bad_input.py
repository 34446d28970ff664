# SPDX-License-Identifier: BSD-3-Clause
"""Wrong calls and bad data: exit status 2, one line on stderr that says where and what, and no file left behind."""

import os
import shutil

import h5py
import numpy as np
import pytest
import scipy.io
from support import load

RNG = np.random.default_rng(5)


def arrays(experiments=20, steps=12, inputs=2, outputs=2):
    return {"u": RNG.standard_normal((experiments, steps, inputs)),
            "y": RNG.standard_normal((experiments, steps, outputs)), "dt": 0.1}


def refused(tokid, directory, *arguments, words=(), status=2):
    """Runs a call that must fail and returns its message."""
    def files():
        return {path: path.stat().st_mtime_ns for path in directory.rglob("*")}

    before = files()
    result = tokid(*arguments, status=status)
    assert result.stdout == ""
    assert result.stderr.startswith("tokid: ") and result.stderr.endswith("\n")
    assert len(result.stderr.splitlines()) == 1
    for word in words:
        assert str(word) in result.stderr, f"{word!r} is not in {result.stderr!r}"
    assert files() == before, "a file appeared or changed"
    return result.stderr


@pytest.fixture
def identify_refused(tokid, tmp_path):
    def call(data, *options, words=()):
        return refused(tokid, tmp_path, "identify", data, "-o", tmp_path / "model.npz", *options,
                       words=[data, *words])

    return call


@pytest.fixture
def npz(tmp_path):
    def write(**changes):
        np.savez(tmp_path / "data.npz", **{k: v for k, v in {**arrays(), **changes}.items() if v is not None})
        return tmp_path / "data.npz"

    return write


# Files

@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat", ".csv"])
def test_missing_file(identify_refused, tmp_path, extension):
    identify_refused(tmp_path / f"nothing{extension}", words=["no such file"])


@pytest.mark.parametrize("command", [["validate"], ["simulate"], ["predict"]])
def test_missing_model(tokid, tmp_path, oscillator, command):
    output = [] if command == ["validate"] else ["-o", tmp_path / "out.npz"]
    refused(tokid, tmp_path, *command, tmp_path / "model.npz", oscillator / "data.npz", *output,
            words=[tmp_path / "model.npz", "no such file"])


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat", ".csv"])
def test_empty_file(identify_refused, tmp_path, extension):
    path = tmp_path / f"data{extension}"
    path.touch()
    identify_refused(path, words=["empty"])


def test_csv_with_a_header_only(identify_refused, tmp_path):
    (tmp_path / "data.csv").write_text("experiment,k,u1,y1\n")
    identify_refused(tmp_path / "data.csv")


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_something_else_under_the_name(identify_refused, tmp_path, extension):
    path = tmp_path / f"data{extension}"
    path.write_text("experiment,k,u1,y1\n" + "0,0,1.0,2.0\n" * 100)
    identify_refused(path)


def test_unknown_extension(identify_refused, tmp_path):
    path = tmp_path / "data.xlsx"
    path.write_bytes(b"PK")
    identify_refused(path, words=[".npz", ".h5", ".mat", ".csv"])


def test_directory(identify_refused, tmp_path):
    (tmp_path / "data.npz").mkdir()
    identify_refused(tmp_path / "data.npz", words=["directory"])


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_not_an_ensemble(identify_refused, tmp_path, extension):
    path = tmp_path / f"data{extension}"
    values = {"voltage": RNG.standard_normal((3, 4)), "current": RNG.standard_normal((3, 4))}
    if extension == ".npz":
        np.savez(path, **values)
    elif extension == ".mat":
        scipy.io.savemat(path, values)
    else:
        with h5py.File(path, "w") as file:
            for name, value in values.items():
                file[name] = value
    identify_refused(path, words=["'u'", "voltage"])


@pytest.mark.parametrize("missing", ["u", "y"])
def test_missing_data_set(identify_refused, npz, missing):
    identify_refused(npz(**{missing: None}), words=[f"'{missing}'"])


def test_model_in_place_of_an_ensemble(tokid, tmp_path, oscillator):
    refused(tokid, tmp_path, "identify", oscillator / "model.npz", "-o", tmp_path / "model.npz",
            words=[oscillator / "model.npz", "a model found"])
    refused(tokid, tmp_path, "validate", oscillator / "data.npz", oscillator / "data.npz",
            words=[oscillator / "data.npz", "an ensemble found"])


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9, 1.0])
@pytest.mark.parametrize("name", ["data.npz", "data.h5", "data.mat", "data73.mat"])
def test_truncated_ensemble(tokid, identify_refused, tmp_path, oscillator, name, share):
    whole, cut = tmp_path / name, tmp_path / f"cut-{name}"
    tokid("convert", oscillator / "data.npz", whole, *(["--mat73"] if "73" in name else []))
    content = whole.read_bytes()
    cut.write_bytes(content[:min(int(share * len(content)), len(content) - 1)])  # 1.0: all but the last byte
    identify_refused(cut)


@pytest.mark.parametrize("share", [0.3, 0.9, 1.0])
@pytest.mark.parametrize("name", ["model.npz", "model.h5", "model.mat", "model73.mat"])
def test_truncated_model(tokid, tmp_path, oscillator, name, share):
    whole, cut = tmp_path / name, tmp_path / f"cut-{name}"
    tokid("convert", oscillator / "model.npz", whole, *(["--mat73"] if "73" in name else []))
    content = whole.read_bytes()
    cut.write_bytes(content[:min(int(share * len(content)), len(content) - 1)])
    refused(tokid, tmp_path, "simulate", cut, oscillator / "data.npz", "-o", tmp_path / "out.npz", words=[cut])


# Types and shapes

@pytest.mark.parametrize("name", ["u", "y"])
@pytest.mark.parametrize("kind,words", [(str, "text"), (complex, "complex")])
def test_wrong_type(identify_refused, npz, name, kind, words):
    identify_refused(npz(**{name: arrays()[name].astype(kind)}), words=[f"'{name}'", words])


def test_wrong_type_in_hdf5(identify_refused, tmp_path):
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"] = arrays()["u"] * 1j
        file["y"] = arrays()["y"]
    identify_refused(tmp_path / "data.h5", words=["'u'"])
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"] = arrays()["u"].astype("S")
        file["y"] = arrays()["y"]
    identify_refused(tmp_path / "data.h5", words=["'u'", "text"])


def test_wrong_type_in_mat(identify_refused, tmp_path):
    values = arrays()
    scipy.io.savemat(tmp_path / "data.mat", {**values, "y": values["y"] + 1j})
    identify_refused(tmp_path / "data.mat", words=["'y'", "complex"])
    scipy.io.savemat(tmp_path / "data.mat", {**values, "u": "text"})
    identify_refused(tmp_path / "data.mat", words=["'u'", "text"])


@pytest.mark.parametrize("changes,words", [
    ({"y": RNG.standard_normal((19, 12, 2))}, ["'y'", "(19, 12, 2)", "(20, 12, "]),
    ({"y": RNG.standard_normal((20, 11, 2))}, ["'y'", "(20, 11, 2)", "(20, 12, "]),
    ({"u": RNG.standard_normal((20, 12))}, ["'u'", "(20, 12)"]),
    ({"u": RNG.standard_normal(20)}, ["'u'", "(20)"]),
    ({"u": RNG.standard_normal((20, 12, 2, 1))}, ["'u'", "(20, 12, 2, 1)"]),
    ({"u": np.zeros((0, 12, 2)), "y": np.zeros((0, 12, 2))}, ["'u'", "(0, 12, 2)"]),
    ({"length": np.full(7, 12)}, ["'length'", "7"]),
    ({"length": np.full(20, 13)}, ["'length'", "13", "12"]),
    ({"dt": -0.1}, ["dt", "-0.1"]),
    ({"free_y": RNG.standard_normal((5, 12, 3))}, ["'free_y'", "(5, 12, 3)"]),
    ({"initial_state": "resting"}, ["initial_state", "resting"]),
    ({"output_names": ["a", "b", "c"]}, ["output_names", "3", "2"]),
])
def test_shapes_and_values_that_disagree(identify_refused, npz, changes, words):
    identify_refused(npz(**changes), words=words)


# Values

@pytest.mark.parametrize("name,channel", [("u", "u2"), ("y", "y2")])
def test_channel_without_a_sample(identify_refused, npz, name, channel):
    values = arrays()[name]
    values[:, :, 1] = np.nan
    identify_refused(npz(**{name: values}), words=[channel])


@pytest.mark.parametrize("name,channel", [("u", "u2"), ("y", "y2")])
@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_infinite_value(identify_refused, npz, name, channel, value):
    values = arrays()[name]
    values[3, 7, 1] = value
    identify_refused(npz(**{name: values}), words=[channel, "infinite", "experiment 3", "step 7"])


@pytest.mark.parametrize("command", ["validate", "simulate", "predict"])
def test_infinite_value_for_a_model(tokid, tmp_path, oscillator, npz, command):
    values = arrays()["u"]
    values[3, 7, 1] = np.inf
    data = npz(u=values)
    output = [] if command == "validate" else ["-o", tmp_path / "out.npz"]
    refused(tokid, tmp_path, command, oscillator / "model.npz", data, *output, words=[data, "u2", "infinite", "step 7"])


# Amounts

def test_too_few_experiments_for_the_lag_order(identify_refused, npz):
    # N_min = r + p (r + m) = 22
    identify_refused(npz(**arrays(experiments=10)), "--lags", 5, "--method", "tvera",
                     words=["10 found", "at least 22", "lag orders up to 2"])


def test_too_few_experiments_for_any_lag_order(identify_refused, npz):
    identify_refused(npz(**arrays(experiments=5)), "--method", "tvera", words=["5 found", "6"])


def test_one_experiment_does_not_show_how_a_system_varies(identify_refused, npz):
    identify_refused(npz(**arrays(experiments=1)), words=["1 found", "at least 2", "time-invariant or periodic"])


def test_too_few_experiments_for_the_states(identify_refused, npz):
    # Six states behind two outputs need p = 3, which needs 14 experiments.
    identify_refused(npz(**arrays(experiments=12)), "--states", 6, "--method", "tvera", words=["12 found", "14"])


def test_too_few_steps(identify_refused, npz):
    identify_refused(npz(**arrays(steps=3)), "--lags", 3, words=["3 found", "4"])
    identify_refused(npz(**arrays(steps=1)), words=["1 found"])


def test_held_out_share_that_leaves_nothing(identify_refused, npz):
    identify_refused(npz(), "--hold-out", 0.001, words=["hold-out"])
    identify_refused(npz(), "--hold-out", 0.999, words=["hold-out"])


def test_model_and_data_that_disagree(tokid, tmp_path, oscillator, npz):
    model = oscillator / "model.npz"
    one_input, one_output = arrays(inputs=1), arrays(outputs=1)
    data = npz(**one_input)
    refused(tokid, tmp_path, "validate", model, data, words=[data, "inputs", "1 found", "2"])
    refused(tokid, tmp_path, "simulate", model, data, "-o", tmp_path / "out.npz", words=[data, "inputs"])
    data = npz(**one_output)
    refused(tokid, tmp_path, "validate", model, data, words=[data, "outputs", "1 found", "2"])
    refused(tokid, tmp_path, "predict", model, data, "-o", tmp_path / "out.npz", words=[data, "outputs"])


def test_folds_that_the_data_do_not_have(tokid, tmp_path, oscillator, npz):
    model = oscillator / "model.npz"
    refused(tokid, tmp_path, "validate", model, oscillator / "fresh.npz", "--cross-validate", 8,
            words=[oscillator / "fresh.npz", "folds", "8 found", "2 to 7"])
    tokid("identify", oscillator / "data.npz", "-o", tmp_path / "tvera.npz", "--method", "tvera")
    refused(tokid, tmp_path, "validate", tmp_path / "tvera.npz", oscillator / "fresh.npz", "--cross-validate", 3,
            words=[oscillator / "fresh.npz", "fold 1 of 3", "other 4 experiments"])
    with np.load(model) as file:
        values = {name: file[name] for name in file.files}
    for options, words in ((None, ["none found"]), ('{"wisdom": 1}', ["wisdom", "not known"]), ("{", ["JSON"])):
        values.pop("options", None)
        np.savez(tmp_path / "other.npz", **values, **({"options": options} if options else {}))
        refused(tokid, tmp_path, "validate", tmp_path / "other.npz", oscillator / "data.npz", "--cross-validate", 2,
                words=[tmp_path / "other.npz", "options of the model", *words])


def test_outputs_are_needed_to_validate(tokid, tmp_path, oscillator, npz):
    data = npz(y=None)
    refused(tokid, tmp_path, "validate", oscillator / "model.npz", data, words=[data, "'y'"])


# CSV

HEADER = "experiment,k,u1,y1\n"


@pytest.mark.parametrize("text,words", [
    (HEADER + "0,0,1,2\n0,1,3\n0,2,1,2\n", ["line 3", "y1"]),
    (HEADER + "0,0,1,2\n0,1,3,4,5\n", ["line 3", "5"]),
    (HEADER + "0,0,1,2\n0,1,three,4\n", ["line 3", "u1", "three"]),
    (HEADER + "0,0,1,2\n0,0,1,2\n", ["line 3"]),
    ("experiment,k,a,b\n0,0,1,2\n", ["u", "'a'"]),
    ("experiment,k,u1,u1,y1\n0,0,1,2,3\n", ["u1"]),
    (HEADER + "0,0,1,\0002\n", ["line 2, column 'y1'", "'\ufffd2' found, a number needed"]),
    ((HEADER + "0,0,1,2\n").encode("utf-16").decode("latin-1"), ["no column whose name begins with u found among", "name the"]),
])
def test_csv(identify_refused, tmp_path, text, words):
    (tmp_path / "data.csv").write_text(text)
    identify_refused(tmp_path / "data.csv", words=words)


def test_csv_columns_that_are_not_there(identify_refused, tmp_path):
    (tmp_path / "data.csv").write_text(HEADER + "0,0,1,2\n")
    identify_refused(tmp_path / "data.csv", "--inputs", "torque", words=["torque", "u1"])
    identify_refused(tmp_path / "data.csv", "--inputs", "u1", "--outputs", "u1", words=["u1"])


def test_columns_are_for_csv_only(identify_refused, npz):
    identify_refused(npz(), "--inputs", "u1", words=[".csv"])


# Calls

@pytest.mark.parametrize("options,words", [
    (["--no-such-option"], ["--no-such-option"]),
    (["--states", "0"], ["--states", "'0'"]),
    (["--states", "many"], ["--states", "'many'", "auto"]),
    (["--lags", "2.5"], ["--lags", "'2.5'"]),
    (["--lags", "-1"], ["--lags", "-1"]),
    (["--method", "era"], ["--method", "'era'", "auto", "tvera", "subspace"]),
    (["--method", "tvera", "--period", "3"], ["tvera", "period"]),
    (["--method", "tvera", "--smoothing", "1"], ["tvera", "regularisation"]),
    (["--smoothing", "bad"], ["--smoothing", "'bad'", "infinity", "auto"]),
    (["--smoothing", "-1"], ["--smoothing", "'-1'", "infinity", "auto"]),
    (["--smoothing", "nan"], ["--smoothing", "'nan'"]),
    (["--period", "1000001"], ["--period", "'1000001'"]),
    (["--period", "2.5"], ["--period", "'2.5'"]),
    (["--period", "3", "--time-invariant"], ["--period", "--time-invariant"]),
    (["--refine", "--no-refine"], ["--refine", "--no-refine"]),
    (["--frame", "tilted"], ["--frame", "'tilted'", "raw", "reference", "smooth"]),
    (["--nominal", "median"], ["--nominal", "'median'", "auto", "none", "mean"]),
    (["--initial-state", "one"], ["--initial-state", "'one'", "auto", "zero", "unknown"]),
    (["--hold-out", "2"], ["--hold-out", "'2'"]),
    (["--hold-out", "1"], ["--hold-out", "'1'", "below 1"]),
    (["--hold-out", "nan"], ["--hold-out", "'nan'"]),
    (["--threads", "-2"], ["--threads", "-2"]),
    (["--threads"], ["--threads"]),
    (["--reference-step", "4"], ["--reference-step", "--frame reference"]),
    (["surplus.npz"], ["surplus.npz"]),
    (["--states\nnewline"], ["--states newline"]),
])
def test_wrong_options(tokid, tmp_path, npz, options, words):
    refused(tokid, tmp_path, "identify", npz(), "-o", tmp_path / "model.npz", *options, words=words)


@pytest.mark.parametrize("arguments,words", [
    (["frobnicate"], ["identify", "validate", "simulate", "predict", "info", "plan", "example", "convert"]),
    (["identfy"], ["'identfy'", "identify"]),
    (["--no-such-option"], ["--no-such-option"]),
    (["identify"], ["DATA"]),
    (["identify", "--no-such-option"], ["--no-such-option"]),
    (["identify", "data.npz"], ["--output"]),
    (["validate", "model.npz"], ["DATA"]),
    (["validate", "model.npz", "data.npz", "--horizon", "0"], ["--horizon", "'0'"]),
    (["validate", "model.npz", "data.npz", "--cross-validate", "1"], ["--cross-validate", "'1'", "from 2"]),
    (["simulate", "model.npz"], ["INPUTS"]),
    (["example", "pendulum", "-o", "data.npz"], ["pendulum", "oscillator", "rotating-tube"]),
    (["example", "oscillator", "-o", "data.npz", "--steps", "0"], ["--steps", "'0'"]),
    (["example", "oscillator", "-o", "data.npz", "--experiments", "-3"], ["--experiments", "-3"]),
    (["example", "oscillator", "-o", "data.npz", "--process-noise", "inf"], ["--process-noise", "'inf'"]),
    (["convert", "data.npz"], ["OUT"]),
])
def test_wrong_calls(tokid, tmp_path, arguments, words):
    refused(tokid, tmp_path, *arguments, words=words)


# Outputs

@pytest.mark.parametrize("name,words", [
    ("nowhere/model.npz", ["nowhere", "does not exist"]),
    ("model.csv", [".csv", ".npz"]),
    ("model.xyz", [".xyz", ".npz"]),
    ("model", [".npz"]),
    ("taken.npz", ["directory"]),
    ("data.npz/model.npz", ["data.npz"]),
    # Too long a name: only the writing itself finds out.
    ("x" * 300 + ".npz", ["xxx"]),
])
def test_unwritable_model(tokid, tmp_path, npz, name, words):
    (tmp_path / "taken.npz").mkdir()
    refused(tokid, tmp_path, "identify", npz(), "-o", tmp_path / name, words=[tmp_path / name, *words])


@pytest.mark.parametrize("arguments", [["simulate", "model.npz", "data.npz"], ["predict", "model.npz", "data.npz"]])
@pytest.mark.parametrize("name", ["nowhere/out.npz", "out.xyz"])
def test_unwritable_ensemble(tokid, tmp_path, oscillator, arguments, name):
    command, *files = arguments
    refused(tokid, tmp_path, command, *(oscillator / file for file in files), "-o", tmp_path / name,
            words=[tmp_path / name])


def test_unwritable_example_and_conversion(tokid, tmp_path, oscillator):
    refused(tokid, tmp_path, "example", "oscillator", "-o", tmp_path / "nowhere/data.npz", words=["nowhere"])
    refused(tokid, tmp_path, "convert", oscillator / "model.npz", tmp_path / "model.csv", words=["model.csv"])
    refused(tokid, tmp_path, "convert", oscillator / "data.npz", tmp_path / "data.h5", "--mat73", words=["--mat73"])


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write to every directory")
def test_directory_without_permission(tokid, tmp_path, npz):
    data, closed = npz(), tmp_path / "closed"
    closed.mkdir(mode=0o500)
    refused(tokid, tmp_path, "identify", data, "-o", closed / "model.npz", words=[closed / "model.npz"],
            status=1)


def test_pseudo_file_system(tokid, tmp_path, npz):
    # Even root can't create files here.
    refused(tokid, tmp_path, "identify", npz(), "-o", "/proc/tokid-test.npz", words=["/proc/tokid-test.npz"],
            status=1)


def test_a_failure_leaves_the_old_file_alone(tokid, tmp_path, oscillator, npz):
    model = tmp_path / "model.npz"
    shutil.copy(oscillator / "model.npz", model)
    refused(tokid, tmp_path, "identify", npz(**arrays(experiments=1)), "-o", model)
    refused(tokid, tmp_path, "simulate", model, npz(u=None), "-o", model)
    assert load(model).keys() == load(oscillator / "model.npz").keys()
