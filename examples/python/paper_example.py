# %% [markdown]
# # The example of the paper
#
# Majji, Juang and Junkins identify an oscillator whose stiffness varies periodically: four states, two inputs, two
# outputs, not stable. `tokid.example` simulates experiments on it, and since its matrices are known, a model can be
# compared with the truth.
#
#     pip install . matplotlib
#     python examples/python/paper_example.py

# %%
# SPDX-License-Identifier: BSD-3-Clause
import matplotlib.pyplot as plt
import numpy as np
import tokid

# %% [markdown]
# ## Without noise
#
# Ten experiments from rest, 100 steps of 50 ms, and eight free responses, which let the model have all states from the
# first step on. That is as few as the method needs: a model of *every* step from ten experiments.

# %%
truth = tokid.example_system("oscillator", steps=100)
data = tokid.example("oscillator", experiments=10, steps=100, free_responses=8)
model = tokid.identify(data, lags=2)
print(data)
print(model)

# %% [markdown]
# States have no meaning by themselves, so matrices are not to be compared as they are. Pulse responses can be, and
# outputs for new inputs; `align` puts the model into the coordinates of the truth, where the matrices agree too.

# %%
pulse_error = model.difference(truth).largest
fresh = tokid.example("oscillator", experiments=5, steps=100, seed=2)
simulated = model.simulate(fresh)
output_error = np.abs(simulated - fresh.y).max() / np.abs(fresh.y).max()
aligned = model.align(truth)
matrix_error = max(np.abs(aligned.at(k).A - truth.at(k).A).max() for k in range(model.full_begin, model.full_end - 1))
print(f"Largest errors: pulse responses {pulse_error:.0e}, outputs {output_error:.0e}, A[k] {matrix_error:.0e}")

# %% [markdown]
# The observer that comes with the model forgets every error within two steps, the lag order: the product of two
# successive closed loops vanishes, although neither of them does. (The first two steps have no past to go by.)

# %%
products = model.deadbeat_products()[2:]
single = min(np.linalg.norm(model.at(k).closed_loop) for k in range(2, model.full_end))
print(f"Closed loops: norm {single:.1f} at least, products of two in a row {products.max():.0e} at most")

# %% [markdown]
# ## With noise
#
# Noise on states and outputs, eighty experiments. Everything is left to tokid: lag order, smoothing over time,
# number of states, maximum likelihood. The yardstick is the true system with its true Kalman filter, which no model
# can beat.

# %%
noise = {"process_noise": 0.02, "measurement_noise": 0.05, "steps": 50}
noisy = tokid.identify(tokid.example("oscillator", experiments=80, **noise))
best = tokid.example_system("oscillator", **noise)
judge = tokid.example("oscillator", experiments=50, seed=3, **noise)
fits = {}
print(f"{noisy.states} states. Fit on fresh experiments [%]:")
print(f"{'':16}one step    ten steps    simulation")
for name, candidate in (("identified", noisy), ("true system", best)):
    found = candidate.validate(judge, horizon=10)
    fits[name] = [found.one_step.fit.mean(), found.horizon.fit.mean(), found.simulation.fit.mean()]
    print(f"{name:<16}{fits[name][0]:8.2f}{fits[name][1]:13.2f}{fits[name][2]:14.2f}")

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
steps = np.arange(model.full_begin, model.full_end - 1)
for number, (name, system, style) in enumerate((("true", truth, "k-"), ("identified", aligned, "C1--"))):
    eigenvalues = np.array([np.linalg.eigvals(system.at(k).A) for k in steps])
    angles = np.sort(np.angle(eigenvalues), axis=1)[:, 2:]  # those of the conjugates are the same
    above.plot(steps, angles, style, lw=2 - number, label=[name, None])
above.set(xlabel="step k", ylabel="angles of the eigenvalues of A[k]", title="In the coordinates of the true system")
above.legend()
below.plot(fresh.time, fresh.y[0], "k-", lw=2, label=["true", None])
below.plot(fresh.time, simulated[0], "C1--", lw=1, label=["identified", None])
below.set(xlabel="time [s]", ylabel="outputs", title="A fresh experiment, simulated")
below.legend()
figure.savefig("paper_example.svg")
