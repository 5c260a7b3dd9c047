"""
Prediction error of everything, attitude too, from the motor commands alone.

From the recorded state at the beginning of a window, position, velocity and attitude are
integrated with commands and battery (:mod:`mambo_analysis.twin.torque`). Beside the model stand a
constant velocity and a constant body rate, and for the attitude also none at all: over half a
second a vehicle in steady flight hardly turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .force import ForceModel
from .recorded import Recorded
from .torque import integrate, prepare, TorqueModel
from .windows import EVERY, HORIZON, PAST

Floats = NDArray[np.float64]

WORSE = 1.2  # [-] attitude error over that of keeping it; no note on seven real flights
BASELINE = (0.127, 0.578, 0.254)
"""m, m/s, rad after 0.5 s: a published physics model of a Crazyflie, in another set of flights."""


class MotorWindows(NamedTuple):
    """
    Length of the error at the end of each window, (k,): of the model, and without one.

    ``turned`` keeps the body rate, ``kept`` the attitude.
    """

    position: Floats       # m
    velocity: Floats       # m/s
    attitude: Floats       # rad
    constant_position: Floats
    constant_velocity: Floats
    turned: Floats
    kept: Floats

    @property
    def mae(self) -> tuple[float, float, float]:
        """Return the mean errors of the model: m, m/s, rad."""
        return (float(self.position.mean()), float(self.velocity.mean()),
                float(self.attitude.mean()))


def doubts(rows: Sequence[tuple[str, MotorWindows]]) -> list[str]:
    """Return a line about flights whose attitude is predicted worse than by keeping it."""
    worse = [name for name, row in rows
             if float(row.attitude.mean()) > WORSE * float(row.kept.mean())]
    return [f'{", ".join(worse)}: the commands predict the attitude worse than keeping it does: '
            'are they of this flight, and is the order of the motors that of the others?'
            ] if worse else []


def predict_all(
    flight: Recorded, force: ForceModel, torque: TorqueModel, horizon: float = HORIZON,
    past: float = PAST,
) -> MotorWindows:
    """Predict a flight in windows; force and torque are best identified on other flights."""
    start = prepare(flight, force, horizon, past, EVERY)
    p, v, turn = integrate(start, force, torque)
    end = Rotation.from_quat(start.end[2])
    begin = Rotation.from_quat(start.q)

    def length(x: Floats) -> Floats:
        return np.linalg.norm(x, axis=1)
    return MotorWindows(
        length(p - start.end[0]), length(v - start.end[1]), (turn.inv() * end).magnitude(),
        length(start.p + horizon * start.v - start.end[0]), length(start.v - start.end[1]),
        (Rotation.from_rotvec(-horizon * start.rate) * begin.inv() * end).magnitude(),
        (begin.inv() * end).magnitude())


def table(
    rows: Sequence[tuple[str, MotorWindows]], horizon: float,
) -> tuple[str, list[str], list[list[str]]]:
    """Return caption, head and rows: the mean errors of each flight, of all, and the baseline."""
    head = ['flight', 'position [m]', 'constant velocity', 'velocity [m/s]', 'constant velocity',
            'attitude [rad]', 'constant rate', 'kept', 'windows']

    def line(name: str, one: MotorWindows) -> list[str]:
        return [name, *(f'{x.mean():.3f}' for x in (
            one.position, one.constant_position, one.velocity, one.constant_velocity,
            one.attitude, one.turned, one.kept)), str(len(one.kept))]
    body = [line(name, one) for name, one in rows]
    body.append(line('all windows', MotorWindows(*map(np.concatenate, zip(
        *(one for _, one in rows))))))
    if horizon == HORIZON:
        p, v, q = (f'{x:.3f}' for x in BASELINE)
        body.append(['published physics, another set', p, '', v, '', q, '', '', ''])
    return f'from the motors alone, mean error after {horizon:g} s', head, body
