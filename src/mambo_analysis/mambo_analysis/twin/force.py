r"""
Specific force of a vehicle from motor commands, battery and velocity, and its fit to a flight.

In body axes FLU, with the velocity :math:`v` in body axes,

.. math:: f = \begin{bmatrix} c_x - d_x v_x \\ c_y - d_y v_y \\ \tau - d_z v_z \end{bmatrix},
          \quad \tau = \kappa \sum_{j=1}^4 L\left(\frac{X_j V}{X_0 V_0}\right)^b,

where :math:`L` is the first-order lag of the motors, X_j their commands, V the battery's voltage
(a command is a share of the supply, so a motor at X and V does what it does at X V / V_0 at the
voltage V_0), X_0 and V_0 the means in the air, and the d are linear drags over the mass, 1/s.
The c hold the tilt of the thrust axis and the bias of the accelerometer, which a flight does not
tell apart. Everything here is per mass: an accelerometer does not know the mass. A command acts
from its stamp on, somewhere between two steps of the grid: the lag may be shorter by up to a step
than the fit says, and its interval reaches down as far.

Propellers shake an accelerometer above 20 Hz; flight and model are compared as means over 50 ms,
without those in which the samples do not show the commands (:mod:`.command_pulses`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal, stats

from ..identify import regression
from ..identify.regression import Fit, IdentifyError, LEVEL, Value
from .command_pulses import pulsed, refuse_pulsed
from .contradictions import refuse_swapped
from .recorded import bias_doubt, Recorded, STEP

Floats = NDArray[np.float64]

BLOCK = 5                # steps from mean to mean
BLOCKS = 8               # parts of the flights whose disagreement widens an interval: 2 s or more
NAMES = ('drag x', 'drag y', 'drag z', 'tilt x', 'tilt y', 'thrust', 'exponent', 'motor lag')
LOW = (-1.0, -1.0, -2.0, -3.0, -3.0, 0.2, 0.4, 0.0)
HIGH = (5.0, 5.0, 5.0, 3.0, 3.0, 20.0, 4.0, 0.98)
START = (0.3, 0.3, 0.3, 0.0, 0.0, 2.45, 1.8, 0.7)
"""Share of a deviation that remains after ``STEP`` due to the lag; 0 without lag."""
LEAST_SWING = 0.4        # m/s, 99 % of the body velocity on an axis: below, drag does not show
LEAST_THRUST = 0.05      # [-] relative swing of the thrust: below, the map does not show
LEAD = 5                 # steps by which commands may be late: 50 ms, a lag of usual motors
RIVAL = 1.3              # [-] unexplained variance as stamped over that with the lead, at least


class ForceModel(NamedTuple):
    """
    Parameters of the specific force.

    Attributes
    ----------
    drag : (3,) 1/s
        Along x, y, z of the body.
    tilt : (2,) m/s^2
        Constant force along x and y.
    thrust
        kappa [m/s^2]: of one motor at the reference command and voltage.
    exponent
        b.
    lag
        Of the motors, s.
    command, voltage
        X_0, in the unit of the recording, and V_0 [V]; NaN without a battery in the recording.

    """

    drag: tuple[float, float, float]
    tilt: tuple[float, float]
    thrust: float
    exponent: float
    lag: float
    command: float
    voltage: float

    def motor_thrust(self, flight: Recorded) -> Floats:
        """Return the thrust of each motor over the mass, (n, 4) m/s^2, along b3 up."""
        share = np.nan_to_num(flight.command) / self.command
        if np.isfinite(self.voltage) and np.isfinite(flight.voltage).any():
            v = flight.voltage / self.voltage
            share = share * np.where(np.isfinite(v), v, 1.0)[:, None]
        each = self.thrust * np.maximum(share, 0.0) ** self.exponent
        left = np.exp(-STEP / self.lag) if self.lag > 0.0 else 0.0
        out, _ = signal.lfilter([1.0 - left], [1.0, -left], each, axis=0, zi=left * each[:1])
        return out

    def thrust_over_mass(self, flight: Recorded) -> Floats:
        """Return the thrust of all motors over the mass, (n,) m/s^2, along b3 up."""
        return self.motor_thrust(flight).sum(axis=1)

    def force(self, thrust: Floats, v: Floats) -> Floats:
        """Return the specific force, (n, 3), of a thrust over the mass, (n,), at a velocity."""
        return np.column_stack([
            self.tilt[0] - self.drag[0] * v[:, 0], self.tilt[1] - self.drag[1] * v[:, 1],
            thrust - self.drag[2] * v[:, 2]])

    def predict(self, flight: Recorded) -> Floats:
        """Return the specific force at every row, (n, 3) m/s^2, body FLU."""
        return self.force(self.thrust_over_mass(flight), flight.body_velocity)


class Found(NamedTuple):
    """A fitted model: parameters with intervals, and those that the flight does not show."""

    model: ForceModel
    values: dict[str, Value]
    hidden: list[str]
    fit: Fit
    measured: Floats  # (m, 3) m/s^2, of the means that were compared
    t: Floats         # (m,) s

    @property
    def shown(self) -> dict[str, Value]:
        """Return the parameters that the flight shows."""
        unseen = {line.split(':')[0] for line in self.hidden}
        return {name: one for name, one in self.values.items() if name not in unseen}


def means(x: Floats) -> Floats:
    """Return means over ``BLOCK`` rows, (n // BLOCK, k)."""
    count = len(x) // BLOCK
    return x[:count * BLOCK].reshape(count, BLOCK, -1).mean(axis=1)


def _known(flight: Recorded) -> NDArray[np.bool_]:
    """Return at which means over the rows in the air, (m,), the samples show the commands."""
    return ~means(pulsed(flight)).any(axis=1)


def lag_of(left: float) -> float:
    """Return the time constant, s, of a lag that leaves a share of a deviation after ``STEP``."""
    return -STEP / float(np.log(left)) if left > 0.0 else 0.0


def _model(theta: Floats, command: float, voltage: float) -> ForceModel:
    x = [float(value) for value in theta]
    return ForceModel((x[0], x[1], x[2]), (x[3], x[4]), x[5], x[6], lag_of(x[7]), command, voltage)


def _swing(x: Floats) -> float:
    low, high = np.percentile(x, [0.5, 99.5])
    return float(high - low)


def _with_doubt(found: Fit, flights: Sequence[Recorded]) -> Fit:
    """Return a fit whose thrust is as uncertain as the bias of the accelerometer makes it."""
    doubt = max(bias_doubt(one.mounting) for one in flights) / 4.0
    covariance, i = found.covariance.copy(), NAMES.index('thrust')
    covariance[i, i] += (doubt / float(stats.norm.ppf(0.5 + 0.5 * LEVEL))) ** 2
    return found._replace(covariance=covariance)


def _hidden(values: dict[str, Value], v: Floats, thrust: Floats) -> list[str]:
    """Return what velocities (n, 3) m/s and thrusts (n,) m/s^2 do not show, with the reason."""
    hidden = [f'drag {axis}: the velocity along {axis} swings by {_swing(v[:, i]):.2f} m/s, '
              f'{LEAST_SWING:g} m/s are needed'
              for i, axis in enumerate('xyz') if _swing(v[:, i]) < LEAST_SWING]
    if _swing(thrust) < LEAST_THRUST * float(np.mean(thrust)):
        hidden += [f'{name}: the thrust swings by {_swing(thrust):.2f} m/s^2'
                   for name in ('exponent', 'motor lag')]
    for name, half in (('exponent', 0.5), ('motor lag', 0.05)):
        if values[name].half > half and not any(one.startswith(name) for one in hidden):
            hidden.append(f'{name}: the interval is wider than +-{half:g} {values[name].unit}')
    up = values['drag z']
    if up.high < 0.0 and not any(one.startswith('drag z') for one in hidden):
        hidden.append(f'drag z: [{up.low:.3g}, {up.high:.3g}] 1/s would drive the vehicle: '
                      'something else changes the thrust with the climb')
    return hidden


def _refuse_driving(names: str, values: dict[str, Value], unseen: set[str]) -> None:
    """Refuse a horizontal drag whose interval is wholly below 0: air does not drive a vehicle."""
    for name in ('drag x', 'drag y'):
        one = values[name]
        if name not in unseen and one.high < 0.0:
            raise IdentifyError(
                f'{names}: {name} is {one.low:.3g} to {one.high:.3g} 1/s, which drives the '
                f'vehicle: check the sign of the accelerometer along {name[-1]} (FLU)')


def _refuse_late_commands(
    names: str, found: Fit, measured: Floats, flights: Sequence[Recorded],
    known: Sequence[NDArray[np.bool_]], command: float, voltage: float,
) -> None:
    """Refuse commands that are stamped after what they do: without a lag a lead fits better."""
    if lag_of(min(float(found.theta[-1]), HIGH[-1])) > STEP:
        return
    earlier = [one._replace(command=np.roll(one.command, -LEAD, axis=0)) for one in flights]

    def rest(theta: Floats) -> Floats:
        model = _model(np.concatenate([found.theta[:5], theta, [0.0]]), command, voltage)
        return measured[:, 2] - np.concatenate(
            [means(model.predict(one)[one.air])[at, 2] for one, at in zip(earlier, known)])
    lead = optimize.least_squares(rest, found.theta[5:7], bounds=(LOW[5:7], HIGH[5:7]))
    left = float(np.mean(found.residual[:, 2] ** 2))
    if left > RIVAL * float(np.mean(lead.fun ** 2)):
        raise IdentifyError(
            f'{names}: the thrust changes before its command: the stamps of motor_pwm are late '
            f'against those of the IMU, by {LEAD * STEP:g} s or so')


def fit_force(*flights: Recorded, blocks: int = BLOCKS) -> Found:
    """
    Fit the specific force to the accelerometer of flights of one vehicle.

    Parameters
    ----------
    flights
        The first gives X_0 and V_0.
    blocks
        Parts whose disagreement widens the intervals; 0: intervals do not matter.

    Raises
    ------
    IdentifyError
        If they do not determine it.

    """
    for one in flights:
        refuse_pulsed(one)
    first = flights[0]
    command = float(np.mean(first.command[first.air]))
    there = np.isfinite(first.voltage[first.air])
    voltage = float(np.mean(first.voltage[first.air][there])) if there.any() else float('nan')
    known = [_known(one) for one in flights]
    measured = np.concatenate([means(one.force[one.air])[at] for one, at in zip(flights, known)])
    v = np.concatenate([one.body_velocity[one.air] for one in flights])

    def predicted(theta: Floats) -> Floats:
        model = _model(theta, command, voltage)
        return np.concatenate(
            [means(model.predict(one)[one.air])[at] for one, at in zip(flights, known)])
    names = ', '.join(one.name for one in flights)
    try:
        found = regression.fit(
            predicted, measured, START, LOW, HIGH, NAMES, blocks=blocks)
    except IdentifyError as error:
        raise IdentifyError(f'{names}: {error}') from None
    _refuse_late_commands(names, found, measured, flights, known, command, voltage)
    found = _with_doubt(found, flights)
    model = _model(found.theta, command, voltage)
    units = ('1/s', '1/s', '1/s', 'm/s^2', 'm/s^2', 'm/s^2', '1')
    values = {name: found.value(i, unit) for i, (name, unit) in enumerate(zip(NAMES, units))}
    left = found.value(len(units), '1')
    lag, low, high = (lag_of(min(x, HIGH[-1])) for x in (left.value, left.low, left.high))
    values['motor lag'] = Value(lag, max(0.0, low - STEP), high, 's')
    thrust = np.concatenate([model.thrust_over_mass(one)[one.air] for one in flights])
    if not model.thrust > 0.0:
        raise IdentifyError(f'{names}: the accelerometer shows no thrust: this is no flight')
    hidden = _hidden(values, v, thrust)
    unseen = {line.split(':')[0] for line in hidden}
    ends = regression.at_bound(found.theta, LOW, HIGH, NAMES, ['motor lag'])
    hidden += [f'{name}: the fit ends at the bound of its range, {end:g}'
               for name, end in ends.items() if name not in unseen]
    if not {'drag x', 'drag y'} & unseen:
        refuse_swapped(names, measured[:, :2], np.concatenate(
            [means(one.body_velocity[one.air])[at] for one, at in zip(flights, known)])[:, :2])
    _refuse_driving(names, values, unseen)
    t = np.concatenate([means(one.t[one.air][:, None])[at, 0] for one, at in zip(flights, known)])
    return Found(model, values, hidden, found, measured, t)
