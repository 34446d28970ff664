#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""TOKID in NumPy, all steps at once: the time of tokid is measured against this.

    numpy_tokid.py DATA.npz -o MODEL.npz [--lags P] [--states N] [--check MODEL_OF_TOKID.npz]

Zero initial states and complete data. Numbers in round brackets are the equations of docs/math.md. Each decomposition
is one call for a stack of steps; the loops run over lags and blocks of steps, not over steps. The time printed is that
from the file to the file, without the start of Python. --check compares the pulse responses with those of a model that
tokid identified from the same data, and fails beyond 1e-8.
"""

import argparse
import json
import sys
import time

import numpy as np

BLOCK = 2**17  # numbers in the windows of the steps that are worked at together: they stay in the cache


def gtv_arx(u, y, lags):
    """D (T, m, r), and M[j - 1] (T, m, r + m), which has h1 and -h2 of lag j: least squares (16)-(19)."""
    experiments, steps, inputs = u.shape
    channels = inputs + y.shape[2]
    columns = inputs + lags * channels
    # Steps first. Zeros before step 0 get zero coefficients, so that all steps have the same shape.
    z = np.zeros((lags + steps, experiments, channels))
    z[lags:, :, :inputs], z[lags:, :, inputs:] = u.transpose(1, 0, 2), y.transpose(1, 0, 2)
    found = np.empty((steps, columns, y.shape[2]))
    block = max(1, BLOCK // (experiments * (columns + y.shape[2])))
    for begin in range(0, steps, block):
        now, end = lags + begin, lags + min(begin + block, steps)
        W = np.concatenate([z[now:end, :, :inputs], *(z[now - j:end - j] for j in range(1, lags + 1)),
                            z[now:end, :, inputs:]], axis=2)
        R = np.linalg.qr(W, mode="r")
        diagonal = np.abs(np.diagonal(R, axis1=1, axis2=2)[:, :columns])
        full = (R.shape[1] >= columns) & (diagonal.min(axis=1) > 1e-10 * diagonal.max(axis=1))
        M = found[begin:begin + len(R)]
        M[full] = np.linalg.solve(R[full, :columns, :columns], R[full, :columns, columns:])
        M[~full] = np.linalg.pinv(R[~full, :, :columns], rcond=1e-12) @ R[~full, :, columns:]  # of least norm
    found = found.transpose(0, 2, 1)
    return found[..., :inputs], np.split(found[..., inputs:], lags, axis=2)


def markov(D, M, band):
    """h[g - 1] (T, m, r + m), which has h_{k,k-g} and its gain: (28), (29) and (34), (35); zeros for k < g."""
    steps, outputs, inputs = D.shape
    h = np.zeros((band, steps, outputs, inputs + outputs))
    for g in range(1, min(band, steps - 1) + 1):
        now = h[g - 1, g:]
        if g <= len(M):
            now[..., :inputs] = M[g - 1][g:, :, :inputs] + M[g - 1][g:, :, inputs:] @ D[:-g]
            now[..., inputs:] = -M[g - 1][g:, :, inputs:]
        for j in range(1, min(g - 1, len(M)) + 1):
            now += M[j - 1][g:, :, inputs:] @ h[g - j - 1, g - j:steps - j]
    return h


def tvera(D, h, rows, cols, states):
    """A, B, C, G and the number of states of all steps from the Hankel matrices H_k = [h_{k+a,k-1-b}] (37)-(41)."""
    steps, outputs, inputs = D.shape
    H = np.zeros((steps + 1, rows, outputs, cols, inputs))  # zeros beyond both ends of the record
    for a in range(rows):
        for b in range(cols):
            H[:steps - a, a, :, b] = h[a + b, a:, :, :inputs]
    U, s, _ = np.linalg.svd(H.reshape(steps + 1, rows * outputs, cols * inputs), full_matrices=False)
    U, s = U[..., :states], s[:, :states]
    size = np.linalg.norm(D, axis=(1, 2))
    kept = s > 1e-9 * np.maximum(s[:, :1], np.append(size, 1.0)[:, None])
    O = U * np.where(kept, np.sqrt(s), 0.0)[:, None]
    inverse = (U * np.where(kept, 1 / np.sqrt(np.where(kept, s, 1.0)), 0.0)[:, None]).transpose(0, 2, 1)
    # The rows that two steps share. Where all states are kept they have full rank.
    shared, later = O[1:, :-outputs], O[:-1, outputs:]
    full = kept[1:].all(axis=1) & (np.arange(steps) < steps - rows)
    A = np.empty((steps, states, states))
    Q, R = np.linalg.qr(shared[full])
    A[full] = np.linalg.solve(R, Q.transpose(0, 2, 1) @ later[full])
    A[~full] = np.linalg.pinv(shared[~full], rcond=1e-12) @ later[~full]
    # Column k of the next Hankel matrix, h_{k+1+a,k}
    column = np.zeros((steps, rows, outputs, inputs + outputs))
    for a in range(min(rows, steps - 1)):
        column[:steps - 1 - a, a] = h[a, a + 1:]
    BG = inverse[1:] @ column.reshape(steps, rows * outputs, inputs + outputs)
    return A, BG[..., :inputs], O[:-1, :outputs], BG[..., inputs:], kept.sum(axis=1)


def model_of(u, y, lags, states=0):
    """A, B, C, D, G (T, ...) and state_dim (T + 1), zeros beyond the states of a step."""
    outputs = y.shape[2]
    states = states or lags * outputs
    rows, cols = max(lags, -(-states // outputs)) + 1, max(lags, states)
    D, M = gtv_arx(u, y, lags)
    A, B, C, G, state_dim = tvera(D, markov(D, M, rows + cols - 1), rows, cols, states)
    return {"A": A, "B": B, "C": C, "D": D, "G": G, "state_dim": state_dim}


def validate(model, u, y):
    """Root mean squares of the errors of simulation and of one-step prediction, (2, m)."""
    A, B, C, D, G = (model[name].transpose(0, 2, 1) for name in "ABCDG")
    outputs, inputs = y.transpose(1, 0, 2), u.transpose(1, 0, 2)
    direct, driven = inputs @ D - outputs, inputs @ B
    squares = np.zeros((2, y.shape[2]))
    for mode, gain in enumerate((np.zeros_like(G), G)):
        # The observer (9): x_{k+1} = A x + B u + G (C x + D u - y). Only this recursion needs a loop over the steps.
        closed, drive = A + C @ gain, driven + direct @ gain
        x = np.zeros((len(A) + 1, len(u), A.shape[1]))
        for now, following, a, d in zip(x, x[1:], closed, drive):
            np.matmul(now, a, out=following)
            following += d
        squares[mode] = np.square(x[:-1] @ C + direct).mean(axis=(0, 1))
    return np.sqrt(squares)


def identify(data, model, lags, states):
    with np.load(data) as file:
        u, y, dt = file["u"], file["y"], file["dt"]
    np.savez(model, **model_of(u, y, lags, states), dt=dt)


def pulse_responses(A, B, C, D, band):
    """h_{k,i} with k - i <= band, entry (i, k - i), and D_k for k = i; zeros beyond the last step."""
    steps = len(A)
    response = np.zeros((steps, min(band, steps - 1) + 1, *D.shape[1:]))
    response[:, 0], x = D, B
    for g in range(1, response.shape[1]):
        x = x[:steps - g]  # after g steps, of the pulses that have that many before them
        response[:steps - g, g] = C[g:] @ x
        x = A[g:] @ x
    return response


def largest_difference(model, reference, band=20):
    """Between the pulse responses, over the largest of the reference. Both: what has the arrays A, B, C, D."""
    own, other = (pulse_responses(*(source[name] for name in "ABCD"), band) for source in (model, reference))
    if own.shape != other.shape:
        return np.inf
    return np.abs(own - other).max() / np.abs(other).max()


def difference_of_files(model, reference):
    with np.load(model) as own, np.load(reference) as other:
        for file in (own, other):
            assert file.get("k_begin", 0) == 0, "a model from step 0 on is needed"
        return largest_difference(own, other)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--lags", type=int, default=2)
    parser.add_argument("--states", type=int, default=0, help="at most so many; default: lags times outputs")
    parser.add_argument("--check", metavar="MODEL")
    call = parser.parse_args()
    begin = time.perf_counter()
    identify(call.data, call.output, call.lags, call.states)
    result = {"seconds": time.perf_counter() - begin}
    if call.check:
        result["difference"] = difference_of_files(call.output, call.check)
    print(json.dumps(result))
    return 0 if result.get("difference", 0.0) <= 1e-8 else 1


if __name__ == "__main__":
    sys.exit(main())
