"""
What speaks against the factor of an optical flow: another clock, floor, unit or attitude.

:func:`refuse` and :func:`refuse_late` refuse what makes any factor wrong; the others return lines
about what may.
"""

from __future__ import annotations

from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag
from mambo_signals import gyro_check, height_check, motion
from mambo_signals.time_offset import AlignError
import numpy as np
from numpy.typing import NDArray

from .allan import Interval
from .regression import IdentifyError
from .sensors.optical_flow import lowest
from .sensors.statistics import jackknife

Floats = NDArray[np.float64]

LAGS = 0.01 * np.arange(-60, 61)  # s, of the flow behind the motion, that are tried
USUAL_LAG = (-0.05, 0.15)  # s, of a sensor: it averages, and its samples are transmitted
SHOWN_LAG = 0.01           # s, from which on a usual lag is worth a note: one of 0.02 s gave a
                           # slope of 0.03 1/m where there was none
LEAST_ROWS = 100           # of a flow whose lag is found
RIVAL = 1.3   # [-] unexplained variance without the lag over that with it, at least
ALIKE = 1.1   # ratio of the factors of the axes: one lens serves both
USUAL = (0.6, 1.7)  # Q of known sensors is 0.66 (Crazyflie) to 1.06 (Parrot)
FLOOR = 0.03  # m between tracked height and range: at 1 m, Q is wrong by that share


def refuse(bag: Bag) -> None:
    """
    Refuse a recording whose range or gyro contradicts the motion capture, or with doubled flow.

    Raises
    ------
    IdentifyError
        In one line that names the topics.

    """
    for line in height_check.of_bag(bag):
        raise IdentifyError(line)
    stamps = np.sort(bag['optical_flow'].stamp)
    again = np.flatnonzero(np.diff(stamps) == 0)
    if len(again):
        at = 1e-9 * float(stamps[again[0]] - bag.start)
        raise IdentifyError(f'optical_flow has {len(again)} messages with the stamp of another '
                            f'one, the first at {at:.3f} s: take the copies out')
    if 'imu/data_raw' not in bag or not len(bag['imu/data_raw']):
        return
    imu = bag['imu/data_raw']
    try:
        tracked = motion.read(bag, 'optitrack/pose')
    except BagError:
        return  # said by what needs the poses
    found = gyro_check.compare(imu.t, imu.angular_velocity, tracked.t, tracked.quaternion)
    try:
        gyro_check.refuse(found)
    except AlignError as error:
        raise IdentifyError(f'imu/data_raw and optitrack/pose: {error}') from None
    if axes := gyro_check.other_axes(found):
        raise IdentifyError(f'imu/data_raw and optitrack/pose: {axes} of the tracked body: check '
                            'the axes of both')


def late(t: Floats, flow: Floats, geometric: Floats) -> float:
    """
    Return by how much a flow lags behind the motion, s; 0 unless a lag explains clearly more.

    Parameters
    ----------
    t : (n,) s
    flow : (n, 2) rad/s
    geometric : (n, 2) rad/s
        Velocity over depth at the same times.

    """
    def left(lag: float) -> float:
        """Return the share of the flow that the motion does not explain with a lag."""
        rows = (t - lag >= t[0]) & (t - lag <= t[-1])
        if rows.sum() < len(t) // 2:
            return np.inf
        seen = flow[rows] - flow[rows].mean(axis=0)
        moved = np.stack([np.interp(t[rows] - lag, t, axis) for axis in geometric.T], axis=1)
        moved = moved - moved.mean(axis=0)
        factor = np.sum(seen * moved) / max(float(np.sum(moved ** 2)), 1e-12)
        return float(np.sum((seen - factor * moved) ** 2) / max(float(np.sum(seen ** 2)), 1e-12))
    shares = [left(float(lag)) for lag in LAGS]
    best = int(np.argmin(shares))
    return float(LAGS[best]) if left(0.0) > RIVAL * shares[best] else 0.0


def small_lag(t: Floats, flow: Floats, geometric: Floats) -> Interval | None:
    """
    Return the lag of a flow within :data:`USUAL_LAG` with its interval, s; None: it shows none.

    The arguments are those of :func:`late`. The lag is that of the least squares with one factor,
    between two of ``LAGS`` by the parabola through three.
    """
    lags = LAGS[(LAGS > USUAL_LAG[0] - 0.005) & (LAGS < USUAL_LAG[1] + 0.005)]
    rows = np.flatnonzero((t - lags[-1] >= t[0]) & (t - lags[0] <= t[-1]))
    if len(rows) < LEAST_ROWS:
        return None
    seen = flow[rows] - flow[rows].mean(axis=0)
    moved = np.stack([[np.interp(t[rows] - lag, t, axis) for axis in geometric.T]
                      for lag in lags])  # (lags, 2, rows)
    moved -= moved.mean(axis=2, keepdims=True)
    along, squares = moved * seen.T, moved * moved

    def best(keep: NDArray[np.int64]) -> float:
        """Return the lag that explains most of some rows."""
        explained = along[:, :, keep].sum(axis=(1, 2)) ** 2 / np.maximum(
            squares[:, :, keep].sum(axis=(1, 2)), 1e-12)
        return lowest(-explained, lags)
    return jackknife(best, len(rows))


def refuse_late(t: Floats, flow: Floats, geometric: Floats) -> list[str]:
    """Refuse a flow of another clock; return a line about a lag that a sensor may have."""
    lag = late(t, flow, geometric)
    if not USUAL_LAG[0] <= lag <= USUAL_LAG[1]:
        raise IdentifyError(
            f'the flow is {abs(lag):.2f} s {"late" if lag > 0.0 else "early"} against the motion '
            f'capture: align the clocks by mambo join, or give --shift {lag:.2f}')
    shown = small_lag(t, flow, geometric)
    if shown is None or shown.low <= SHOWN_LAG and shown.high >= -SHOWN_LAG:
        return []
    return [f'the flow lags by {shown.value:.3f} s behind the motion capture (95 %: '
            f'{shown.low:.3f} to {shown.high:.3f}), which may look like a slope of Q: '
            f'--shift {shown.value:.3f} allows for it']


def unequal(flow: Floats, geometric: Floats) -> list[str]:
    """Return a line if the axes of a flow, (n, 2), have factors that surely differ."""
    def ratio(keep: NDArray[np.int64]) -> float:
        x = flow[keep] - flow[keep].mean(axis=0)
        g = geometric[keep] - geometric[keep].mean(axis=0)
        shares = np.sum(x * g, axis=0) / np.maximum(np.sum(g * g, axis=0), 1e-12)
        return float(np.log(np.maximum(shares, 1e-3)) @ [1.0, -1.0])
    found = jackknife(ratio, len(flow))
    if -np.log(ALIKE) <= found.high and found.low <= np.log(ALIKE):
        return []
    return [f'the flow along x is {np.exp(found.value):.2f} times that along y for one motion '
            f'(95 %: {np.exp(found.low):.2f} to {np.exp(found.high):.2f}): one lens has one '
            'factor, so check the scale of both axes']


def floor(bag: Bag, tracked: motion.Motion, at: float = 0.0) -> list[str]:
    """Return a line if the height above a floor at a height in m is not the range to it."""
    found = height_check.beside(bag, tracked)
    if found is None or len(found[0]) < height_check.LEAST_ROWS:
        return []
    above = float(np.median(found[1][:, 2] - found[0]))
    if abs(above - at) < FLOOR:
        return []
    more = f'{abs(above - at):.2f} m {"more" if above > at else "less"}'
    return [f'the height of optitrack/pose above the floor is {more} than the range to it '
            f'(median), and Q depends on it: --floor {above:.2f} allows for that']


def size(factor: float) -> list[str]:
    """Return a line about a factor that no known sensor has."""
    return [] if USUAL[0] < factor < USUAL[1] else [
        f'no known sensor has the factor {factor:.3g}; {USUAL[0]:g} to {USUAL[1]:g} are usual: '
        'check the units of flow and positions']
