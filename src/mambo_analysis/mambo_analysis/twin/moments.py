r"""
Moments of inertia from motor commands and gyro of a flight in closed loop.

About each axis, with the body rate :math:`\omega`, the differences u of lagged thrusts over the
mass (:data:`mambo_analysis.twin.recorded.MIX`), the velocity v that sways the vehicle, and a
torque o of everything else,

.. math:: \dot\omega = g u + s v + o, \quad g = l m / J.

A controller answers every disturbance by its commands, so a regression of :math:`\dot\omega`
on u finds the inverse of the controller and not the vehicle. What tells them apart is time: a
command cannot answer a disturbance before the gyro has shown it. The fit therefore minimises the
errors of a one-step prediction in innovation form (Ljung, System Identification, 1999, ch. 7 and
13), in which o is a first-order process that the innovations e drive:

.. math:: \hat\omega_{k+1} = \hat\omega_k + h (g \bar u_k + s v_k + o_k) + K e_k,
          \quad o_{k+1} = q o_k + L e_k, \quad e_k = \omega_k - \hat\omega_k .

Errors of a prediction are nearly white, so the interval of g is that of
:mod:`mambo_analysis.identify.regression`, with the error of the thrust map's slope in it. Above
the motors' corner only g over their lag shows, so the fit needs the lag. A longer one gives a
smaller moment of inertia, at most in proportion. Where the lag has an interval, the fit is
repeated at both ends of it, and the differences widen the interval as an independent error.

Commands between two samples lie on the line to the later one, which answers the rate at its own
time. Of samples far apart this line shows an answer before its cause, and the regression finds the
controller again: moments came out up to 41 % too small at 20 Hz. They are refused there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from mambo_model.vehicle.parameters import Vehicle
import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from ..identify import regression
from ..identify.regression import IdentifyError, LEVEL, plus_minus, Value
from .force import BLOCKS, Found, NAMES as FORCE
from .recorded import MIX, Recorded, STEP

Floats = NDArray[np.float64]

AXES = 'xyz'
ACROSS = (1, 0, None)     # axis of the velocity that sways about each axis
NAMES = ('gain', 'sway', 'gain of the rate', 'memory', 'gain of the torque')
LOW = (-300.0, -90.0, 0.0, 0.0, 0.0)
HIGH = (300.0, 90.0, 3.0, 1.0, 500.0)
START = (40.0, 0.0, 0.8, 0.95, 5.0)
WIDEST = 0.25             # of the value, half of the interval: wider ones are refused
SLOW = 1.0                # Hz, below which other torques than those of the motors prevail
LONGEST_PACE = 1.5 * STEP  # s between samples: at 50 Hz the moment about a yaw axis that nothing
                          # turned came out as 0.4 to 0.6 of the true one, six of six outside
LEAST_SHARE = 0.25        # R^2 of the prediction above SLOW: below, the gyro shows its noise
REMEDY = 'give --motor-lag S'


class Moment(NamedTuple):
    """Moment of inertia about one axis, or the reason why the flight does not show it."""

    value: Value | None   # kg m^2
    share: float          # R^2 of the one-step prediction above ``SLOW``
    hidden: str           # '' if shown


def predicted(theta: Floats, u: Floats, v: Floats, rate: Floats) -> Floats:
    """
    Return the one-step prediction of a body rate.

    Parameters
    ----------
    theta : (5,)
        As ``NAMES``: g 1/m, s rad/(m s), K, q, L 1/s.
    u, v : (n,) m/s^2, m/s
        Differences of lagged thrusts over the mass, and the velocity that sways.
    rate : (n,) rad/s
        As measured; all three are best without their first value.

    Returns
    -------
    rate : (n,) rad/s
        Each from the samples before.

    """
    g, s, K, q, L = theta
    a = 1.0 - K
    below = [1.0, -(a + q), a * q + STEP * L]
    forced = signal.lfilter([0.0, STEP, -STEP * q], below, g * u + s * v)
    return forced + signal.lfilter([0.0, K, STEP * L - q * K], below, rate)


def arms(vehicle: Vehicle) -> tuple[float, float, float]:
    """Return torque over difference of thrusts about each axis, m."""
    return vehicle.arm, vehicle.arm, vehicle.yaw_ratio


def fit_moments(
    flight: Recorded, found: Found, vehicle: Vehicle, lag: float, ends: tuple[float, ...] = (),
) -> dict[str, Moment]:
    """
    Fit the moments of inertia to a flight.

    Parameters
    ----------
    flight
        In the air without gaps.
    found
        Force model of the flight: its thrust map with its errors; its own lag is not used.
    vehicle
        Its mass, arm and yaw ratio.
    lag : s
        Of the motors.
    ends : s
        Of the interval of the lag, low and high; none if the lag is known.

    Returns
    -------
    moments
        By axis, FLU.

    """
    if flight.pace > LONGEST_PACE * (1.0 + 1e-6):  # times are rounded
        hidden = (f'samples are {flight.pace:.2g} s apart, in which the controller answers a '
                  f'turn: {LONGEST_PACE:g} s at most are needed; record motor_pwm and IMU at '
                  '100 Hz')
        return {axis: Moment(None, 0.0, hidden) for axis in AXES}
    velocity, rate = flight.body_velocity[flight.air][1:], flight.gyro[flight.air][1:]
    still, slope = np.zeros(len(rate)), _slope_error(found)

    def of_lag(motors: float, blocks: int) -> list[Moment]:
        """Return the moments about all axes for a lag in s."""
        lagged = found.model._replace(lag=motors).motor_thrust(flight)[flight.air]
        u = lagged @ MIX.T
        # mean over the step that begins at a sample: of commands up to that sample, not after it
        u = 0.5 * (u[:-1] + u[1:])
        return [_moment(u[:, i], still if across is None else velocity[:, across], rate[:, i],
                        arms(vehicle)[i] * vehicle.mass, slope, blocks)
                for i, across in enumerate(ACROSS)]
    moments = of_lag(lag, BLOCKS)
    if ends and any(one.value for one in moments):
        low, high = (of_lag(end, 0) for end in ends)
        moments = [over_lags(one, ends, pair)
                   for one, *pair in zip(moments, low, high, strict=True)]
    return dict(zip(AXES, moments, strict=True))


def over_lags(one: Moment, ends: Sequence[float], others: Sequence[Moment]) -> Moment:
    """
    Return a moment whose interval holds the error of the lag, or none if it is too wide then.

    Parameters
    ----------
    one
        For the lag itself.
    ends : s
        Of the interval of the lag.
    others
        For each of the ends; their intervals do not matter.

    """
    if one.value is None:
        return one
    for end, other in zip(ends, others, strict=True):
        if other.value is None:
            return one._replace(value=None, hidden=f'for a motor lag of {end:.3g} s, an end of '
                                f'its interval: {other.hidden}; {REMEDY}')
    middle, low, high = one.value[:3]
    at_ends = [middle, *(other.value.value for other in others if other.value)]
    low = middle - float(np.hypot(middle - low, middle - min(at_ends)))
    high = middle + float(np.hypot(high - middle, max(at_ends) - middle))
    if not high - low < 2.0 * WIDEST * middle:
        return one._replace(value=None, hidden=(
            f'{low:.3g} to {high:.3g} kg m^2, as this flight shows the motor lag only as '
            f'{ends[0]:.3g} to {ends[1]:.3g} s; +-{100.0 * WIDEST:g} % are needed: {REMEDY}'))
    return one._replace(value=one.value._replace(low=low, high=high))


def _slope_error(found: Found) -> float:
    """Return half of the interval of the slope of the thrust map over the slope, kappa b."""
    i = [FORCE.index('thrust'), FORCE.index('exponent')]
    ratio = np.array([1.0 / found.model.thrust, 1.0 / found.model.exponent])
    variance = ratio @ found.fit.covariance[np.ix_(i, i)] @ ratio
    return float(stats.t.ppf(0.5 + 0.5 * LEVEL, found.fit.freedom) * np.sqrt(variance))


def _share(rate: Floats, residual: Floats) -> float:
    """Return R^2 of a prediction of rates (n,), both above ``SLOW``."""
    above = signal.butter(2, SLOW, 'high', fs=1.0 / STEP, output='sos')
    left, whole = (float(np.mean(signal.sosfiltfilt(above, x) ** 2)) for x in (residual, rate))
    return 1.0 - left / whole if whole > 0.0 else 0.0


def _moment(
    u: Floats, v: Floats, rate: Floats, lever: float, slope: float, blocks: int,
) -> Moment:
    """
    Return the moment of inertia about one axis.

    ``lever`` is l m in kg m, ``slope`` the relative half interval of the slope of the thrust map,
    ``blocks`` as of :func:`.regression.fit`.
    """
    u, rate, swayed = u - u[0], rate - rate[0], bool(v.any())
    v = v - v[0]
    free = [i for i, name in enumerate(NAMES) if swayed or name != 'sway']

    def model(theta: Floats) -> Floats:
        whole = np.zeros(len(NAMES))
        whole[free] = theta
        return predicted(whole, u, v, rate)[:, None]
    start, low, high, names = ([x[i] for i in free] for x in (START, LOW, HIGH, NAMES))
    try:
        fit = regression.fit(model, rate[:, None], start, low, high, names, blocks=blocks)
    except IdentifyError as error:
        return Moment(None, 0.0, str(error))
    gain = fit.value(0, '1/m')
    for name in regression.at_bound(fit.theta, low, high, names):
        if name in ('gain', 'sway'):  # a memory of 1 and gains of 0 are those of some noise
            return Moment(None, 0.0, f'the fit of its {name} ends at the bound of its range')
    share = _share(rate, fit.residual[:, 0])
    if share < LEAST_SHARE:
        return Moment(None, share, 'the gyro shows little but its noise: R^2 of its '
                      f'prediction is {share:.2f}, {LEAST_SHARE:g} are needed')
    wide = np.hypot(gain.half / gain.value, slope)
    if not (gain.value > 0.0 and wide < WIDEST):
        order = ('; is motor_pwm of this flight, and in the order front left, front right, rear '
                 'right, rear left?'
                 if gain.value < gain.half else '')
        return Moment(None, share, 'the angular acceleration over the commands is '
                      f'{plus_minus(gain.value, gain.half)} 1/m, with a thrust map known to '
                      f'{100.0 * slope:.0f} %; {100.0 * WIDEST:g} % in all are needed{order}')
    middle = lever / gain.value
    return Moment(
        Value(middle, middle / (1.0 + wide), middle / (1.0 - wide), 'kg m^2'), share, '')
