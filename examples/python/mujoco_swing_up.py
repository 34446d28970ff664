# %% [markdown]
# # A swing-up in MuJoCo, stabilised by a model that was identified
#
# A cart on a rail swings up a pole. The inputs that do so are planned, but applied by themselves they do not get the
# pole up unless it starts exactly from rest. Sixty slightly disturbed runs tell tokid how departures from the plan
# evolve. A time varying LQR on the identified model, with the observer that comes with the model, then holds the
# simulation of [MuJoCo](https://mujoco.org) on its course, from starts that are up to twenty times as far off as those
# of the runs.
#
#     pip install . mujoco matplotlib
#     python examples/python/mujoco_swing_up.py
#
# The motor follows its command with a lag that is not measured. Nothing that MuJoCo knows enters the identification:
# no equation, no mass, no number of states, no velocity, and neither the lag.

# %%
# SPDX-License-Identifier: BSD-3-Clause
import time
import warnings

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import tokid

# %% [markdown]
# ## The machine
#
# Every 20 ms two encoders are read, the position of the cart [m] and the angle of the pole [rad], and a force is
# commanded [N].

# %%
machine = mujoco.MjModel.from_xml_string("""
<mujoco model="cart and pole">
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="0.5"/>
      <geom type="box" size="0.1 0.05 0.05" mass="1"/>
      <body name="pole">
        <joint name="pivot" type="hinge" axis="0 -1 0" damping="0.002"/>
        <geom type="capsule" fromto="0 0 0 0 0 -1" size="0.02" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general joint="rail" dyntype="filterexact" dynprm="0.03" gainprm="1"/>
  </actuator>
</mujoco>
""")
data = mujoco.MjData(machine)
STEPS, DT = 175, 0.02  # 3.5 s
NOISE = 5e-4  # of the encoders, standard deviation [m], [rad]


def step(state, force):
    """The state (position, angle, their velocities, force of the motor) one sample later."""
    data.qpos, data.qvel, data.act = state[:2], state[2:4], state[4:]
    data.ctrl = force
    mujoco.mj_step(machine, data, nstep=2)
    return np.concatenate([data.qpos, data.qvel, data.act])


def run(policy, start):
    """States (STEPS + 1, 5) from a start; the policy gives the force from the step and the state."""
    states = np.empty((STEPS + 1, 5))
    states[0] = start
    for k in range(STEPS):
        states[k + 1] = step(states[k], policy(k, states[k]))
    return states


# %% [markdown]
# ## The planned motion
#
# Up in 2.5 s, then upright for a second: iterative LQR, with derivatives by finite differences of the simulation. Any
# other way to a nominal trajectory would do; what follows uses its inputs and outputs alone.

# %%
UPRIGHT = np.array([0, np.pi, 0, 0, 0])
SWING = 125  # steps until the pole is to be upright
weight = np.where(np.arange(STEPS + 1)[:, None] < SWING, [1, 0, 0.1, 0, 0], [10, 10, 1, 1, 0])
EFFORT = 2e-3


def linearise(states, forces, h=1e-5):
    """Derivatives of each step: A (STEPS, 5, 5) and B (STEPS, 5, 1)."""
    AB = np.empty((STEPS, 5, 6))
    for k in range(STEPS):
        after = step(states[k], forces[k])
        for j, shift in enumerate(h * np.eye(6)):
            AB[k, :, j] = (step(states[k] + shift[:5], forces[k] + shift[5]) - after) / h
    return AB[:, :, :5], AB[:, :, 5:]


def plan(forces, iterations=100):
    """Forces (STEPS) that bring the pole up from rest, and the states on the way."""

    def cost(states, forces):
        return 0.5 * np.sum(weight * (states - UPRIGHT) ** 2) + 0.5 * EFFORT * np.sum(forces**2)

    states = run(lambda k, x: forces[k], np.zeros(5))
    best, damping = cost(states, forces), 1e-3
    for _ in range(iterations):
        A, B = linearise(states, forces)
        before = best
        while best == before and damping < 1e4:
            P, p = np.diag(weight[-1]), weight[-1] * (states[-1] - UPRIGHT)
            shift, gain = np.empty(STEPS), np.empty((STEPS, 5))
            for k in reversed(range(STEPS)):
                a, b = A[k], B[k, :, 0]
                curvature = EFFORT + b @ P @ b + damping
                shift[k], gain[k] = -(EFFORT * forces[k] + b @ p) / curvature, -(b @ P @ a) / curvature
                F = a + np.outer(b, gain[k])
                p = F.T @ (p + P @ b * shift[k]) + EFFORT * gain[k] * (forces[k] + shift[k])
                p += weight[k] * (states[k] - UPRIGHT)
                P = np.diag(weight[k]) + EFFORT * np.outer(gain[k], gain[k]) + F.T @ P @ F
            for share in 0.5 ** np.arange(6):
                trial = run(lambda k, x: forces[k] + share * shift[k] + gain[k] @ (x - states[k]), np.zeros(5))
                tried = forces + share * shift + np.sum(gain * (trial - states)[:-1], axis=1)
                if cost(trial, tried) < best:
                    best, states, forces, damping = cost(trial, tried), trial, tried, damping / 3
                    break
            else:
                damping *= 10
        if before - best < 1e-4 * before:
            break
    return forces, states


began = time.perf_counter()
swing = np.arange(STEPS)
u_plan, x_plan = plan(np.where(swing < SWING, 6 * np.sin(2 * np.pi * swing / 60), 0))
y_plan = x_plan[:, :2]
print(f"Plan           {STEPS} steps of {1000 * DT:g} ms, at most {np.abs(u_plan).max():.1f} N, "
      f"ends {x_plan[-1, 1] - np.pi:+.3f} rad from upright")

# %% [markdown]
# ## The runs
#
# Sixty runs from starts near rest, with a random force of 0.3 N on top of the planned one. The motion is not stable:
# departures grow, and linear models know small ones only. Therefore a run is stopped where it is 0.6 m or 0.6 rad off.
# tokid takes runs of unequal length.

# %%
RUNS, DITHER, STOP = 60, 0.3, 0.6
SPREAD = np.array([0.005, 0.005, 0.025, 0.025, 0])  # of the starts, standard deviation
random = np.random.default_rng(1)
u = DITHER * random.standard_normal((RUNS, STEPS, 1))
y = np.empty((RUNS, STEPS, 2))
length = np.full(RUNS, STEPS)
for n in range(RUNS):
    states = run(lambda k, x: u_plan[k] + u[n, k, 0], SPREAD * random.standard_normal(5))
    y[n] = (states - x_plan)[:-1, :2] + NOISE * random.standard_normal((STEPS, 2))
    off = np.any(np.abs(y[n]) > STOP, axis=1)
    if off.any():
        length[n] = np.argmax(off)
departures = tokid.Ensemble(u, y, dt=DT, length=length, initial_state="unknown",
                            input_names=["force"], output_names=["cart", "pole"],
                            input_units=["N"], output_units=["m", "rad"])
print(f"Runs           {RUNS}, of which {np.sum(length < STEPS)} end early, the first after {DT * length.min():.2f} s; "
      f"noise {1000 * NOISE:g} mm and mrad")

# %% [markdown]
# ## The model
#
# The first call identifies a model of every step. A lag order is given, since trying many takes time; tokid finds the
# number of states, and how much neighbouring steps help each other. The second call makes it the most likely model,
# which begins at the first step and has as its observer the Kalman filter for the noise that the runs show.

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", tokid.TokidWarning)  # that the first one starts late, that the second might go on
    first = tokid.identify(departures, lags=8, refine=False)
    model = first.refine(departures, smoothing=first.identification.smoothing_choice.smoothing, iterations=40)
print(f"Model          {model.states} states, steps {model.k_begin} to {model.k_end - 1}")

# %% [markdown]
# ## The controller
#
# `Model.lqr` designs gains for every step. The states of an identified model have no meaning by themselves, so its
# outputs are weighted: a metre and a radian count alike. The observer of the model estimates the states from the
# encoders. It starts from the mean of the runs, knowing nothing of how far away the start is.

# %%
EFFORT_OF_CONTROL = 1e-3
controller = model.lqr(1.0, EFFORT_OF_CONTROL)


class OutputFeedback:
    """The policy of one run: planned force, corrected by the estimated state."""

    def __init__(self, controller, random):
        self.controller, self.observer, self.random = controller, controller.model.observer(), random

    def __call__(self, k, state):
        y = state[:2] + NOISE * self.random.standard_normal(2) - y_plan[k]
        u = self.controller.input(k, self.observer.state)
        self.observer.step(u, y)
        return u_plan[k] + u[0]


# %% [markdown]
# ## From perturbed starts
#
# Up to 10 cm, 0.1 rad, 0.2 m/s and 0.5 rad/s off. The planned inputs alone, the controller, and for comparison what
# could be had by someone who knows everything: the same LQR on the simulator's own derivatives, with the whole state
# measured without noise.

# %%
REACH = np.array([0.1, 0.1, 0.2, 0.5, 0])
STARTS = 20
random = np.random.default_rng(7)
starts = REACH * random.uniform(-1, 1, (STARTS, 5))
A, B = linearise(x_plan, u_plan)
ideal = tokid.Model.from_matrices(A, B, [np.eye(2, 5)] * STEPS).lqr(1.0, EFFORT_OF_CONTROL)
policies = {
    "open loop": lambda: lambda k, x: u_plan[k],
    "identified model": lambda: OutputFeedback(controller, random),
    "all known": lambda: lambda k, x: u_plan[k] + ideal.input(k, x - x_plan[k])[0],
}
motions = {name: np.array([run(policy(), start) for start in starts]) for name, policy in policies.items()}


def departure(states):
    """Of cart and pole; a pole that has fallen and gone round is no more than half a turn away."""
    result = (states - x_plan)[..., :2]
    result[..., 1] = (result[..., 1] + np.pi) % (2 * np.pi) - np.pi
    return result


def tip(states):
    """Distance of the pole's tip from its place [m]."""
    place = [np.stack([x[..., 0] + np.sin(x[..., 1]), -np.cos(x[..., 1])], axis=-1) for x in (states, x_plan)]
    return np.linalg.norm(place[0] - place[1], axis=-1)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


print(f"Starts         {STARTS}; root mean square over starts and steps of the departures from the plan")
WIDTHS = 8, 12, 8, 9, 18
heads = "cart [m]", "pole [rad]", "both", "tip [m]", "both, at the end"
print(" " * 20 + "".join(f"{head:>{width}}" for head, width in zip(heads, WIDTHS)) + "  upright")
errors, upright = {}, {}
for name, states in motions.items():
    e = departure(states)
    upright[name] = int(np.sum(np.abs(e[:, -1, 1]) < 0.1))
    errors[name] = [rms(e[..., 0]), rms(e[..., 1]), rms(e), rms(tip(states)), rms(e[:, -1])]
    cells = "".join(f"{value:{width}.4f}" for value, width in zip(errors[name], WIDTHS))
    print(f"  {name:<18}{cells}{upright[name]:9}")
ratios = np.divide(errors["open loop"], errors["identified model"])
ratio, tip_ratio, end_ratio = ratios[2:]
print(f"Ratio          with the identified model, departures are {ratio:.1f} times smaller than in open loop,")
print(f"               those of the tip {tip_ratio:.1f} times, those at the end {end_ratio:.0f} times")
print(f"Time           {time.perf_counter() - began:.1f} s")

# %% [markdown]
# In open loop (grey) the pole falls to either side; the controller (blue) brings every run back to the plan (dashed).

# %%
plt.rcParams["svg.fonttype"] = "none"
colours = {"open loop": "0.65", "identified model": "tab:blue", "all known": "tab:orange"}
seconds = DT * np.arange(STEPS + 1)
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
for name in ("open loop", "identified model"):
    for number, states in enumerate(motions[name][:8]):
        above.plot(seconds, states[:, 1], color=colours[name], lw=1, label=name if number == 0 else None)
above.plot(seconds, x_plan[:, 1], "k--", lw=1, label="plan")
above.set(ylabel="angle of the pole [rad]", title="Swing-up from eight perturbed starts", ylim=(-3.5, 7.5))
above.legend()
for name, states in motions.items():
    below.semilogy(seconds, np.sqrt(np.mean(tip(states) ** 2, axis=0)), color=colours[name], label=name)
below.set(xlabel="time [s]", ylabel="tip off its place [m], RMS", title=f"Mean over {STARTS} starts")
below.legend()
figure.savefig("mujoco_swing_up.svg")
