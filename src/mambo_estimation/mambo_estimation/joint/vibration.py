"""
Vibration in the integral of the accelerometer, which is removed from the published velocity.

Above a few hertz a force that is neither drag nor slowly changing thrust is vibration. Its
integral is small and does not grow, but at the time of a sample it is larger than all other errors
of the velocity. It is therefore integrated separately with a short memory and subtracted.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate_inverse
from mambo_model.motion.vector import Vec3

from ..health import Sensor
from .state import Nominal

FORGOTTEN = 0.02    # s, time constant: four samples
THRUST = 0.05       # s, time constant of the thrust that is not vibration
LARGEST = 0.02      # m/s: a larger value is a shock, not vibration
LEFT = 0.25         # share of the variance that is left, of the mean of two draws: dt / FORGOTTEN
LONGEST = 0.02      # s: a longer step has lost samples, which is worse than vibration


class Vibration(NamedTuple):
    """Memory of the vibration."""

    velocity: Vec3    # (3,) m/s, body FRD
    thrust: float     # m/s^2, specific force along body z, smoothed; 0: not yet


CALM = Vibration((0.0, 0.0, 0.0), 0.0)


@jit
def _followed(old: float, force: float, dt: float) -> float:
    """Return the velocity by vibration along one axis after a step, m/s."""
    new = (1.0 - min(dt / FORGOTTEN, 1.0)) * old + dt * force
    return min(max(new, -LARGEST), LARGEST)


@jit
def shaken(old: Vibration, x: Nominal, accel: Vec3, dt: float) -> Vibration:
    """
    Return the vibration after a step.

    Parameters
    ----------
    old
        Before the step.
    x
        State after it.
    accel : (3,) m/s^2, body FRD
        Specific force, mean over the step, bias included.
    dt : s

    """
    nu, s = rotate_inverse(x.q, x.v), accel[2] - x.accel_bias[2]
    thrust = s if old.thrust == 0.0 else old.thrust + min(dt / THRUST, 1.0) * (s - old.thrust)
    return Vibration(
        (_followed(old.velocity[0], accel[0] - x.accel_bias[0] - x.drag[0] * s * nu[0], dt),
         _followed(old.velocity[1], accel[1] - x.accel_bias[1] - x.drag[1] * s * nu[1], dt),
         _followed(old.velocity[2], s - thrust, dt)), thrust)


@jit
def variance(accel: Sensor, dt: float) -> Vec3:
    """
    Return the variance of the velocity by vibration, (3,) m^2/s^2, body axes.

    Of the difference of successive draws with variance s^2 the trapezoidal rule leaves
    dt^2 s^2 / 4, and `accel.noise` is then 3/2 s^2 (:func:`mambo_estimation.health.noise`).
    """
    share = min(dt, LONGEST) * min(dt, LONGEST) / 6.0
    return (share * accel.noise[0], share * accel.noise[1], share * accel.noise[2])
