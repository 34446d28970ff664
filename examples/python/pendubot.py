# %% [markdown]
# # Swing-ups of a real robot
#
# The pendubot is a double pendulum whose upper joint alone has a motor. Here are ten measured swing-ups, disturbed by
# random bumps of the torque. A feedback controller is at work, the joints stick, and the equilibrium is not stable: no
# model can simulate the whole manoeuvre, so predictions of runs that were left out are judged.
#
#     pip install . matplotlib
#     python examples/python/pendubot.py
#
# The runs come from github.com/dfki-ric-underactuated-lab/double_pendulum,
# leaderboard/pendubot/real_hardware_perturbed_v2, ilqr_tvlqr_lqr/experiment01 … 10/trajectory.csv. Please cite Wiebe,
# Kumar et al., "An Open Source Dual Purpose Acrobot and Pendubot Platform". They are no part of tokid: put them, on an
# even grid of 195 steps of 20 ms, into `pendubot.npz` in the current folder, or in the folder `pendubot` of the one that
# the environment variable `TOKID_DATA` names:
#
#     u  (10, 195, 2)  measured joint torques [N m], mean from one step to the next
#     y  (10, 195, 2)  positions of both joints [rad], at the step
#
# (With a mask `perturbed`, the file may hold other runs, and further outputs behind the positions.)

# %%
# SPDX-License-Identifier: BSD-3-Clause
import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import tokid

places = [Path("pendubot.npz"), Path(os.environ.get("TOKID_DATA", ".")) / "pendubot" / "pendubot.npz"]
path = next((place for place in places if place.exists()), None)
if path is None:
    sys.exit(f"{places[-1]} is absent; the example says where the runs come from")
with np.load(path) as file:
    runs = np.flatnonzero(file["perturbed"]) if "perturbed" in file else np.arange(len(file["u"]))
    u, y = file["u"][runs], file["y"][runs, :, :2]
data = tokid.Ensemble(u, y, dt=0.02, initial_state="unknown", input_names=["torque1", "torque2"],
                      output_names=["pos1", "pos2"], input_units=["N m", "N m"], output_units=["rad", "rad"])
print(data)

# %% [markdown]
# ## Seven runs identify, three are kept back
#
# All choices are tokid's: that the mean motion is to be removed, lag order, smoothing over time, states, refinement.
# Seven runs are fewer than the unknowns of a single step; neighbouring steps help each other.

# %%
order = np.random.default_rng(0).permutation(len(data))
training, fresh = (data.subset(np.sort(rows)) for rows in np.split(order, [int(0.7 * len(data))]))
model = tokid.identify(training)
print(model)
print(f"Lag order {model.identification.lags}, mean motion {'removed' if model.identification.nominal else 'kept'}")

# %% [markdown]
# ## Predictions
#
# Fit of predictions on the runs kept back: 100 % is perfect, 0 % as good as the mean motion of the training runs.

# %%
HORIZONS = (1, 5, 10, 20)
fits = np.array([model.validate(fresh, horizon=horizon).horizon.fit for horizon in HORIZONS])
print(f"{'steps ahead':<12}{'pos1 [%]':>10}{'pos2 [%]':>10}")
for horizon, fit in zip(HORIZONS, fits):
    print(f"{horizon:<12}{fit[0]:10.1f}{fit[1]:10.1f}")

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, axes = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
predicted = model.predict(fresh, horizon=10)
for joint, axis in enumerate(axes):
    for y, style, label in ((fresh.y, "k-", "measured"), (predicted, "C0--", "predicted 0.2 s ahead")):
        lines = axis.plot(fresh.time, (y - model.y_nominal)[:, :, joint].T, style, lw=1)
        lines[0].set_label(label)
    axis.set(ylabel=f"{fresh.output_names[joint]} less the mean motion [rad]")
axes[0].set(title="Three runs that the model has not seen")
axes[0].legend()
axes[1].set(xlabel="time [s]")
figure.savefig("pendubot.svg")
