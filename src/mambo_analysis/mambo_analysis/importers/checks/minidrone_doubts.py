"""
Doubtful values in a log of the educational toolbox: :func:`sensor_doubts`, :func:`onboard_doubts`.

The log is imported as it is; each doubt is one line. The drone computes its own estimate from
its sensors, so the two must agree. What twelve public logs show:

* Accelerometer along z: a median of -10.0 to -9.1 m/s^2 in eleven; in one the drone lies on its
  side.
* Position: x and y are the integral of the velocity turned by the attitude (correlation 0.993 or
  more, 0.96 to 1.015 times as large). Height follows other sensors, too (correlation 0.43 or
  more, 0.7 to 1.4 times).
* Sonar: 0.88 to 1.05 times the drone's own height above 0.5 m (median).
* Gyro: correlation of 0.67 or more with the drone's own rate about each axis.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import plausible

if TYPE_CHECKING:
    from ..minidrone import Log

Floats = NDArray[np.float64]
STEP = 0.005  # [s] of the log
UPRIGHT = (-13.0, -7.0)  # [m/s^2] median of the accelerometer along z (FRD)
HORIZONTAL = (0.9, 0.8, 1.25)  # least correlation, least and largest factor of x and y
VERTICAL = (0.0, 0.3, 3.0)  # likewise of z
LEAST_PATH = 1e-3  # [m] standard deviation of a path that shows more than rounding
HEIGHTS = (0.75, 1.3)  # median of the sonar over the drone's own height
ALOFT = 0.5  # [m] own height of a sample that counts: the sonar is blind below 0.434
LEAST_ROWS = 50  # that count


def sensor_doubts(log: Log, flow_scale: float) -> list[str]:
    """
    Return a line about each sensor whose values are all 0, or of no minidrone.

    Parameters
    ----------
    log
        Of the toolbox.
    flow_scale
        rad/s for a flow of 1.

    """
    accel, gyro = ('ddxb', 'ddyb', 'ddzb'), ('pa', 'qa', 'ra')
    flow, battery = log.signals['opticalFlow_datout'], log.signals['batteryStatus_datout']
    length = np.linalg.norm(log.columns(*accel), axis=1)
    out = plausible.unusual(f'the length of {", ".join(accel)}', 'accel', length)
    if not out and not UPRIGHT[0] <= (down := float(np.median(log.signals['ddzb']))) <= UPRIGHT[1]:
        out = [f'ddzb has a median of {down:.3g} m/s^2, usual are {UPRIGHT[0]:g} to '
               f'{UPRIGHT[1]:g}: the drone did not stand upright, or check its axes and signs '
               'before you use it']
    out += [plausible.constant(name, 0.0) for name in (*(accel if length.any() else ()), *gyro)
            if not log.signals[name].any()]
    out += plausible.unusual_gyro(gyro, log.columns(*gyro), log.columns('pb', 'qb', 'rb'))
    for name, kind, values in (
            ('altitude_sonarb', 'sonar', log.signals['altitude_sonarb']),
            ('prsb', 'pressure', log.signals['prsb']),
            ('opticalFlow_datout', 'flow', flow_scale * np.linalg.norm(flow[:, :2], axis=1)),
            ('motors_refout', 'motors', log.signals['motors_refout'].ravel()),
            ('batteryStatus_datout[0]', 'battery', battery[:, 0]),
            ('batteryStatus_datout[1]', 'percent', battery[:, 1])):
        out += plausible.unusual(name, kind, values)
    return out


def onboard_doubts(log: Log) -> list[str]:
    """Return a line about each part of the drone's own estimate that contradicts another one."""
    attitude = Rotation.from_euler('ZYX', log.columns('yaw', 'pitch', 'roll'))
    moved = STEP * np.cumsum(attitude.apply(log.columns('dx', 'dy', 'dz')), axis=0)
    out = []
    for name, path, (least, low, high) in zip(
            'XYZ', moved.T, (HORIZONTAL, HORIZONTAL, VERTICAL)):
        x, y = (values - values.mean() for values in (log.signals[name], path))
        if x.std() < LEAST_PATH > y.std():
            continue
        r = float(x @ y) / max(float(np.sqrt((x @ x) * (y @ y))), 1e-12)
        ratio = float(x.std() / max(y.std(), 1e-12))
        if r < least or not low <= ratio <= high:
            out.append(f'{name} moves {ratio:.3g} times as much as the integral of dx, dy, dz, '
                       f'turned by yaw, pitch, roll (correlation {r:.2f}): check units, order '
                       'and signs of these before you use it')
    sonar, height = log.signals['altitude_sonarb'], -log.signals['Z']
    aloft = (sonar > 0.0) & (height > ALOFT)
    if aloft.sum() >= LEAST_ROWS:
        ratio = float(np.median(sonar[aloft] / height[aloft]))
        if not HEIGHTS[0] <= ratio <= HEIGHTS[1]:
            out.append(f'altitude_sonarb is {ratio:.3g} times the height that the drone estimates '
                       '(-Z): check the unit of both before you use it')
    return out
