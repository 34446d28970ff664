# %% [markdown]
# # From a plan to a model
#
# How many experiments does a system need, and which inputs? `tokid.plan` answers both. Here a simulated oscillator, four
# states, two inputs and two outputs, stands for the plant: its experiments are made with the planned inputs.
#
#     pip install . matplotlib
#     python examples/python/plan.py

# %%
# SPDX-License-Identifier: BSD-3-Clause
import warnings

import matplotlib.pyplot as plt
import numpy as np
import tokid

STEPS, PROCESS, MEASUREMENT = 40, 0.01, 0.02
plant = tokid.example_system("oscillator", steps=STEPS, process_noise=PROCESS, measurement_noise=MEASUREMENT)


def measure(u, seed):
    """Experiments on the plant with the inputs u (N, T, r), from rest: an ensemble with noise."""
    rng = np.random.default_rng(seed)
    x, y = np.zeros((len(u), 4)), np.empty((len(u), STEPS, 2))
    for k, (a, b, c, d) in enumerate(zip(plant.A, plant.B, plant.C, plant.D)):
        y[:, k] = x @ c.T + u[:, k] @ d.T + MEASUREMENT * rng.standard_normal((len(u), 2))
        x = x @ a.T + u[:, k] @ b.T + PROCESS * rng.standard_normal((len(u), 4))
    return tokid.Ensemble(u, y, dt=plant.dt, initial_state="zero")


# %% [markdown]
# ## The plan
#
# The sizes of the system, the limit of the inputs and the noise are all that it takes.

# %%
plan = tokid.plan(states=4, inputs=2, outputs=2, steps=STEPS, amplitude=1.0, noise=(0.0, MEASUREMENT), dt=plant.dt)
print(f"{plan.experiments} experiments with {plan.kind} inputs")

# %% [markdown]
# ## The experiments, and models
#
# The planned number of experiments, a quarter of it, and twice as many. Beside the planned inputs there are those of step
# tests: in each experiment, each input is constant at a random height. They tell the inputs of neighbouring steps apart
# by the noise alone, so that more experiments do not help. The lag order is twice that of the plan, because a longer past
# averages the noise.

# %%
counts = [plan.experiments // 4, plan.experiments, 2 * plan.experiments]
errors = {"planned inputs": [], "step tests": []}
for count in counts:
    planned = tokid.plan(states=4, inputs=2, outputs=2, steps=STEPS, amplitude=1.0, experiments=count, dt=plant.dt).u
    steps = np.repeat(np.random.default_rng(4).uniform(-1, 1, (count, 1, 2)), STEPS, axis=1)
    for name, u in zip(errors, (planned, steps)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", tokid.TokidWarning)  # they say what is wrong with step tests
            model = tokid.identify(measure(u, seed=7), states=4, lags=2 * plan.lags, nominal="none", refine=False)
        errors[name].append(np.sqrt(np.mean(model.difference(plant).relative_error**2)))
print("Relative errors of the pulse responses")
print(f"{'experiments':<16}" + "".join(f"{count:8}" for count in counts))
for name, values in errors.items():
    print(f"{name:<16}" + "".join(f"{value:8.3f}" for value in values))

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
for n in range(3):
    above.step(plan.inputs.time, plan.u[n, :, 0] + 2.5 * n, where="post", color="C0", lw=1)
above.set(xlabel="time [s]", ylabel="input u1, shifted", title="Planned inputs of three experiments")
for (name, values), style in zip(errors.items(), ("C0-o", "C1-s")):
    below.loglog(counts, values, style, label=name)
below.set(xlabel="number of experiments", ylabel="relative error of pulse responses", xticks=counts, xticklabels=counts,
          title="What the plan is worth")
below.minorticks_off()
below.legend()
figure.savefig("plan.svg")
