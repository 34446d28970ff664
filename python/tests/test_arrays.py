# SPDX-License-Identifier: BSD-3-Clause
"""What goes in and what comes out: any layout in memory, one pass, views, and refusals that say what is wanted."""

import copy
import errno
import os
import pickle
import resource

import numpy as np
import pytest

import tokid
from tokid import _arrays


def samples(N=5, T=7, r=2, m=3, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(N, T, r)), rng.normal(size=(N, T, m))


LAYOUTS = {
    "C": np.ascontiguousarray,
    "Fortran": np.asfortranarray,
    "reversed": lambda a: a[::-1].copy()[::-1],
    "transposed": lambda a: a.transpose(1, 2, 0).copy().transpose(2, 0, 1),
    "strided": lambda a: np.repeat(a, 2, axis=1)[:, ::2],
    "list": lambda a: a.tolist(),
    "read-only": lambda a: np.frombuffer(a.tobytes()).reshape(a.shape),
    "big-endian": lambda a: a.astype(">f8"),
    "long double": lambda a: a.astype(np.longdouble),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("N", [1, 5, 37])
def test_any_layout(layout, N):
    u, y = samples(N)
    data = tokid.Ensemble(LAYOUTS[layout](u), LAYOUTS[layout](y))
    assert np.array_equal(data.u, u) and np.array_equal(data.y, y)


@pytest.mark.parametrize("kind", ["f2", "f4", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "?"])
def test_any_real_numbers(kind):
    u = (samples()[0] * 3).astype(kind)
    assert np.array_equal(tokid.Ensemble(u).u, u.astype(float))


def test_fields_and_shifted_arrays():
    """Strides that are no multiple of the size of a number, and numbers that begin anywhere."""
    u, y = samples()
    records = np.zeros(u.shape, dtype=[("mark", "i1"), ("value", "f8"), ("single", "f4")])
    records["value"], records["single"] = u, u
    shifted = np.ndarray(u.shape, np.float64, bytearray(u.nbytes + 1), offset=1)
    shifted[...] = u
    assert not shifted.flags.aligned and records["value"].strides[-1] % 8
    assert np.array_equal(tokid.Ensemble(records["value"], y).u, u)
    assert np.array_equal(tokid.Ensemble(records["single"], y).u, u.astype(np.float32))
    assert np.array_equal(tokid.Ensemble(shifted, y).u, u)
    # Of packed records whose numbers happen to be aligned the strides alone tell.
    buffer = np.zeros(u.size, dtype=[("value", "f4"), ("rest", "i2")])
    buffer["value"] = u.ravel()
    assert np.array_equal(tokid.Ensemble(buffer["value"].reshape(u.shape), y).u, u.astype(np.float32))
    whole = _arrays.numbers("u", buffer["value"])
    assert all(stride % whole.itemsize == 0 for stride in whole.strides)
    assert np.shares_memory(_arrays.numbers("u", u[::2, ::-1]), u)  # as ever without a copy


def test_masks_are_missing_samples():
    u, y = samples()
    masked = np.ma.array(y, mask=y > 1)
    data = tokid.Ensemble(u, masked)
    assert np.array_equal(np.isnan(data.y), y > 1) and data.missing == (y > 1).sum()


def test_views_are_the_samples():
    data = tokid.Ensemble.empty(4, 6, 2, 1, dt=0.5)
    # Experiments without a sample have length 0, so that no sample is missing within their lengths.
    assert np.isnan(data.u).all() and np.isnan(data.y).all() and data.missing == 0
    assert data.u.strides == data.y.strides == (8, 8 * 4 * 3, 8 * 4)
    assert np.shares_memory(data.u, data.u) and not data.u.flags.owndata
    data.u[...] = 1.0
    data.y[2, 3] = 5.0
    assert (data.u == 1).all() and data.y[2, 3, 0] == 5 and data.missing == 23
    u = data.u
    del data
    assert (u == 1).all()  # the view keeps the samples


def test_everything_that_is_known():
    u, y = samples()
    data = tokid.Ensemble(u, y, dt=0.1, length=[7, 3, 0, 7, 7], free_y=np.ones((2, 4, 3)), initial_state="unknown",
                          input_names=["a", "b"], output_units=["m", "s", ""])
    assert (len(data), data.experiments, data.steps, data.inputs, data.outputs) == (5, 5, 7, 2, 3)
    assert data.length.tolist() == [7, 3, 0, 7, 7] and data.missing == 0
    assert np.isnan(data.u[1, 3:]).all() and np.array_equal(data.u[1, :3], u[1, :3])
    assert data.free_y.shape == (2, 4, 3) and (data.free_y == 1).all()
    assert (data.input_names, data.output_names) == (["a", "b"], ["y1", "y2", "y3"])
    assert (data.input_units, data.output_units, data.initial_state) == (["", ""], ["m", "s", ""], "unknown")
    assert data.time.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    summary = data.summary()
    assert list(summary) == ["a", "b", "y1", "y2", "y3"]
    inside = np.concatenate([u[n, :l, 1] for n, l in enumerate([7, 3, 0, 7, 7])])
    assert summary["b"].samples == inside.size and summary["b"].mean == pytest.approx(inside.mean())
    data.u[1, 5] = 99.0  # behind its end: ignored wherever the ensemble is used
    assert data.summary()["b"].max == pytest.approx(inside.max())
    for other in (pickle.loads(pickle.dumps(data)), copy.deepcopy(data)):
        assert other.fingerprint == data.fingerprint and other.length.tolist() == data.length.tolist()
        assert (other.free_y == 1).all() and other.input_names == ["a", "b"] and other.initial_state == "unknown"


def test_parts():
    u, y = samples(10)
    data = tokid.Ensemble(u, y)
    training, held_out = data.split(0.3)
    assert (len(training), len(held_out)) == (7, 3)
    assert np.array_equal(data.subset([3, 1]).u, u[[3, 1]])
    assert np.array_equal(data.subset(u[:, 0, 0] > 0).u, u[u[:, 0, 0] > 0])
    assert np.array_equal(data.stretch(2, 5).y, y[:, 2:5])
    assert data.cut(3).u.shape == (20, 3, 2)
    mean_u, mean_y = data.nominal()
    assert np.allclose(mean_u, u.mean(0)) and np.allclose(data.departures().y, y - y.mean(0))
    assert data.fingerprint == tokid.Ensemble(u, y).fingerprint != training.fingerprint


def test_experiments_by_number():
    u, y = samples(10)
    data = tokid.Ensemble(u, y, length=[7, 3, 0, 7, 7, 7, 7, 7, 7, 5])
    assert np.array_equal(data[3].u, u[[3]]) and np.array_equal(data[-1].y[:, :5], y[[9], :5])
    assert data[np.int64(1)].length.tolist() == [3]
    for rows in (slice(2, 8, 2), [0, -1], [-1, -10], slice(None, None, -1), u[:, 0, 0] > 0):
        for part in (data.subset(rows), data[rows]):
            assert part.length.tolist() == data.length[rows].tolist()
            assert np.array_equal(part.u, data.u[rows], equal_nan=True)
    assert [one.length.tolist() for one in data] == [[n] for n in data.length]
    assert [len(list(data)), list(data)[2].u.shape] == [10, (1, 7, 2)]
    for n in (10, -11):
        with pytest.raises(IndexError, match=f"experiment {n} found, one of 10 needed"):
            data[n]


LENGTHS = [7, 3, 0, 5, 7]


@pytest.mark.parametrize("kind", ["list", "tuple", "array of objects", "nested lists"])
def test_experiments_of_different_lengths(kind):
    make = {"list": list, "tuple": tuple, "nested lists": lambda runs: [run.tolist() or np.empty(run.shape) for run in runs]}
    u, y = samples()
    runs = [[array[n, :length] for n, length in enumerate(LENGTHS)] for array in (u, y)]
    if kind == "array of objects":
        given = [np.empty(5, dtype=object) for _ in runs]
        for array, listed in zip(given, runs):
            array[:] = listed
    else:
        given = [make[kind](listed) for listed in runs]
    data = tokid.Ensemble(*given, dt=0.5, input_names=["a", "b"])
    padded = tokid.Ensemble(u, y, length=LENGTHS, dt=0.5, input_names=["a", "b"])
    assert data.length.tolist() == LENGTHS and data.fingerprint == padded.fingerprint and data.missing == 0
    assert np.isnan(data.y[1, 3:]).all() and np.array_equal(data.y[3, :5], y[3, :5])
    assert tokid.Ensemble(given[0]).length.tolist() == tokid.Ensemble(None, given[1]).length.tolist() == LENGTHS


def test_calls_take_experiments_of_different_lengths(noisy):
    lengths = [30 - n % 4 for n in range(40)]
    u, y = ([array[n, :length] for n, length in enumerate(lengths)] for array in (noisy.u, noisy.y))
    data = tokid.Ensemble(u, y, dt=noisy.dt)
    options = {"states": 4, "lags": 4, "refine": False}
    model = tokid.identify(u, y, dt=noisy.dt, **options, keep_state=True)
    assert np.array_equal(model.A.stack(), tokid.identify(data, **options).A.stack())
    assert np.array_equal(model.validate(u, y).one_step.fit, model.validate(data).one_step.fit)
    simulated = model.simulate(u)
    assert np.array_equal(simulated, model.simulate(data), equal_nan=True)
    assert simulated.shape == (40, 30, 2) and np.isnan(simulated[1, 29]).all() and not np.isnan(simulated[1, 28]).any()
    folds = [tokid.cross_validate(*given, folds=2, **options).one_step.fit for given in ((u, y), (data,))]
    assert np.array_equal(*folds)
    assert tokid.update(model.state, [2 * one for one in u], y).updated.experiments == 80


def test_masks_of_a_list_are_missing_samples():
    u, y = samples()
    masked = [np.ma.masked_array(one, mask=np.arange(14).reshape(7, 2) // 2 == n) for n, one in enumerate(u)]
    data = tokid.Ensemble(masked, y)
    assert data.missing == 10 and data.length is None and np.isnan(data.u[2, 2]).all()


def test_ensemble_is_no_array():
    u, y = samples(10)
    with pytest.raises(TypeError, match=r"an Ensemble found, an array needed: use its arrays u \(N, T, r\) and y"):
        tokid.identify(u, tokid.Ensemble(u, y))


def test_subclasses_stay_what_they_are(tmp_path):
    class Flights(tokid.Ensemble):
        pass

    data = Flights(*samples(10))
    parts = [*data.split(0.3), data.subset([1]), data[0], data[2:4], data.stretch(1, 4), data.cut(3), data.departures(),
             copy.copy(data), copy.deepcopy(data), Flights.empty(1, 2, 1, 1), next(iter(data))]
    data.save(tmp_path / "data.npz")
    parts.append(Flights.load(tmp_path / "data.npz"))
    assert {type(part) for part in parts} == {Flights}
    assert repr(data).startswith("<Flights: N = 10 experiments")
    assert np.array_equal(parts[8].u, data.u)


REFUSED = [
    (lambda u, y: tokid.Ensemble(u[0, 0], y), "u: shape (2,) found, (N, T, r) needed, or (T, r) for one experiment"),
    (lambda u, y: tokid.Ensemble(u, y[:3]), "y: shape (3, 7, 3) found, (5, 7, m) needed"),
    (lambda u, y: tokid.Ensemble(u, y[:, :6]), "y: shape (5, 6, 3) found, (5, 7, m) needed"),
    (lambda u, y: tokid.Ensemble(u[0], y[0, :6]), "y: shape (6, 3) found, (7, m) needed"),
    (lambda u, y: tokid.Ensemble(u, y[..., 0]), "y: shape (5, 7) found, (5, 7, m) needed"),
    (lambda u, y: tokid.Ensemble(u * 1j, y), "u: an array of complex128 found, real numbers needed"),
    (lambda u, y: tokid.Ensemble(u, y.astype(str)), "y: an array of <U32 found, real numbers needed"),
    (lambda u, y: tokid.Ensemble(u, y.astype(object)), "y: an array of object found, real numbers needed"),
    (lambda u, y: tokid.Ensemble([[[1, 2], [3]]], y), "u: lists of unequal lengths found"),
    (lambda u, y: tokid.Ensemble([[1, 2], [3]], y),
     "u[0]: shape (2,) found, (T, r) needed for an experiment in a list; for one channel, (T, 1)"),
    (lambda u, y: tokid.Ensemble([u[0], u[1, :4]], y[:2]), "y[1]: 7 steps found, 4 needed as in u[1]"),
    (lambda u, y: tokid.Ensemble(u[:2], [y[0], y[1, :4]]), "y[1]: 4 steps found, 7 needed as in u[1]"),
    (lambda u, y: tokid.Ensemble([u[0], u[1, :4]], [y[0], y[1, :4], y[2]]), "y: 3 experiments found, 2 needed as in u"),
    (lambda u, y: tokid.Ensemble([u[0], u[1, :4]], y[0]), "y: shape (7, 3) found, a list of N experiments (T, m) needed"),
    (lambda u, y: tokid.Ensemble([u[0], u[1, :4, :1]]), "u[1]: shape (4, 1) found, (T, 2) needed as in u[0]"),
    (lambda u, y: tokid.Ensemble([np.array(1.0), u[0]]), "u: lists of unequal lengths found, an array of real numbers needed"),
    (lambda u, y: tokid.Ensemble([np.array(1.0), np.array(2.0)]), "u: shape (2,) found, (N, T, r) needed"),
    (lambda u, y: tokid.Ensemble([u[0], "abc"]), "u[1]: an array of <U3 found, real numbers needed"),
    (lambda u, y: tokid.Ensemble([u[0], u[1, :4]], length=[7, 4]),
     "length: found beside a list of experiments, whose lengths are known"),
    (lambda u, y: tokid.identify([u[0], u[1, :4]], [y[0], y[1, :4]], length=[7, 4]), "length: found beside a list"),
    (lambda u, y: tokid.Ensemble(None), "inputs (N, T, r) or outputs (N, T, m) needed"),
    (lambda u, y: tokid.Ensemble(np.where(u > 1, np.inf, u)), "infinite value in experiment"),
    (lambda u, y: tokid.Ensemble(np.full_like(u, np.nan), y), "u1"),
    (lambda u, y: tokid.Ensemble(u, y, dt=0), "dt"),
    (lambda u, y: tokid.Ensemble(u, y, length=[1, 2]), "length: shape (2,) found, (5,) needed"),
    (lambda u, y: tokid.Ensemble(u, y, length=[8, 2, 2, 2, 2]), "length: 8 found, 0 to 7 needed"),
    (lambda u, y: tokid.Ensemble(u, y, length=np.ones(5)), "length: an array of float64 found, whole numbers needed"),
    (lambda u, y: tokid.Ensemble(u, y, free_y=np.ones((2, 3))), "free_y: shape (2, 3) found, (Nf, Tf, 3) needed"),
    (lambda u, y: tokid.Ensemble(u, y, input_names=["a"]), "input_names: 1 text found, a list of 2 texts needed"),
    (lambda u, y: tokid.Ensemble(u, y, input_names="ab"), "input_names: 'ab' found, a list of 2 texts needed"),
    (lambda u, y: tokid.Ensemble(u, y, initial_state="one"), "initial_state: 'one' found, one of 'zero', 'unknown'"),
    (lambda u, y: tokid.Ensemble(u, y).subset([5]), "rows: 5 found, numbers from -5 to 4 needed"),
    (lambda u, y: tokid.Ensemble(u, y).subset([-6]), "rows: -6 found, numbers from -5 to 4 needed"),
    (lambda u, y: tokid.Ensemble(u, y)[True], "rows"),
    (lambda u, y: tokid.Ensemble(u, y).subset([0.5]), "row numbers"),
    (lambda u, y: tokid.Ensemble(u, y).split(1.5), "1.5"),
    (lambda u, y: tokid.Ensemble.empty(-1, 2, 1, 1), "experiments: -1 found, a whole number from 0 on needed"),
    (lambda u, y: tokid.Ensemble(u, y).cut(3.5), "length: 3.5 found, a whole number from 1 to 7 needed"),
    (lambda u, y: tokid.Ensemble(u, y).stretch(1, 2.0), "end: 2.0 found, a whole number from 2 to 7 needed"),
    (lambda u, y: tokid.Ensemble(u, y).stretch(None, 2), "begin: None found, a whole number from 0 to 6 needed"),
    (lambda u, y: tokid.Ensemble(u, y).split("half"), "fraction: 'half' found, a number from 0 to 1 needed"),
    (lambda u, y: tokid.Ensemble(u, y, input_names=iter("a")), "input_names: 1 text found, a list of 2 texts needed"),
    (lambda u, y: tokid.identify(u), "y: none found, outputs (N, T, m) needed"),
    (lambda u, y: tokid.identify(tokid.Ensemble(u, y), y), "y: found beside an Ensemble"),
    (lambda u, y: tokid.identify(tokid.Ensemble(u, y), dt=1), "dt: found beside an Ensemble"),
    (lambda u, y: tokid.identify(u, y, lags=3, method="tvera"), "experiments: 5 found"),  # what the library says
    (lambda u, y: tokid.identify(u, y, states=0), "states: 0 found, a whole number from 1 to 1000000 or 'auto' needed"),
    (lambda u, y: tokid.identify(u, y, states=2.0), "states: 2.0 found, a whole number from 1 to 1000000 or 'auto' needed"),
    (lambda u, y: tokid.identify(u, y, lags="all"), "lags: 'all' found, a whole number from 1 to 1000000 or 'auto' needed"),
    (lambda u, y: tokid.identify(u, y, method="era"), "method: 'era' found, one of 'auto', 'tvera', 'subspace', 'regression' needed"),
    (lambda u, y: tokid.identify(u, y, smoothing=-1), "smoothing: -1 found, a number from 0 on, 'infinity' or 'auto'"),
    (lambda u, y: tokid.identify(u, y, smoothing=np.nan), "smoothing: nan found"),
    (lambda u, y: tokid.identify(u, y, period="weekly"), "period: 'weekly' found, a whole number from 0 to 1000000"),
    (lambda u, y: tokid.identify(u, y, refine="often"), "refine: 'often' found, one of True, False, None, 'auto'"),
    (lambda u, y: tokid.identify(u, y, hold_out=2), "hold_out: 2 found, a number from 0 to below 1 needed"),
    (lambda u, y: tokid.identify(u, y, hold_out=1.0), "hold_out: 1.0 found, a number from 0 to below 1 needed"),
    (lambda u, y: tokid.identify(u[..., 0].T, y[..., 0].T), "the array u of shape (7, 5) was read as one experiment of 7 steps with 5 inputs"),
    (lambda u, y: tokid.cross_validate(u[0], y[0]), "; the array u of shape (7, 2) was read as one experiment of 7 steps with 2 inputs. "
                                                    "For 7 experiments with one input, use the shape (7, 2, 1)"),
    (lambda u, y: tokid.identify(u, y, reference_step=3), "reference_step: needs frame 'reference'"),
    (lambda u, y: tokid.identify(u, y, threads=-1), "threads: -1 found, a whole number from 0 to 1024 needed"),
]


@pytest.mark.parametrize("call, words", REFUSED, ids=[words for _, words in REFUSED])
def test_refusals_say_what_is_wanted(call, words):
    with pytest.raises(ValueError) as error:
        call(*samples())
    assert words in str(error.value)


def test_more_inputs_than_steps_are_worth_a_word(recwarn):
    u, y = samples()
    with pytest.warns(tokid.TokidWarning, match=r"u of shape \(5, 7\) was read as one experiment of 5 steps with 7 inputs"):
        data = tokid.Ensemble(u[..., 0], y[..., 0])
    assert data.u.shape == (1, 5, 7)
    with pytest.warns(tokid.TokidWarning, match="5 steps with 7 inputs") as warned:
        tokid.Ensemble(u[..., 0], y[..., 0], dt=1.0)
    assert len(warned) == 1 and warned[0].filename == __file__
    with pytest.raises(ValueError, match="5 steps with 7 inputs"):
        tokid.identify(u[..., 0], y[..., 0], dt=1.0)
    recwarn.clear()
    tokid.Ensemble(u[0], y[0], dt=1.0), tokid.Ensemble(u[:, :1], y[:, :1], dt=1.0)
    assert not recwarn


def test_errors_of_a_listener_stay_as_they_are(data):
    def listen(share):
        raise ValueError("enough")

    with pytest.raises(ValueError) as error:
        tokid.identify(data.u[0], data.y[0], period=1, states=1, lags=1, refine=False, progress=listen)
    assert str(error.value) == "enough"


def test_options_of_numpy_and_words(data):
    """As a grid of scikit-learn holds them."""
    fixed = {"lags": 2, "states": 4, "weighting": "one-step"}
    first = tokid.identify(data, **fixed, smoothing=0.0, refine=False)
    same = tokid.identify(data, **fixed, smoothing=np.float32(0), refine=np.False_, keep_state=np.True_)
    assert np.array_equal(same.A.stack(), first.A.stack()) and same.state is not None
    constant = [tokid.identify(data, **fixed, smoothing=value, refine=False) for value in ("inf", "infinity", np.inf)]
    assert all(np.array_equal(model.A.stack(), constant[0].A.stack()) for model in constant)


def test_cross_validation_of_arrays(data):
    options = {"lags": 2, "states": 4, "smoothing": 0.0, "refine": False, "folds": 3}
    of_arrays = tokid.cross_validate(np.array(data.u), np.array(data.y), dt=data.dt, **options)
    of_ensemble = tokid.cross_validate(tokid.Ensemble(data.u, data.y, dt=data.dt), **options)
    assert np.array_equal(of_arrays.one_step.fit, of_ensemble.one_step.fit)


def test_files_that_are_none(tmp_path, model):
    (tmp_path / "no.npz").write_text("no archive")
    with pytest.raises(OSError, match="no.npz") as error:
        tokid.load(tmp_path / "no.npz")
    assert isinstance(error.value, tokid.IoError)
    with pytest.raises(tokid.IoError, match="missing.h5: no such file"):
        tokid.load(tmp_path / "missing.h5")
    with pytest.raises(tokid.IoError, match="models and bounds don't fit into .csv"):
        model.save(tmp_path / "model.csv")
    model.save(tmp_path / "model.npz")
    with pytest.raises(tokid.IoError):
        tokid.Ensemble.load(tmp_path / "model.npz")


def test_files_that_are_not_there(tmp_path, model, data):
    """Python's own errors, and tokid's; with the text of the library."""
    missing, nowhere = tmp_path / "missing.h5", tmp_path / "none" / "file.npz"
    state = tokid.identify(data, keep_state=True, refine=False).state
    for call, file in [
        (lambda: tokid.load(missing), missing),
        (lambda: tokid.Ensemble.load(missing), missing),
        (lambda: tokid.Model.load(str(missing)), missing),
        (lambda: tokid.UpdateState.load(missing), missing),
        (lambda: tokid.update(missing, data), missing),
        (lambda: tokid.update(state, missing), missing),
        (lambda: tokid.identify_file(missing, tmp_path / "model.h5"), missing),
        (lambda: data.save(nowhere), nowhere),
        (lambda: model.save(nowhere), nowhere),
        (lambda: state.save(nowhere), nowhere),
        (lambda: model.report(data, nowhere.with_suffix(".html")), nowhere.with_suffix(".html")),
    ]:
        with pytest.raises(FileNotFoundError) as error:
            call()
        assert isinstance(error.value, tokid.IoError)
        assert error.value.errno == errno.ENOENT and str(error.value.filename) == str(file)
        assert file.name in str(error.value) and "Errno" not in str(error.value)
    (tmp_path / "no.npz").write_text("no archive")
    with pytest.raises(tokid.IoError) as error:
        tokid.load(tmp_path / "no.npz")
    assert not isinstance(error.value, FileNotFoundError)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may do anything")
def test_files_that_are_forbidden(tmp_path, data):
    data.save(tmp_path / "data.npz")
    (tmp_path / "data.npz").chmod(0)
    for call in (lambda: tokid.load(tmp_path / "data.npz"), lambda: data.save(tmp_path / "data.npz")):
        with pytest.raises(PermissionError) as error:
            call()
        assert isinstance(error.value, tokid.IoError) and error.value.errno == errno.EACCES


def test_no_space_for_files(tmp_path, data):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    (tmp_path / "data.h5").write_bytes(b"old")
    for name in ("data.npz", "data.h5", "data.mat", "data.csv"):
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
        try:
            with pytest.raises(tokid.IoError, match=f"{name}: can't be written: File too large") as error:
                data.save(tmp_path / name)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert error.value.errno == errno.EFBIG and error.value.filename == str(tmp_path / name)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("data.h5", b"old")]


def test_no_paths():
    for call in (lambda: tokid.load(3), lambda: tokid.Model.load(None), lambda: tokid.UpdateState.load(2.5)):
        with pytest.raises(TypeError, match="expected str, bytes or os.PathLike object, not"):
            call()
