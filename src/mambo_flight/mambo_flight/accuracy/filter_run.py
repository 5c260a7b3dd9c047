"""The joint filter run over recorded samples: its state and full covariance at each step."""

from __future__ import annotations

from typing import NamedTuple

from mambo_estimation.joint import filter as joint
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_model.compiled import jit
import numpy as np
from numpy.typing import NDArray

from ..offline_replay import Steps

Array = NDArray[np.float64]
WIDTH = 24
"""Columns of a state: p, v, q, gyro bias, accelerometer bias, scale, slope, drag x y, latency,
leak, range offset, pressure offset."""


class Filtered(NamedTuple):
    """State and covariance after each step."""

    x: Array        # (n, 24) see WIDTH
    P: Array        # (n, SIZE, SIZE)
    nu: Array       # (n, 3) m/s, published body velocity
    twist: Array    # (n, 3, 3) m^2/s^2, published covariance of the body velocity
    ratios: Array   # (n, 3) test ratio of sonar, flow and barometer, times the squared gate
    resting: NDArray[np.bool_]  # (n,) aligning, or at rest since


@jit
def store_nominal(row, x):
    """Store a state of the joint filter in a row of :data:`WIDTH` numbers."""
    for i in range(3):
        row[i], row[3 + i] = x.p[i], x.v[i]
        row[10 + i], row[13 + i] = x.gyro_bias[i], x.accel_bias[i]
    for i in range(4):
        row[6 + i] = x.q[i]
    row[16], row[17], row[18], row[19] = x.scale, x.slope, x.drag[0], x.drag[1]
    row[20], row[21], row[22], row[23] = x.latency, x.leak, x.range_offset, x.pressure_offset


@jit
def _run(memory, values, s, out):
    """Run the filter over some steps and fill ``out``."""
    gates = (values.sonar.gate, values.optical_flow.gate, values.barometer.gate)
    for k in range(len(s.t)):
        g, a, f = s.gyro[k], s.accel[k], s.flow[k]
        memory, e = joint.step(
            memory, s.dt[k], (g[0], g[1], g[2]), (a[0], a[1], a[2]), s.sonar[k], (f[0], f[1]),
            s.flow_quality[k], s.pressure[k], values)
        store_nominal(out.x[k], memory.x)
        for i in range(3):
            out.nu[k, i] = e.state.nu[i]
            for j in range(3):
                out.twist[k, i, j] = e.twist_covariance[6 * i + j]
        out.P[k] = memory.P
        out.resting[k] = memory.aligning or memory.resting
        out.ratios[k, 0] = e.sonar_test_ratio * gates[0] * gates[0]
        out.ratios[k, 1] = e.flow_test_ratio * gates[1] * gates[1]
        out.ratios[k, 2] = e.barometer_test_ratio * gates[2] * gates[2]


def run(found: Steps, params: JointParams) -> Filtered:
    """Run the filter over some steps; return state, covariance and test ratios of each."""
    n = len(found.t)
    out = Filtered(
        np.empty((n, WIDTH)), np.empty((n, SIZE, SIZE)), np.empty((n, 3)), np.empty((n, 3, 3)),
        np.empty((n, 3)), np.empty(n, np.bool_))
    _run(joint.initial(params.values()), params.values(), found, out)
    return out
