#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""TOKID as a straightforward script, equation by equation: what the tool's time is measured against.

    numpy_tokid.py DATA.npz -o MODEL.npz [--lags P] [--states N] [--check MODEL_OF_TOKID.npz]

Zero initial states, noise-free and complete data. Numbers in round brackets are the equations of docs/math.md. The time
printed is that from the file to the file, without the start of Python. --check compares the pulse responses with those
of a model that tokid identified from the same data, and fails beyond 1e-8.
"""

import argparse
import json
import sys
import time

import numpy as np


def gtv_arx(u, y, lags):
    """D[k], h1[k][j], h2[k][j], 1 <= j <= p_k: least squares of every step by itself (16)-(19)."""
    steps, inputs = u.shape[1:]
    D, h1, h2 = [], [], []
    for k in range(steps):
        p = min(lags, k)
        regressors = [u[:, k]]
        for j in range(1, p + 1):
            regressors += [u[:, k - j], y[:, k - j]]
        W = np.hstack(regressors)
        M = np.linalg.lstsq(W, y[:, k], rcond=None)[0].T
        D.append(M[:, :inputs])
        blocks = np.split(M[:, inputs:], p, axis=1) if p > 0 else []
        h1.append({j: block[:, :inputs] for j, block in enumerate(blocks, 1)})
        h2.append({j: -block[:, inputs:] for j, block in enumerate(blocks, 1)})
    return D, h1, h2


def markov(D, h1, h2, band):
    """h[k, i] and h_gain[k, i], 1 <= k - i <= band: (28), (29) and (34), (35)."""
    steps = len(D)
    h, h_gain = {}, {}
    for i in range(steps):
        for k in range(i + 1, min(i + band + 1, steps)):
            g, p = k - i, len(h1[k])
            if g <= p:
                system, gain = h1[k][g] - h2[k][g] @ D[i], h2[k][g].copy()
            else:
                system, gain = np.zeros_like(D[i]), np.zeros((len(D[i]), len(D[i])))
            for j in range(1, min(g - 1, p) + 1):
                system -= h2[k][j] @ h[k - j, i]
                gain -= h2[k][j] @ h_gain[k - j, i]
            h[k, i], h_gain[k, i] = system, gain
    return h, h_gain


def tvera(D, h, h_gain, rows, cols, states):
    """A, B, C, D, G of every step from the Hankel matrices H_k = [h_{k+a,k-1-b}] (37)-(41)."""
    steps, (outputs, inputs) = len(D), D[0].shape

    def observability(k):
        a_end, b_end = min(rows, steps - k), min(cols, k)
        if a_end <= 0 or b_end <= 0:
            return np.zeros((max(a_end, 0) * outputs, 0))
        H = np.block([[h[k + a, k - 1 - b] for b in range(b_end)] for a in range(a_end)])
        U, s, _ = np.linalg.svd(H)
        n = min(states, np.count_nonzero(s > 1e-9 * max(s[0], np.linalg.norm(D[k]))))
        return U[:, :n] * np.sqrt(s[:n])

    A, B, C, G = [], [], [], []
    O = observability(0)
    for k in range(steps):
        following = observability(k + 1)
        blocks = len(following) // outputs
        C.append(O[:outputs])
        if blocks == 0:
            A.append(np.zeros((0, O.shape[1])))
            B.append(np.zeros((0, inputs)))
            G.append(np.zeros((0, outputs)))
            break
        shared = len(O) - outputs
        A.append(np.linalg.pinv(following[:shared]) @ O[outputs:])
        inverse = np.linalg.pinv(following)
        B.append(inverse @ np.vstack([h[k + 1 + a, k] for a in range(blocks)]))
        G.append(inverse @ np.vstack([h_gain[k + 1 + a, k] for a in range(blocks)]))
        O = following
    return A, B, C, D, G


def padded(matrices):
    """One array (S, rows, columns), zeros beyond each matrix."""
    shape = np.max([m.shape for m in matrices], axis=0)
    result = np.zeros((len(matrices), *shape))
    for entry, m in zip(result, matrices):
        entry[:m.shape[0], :m.shape[1]] = m
    return result


def identify(data, model, lags, states):
    with np.load(data) as file:
        u, y, dt = file["u"], file["y"], file["dt"]
    outputs = y.shape[2]
    states = states or lags * outputs
    rows, cols = max(lags, -(-states // outputs)) + 1, max(lags, states)
    D, h1, h2 = gtv_arx(u, y, lags)
    h, h_gain = markov(D, h1, h2, rows + cols - 1)
    A, B, C, D, G = tvera(D, h, h_gain, rows, cols, states)
    state_dim = [c.shape[1] for c in C] + [A[-1].shape[0]]
    n = max(state_dim)
    np.savez(model, A=padded([*A, np.zeros((n, n))])[:-1], B=padded([*B, np.zeros((n, 0))])[:-1],
             C=padded([*C, np.zeros((0, n))])[:-1], D=np.array(D), G=padded([*G, np.zeros((n, 0))])[:-1],
             state_dim=state_dim, dt=dt)


def pulse_responses(path, band):
    """h_{k,i} with k - i <= band, entry (i, k - i), and D_k for k = i; zeros beyond the last step."""
    with np.load(path) as file:
        assert file.get("k_begin", 0) == 0, f"{path}: a model from step 0 on is needed"
        A, B, C, D = (file[name] for name in "ABCD")
    steps = len(A)
    response = np.zeros((steps, band + 1, *D.shape[1:]))
    for i in range(steps):
        response[i, 0] = D[i]
        x = B[i]
        for k in range(i + 1, min(i + band + 1, steps)):
            response[i, k - i] = C[k] @ x
            x = A[k] @ x
    return response


def largest_difference(model, reference, band=20):
    """Of the pulse responses, over the largest."""
    own, other = pulse_responses(model, band), pulse_responses(reference, band)
    if own.shape != other.shape:
        return np.inf
    return np.abs(own - other).max() / np.abs(other).max()


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
        result["difference"] = largest_difference(call.output, call.check)
    print(json.dumps(result))
    return 0 if result.get("difference", 0.0) <= 1e-8 else 1


if __name__ == "__main__":
    sys.exit(main())
