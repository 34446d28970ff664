# SPDX-License-Identifier: BSD-3-Clause
"""The methods that tokid is compared with.

Each function takes the samples u (N, T, r) and y (N, T, m) of the training experiments and stated options. It returns
a predictor (predictors.py), or None if the options are impossible. judge.py chooses the options. Regressors are divided
by the root mean squares of their channels, so that penalties and ranks do not depend on units.
"""

from dataclasses import dataclass

import numpy as np

from predictors import Arx, StateSpace, collected, delayed, lagged

SINGULAR = 1e-10  # of a diagonal of R: below, a least-squares problem is solved by its pseudo-inverse


def sizes_of(samples):
    """Root mean squares of the channels (c) of samples (T, N, c); 1 for a channel of zeros."""
    size = np.sqrt(np.mean(samples**2, axis=(0, 1)))
    return np.where(size > 0, size, 1.0)


@dataclass(frozen=True)
class Regression:
    """Regressors W (T, N, q) and outputs (T, N, m) of ARX models, over the sizes of their channels."""

    W: np.ndarray
    outputs: np.ndarray
    u_size: np.ndarray
    y_size: np.ndarray
    lags: int
    feedthrough: bool

    @classmethod
    def of(cls, u, y, lags, feedthrough):
        u, y = u.transpose(1, 0, 2), y.transpose(1, 0, 2)
        u_size, y_size = sizes_of(u), sizes_of(y)
        u, y = u / u_size, y / y_size
        parts = [u] if feedthrough else []
        W = np.concatenate([*parts, lagged(y, lags), lagged(u, lags)], axis=2)
        return cls(W, y, u_size, y_size, lags, feedthrough)

    def arx(self, coefficients):
        """The model of the coefficients (..., q, m) of these regressors, in the units of the samples."""
        r, m = len(self.u_size), len(self.y_size)
        edges = np.cumsum([r * self.feedthrough, self.lags * m])
        direct, own, driven = np.split(coefficients * self.y_size, edges, axis=-2)
        if not self.feedthrough:
            direct = np.zeros((*coefficients.shape[:-2], r, m))
        of_y, of_u = (np.tile(size, self.lags)[:, None] for size in (self.y_size, self.u_size))
        return Arx(direct / self.u_size[:, None], own / of_y, driven / of_u)


def triangles(rows):
    """The triangular factors R of a stack of matrices (..., N, q)."""
    return np.linalg.qr(rows, mode="r")


def solved(R, unknowns):
    """Coefficients (T, q, m) of the least-squares problems with the factors R (T, rows, q + m); of least norm."""
    left, right = R[..., :unknowns], R[..., unknowns:]
    if R.shape[1] < unknowns:
        return np.linalg.pinv(left, rcond=SINGULAR) @ right
    diagonal = np.abs(np.diagonal(left, axis1=1, axis2=2))
    full = diagonal.min(axis=1) > SINGULAR * diagonal.max(axis=1)
    found = np.empty((len(R), unknowns, right.shape[2]))
    found[full] = np.linalg.solve(left[full, :unknowns], right[full, :unknowns])
    found[~full] = np.linalg.pinv(left[~full], rcond=SINGULAR) @ right[~full]
    return found


def varying_arx(u, y, lags, pool=0, ridge=0.0, feedthrough=True):
    """ARX coefficients of each step, by least squares over the experiments.

    The regression of a step also has the rows of the `pool` steps on either side. `ridge` is the penalty on a
    coefficient, in numbers of rows.
    """
    data = Regression.of(u, y, lags, feedthrough)
    steps, _, unknowns = data.W.shape
    R = triangles(np.concatenate([data.W, data.outputs], axis=2))
    if pool:
        around = np.concatenate([np.zeros((pool, *R.shape[1:])), R, np.zeros((pool, *R.shape[1:]))])
        R = triangles(np.concatenate([around[i : i + steps] for i in range(2 * pool + 1)], axis=1))
    if ridge:
        penalty = np.zeros((unknowns, R.shape[2]))
        np.fill_diagonal(penalty, np.sqrt(ridge * len(u) * (2 * pool + 1)))
        R = triangles(np.concatenate([R, np.broadcast_to(penalty, (steps, *penalty.shape))], axis=1))
    return data.arx(solved(R, unknowns))


def invariant_arx(u, y, lags, ridge=0.0, feedthrough=True):
    """The same ARX coefficients for all steps, by least squares over the steps from `lags` on."""
    data = Regression.of(u, y, lags, feedthrough)
    rows = np.concatenate([data.W, data.outputs], axis=2)[lags:]
    rows, unknowns = rows.reshape(-1, rows.shape[2]), data.W.shape[2]
    penalty = np.zeros((unknowns, rows.shape[1]))
    np.fill_diagonal(penalty, np.sqrt(ridge * len(rows)))
    R = triangles(np.concatenate([rows, penalty]))
    return data.arx(solved(R[None], unknowns))


def recursive_ensemble(u, y, lags, forgetting, feedthrough=True):
    """Recursive least squares over time. Each step adds the rows of all experiments; older ones count less.

    The coefficients of a step come from the training experiments up to this step. The recursion is that of the
    triangular factor, which keeps all digits.
    """
    data = Regression.of(u, y, lags, feedthrough)
    steps, _, unknowns = data.W.shape
    rows = np.concatenate([data.W, data.outputs], axis=2)
    R = np.zeros((unknowns, rows.shape[2]))
    np.fill_diagonal(R, 1e-3)
    factors = np.empty((steps, *R.shape))
    for k in range(steps):
        factors[k] = R = triangles(np.concatenate([np.sqrt(forgetting) * R, rows[k]]))[:unknowns]
    return data.arx(solved(factors, unknowns))


@dataclass(frozen=True)
class Adaptive:
    """Recursive least squares in the experiment that is predicted.

    It starts from the time-invariant coefficients of the training experiments, which count as `prior` steps. A
    prediction uses the coefficients of the step from which it looks ahead.
    """

    start: np.ndarray  # coefficients (q, m)
    covariance: np.ndarray  # (q, q), of the start
    forgetting: float
    training: Regression  # sizes, lags, feedthrough

    def predict(self, u, y, horizons):
        t = self.training
        u, y = u.transpose(1, 0, 2) / t.u_size, y.transpose(1, 0, 2) / t.y_size
        past, m = lagged(y, t.lags), y.shape[2]
        W = np.concatenate([*([u] if t.feedthrough else []), past, lagged(u, t.lags)], axis=2)
        steps, count, unknowns = W.shape
        known = np.empty((steps + 1, count, unknowns, m))  # before the sample of the step
        known[0] = self.start
        P = np.tile(self.covariance, (count, 1, 1))
        for k in range(steps):
            if k < t.lags:  # the regressors are not complete
                known[k + 1] = known[k]
                continue
            w = W[k, :, :, None]
            Pw = P @ w
            gain = Pw / (self.forgetting + w.transpose(0, 2, 1) @ Pw)
            known[k + 1] = known[k] + gain @ (y[k, :, None, :] - w.transpose(0, 2, 1) @ known[k])
            P = (P - gain @ Pw.transpose(0, 2, 1)) / self.forgetting
            P = (P + P.transpose(0, 2, 1)) / 2
        begin = len(t.u_size) * t.feedthrough
        others = np.r_[:begin, begin + t.lags * m : unknowns]
        rest, coefficients = W[:, :, None, others], known[:-1]

        def following():
            nonlocal past, coefficients
            own = coefficients[:, :, begin : begin + t.lags * m]
            predicted = (rest @ coefficients[:, :, others] + past[:, :, None] @ own)[:, :, 0]
            past = delayed(np.concatenate([predicted, past[:, :, :-m]], axis=2))
            coefficients = delayed(coefficients)
            return predicted * t.y_size

        return collected(following, horizons)


def recursive_run(u, y, lags, forgetting, prior, feedthrough=True):
    """The recursion of Adaptive, from the time-invariant coefficients of the training experiments."""
    data = Regression.of(u, y, lags, feedthrough)
    rows = np.concatenate([data.W, data.outputs], axis=2)[lags:]
    rows, unknowns = rows.reshape(-1, rows.shape[2]), data.W.shape[2]
    R = triangles(np.concatenate([rows, 1e-6 * np.eye(unknowns, rows.shape[1])]))
    inverse = np.linalg.inv(R[:unknowns, :unknowns])
    return Adaptive(solved(R[None], unknowns)[0], inverse @ inverse.T * (len(rows) / prior), forgetting, data)


def okid_era(u, y, lags, states, joint=True):
    """OKID and ERA: time-invariant ARX coefficients, Markov parameters of system and gain, realisation.

    With `joint`, the states are those of the inputs and of the innovations together. Else the gain follows from the
    observability matrix of the system alone.
    """
    u_size, y_size = (sizes_of(part.transpose(1, 0, 2)) for part in (u, y))
    arx = invariant_arx(u / u_size, y / y_size, lags)
    m, r = y.shape[2], u.shape[2]
    if states > lags * m:
        return None
    own = arx.own[0].reshape(lags, m, m).transpose(0, 2, 1)
    driven = arx.driven[0].reshape(lags, r, m).transpose(0, 2, 1)
    D = arx.direct[0].T
    count = 4 * lags + 2
    h = np.zeros((count, m, r + m))  # C A^i [B K]
    for i in range(count):
        if i < lags:
            h[i] = np.hstack([driven[i] + own[i] @ D, own[i]])
        for j in range(min(i, lags)):
            h[i] += own[j] @ h[i - 1 - j]
    half, columns = count // 2, slice(0, r + m if joint else r)
    H, shifted = (np.block([[h[i + j + first][:, columns] for j in range(half)] for i in range(half)])
                  for first in (0, 1))
    U, s, V = np.linalg.svd(H, full_matrices=False)
    if s[states - 1] <= SINGULAR * s[0]:
        return None
    root = np.sqrt(s[:states])
    O, X = U[:, :states] * root, root[:, None] * V[:states]
    inverse = (U[:, :states] / root).T
    A = inverse @ shifted @ (V[:states].T / root)
    K = inverse @ np.concatenate(h[:half])[:, r:]
    return StateSpace(*(part[None] for part in (A, X[:, :r] / u_size, y_size[:, None] * O[:m],
                                                y_size[:, None] * D / u_size, K / y_size)))


@dataclass(frozen=True)
class Delays:
    """z[k+1] = A z[k] + B u[k]. z has the last outputs and inputs, over their sizes. Those of step k are first."""

    A: np.ndarray
    B: np.ndarray
    u_size: np.ndarray
    y_size: np.ndarray
    lags: int

    def states(self, u, y):
        """z (T, N, ...), which at step k has the outputs of the steps k ... k-p+1 and the inputs of k-1 ... k-p+1."""
        parts = [y, lagged(y, self.lags - 1), lagged(u, self.lags - 1)] if self.lags > 1 else [y]
        return np.concatenate(parts, axis=2)

    def predict(self, u, y, horizons):
        u, y = u.transpose(1, 0, 2) / self.u_size, y.transpose(1, 0, 2) / self.y_size
        z, driven, m = self.states(u, y), u @ self.B.T, y.shape[2]

        def following():
            nonlocal z
            z = delayed(z @ self.A.T + driven)
            return z[:, :, :m] * self.y_size

        return collected(following, horizons)


def dmd_control(u, y, lags, rank):
    """Dynamic mode decomposition with control, of delays: one map for all steps, from a truncated SVD."""
    u, y = u.transpose(1, 0, 2), y.transpose(1, 0, 2)
    u_size, y_size = sizes_of(u), sizes_of(y)
    model = Delays(np.empty(0), np.empty(0), u_size, y_size, lags)
    u, y = u / u_size, y / y_size
    z = model.states(u, y)
    size = z.shape[2]
    before = np.concatenate([z, u], axis=2)[lags - 1 : -1].reshape(-1, size + u.shape[2])
    after = z[lags:].reshape(-1, size)
    if rank > before.shape[1]:
        return None
    R = triangles(np.concatenate([before, after], axis=1))
    U, s, V = np.linalg.svd(R[:, : before.shape[1]], full_matrices=False)
    both = (V[:rank].T / s[:rank]) @ (U[:, :rank].T @ R[:, before.shape[1] :])
    return Delays(both[:size].T, both[size:].T, u_size, y_size, lags)


def system_id(u, y, lags, states, free_y, dt=1.0):
    """SystemID's identification from forced and free responses (PyPI: systemID-light), and an observer gain.

    The package computes the Markov parameters of the gain, but no gain. It follows from them as B from those of the
    inputs. The models of the last steps are missing.
    """
    from systemID_light.model.model import discrete_ss_model

    _, steps, r = u.shape
    m = y.shape[2]
    rows = max(lags, -(-states // min(r, m))) + 1
    if states > min(lags * m, len(free_y), rows * r) or 2 * rows + 2 > steps:
        return None
    program = discrete_ss_model(model_type="linear", state_dimension=states, dt=dt)
    program.ltv_fit(forced_response_output_data=np.ascontiguousarray(y.transpose(2, 1, 0)),
                    input_data=np.ascontiguousarray(u.transpose(2, 1, 0)),
                    free_response_output_data=np.ascontiguousarray(free_y.transpose(2, 1, 0)),
                    observer_order=lags, p=rows, q=rows)
    found, end = program.fit_config, steps - rows - 1
    A, B, C, D = (np.array([matrix(k * dt) for k in range(end)])
                  for matrix in (program.A, program.B, program.C, program.D))
    K = np.empty((end, states, m))
    reference = np.linalg.pinv(found["Ok"][:, :, rows])
    for k in range(end):
        after = found["Ok1"][:, :, k]
        K[k] = -np.linalg.pinv(after) @ found["hkio"][k * m : (k + rows) * m, k * m : (k + 1) * m]
        if k < rows:  # there the package changes the coordinates of the states
            K[k] = reference @ after @ K[k]
    return Ending(StateSpace(A, B, C, D, K), end)


@dataclass(frozen=True)
class Ending:
    """A predictor of the first `end` steps alone."""

    inner: StateSpace
    end: int

    def predict(self, u, y, horizons):
        predicted = self.inner.predict(u[:, : self.end], y[:, : self.end], horizons)
        missing = ((0, 0), (0, y.shape[1] - self.end), (0, 0))
        return [np.pad(part, missing, constant_values=np.nan) for part in predicted]
