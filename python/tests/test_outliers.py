# SPDX-License-Identifier: BSD-3-Clause
"""The option `outliers` of an identification."""

import time

import numpy as np
import pytest

import tokid


@pytest.fixture(scope="module")
def bad(noisy):
    y = np.array(noisy.y)
    y[16, :, 0] *= -1
    return tokid.Ensemble(noisy.u, y, dt=noisy.dt, initial_state="zero")


def test_drop(noisy, bad):
    with pytest.warns(tokid.TokidWarning, match="experiment 16 does not fit the other experiments.*The experiment was dropped"):
        model = tokid.identify(bad, outliers="drop", refine=False)
    found = model.identification
    (outlier,) = found.outliers
    assert (outlier.experiment, outlier.weight, outlier.held_out) == (16, 0.0, False)
    assert found.experiments == len(noisy.u) - 1
    assert model.options["outliers"] == "drop"
    rest = [n for n in range(len(noisy.u)) if n != 16]
    by_hand = tokid.identify(noisy.u[rest], noisy.y[rest], dt=noisy.dt, initial_state="zero", refine=False)
    assert np.array_equal(model.A.stack(), by_hand.A.stack())


def test_downweight(bad):
    with pytest.warns(tokid.TokidWarning, match="The experiment counts with the weight"):
        model = tokid.identify(bad, outliers="downweight", refine=False)
    (outlier,) = model.identification.outliers
    assert 0 < outlier.weight < 0.2
    with pytest.raises(ValueError, match="outliers: downweight found"):
        model.confidence(bad)


def test_wrong_value(noisy):
    with pytest.raises(ValueError, match="outliers: 'hide' found, one of 'keep', 'drop', 'downweight' needed"):
        tokid.identify(noisy, outliers="hide")


def test_seconds_are_those_of_all_rounds(bad):
    """Each report of the progress waits, so that the time of a round is known."""
    waited = []

    def wait(progress):
        begin = time.perf_counter()
        time.sleep(0.002)
        waited.append(time.perf_counter() - begin)

    with pytest.warns(tokid.TokidWarning):
        found = tokid.identify(bad, outliers="drop", refine=False, lags=3, states=4, progress=wait).identification
    assert len(waited) > 1 and found.seconds >= sum(waited)
