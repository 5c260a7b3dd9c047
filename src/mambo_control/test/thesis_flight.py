"""
The simulation of section 3.4 in continuous time, for the tests of this package.

Rigid body and controller as one differential equation of 19 numbers: rho, nu, q, omega, P_e,
p_e. The reference (3.31) is written out here, not taken from the trajectories of the product.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_control.attitude_law import alignment
from mambo_control.cascaded import CascadedParams, law, Memory
from mambo_control.gains import GainValues
from mambo_model.aerodynamics import lumped_drag
from mambo_model.compiled import jit
from mambo_model.motion import rigid_body
from mambo_model.motion.flatness import from_flat_output, from_flat_output_yaw
from mambo_model.motion.quaternion import conjugate, rotate_inverse
from mambo_model.motion.vector import add, mul, scale, sub
from mambo_model.vehicle.parameters import preset, VehicleValues
import numpy as np
from scipy.integrate import solve_ivp


class Setup(NamedTuple):
    """What flies, what the controller believes, and what disturbs it."""

    gains: GainValues
    plant: VehicleValues
    believed: VehicleValues
    size: float = 1.0  # m, of the motion (3.31); 0: hover at 1.5 m
    yaw_amplitude: float = 0.0  # rad, of a moving yaw; 0: least rotation
    disturbance: tuple = (0.0, 0.0, 0.0)  # m/s^2, inertial
    printed: bool = False  # q_e as printed in (3.29), in place of q_e*


def setup(vehicle='toolbox', params=None, **changes):
    """Return a setup whose controller knows the vehicle exactly."""
    values = preset(vehicle).values()
    return Setup((params or CascadedParams()).values(), values, values, **changes)


def start(rho=(0.0, 0.0, 0.0), q=(1.0, 0.0, 0.0, 0.0)):
    """Return the 19 numbers of a vehicle at rest, (3.32)."""
    return np.array([*rho, 0.0, 0.0, 0.0, *q, *[0.0] * 9])


@jit
def reference(t, case):
    """Return (3.31) with the chosen yaw, for the believed vehicle."""
    c, s, A, vv = math.cos(t), math.sin(t), case.size, case.believed
    rho, v, a = (A * c, A * s, -1.5 - A * s), (-A * s, A * c, -A * c), (-A * c, -A * s, A * s)
    j = (A * s, -A * c, A * c)
    snap = (A * c, A * s, -A * s)
    if case.yaw_amplitude != 0.0:
        w, Y = 0.7, case.yaw_amplitude
        return from_flat_output_yaw(
            rho, v, a, j, snap, Y * math.sin(w * t), Y * w * math.cos(w * t),
            -Y * w * w * math.sin(w * t), vv.mass, vv.inertia, vv.gravity)
    return from_flat_output(rho, v, a, j, snap, vv.mass, vv.inertia, vv.gravity)


@jit
def unpack(y):
    """Return rigid_body.State and Memory of the 19 numbers."""
    state = rigid_body.State(
        (y[0], y[1], y[2]), (y[3], y[4], y[5]), (y[6], y[7], y[8], y[9]),
        (y[10], y[11], y[12]))
    return state, Memory((y[13], y[14], y[15]), (y[16], y[17], y[18]))


@jit
def control(t, y, case):
    """Return the Law at time t (s) and state y."""
    state, memory = unpack(y)
    return law(state, reference(t, case), memory, case.gains, case.believed)


@jit
def rate(t, y, case):
    """Return dy/dt of vehicle and controller together."""
    state, _ = unpack(y)
    out = control(t, y, case)
    tau = out.tau
    if case.printed:
        wrong = sub(alignment(conjugate(out.q_e), case.gains.k),
                    alignment(out.q_e, case.gains.k))
        tau = add(tau, scale(case.gains.k_R, mul(case.believed.inertia, wrong)))
    F = add(lumped_drag(state.nu, out.f, case.plant),
            scale(case.plant.mass, rotate_inverse(state.q, case.disturbance)))
    d = rigid_body.derivative(state, out.f, tau, F, (0.0, 0.0, 0.0), case.plant)
    parts = (d.rho[0], d.rho[1], d.rho[2], d.nu[0], d.nu[1], d.nu[2], d.q[0], d.q[1], d.q[2],
             d.q[3], d.omega[0], d.omega[1], d.omega[2], out.P_dot[0], out.P_dot[1],
             out.P_dot[2], out.p_dot[0], out.p_dot[1], out.p_dot[2])
    return np.array(parts)


@jit
def runge_kutta(t, y, h, case):
    """Advance y by one classical step of h seconds (either sign), q normalised."""
    k1 = rate(t, y, case)
    k2 = rate(t + 0.5 * h, y + 0.5 * h * k1, case)
    k3 = rate(t + 0.5 * h, y + 0.5 * h * k2, case)
    k4 = rate(t + h, y + h * k3, case)
    y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    y[6:10] /= math.sqrt((y[6:10] ** 2).sum())
    return y


@jit
def flight(y, count, h, case):
    """Return the states, (count + 1, 19), at times 0, h, ... of a flight from y."""
    out = np.empty((count + 1, 19))
    out[0] = y
    for i in range(count):
        out[i + 1] = runge_kutta(i * h, out[i], h, case)
    return out


def precise_flight(y, times, case):
    """Return the states at the given times, (N, 19), to about 1e-12."""
    solution = solve_ivp(
        lambda t, y: rate(t, y, case), (times[0], times[-1]), y, 'DOP853', times, rtol=1e-12,
        atol=1e-13)
    assert solution.success
    return solution.y.T


def random_state(rng, case, t):
    """Return a state of large errors: 1 m, 1 m/s, 60 deg, 3 rad/s about the reference."""
    ref = reference(t, case)
    axis = rng.normal(size=3)
    angle = rng.uniform(0, np.pi / 3)
    turn = np.sin(angle / 2) * axis / np.linalg.norm(axis)
    return np.array([
        *(np.array(ref.rho) + rng.normal(size=3)), *rng.normal(size=3), np.cos(angle / 2), *turn,
        *rng.uniform(-3, 3, 3), *rng.uniform(-0.5, 0.5, 6)])
