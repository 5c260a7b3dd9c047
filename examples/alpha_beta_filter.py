"""
An alpha-beta filter of the height, in plain Python; the built-in estimator does the rest.

Fly it with ``./run --estimator examples/alpha_beta_filter.py``, or in one process with
``./mambo fly fig_5_3 --estimator examples/alpha_beta_filter.py -o my_bag``. Without ``@jit`` it
flies slower, and may use whatever Python has.
"""

from dataclasses import dataclass
import math

from mambo_estimation import kalman
from mambo_model.motion.quaternion import rotate, rotate_inverse, to_matrix
from mambo_model.schema import group, quantity
from mambo_model.values import Parameters

__version__ = '1.0'


@dataclass(frozen=True)
class Params(Parameters):
    """Gains of the filter, and the estimator that it is built on."""

    alpha: float = quantity(0.3, '-', 0.0, 1.0, 'judgement: share of a new range')
    beta: float = quantity(0.05, '-', 0.0, 2.0, 'judgement: share that changes the climb')
    rest: kalman.EstimatorParams = group(kalman.EstimatorParams)


def initial(values):
    """Return the memory at start: that of the estimator, height, climb, time since a range."""
    return kalman.initial(values.rest), 0.0, 0.0, 0.0


def step(memory, dt, gyro, accel, sonar, flow, flow_quality, pressure, values):
    """Return the memory after this step, and the estimate; NaN stands for no sample."""
    rest, height, climb, since = memory
    rest, estimate = kalman.step(
        rest, dt, gyro, accel, sonar, flow, flow_quality, pressure, values.rest)
    height, since = height + dt * climb, since + dt
    upright = to_matrix(estimate.state.q)[2][2]
    if math.isfinite(sonar) and sonar > values.rest.sonar.min_range and upright > 0.7:
        error = sonar * upright - height
        height += values.alpha * error
        climb += values.beta * error / since
        since = 0.0
    state = estimate.state
    v = rotate(state.q, state.nu)
    state = state._replace(
        rho=(state.rho[0], state.rho[1], -height),
        nu=rotate_inverse(state.q, (v[0], v[1], -climb)))
    estimate = estimate._replace(state=state, height=height, vertical_velocity=climb)
    return (rest, height, climb, since), estimate
