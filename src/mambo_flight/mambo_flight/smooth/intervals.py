"""Parameters of sensors and vehicle from a smoothed flight, with intervals, and its path error."""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import NamedTuple

from mambo_estimation.joint.state import ACCEL_BIAS, DRAG, GYRO_BIAS, LATENCY, SCALE, SLOPE
from mambo_model.frames import flip_vector
import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from .smoother import Smoothed

Array = NDArray[np.float64]
LEVEL = 0.95  # probability that an interval contains the true value
WIDTH = float(norm.ppf(0.5 + 0.5 * LEVEL))  # standard deviations


class Quantity(NamedTuple):
    """A parameter that the filter estimates besides the motion; vectors are in body FLU."""

    name: str
    unit: str
    index: int  # in the error state; plus one in a row of the state
    sign: float = 1.0  # of the value over that of the state, which is in body FRD


AXES = tuple(zip('xyz', flip_vector((1.0, 1.0, 1.0)), strict=True))
QUANTITIES = (
    Quantity('Q at the reference height', '-', SCALE),
    Quantity('slope dQ/dh', '1/m', SLOPE),
    Quantity('drag along body x', 's/m', DRAG), Quantity('drag along body y', 's/m', DRAG + 1),
    Quantity('latency of the flow', 's', LATENCY),
    *(Quantity(f'gyro bias {axis}, body FLU', 'rad/s', GYRO_BIAS + i, sign)
      for i, (axis, sign) in enumerate(AXES)),
    *(Quantity(f'accelerometer bias {axis}, body FLU', 'm/s^2', ACCEL_BIAS + i, sign)
      for i, (axis, sign) in enumerate(AXES)))
NAME = 2 + max(len(f'{one.name} [{one.unit}]') for one in QUANTITIES)  # characters

POSITIVE = (SCALE, DRAG, DRAG + 1, LATENCY)
"""Indices of quantities that cannot be below 0."""


class Interval(NamedTuple):
    """A quantity estimated from the whole flight, at the middle of the flight."""

    quantity: Quantity
    value: float  # unit of the quantity
    low: float    # unit of the quantity, lower end of the interval
    high: float   # unit of the quantity, upper end


def middle(s: Smoothed) -> int:
    """Return the step in the middle of the longest motion."""
    edges = np.flatnonzero(np.diff(s.moving, prepend=False, append=False)).reshape(-1, 2)
    if not len(edges):
        return len(s.t) - 1
    begin, end = edges[np.argmax(edges[:, 1] - edges[:, 0])].tolist()
    return (begin + end - 1) // 2


def intervals(s: Smoothed) -> list[Interval]:
    """Return every quantity with its interval, drifting biases at the middle of the flight."""
    k, out = middle(s), []
    for quantity in QUANTITIES:
        value = quantity.sign * float(s.x[k, quantity.index + 1])
        reach = WIDTH * math.sqrt(max(float(s.P[k, quantity.index, quantity.index]), 0.0))
        out.append(Interval(quantity, value, value - reach, value + reach))
    return out


def impossible(found: Iterable[Interval]) -> list[str]:
    """Return the names of quantities whose intervals are below 0, where none can be."""
    return [one.quantity.name for one in found
            if one.high < 0.0 and one.quantity.index in POSITIVE]


class Path(NamedTuple):
    """Distance of a path from the true one, m, horizontally, where it is smoothed."""

    rms: float
    largest: float
    end: float


def path_error(rows: Array, truth: Array) -> Path:
    """
    Return the horizontal error of a path.

    Parameters
    ----------
    rows, truth : (n, >= 2) m
        Positions, inertial NED, NaN where unknown.

    """
    off = np.linalg.norm(rows[:, :2] - truth[:, :2], axis=1)
    off = off[np.isfinite(off)]
    return Path(float(np.sqrt(np.mean(off**2))), float(off.max()), float(off[-1]))


def table(s: Smoothed, truth: Array | None = None) -> str:
    """
    Return a smoothed flight as lines of text.

    Parameters
    ----------
    s
        The flight.
    truth : (n, >= 2) m
        True positions of its steps, inertial NED; None: unknown.

    """
    out, found = [f'{"":<{NAME}}{"value":>11}{"":>4}95 % interval'], intervals(s)
    for one in found:
        name = f'{one.quantity.name} [{one.quantity.unit}]'
        out.append(f'{name:<{NAME}}{one.value:>11.5g}{"":>4}{one.low:.5g} to {one.high:.5g}')
    if truth is not None and np.isfinite(truth[s.moving, 0]).any():
        out.append(f'{"horizontal path error [m]":<{NAME}}{"rms":>11}{"largest":>11}{"end":>11}')
        for name, rows in (('filter', s.filtered.x), ('smoother', s.x)):
            path = path_error(rows[s.moving], truth[s.moving])
            out.append(f'{f"  {name}":<{NAME}}' + ''.join(f' {number:>10.4f}' for number in path))
    if wrong := impossible(found):
        out.append(f'note: {" and ".join(wrong)} cannot be below 0, so no interval holds: check '
                   'axes, signs and clock of accelerometer and optical flow')
    return '\n'.join(out)
