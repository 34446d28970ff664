# SPDX-License-Identifier: BSD-3-Clause
"""The estimator of scikit-learn."""

import pickle

import numpy as np
import pytest
import sklearn.utils.estimator_checks as checks
import tokid
from sklearn.base import clone, is_regressor
from sklearn.exceptions import NotFittedError
from sklearn.metrics import get_scorer, max_error, mean_squared_error, r2_score
from sklearn.model_selection import GridSearchCV, KFold, cross_val_predict, cross_val_score, train_test_split
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from tokid.interop import simulate_ltv
from tokid.sklearn import LTVIdentifier, make_scorer, scorers

# One regression for each step: milliseconds each.
QUICK = {
    "states": 4,
    "lags": 2,
    "smoothing": 0.0,
    "refine": False,
    "weighting": "one-step",
    "nominal": "none",
    "initial_state": "zero",
    "dt": 0.05,
}


@pytest.fixture(scope="module")
def data():
    return tokid.example("oscillator", experiments=45, steps=25, measurement_noise=0.02)


@pytest.fixture(scope="module")
def fitted(data):
    return LTVIdentifier(**QUICK).fit(data.u, data.y)


def test_fit_is_identify(data, fitted):
    model = tokid.identify(data.u, data.y, **QUICK)
    for name in "ABCDG":
        np.testing.assert_array_equal(np.asarray(getattr(fitted.model_, name)), np.asarray(getattr(model, name)))
    assert fitted.model_.dt == 0.05
    assert (fitted.n_features_in_, fitted.n_outputs_, fitted.n_steps_) == (2, 2, 25)


@pytest.mark.filterwarnings("ignore::tokid.TokidWarning")
@pytest.mark.parametrize(
    "option",
    [
        {"method": "tvera", "weighting": "auto"},
        {"period": "invariant", "smoothing": "auto"},
        {"frame": "smooth"},
        {"nominal": "mean"},
        {"initial_state": "unknown"},
        {"lags": 3},
        {"states": 3},
        {"frame": "reference", "reference_step": 7},
        {"rows": 4, "cols": 3, "method": "tvera", "weighting": "auto"},
        {"weighting": "many-steps"},
    ],
)
def test_every_option_reaches_identify(data, option):
    options = {**QUICK, **option}
    few = data.subset(range(30))
    found = LTVIdentifier(**options).fit(few.u, few.y).model_
    assert not np.array_equal(found.A.stack(), tokid.identify(few.u, few.y, **QUICK).A.stack())  # it matters
    np.testing.assert_array_equal(np.asarray(found.A), np.asarray(tokid.identify(few.u, few.y, **options).A))


def test_predict_simulates_or_predicts(data, fitted):
    np.testing.assert_array_equal(fitted.predict(data.u), fitted.model_.simulate(data.u))
    np.testing.assert_array_equal(fitted.predict(data.u, data.y), fitted.model_.simulate(data.u))
    ahead = clone(fitted).set_params(horizon=3).fit(data.u, data.y)
    np.testing.assert_array_equal(ahead.predict(data.u, data.y), fitted.model_.predict(data.u, data.y, horizon=3))
    with pytest.raises(ValueError, match=r"y: none found, the measured outputs \(N, T, 2\) needed .* horizon 3"):
        ahead.predict(data.u)


def test_score_is_r2_of_all_samples(data, fitted):
    fresh = tokid.example("oscillator", experiments=6, steps=25, measurement_noise=0.02, seed=2)
    flat = fresh.y.reshape(-1, 2)
    assert fitted.score(fresh.u, fresh.y) == pytest.approx(
        r2_score(flat, fitted.predict(fresh.u).reshape(-1, 2)), rel=1e-12
    )
    weights = np.arange(1.0, 7.0)
    wanted = r2_score(flat, fitted.predict(fresh.u).reshape(-1, 2), sample_weight=np.repeat(weights, 25))
    assert fitted.score(fresh.u, fresh.y, weights) == pytest.approx(wanted, rel=1e-12)
    # The fit in percent, of the same means
    simulation = fitted.model_.validate(fresh).simulation.fit
    r2 = r2_score(flat, fitted.predict(fresh.u).reshape(-1, 2), multioutput="raw_values")
    np.testing.assert_allclose(simulation, 100 * (1 - np.sqrt(1 - r2)), rtol=1e-9)


def test_score_leaves_out_what_is_missing(data, fitted):
    y = np.array(data.y)
    y[3, 5:9, 1] = np.nan
    predicted = fitted.predict(data.u)
    known = ~np.isnan(y[:, :, 1])
    wanted = (
        r2_score(y[:, :, 0].ravel(), predicted[:, :, 0].ravel())
        + r2_score(y[:, :, 1][known], predicted[:, :, 1][known])
    ) / 2
    assert fitted.score(data.u, y) == pytest.approx(wanted, rel=1e-12)
    assert np.isnan(fitted.score(data.u, np.full_like(y, np.nan)))
    one_step = clone(fitted).set_params(horizon=1).fit(data.u, data.y)
    assert one_step.score(data.u, data.y) > fitted.score(data.u, data.y)


def test_cross_validation_leaves_out_experiments(data):
    folds = KFold(3)
    scores = cross_val_score(LTVIdentifier(**QUICK), data.u, data.y, cv=folds)
    for score, (train, test) in zip(scores, folds.split(data.u)):
        model = tokid.identify(data.u[train], data.y[train], **QUICK)
        wanted = r2_score(data.y[test].reshape(-1, 2), model.simulate(data.u[test]).reshape(-1, 2))
        assert score == pytest.approx(wanted, rel=1e-12)
    predicted = cross_val_predict(LTVIdentifier(**QUICK), data.u, data.y, cv=folds)
    assert predicted.shape == data.y.shape and not np.isnan(predicted).any()


@pytest.mark.parametrize("name", scorers)
def test_scorers_are_those_of_scikit_learn_for_experiments(data, fitted, name):
    flat = get_scorer(name)
    y, y_hat = data.y.reshape(-1, 2), fitted.predict(data.u).reshape(-1, 2)
    # The root is taken of each output, as scikit-learn does it too.
    assert scorers[name](fitted, data.u, data.y) == pytest.approx(flat._sign * flat._score_func(y, y_hat))
    scores = cross_val_score(LTVIdentifier(**QUICK), data.u, data.y, cv=KFold(3), scoring=scorers[name])
    assert np.isfinite(scores).all()
    assert pickle.loads(pickle.dumps(scorers[name]))(fitted, data.u, data.y) == scorers[name](fitted, data.u, data.y)


def test_scorer_is_score_where_it_is_r2(data, fitted):
    y = np.array(data.y)
    y[3, 5:9, 1] = np.nan
    weights = np.arange(1.0, 46.0)
    assert scorers["r2"](fitted, data.u, y, weights) == pytest.approx(fitted.score(data.u, y, weights), rel=1e-12)
    assert np.isnan(scorers["r2"](fitted, data.u, np.full_like(y, np.nan)))
    ahead = clone(fitted).set_params(horizon=1).fit(data.u, data.y)
    pipeline = make_pipeline(FunctionTransformer(), ahead)
    search = GridSearchCV(ahead, {"states": [2, 4]}, cv=3, scoring=scorers["r2"]).fit(data.u, data.y)
    assert search.best_params_ == {"states": 4}
    for estimator in (ahead, pipeline, search):
        assert scorers["r2"](estimator, data.u, y) == pytest.approx(ahead.score(data.u, y), rel=1e-12)


def test_scorers_of_other_metrics(data, fitted):
    worst = make_scorer(max_error, greater_is_better=False)
    errors = np.abs(data.y - fitted.predict(data.u)).max(axis=(0, 1))
    assert worst(fitted, data.u, data.y) == pytest.approx(-errors.mean())

    class Zero:
        def predict(self, X):
            return np.zeros((*X.shape[:2], 2))

    assert make_scorer(mean_squared_error)(Zero(), data.u, data.y) == pytest.approx((data.y**2).mean())
    with pytest.raises(ValueError, match=r"y: shape \(45, 24, 2\) found, \(45, 25, m\) needed"):
        worst(fitted, data.u, data.y[:, 1:])


@pytest.mark.filterwarnings("ignore::tokid.TokidWarning")
@pytest.mark.parametrize("horizon", [None, 1])
def test_search_finds_the_lag_order(horizon):
    """White innovations of an observer that forgets after two steps: a third lag only adds unknowns."""
    model, rng = tokid.example_system("oscillator", steps=20), np.random.default_rng(1)
    u, e = rng.normal(size=(36, 20, 2)), 0.1 * rng.normal(size=(36, 20, 2))
    systems = [
        (step.A, np.hstack([step.B, -step.G]), step.C, np.hstack([step.D, np.eye(2)]))
        for step in map(model.at, range(20))
    ]
    y = simulate_ltv(systems, np.concatenate([u, e], axis=2))
    np.testing.assert_allclose(model.innovations(u, y), e, atol=1e-10)  # that is what was made

    search = GridSearchCV(LTVIdentifier(**QUICK, horizon=horizon), {"lags": [1, 2, 3]}, cv=3).fit(u, y)
    assert search.best_params_ == {"lags": 2}
    assert search.best_estimator_.model_.lags.max() == 2
    if horizon is None:
        np.testing.assert_array_equal(search.predict(u), search.best_estimator_.model_.simulate(u))


def test_search_finds_the_number_of_states(data):
    search = GridSearchCV(LTVIdentifier(**QUICK), {"states": [2, 4]}, cv=3, n_jobs=1).fit(data.u, data.y)
    assert search.best_params_ == {"states": 4}


def test_in_a_pipeline_and_with_a_split(data):
    u, fresh_u, y, fresh_y = train_test_split(data.u, data.y, test_size=0.2, random_state=0)
    pipeline = make_pipeline(FunctionTransformer(lambda inputs: 2 * inputs), LTVIdentifier(**QUICK)).fit(u, y)
    plain = LTVIdentifier(**QUICK).fit(u, y)
    assert pipeline.score(fresh_u, fresh_y) == pytest.approx(plain.score(fresh_u, fresh_y), rel=1e-6)
    np.testing.assert_allclose(2 * pipeline[-1].model_.markov(3), plain.model_.markov(3), rtol=1e-6, atol=1e-9)


def test_not_fitted(data):
    for use in (lambda e: e.predict(data.u), lambda e: e.score(data.u, data.y)):
        with pytest.raises(NotFittedError):
            use(LTVIdentifier())


def test_wrong_shapes(data, fitted):
    with pytest.raises(ValueError, match=r"X: shape \(25, 2\) found, \(N, T, r\) needed: one entry per experiment"):
        LTVIdentifier().fit(data.u[0], data.y[0])
    with pytest.raises(ValueError, match=r"y: shape \(45, 24, 2\) found, \(45, 25, m\) needed"):
        LTVIdentifier().fit(data.u, data.y[:, 1:])
    with pytest.raises(ValueError, match="X has 1 features, but LTVIdentifier is expecting 2 features as input"):
        fitted.predict(data.u[:, :, :1])
    with pytest.raises(ValueError, match="y: 1 outputs found, 2 needed"):
        fitted.score(data.u, data.y[:, :, :1])
    with pytest.raises(ValueError, match="requires y to be passed, but the target y is None"):
        LTVIdentifier().fit(data.u, None)
    with pytest.raises(ValueError, match="lags: 0 found, a whole number from 1 to 1000000 or 'auto' needed"):
        LTVIdentifier(lags=0).fit(data.u, data.y)


def test_clone_and_pickle(data, fitted):
    copy = clone(fitted)
    assert copy.get_params() == fitted.get_params() and not hasattr(copy, "model_")
    restored = pickle.loads(pickle.dumps(fitted))
    np.testing.assert_array_equal(restored.predict(data.u), fitted.predict(data.u))
    assert is_regressor(fitted)


# What the checks of scikit-learn ask of any estimator; the others fit tables (n_samples, n_features) without steps.
@pytest.mark.parametrize(
    "check",
    [
        "check_no_attributes_set_in_init",
        "check_parameters_default_constructible",
        "check_get_params_invariance",
        "check_set_params",
        "check_estimator_cloneable",
        "check_estimator_repr",
        "check_valid_tag_types",
        "check_estimator_tags_renamed",
        "check_mixin_order",
    ],
)
def test_check_of_scikit_learn(check):
    getattr(checks, check)("LTVIdentifier", LTVIdentifier())


def test_one_dimension_is_refused():
    checks.check_fit1d("LTVIdentifier", LTVIdentifier())


def test_parameters_and_data_stay_as_they_are(data):
    """What `check_dict_unchanged`, `check_dont_overwrite_attributes` and `check_readonly_memmap_input` ask, in 3-D."""
    u, y = np.array(data.u), np.array(data.y)
    u.flags.writeable = y.flags.writeable = False
    estimator = LTVIdentifier(**QUICK)
    before = estimator.get_params()
    assert estimator.fit(u, y) is estimator and estimator.get_params() == before
    added = set(vars(estimator)) - set(before)
    assert added and all(name.endswith("_") and not name.startswith("_") for name in added)
    state = dict(vars(estimator))
    first = estimator.predict(u)
    assert vars(estimator) == state
    np.testing.assert_array_equal(estimator.fit(u, y).predict(u), first)  # fitted again, the same
    np.testing.assert_array_equal(estimator.predict(u[::-1])[::-1], first)  # experiments on their own
    np.testing.assert_array_equal(estimator.predict(u[:3]), first[:3])
    np.testing.assert_array_equal(clone(estimator).fit(u.tolist(), y.tolist()).predict(u.tolist()), first)
