"""What the joint filter makes of recorded samples, before and after the samples of each step."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from mambo_estimation.joint import filter as joint
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_model.compiled import jit
import numpy as np
from numpy.typing import NDArray

from ..offline_replay import Steps

Array = NDArray[np.float64]
WIDTH = 24  # numbers of a state: p, v, q, gyro bias, accelerometer bias, scale, slope, drag x y,
# latency, leak, range offset, pressure offset


class Forward(NamedTuple):
    """States and covariances of the filter, row k at step k."""

    dt: Array       # (n,) s, from the step before
    x: Array        # (n, 24) after the samples of the step
    P: Array        # (n, SIZE, SIZE) likewise
    predicted: Array    # (n, 24) before them, but with the inertial sample
    predicted_P: Array  # (n, SIZE, SIZE) likewise
    moving: NDArray[np.bool_]  # (n,) aligned, and it has left its place


@jit
def _store(row, x):
    """Store a state in a row of 24 numbers."""
    for i in range(3):
        row[i], row[3 + i] = x.p[i], x.v[i]
        row[10 + i], row[13 + i] = x.gyro_bias[i], x.accel_bias[i]
    for i in range(4):
        row[6 + i] = x.q[i]
    row[16], row[17], row[18], row[19] = x.scale, x.slope, x.drag[0], x.drag[1]
    row[20], row[21], row[22], row[23] = x.latency, x.leak, x.range_offset, x.pressure_offset


@jit
def _run(memory, values, without, s, out):
    """Fill ``out``; ``without`` are the same parameters without the measurement of drag."""
    nan = np.nan
    for k in range(len(s.t)):
        g, a, f = s.gyro[k], s.accel[k], s.flow[k]
        gyro, accel = (g[0], g[1], g[2]), (a[0], a[1], a[2])
        before, _ = joint.step(
            memory, s.dt[k], gyro, accel, nan, (nan, nan), 0, nan, without)
        memory, _ = joint.step(
            memory, s.dt[k], gyro, accel, s.sonar[k], (f[0], f[1]), s.flow_quality[k],
            s.pressure[k], values)
        _store(out.predicted[k], before.x)
        _store(out.x[k], memory.x)
        out.predicted_P[k], out.P[k] = before.P, memory.P
        out.moving[k] = not (memory.aligning or memory.resting)


def run(found: Steps, params: JointParams) -> Forward:
    """
    Return what the filter makes of some steps; the motion capture is not used.

    Parameters
    ----------
    found
        Of :func:`mambo_flight.offline_replay.steps`.
    params
        Of the filter.

    """
    n = len(found.t)
    out = Forward(
        np.minimum(found.dt, params.imu.max_gap), np.empty((n, WIDTH)), np.empty((n, SIZE, SIZE)),
        np.empty((n, WIDTH)), np.empty((n, SIZE, SIZE)), np.empty(n, np.bool_))
    alone = replace(params, pose=replace(params.pose, enabled=False))
    values = alone.values()
    without = replace(alone, drag=replace(alone.drag, enabled=False)).values()
    _run(joint.initial(values), values, without, found, out)
    return out
