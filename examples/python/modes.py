# %% [markdown]
# # Natural frequencies over time
#
# A rocket burns its fuel: the slosh in its tank and the bending of its hull become faster. Two oscillators stand for
# them here, so that the truth is known. The example identifies a model from noisy experiments and reads its modes.
#
#     pip install . matplotlib
#     python examples/python/modes.py

# %%
# SPDX-License-Identifier: BSD-3-Clause
import matplotlib.pyplot as plt
import numpy as np
import tokid

# %% [markdown]
# ## Experiments
#
# The frequencies grow linearly. Each step is integrated in twenty parts with the frequencies at their centres. Two
# sensors measure both positions.

# %%
DT, STEPS, DAMPING = 0.05, 120, np.array([0.02, 0.01])


def frequency(time):
    """Natural frequencies [rad/s] of slosh and bending."""
    return np.array([4 + 0.2 * time, 12 + 1.2 * time])


def transition(k, parts=20):
    """The state matrix of step k; the states are positions and velocities."""
    matrix, h = np.eye(4), DT / parts
    for i in range(parts):
        w = frequency(k * DT + (i + 0.5) * h)
        rate = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(w**2), -np.diag(2 * DAMPING * w)]])
        half = h / 2 * rate
        matrix = np.linalg.solve(np.eye(4) - half, np.eye(4) + half) @ matrix
    return matrix


A = [transition(k) for k in range(STEPS)]
B = [DT * np.array([[0.0], [0.0], [1.0], [1.0]])] * STEPS
C = [np.array([[1.0, 0.5, 0.0, 0.0], [-0.3, 1.0, 0.0, 0.0]])] * STEPS
truth = tokid.Model.from_matrices(A, B, C, dt=DT)
rng = np.random.default_rng(1)
u = rng.normal(size=(40, STEPS, 1))
y = truth.simulate(u)
data = tokid.Ensemble(u, y + 0.02 * y.std() * rng.normal(size=y.shape), dt=DT)
model = tokid.identify(data, states=4)

# %% [markdown]
# ## Modes
#
# With the data, each frequency and each damping ratio has a 95 % interval, by a bootstrap. `valid` says where a mode
# varies slowly enough to be described by a frequency.

# %%
found = model.modes(data, replicates=40)
time, shown = found.time, [0, 2]  # the other columns are the conjugates
wanted = frequency(time).T
errors = 100 * np.abs(found.frequency[:, shown] / wanted - 1)
bounds = found.frequency_bounds
held = np.mean((bounds.lower[:, shown] <= wanted) & (wanted <= bounds.upper[:, shown]), axis=0)
print(f"Valid at {100 * found.valid[:, shown].mean():.0f} % of the steps")
for name, error, share in zip(("Slosh", "Bending"), errors.T, held):
    print(f"{name:<8}frequency: median error {np.median(error):.2f} %, worst {error.max():.2f} %; "
          f"intervals hold the truth at {100 * share:.0f} % of the steps")

# %%
plt.rcParams["svg.fonttype"] = "none"
plt.rcParams["svg.hashsalt"] = "modes"
figure, axes = plt.subplots(3, 1, figsize=(8, 7.5), layout="constrained", sharex=True)
for axis, i, name, w in zip(axes, shown, ("slosh", "bending"), wanted.T):
    axis.fill_between(time, bounds.lower[:, i], bounds.upper[:, i], color="C0", alpha=0.3, lw=0, label="95 % interval")
    axis.plot(time, w, "k-", lw=2, label="true")
    axis.plot(time, found.frequency[:, i], "C1--", lw=1.5, label="identified")
    axis.set(ylabel=f"{name} [rad/s]")
    axis.legend(loc="upper left")
damping = found.damping_bounds
for i, colour, name, ratio in zip(shown, ("C0", "C2"), ("slosh", "bending"), DAMPING):
    axes[2].fill_between(time, damping.lower[:, i], damping.upper[:, i], color=colour, alpha=0.2, lw=0)
    axes[2].plot(time, found.damping[:, i], "--", color=colour, lw=1.5, label=name)
    axes[2].axhline(ratio, color="k", lw=1)
axes[2].set(xlabel="time [s]", ylabel="damping ratio", ylim=(-0.02, 0.1))
axes[2].legend(loc="upper right")
figure.savefig("modes.svg", metadata={"Date": None})
