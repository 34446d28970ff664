# SPDX-License-Identifier: BSD-3-Clause
"""Experiments keep the names that their file gives them, and messages call them by these."""

import json
import re

import h5py
import numpy as np
import pytest
import scipy.io

N, T = 60, 30
BAD = 16  # the row of the batch that is labelled 17
# Choices that take the tool the most time, where they are not what is looked at.
QUICK = ["--states", 4, "--lags", 2, "--smoothing", 1, "--no-refine"]


def samples(tokid, folder, experiments=N, seed=1, noise=0.05):
    tokid("example", "oscillator", "-o", folder / "plain.npz", "--experiments", experiments, "--steps", T,
          "--seed", seed, "--measurement-noise", noise)
    with np.load(folder / "plain.npz") as file:
        return file["u"], file["y"], float(file["dt"])


def write_csv(path, u, y, dt, names):
    lines = ["experiment,time,u1,u2,y1,y2"]
    for n, name in enumerate(names):
        for k in range(u.shape[1]):
            cells = [*u[n, k], *y[n, k]]
            lines.append(",".join([str(name), repr(k * dt), *("" if np.isnan(x) else repr(float(x)) for x in cells)]))
    path.write_text("\n".join(lines) + "\n")
    return path


def bad(y):
    y = y.copy()
    y[BAD] = y[BAD, :, ::-1]  # swapped channels
    return y


@pytest.fixture(scope="module")
def campaign(tokid, tmp_path_factory):
    """Batches labelled 1 … 60, of which 17 has swapped outputs, and the same labelled otherwise."""
    folder = tmp_path_factory.mktemp("campaign")
    u, y, dt = samples(tokid, folder)
    write_csv(folder / "numbers.csv", u, bad(y), dt, range(1, N + 1))
    write_csv(folder / "rows.csv", u, bad(y), dt, range(N))
    write_csv(folder / "words.csv", u, bad(y), dt, [f"flight {n + 1:03}" for n in range(N)])
    return folder


def warnings(result):
    return [line for line in result.stderr.splitlines() if line.startswith("tokid: warning")]


@pytest.mark.parametrize("data,shown,name", [("numbers", '"17" (row 16)', "17"), ("rows", "16", None),
                                             ("words", '"flight 017" (row 16)', "flight 017")])
@pytest.mark.parametrize("more", [[], ["--hold-out", 0.25], ["--method", "tvera"]])
def test_the_bad_batch_is_called_by_its_label(tokid, tmp_path, campaign, data, shown, name, more):
    call = ["identify", campaign / f"{data}.csv", "-o", tmp_path / "model.npz", "--no-refine", *more]
    result = tokid(*call, "--json")
    said = warnings(result)
    assert any(f"experiment {shown} does not fit the other experiments" in line for line in said), said
    outlier, = json.loads(result.stdout)["outliers"]
    assert (outlier["experiment"], outlier["name"]) == (BAD, name)


def test_in_blocks_too(tokid, tmp_path, campaign):
    tokid("convert", campaign / "numbers.csv", tmp_path / "data.h5")
    call = ["identify", tmp_path / "data.h5", "-o", tmp_path / "model.h5", "--block", 200, "--no-refine", "--json"]
    result = tokid(*call)
    assert any('experiment "17" (row 16) does not fit' in line for line in warnings(result))
    outlier, = json.loads(result.stdout)["outliers"]
    assert (outlier["experiment"], outlier["name"]) == (BAD, "17")


def chain(tokid, path, *extensions):
    for extension in extensions:
        path, before = path.with_name(f"{path.stem}-{extension}.{extension}"), path
        tokid("convert", before, path)
    return path


def test_names_go_through_every_format(tokid, tmp_path, campaign):
    for data, names in (("numbers", [str(n + 1) for n in range(N)]),
                        ("words", [f"flight {n + 1:03}" for n in range(N)])):
        first = chain(tokid, campaign / f"{data}.csv", "csv")
        assert first.read_bytes() == chain(tokid, first, "npz", "h5", "mat", "csv").read_bytes()
        with np.load(chain(tokid, first, "npz")) as file:
            assert file["experiment_names"].tolist() == names
        with h5py.File(chain(tokid, first, "h5")) as file:
            assert [text.decode() for text in file["experiment_names"][()]] == names
        mat = scipy.io.loadmat(chain(tokid, first, "mat"), squeeze_me=True)
        assert mat["experiment_names"].tolist() == names
        found = tokid.json("info", first)
        assert found["experiment_names"] == names
    assert tokid.json("info", campaign / "rows.csv")["experiment_names"] is None
    assert "experiment_names" not in tokid.arrays(campaign / "rows.csv", tmp_path)
    assert re.search(r"^Named +1, 2, 3, 4, 5, … 60$", tokid("info", campaign / "numbers.csv").stdout, re.MULTILINE)
    assert "Named" not in tokid("info", campaign / "rows.csv").stdout


def test_names_may_be_numbers_in_binary_files(tokid, tmp_path):
    u, y, dt = samples(tokid, tmp_path, 4)
    np.savez(tmp_path / "data.npz", u=u, y=y, dt=dt, experiment_names=np.arange(1, 5))
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"], file["y"], file["dt"] = u, y, dt
        file["experiment_names"] = ["1", "2", "3", "4"]
    scipy.io.savemat(tmp_path / "data.mat", {"u": u, "y": y, "dt": dt, "experiment_names": np.arange(1.0, 5.0)})
    for extension in ("npz", "h5", "mat"):
        found = tokid.json("info", tmp_path / f"data.{extension}")
        assert found["experiment_names"] == ["1", "2", "3", "4"], extension


def test_bad_samples_are_found_by_the_label(tokid, tmp_path):
    u, y, dt = samples(tokid, tmp_path, 5)
    y[3, 5, 0] = np.inf
    write_csv(tmp_path / "data.csv", u, y, dt, ["a", "b", "c", "d", "e"])
    said = tokid("identify", tmp_path / "data.csv", "-o", tmp_path / "model.npz", status=2).stderr
    assert said.endswith('data.csv: output y1: infinite value in experiment "d" (row 3) at step 5, '
                         "finite or missing (NaN) needed\n")
    np.savez(tmp_path / "data.npz", u=u, y=y, dt=dt, experiment_names=["a", "b", "c", "d", "e"])
    for command in (["info"], ["identify", "-o", tmp_path / "model.npz"]):
        said = tokid(command[0], tmp_path / "data.npz", *command[1:], status=2).stderr
        assert 'experiment "d" (row 3) at step 5' in said


@pytest.mark.parametrize("names,said", [(["a", "b", "a"], 'experiment_names: "a" found at rows 0 and 2'),
                                        (["a", "b"], "experiment_names: 2 names found for 3 experiments"),
                                        (["a", "", "c"], "experiment_names: an empty text found at row 1"),
                                        ([1, 2, 1], 'experiment_names: "1" found at rows 0 and 2')])
def test_wrong_names_are_refused(tokid, tmp_path, names, said):
    u, y, dt = samples(tokid, tmp_path, 3)
    np.savez(tmp_path / "data.npz", u=u, y=y, dt=dt, experiment_names=names)
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["u"], file["y"], file["experiment_names"] = u, y, names
    for extension in ("npz", "h5"):
        assert said in tokid("info", tmp_path / f"data.{extension}", status=2).stderr


def test_hostile_names_stay_text(tokid, tmp_path, campaign):
    u, y, dt = samples(tokid, tmp_path)
    names = [f"n{n}" for n in range(N)]
    names[BAD] = "\x1b[31m<script>alert(1)</script>\u202e\n" + 50_000 * "x"
    names[BAD + 1] = "=cmd|' /C calc'!A0"
    np.savez(tmp_path / "data.npz", u=u, y=bad(y), dt=dt, experiment_names=names)
    result = tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--no-refine", "--report",
                   tmp_path / "page.html")
    line, = (line for line in warnings(result) if "does not fit" in line)
    assert 'experiment " [31m<script>alert(1)</script>' in line and '…" (row 16) does not fit' in line
    assert len(line) < 400 and "\x1b" not in result.stderr + result.stdout and "\u202e" not in result.stderr
    assert "<script>alert" not in (tmp_path / "page.html").read_text()
    call = ["identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--no-refine"]
    assert tokid.json(*call)["outliers"][0]["name"] == names[BAD]
    said = tokid("convert", tmp_path / "data.npz", tmp_path / "data.csv", status=2).stderr
    assert "experiment_names: '=cmd|' /C calc'!A0' found" in said and not (tmp_path / "data.csv").exists()


def page_data(path):
    found = re.search(r'<script type="application/json" id="report-data">(.*?)</script>', path.read_text(), re.S)
    return json.loads(found.group(1))


@pytest.mark.parametrize("hold_out", [0, 0.25])
@pytest.mark.parametrize("data", ["numbers", "rows"])
def test_pages_name_experiments_as_the_data_do(tokid, tmp_path, campaign, data, hold_out):
    """Those that were held out too, by their rows in the file and not in the part."""
    model = tmp_path / "model.npz"
    tokid("identify", campaign / f"{data}.csv", "-o", model, *QUICK, "--hold-out", hold_out, "--report",
          tmp_path / "page.html")
    tokid("report", model, campaign / f"{data}.csv", "-o", tmp_path / "later.html")
    held_out = [n for n in range(N) if int((n + 1) * hold_out) > int(n * hold_out)]
    for page in ("page.html", "later.html"):
        shown = page_data(tmp_path / page)["traces"]["experiments"]
        assert len(shown) > 10
        for one in shown:
            row = one["row"]
            assert row in (held_out or range(N))
            assert one["name"] == (str(row + 1) if data == "numbers" else None)
            assert re.match(rf'Experiment "{row + 1}" \(row {row}\)( |$)' if data == "numbers"
                            else rf"Experiment {row}( |$)", one["label"]), one["label"]


def test_page_of_validation_data_names_what_stands_out(tokid, tmp_path, campaign):
    good = tmp_path / "good.npz"
    u, y, dt = samples(tokid, tmp_path, noise=0.01)
    np.savez(good, u=u, y=y, dt=dt)
    tokid("identify", good, "-o", tmp_path / "model.npz", "--no-refine")
    tokid("report", tmp_path / "model.npz", campaign / "numbers.csv", "-o", tmp_path / "page.html")
    assert "Errors of experiment &quot;17&quot; (row 16) are more than" in (tmp_path / "page.html").read_text()


def test_folds_are_listed_by_rows_and_names(tokid, tmp_path, campaign):
    tokid("identify", campaign / "numbers.csv", "-o", tmp_path / "model.npz", "--method", "tvera", "--states", 4,
          "--lags", 2)
    for data, named in (("numbers", True), ("rows", False)):
        found = tokid.json("validate", tmp_path / "model.npz", campaign / f"{data}.csv", "--cross-validate", 3)
        for i, fold in enumerate(found["cross_validation"]["per_fold"]):
            assert fold["experiments"] == list(range(i, N, 3))
            assert fold["experiment_names"] == ([str(n + 1) for n in range(i, N, 3)] if named else None)


def test_outputs_keep_the_names(tokid, tmp_path, campaign):
    model = tmp_path / "model.npz"
    tokid("identify", campaign / "numbers.csv", "-o", model, "--method", "tvera", "--states", 4, "--lags", 2)
    for command in ("simulate", "predict"):
        tokid(command, model, campaign / "numbers.csv", "-o", tmp_path / "outputs.csv")
        rows = (tmp_path / "outputs.csv").read_text().splitlines()
        assert {line.split(",")[0] for line in rows if line[0].isdigit()} == {str(n + 1) for n in range(N)}


def test_updates_name_what_is_wrong_with_a_file(tokid, tmp_path):
    u, y, dt = samples(tokid, tmp_path, 40, noise=0)
    np.savez(tmp_path / "first.npz", u=u, y=y, dt=dt, initial_state="zero")
    tokid("identify", tmp_path / "first.npz", "-o", tmp_path / "model.npz", "--state", tmp_path / "state.npz")
    u, y, _ = samples(tokid, tmp_path, 5, seed=2, noise=0)
    y[2, 7, 1] = -np.inf
    more = write_csv(tmp_path / "more.csv", u, y, dt, [41, 42, 43, 44, 45])
    said = tokid("update", tmp_path / "state.npz", more, status=2).stderr
    assert 'infinite value in experiment "43" (row 2) at step 7' in said


def test_experiments_that_share_no_step_have_their_own_rows(tokid, tmp_path):
    """Not those of the part that is left when some are held out."""
    u, y, dt = samples(tokid, tmp_path)
    for samples_of in (u, y):
        samples_of[41, :15] = samples_of[20, 14:] = np.nan
    for names, late, early in ((None, "41", "20"), ([f"b{n}" for n in range(N)], '"b41" (row 41)', '"b20" (row 20)')):
        np.savez(tmp_path / "data.npz", u=u, y=y, dt=dt, **({} if names is None else {"experiment_names": names}))
        for more in ([], ["--hold-out", 0.25]):
            said = tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", *QUICK, *more).stderr
            assert f"experiment {late} begins at step 15, after experiment {early} has ended at step 13" in said


def test_repeats_and_stuck_sensors_are_named(tokid, tmp_path):
    u, y, dt = samples(tokid, tmp_path)
    u[9], y[9] = u[30], y[30]
    y[44, 10:, 0] = y[44, 10, 0]
    write_csv(tmp_path / "data.csv", u, y, dt, range(1, N + 1))
    said = tokid("identify", tmp_path / "data.csv", "-o", tmp_path / "model.npz", *QUICK).stderr
    assert '"31" (row 30) of experiment "10" (row 9)' in said
    assert 'in experiment "45" (row 44) at steps 10–29' in said
