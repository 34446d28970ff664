# SPDX-License-Identifier: BSD-3-Clause
"""What is read of a file, and what is said of the rest: times by other names, columns that are not used, an end that may
have been cut, things said twice, no sample time, axes in another order."""

import re
import zipfile

import h5py
import numpy as np
import pytest
import scipy.io
from support import load, random_system, simulate

DT = 0.05


def table(path, time="time", comments="", steps=range(12), end="\n", extra=()):
    """Three experiments with one input and one output, some of their rows missing."""
    random = np.random.default_rng(1)
    lines = [",".join(["experiment", *([time] if time else []), *[name for name, _ in extra], "u1", "y1"])]
    for n in range(3):
        for k in steps:
            cells = [n, *([repr(round(k * DT, 12))] if time else []), *[value for _, value in extra],
                     *random.standard_normal(2).round(6)]
            if (n + k) % 5 or not time:
                lines.append(",".join(map(str, cells)))
    path.write_text(comments + "\n".join(lines) + end, encoding="utf-8")
    return path


def warnings(tokid, *arguments):
    """What JSON and stderr warn of: the same."""
    found = tokid.json(*arguments)["warnings"]
    assert tokid(*arguments).stderr.splitlines() == [f"tokid: warning: {text}" for text in found]
    return found


def told_of(texts, *words):
    return [text for text in texts if all(word in text for word in words)]


# Rows as steps

def test_rows_as_steps_are_told_wherever_files_are_read(tokid, tmp_path):
    file, model = table(tmp_path / "data.csv", None, comments="# dt = 0.05\n", steps=range(40)), tmp_path / "model.npz"
    for arguments in (["info", file], ["identify", file, "-o", model, "--lags", "1", "--time-invariant"],
                      ["validate", model, file]):
        assert told_of(warnings(tokid, *arguments), "so the rows were taken as successive steps")


# Columns that are not used

def test_columns_that_are_not_used(tokid, tmp_path):
    extra = [("trial", 7), ("temperature", 20.5)]
    file = table(tmp_path / "data.csv", extra=extra, steps=range(40))
    model = tmp_path / "model.npz"
    for arguments in (["info", file], ["identify", file, "-o", model, "--lags", "1", "--time-invariant"]):
        assert told_of(warnings(tokid, *arguments), "columns 'trial', 'temperature' are not used", "inputs or outputs")
    for arguments in (["validate", model, file], ["refine", model, file, "-o", tmp_path / "refined.npz"]):
        assert told_of(warnings(tokid, *arguments), "'trial', 'temperature' are not used")
    for arguments in (["predict", model, file, "-o", tmp_path / "out.npz"],
                      ["simulate", model, file, "-o", tmp_path / "out.npz"],
                      ["report", model, file, "-o", tmp_path / "page.html"], ["convert", file, tmp_path / "out.npz"]):
        assert "'trial', 'temperature' are not used" in tokid(*arguments).stderr
    assert "temperature" in (tmp_path / "page.html").read_text()
    assert "'k'" in warnings(tokid, "info", table(tmp_path / "k.csv", extra=[("k", 1)]))[0]


# An end that may have been cut

def test_cuts_within_the_last_number(tokid, tmp_path):
    whole = table(tmp_path / "whole.csv").read_bytes()
    silent = 0
    for cut in range(len(whole) - 60, len(whole)):
        (tmp_path / "cut.csv").write_bytes(whole[:cut])
        process = tokid_or_refused(tokid, tmp_path / "cut.csv")
        if whole[cut - 1:cut] == b"\n":  # between two rows: one file like another
            continue
        silent += process is not None and not told_of(process["warnings"], "ends without a line break")
    assert silent == 0
    assert warnings(tokid, "info", tmp_path / "whole.csv") == []


def tokid_or_refused(tokid, file):
    try:
        return tokid.json("info", file)
    except AssertionError:
        assert "line" in tokid("info", file, status=2).stderr
        return None


def test_a_last_line_without_its_break(tokid, tmp_path):
    file = table(tmp_path / "data.csv", end="", steps=range(40))
    last = file.read_text().splitlines()
    text, = warnings(tokid, "info", file)
    assert f"the last line {len(last)} ends" in text
    model = tmp_path / "model.npz"
    found = warnings(tokid, "identify", file, "-o", model, "--lags", "1", "--time-invariant")
    assert text in found and text in warnings(tokid, "validate", model, file)
    file.write_text(file.read_text()[:-1] + '"')  # an error of its own: a stray quotation mark
    tokid("info", file, status=2)
    rows = last[:-1] + [last[-1].rsplit(",", 1)[0] + ',"' + last[-1].rsplit(",", 1)[1] + '"']
    file.write_text("\n".join(rows))  # quoted, it is whole
    assert warnings(tokid, "info", file) == []


# The checksum in the first line

CHANGED = "file was changed after tokid wrote it"


@pytest.fixture
def written(tokid, tmp_path):
    file = tmp_path / "data.csv"
    tokid("convert", table(tmp_path / "in.csv", steps=range(40)), file)
    assert re.match(r"# checksum = [0-9a-f]{16}\n", file.read_text())
    return file


def test_line_ends_are_no_damage(tokid, written):
    content = written.read_bytes()
    for same in (content, content.replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"),
                 content.split(b"\n", 1)[1]):
        written.write_bytes(same)
        assert warnings(tokid, "info", written) == []


def test_a_file_that_was_changed(tokid, tmp_path, written):
    text, model = written.read_text(), tmp_path / "model.npz"
    first, rest = text.split("\n", 1)
    cells = rest.rsplit(",", 1)
    for changed in (f"{first}\n{cells[0]},7.25\n", f"{first[:-1]}\n{rest}", f"# checksum = \n{rest}",
                    f"{first},,\n{rest}", f"# measured on Monday\n{text}", text + "2,0.15,1,2\n",
                    text.replace("# checksum", "#(checksum")):
        written.write_text(changed)
        found = warnings(tokid, "info", written)
        assert len(found) == 1 and CHANGED in found[0] and f"'{written}'" in found[0]
        assert "Remove this line if you changed the file by hand. Otherwise the file is damaged" in found[0]
    for arguments in (["identify", written, "-o", model, "--lags", "1", "--time-invariant"],
                      ["validate", model, written]):
        assert told_of(warnings(tokid, *arguments), CHANGED)
    assert CHANGED in tokid("convert", written, tmp_path / "out.npz").stderr
    written.write_text(changed.split("\n", 1)[1])
    assert warnings(tokid, "info", written) == []


# Said twice

@pytest.mark.parametrize("first,second", [
    ("dt = 0.05", "dt = 0.1"), ("initial_state = zero", "initial_state = unknown"),
    ("length = [12, 12, 12]", "length = [1, 1, 1]"), ('input_names = ["u1"]', 'input_names = ["y1"]'),
    ('output_units = ["m"]', 'output_units = ["mm"]'),
])
def test_comments_that_contradict_each_other(tokid, tmp_path, first, second):
    error = tokid("info", table(tmp_path / "data.csv", comments=f"# {first}\n# {second}\n"), status=2).stderr
    assert "line 2" in error and "line 1" in error and second.split(" = ")[1] in error
    tokid("info", table(tmp_path / "data.csv", comments=f"# {first}\n# {first}\n"))


def test_comments_that_agree(tokid, tmp_path):
    found = tokid.json("info", table(tmp_path / "data.csv", comments="# dt = 0.05\n# dt = 5e-2\n"))
    assert found["dt"] == DT and found["warnings"] == []


def test_a_dt_that_the_times_contradict(tokid, tmp_path):
    error = tokid("info", table(tmp_path / "data.csv", comments="# dt = 0.01\n"), status=2).stderr
    assert "# dt = 0.01" in error and "0.05 s" in error
    tokid("info", table(tmp_path / "data.csv", comments="# dt = 0.07\n"), status=2)
    tokid("info", table(tmp_path / "data.csv", comments="# dt = 0.05\n", steps=(0, 1, 4, 8)))


@pytest.mark.parametrize("name,one,other", [("dt", 0.05, 0.1), ("initial_state", "zero", "unknown"),
                                            ("length", [9, 9], [9, 8]), ("input_names", ["a"], ["b"])])
def test_data_sets_and_attributes(tokid, tmp_path, name, one, other):
    file = tmp_path / "data.h5"
    for attribute, status in ((one, 0), (other, 2)):
        with h5py.File(file, "w") as h5:
            h5["u"], h5["y"] = (np.random.default_rng(seed).standard_normal((2, 9, 1)) for seed in (1, 2))
            h5[name], h5.attrs[name] = one, attribute
        process = tokid("info", file, status=status)
        assert status == 0 or f"'{name}': found twice, with different values" in process.stderr


def test_arrays_that_are_there_twice(tokid, tmp_path):
    arrays = {"u": np.ones((2, 9, 1)), "y": np.ones((2, 9, 1)), "dt": 0.05}
    arrays["y"][0, 3] = np.nan
    np.savez(tmp_path / "twice.npz", **arrays)
    with zipfile.ZipFile(tmp_path / "twice.npz", "a") as archive, pytest.warns(UserWarning):
        archive.writestr("dt.npy", archive.read("dt.npy"))
    assert "two arrays with the same name found" in tokid("info", tmp_path / "twice.npz", status=2).stderr
    scipy.io.savemat(tmp_path / "a.mat", {**arrays, "experiments": 2})
    header = 128
    for other, status in (({"dt": 0.05}, 0), ({"dt": 0.1}, 2)):
        scipy.io.savemat(tmp_path / "b.mat", other)
        more = (tmp_path / "b.mat").read_bytes()[header:]
        (tmp_path / "twice.mat").write_bytes((tmp_path / "a.mat").read_bytes() + more)
        process = tokid("info", tmp_path / "twice.mat", status=status)
        assert status == 0 or "'dt': found twice" in process.stderr


# No sample time

def samples(seed=3, experiments=40, steps=30, outputs=2):
    system = random_system(seed, steps, 3, 2, outputs)
    u = np.random.default_rng(seed).standard_normal((experiments, steps, 2))
    return u, simulate(system, u)


def write(path, **arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {**arrays, "experiments": len(arrays["u"])})
    else:
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file[name] = values
    return path


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_no_sample_time(tokid, tmp_path, extension):
    u, y = samples()
    file, model = write(tmp_path / f"data{extension}", u=u, y=y), tmp_path / "model.npz"
    for arguments in (["info", file], ["identify", file, "-o", model]):
        text, = told_of(warnings(tokid, *arguments), "sample time")
        assert "tokid assumes dt = 1 s" in text
    assert tokid.json("info", file)["dt_stated"] is False
    # The model knows, and so does what it makes of such data.
    assert tokid.json("info", model)["dt_stated"] is False and "dt is assumed" in tokid("info", model).stdout
    tokid("predict", model, file, "-o", tmp_path / "out.npz")
    assert "dt" not in load(tmp_path / "out.npz")
    stated = write(tmp_path / f"stated{extension}", u=u, y=y, dt=1.0)
    assert tokid.json("info", stated)["warnings"] == []
    assert tokid.json("identify", stated, "-o", model)["warnings"] == []
    assert tokid.json("info", model)["dt_stated"] is True


def test_the_sample_time_of_the_model_stands_in(tokid, tmp_path):
    u, y = samples()
    model = tmp_path / "model.npz"
    tokid("identify", write(tmp_path / "stated.npz", u=u, y=y, dt=0.05), "-o", model, "--state", tmp_path / "state.npz")
    file = write(tmp_path / "data.npz", u=u[::2], y=y[::2])
    text, = warnings(tokid, "validate", model, file)
    assert "tokid assumes the model's dt = 0.05 s" in text
    tokid("predict", model, file, "-o", tmp_path / "out.npz")
    assert load(tmp_path / "out.npz")["dt"] == 0.05
    new = tokid.json("update", tmp_path / "state.npz", file)
    assert told_of(new["warnings"], "data.npz: ", "tokid assumes the model's dt = 0.05 s")


def test_step_numbers_state_no_sample_time(tokid, tmp_path):
    rows = "".join(f"{n},{k},{n - k},{k + n * n}\n" for n in range(3) for k in range(9))
    (tmp_path / "k.csv").write_text("experiment,k,u1,y1\n" + rows)
    (tmp_path / "rows.csv").write_text("u1,y1\n" + "".join(f"{k % 4},{k * k}\n" for k in range(9)))
    (tmp_path / "one.csv").write_text("time,u1,y1\n0,1,2\n")
    for name in ("k", "rows", "one"):
        assert told_of(warnings(tokid, "info", tmp_path / f"{name}.csv"), "no sample time")
    (tmp_path / "stated.csv").write_text("# dt = 0.05\nexperiment,k,u1,y1\n" + rows)
    assert tokid.json("info", tmp_path / "stated.csv")["warnings"] == []
    # Nor do files that are made of them.
    for extension in ("csv", "npz", "h5", "mat"):
        tokid("convert", tmp_path / "k.csv", tmp_path / f"copy.{extension}")
        assert tokid.json("info", tmp_path / f"copy.{extension}")["dt_stated"] is False
    assert "\nexperiment,k,u1,y1\n0,0," in (tmp_path / "copy.csv").read_text()


def test_plans_state_no_sample_time_by_themselves(tokid, tmp_path):
    sizes = ["--states", 2, "--inputs", 1, "--outputs", 1, "--steps", 20]
    tokid("plan", *sizes, "-o", tmp_path / "plan.npz")
    assert "dt" not in load(tmp_path / "plan.npz")
    tokid("plan", *sizes, "--dt", 1, "-o", tmp_path / "plan.npz")
    assert load(tmp_path / "plan.npz")["dt"] == 1


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_other_names_of_the_sample_time(tokid, tmp_path, extension):
    u, y = samples()
    times = DT * np.arange(30)

    def dt(**named):
        found = tokid.json("info", write(tmp_path / f"data{extension}", u=u, y=y, **named))
        return found["dt"] if found["dt_stated"] else None, found["warnings"]

    for named in ({"Ts": DT}, {"t": times}, {"time": 7.5 + times}, {"t": times[:, None]}, {"Ts": DT, "time": times},
                  {"t": times.astype("float32")}, {"time": np.round(np.arange(30) * DT, 2)}):
        assert dt(**named) == (DT, []), named
    # What is stated needs no other name, but no other time either.
    assert dt(dt=DT, Ts=DT, t=times, fs=20.0) == (DT, [])
    assert dt(dt=0.1, Ts=DT) == (0.1, [f"'dt' = 0.1 and 'Ts' = {DT} differ. tokid uses 'dt'"])
    assert dt(Ts=0.1, time=times) == (0.1, [f"'Ts' = 0.1 and the steps of {DT} between the times differ. tokid uses 'Ts'"])
    uneven, gap, back = times.copy(), times.copy(), times[::-1]
    uneven[7] += 0.01
    gap[7:] += DT
    for name, value in (("Ts", -1.0), ("Ts", times), ("t", uneven), ("time", gap), ("t", back), ("t", times[1:]),
                        ("time", np.tile(times, (40, 1))), ("t", times + 1j), ("fs", 20.0), ("sample_time", DT),
                        ("time_ms", 50.0), ("t", np.where(times > 1, np.nan, times))):
        stated, texts = dt(**{name: value})
        assert stated is None and told_of(texts, f"'{name}' is not used, because a sample time needs the name 'dt'", "30 evenly"), name
        assert told_of(texts, "no sample time")
    assert told_of(dt(fs=20.0, t=uneven)[1], "'fs'", "'t'", "are not used")
    assert len(dt(T=30, tau=0.3, temperature=times)[1]) == 1


def test_times_that_cannot_be_read_are_not_used(tokid, tmp_path):
    """They were none of tokid's business before."""
    u, y = samples()
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"], file["y"] = u, y
        file.create_dataset("time", data=30 * ["noon"], dtype=h5py.string_dtype(), chunks=(10,))
        file.create_group("t")
    assert told_of(tokid.json("info", tmp_path / "data.h5")["warnings"], "'t', 'time' are not used")


def test_other_names_of_the_sample_time_in_blocks(tokid, tmp_path):
    u, y = samples(steps=60)

    def identified(**named):
        file = write(tmp_path / "data.h5", u=u, y=y, **named)
        found = tokid.json("identify", file, "-o", tmp_path / "model.h5", "--block", "30")
        model = tokid.json("info", tmp_path / "model.h5")
        return model["dt"] if model["dt_stated"] else None, found["warnings"]

    for named in ({"Ts": DT}, {"t": DT * np.arange(60)}):
        assert identified(**named) == (DT, [])
    dt, texts = identified(time=np.zeros((40, 60)))
    assert dt is None and len(told_of(texts, "'time' is not used")) == 1


def test_no_sample_time_in_blocks(tokid, tmp_path):
    u, y = samples(steps=60)
    file = write(tmp_path / "data.h5", u=u, y=y)
    found = tokid.json("identify", file, "-o", tmp_path / "model.h5", "--block", "30")
    assert len(told_of(found["warnings"], "no sample time")) == 1
    assert tokid.json("info", tmp_path / "model.h5")["dt_stated"] is False


# Axes

@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_time_before_experiments(tokid, tmp_path, extension):
    u, y = samples(experiments=50, steps=40)
    right = write(tmp_path / f"right{extension}", u=u, y=y, dt=0.1)
    assert tokid.json("info", right)["warnings"] == []
    swapped = write(tmp_path / f"swapped{extension}", u=u.swapaxes(0, 1), y=y.swapaxes(0, 1), dt=0.1)
    text, = tokid.json("info", swapped)["warnings"]
    assert "40 experiments of 50 steps" in text and "(experiments, steps, channels), not (steps, experiments, channels)" in text
    process = run(tokid, "identify", swapped, "-o", tmp_path / "model.npz", "--lags", 2, "--states", 2, "--no-refine")
    assert "arrays look swapped" in process.stderr
    tokid("identify", right, "-o", tmp_path / "model.npz")
    assert told_of(tokid.json("validate", tmp_path / "model.npz", swapped)["warnings"], "arrays look swapped")


def run(tokid, *arguments):
    """Whether it succeeds or not."""
    try:
        return tokid(*arguments)
    except AssertionError:
        return tokid(*arguments, status=2)


def test_channels_before_time(tokid, tmp_path):
    u, y = samples(experiments=50, steps=40)
    swapped = write(tmp_path / "swapped.npz", u=u.swapaxes(1, 2), y=y.swapaxes(1, 2), dt=0.1)
    text, = tokid.json("info", swapped)["warnings"]
    assert "50 experiments of 2 steps with 40 inputs and 40 outputs" in text and "not (experiments, channels, steps)" in text
    error = tokid("identify", swapped, "-o", tmp_path / "model.npz", status=2).stderr
    assert "not (experiments, channels, steps)" in error
    # Without as many inputs as outputs the shapes don't go together.
    u, y = samples(experiments=50, steps=40, outputs=1)
    swapped = write(tmp_path / "swapped.npz", u=u.swapaxes(1, 2), y=y.swapaxes(1, 2), dt=0.1)
    error = tokid("info", swapped, status=2).stderr
    assert "(50, 2, 40) and (50, 1, 40) found, read as 50 experiments of 2 steps with 40 inputs, and 1 step" in error
    assert "both look like (N, channels, T), (N, T, channels) needed" in error


@pytest.mark.parametrize("extension", [".npz", ".h5", ".mat"])
def test_channels_before_time_in_two_axes(tokid, tmp_path, extension):
    u, y = samples(experiments=1, steps=200)
    u, y = u[0], y[0, :, :1]
    file = tmp_path / f"data{extension}"
    for shown_u, shown_y, words in (
            (u.T, y.T, ("(2, 200) and (1, 200)", "2 steps with 200 inputs, and 1 step with 200 outputs", "both look")),
            (u.T, y, ("(2, 200) and (200, 1)", "2 steps with 200 inputs, and 200 steps with 1 output", "'u' looks")),
            (u, y.T, ("(200, 2) and (1, 200)", "200 steps with 2 inputs, and 1 step with 200 outputs", "'y' looks"))):
        write_one(file, u=shown_u, y=shown_y)
        for arguments in (["info", file], ["identify", file, "-o", tmp_path / "model.npz", "--time-invariant"]):
            error = tokid(*arguments, status=2).stderr
            assert f"shapes {words[0]} found, read as 1 experiment of {words[1]}" in error
            assert f"{words[2]} like (channels, T), (T, channels) needed" in error
    write_one(file, u=u, y=y[:-1])
    assert "shape (199, 1) found, (200, channels) like 'u' needed" in tokid("info", file, status=2).stderr
    # With as many inputs as outputs they go together.
    write_one(file, u=u[:, :1].T, y=y.T)
    words = "u of shape (1, 200) was read as one experiment of 1 step with 200 inputs", "For one experiment with 1 input, use the shape (200, 1)"
    assert told_of(tokid.json("info", file)["warnings"], *words)
    error = tokid("identify", file, "-o", tmp_path / "model.npz", "--time-invariant", status=2).stderr
    assert all(text in error for text in words)
    write_one(file, u=u, y=y)
    tokid("identify", file, "-o", tmp_path / "model.npz", "--time-invariant", "--states", 2)
    write_one(file, u=u.T, y=y.T)
    assert "both look" in tokid("validate", tmp_path / "model.npz", file, status=2).stderr
    # For a model, whose channels they are not.
    write_one(file, u=u.T, y=u.T)
    for command in ("validate", "predict", "simulate", "refine"):
        output = [] if command == "validate" else ["-o", tmp_path / "out.npz"]
        error = tokid(command, tmp_path / "model.npz", file, *output, status=2).stderr
        assert "inputs: 200 found, the model has 2; the array u of shape (2, 200) was read as one experiment of 2 steps" in error
        assert "use the shape (200, 2)" in error


def write_one(path, u, y):
    """One experiment of two axes, as people save it."""
    if path.suffix == ".mat":
        scipy.io.savemat(path, {"u": u, "y": y, "dt": 0.1})
    else:
        write(path, u=u, y=y, dt=0.1)


def test_two_axes_in_another_order(tokid, tmp_path):
    u, y = samples(experiments=30, steps=40)
    rows = write(tmp_path / "rows.npz", u=u[..., 0], y=y[..., 0], dt=0.1)  # (N, T)
    text, = tokid.json("info", rows)["warnings"]
    assert "u of shape (30, 40) was read as one experiment of 30 steps with 40 inputs. For 30 experiments with one input, use the shape (30, 40, 1)" in text
    assert "(30, 40, 1)" in tokid("identify", rows, "-o", tmp_path / "model.npz", status=2).stderr
    columns = write(tmp_path / "columns.npz", u=u[0].T, y=y[0].T, dt=0.1)  # (channels, T)
    assert "For one experiment with 2 inputs, use the shape (40, 2)" in tokid.json("info", columns)["warnings"][0]
    one = write(tmp_path / "one.npz", u=u[0][:, np.newaxis], y=y[0][:, np.newaxis], dt=0.1)  # (T, 1, channels)
    assert "(1, 40, channels)" in tokid.json("info", one)["warnings"][0]
