# SPDX-License-Identifier: BSD-3-Clause
"""Plants and conditions drawn at random, so that no choice of tokid can have been made for them.

`draw-SEED` is the name of a plant. Nothing is left out because a method does badly on it.
"""

import numpy as np
import scipy.linalg

from plants import Plant, at_rest

DT = 0.1


def log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def sizes_drawn(rng):
    """Numbers of states, outputs, inputs, steps and experiments."""
    return (round(log_uniform(rng, 1, 30)), rng.integers(1, 7), rng.integers(1, 7), round(log_uniform(rng, 40, 200)),
            round(log_uniform(rng, 10, 300)))


def rates(rng, states):
    """The matrix of a continuous plant: modes of random time constants, weakly coupled, three in ten with a pole at 0."""
    integrates = rng.random() < 0.3
    a, at = np.zeros((states, states)), int(integrates)
    while at < states:
        if states - at > 1 and rng.random() < 0.7:
            frequency, damping = log_uniform(rng, 0.2, 15), log_uniform(rng, 0.005, 0.7)
            a[at : at + 2, at : at + 2] = [[0, frequency], [-frequency, -2 * damping * frequency]]
            at += 2
        else:
            a[at, at] = -log_uniform(rng, 0.2, 20)
            at += 1
    coupling = rng.normal(size=(states, states)) * log_uniform(rng, 0.01, 1) / np.sqrt(states)
    coupling[:, : int(integrates)] = 0
    return a + (coupling if integrates else coupling - coupling.T)


def course(rng, steps):
    """A number for each step, between -1 and 1, that says how far the plant has changed; and the step of a jump."""
    kind, t = rng.choice(["none", "ramp", "slow", "fast", "jump"], p=[0.2, 0.25, 0.25, 0.15, 0.15]), np.arange(steps)
    jump = int(rng.uniform(0.3, 0.7) * steps)
    phase = rng.uniform(0, 2 * np.pi)
    found = {"none": 0.0 * t, "ramp": 2 * t / steps - 1, "slow": np.sin(2 * np.pi * t / steps + phase),
             "fast": np.sin(2 * np.pi * t / rng.uniform(12, 40) + phase), "jump": np.where(t < jump, -1.0, 1.0)}
    return found[kind], jump if kind == "jump" else None


def drawn(seed):
    """The plant of a seed."""
    rng = np.random.default_rng([1704, seed])
    n, m, r, steps, _ = sizes_drawn(rng)
    a = rates(rng, n)
    delay = int(rng.integers(1, 13)) if rng.random() < 0.25 else 0
    direct = 0.3 * rng.normal(size=(m, r)) * (delay == 0 and rng.random() < 0.3)
    change, jump = course(rng, steps)
    size = rng.uniform(0.05, 0.5)
    of_rates = size * rng.uniform(-1, 1, n)  # every row of A by its own factor: time constants and frequencies change
    b0, b1, c0, c1 = (rng.normal(size=shape) for shape in ((n, r), (n, r), (m, n), (m, n)))
    total = n + delay * r
    A, B, C = np.zeros((steps, total, total)), np.zeros((steps, total, r)), np.zeros((steps, m, total))
    for k in range(steps):
        rate = np.exp(of_rates * change[k])[:, None] * a
        b = b0 + size * change[k] * b1
        held = scipy.linalg.expm(DT * np.block([[rate, b], [np.zeros((r, n + r))]]))
        A[k, :n, :n] = held[:n, :n]
        C[k, :, :n] = c0 + size * change[k] * c1
        (A[k, :n, n : n + r] if delay else B[k, :n])[:] = held[:n, n:]  # the oldest of the delayed inputs drives
        if delay:
            A[k, n : total - r, n + r :] = np.eye((delay - 1) * r)
            B[k, total - r :] = np.eye(r)
    closed = max(np.abs(np.linalg.eigvals(each)).max() for each in A) > 1.02
    return Plant(f"draw-{seed}", "drawn at random", DT, lambda x, u, k: x @ A[k].T + u @ B[k].T,
                 lambda x, u, k: x @ C[k].T + u @ direct.T, **at_rest(total, r, steps), u_std=np.ones(r),
                 x_std=np.r_[np.ones(n), np.zeros(total - n)] * np.sqrt(DT), closed=closed, jump=jump)


def condition_drawn(seed, closed):
    """Arguments of the `Condition` of a seed."""
    experiments = sizes_drawn(np.random.default_rng([1704, seed]))[-1]
    rng = np.random.default_rng([1705, seed])
    noise = log_uniform(rng, 1e-8, 0.3)
    loop = "delayed" if closed or rng.random() < 0.2 else "natural"
    return {"experiments": experiments, "noise": noise, "coloured": bool(rng.random() < 0.2), "loop": loop,
            "initial": str(rng.choice(["zero", "unknown"]))}
