# SPDX-License-Identifier: BSD-3-Clause
"""Experiments and single samples that do not fit: named, dropped or downweighted."""

import json

import h5py
import numpy as np
import pytest

N, T = 40, 40
BAD, STUCK = 12, (30, 25, 1)  # an experiment with a wrong sign; a sample far off: experiment, step, output
QUICK = ["--lags", 4, "--states", 4, "--no-refine"]


@pytest.fixture(scope="module")
def data(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("outliers")
    tokid("example", "oscillator", "-o", folder / "healthy.npz", "--experiments", N, "--steps", T,
          "--measurement-noise", 0.05)
    with np.load(folder / "healthy.npz") as file:
        arrays = dict(file)
    y = arrays["y"].copy()
    y[BAD, :, 0] *= -1
    y[STUCK] += 1.5
    np.savez(folder / "data.npz", **{**arrays, "y": y})
    y = np.delete(y, BAD, axis=0)
    y[STUCK[0] - 1, STUCK[1], STUCK[2]] = np.nan  # one row further up
    np.savez(folder / "by_hand.npz", **{**arrays, "u": np.delete(arrays["u"], BAD, axis=0), "y": y})
    return folder


def identified(tokid, data, tmp_path, *more, name="data.npz"):
    return tokid.json("identify", data / name, "-o", tmp_path / f"m{'-'.join(map(str, more))}.npz", *QUICK, *more)


def test_keep_names_them(tokid, data, tmp_path):
    found = identified(tokid, data, tmp_path)
    assert [o["experiment"] for o in found["outliers"]] == [BAD] and found["outliers"][0]["weight"] == 1
    sample, = found["outlying_samples"]
    assert (sample["experiment"], sample["steps"], sample["output"]) == (STUCK[0], [STUCK[1]], STUCK[2])
    assert found["experiments"] == N


def test_drop_is_as_by_hand(tokid, data, tmp_path):
    found = identified(tokid, data, tmp_path, "--outliers", "drop")
    outlier, = found["outliers"]
    assert (outlier["experiment"], outlier["weight"], outlier["held_out"]) == (BAD, 0, False)
    assert outlier["outputs"][0]["name"] == "y1"
    assert found["outlying_samples"][0]["weight"] == 0
    assert found["experiments"] == N - 1 and found["held_out_experiments"] == 0
    assert sum(text.endswith("was dropped") for text in found["warnings"]) == 2
    by_hand = identified(tokid, data, tmp_path, name="by_hand.npz")
    assert found["one_step_fit"] == by_hand["one_step_fit"] and found["simulation_fit"] == by_hand["simulation_fit"]
    info = tokid.json("info", tmp_path / "m--outliers-drop.npz")
    made = json.loads(info["options"])["corrections"] if isinstance(info["options"], str) else info["options"]["corrections"]
    assert made["experiments"] == [{"label": str(BAD), "weight": 0.0}]
    assert made["samples"] == [{"label": str(STUCK[0]), "output": STUCK[2], "step": STUCK[1], "value": None}]


def test_downweight_keeps_them_in(tokid, data, tmp_path):
    found = identified(tokid, data, tmp_path, "--outliers", "downweight")
    assert 0 < found["outliers"][0]["weight"] < 0.1 and 0 < found["outlying_samples"][0]["weight"] < 0.5
    assert found["experiments"] == N
    assert any("The experiment counts with the weight" in text for text in found["warnings"])
    assert any("The sample was moved towards its prediction" in text for text in found["warnings"])


def test_the_page_says_so(tokid, data, tmp_path):
    text = tokid("identify", data / "data.npz", "-o", tmp_path / "m.npz", *QUICK, "--outliers", "drop", "--report",
                 tmp_path / "page.html").stdout
    assert "1 experiment dropped, 1 sample dropped" in text
    page = (tmp_path / "page.html").read_text()
    assert "The experiment was dropped" in page
    # A page of the model and the same data tests it on the experiments that it was identified from.
    tokid("report", tmp_path / "m.npz", data / "data.npz", "-o", tmp_path / "again.html")
    assert f"{N - 1} experiments" in (tmp_path / "again.html").read_text()


def test_held_out_experiments_are_named(tokid, data, tmp_path):
    found = identified(tokid, data, tmp_path, "--hold-out", 0.4)
    assert [(o["experiment"], o["held_out"]) for o in found["outliers"]] == [(BAD, True)]
    dropped = identified(tokid, data, tmp_path, "--hold-out", 0.4, "--outliers", "drop")
    assert dropped["experiments"] + dropped["held_out_experiments"] == N - 1


def test_bounds_and_updates_use_what_was_used(tokid, data, tmp_path):
    tokid("identify", data / "data.npz", "-o", tmp_path / "m.npz", *QUICK, "--outliers", "drop", "--state",
          tmp_path / "s.npz")
    bounds = tokid.json("confidence", tmp_path / "m.npz", data / "data.npz", "-o", tmp_path / "bounds.npz")
    assert bounds["experiments"] == N - 1 and not any("other data" in text for text in bounds["warnings"])
    tokid("example", "oscillator", "-o", tmp_path / "more.npz", "--experiments", 10, "--steps", T, "--seed", 9,
          "--measurement-noise", 0.05)
    assert tokid.json("update", tmp_path / "s.npz", tmp_path / "more.npz", "-o", tmp_path / "n.npz")["experiments"] == N + 9
    refused = tokid("identify", data / "data.npz", "-o", tmp_path / "w.npz", *QUICK, "--outliers", "downweight",
                    "--state", tmp_path / "w-s.npz", status=2).stderr
    assert "outliers: downweight found" in refused and "use drop or keep" in refused


def test_blocks_refuse(tokid, tmp_path, data):
    with np.load(data / "data.npz") as arrays, h5py.File(tmp_path / "data.h5", "w") as file:
        for name in ("u", "y", "dt"):
            file[name] = arrays[name]
    refused = tokid("identify", tmp_path / "data.h5", "-o", tmp_path / "m.h5", "--block", 20, "--outliers", "drop",
                    status=2).stderr
    assert "outliers: drop found, which needs all steps at once" in refused
