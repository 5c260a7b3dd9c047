r"""
Attitude from the motors: angular acceleration of a vehicle, and its fit to windows of flights.

In body axes FLU, with body rate :math:`\omega`, velocity :math:`v` in body axes and lagged thrusts
over the mass :math:`\tau_j` of :mod:`mambo_analysis.twin.force`,

.. math:: \dot\omega = g \odot M\tau + \begin{bmatrix} s_x v_y \\ s_y v_x \\ 0 \end{bmatrix}
          - d \odot \omega + o,

where M takes the differences of (3.2): left less right, rear less front, and the motors that turn
clockwise less the others. The gains g are l m / J about x and y, and c m / J about z. The swaying
s is the torque of air that meets the rotors from the side. The offsets o hold what differs between
the motors, and a centre of mass beside the middle.

No flight has the offsets of another, and they walk within a flight. With a ``past`` they are what
the gyro showed beyond the model in the mean of that time before a window; without it
they are fitted as constants.

The fit minimises the error of the attitude at the end of windows that start at recorded states.
A controller answers every disturbance by its commands, so recorded commands are not independent
of what they are to explain. Gains and dampings that predict best are therefore not those of
physics, and give no moment of inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.spatial.transform import Rotation

from ..identify.regression import IdentifyError
from .force import ForceModel
from .recorded import GRAVITY, MIX, Recorded, STEP
from .windows import past_mean, starts

Floats = NDArray[np.float64]

EVERY = 0.2          # s between the windows of a fit
LEAST = 50           # windows of a fit
OUTLIER = 0.1        # rad, from which an error counts by its size and not by its square
START = (20.0, 20.0, 2.0, 8.0, -8.0, 1.0, 1.0, 1.0)
SIZE = (20.0, 20.0, 2.0, 8.0, 8.0, 10.0, 10.0, 1.0)
DAMPED = 20.0        # 1/s, of a damping at most: faster than the motors, only g over d shows
STEPS = 12           # of the fit at most


class TorqueModel(NamedTuple):
    """
    Parameters of the angular acceleration.

    Attributes
    ----------
    gain : (3,) 1/m
        Angular acceleration per difference of thrusts over the mass, roll, pitch, yaw.
    sway : (2,) rad/(m s)
        Roll by the velocity along y, pitch by that along x.
    damping : (3,) 1/s
    offset : (3,) rad/s^2
        0 if the past of a window gives them.

    """

    gain: tuple[float, float, float]
    sway: tuple[float, float]
    damping: tuple[float, float, float]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def swaying(self, v: Floats) -> Floats:
        """Return the angular acceleration, (n, 3) rad/s^2, by body velocities (n, 3) m/s."""
        return np.column_stack([self.sway[0] * v[:, 1], self.sway[1] * v[:, 0], 0.0 * v[:, 0]])

    def acceleration(self, differences: Floats, v: Floats, rate: Floats) -> Floats:
        """Return the angular acceleration, (n, 3) rad/s^2, FLU, of ``MIX`` times thrusts."""
        return (np.multiply(self.gain, differences) + self.swaying(v)
                - np.multiply(self.damping, rate) + self.offset)


class Start(NamedTuple):
    """
    Windows of one or more flights: states at their beginning, commands in them, states at the end.

    All in arrays with a row for each of the k windows.
    """

    p: Floats            # (k, 3) m, world, z up
    v: Floats            # (k, 3) m/s
    q: Floats            # (k, 4) x y z w
    rate: Floats         # (k, 3) rad/s, FLU
    thrust: Floats       # (k, steps) m/s^2, total over mass
    differences: Floats  # (k, steps, 3) m/s^2
    beyond: Floats       # (k, 3) m/s^2, force that the past showed beyond the model
    past: Floats         # (4, k, 3) means before: change of rate, differences, velocity, rate
    end: tuple[Floats, Floats, Floats]  # p, v, q

    @property
    def has_past(self) -> bool:
        """Return whether offsets come from the time before the windows."""
        return bool(self.past.any())


def prepare(
    flight: Recorded, force: ForceModel, horizon: float, past: float, every: float = EVERY,
) -> Start:
    """Return the windows of a flight; ``horizon``, ``past`` and ``every`` in s."""
    rows, steps = starts(flight, horizon, past, every), round(horizon / STEP)
    each = force.motor_thrust(flight)
    differences, total = each @ MIX.T, each.sum(axis=1)
    velocity = flight.body_velocity
    inside = rows[:, None] + np.arange(steps)
    ago = np.zeros((4, len(rows), 3))
    if past > 0.0:
        back = round(past / STEP)
        ago = np.stack([(flight.gyro[rows] - flight.gyro[rows - back]) / past, *(
            past_mean(x, rows, past) for x in (differences, velocity, flight.gyro))])
    end = rows + steps
    return Start(
        flight.position[rows], flight.velocity[rows], flight.attitude[rows], flight.gyro[rows],
        total[inside], differences[inside],
        past_mean(flight.force - force.force(total, velocity), rows, past), ago,
        (flight.position[end], flight.velocity[end], flight.attitude[end]))


def joined(parts: Sequence[Start]) -> Start:
    """Return the windows of several flights as one."""
    return Start(
        *(np.concatenate([getattr(one, name) for one in parts]) for name in Start._fields[:7]),
        np.concatenate([one.past for one in parts], axis=1),
        tuple(np.concatenate(ends) for ends in zip(*(one.end for one in parts))))


def integrate(
    start: Start, force: ForceModel, model: TorqueModel,
) -> tuple[Floats, Floats, Rotation]:
    """Return position, velocity and attitude at the end of each window, from the motors alone."""
    beyond = np.zeros_like(start.rate)
    if start.has_past:
        change, differences, v, rate = start.past
        beyond = change - model.acceleration(differences, v, rate)
    p, v, rate = start.p, start.v, start.rate
    turn = Rotation.from_quat(start.q)
    for i in range(start.thrust.shape[1]):
        matrix = turn.as_matrix()
        w = np.einsum('nji,nj->ni', matrix, v)
        f = force.force(start.thrust[:, i], w) + start.beyond
        a = np.einsum('nij,nj->ni', matrix, f) - [0.0, 0.0, GRAVITY]
        spin = model.acceleration(start.differences[:, i], w, rate) + beyond
        p, v = p + STEP * v + 0.5 * STEP * STEP * a, v + STEP * a
        turn = turn * Rotation.from_rotvec(STEP * (rate + 0.5 * STEP * spin))
        rate = rate + STEP * spin
    return p, v, turn


def _model(theta: Floats) -> TorqueModel:
    x = [float(value) for value in theta]
    return TorqueModel((x[0], x[1], x[2]), (x[3], x[4]), (x[5], x[6], x[7]),
                       (x[8], x[9], x[10]) if len(x) > 8 else (0.0, 0.0, 0.0))


def fit_torque(
    flights: Sequence[Recorded], force: ForceModel, horizon: float, past: float,
) -> TorqueModel:
    """
    Fit the angular acceleration to windows of flights of one vehicle.

    Parameters
    ----------
    flights
        Not the one that is to be predicted.
    force
        Of the same vehicle.
    horizon, past : s
        Length of a window, and of the time before it; a past of 0 fits constant offsets.

    Raises
    ------
    IdentifyError
        If the windows do not determine it.

    """
    names = ', '.join(one.name for one in flights)
    start = joined([prepare(one, force, horizon, past) for one in flights])
    if len(start.p) < LEAST:
        raise IdentifyError(f'{names}: {len(start.p)} windows, {LEAST} are needed')
    wanted = Rotation.from_quat(start.end[2])

    def error(theta: Floats) -> Floats:
        return (integrate(start, force, _model(theta))[2].inv() * wanted).as_rotvec().ravel()
    more = () if past > 0.0 else (0.0, 0.0, 0.0)
    size = (*SIZE, *(5.0 for _ in more))
    high = np.full(len(size), np.inf)
    high[5:8] = DAMPED
    low = np.where(np.isfinite(high), 0.0, -np.inf)
    found = optimize.least_squares(
        error, (*START, *more), bounds=(low, high), x_scale=size, loss='soft_l1',
        f_scale=OUTLIER, max_nfev=STEPS)
    if not np.isfinite(found.cost):
        raise IdentifyError(f'{names}: the attitude cannot be predicted from the commands')
    return _model(found.x)
