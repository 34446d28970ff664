# SPDX-License-Identifier: BSD-3-Clause
"""Plants whose truth is known.

Every plant is a nonlinear discrete-time system with a nominal trajectory. The data of the study are deviations from
that trajectory, small enough that its linearisation is the truth. Continuous plants are integrated by RK4 with held
inputs. States, inputs and outputs have the units of the plant, and one row for each experiment.
"""

from dataclasses import dataclass
from typing import Callable, Optional

import numpy as np
import scipy.linalg


@dataclass(frozen=True)
class Plant:
    """A plant with its nominal trajectory and the usual sizes of its deviations.

    step(x, u, k) -> x of step k+1 and output(x, u, k) -> y, for x (N, n), u (N, r), y (N, m).
    """

    name: str
    text: str
    dt: float  # [s]
    step: Callable
    output: Callable
    x: np.ndarray  # nominal states (T+1, n)
    u: np.ndarray  # nominal inputs (T, r)
    u_std: np.ndarray  # standard deviation of the excitation (r)
    x_std: np.ndarray  # standard deviation of an unknown initial deviation (n)
    closed: bool = False  # unstable: feedback is always on
    jump: Optional[int] = None  # first step after a jump of the parameters

    @property
    def steps(self):
        return len(self.u)


def rk4(rate, dt, substeps=1):
    """The step of x' = rate(x, u, t) over dt with u held."""
    h = dt / substeps

    def step(x, u, k):
        for i in range(substeps):
            t = k * dt + i * h
            a = rate(x, u, t)
            b = rate(x + h / 2 * a, u, t + h / 2)
            c = rate(x + h / 2 * b, u, t + h / 2)
            d = rate(x + h * c, u, t + h)
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
        return x

    return step


def along(step, x0, policy, steps):
    """Nominal states (T+1, n) and inputs (T, r) from x0 under u = policy(x, k)."""
    x, u = [np.asarray(x0, float)], []
    for k in range(steps):
        u.append(np.asarray(policy(x[-1], k), float))
        x.append(step(x[-1][None], u[-1][None], k)[0])
    return {"x": np.array(x), "u": np.array(u)}


def at_rest(states, inputs, steps):
    """The nominal trajectory of a linear plant."""
    return {"x": np.zeros((steps + 1, states)), "u": np.zeros((steps, inputs))}


def sizes(u_std, x_std):
    return {"u_std": np.array(u_std, float), "x_std": np.array(x_std, float)}


def columns(*values):
    """Rows of experiments from one vector for each channel."""
    return np.stack(np.broadcast_arrays(*values), -1)


def linear(rate_matrices):
    """x' = A x + B u with A, B = rate_matrices(t)."""

    def rate(x, u, t):
        a, b = rate_matrices(t)
        return x @ a.T + u @ b.T

    return rate


def measured(c, d=None):
    """The output C x + D u."""
    c = np.asarray(c, float)
    return lambda x, u, k: x @ c.T if d is None else x @ c.T + u @ np.asarray(d, float).T


def second_order(mass, damping, stiffness, force):
    """A, B of M q'' + C q' + K q = F u, with the state (q, q')."""
    half = len(mass)
    a = np.zeros((2 * half, 2 * half))
    a[:half, half:] = np.eye(half)
    a[half:] = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return a, np.vstack([np.zeros_like(force), np.linalg.solve(mass, force)])


def oscillator():
    """n = 4, r = m = 2, D != 0. Majji, Juang, Junkins, JGCD 33(3), 2010, (77) and (78)."""
    dt, steps = 0.05, 80
    a = np.zeros((steps, 4, 4))
    for k in range(steps):
        stiffness = np.array([[4 + 3 * np.sin(10 * k * dt), -1], [-1, 7 + 3 * np.cos(10 * k * dt)]])
        a[k] = scipy.linalg.expm(dt * second_order(np.eye(2), np.zeros((2, 2)), stiffness, np.eye(2))[0])
    b = np.array([[1, 0], [1, -1], [0, 1], [-1, 0.0]])
    return Plant("oscillator", "coupled oscillators with periodic stiffness", dt,
                 lambda x, u, k: x @ a[k].T + u @ b.T,
                 measured([[1, 0, 1, 0.2], [1, -1, 0, -0.5]], 0.1 * np.eye(2)),
                 **at_rest(4, 2, steps), **sizes([1, 1], [3, 3, 3, 3]))


def cart_pole():
    """States: position [m], angle from upright [rad] and their rates. Input [N]. Barto, Sutton, Anderson, 1983."""
    cart, pole, length, g, dt = 1.0, 0.2, 1.0, 9.81, 0.02

    def rate(x, u, t):
        _, angle, speed, turn = x.T
        s, c = np.sin(angle), np.cos(angle)
        force = u[:, 0] - 0.5 * speed
        push = (force + pole * s * (length * turn**2 - g * c)) / (cart + pole * s**2)
        return columns(speed, turn, push, (g * s - c * push) / length)

    def policy(x, k):
        t = k * dt
        aim = np.array([0.35 * (1 - np.cos(4 * t)), 0, 1.4 * np.sin(4 * t), 0])
        return [np.array([-5.5, -65, -9, -20]) @ (aim - x)]

    step = rk4(rate, dt)
    return Plant("cart_pole", "inverted pendulum on a cart that moves to and fro", dt, step,
                 measured(np.eye(2, 4)), **along(step, np.zeros(4), policy, 150),
                 **sizes([0.4], [0.002, 0.001, 0.005, 0.005]), closed=True)


def two_link_arm():
    """Angles from hanging [rad] and their rates, torques at both joints [N m]. Spong, Hutchinson, Vidyasagar, 2006."""
    dt, steps, length, g = 0.01, 150, 0.5, 9.81

    def dynamics(x):
        q1, q2, w1, w2 = x.T
        s, c = np.sin(q2), np.cos(q2)
        m11, m12, m22 = length**2 * (1.75 + c), length**2 * (0.375 + c / 2), 0.375 * length**2 + 0 * c
        turn = length**2 * s / 2
        n1 = -turn * (2 * w1 * w2 + w2**2) + g * length * (1.5 * np.sin(q1) + 0.5 * np.sin(q1 + q2)) + 0.05 * w1
        n2 = turn * w1**2 + 0.5 * g * length * np.sin(q1 + q2) + 0.05 * w2
        return m11, m12, m22, n1, n2

    def rate(x, u, t):
        m11, m12, m22, n1, n2 = dynamics(x)
        f1, f2, det = u[:, 0] - n1, u[:, 1] - n2, m11 * m22 - m12**2
        return columns(x[:, 2], x[:, 3], (m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det)

    def policy(x, k):
        s = np.array([k * dt / 1.5, (k + 1) * dt / 1.5])
        aim = np.array([np.pi / 2 * (1 - np.cos(np.pi * s)), 2 * np.sin(np.pi * s) ** 2])
        wanted = 80 * (aim[:, 0] - x[:2]) + 18 * ((aim[:, 1] - aim[:, 0]) / dt - x[2:])
        m11, m12, m22, n1, n2 = (v[0] for v in dynamics(x[None]))
        return [m11 * wanted[0] + m12 * wanted[1] + n1, m12 * wanted[0] + m22 * wanted[1] + n2]

    step = rk4(rate, dt)
    return Plant("two_link_arm", "arm of two links that swings up", dt, step, measured(np.eye(2, 4)),
                 **along(step, np.zeros(4), policy, steps), **sizes([0.15, 0.05], [0.005, 0.005, 0.025, 0.04]), closed=True)


def quadrotor():
    """x, z [m], pitch [rad] and rates; two thrusts [N]; m = 4. Mellinger, Kumar, ICRA 2011, in the plane."""
    mass, inertia, arm, g, dt = 0.5, 0.004, 0.15, 9.81, 0.02

    def rate(x, u, t):
        pitch, lift = x[:, 2], (u[:, 0] + u[:, 1]) / mass
        ahead, up = -lift * np.sin(pitch) - 0.2 * x[:, 3], lift * np.cos(pitch) - g - 0.2 * x[:, 4]
        return columns(x[:, 3], x[:, 4], x[:, 5], ahead, up, arm * (u[:, 0] - u[:, 1]) / inertia)

    def policy(x, k):
        phase = 2 * np.pi * k * dt / 3
        aim = np.array([1.5 * np.sin(phase), 0.15 * np.sin(2 * phase)])
        speed = 2 * np.pi / 3 * np.array([1.5 * np.cos(phase), 0.3 * np.cos(2 * phase)])
        accel = -((2 * np.pi / 3) ** 2) * np.array([1.5 * np.sin(phase), 0.6 * np.sin(2 * phase)])
        ahead, up = accel + 4 * (aim - x[:2]) + 3 * (speed - x[3:5]) + [0, g]
        turn = inertia / arm * (400 * (np.arctan(-ahead / up) - x[2]) - 28 * x[5])
        lift = mass * np.hypot(ahead, up)
        return [(lift + turn) / 2, (lift - turn) / 2]

    step = rk4(rate, dt)
    return Plant("quadrotor", "planar quadrotor on a fast figure eight", dt, step, measured(np.eye(6)[[0, 1, 2, 5]]),
                 **along(step, [0, 0, 0, 3.1, 0.6, 0], policy, 300),
                 **sizes([0.01, 0.01], [0.004, 0.004, 0.004, 0.01, 0.01, 0.02]), closed=True)


def aircraft():
    """Speed [m/s], angle of attack, pitch rate, pitch [rad, s]; elevator [rad], thrust [N]; first output in Pa.

    Stevens, Lewis, Johnson, Aircraft Control and Simulation, 2015. The density of a steep descent is prescribed.
    """
    mass, area, chord, inertia, g, dt = 9000.0, 28.0, 3.4, 75000.0, 9.81, 0.05

    def density(t):
        return 0.35 + 0.85 / (1 + np.exp(-(t - 5)))

    def rate(x, u, t):
        speed, attack, turn, pitch = x.T
        pressure = density(t) * speed**2 / 2 * area
        lift = 0.1 + 4.5 * attack
        moment = -0.6 * attack + 0.04 - 0.8 * u[:, 0] - 12 * chord * turn / (2 * speed)
        path = pitch - attack
        push = (u[:, 1] * np.cos(attack) - pressure * (0.02 + 0.1 * lift**2)) / mass - g * np.sin(path)
        climb = (pressure * lift + u[:, 1] * np.sin(attack)) / (mass * speed) - g * np.cos(path) / speed
        return columns(push, turn - climb, pressure * chord * moment / inertia, turn)

    def policy(x, k):
        pressure = density(k * dt) * x[0] ** 2 / 2 * area
        attack = (mass * g / pressure - 0.1) / 4.5
        return [(0.04 - 0.6 * attack) / 0.8 + 0.2 * x[2], 3e4]

    def output(x, u, k):
        return columns(density(k * dt) * x[:, 0] ** 2 / 2, x[:, 1], x[:, 2])

    step = rk4(rate, dt)
    return Plant("aircraft", "longitudinal motion through a fivefold dynamic pressure", dt, step, output,
                 **along(step, [180, 0.08, 0, 0.08], policy, 200), **sizes([0.005, 1000], [0.2, 0.002, 0.003, 0.002]))


def launch_vehicle():
    """Pitch, slosh and bending with their rates; gimbal angle [rad]; gyros that see the bending. Greensite, 1970."""
    dt = 0.05

    def matrices(t):
        aerodynamic, gimbal = 3 * np.exp(-(((t - 3.5) / 2) ** 2)), 3 + 0.4 * t
        slosh, bend = 4 + 0.2 * t, 12 + 1.2 * t
        a = np.zeros((6, 6))
        a[:3, 3:] = np.eye(3)
        a[3] = [aerodynamic, 6, 0, -0.02 * t, 0, 0]
        a[4] = [-aerodynamic, -(slosh**2), 0, 0, -0.04 * slosh, 0]
        a[5] = [0, 0, -(bend**2), 0, 0, -0.02 * bend]
        return a, np.array([[0, 0, 0, gimbal, -1.5, 6]]).T

    return Plant("launch_vehicle", "pitch with slosh and bending through maximum dynamic pressure", dt,
                 rk4(linear(matrices), dt, 2), measured([[1, 0, 0.1, 0, 0, 0], [0, 0, 0, 1, 0, -0.15]]),
                 **at_rest(6, 1, 140), **sizes([0.01], [0.003, 0.003, 0.001, 0.01, 0.01, 0.01]), closed=True)


def batch_reactor():
    """Concentration [mol/m^3], reactor and jacket temperature [K]; inlet of the jacket [K]. Luyben, 1990."""
    dt = 30.0

    def rate(x, u, t):
        amount, hot, jacket = x.T
        reaction = 1e-3 * np.exp(8000 / 330 - 8000 / hot) * amount
        return columns(-reaction, 0.03 * reaction - (hot - jacket) / 600,
                       (u[:, 0] - jacket) / 120 + (hot - jacket) / 300)

    step = rk4(rate, dt, 2)
    return Plant("batch_reactor", "exothermic reaction that ignites and dies out", dt, step, measured(np.eye(3)[1:]),
                 **along(step, [2000, 320, 320], lambda x, k: [325 - 0.15 * k], 100),
                 **sizes([0.5], [1, 0.1, 0.2]))


def battery():
    """State of charge, polarisation [V], core and surface [K]; current [A], ambient [K]; D != 0. Plett, 2015."""
    dt = 10.0

    def resistance(core):
        return 0.02 * np.exp(2000 / core - 2000 / 298)

    def rate(x, u, t):
        _, polarisation, core, surface = x.T
        current, flow = u[:, 0], (x[:, 2] - x[:, 3]) / 2
        heat = current**2 * resistance(core) + current * polarisation
        return columns(-current / 8280, current / 2500 - polarisation / 40, (heat - flow) / 60,
                       (flow - (surface - u[:, 1]) / 4) / 15)

    def output(x, u, k):
        charge, polarisation, core, surface = x.T
        source = 3.2 + 1.4 * charge - 1.2 * charge**2 + 0.8 * charge**3 - 0.4 * np.exp(-12 * charge)
        return columns(source - polarisation - u[:, 0] * resistance(core), surface)

    step = rk4(rate, dt)
    return Plant("battery", "discharge of a cell with polarisation and heat", dt, step, output,
                 **along(step, [0.95, 0, 298, 298], lambda x, k: [4.6, 298], 150),
                 **sizes([0.1, 0.4], [0.0006, 0.0015, 0.1, 0.1]))


def rotor():
    """Flap angle and rate over azimuth; pitch and inflow; 24 steps a turn, six turns. Johnson, Helicopter Theory."""
    dt, lock, advance = 2 * np.pi / 24, 8.0, 0.5

    def matrices(azimuth):
        s, c = np.sin(azimuth), np.cos(azimuth)
        damping = lock / 8 * (1 + 4 / 3 * advance * s)
        stiffness = 1.1 + lock / 8 * advance * c * (4 / 3 + 2 * advance * s)
        pitch, inflow = 1 + 8 / 3 * advance * s + 2 * (advance * s) ** 2, 1 + 1.5 * advance * s
        b = np.array([[0, 0], [lock / 8 * pitch, -lock / 6 * inflow]])
        return np.array([[0, 1], [-stiffness, -damping]]), b

    return Plant("rotor", "flapping blade in forward flight, periodic", dt, rk4(linear(matrices), dt, 4),
                 measured([[1, 0]]), **at_rest(2, 2, 144), **sizes([0.02, 0.01], [0.01, 0.01]))


def beam():
    """Five modes of a simply supported beam, n = 10; shaker and load; three velocities. Fryba, 1999."""
    dt, steps, modes = 0.06, 150, np.arange(1, 6)

    def shape(place):
        return np.sin(np.pi * modes * place)

    def matrices(t):
        under = shape(t / (dt * steps))
        mass = np.eye(5) + 0.3 * np.outer(under, under)
        return second_order(mass, np.diag(0.06 * modes**2), np.diag(modes**4.0), np.stack([shape(0.37), under], 1))

    c = np.hstack([np.zeros((3, 5)), [shape(0.21), shape(0.45), shape(0.72)]])
    return Plant("beam", "mass that moves over a beam", dt, rk4(linear(matrices), dt, 5), measured(c),
                 **at_rest(10, 2, steps), **sizes([1, 1], np.r_[0.2 / modes**2, 0.2 * np.ones(5)]))


def mass_chain():
    """Two bodies and a soft spring, of which the first loses mass; force [N], positions [m]. Ogata, 2010."""
    dt = 0.1

    def matrices(t):
        mass, between = np.diag([0.6 + 1.4 / (1 + np.exp(t - 5)), 1.0]), np.array([[1.0, -1], [-1, 1]])
        return second_order(mass, 0.2 * between, 4 * between, np.eye(2)[:, :1])

    return Plant("mass_chain", "two free bodies, one of which loses mass", dt, rk4(linear(matrices), dt),
                 measured(np.eye(2, 4)), **at_rest(4, 1, 100), **sizes([1], [0.1, 0.1, 0.1, 0.1]), closed=True)


def gear_shift():
    """Engine speed, twist of the shaft, wheel speed [rad, s]; engine and brake torque [N m]. Kiencke, Nielsen, 2005."""
    dt, steps, jump = 0.04, 120, 60

    def of_ratio(ratio):
        twist = np.array([1 / ratio, 0, -1])
        torque = 80 * twist + [0, 4000, 0]
        a = np.array([-torque / (0.2 * ratio) - [0.5, 0, 0], twist, torque / 100 - [0, 0, 0.1]])
        return a, np.array([[5, 0], [0, 0], [0, -0.01]])

    low, high = (rk4(linear(lambda t, m=of_ratio(ratio): m), dt, 2) for ratio in (12.0, 7.0))
    return Plant("gear_shift", "drive train whose gear ratio jumps", dt,
                 lambda x, u, k: (low if k < jump else high)(x, u, k), measured([[1, 0, 0], [0, 0, 1]]),
                 **at_rest(3, 2, steps), **sizes([5, 200], [3, 0.01, 0.3]), jump=jump)


def stage_separation():
    """Two bending modes and rates; mass, frequencies and C jump, states carried across. Wie, 2008."""
    dt, steps, jump = 0.05, 100, 50
    carried = np.kron(np.eye(2), np.array([[0.8, 0.3], [-0.2, 0.9]]))

    def stage(low, high, gain):
        rates = np.diag([low, high])
        matrices = second_order(np.eye(2), 0.04 * rates, rates**2, gain * np.array([[1.0], [1.5]]))
        return rk4(linear(lambda t: matrices), dt, 3)

    before, after = stage(6, 14, 1.0), stage(9, 21, 2.0)
    c = np.array([[1, 0.6, 0, 0], [0, 0, 0.3, -0.2]]), np.array([[0.7, -0.8, 0, 0], [0, 0, 0.2, 0.4]])

    def step(x, u, k):
        x = (before if k < jump else after)(x, u, k)
        return x @ carried.T if k == jump - 1 else x

    return Plant("stage_separation", "structure that loses a stage", dt, step, lambda x, u, k: x @ c[k >= jump].T,
                 **at_rest(4, 1, steps), **sizes([10], [0.2, 0.1, 1.5, 1.5]), jump=jump)


def stiffness_jump():
    """Mass, spring and damper; stiffness, damping and input jump at step 40. Ljung, System Identification, 1999."""
    dt, steps, jump = 0.1, 80, 40
    before, after = (rk4(linear(lambda t, m=m: m), dt, 2) for m in (
        second_order(np.eye(1), np.array([[0.3]]), np.array([[9.0]]), np.array([[1.0]])),
        second_order(np.eye(1), np.array([[1.2]]), np.array([[36.0]]), np.array([[2.5]]))))
    return Plant("stiffness_jump", "oscillator whose spring changes at one step", dt,
                 lambda x, u, k: (before if k < jump else after)(x, u, k), measured([[1, 0]]),
                 **at_rest(2, 1, steps), **sizes([1], [0.1, 0.3]), jump=jump)


def invariant_structure():
    """Two masses, two forces, 1 % damping, time-invariant. Juang, Applied System Identification, 1994."""
    dt, stiffness = 0.2, np.array([[5.0, -2], [-2, 3]])
    matrices = second_order(np.eye(2), 0.01 * stiffness, stiffness, np.eye(2))
    return Plant("invariant_structure", "lightly damped structure, time-invariant", dt,
                 rk4(linear(lambda t: matrices), dt, 2), measured(np.eye(2, 4)),
                 **at_rest(4, 2, 100), **sizes([1, 1], [0.5, 0.5, 0.8, 0.8]))


def invariant_delay():
    """(1 - s) / ((1 + s)(1 + s/20)) after three steps of delay, n = 5, time-invariant. Seborg, Edgar, Mellichamp."""
    rate, force = np.array([[-1.0, 0], [0, -20]]), np.array([[2.0], [1]])
    whole = scipy.linalg.expm(0.1 * np.block([[rate, force], [np.zeros((1, 3))]]))
    a = np.zeros((5, 5))
    a[:2, :3], a[2, 3], a[3, 4] = whole[:2], 1, 1
    b = np.eye(5)[:, 4:]
    return Plant("invariant_delay", "stiff, non-minimum phase, with three steps of delay, time-invariant", 0.1,
                 lambda x, u, k: x @ a.T + u @ b.T, measured([[20 / 19, -420 / 19, 0, 0, 0]]),
                 **at_rest(5, 1, 100), **sizes([1], [0.4, 0.05, 1, 1, 1]))


def suspension():
    """Travel, body speed, tyre deflection, wheel speed; road speed [m/s], actuator [N]; D != 0. Hrovat, 1997."""
    dt, body, wheel = 0.01, 300.0, 40.0

    def matrices(t):
        damper = 1500 + 1000 * np.sin(2 * np.pi * t / 0.8)
        force = np.array([-16000, -damper, 0, damper])
        a = np.array([[0, 1, 0, -1], force / body, [0, 0, 0, 1], -force / wheel - [0, 0, 160000 / wheel, 0]])
        return a, np.array([[0, 0], [0, 1 / body], [-1, 0], [0, -1 / wheel]])

    def output(x, u, k):
        a, b = matrices(k * dt)
        return columns(x @ a[1] + u @ b[1], x[:, 0])

    return Plant("suspension", "quarter car with a switched damper and an accelerometer", dt,
                 rk4(linear(matrices), dt, 2), output, **at_rest(4, 2, 150),
                 **sizes([0.3, 200], [0.01, 0.1, 0.003, 0.3]))


def crane():
    """Trolley position and speed, sway and rate; force [N]; the rope is hoisted. Sakawa, Shindo, Automatica 1982."""
    dt, g = 0.1, 9.81

    def rate(x, u, t):
        _, speed, sway, turn = x.T
        hoist = -0.3 * np.sin(np.pi * t / 12) ** 2
        rope = 4 - 0.15 * (t - 6 / np.pi * np.sin(np.pi * t / 6))
        push = (u[:, 0] - 20 * speed) / 100
        return columns(speed, push, turn, -(g * np.sin(sway) + push * np.cos(sway) + 2 * hoist * turn) / rope)

    step = rk4(rate, dt)
    return Plant("crane", "gantry crane that hoists its load on the way", dt, step, measured(np.eye(4)[[0, 2]]),
                 **along(step, np.zeros(4), lambda x, k: [80 * np.sin(2 * np.pi * k / 120)], 120),
                 **sizes([20], [0.05, 0.05, 0.01, 0.02]))


def wheeled_robot():
    """Position [m] and heading [rad] on an S-curve; speed [m/s] and turn rate [rad/s]. Siegwart, Nourbakhsh, 2004."""
    dt, steps = 0.02, 240

    def rate(x, u, t):
        return columns(u[:, 0] * np.cos(x[:, 2]), u[:, 0] * np.sin(x[:, 2]), u[:, 1])

    def policy(x, k):
        return [1 + 0.3 * np.sin(4 * np.pi * k / steps), 2.6 * np.sin(2 * np.pi * k / steps)]

    step = rk4(rate, dt)
    return Plant("wheeled_robot", "wheeled robot on an S-curve", dt, step,
                 measured(np.eye(3)), **along(step, np.zeros(3), policy, steps),
                 **sizes([0.15, 0.5], [0.02, 0.02, 0.02]), closed=True)


def balancing_robot():
    """Tilt [rad], its rate, wheel speed; voltage; time-invariant with a pole at 1.08. Grasser et al., TIE 2002."""
    matrices = np.array([[0, 1, 0], [16, -0.5, 0.8], [0, 0, -6]]), np.array([[0], [-4.0], [30]])
    return Plant("balancing_robot", "robot that balances on two wheels, time-invariant", 0.02,
                 rk4(linear(lambda t: matrices), 0.02, 2), measured([[1, 0, 0], [0, 0, 1]]), **at_rest(3, 1, 150),
                 **sizes([2], [0.01, 0.05, 0.5]), closed=True)


def dead_time():
    """Two lags behind eight steps of dead time; the first of them varies. Seborg, Edgar, Mellichamp."""
    dt, steps, delay = 0.1, 150, 8

    def step(x, u, k):
        first = 0.35 + 0.2 * np.sin(2 * np.pi * k / steps)
        arrived, lag, last = x[:, 0], x[:, delay], x[:, delay + 1]
        moved = columns(lag + first * (arrived - lag), last + 0.5 * (lag - last))
        return np.hstack([x[:, 1:delay], u, moved])

    x_std = np.r_[np.zeros(delay), 0.5, 0.5]
    return Plant("dead_time", "two lags behind eight steps of dead time", dt, step,
                 measured(np.eye(delay + 2)[-1:]), **at_rest(delay + 2, 1, steps), u_std=np.ones(1), x_std=x_std)


PLANTS = {make.__name__: make for make in (
    oscillator, cart_pole, two_link_arm, quadrotor, aircraft, launch_vehicle, batch_reactor, battery, rotor, beam,
    mass_chain, gear_shift, stage_separation, stiffness_jump, invariant_structure, invariant_delay, suspension, crane, wheeled_robot,
    balancing_robot, dead_time)}
