r"""
Lag of the motors: how the accelerometer along b3 follows the commands.

Thrust of a motor follows its map (4.5) by a first-order lag, exact over a step in which the
command is held,

.. math:: T_{k+1} = T(X_k) + e^{-\Delta t/\tau} (T_k - T(X_k)), \quad a_3 = -\sum T/m .

The size of the thrust and an offset of the accelerometer are fitted along. A delay between
command and motor counts as lag, as the response to small commands does not tell them apart.
What is fitted is the share of a deviation that a usual step leaves: it is 0 without a lag, where
the time constant itself would have no effect.

Propellers shake an accelerometer above 20 Hz, a hundred times as much as below. Data and model are
therefore compared as means over 0.1 s, in which the shaking is gone and the lag is not.

The map is that of the base. A bag with a motion and without a scenario is a flight of a vehicle
that nobody knows: there the map is fitted along (:mod:`.from_flight`), unless ``--map base``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import dataclasses
from pathlib import Path
from typing import NamedTuple

from mambo_bags.command import Parser
from mambo_bags.reader import read_bag
from mambo_flight.closed_loop import Recording
from mambo_model import palette
from mambo_model.compiled import jit
from mambo_model.frames import flip_vector
from mambo_model.vehicle.motor_mixer import limit_pwm, thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle, VehicleValues
from mambo_signals import metrics, motion
from mambo_signals.resample import longest_run
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from . import from_flight, regression, result
from .base import based, flown, of_bag
from .regression import IdentifyError, Value

Floats = NDArray[np.float64]

BLOCK = 10        # control steps from mean to mean
LEAST = 800       # control steps
LONGEST = 0.5     # s
STILL = 0.02      # m/s^2, rms of the predicted thrust over mass: below, nothing is asked of motors
FLOOR = 3.0       # s at both ends of a flight in which the floor may carry a part of the weight
STRAY = 6.0       # of the robust deviation of the residual in between: more is the floor's force
LANDED = 0.5      # of the weight: commands below are no flight
GUESS = 0.03      # s
NAMES = 'lag', 'thrust over that of the map'
HOVER = 0.75      # of gravity, or its inverse, in the mean of a flight: a bias of 1 m/s^2, a tilt
                  # of 30 deg and a climb are less; another unit is 2 or more


class Motor(NamedTuple):
    """A lag, and what else the accelerometer tells of the thrust."""

    time_constant: Value  # s
    gain: Value           # 1, thrust over mass, over that of the vehicle
    offset: float         # m/s^2, of the accelerometer along z, body FRD
    without: float        # m/s^2, rms about the mean of what is left with no lag
    t: Floats             # (m,) s, of the means that were compared
    measured: Floats      # (m,) m/s^2
    fit: regression.Fit
    samples: int          # control steps that were compared

    @property
    def rms(self) -> float:
        """Return the rms about the mean of what is left with the lag, m/s^2."""
        return float(np.std(self.fit.residual))


@jit
def lagged(steps: Floats, pwm: Floats, left: float, vv: VehicleValues) -> Floats:
    """
    Return the total thrust, (n,) N, at the beginning of every control step.

    Parameters
    ----------
    steps : (n,)
        Length of each step over that of a usual one.
    pwm : (n, 4)
        Commands, held over the step.
    left
        Share of a deviation that is left after a usual step, exp(-dt/tau), 0 without lag.
    vv
        Motor map.

    """
    out, T = np.empty(len(steps)), np.zeros(4)
    for k in range(len(steps)):
        share, total = left ** steps[k], 0.0
        for j in range(4):
            target = thrust_from_pwm(limit_pwm(pwm[k, j], vv), vv) if pwm[k, j] > 0.0 else 0.0
            if k == 0:
                T[j] = target
            total += T[j]
            T[j] = target + share * (T[j] - target)
        out[k] = total
    return out


def fit_motor(t: Floats, pwm: Floats, acceleration: Floats, vehicle: Vehicle) -> Motor:
    """
    Fit the lag of the motors to a flight.

    Parameters
    ----------
    t : (n,) s
        Of the control steps, nearly even.
    pwm : (n, 4)
        Commands of each step.
    acceleration : (n,) m/s^2
        Specific force along b3 (down) at its beginning: -g in hover.
    vehicle
        Motor map and mass; its own lag does not matter.

    Raises
    ------
    IdentifyError
        For data that show no lag, in one line.

    """
    regression.check_columns({'time': t, 'pwm': pwm, 'acceleration': acceleration}, LEAST)
    regression.check_times(t)
    vv, dt = vehicle.values(), float(np.median(np.diff(t)))
    steps = np.append(np.diff(t) / dt, 1.0)

    def predicted(left: float) -> Floats:
        """Return the acceleration of motors with this lag, (n,) m/s^2."""
        return -lagged(steps, pwm, left, vv) / vehicle.mass
    _check(predicted(0.0), acceleration, vehicle.gravity)

    def model(theta: Floats) -> Floats:
        """Return means of the acceleration by lag (1 + what is left after a sample) and gain."""
        return means(theta[1] * predicted(float(theta[0]) - 1.0))[:, None]
    measured = means(acceleration)
    low, high = [1.0, 0.2], [1.0 + np.exp(-dt / LONGEST), 5.0]
    found = regression.fit(
        model, measured[:, None], [1.0 + np.exp(-dt / GUESS), 1.0], low, high, NAMES,
        np.ones((len(measured), 1)), step=1e-4)
    regression.refuse_bound(found, low, high, NAMES, NAMES[:1])
    value = Value(*(_time_constant(x - 1.0, dt) for x in found.value(0, '1')[:3]), 's')
    if not value.half < 0.5 * LONGEST:
        raise IdentifyError('this flight does not show the lag: fly one with quick commands')
    offset = float(np.mean(measured - model(found.theta)[:, 0]))
    rest = measured - means(found.theta[1] * predicted(0.0)) - offset
    return Motor(
        value, found.value(1, '1'), offset, float(np.std(rest)), means(t), measured, found,
        len(t))


def fit_flight(t: Floats, pwm: Floats, acceleration: Floats, vehicle: Vehicle) -> Motor:
    """
    Fit as :func:`fit_motor`, without what the floor does at both ends of a flight.

    A vehicle that touches down is carried by the floor while its motors still run, and a floor
    within a rotor's diameter adds thrust: the accelerometer then shows what no command explains.
    """
    found = fit_motor(t, pwm, acceleration, vehicle)
    at, residual = found.t, found.fit.residual[:, 0]
    first, last = at < at[0] + FLOOR, at > at[-1] - FLOOR
    between = residual[~first & ~last]
    if not len(between):
        return found
    middle = np.median(between)
    stray = np.abs(residual - middle) > STRAY * 1.4826 * np.median(np.abs(between - middle))
    begin, end = at[first & stray].max(initial=t[0]), at[last & stray].min(initial=t[-1])
    kept = (t >= begin) & (t <= end)
    return found if kept.all() else fit_motor(t[kept], pwm[kept], acceleration[kept], vehicle)


def means(x: Floats) -> Floats:
    """Return means of x (n,), every ``BLOCK`` samples, under a triangle of twice that width."""
    box = np.full(BLOCK, 1.0 / BLOCK)
    return np.convolve(x, np.convolve(box, box), 'valid')[::BLOCK]


def _time_constant(left: float, dt: float) -> float:
    """Return tau of left = exp(-dt/tau) in s."""
    if left >= 1.0:
        return float('inf')
    return -dt / float(np.log(left)) if left > 0.0 else 0.0


def _check(predicted: Floats, acceleration: Floats, gravity: float) -> None:
    """Refuse a flight that shows no lag or is not in its units."""
    if not np.std(predicted) > STILL:
        raise IdentifyError(
            f'the commands ask for changes of {np.std(predicted):.3g} m/s^2: constant commands '
            'show no lag')
    if not np.ptp(acceleration) > 0.0:
        raise IdentifyError(
            f'the acceleration along b3 is {acceleration[0]:.4g} m/s^2 throughout: that axis is '
            'dead, or not in the recording')
    if not HOVER < -acceleration.mean() / gravity < 1.0 / HOVER:
        raise IdentifyError(
            f'the mean acceleration along b3 is {acceleration.mean():.3g} m/s^2, not near '
            f'{-gravity:g}: it must be in m/s^2, down, and that of a flight')


def in_flight(t: Floats, pwm: Floats, vehicle: Vehicle, rest: float = 0.5) -> NDArray[np.bool_]:
    """
    Return which control steps are in the air: the longest part with thrust, less its ends.

    Parameters
    ----------
    t : (n,) s
    pwm : (n, 4)
    vehicle
        Whose weight says how much thrust a flight needs.
    rest : s
        At either end that is left out, of the blow of the floor.

    """
    vv = vehicle.values()
    thrust = lagged(np.full(len(t), 1.0), np.ascontiguousarray(pwm), 0.0, vv)
    up = np.append(thrust[1:] > LANDED * vehicle.mass * vehicle.gravity, False)
    flown = longest_run(up)
    out = np.zeros(len(t), bool)
    if flown.stop:
        out[flown] = True
        out &= (t >= t[flown][0] + rest) & (t <= t[flown][-1] - rest)
    return out


def from_recording(
    recording: Recording, vehicle: Vehicle,
) -> tuple[Floats, Floats, Floats]:
    """Return times s, commands and acceleration of a simulated flight, of the steps in the air."""
    t = recording.t * 1e-9
    air = in_flight(t, recording.pwm, vehicle)
    return t[air], recording.pwm[air], recording.imu[air, 5]


def _draw(found: Motor) -> Callable[[Figure], None]:
    def draw(figure: Figure) -> None:
        """Draw the acceleration measured and found, and what is left."""
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(found.t, found.measured, color=palette.COLOURS[palette.MEASURED],
                   label='accelerometer')
        above.plot(found.t, found.measured - found.fit.residual[:, 0], label='commands, lagged',
                   color=palette.COLOURS[palette.SERIES[0]], lw=1)
        above.set_ylabel('specific force along b3 [m/s^2]')
        above.legend()
        below.plot(found.t, found.fit.residual[:, 0], color=palette.INK, lw=0.6)
        below.set_ylabel('residual [m/s^2]')
        below.set_xlabel('time [s]')
    return draw


def read(path: Path, vehicle: Vehicle, namespace: str | None) -> tuple[Floats, Floats, Floats]:
    """Return times s, commands and acceleration of a bag, of the steps in the air."""
    bag = result.open_bag(path, ('imu/data_raw', 'motor_pwm'), namespace)
    imu, motors = bag['imu/data_raw'], bag['motor_pwm']
    here, there = metrics.common_stamps(imu.stamp, motors.stamp)
    if len(here) < LEAST:
        raise IdentifyError(
            f'{path}: {len(here)} commands with the stamp of an IMU sample, at least {LEAST} are '
            'needed')
    t = imu.stamp[here] * 1e-9
    pwm = np.ascontiguousarray(motors['pwm'][there], float)
    down = np.array([flip_vector(tuple(a))[2] for a in imu.acceleration[here].tolist()])
    if np.median(pwm.max(axis=1)) > vehicle.pwm_max:
        raise IdentifyError(
            f'{path}: motor_pwm has commands up to {pwm.max():g}, beyond the range of the base, '
            f'{vehicle.pwm_min:g} to {vehicle.pwm_max:g}: give the vehicle by --base')
    air = in_flight(t, pwm, vehicle)
    if not air.any():
        raise IdentifyError(
            f'{path}: with the motor map of the base, commands up to {pwm.max():g} lift nothing: '
            'give the vehicle by --base')
    return t[air], pwm[air], down[air]


def parser() -> Parser:
    """Return the command line."""
    out = result.parser(
        'identify_motor', 'Lag of the motors from commands and accelerometer of a flight.')
    out.add_argument('bag', type=Path, help='with imu/data_raw and motor_pwm')
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    out.add_argument('--map', choices=('base', 'flight'),
                     help='motor map: of the base, or fitted to the flight, which needs a motion '
                          '(default: flight for a bag with a motion and without a scenario)')
    from_flight.add_options(out)
    return out


def _map_of_flight(options: argparse.Namespace) -> bool:
    """Return whether the motor map comes from the flight."""
    if options.map is not None:
        return bool(options.map == 'flight')
    bag = read_bag(options.bag, motion.TRUTH, options.namespace)
    return flown(bag) is None and any(
        topic in bag and len(bag[topic]) for topic in motion.TRUTH)


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_motor``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> result.Report:
        """Read the bag and return what was found."""
        if _map_of_flight(options):
            return from_flight.motor_report(from_flight.read(
                options.bag, options.base, options.mass, options.namespace))
        base = of_bag(options.base, options.bag, options.namespace)
        vehicle = base.vehicle
        if options.mass is not None:
            vehicle = dataclasses.replace(vehicle, mass=options.mass)  # checks its range
        t, pwm, acceleration = read(options.bag, vehicle, options.namespace)
        found = fit_flight(t, pwm, acceleration, vehicle)
        value = found.time_constant
        source = (f'identify_motor, {options.bag.name}, 95 %: {value.low:.4g} to '
                  f'{value.high:.4g}')
        return based(result.Report(
            f'lag of the motors of {options.bag.name}',
            {'time constant': value, 'thrust over that of the map': found.gain},
            {'accelerometer offset z, body FLU [m/s^2]': flip_vector((0.0, 0.0, found.offset))[2],
             'rms residual [m/s^2]': found.rms, 'rms without lag [m/s^2]': found.without,
             'samples': found.samples, 'order of the residual': found.fit.order[0]},
            ['a delay of the commands counts as lag, late stamps of theirs as less',
             *base.unless_sagged(
                 'the map of the base holds at one battery voltage',
                 'lag and thrust over that of the map',
                 'record voltage and motion, and give --map flight')],
            {'motor_time_constant': (value.value, source)}, _draw(found)), base)
    return result.run('identify_motor', options, work)


if __name__ == '__main__':
    raise SystemExit(main())
