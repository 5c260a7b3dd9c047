"""The flight of ``reference.c`` with the project's own plant: same circle, same controller."""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import to_matrix
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, cross, dot, mul, norm, scale, sub, Vec3
from mambo_model.vehicle.motor_mixer import allocate, Four, limit_pwm, pwm_from_thrust
from mambo_model.vehicle.parameters import VehicleValues
from mambo_sim import plant
import numpy as np
from numpy.typing import NDArray

SUBSTEPS = 5
STEP = 0.005  # s, of the controller
START = plant.PlantState(
    State((1.0, 0.0, -1.5), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class Gains(NamedTuple):
    """Of the geometric controller; those of position and attitude as in RotorPy's."""

    position: float = 6.5   # 1/s^2
    velocity: float = 4.0   # 1/s
    attitude: float = 310.0  # 1/s^2
    rate: float = 57.0      # 1/s


@jit
def command(s: State, t: float, height: float, g: Gains, vv: VehicleValues) -> Four:
    """
    Return the PWM (4,) for the circle of radius 1 m and rate 1 rad/s at a height in m.

    T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)",
    CDC 2010, with desired rates of zero.
    """
    R = to_matrix(s.q)
    velocity = (dot(R[0], s.nu), dot(R[1], s.nu), dot(R[2], s.nu))
    c, d = math.cos(t), math.sin(t)
    wanted = sub(
        (-c, -d, -vv.gravity), add(scale(g.position, sub(s.rho, (c, d, -height))),
                                   scale(g.velocity, sub(velocity, (-d, c, 0.0)))))
    F = scale(-vv.mass, wanted)
    b1 = (R[0][0], R[1][0], R[2][0])
    b2 = (R[0][1], R[1][1], R[2][1])
    b3 = (R[0][2], R[1][2], R[2][2])
    z = scale(1.0 / norm(F), F)
    y = cross(z, (1.0, 0.0, 0.0))
    y = scale(1.0 / norm(y), y)
    x = cross(y, z)
    error = (0.5 * (dot(z, b2) - dot(y, b3)), 0.5 * (dot(x, b3) - dot(z, b1)),
             0.5 * (dot(y, b1) - dot(x, b2)))
    turn = add(scale(-g.attitude, error), scale(-g.rate, s.omega))
    tau: Vec3 = add(mul(vv.inertia, turn), cross(s.omega, mul(vv.inertia, s.omega)))
    T = allocate(dot(F, b3), tau, vv)
    return (
        limit_pwm(pwm_from_thrust(T[0], vv), vv), limit_pwm(pwm_from_thrust(T[1], vv), vv),
        limit_pwm(pwm_from_thrust(T[2], vv), vv), limit_pwm(pwm_from_thrust(T[3], vv), vv))


@jit
def fly(
    state: plant.PlantState, gains: Gains, vv: VehicleValues, path: NDArray[np.float64],
) -> plant.PlantState:
    """Fly as many control steps as the path (n, 3) has rows: position in m before each."""
    for k in range(len(path)):
        for i in range(3):
            path[k, i] = state.body.rho[i]
        pwm = command(state.body, k * STEP, 1.5, gains, vv)
        state = plant.advance(state, pwm, STEP, SUBSTEPS, vv, False)
    return state
