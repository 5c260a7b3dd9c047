"""
Vehicle parameters from one flight: drag, thrust and its lag, mounting, biases, noise.

Reads a bag with IMU, motor commands and a motion capture (or truth), of any drone, and writes
a vehicle file that can be flown. Parameters that the flight does not excite are named and keep the
value of the base. An accelerometer cannot determine the mass: give ``--mass``, or keep the base.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from mambo_bags.cli.option_types import real
from mambo_bags.command import Parser
from mambo_model import palette
from mambo_model.vehicle.parameters import preset, Vehicle
from matplotlib.figure import Figure
import numpy as np
from scipy import stats

from ..identify import result
from ..identify.regression import LEVEL, Value
from .force import fit_force, Found
from .recorded import GRAVITY, read_flight, Recorded

AXES = 'xyz'


def _resting(flight: Recorded) -> dict[str, Value]:
    """Return bias of the gyro and noise of both sensors, from the rest before take-off."""
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
                out[f'gyro bias {axis}'] = Value(mean, mean - half, mean + half, unit)
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


def _vehicle(
    found: Found, base: Vehicle, mass: float, hover: float, source: str,
) -> dict[str, tuple[Any, str]]:
    """Return the parameters of a vehicle file that the flight determines, with the PWM range."""
    model, hidden = found.model, {line.split(':')[0] for line in found.hidden}
    out: dict[str, tuple[Any, str]] = {'mass': (mass, 'as given, or of the base')}
    exponent = base.power_b if 'exponent' in hidden else model.exponent
    # the law through the hover point, at the mean voltage of the flight
    out |= {'thrust_map': ('power', source), 'power_b': (exponent, source),
            'power_a': (mass * GRAVITY / 4.0 / hover ** exponent, source),
            'linear_gain': (hover / (mass * GRAVITY / 4.0), source)}
    if 'motor lag' not in hidden:
        out['motor_time_constant'] = (model.lag, source)
    sideways = [model.drag[i] for i, axis in enumerate('xy')
                if f'drag {axis}' not in hidden and found.values[f'drag {axis}'].low > 0.0]
    if sideways:
        out['drag_reading'] = ('acceleration', source)
        out['drag_coefficient'] = (max(0.0, float(np.mean(sideways))), source)
        out['vertical_drag_coefficient'] = (0.0, 'not shown by the flight')
        if 'drag z' not in hidden and found.values['drag z'].low > 0.0:
            out['vertical_drag_coefficient'] = (model.drag[2], source)
    return out


def _draw(found: Found) -> Any:
    def draw(figure: Figure) -> None:
        """Draw the specific force on each axis, measured and as fitted."""
        rows = figure.subplots(3, 1, sharex=True)
        flown, fitted = palette.lines(['accelerometer', 'model'])
        for i, axes in enumerate(rows):
            axes.plot(found.t, found.measured[:, i], label='accelerometer', **flown)
            axes.plot(found.t, found.measured[:, i] - found.fit.residual[:, i], label='model',
                      **fitted)
            axes.set_title(f'specific force along {AXES[i]} [m/s^2], FLU')
        rows[0].legend()
        rows[-1].set_xlabel('time [s]')
    return draw


def identify(path: Path, base: str, mass: float | None, namespace: str | None) -> result.Report:
    """
    Identify a vehicle from a flight and return the report.

    Raises
    ------
    IdentifyError, mambo_bags.reader.BagError, mambo_model.schema.ParameterError
        In one line.

    """
    start = preset(base)
    if mass is not None:
        start = dataclasses.replace(start, mass=mass)  # checks its range
    flight = read_flight(path, namespace)
    found = fit_force(flight)
    hover = hover_command(found)
    shown = {line.split(':')[0] for line in found.hidden}
    values = {name: value for name, value in found.values.items() if name not in shown}
    values |= {'hover command': hover, **_resting(flight)}
    notes = [f'not shown by this flight: {line}' for line in found.hidden]
    if flight.rest.stop == flight.rest.start:
        notes.append('not shown by this flight: biases and noise: no second of rest, motors off, '
                     'before take-off')
    if flight.has_flow:
        notes.append('it has optical flow: mambo identify flow gives its factor')
    notes.append(f'per mass; thrust and tilt hold at {found.model.voltage:.2f} V'
                 if np.isfinite(found.model.voltage) else 'no battery voltage in the recording')
    angles = np.degrees(flight.mounting[:2])
    facts = {'time in the air [s]': float(flight.t[flight.air][-1] - flight.t[flight.air][0]),
             'mass [kg], not identified': start.mass,
             'markers turned by, roll [deg]': float(angles[0]),
             'markers turned by, pitch [deg]': float(angles[1]),
             'rms residual [m/s^2]': found.fit.rms}
    return result.Report(
        f'what {path.name} tells of its vehicle', values, facts, notes,
        _vehicle(found, start, start.mass, hover.value, f'mambo identify flight, {path.name}'),
        _draw(found))


def parser() -> Parser:
    """Return the command line."""
    out = result.parser('identify_flight', 'What one flight tells of its vehicle, each value '
                                           'with its interval.')
    out.add_argument('bag', type=Path, help='with imu/data_raw, motor_pwm and optitrack/pose')
    out.add_argument('--mass', type=real(0.0, 1000.0, 'kg', above=True), metavar='KG',
                     help='default: that of the base')
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_flight``; return the exit code."""
    options: argparse.Namespace = parser().parse_args(arguments)
    return result.run('identify_flight', options, lambda: identify(
        options.bag, options.base, options.mass, options.namespace))


if __name__ == '__main__':
    raise SystemExit(main())
