# %% [markdown]
# # A crane in MuJoCo, run by exported C code
#
# A crane carries a load along its rail and hoists it on the way, so the pendulum changes its length. Forty disturbed runs
# give a model and an LQG controller. Both are exported as C code in single precision and compiled. The code then
# controls the simulation of [MuJoCo](https://mujoco.org): it reads the two encoders and commands the force, as on the
# board of a machine. A gust hits the load in each run, and a tenth of the samples is lost.
#
#     pip install . mujoco matplotlib
#     python examples/python/mujoco_crane.py
#
# The compiler is `cc`.

# %%
# SPDX-License-Identifier: BSD-3-Clause
import ctypes
import subprocess
import time
import warnings

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import tokid

# %% [markdown]
# ## The machine
#
# Every 40 ms two encoders are read, the position of the trolley [m] and the angle of the rope [rad], and a force is
# commanded [N]. The motor follows with a lag of 50 ms. The hoist takes in a metre of rope between 0.5 s and 4.5 s.

# %%
crane = mujoco.MjModel.from_xml_string("""
<mujoco model="crane">
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <body name="trolley">
      <joint name="rail" type="slide" axis="1 0 0" damping="2"/>
      <geom type="box" size="0.1 0.05 0.05" mass="2"/>
      <body name="rope">
        <joint name="swing" type="hinge" axis="0 -1 0" damping="0.005"/>
        <geom type="sphere" size="0.01" mass="0.01"/>
        <body name="load">
          <joint name="hoist" type="slide" axis="0 0 -1" damping="5"/>
          <geom type="sphere" size="0.06" mass="1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general joint="rail" dyntype="filterexact" dynprm="0.05" gainprm="1"/>
    <position joint="hoist" kp="2000" kv="100"/>
  </actuator>
</mujoco>
""")
data = mujoco.MjData(crane)
load = crane.body("load").id
STEPS, DT = 150, 0.04  # 6 s
NOISE = 1e-3  # of the encoders, standard deviation [m], [rad]
seconds = DT * np.arange(STEPS)


def gentle(begin, end):
    """From 0 to 1 without jumps of the acceleration."""
    s = np.clip((seconds - begin) / (end - begin), 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


rope = 1.5 - gentle(0.5, 4.5)


def run(policy, start=(0, 0, 0, 0), wind=np.zeros(STEPS)):
    """Forces (STEPS, 1) and true outputs (STEPS, 2) from a start; the policy gives the force from the step and the
    outputs."""
    mujoco.mj_resetData(crane, data)
    data.qpos[:] = *start[:2], rope[0]
    data.qvel[:2] = start[2:]
    u, y = np.empty((STEPS, 1)), np.empty((STEPS, 2))
    for k in range(STEPS):
        y[k] = data.qpos[:2]
        u[k] = policy(k, y[k])
        data.ctrl[:] = u[k, 0], rope[k]
        data.xfrc_applied[load, 0] = wind[k]
        mujoco.mj_step(crane, data, nstep=4)
    return u, y


# %% [markdown]
# ## The runs
#
# The planned forces come from a servo that moves the trolley by two metres in the simulation. The runs apply these forces
# without the servo, with a random force of 1 N on top, from starts near rest.

# %%
path = 2 * gentle(0.2, 5)
u_plan, y_plan = run(lambda k, y: 40 * (path[k] - y[0]))
RUNS, DITHER = 40, 1.0
SPREAD = np.array([0.01, 0.03, 0.02, 0.05])  # of the starts, standard deviation
random = np.random.default_rng(1)
runs = []
for n in range(RUNS):
    dither = DITHER * random.standard_normal(STEPS)
    u, y = run(lambda k, y: u_plan[k] + dither[k], SPREAD * random.standard_normal(4))
    runs.append((u, y + NOISE * random.standard_normal(y.shape)))
experiments = tokid.Ensemble(*map(np.array, zip(*runs)), dt=DT, initial_state="unknown",
                             input_names=["force"], output_names=["trolley", "rope"],
                             input_units=["N"], output_units=["m", "rad"])
print(f"Runs           {RUNS} of {STEPS} steps of {1000 * DT:g} ms; noise {1000 * NOISE:g} mm and mrad")

# %% [markdown]
# ## The model and the controller
#
# tokid subtracts the mean of the runs, finds the number of states and refines the model, so that its observer is the
# Kalman filter. The LQR weights a metre and a radian alike.

# %%
began = time.perf_counter()
with warnings.catch_warnings():
    warnings.simplefilter("ignore", tokid.TokidWarning)  # that the first one starts late
    first = tokid.identify(experiments, lags=8, refine=False)
    model = first.refine(experiments, smoothing=first.identification.smoothing_choice.smoothing, iterations=20)
controller = model.lqr(1.0, 1e-3)
print(f"Model          {model.states} states, steps {model.k_begin} to {model.k_end - 1}, "
      f"in {time.perf_counter() - began:.1f} s")

# %% [markdown]
# ## The code
#
# `export_c` writes `crane.c` and `crane.h`. They are compiled as for any machine. This script then calls the three
# functions, where a board would call them from its timer.

# %%
code = model.export_c("crane.c", controller, single_precision=True)
subprocess.run(["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror", "-shared", "-fPIC", "crane.c",
                "-o", "crane.so"], check=True)
board = ctypes.CDLL("./crane.so")
print(f"Code           {code.table_bytes} bytes of tables, {code.state_bytes} bytes of state; in each step "
      f"{code.control.multiplications} + {code.step.multiplications} multiplications")


class Board:
    """The policy of one run: the C code, which knows the encoders alone."""

    def __init__(self, random):
        self.random, self.log = random, []
        self.state = ctypes.create_string_buffer(code.state_bytes)
        board.crane_init(self.state)

    def __call__(self, k, y):
        u, samples = np.zeros(1, np.float32), (y + NOISE * self.random.standard_normal(2)).astype(np.float32)
        samples[self.random.random(2) < 0.1] = np.nan
        status = board.crane_control(self.state, ctypes.c_void_p(u.ctypes.data))
        status = status or board.crane_step(self.state, *(ctypes.c_void_p(a.ctypes.data) for a in (u, samples)), None, None)
        if status != 0:
            raise RuntimeError(f"status {status} at step {k}")
        self.log.append((u.astype(float), samples.astype(float)))
        return u[0]


# %% [markdown]
# ## From perturbed starts, in gusts
#
# The load begins up to 0.15 rad off and the trolley up to 10 cm. A gust of up to 2 N pushes the load for 0.4 s.

# %%
TRIPS = 20
random = np.random.default_rng(7)
open_loop, controlled, boards = [], [], []
for n in range(TRIPS):
    start = np.array([0.1, 0.15, 0, 0]) * random.uniform(-1, 1, 4)
    gust = random.integers(20, 80)
    wind = np.where((gust <= np.arange(STEPS)) & (np.arange(STEPS) < gust + 10), random.uniform(-2, 2), 0.0)
    open_loop.append(run(lambda k, y: model.u_nominal[k], start, wind)[1] - model.y_nominal)
    boards.append(Board(random))
    controlled.append(run(boards[-1], start, wind)[1] - model.y_nominal)
open_loop, controlled = np.array(open_loop), np.array(controlled)

# %% [markdown]
# The same samples go through the observer and the controller of the package in double precision. The forces agree up to
# rounding errors.

# %%
difference, largest = 0.0, 0.0
for trip in boards:
    observer, last = model.observer(), None
    for k, (u, y) in enumerate(trip.log):
        difference = max(difference, abs(controller.input(k, observer.state, last)[0] - u[0]))
        largest = max(largest, abs(u[0]))
        observer.step(u, y)
        last = u


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=(0, 1)))


print(f"Trips          {TRIPS}; root mean square of the departures from the mean run")
print("                  trolley [m]  rope [rad]  trolley, last second  rope, last second")
last_second = slice(STEPS - 25, STEPS)
errors = {"open loop": open_loop, "C code": controlled}
table = {name: [*rms(values), *rms(values[:, last_second])] for name, values in errors.items()}
for name, values in table.items():
    print(f"  {name:<16}" + "".join(f"{value:{width}.4f}" for value, width in zip(values, (11, 12, 22, 19))))
end_ratio = np.divide(table["open loop"], table["C code"])[2:]
print(f"Ratio          in the last second, departures are {end_ratio[0]:.0f} and {end_ratio[1]:.0f} times smaller with the code")
print(f"Forces         at most {largest:.1f} N, {difference:.1g} N from those of the package in double precision")

# %% [markdown]
# In open loop (grey) the load swings on; the C code (blue) brings trolley and load back to the mean of the runs (dashed).

# %%
plt.rcParams["svg.fonttype"] = "none"
figure, axes = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
for axis, j, label in zip(axes, range(2), ("position of the trolley [m]", "angle of the rope [rad]")):
    for name, colour in (("open loop", "0.65"), ("C code", "tab:blue")):
        for number, departures in enumerate(errors[name][:8]):
            axis.plot(seconds, model.y_nominal[:, j] + departures[:, j], color=colour, lw=1,
                      label=name if number == 0 else None)
    axis.plot(seconds, model.y_nominal[:, j], "k--", lw=1, label="mean run")
    axis.set(ylabel=label)
axes[0].legend()
axes[0].set(title="Eight trips from perturbed starts, each with a gust")
axes[1].set(xlabel="time [s]")
figure.savefig("mujoco_crane.svg")
