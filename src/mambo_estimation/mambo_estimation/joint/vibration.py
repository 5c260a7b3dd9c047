r"""
Vibration in the integral of the accelerometer, which is removed from the published velocity.

Above a few hertz a force that is neither drag nor slowly changing thrust is vibration. Its
integral is small and does not grow, but at the time of a sample it is larger than all other errors
of the velocity. It is therefore integrated separately with a short memory and subtracted.

Along body z the force to be told from it is the thrust. With samples a = s + d - d', vibration
being the difference of successive white draws, and a thrust s whose slope walks, the steady Kalman
filter for (s, its slope, d) is

    e = a - (s + slope) + d,   s += slope + ALPHA e,   slope += BETA e,   d = GAMMA e

Its gains follow from the Riccati equation with 0.92 m/s^2 for d (1.3 m/s^2 of vibration), 0.022
for the sensor, and 0.003 and 1.5e-4 m/s^2 a step for walks of thrust and slope: the circles of the
thesis, flown at 1 m/s. They leave d a tenth of the variance of e.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate_inverse
from mambo_model.motion.vector import Vec3

from ..health import Sensor
from .state import Nominal

FORGOTTEN = 0.02    # s, time constant: four samples
ALPHA, BETA, GAMMA = 6.60e-3, 1.54e-4, 0.886
STEP = 0.005        # s, for which these are
LARGEST = 0.02      # m/s: a larger value is a shock, not vibration
LEFT = 0.25         # share of the variance that is left along x and y: dt / FORGOTTEN
LEFT_DOWN = 0.145   # of that of e, along z: 0.10, and what the thrust does besides on a circle
SETTLING = 0.5      # s, over which the variance of e is averaged
LONGEST = 0.02      # s: a longer step has lost samples, which is worse than vibration


class Vibration(NamedTuple):
    """Memory of the vibration."""

    velocity: Vec3    # (3,) m/s, body FRD
    thrust: float     # m/s^2, specific force along body z without it; 0: not yet
    slope: float      # m/s^2, its change a step of STEP
    power: float      # m^2/s^4, mean square of e


CALM = Vibration((0.0, 0.0, 0.0), 0.0, 0.0, 0.0)


@jit
def _clipped(velocity: float) -> float:
    return min(max(velocity, -LARGEST), LARGEST)


@jit
def _followed(old: float, force: float, dt: float) -> float:
    """Return the velocity by vibration along one axis after a step, m/s."""
    return _clipped((1.0 - min(dt / FORGOTTEN, 1.0)) * old + dt * force)


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
    steps = min(dt, LONGEST) / STEP
    thrust, slope, down, power = s, 0.0, 0.0, old.power
    if old.thrust != 0.0 and dt > 0.0:
        thrust = old.thrust + steps * old.slope
        off = s - thrust + old.velocity[2] / dt
        thrust += steps * ALPHA * off
        slope = old.slope + steps * BETA * off
        power += min(dt / SETTLING, 1.0) * (off * off - power)
        down = _clipped(max(1.0 - steps * (1.0 - GAMMA), 0.0) * dt * off)
    return Vibration(
        (_followed(old.velocity[0], accel[0] - x.accel_bias[0] - x.drag[0] * s * nu[0], dt),
         _followed(old.velocity[1], accel[1] - x.accel_bias[1] - x.drag[1] * s * nu[1], dt),
         down), thrust, slope, power)


@jit
def left(v: Vibration, accel: Sensor, dt: float) -> Vec3:
    """Return the variance that vibration leaves in the published velocity, (3,) m^2/s^2."""
    sideways, step = variance(accel, dt), min(dt, LONGEST)
    return (LEFT * sideways[0], LEFT * sideways[1], LEFT_DOWN * step * step * v.power)


@jit
def variance(accel: Sensor, dt: float) -> Vec3:
    """
    Return the variance of the velocity by vibration, (3,) m^2/s^2, body axes.

    Of the difference of successive draws with variance s^2 the trapezoidal rule leaves
    dt^2 s^2 / 4, and `accel.noise` is then 3/2 s^2 (:func:`mambo_estimation.health.noise`).
    """
    share = min(dt, LONGEST) * min(dt, LONGEST) / 6.0
    return (share * accel.noise[0], share * accel.noise[1], share * accel.noise[2])
