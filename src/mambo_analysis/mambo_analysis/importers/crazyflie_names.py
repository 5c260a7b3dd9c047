"""
Signals of a Crazyflie log by their names, without the group ``ae483log``; SI.

The firmware's own signals (crazyflie-firmware) are read, too, in the units that it gives them:

====================  ======================================================================
``motor.m1`` to 4     0 to 65535, motors as in the course's ``m_1`` to ``m_4``
``gyro``, ``acc``     deg/s and g, FLU
``stateEstimate``     m, m/s in the axes of the position, deg with the pitch positive nose up
``stabilizer``        deg, the same attitude
``ctrltarget``        m, the goal
``range.zrange``      mm
``motion``            counts of the PMW3901 in its own axes: the course's ``n_x`` is ``-deltaY``
                      and its ``n_y`` ``-deltaX`` (``flowdeck_v1v2.c``)
``pm.vbat``           V
====================  ======================================================================
"""

from __future__ import annotations

from collections.abc import Iterable
import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Signal = tuple[NDArray[np.float64], NDArray[np.float64]]
COURSE = 'ae483log'
# In the order of (3.2): front left, front right, rear right, rear left.
MOTORS = ('m_4', 'm_1', 'm_2', 'm_3')
RATES = ('w_x', 'w_y', 'w_z')
GYRO = ('gyro.x', 'gyro.y', 'gyro.z')  # deg/s
HORIZONTAL = ('a_x', 'a_y')
ATTITUDE = ('psi', 'theta', 'phi')
ESTIMATE = ('p_x', 'p_y', 'p_z', *ATTITUDE, 'v_x', 'v_y', 'v_z')
ODOMETRY = (*ESTIMATE, *RATES)
GOAL = ('p_x_des', 'p_y_des', 'p_z_des')
BATTERY = 'vbat'
USED = (*RATES, *HORIZONTAL, 'a_z', 'r', 'n_x', 'n_y', *MOTORS, *ESTIMATE, *GOAL, BATTERY)
MOCAP = ('x', 'y', 'z', 'yaw', 'pitch', 'roll')
FORMER = {f'o_{axis}{end}': f'p_{axis}{end}' for axis in 'xyz' for end in ('', '_des')}
"""Present name of each signal that the course has renamed."""
GRAVITY = 9.81  # [m/s^2] of a g, as the course takes it
LIKE_COMMAND = re.compile(r'(^|[._])(m|motor)_?[1-4]($|[._])|pwm', re.IGNORECASE)


class Quantity(NamedTuple):
    """What makes a topic, or a part of it, by its names in the course and in the firmware."""

    topic: str
    course: tuple[str, ...]
    firmware: tuple[dict[str, float], ...]  # {name: factor to SI}, in order of preference


def _of(group: str, names: str, *factors: float) -> dict[str, float]:
    """Return {name of the firmware: factor} of a group; one factor may stand for all."""
    parts = names.split()
    return {f'{group}.{name}': factor
            for name, factor in zip(parts, factors * (len(parts) // len(factors)))}


_DEGREE = math.pi / 180.0
_PLACE, _TURN = _of('stateEstimate', 'x y z', 1.0), (_DEGREE, -_DEGREE, _DEGREE)
_SPEED = _of('stateEstimate', 'vx vy vz', 1.0)
QUANTITIES = (
    Quantity('imu/data_raw', RATES, (_of('gyro', 'x y z', _DEGREE),)),
    Quantity('imu/data_raw', ('a_z',), (_of('acc', 'z', GRAVITY),)),
    Quantity('imu/data_raw', HORIZONTAL, (_of('acc', 'x y', GRAVITY),)),
    Quantity('sonar/range', ('r',), (_of('range', 'zrange', 1e-3),)),
    Quantity('optical_flow', ('n_x', 'n_y'), (_of('motion', 'deltaY deltaX', -1.0),)),
    Quantity('motor_pwm', ('m_1', 'm_2', 'm_3', 'm_4'), (_of('motor', 'm1 m2 m3 m4', 1.0),)),
    Quantity('onboard/odom', ESTIMATE, tuple(
        _PLACE | _of(group, 'yaw pitch roll', *_TURN) | _SPEED
        for group in ('stateEstimate', 'stabilizer'))),
    Quantity('onboard/reference', GOAL, (_of('ctrltarget', 'x y z', 1.0),)),
    Quantity('battery', (BATTERY,), (_of('pm', 'vbat', 1.0),)))


class Selected(NamedTuple):
    """
    The signals of a log that are used.

    Attributes
    ----------
    signals
        {name of the course: times [s] and values, SI}; a velocity of the firmware is in the axes
        of its position.
    origin
        {name of the course: name in the log}, of those of the firmware, also the missing ones of
        a quantity of which some are there.
    doubled
        A line for each quantity that the log holds twice.
    ignored
        Names of the signals that are neither used nor in such a line.

    """

    signals: dict[str, Signal]
    origin: dict[str, str]
    doubled: list[str]
    ignored: list[str]


def select(found: dict[str, Signal]) -> Selected:
    """
    Return the signals of a log under the names and in the units of the course.

    A quantity of which the course's signals are complete is taken from them, else from those of
    the firmware if they are complete, else from what there is.

    Parameters
    ----------
    found
        {name, without the group of the course: times (n,) s, values (n,)}.

    """
    out: dict[str, Signal] = {}
    origin: dict[str, str] = {}
    doubled, told = [], set(found)
    for quantity in QUANTITIES:
        course = [name for name in quantity.course if name in found]
        whole = [names for names in quantity.firmware if names.keys() <= found.keys()]
        some = whole or ([] if course else [
            names for names in quantity.firmware if names.keys() & found.keys()])
        if some and len(course) < len(quantity.course):
            origin |= dict(zip(quantity.course, some[0]))
            out |= {name: _scaled(found[source], factor, name == 'psi')
                    for name, (source, factor) in zip(quantity.course, some[0].items())
                    if source in found}
            told -= some[0].keys()
            continue
        out |= {name: found[name] for name in course}
        told -= set(course)
        if whole:
            doubled.append(f'{quantity.topic}: taken from {COURSE}.{", ".join(course)}, not from '
                           f'{", ".join(whole[0])}, which the log has, too')
            told -= whole[0].keys()
    return Selected(out, origin, doubled, [name for name in found if name in told])


def _scaled(signal: Signal, factor: float, wraps: bool) -> Signal:
    """Return a signal in SI; an angle that wraps at half a turn goes on beyond it."""
    values = factor * signal[1]
    return signal[0], np.unwrap(values) if wraps else values


def like_commands(names: Iterable[str]) -> list[str]:
    """Return the names that may be those of motor commands."""
    return [name for name in names if LIKE_COMMAND.search(name)]
