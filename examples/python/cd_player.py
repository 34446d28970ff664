# %% [markdown]
# # The arm of a CD player
#
# One measured record of the swing arm of a CD player: the forces of two actuators are the inputs, the tracking errors of
# the laser in two directions the outputs. A controller was at work during the measurement. The system does not vary in
# time.
#
#     pip install . matplotlib
#     python examples/python/cd_player.py
#
# The record is that of DaISy (KU Leuven), which github.com/SLICOT/SLICOT-SystemIdentification distributes. It is no part
# of tokid: put it as `cd_player_arm.csv`, with the columns `u1`, `u2`, `y1` and `y2`, into the current folder, or into the
# folder `lti` of the one that the environment variable `TOKID_DATA` names.

# %%
# SPDX-License-Identifier: BSD-3-Clause
import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import tokid

places = [Path("cd_player_arm.csv"), Path(os.environ.get("TOKID_DATA", ".")) / "lti" / "cd_player_arm.csv"]
path = next((place for place in places if place.exists()), None)
if path is None:
    sys.exit(f"{places[-1]} is absent; the example says where the record comes from")
samples = np.loadtxt(path, delimiter=",", skiprows=1)
half = len(samples) // 2
samples -= samples[:half].mean(axis=0)
names = {"dt": 1.0, "initial_state": "unknown", "input_names": ["force1", "force2"], "output_names": ["error1", "error2"]}
first, second = (tokid.Ensemble(part[:, :2], part[:, 2:], **names) for part in np.split(samples, [half]))
print(first)

# %% [markdown]
# ## How many states?
#
# Models of two to twelve states, identified from the first half, predict the second half. A simulation from the forces
# alone is harder than a prediction with the measured errors in the loop. Without maximum likelihood, each model takes a
# fraction of a second.

# %%
table, models = {}, {}
for states in (2, 4, 6, 8, 10, 12):
    models[states] = model = tokid.identify(first, states=states, period="invariant", refine=False)
    found = model.validate(second, horizon=10)
    table[states] = [found.simulation.fit, found.horizon.fit, found.one_step.fit]
print(f"{'states':<8}{'simulation [%]':>18}{'ten steps [%]':>18}{'one step [%]':>18}")
for states, fits in table.items():
    print(f"{states:<8}" + "".join(f"{fit[0]:10.1f}{fit[1]:8.1f}" for fit in fits))

# %% [markdown]
# Octave's n4sid, with eight states, has 57.9 and 77.0 % in simulation, and 81.8 and 80.6 % one step ahead.

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 6), layout="constrained")
predicted = models[12].predict(second, horizon=10)
shown = slice(500, 620)
for output, axis in enumerate((above, below)):
    axis.plot(np.arange(half)[shown], second.y[0, shown, output], "k-", lw=2, label="measured")
    axis.plot(np.arange(half)[shown], predicted[0, shown, output], "C1--", lw=1.5, label="predicted ten steps ahead")
    axis.set(ylabel=second.output_names[output])
above.set(title="Part of the second half, twelve states")
above.legend()
below.set(xlabel="step k")
figure.savefig("cd_player.svg")
