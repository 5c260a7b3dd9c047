"""
Vehicle parameters from one flight: drag, thrust and its lag, inertia, mounting, biases, noise.

Reads a bag with IMU, motor commands and a motion capture (or truth), of any drone, and writes
a vehicle file that can be flown. Parameters that the flight does not excite are named and keep the
value of the base. An accelerometer cannot determine the mass: give ``--mass``, or keep the base.
Moments of inertia hold for a lag of the motors: give ``--motor-lag``, or keep that of the base. If
the base has none, that of the flight is taken with its error, and if the flight shows none, there
are no moments. A vehicle file has moments and the lag that they hold for.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import real
from mambo_bags.command import Parser
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle
from mambo_signals.gyro_check import ASKEW
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from . import command_delay
from ..identify import result
from ..identify.base import Base, based, of_bag
from ..identify.regression import IdentifyError, LEVEL, Value
from ..importers.checks.powertrain import LEAST_VOLTS
from .command_pulses import pulse_notes
from .contradictions import SCALE
from .force import BLOCKS, fit_force, Found
from .moments import fit_moments, Moment, REMEDY
from .recorded import BATTERY_GAP, GRAVITY, read_flight, Recorded

AXES = 'xyz'
USUAL_BIAS = 0.8  # m/s^2, of the accelerometer along z: MPU-6000, at most
Floats = NDArray[np.float64]

SMALLEST = 1.0  # command at which a vehicle can hover: the maps of vehicle files begin there
OTHER_MASS = 3.0  # factor between mass and lift; 1.6 to 1.9 with the preset crazyflie on NanoBench
CHARGING = 0.015  # share by which a battery rises in the air; 0.002 at most in those flights
SLOW = 0.1  # s between readings of a battery; in flights of a Crazyflie 0.01
NO_LAG = 0.01  # [s] of motors, at most; in flights of a Crazyflie 0.02 or more
METHOD = f'{result.METHOD}; wider where {BLOCKS} parts of the flight disagree (jackknife)'


def _resting(flight: Recorded) -> dict[str, Value]:
    """Return bias of the gyro, body FLU, and noise of both sensors, from the rest at the start."""
    out: dict[str, Value] = {}
    count = flight.rest.stop - flight.rest.start
    if not count:
        return out
    low, high = stats.chi2.ppf([0.5 + 0.5 * LEVEL, 0.5 - 0.5 * LEVEL], count - 1)
    for name, values, unit in (('gyro', flight.gyro, 'rad/s'), ('accelerometer', flight.force,
                                                               'm/s^2')):
        for i, axis in enumerate(AXES):
            x = values[flight.rest, i]
            sigma = float(x.std(ddof=1))
            if name == 'gyro':
                half = float(stats.t.ppf(0.5 + 0.5 * LEVEL, count - 1)) * sigma / count ** 0.5
                mean = float(x.mean())
                out[f'gyro bias {axis}, body FLU'] = Value(mean, mean - half, mean + half, unit)
            scale = (count - 1) ** 0.5 * sigma
            out[f'{name} noise {axis}'] = Value(
                sigma, scale / float(low) ** 0.5, scale / float(high) ** 0.5, unit)
    return out


def hover_command(found: Found) -> Value:
    """Return the hover command of four equal motors at the mean voltage."""
    thrust, b = found.model.thrust, found.model.exponent
    command = found.model.command * (GRAVITY / (4.0 * thrust)) ** (1.0 / b)
    i, j = 5, 6  # thrust and exponent among the parameters
    slope = np.array([-1.0 / (b * thrust), -np.log(GRAVITY / (4.0 * thrust)) / b ** 2]) * command
    covariance = found.fit.covariance[np.ix_([i, j], [i, j])]
    half = float(stats.t.ppf(0.5 + 0.5 * LEVEL, found.fit.freedom)
                 * np.sqrt(slope @ covariance @ slope))
    return Value(float(command), float(command) - half, float(command) + half, 'PWM')


def command_notes(name: str, hover: float, base: Vehicle) -> list[str]:
    """
    Return a note if a flight hovers at a command that its base cannot be given, or that would
    lift another mass.

    Raises
    ------
    IdentifyError
        If the commands are in another unit than any vehicle's.

    """
    if hover < SMALLEST:
        raise IdentifyError(f'{name}: it hovers at a motor_pwm of {hover:.3g}: a vehicle takes '
                            'PWM or counts above 1; multiply the commands by their range')
    if base.pwm_min < hover < base.pwm_max:
        lift = 4.0 * thrust_from_pwm(hover, base.values()) / (base.mass * base.gravity)
        if 1.0 / OTHER_MASS < lift < OTHER_MASS:
            return []
        return [f'it hovers at a motor_pwm of {hover:.0f}, with which the motors of the base lift '
                f'{lift:.2g} times the mass of {base.mass:.3g} kg: check --mass and --base']
    return [f'it hovers at a motor_pwm of {hover:.0f}, and its base takes {base.pwm_min:g} to '
            f'{base.pwm_max:g}: the vehicle file cannot be flown without other pwm_min and '
            'pwm_max, or another --base']


def lag_notes(name: str, lag: float, base: Vehicle) -> list[str]:
    """Return a note if the thrust has no lag, s, and the motors of the base have one."""
    if lag > NO_LAG or base.motor_time_constant <= NO_LAG:
        return []
    return [f'{name}: the thrust follows its command at once, that of the base is '
            f'{base.motor_time_constant:.3g} s behind: the stamps of motor_pwm may be late, and '
            'exponent and inertia have their error']


def drag_parameters(found: Found, source: str) -> dict[str, tuple[Any, str]]:
    """
    Return the drag of a vehicle file with its source; nothing without a horizontal drag.

    The reading belongs to both coefficients, so a vertical one alone has no place in a file.
    """
    shown = found.shown
    drag = {axis: found.model.drag[i] for i, axis in enumerate(AXES)
            if f'drag {axis}' in shown and shown[f'drag {axis}'].low > 0.0}
    upward = (drag.pop('z'), source) if 'z' in drag else (0.0, 'not shown by the flight')
    if not drag:
        return {}
    return {'drag_reading': ('acceleration', source),
            'drag_coefficient': (float(np.mean(list(drag.values()))), source),
            'vertical_drag_coefficient': upward}


def vehicle_parameters(
    found: Found, base: Vehicle, mass: float, hover: float, source: str,
    moments: dict[str, Moment], motors: Lag,
) -> dict[str, tuple[Any, str]]:
    """
    Return the parameters of a vehicle file that the flight determines.

    The lag is the one that was given, or that the moments of inertia hold for; else it is that of
    the flight.
    """
    model, known = found.model, found.shown
    out: dict[str, tuple[Any, str]] = {'mass': (mass, 'as given, or of the base')}
    shown = [None if axis not in moments else moments[axis].value for axis in AXES]
    if any(shown):
        out['inertia'] = (tuple(
            kept if one is None else one.value for one, kept in zip(shown, base.inertia)),
            f'{source}; about {" and ".join(a for a, v in zip(AXES, shown) if v)}')
    exponent = model.exponent if 'exponent' in known else base.power_b
    # the law through the hover point, at the mean voltage of the flight
    out |= {'thrust_map': ('power', source), 'power_b': (exponent, source),
            'power_a': (mass * GRAVITY / 4.0 / hover ** exponent, source),
            'linear_gain': (hover / (mass * GRAVITY / 4.0), source)}
    if motors.given or any(shown):
        held = '; the inertia holds for it' if any(shown) else ''
        out['motor_time_constant'] = (
            motors.value, source if motors.ends else f'{motors.source}{held}')
    elif 'motor lag' in known:
        out['motor_time_constant'] = (model.lag, source)
    return out | drag_parameters(found, source)


def battery_notes(name: str, volts: Floats, pace: float = np.nan) -> list[str]:
    """
    Return what is wrong with a battery in the air, one line each.

    Parameters
    ----------
    name
        Of the flight.
    volts : (n,) V
    pace : s
        Time between its new readings.

    """
    if not len(volts) or not np.isfinite(volts).all():
        return []
    if np.ptp(volts) == 0.0:
        return [f'{name}: the battery shows {volts[0]:.4g} V throughout: it was not measured, and '
                'drag z, exponent, motor lag and inertia hold only if it did not sag']
    lines, part, mean = [], len(volts) // 5, float(volts.mean())
    if pace > SLOW:
        lines.append(f'{name}: the battery has a new reading every {pace:.2g} s: it sags with '
                     'each change of the thrust, so drag z, exponent, motor lag and inertia have '
                     'an error that their intervals do not hold')
    if mean < LEAST_VOLTS:
        lines.append(f'{name}: the battery shows {mean:.3g} V in the mean, less than one lithium '
                     'cell has in flight: check its unit and channel')
    rise = float(volts[-part:].mean() - volts[:part].mean()) if part else 0.0
    if rise > CHARGING * mean:
        lines.append(f'{name}: the battery rises by {rise:.2g} V in the air: it is that of another'
                     ' flight or runs backwards, and drag z, exponent, motor lag and inertia have '
                     'its error')
    return lines


def voltage_notes(found: Found, base: Base, values: str) -> list[str]:
    """
    Return a note if the battery of a flight may have sagged and its voltage is not known.

    Parameters
    ----------
    found, base
        Of the flight.
    values
        What a sag would falsify.

    """
    if np.isfinite(found.model.voltage):
        return []
    return base.unless_sagged(
        f'no battery voltage in the recording, or one less often than every {BATTERY_GAP:g} s',
        values, 'record the voltage, as topic battery')


def reading_notes(flight: Recorded) -> list[str]:
    """Return how a flight was read where it is not as usual, one line each."""
    lines = [f'{flight.name}: {line}' for line in flight.absent]
    if flight.late:
        lines.append(
            f'{flight.name}: the poses are {abs(flight.late):.2f} s '
            f'{"late" if flight.late > 0.0 else "early"} against the gyro, and were moved by it')
    if abs(flight.bias) > USUAL_BIAS:
        lines.append(f'{flight.name}: the accelerometer is {flight.bias:+.2g} m/s^2 off along z, '
                     f'usual are {USUAL_BIAS:g} at most: check its scale, as drag and thrust have '
                     'its error')
    for axis, (low, high), (least, most) in zip(AXES, flight.gain, SCALE):
        if not (low <= most and high >= least):
            lines.append(f'{flight.name}: along {axis} of the world the tracked position '
                         f'accelerates {low:.2f} to {high:.2f} times as much as accelerometer and '
                         'attitude say: check the scales of both, as drag and thrust have their '
                         'error')
    if abs(flight.askew) > ASKEW:
        lines.append(f'{flight.name}: the axes of the tracked body are turned by '
                     f'{np.degrees(flight.askew):.0f} deg about z against those of the gyro: '
                     'check how its rigid body was made, as drag and inertia have its error')
    lines += command_delay.command_notes(flight) + pulse_notes(flight)
    lines += battery_notes(flight.name, flight.voltage[flight.air], flight.battery_pace)
    if not flight.has_ground:
        lines.append(f'{flight.name}: it begins and ends in the air: all of it is taken as '
                     'flight, also where it is near the floor')
    if flight.unused:
        begin, end = flight.t[flight.air][[0, -1]]
        lines.append(
            f'{flight.name}: only the longest stretch in the air is used, {begin:.1f} to '
            f'{end:.1f} s; {flight.unused:.0f} s of others are not: give each in a bag of its own')
    return lines


class Lag(NamedTuple):
    """Lag of the motors that moments of inertia hold for."""

    value: float                     # s
    source: str                      # where it comes from
    ends: tuple[float, ...] = ()     # s, of its interval; none if it is taken as known
    given: bool = False              # whether by --motor-lag
    shown: bool = True               # False: by nothing, so no moment can be found


def known_lag(given: float | None, base: Base, found: Found) -> Lag:
    """
    Return the lag of the motors that moments of inertia are to hold for.

    Parameters
    ----------
    given : s
        None: that of the base, or, if it has none, of the flight. The vehicle of the scenario of a
        simulated flight is known to have none then.
    base, found
        Of the flight.

    """
    if given is not None:
        return Lag(given, 'as given', given=True)
    if base.own or base.vehicle.motor_time_constant > 0.0:
        return Lag(base.vehicle.motor_time_constant, 'of the base')
    one = found.values['motor lag']
    return Lag(one.value, 'of this flight, with its error', (one.low, one.high),
               shown='motor lag' in found.shown)


def moments_of(
    flight: Recorded, found: Found, vehicle: Vehicle, lag: Lag,
) -> tuple[dict[str, Moment], list[str]]:
    """Return the moments of inertia by axis, and a note on their lag, or why there are none."""
    if not lag.shown:
        return {}, ['not shown by this flight: inertia: it holds for a motor lag, which neither '
                    f'the base has nor this flight shows: {REMEDY}']
    moments = fit_moments(flight, found, vehicle, lag.value, lag.ends)
    notes = [f'not shown by this flight: inertia {axis}: {one.hidden}'
             for axis, one in moments.items() if one.hidden]
    if any(one.value for one in moments.values()):
        notes.append(f'inertia is for a motor lag of {lag.value:.3g} s, {lag.source}; a longer '
                     'lag gives a smaller one')
    return moments, notes


def read(
    path: Path, base: str | None, mass: float | None, namespace: str | None,
) -> tuple[Recorded, Found, Base]:
    """
    Read a flight, fit its specific force, and return the base that all else is taken from.

    Parameters
    ----------
    path
        Bag with ``imu/data_raw``, ``motor_pwm`` and a motion (capture or truth).
    base
        Name or file of a vehicle; None: that of the scenario in the bag, or the default.
    mass : kg
        None: that of the base.
    namespace
        Of the drone; None if the bag has one.

    Raises
    ------
    IdentifyError, mambo_bags.reader.BagError, mambo_model.schema.ParameterError
        In one line.

    """
    start = of_bag(base, path, namespace)
    if mass is not None:  # dataclasses.replace checks its range
        start = start._replace(vehicle=dataclasses.replace(start.vehicle, mass=mass))
    recorded = read_flight(path, namespace)
    return recorded, fit_force(recorded), start


def identify(
    path: Path, base: str | None, mass: float | None, namespace: str | None,
    lag: float | None = None,
) -> result.Report:
    """
    Identify a vehicle from a flight and return the report.

    Parameters
    ----------
    path, base, mass, namespace
        As of :func:`read`, errors too.
    lag : s
        Of the motors, for the moments of inertia. None: as :func:`known_lag` says.

    """
    flight, found, whole = read(path, base, mass, namespace)
    start = whole.vehicle
    hover = hover_command(found)
    motors = known_lag(lag, whole, found)
    moments, of_inertia = moments_of(flight, found, start, motors)
    values = found.shown
    values |= {f'inertia {axis}': one.value for axis, one in moments.items() if one.value}
    values |= {'hover command': hover, **_resting(flight)}
    notes = ['x, y and z, roll and pitch are of body FLU, the axes of imu/data_raw: x forward, y '
             'left, z up', *(f'not shown by this flight: {line}' for line in found.hidden)]
    notes += of_inertia
    if flight.rest.stop == flight.rest.start:
        notes.append('not shown by this flight: biases and noise: no second of rest, motors off, '
                     'before take-off')
    if flight.has_flow:
        notes.append('it has optical flow: mambo identify flow gives its factor')
    if np.isfinite(found.model.voltage):
        notes.append(f'per mass; thrust and tilt hold at {found.model.voltage:.2f} V')
    notes += [*voltage_notes(found, whole, 'drag z, exponent, motor lag and inertia'),
              *command_notes(path.name, hover.value, start),
              *(lag_notes(path.name, found.model.lag, start)
                if 'motor lag' in values else []), *reading_notes(flight)]
    angles = np.degrees(flight.mounting[:2])
    facts = {'time in the air [s]': float(flight.t[flight.air][-1] - flight.t[flight.air][0]),
             'mass [kg], not identified': start.mass,
             'markers turned by, roll [deg]': float(angles[0]),
             'markers turned by, pitch [deg]': float(angles[1]),
             'accelerometer bias z, body FLU [m/s^2]': flight.bias,
             **{f'R^2 of the gyro {axis}': one.share for axis, one in moments.items()},
             'rms residual [m/s^2]': found.fit.rms}
    return based(result.Report(
        f'what {path.name} tells of its vehicle', values, facts, notes,
        vehicle_parameters(found, start, start.mass, hover.value,
                           f'mambo identify flight, {path.name}', moments, motors),
        result.drawn_force(found.t, found.measured, found.fit.residual), method=METHOD), whole)


def parser() -> Parser:
    """Return the command line."""
    out = result.parser('identify_flight', 'What one flight tells of its vehicle, each value '
                                           'with its interval.')
    out.add_argument('bag', type=Path, help='with imu/data_raw, motor_pwm and optitrack/pose')
    out.add_argument('--mass', type=real(0.0, 1000.0, 'kg', above=True), metavar='KG',
                     help='default: that of the base')
    out.add_argument('--motor-lag', type=real(0.0, 0.5, 's'), metavar='S',
                     help='of the motors, for the inertia (default: that of the base; if it has '
                          'none, that of the flight, where it shows it)')
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_flight``; return the exit code."""
    options: argparse.Namespace = parser().parse_args(arguments)
    return result.run('identify_flight', options, lambda: identify(
        options.bag, options.base, options.mass, options.namespace, options.motor_lag))


if __name__ == '__main__':
    raise SystemExit(main())
