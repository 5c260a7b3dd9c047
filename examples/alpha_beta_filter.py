"""
An alpha-beta filter of the height, in plain Python; the built-in estimator does the rest.

Between two ranges of the sonar the accelerometer predicts height and climb; each range corrects
both. Below its shortest range the sonar measures nothing. On the floor, at take-off and at landing
the example therefore uses height and climb of the built-in estimator, which knows when the vehicle
rests, and that it is below that range.

Fly it with ``./run --estimator examples/alpha_beta_filter.py``, or in one process with
``./mambo fly fig_5_3 --estimator examples/alpha_beta_filter.py -o my_bag``. Without ``@jit`` it
flies slower, and may use whatever Python has.
"""

from dataclasses import dataclass
import math

from mambo_estimation import kalman
from mambo_model.motion.quaternion import rotate, rotate_inverse, to_matrix
from mambo_model.motion.vector import sub
from mambo_model.schema import group, quantity
from mambo_model.values import Parameters

__version__ = '1.1'


@dataclass(frozen=True)
class Params(Parameters):
    """Gains of the filter, and the estimator that it is built on."""

    alpha: float = quantity(0.3, '-', 0.0, 1.0, 'judgement: share of a new range')
    beta: float = quantity(0.05, '-', 0.0, 2.0, 'judgement: share that changes the climb')
    longest_gap: float = quantity(
        0.2, 's', 0.0, 10.0, 'judgement: four ranges; after it the built-in height is used')
    rest: kalman.EstimatorParams = group(kalman.EstimatorParams)


def initial(values):
    """Return the memory at start: that of the estimator, height, climb, time since a range."""
    return kalman.initial(values.rest), 0.0, 0.0, math.inf


def step(memory, dt, gyro, accel, sonar, flow, flow_quality, pressure, values):
    """Return the memory after this step, and the estimate; NaN stands for no sample."""
    rest, height, climb, since = memory
    rest, estimate = kalman.step(
        rest, dt, gyro, accel, sonar, flow, flow_quality, pressure, values.rest)
    state, limits = estimate.state, values.rest.sonar
    # predict with the specific force, turned to inertial axes (z down), and gravity
    force = rotate(state.q, sub(accel, estimate.accel_bias))
    up = -force[2] - values.rest.gravity if math.isfinite(force[2]) else 0.0
    height, climb, since = height + dt * climb, climb + dt * up, since + dt
    # correct with the range along the tilted axis of the body; without one, as built in
    upright = to_matrix(state.q)[2][2]
    if limits.min_range < sonar <= limits.max_range and upright > limits.min_tilt_cos:
        error = sonar * upright - height
        height += values.alpha * error
        climb += values.beta * error / since
        since = 0.0
    elif since > values.longest_gap:
        height, climb = estimate.height, estimate.vertical_velocity
    v = rotate(state.q, state.nu)
    state = state._replace(
        rho=(state.rho[0], state.rho[1], -height),
        nu=rotate_inverse(state.q, (v[0], v[1], -climb)))
    estimate = estimate._replace(state=state, height=height, vertical_velocity=climb)
    return (rest, height, climb, since), estimate
