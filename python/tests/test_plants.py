# SPDX-License-Identifier: BSD-3-Clause
"""Control and learning on plants of the zoo, and the figures of the paper."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import tokid

ZOO = Path(__file__).resolve().parents[2] / "bench" / "zoo"


@pytest.fixture(scope="module")
def zoo():
    """The modules of bench/zoo."""
    sys.path.insert(0, str(ZOO))
    try:
        import conditions
        import measures
        import truth

        yield conditions, measures, truth
    finally:
        sys.path.remove(str(ZOO))


def of_zoo(truth):
    """The truth of a plant as a model with noise."""
    s = truth.system
    return tokid.Model.from_matrices(
        s.A, s.B, s.C, s.D, Q=s.Q, R=s.R, x0_mean=np.zeros(len(s.P0)), x0_cov=s.P0, dt=truth.plant.dt,
        initial_state="unknown" if s.P0.any() else "zero",
    ).kalman_observer()  # fmt: skip


@pytest.mark.parametrize("plant, states, lags", [("oscillator", 4, 6), ("rotor", 2, 4), ("stage_separation", 4, 4)])
def test_lqg_on_plants_of_the_zoo(plant, states, lags, zoo):
    conditions, measures, truths = zoo
    truth = truths.truth_of(plant, conditions.Condition(experiments=60))
    assert truth.law is None  # open loop
    u, y, _ = truths.experiments(truth, 60, 7, nonlinear=True)
    model = tokid.identify(u.transpose(1, 0, 2), y.transpose(1, 0, 2), dt=truth.plant.dt, states=states, lags=lags,
                           smoothing=0.1)
    known = of_zoo(truth)
    wy, wu = truth.y_scale**-2, truth.plant.u_std**-2
    begin, end = model.full_begin, model.k_end
    best = known.lqr(wy, wu, begin=begin, end=end).expected_cost().total
    cost = model.lqr(wy, wu, begin=begin, end=end).expected_cost(known).total
    # The same by second moments, written down by hand.
    assert best == pytest.approx(measures.control_cost(measures.of_truth(truth.system), truth, begin, end), rel=1e-8)
    assert cost <= 1.3 * best


@pytest.mark.parametrize("plant, output, states, lags",
                         [("batch_reactor", 1, 3, 6), ("battery", 0, 4, 6), ("crane", 0, 4, 12)])
def test_learning_on_nonlinear_plants_of_the_zoo(plant, output, states, lags, zoo):
    conditions, measures, truths = zoo
    truth = truths.truth_of(plant, conditions.Condition(experiments=60))
    u, y, _ = truths.experiments(truth, 60, 7, nonlinear=True)
    # A model without EM is good enough here.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tokid.TokidWarning)
        model = tokid.identify(u.transpose(1, 0, 2), y.transpose(1, 0, 2), dt=truth.plant.dt, states=states,
                               lags=lags, smoothing=10.0, refine=False)

    def errors(designed):
        def learn(reference, inputs, measured, weight):
            change = 0.05 * truth.plant.u_std**-2
            return designed.learn(reference, inputs, measured, error_weight=weight, input_change_weight=change).u

        return measures.learning_errors(truth, output, learn)

    by_model, by_truth = errors(model), errors(of_zoo(truth))
    assert by_model[5] < 0.1 * by_model[0] and by_model[5] <= 1.5 * by_truth[5]


def test_paper(tmp_path):
    found = tokid.paper(tmp_path / "paper", threads=2)
    assert all(n.agrees for n in found.printed) and len(found.printed) > 20 and found.data
    assert (tmp_path / "paper" / "paper.html").exists()
