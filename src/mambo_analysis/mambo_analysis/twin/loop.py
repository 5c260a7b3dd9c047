r"""
Closed loop beside a flight: the same reference, flown by a model of drone and controller.

The controller is a cascade as the firmware of the Crazyflie has it, with its published default
gains: position to velocity (P), velocity to tilt (PI), height to climb (PI) to thrust command
(PI), tilt to body rate (PI). The rate loop is taken as fast as the motors: the rate follows with
their lag. Mass, drag, thrust and lag are those of :mod:`mambo_analysis.twin.force`, best
identified on other flights. Heading and battery are as recorded.

The simulation begins at the recorded state. Until then the controller watches the recorded
flight, so that its integrals have what they had in the drone. A drone flies by its estimate: with
``mistaken``, the difference of the recorded estimate and the motion capture is added to what the
simulated controller is told.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..identify.regression import IdentifyError
from .force import ForceModel
from .recorded import GRAVITY, Recorded, STEP

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

APART = 0.5          # m, mean of estimate less motion: beyond, they have different frames
OTHER_REFERENCE = 1.0  # m, median from the flight; 0.68 at most in 85 real ones, fast ovals
OTHER_ESTIMATE = 0.2   # m, likewise of the estimate; 0.07 at most, fed by motion capture
TAKES_OFF = 0.6        # s with the motors on before the flight; 0.9 at least in them


class Gains(NamedTuple):
    """Gains and limits; defaults of the public firmware of the Crazyflie 2.x, 2025."""

    position: float = 2.0                     # 1/s
    height: tuple[float, float] = (2.0, 0.5)  # 1/s, 1/s^2
    velocity: tuple[float, float] = (25.0, 1.0)       # deg s/m, deg/m
    climb: tuple[float, float] = (25000.0, 15000.0)   # PWM s/m, PWM/m
    attitude: tuple[float, float] = (6.0, 3.0)        # 1/s, 1/s^2
    fastest: float = 1.1                      # m/s
    steepest: float = 20.0                    # deg
    hover: float = 36000.0                    # PWM, without an integral
    swing: float = 32767.0                    # PWM beside it at most
    least: float = 20000.0                    # PWM
    most: float = 65535.0                     # PWM


FIRMWARE = Gains()


def _within(x: float, limit: float) -> float:
    return max(-limit, min(limit, x))


class Cascade:
    """The controller with its integrals, called every ``STEP``."""

    def __init__(self, gains: Gains) -> None:
        self.gains = gains
        self.height = self.climb = 0.0      # m/s, PWM
        self.velocity = [0.0, 0.0]          # deg, along and across the heading
        self.tilt = [0.0, 0.0]              # rad/s, roll and pitch

    def position(
        self, wanted: Vector, p: Vector, v: Vector, yaw: float,
    ) -> tuple[float, float, float]:
        """Return roll and pitch, rad FLU, and the common motor command, PWM."""
        g, c, s = self.gains, math.cos(yaw), math.sin(yaw)
        e = (wanted[0] - p[0], wanted[1] - p[1])
        tilt = []
        for i, (error, speed) in enumerate((
                (c * e[0] + s * e[1], c * v[0] + s * v[1]),
                (c * e[1] - s * e[0], c * v[1] - s * v[0]))):
            missing = _within(g.position * error, g.fastest) - speed
            self.velocity[i] += g.velocity[1] * missing * STEP
            tilt.append(math.radians(_within(
                g.velocity[0] * missing + self.velocity[i], g.steepest)))
        up = wanted[2] - p[2]
        self.height += g.height[1] * up * STEP
        missing = _within(g.height[0] * up + self.height, g.fastest) - v[2]
        self.climb += g.climb[1] * missing * STEP
        thrust = g.hover + _within(g.climb[0] * missing + self.climb, g.swing)
        return -tilt[1], tilt[0], max(g.least, min(g.most, thrust))

    def rates(self, wanted: tuple[float, float], tilt: tuple[float, float]) -> list[float]:
        """Return the rates of roll and pitch, rad/s, towards a wanted roll and pitch, rad."""
        out = []
        for i in range(2):
            error = wanted[i] - tilt[i]
            self.tilt[i] += self.gains.attitude[1] * error * STEP
            out.append(self.gains.attitude[0] * error + self.tilt[i])
        return out


class Flown(NamedTuple):
    """A simulated flight at the rows in the air: (n, 3) m, (n, 3) m/s, (n, 4) x y z w."""

    position: Floats
    velocity: Floats
    attitude: Floats

    def rms(self, flight: Recorded) -> tuple[float, float, float]:
        """Return the RMS distance to the recorded path, m: horizontal, vertical, total."""
        e = self.position - flight.position[flight.air]
        squares = np.mean(e * e, axis=0)
        return (math.sqrt(squares[0] + squares[1]), math.sqrt(squares[2]),
                math.sqrt(squares.sum()))


class _Told(NamedTuple):
    """What the estimate of the drone has beyond the motion, at every row."""

    position: Floats   # (n, 3) m
    velocity: Floats   # (n, 3) m/s
    angles: Floats     # (n, 3) rad: yaw, pitch, roll


def has_estimate(flight: Recorded) -> bool:
    """Return whether the estimate of the drone is known all the time in the air."""
    known = flight.onboard
    return known is not None and all(bool(np.isfinite(x[flight.air]).all()) for x in (
        known.position, known.velocity, known.attitude))


def _mistakes(flight: Recorded, angles: Floats, mistaken: bool) -> _Told:
    """Return the errors of the estimate; 0 where it is not known, or not wanted."""
    nothing = np.zeros_like(flight.position)
    if not mistaken:
        return _Told(nothing, nothing, nothing)
    if flight.onboard is None or not has_estimate(flight):
        raise IdentifyError(f'{flight.name}: no estimate of the drone (onboard/odom) in the air')
    own = flight.onboard
    apart = float(np.linalg.norm(np.mean((own.position - flight.position)[flight.air], axis=0)))
    if apart > APART:
        raise IdentifyError(
            f'{flight.name}: the estimate of the drone is {apart:.2f} m beside the motion: '
            'they are in different frames')
    good = np.isfinite(own.attitude).all(axis=1)
    believed = np.zeros_like(angles)
    believed[good] = Rotation.from_quat(own.attitude[good]).as_euler('ZYX')
    wrong = np.angle(np.exp(1j * (believed - angles)))
    return _Told(*(np.nan_to_num(x) for x in (
        own.position - flight.position, own.velocity - flight.velocity,
        np.where(good[:, None], wrong, 0.0))))


def doubts(flight: Recorded) -> list[str]:
    """Return lines about what makes the closed loop of a flight another one."""
    own, air, out = flight.onboard, flight.air, []
    if own is None or not np.isfinite(own.reference[air]).all():
        return []
    for what, place, limit in (('reference', own.reference, OTHER_REFERENCE),
                               ('estimate of the drone', own.position, OTHER_ESTIMATE)):
        far = np.linalg.norm(place[air] - flight.position[air], axis=1)
        far = far[np.isfinite(far)]
        if len(far) and (usual := float(np.median(far))) > limit:
            out.append(f'{flight.name}: the {what} is {usual:.2f} m from the flight (median): is '
                       'it of this flight, and are axes, unit and clock those of the motion?')
    if (air.start - _first(flight)) * STEP < TAKES_OFF:
        out.append(f'{flight.name}: what is used begins in the air: the integrals of the '
                   'simulated controller begin at 0, and its height is off at first')
    return out


def _first(flight: Recorded) -> int:
    """Return the row at which the motors start, of those with all that the controller needs."""
    assert flight.onboard is not None
    known = np.isfinite(flight.onboard.reference).all(axis=1)
    known &= np.isfinite(flight.velocity).all(axis=1) & np.isfinite(flight.attitude).all(axis=1)
    known &= flight.command.min(axis=1) > 0.0
    row = flight.air.start
    while row > 0 and known[row - 1]:
        row -= 1
    return row


def _thrust(flight: Recorded, force: ForceModel, row: int) -> float:
    """Return the specific force along b3 at a row that the model's thrust gives, m/s^2."""
    w = flight.turn[row].inv().apply(flight.velocity[row])
    return float(flight.force[row, 2] + force.drag[2] * w[2])


def fly(
    flight: Recorded, force: ForceModel, mistaken: bool, gains: Gains = FIRMWARE,
) -> Flown:
    """
    Fly the reference of a recording.

    Parameters
    ----------
    flight
        With a reference on board.
    force
        Of the same vehicle.
    mistaken
        Whether the controller is told what the estimate of the drone was wrong by.
    gains

    Raises
    ------
    IdentifyError
        If the recording lacks the reference or the estimate in the air, or its frame is another.

    """
    air = flight.air
    if flight.onboard is None or not np.isfinite(flight.onboard.reference[air]).all():
        raise IdentifyError(f'{flight.name}: no reference (onboard/reference) in the air')
    angles = flight.turn.as_euler('ZYX')
    told = _mistakes(flight, angles, mistaken)
    wanted, law = flight.onboard.reference, Cascade(gains)
    p, v, tilt = np.zeros(3), np.zeros(3), np.zeros(2)
    rate, total = np.zeros(2), 0.0
    left = math.exp(-STEP / force.lag) if force.lag > 0.0 else 0.0
    volts = np.where(np.isfinite(flight.voltage), flight.voltage / force.voltage, 1.0)
    rows: list[tuple[Floats, Floats, Floats]] = []
    for k in range(_first(flight), air.stop):
        if k <= air.start:  # as recorded
            p, v, tilt = flight.position[k], flight.velocity[k], angles[k, :0:-1]
            rate, total = flight.gyro[k, :2], _thrust(flight, force, k)
        yaw = angles[k, 0]
        if k >= air.start:
            rows.append((p, v, np.array([yaw, tilt[1], tilt[0]])))
        believed = tilt + told.angles[k, :0:-1]
        roll, pitch, command = law.position(
            tuple(wanted[k]), tuple(p + told.position[k]), tuple(v + told.velocity[k]),
            yaw + told.angles[k, 0])
        asked = np.array(law.rates((roll, pitch), (believed[0], believed[1])))
        rate = asked + left * (rate - asked)
        thrust = 4.0 * force.thrust * (command / force.command * volts[k]) ** force.exponent
        total = thrust + left * (total - thrust)
        matrix = Rotation.from_euler('ZYX', [yaw, tilt[1], tilt[0]]).as_matrix()
        f = force.force(np.array([total]), (v @ matrix)[None])[0]
        a = matrix @ f - [0.0, 0.0, GRAVITY]
        p, v, tilt = p + STEP * v + 0.5 * STEP * STEP * a, v + STEP * a, tilt + STEP * rate
    position, velocity, turned = (np.array(x) for x in zip(*rows))
    return Flown(position, velocity, Rotation.from_euler('ZYX', turned).as_quat())


def table(
    rows: Sequence[tuple[Recorded, Flown | None, Flown | None]],
) -> tuple[str, list[str], list[list[str]]]:
    """Return caption, head and rows: distances to the recorded path by state and by estimate."""
    body = []
    for flight, true, own in rows:
        cells = ['-' if one is None else f'{100.0 * x:.1f}' for one in (true, own)
                 for x in ((0.0, 0.0, 0.0) if one is None else one.rms(flight))]
        body.append([flight.name, *cells])
    parts = ('horizontal', 'vertical', 'total')
    return ('closed loop, RMS between simulated and flown path [cm]',
            ['flight', *(f'{by}: {x}' for by in ('true state', 'its estimate') for x in parts)],
            body)
