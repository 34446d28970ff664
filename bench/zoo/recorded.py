# SPDX-License-Identifier: BSD-3-Clause
"""Measured ensembles as cells of the study. No truth is known, so regressions of bench/compare stand beside tokid.

A split gives some runs to the identification, at random, and leaves the others fresh. The errors of predictions of the
fresh runs are those of bench/compare: relative to the errors of the mean trajectory.
"""

import json
import subprocess
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from contenders import CONTENDERS
from ensembles import parted
from judge import HORIZONS, errors, squares
from table import ERRORS


def recorded_cells(folder, begin, end):
    """Name -> (file, split): the splits begin ... end-1 of each file (.npz with u, y and dt) in the folder or below."""
    return {f"{path.stem}/split-{split}": (path, split) for path in sorted(Path(folder).rglob("*.npz"))
            for split in range(begin, end)}


def halves(path, split):
    """u (N, T, r), y (N, T, m) and dt of the runs for the identification, and of the fresh ones."""
    with np.load(path) as file:
        u, y, dt = file["u"], file["y"], float(file["dt"])
    return [{"u": u[part], "y": y[part], "dt": dt} for part in parted(len(u), split)]


def by_rival(name, training, fresh):
    """The predictions of the fresh runs by a regression, its options, and processor seconds."""
    found = CONTENDERS[name](SimpleNamespace(**training))
    return found.predictor.predict(fresh["u"], fresh["y"], HORIZONS), found.options, found.seconds


def by_tool(tool, options, limit, training, fresh):
    """The predictions of the fresh runs by the model of `tokid identify`, its report, and seconds."""

    def run(*command):
        return subprocess.run([tool, *map(str, command)], capture_output=True, text=True, check=True,
                              timeout=limit).stdout

    with tempfile.TemporaryDirectory() as folder:
        data, model, new = (Path(folder, f"{name}.npz") for name in ("data", "model", "fresh"))
        np.savez(data, **training)
        np.savez(new, **fresh)
        begin = time.monotonic()
        report = json.loads(run("identify", data, *options, "-o", model, "--json"))
        seconds, predictions = time.monotonic() - begin, []
        for horizon in HORIZONS:
            run("predict", model, new, "--horizon", horizon, "-o", Path(folder, f"{horizon}.npz"))
            predictions.append(np.load(Path(folder, f"{horizon}.npz"))["y"])
    return predictions, report, seconds


def errors_of(predictions, training, fresh):
    """The errors of predictions of the fresh runs, by name."""
    found = errors(squares(predictions, fresh["y"], training["y"].mean(axis=0))) / 100
    return dict(zip(ERRORS, found.tolist()))
