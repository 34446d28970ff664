# %% [markdown]
# # Learning from run to run
#
# A batch reactor is heated along a profile. Its rate constants grow with temperature and its content shrinks, so the
# system varies during the batch, in the same way each time. A model of the departures, identified from forty earlier
# batches, tells how to change the heating from one run to the next until the temperature follows a new profile.
#
#     pip install . matplotlib
#     python examples/python/learning.py

# %%
# SPDX-License-Identifier: BSD-3-Clause
import matplotlib.pyplot as plt
import numpy as np
import tokid

STEPS, DT = 80, 30.0  # steps, seconds
time = DT * np.arange(STEPS)
heating = 20.0 + 25.0 * (time < 1200.0) + 5.0 * np.sin(time / 400.0)  # [kW], the nominal input


def batch(u, rng):
    """Measured temperature [K] of a batch with the heating u (T,): exothermic reaction, losses to the jacket."""
    temperature, reactant, y = 300.0, 1.0, np.empty(STEPS)
    for k in range(STEPS):
        y[k] = temperature + 0.02 * rng.standard_normal()
        for _ in range(10):  # Euler's method, 3 s
            rate = 1.2e4 * np.exp(-5400.0 / temperature) * reactant
            capacity = 260.0 + 120.0 * reactant  # [kJ/K]; the solvent evaporates with the reaction
            reactant -= 3.0 * rate
            temperature += 3.0 * (u[k] - 0.25 * (temperature - 295.0) + 4000.0 * rate) / capacity
    return y


# %% [markdown]
# ## Earlier batches identify the model
#
# The operators varied the heating a little. The mean over the batches becomes the nominal trajectory, and the model
# describes departures from it.

# %%
rng = np.random.default_rng(1)
u = heating + 2.0 * rng.standard_normal((40, STEPS))
y = np.array([batch(inputs, rng) for inputs in u])
model = tokid.identify(u[:, :, None], y[:, :, None], dt=DT, nominal="mean", feedthrough=False, input_names=["heating"],
                       output_names=["temperature"], input_units=["kW"], output_units=["K"])
print(model)

# %% [markdown]
# ## A new profile
#
# The temperature shall rise by fifteen kelvin more in the second half of the batch. `learn` takes the last run and gives
# the inputs of the next one. A model that is only right for small departures is enough: what it gets wrong, the next run
# shows.

# %%
reference = y.mean(axis=0) + 15.0 / (1.0 + np.exp(-(time - 1200.0) / 120.0))
inputs, runs, errors = heating, [], []
for run in range(6):
    runs.append(batch(inputs, rng))
    errors.append(np.sqrt(np.mean((reference - runs[-1]) ** 2)))
    print(f"Run {run}: RMS error {errors[-1]:.3f} K")
    inputs = model.learn(reference[:, None], inputs[:, None], runs[-1][:, None], error_weight=1.0,
                         input_change_weight=1e-4).u[:, 0]

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
above.plot(time / 60, reference, "k-", lw=2.5, label="new profile")
for run, style in ((0, "C7-"), (1, "C1--"), (5, "C0-")):
    above.plot(time / 60, runs[run], style, lw=1.3, label=f"run {run}")
above.set(xlabel="time [min]", ylabel="temperature [K]", title="The batch learns its profile")
above.legend()
below.semilogy(errors, "C0-o")
below.axhline(0.02, color="C7", ls="--", lw=1)
below.annotate("noise of the sensor", (0.1, 0.0215), color="C7")
below.set(xlabel="run", ylabel="RMS error [K]")
figure.savefig("learning.svg")
