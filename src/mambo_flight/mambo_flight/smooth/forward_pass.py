"""Forward pass of the smoother: the joint filter before and after the samples of each step."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from mambo_estimation.joint import filter as joint
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_model.compiled import jit
import numpy as np
from numpy.typing import NDArray

from ..accuracy.filter_run import store_nominal, WIDTH
from ..offline_replay import Steps

Array = NDArray[np.float64]


class Forward(NamedTuple):
    """States and covariances of the filter, row k at step k."""

    dt: Array       # (n,) s, since the previous step
    x: Array        # (n, 24) after the samples of the step
    P: Array        # (n, SIZE, SIZE) of x
    predicted: Array    # (n, 24) after the inertial sample alone
    predicted_P: Array  # (n, SIZE, SIZE) of predicted
    moving: NDArray[np.bool_]  # (n,) aligned, and not at rest


@jit
def _run(memory, values, without, s, out):
    """Fill ``out``; ``without`` are the same parameters without the drag measurement."""
    nan = np.nan
    for k in range(len(s.t)):
        g, a, f = s.gyro[k], s.accel[k], s.flow[k]
        gyro, accel = (g[0], g[1], g[2]), (a[0], a[1], a[2])
        before, _ = joint.step(
            memory, s.dt[k], gyro, accel, nan, (nan, nan), 0, nan, without)
        memory, _ = joint.step(
            memory, s.dt[k], gyro, accel, s.sonar[k], (f[0], f[1]), s.flow_quality[k],
            s.pressure[k], values)
        store_nominal(out.predicted[k], before.x)
        store_nominal(out.x[k], memory.x)
        out.predicted_P[k], out.P[k] = before.P, memory.P
        out.moving[k] = not (memory.aligning or memory.resting)


def run(found: Steps, params: JointParams) -> Forward:
    """
    Run the filter over some steps, without motion capture.

    Parameters
    ----------
    found
        Steps of :func:`mambo_flight.offline_replay.steps`.
    params
        Parameters of the filter.

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
