# SPDX-License-Identifier: BSD-3-Clause
"""The package and a user's script pass mypy --strict, and wrong calls don't."""

import re
import subprocess
import sys
from pathlib import Path

import tokid

SCRIPT = """
from typing import Optional, Union
import numpy as np
import numpy.typing as npt
import tokid

def swing_up(u: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> tokid.Model:
    data = tokid.Ensemble(u, y, dt=0.01, input_names=["torque"], output_names=["angle", "rate"])
    training, held_out = data.split(0.2)
    model = tokid.identify(training, states=4, smoothing="auto", progress=True)
    validation: tokid.Validation = model.validate(held_out, horizon=5)
    fit: float = float(validation.one_step.fit[0])
    if model.identification is not None and fit < 90:
        print(model.identification.lags, model.identification.order_scores.states)
    a: npt.NDArray[np.float64] = model.A[3]
    stack: npt.NDArray[np.float64] = model.A[2:5].stack()
    h = model.markov(3) @ np.ones(1) + a.sum() + stack.sum()
    refined = model.refine(u, y, iterations=5)
    bounds = refined.confidence(training, level=0.9)
    lower: npt.NDArray[np.float64] = bounds.markov.interval.lower + h.sum()
    plan = tokid.plan(model, experiments=10, amplitude=[0.5])
    x: Union[tokid.Ensemble, tokid.Model] = tokid.load("model.npz")
    state: Optional[tokid.UpdateState] = tokid.identify(data, keep_state=True).state
    if state is not None:
        model = tokid.update(state, plan.u, y)
    tokid.cross_validate(data, folds=3, states=4, lags="auto")
    tokid.identify_file("a.h5", "b.h5", lags=3)
    arx: tokid.stages.GtvArx = tokid.stages.gtv_arx(training, 4)
    own = tokid.stages.GtvArx(2 * arx.coefficients, arx.inputs, 4, arx.residual_cov, arx.output_rms)
    started: tokid.Model = tokid.stages.subspace(training, own, states=4, weighting="many-steps")
    model = tokid.stages.refine(started, training, smoothing=3.0).model
    print(lower, x, model.report(data, path="page.html").trust)
    return model.frame("smooth")
"""

WRONG = """
import numpy as np
import tokid
u = np.zeros((3, 4, 1))
tokid.identify(u, u, states=1.5)
tokid.identify(u, u, 0.1)
tokid.identify(u, u).simulate(u).norm()
tokid.cross_validate(u, u, statez=4)
tokid.Ensemble(u, u, dt="fast")
tokid.stages.markov(tokid.Ensemble(u, u), 5)
"""


def test_mypy(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    (tmp_path / "wrong.py").write_text(WRONG)
    package = Path(tokid.__file__).parent
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir", tmp_path / "cache", "--package",
         "tokid", "--module", "script", "--module", "wrong"],
        cwd=tmp_path, env={"MYPYPATH": str(package.parent), "PATH": ""}, capture_output=True, text=True, check=False)
    errors = done.stdout.splitlines()[:-1]
    expected = len(WRONG.splitlines()) - 4
    assert [line for line in errors if not line.startswith("wrong.py")] == [], done.stdout + done.stderr
    assert sorted({int(re.match(r"wrong.py:(\d+)", line)[1]) for line in errors}) == [
        5 + i for i in range(expected)], done.stdout
