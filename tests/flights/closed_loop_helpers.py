"""
Plant and controller in one compiled loop at 200 Hz, the controller seeing the true state.

What is left out on purpose: sensors, estimator, messages. The motor command is held over a step.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple

from mambo_control.cascaded import CascadedParams, initial as initial_memory
from mambo_control.controllers import answer
from mambo_model.compiled import jit
from mambo_model.motion.trajectory import FlightPlanParams, reference_step, TRACK
from mambo_model.vehicle.parameters import VehicleValues
from mambo_sim import plant
import numpy as np

DT = 0.005  # s
SUBSTEPS = 5  # physics at 1000 Hz


class Flight(NamedTuple):
    """One row a step of 5 ms; inertial NED."""

    t: np.ndarray  # (N,) s
    position: np.ndarray  # (N, 3) m
    reference: np.ndarray  # (N, 3) m
    thrust: np.ndarray  # (N,) N, commanded
    pwm: np.ndarray  # (N, 4)
    tilt: np.ndarray  # (N,) rad

    def after(self, t: float) -> Flight:
        """Return the part from time t (s) on."""
        return Flight(*(column[self.t >= t - 1e-9] for column in self))

    @property
    def distance(self) -> np.ndarray:
        """Distance to the reference, (N,) m."""
        return np.linalg.norm(self.reference - self.position, axis=1)


@jit
def _loop(state, plan, gains, true, believed, count):
    """Fly ``count`` steps; return (count, 13): t, rho, rho_r, f, PWM, tilt."""
    out = np.empty((count, 13))
    memory = initial_memory(gains)
    for k in range(count):
        t = k * DT
        ref, _ = reference_step(t, plan, believed.mass, believed.inertia, believed.gravity)
        body = state.body
        memory, command = answer(memory, body, ref, TRACK, DT, gains, believed)
        sine = math.sqrt(body.q[1] * body.q[1] + body.q[2] * body.q[2])
        row = out[k]
        row[0], row[7], row[12] = t, command.thrust, 2.0 * math.asin(min(1.0, sine))
        for i in range(3):
            row[1 + i], row[4 + i] = body.rho[i], ref.rho[i]
        for i in range(4):
            row[8 + i] = command.pwm[i]
        state = plant.advance(state, command.pwm, DT, SUBSTEPS, true, False)
    return out


def fly(trajectory, seconds, true, believed=None, params=None, position=(0.0, 0.0, 0.0)):
    """
    Fly a trajectory of the thesis from rest, the reference being the trajectory from t = 0.

    The controller believes the true vehicle without its drag, unless told otherwise by a Vehicle
    or, past the range check of one, by VehicleValues.
    """
    believed = believed or replace(true, drag_reading='none')
    if not isinstance(believed, VehicleValues):
        believed = believed.values()
    plan = FlightPlanParams(trajectory=trajectory, takeoff='none')
    state = plant.initial(plant.PlantParams(ground=False, initial_position=position))
    rows = _loop(
        state, plan.values(), (params or CascadedParams()).values(), true.values(),
        believed, round(seconds / DT))
    return Flight(
        rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7], rows[:, 8:12], rows[:, 12])


def circle(flight, rate, turns=2):
    """Return radius (m) and lag (deg) of the last full turns flown at a rate (rad/s)."""
    last = flight.after(flight.t[-1] - turns * 2 * math.pi / rate + DT)
    plane = last.position[:, 0] + 1j * last.position[:, 1]
    mean = np.mean(plane * np.exp(-1j * rate * last.t))
    return abs(mean), -math.degrees(np.angle(mean)), last


def step_response(flight, t0=5.0):
    """Return rise time 10-90 % (s), overshoot (1) and settling time to 5 % (s) along x."""
    t, x = flight.t - t0, flight.position[:, 0]
    rise = t[np.argmax(x >= 0.9)] - t[np.argmax(x >= 0.1)]
    return rise, x.max() - 1.0, t[np.nonzero(np.abs(x - 1.0) >= 0.05)[0][-1] + 1]
