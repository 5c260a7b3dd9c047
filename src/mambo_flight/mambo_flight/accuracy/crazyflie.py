"""
The Kalman filter of the Crazyflie's firmware on the samples of a simulated flight.

It is ``kalman_core`` of https://github.com/bitcraze/crazyflie-firmware through that project's own
Python bindings (``make bindings_python``), which are not part of this workspace. They are driven
as ``estimator_kalman.c`` does: process noise and measurements every millisecond, a prediction
every 10 ms with the mean of the inertial samples since the last one. Between samples at 200 Hz,
where the firmware has them at 1 kHz, they are taken to change evenly. Parameters are those of the
firmware; the deviation of a range and of a flow is the true one, as its drivers would state it.
"""

from __future__ import annotations

from importlib import import_module
import os
from pathlib import Path
import sys
from types import ModuleType
from typing import Any, NamedTuple

from mambo_model.errors import InputError
from mambo_model.frames import flip_vector
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..offline_replay import Steps

Array = NDArray[np.float64]
FOLDER = 'CFFIRMWARE'   # environment variable: where cffirmware.py is
STRIDE = 2              # control steps of 5 ms from prediction to prediction
STEP_MS = 5
COUNTS = 35.0 / 0.71674 / 0.1  # 1/rad, counts of the flow sensor, mm_flow.c


class Told(NamedTuple):
    """What the filter is told of the vehicle and its sensors."""

    flow_noise: float   # rad/s, deviation of a sample
    flow_rate: float    # Hz
    range_noise: float  # m, deviation of a range
    drag: float = 0.0   # 1/s, linear; by default that of the firmware for this vehicle, none


def bindings(folder: str | None = None) -> ModuleType:
    """
    Return the module ``cffirmware``.

    Parameters
    ----------
    folder
        Where it is; by default what the environment variable ``CFFIRMWARE`` says, else the
        Python path is searched.

    Raises
    ------
    InputError
        If it is not there.

    """
    folder = folder or os.environ.get(FOLDER, '')
    if folder and folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        return import_module('cffirmware')
    except ImportError:
        where = Path(folder).resolve() if folder else 'on the Python path'
        raise InputError(
            f'no module cffirmware {"in " if folder else ""}{where}: run `make bindings_python` '
            f'in crazyflie-firmware and set {FOLDER} to its folder build') from None


def _vector(cf: ModuleType, values: Array) -> Any:
    """Return a vector of the firmware."""
    out = cf.Axis3f()
    out.x, out.y, out.z = (float(value) for value in values)
    return out


def _means(samples: Array) -> Array:
    """Return the mean of each two steps, (n, 3) of (2 n + 1, 3), between samples a line."""
    return 0.25 * samples[:-2:2] + 0.5 * samples[1:-1:2] + 0.25 * samples[2::2]


def _flow(cf: ModuleType, rate: Array, told: Told) -> Any:
    """
    Return a sample of the flow in counts.

    The simulated sensor takes the rotation out, so the filter gets it with a rate of zero.
    """
    out, period = cf.flowMeasurement_t(), 1.0 / told.flow_rate
    share = COUNTS * period
    out.dpixelx, out.dpixely = float(share * rate[0]), float(-share * rate[1])
    out.stdDevX = out.stdDevY = share * told.flow_noise
    out.dt = period
    return out


def _range(cf: ModuleType, distance: float, noise: float) -> Any:
    """Return a sample of the range finder, m."""
    out = cf.tofMeasurement_t()
    out.distance, out.stdDev = float(distance), noise
    return out


def _state(cf: ModuleType, core: Any, gyro: Array) -> list[float]:
    """Return position, velocity (both z up), quaternion and the rate of the gyro, 13 numbers."""
    found = cf.state_t()
    cf.kalmanCoreExternalizeState(core, found, cf.Axis3f())
    p, v, q = found.position, found.velocity, found.attitudeQuaternion
    return [p.x, p.y, p.z, v.x, v.y, v.z, q.w, q.x, q.y, q.z, *gyro]


def _ned(rows: Array) -> Array:
    """Return states as of ``closed_loop.Recording`` of what :func:`_state` returns."""
    out = rows.copy()
    for first in (0, 3, 7, 10):
        out[:, first:first + 3] = np.stack(flip_vector(tuple(rows[:, first:first + 3].T)), axis=1)
    turn = Rotation.from_quat(out[:, [7, 8, 9, 6]])
    out[:, 3:6] = turn.inv().apply(out[:, 3:6])
    return out


def _start(cf: ModuleType, told: Told) -> tuple[Any, Any]:
    """Return state and parameters of the filter at the start."""
    core, params = cf.kalmanCoreData_t(), cf.kalmanCoreParams_t()
    cf.kalmanCoreDefaultParams(params)
    params.dragB_x = params.dragB_y = told.drag
    cf.kalmanCoreInit(core, params, 0)
    return core, params


def states(s: Steps, start: int, told: Told) -> Array:
    """
    Return what the firmware's filter makes of a flight, (n, 13), at the steps 0, 2, 4 and so on.

    Parameters
    ----------
    s
        Samples of the flight, a step each 5 ms.
    start
        Step of take-off; before it the vehicle does not fly.
    told
        What the filter is told.

    Returns
    -------
    States as of ``closed_loop.Recording``.

    """
    cf = bindings()
    up = np.array([1.0, -1.0, -1.0])
    gyro, accel = _means(s.gyro * up), _means(s.accel * up)
    core, params = _start(cf, told)
    still, rows = cf.Axis3f(), [_state(cf, core, np.zeros(3))]
    for k in range(1, STRIDE * len(gyro) + 1):
        for now in range(STEP_MS * (k - 1) + 1, STEP_MS * k + 1):
            if now % (STRIDE * STEP_MS) == 0:
                i = k // STRIDE - 1
                cf.kalmanCorePredict(core, params, _vector(cf, accel[i]), _vector(cf, gyro[i]),
                                     now, k >= start)
            cf.kalmanCoreAddProcessNoise(core, params, now)
            if now == STEP_MS * k:
                if np.isfinite(s.sonar[k]):
                    cf.kalmanCoreUpdateWithTof(core, _range(cf, s.sonar[k], told.range_noise))
                if np.isfinite(s.flow[k, 0]):
                    cf.kalmanCoreUpdateWithFlow(core, _flow(cf, s.flow[k], told), still)
            cf.kalmanCoreFinalize(core)
        if k % STRIDE == 0:
            rows.append(_state(cf, core, gyro[k // STRIDE - 1]))
    return _ned(np.array(rows))
