"""
Drag, motor map and motor lag from a flight of which nothing is known but its recording.

``identify drag``, ``identify thrust`` and ``identify motor`` take a bag that holds no scenario:
the accelerometer shows the specific force, whatever was flown
(:mod:`mambo_analysis.twin.force`). What the recording cannot know comes from the command line: the
vehicle that all else is taken from (:mod:`.base`), and its mass (``--mass``).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import real
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

from . import result
from ..twin import identify_flight
from ..twin.force import Found
from ..twin.identify_flight import drag_parameters, METHOD, reading_notes, voltage_notes
from ..twin.recorded import GRAVITY, Recorded
from .base import Base, based
from .regression import IdentifyError, Value

AXES = {'horizontal': 'xy', 'vertical': 'z'}


class Flight(NamedTuple):
    """A recorded flight, its force model, and the base that all else is taken from."""

    recorded: Recorded
    found: Found
    base: Base

    @property
    def vehicle(self) -> Vehicle:
        """Return the vehicle that all else is taken from."""
        return self.base.vehicle

    @property
    def unknown(self) -> str:
        """Return the beginning of a note on a flight of which only the recording is known."""
        return '' if self.base.simulated else 'no scenario in the bag: '

    @property
    def name(self) -> str:
        """Return the name of the bag."""
        return self.recorded.name

    def value(self, name: str) -> Value:
        """Return a parameter of the force model; an IdentifyError says why it is not shown."""
        for line in self.found.hidden:
            if line.startswith(f'{name}:'):
                raise IdentifyError(f'{self.name} does not show {line}')
        return self.found.values[name]

    def facts(self) -> dict[str, Any]:
        """Return what was known beforehand, and how well the model fits."""
        model, t = self.found.model, self.recorded.t[self.recorded.air]
        return {'mass [kg], not identified': self.vehicle.mass,
                'time in the air [s]': float(t[-1] - t[0]),
                'mean command': model.command, 'mean voltage [V]': model.voltage
                if np.isfinite(model.voltage) else 'not recorded',
                'rms residual [m/s^2]': self.found.fit.rms}


def add_options(out: argparse.ArgumentParser) -> None:
    """Add the option with the fact that a recording does not hold."""
    out.add_argument('--mass', type=real(0.0, 1000.0, 'kg', above=True), metavar='KG',
                     help='of the vehicle (default: of the base)')


def read(path: Path, base: str | None, mass: float | None, namespace: str | None) -> Flight:
    """Read a flight; arguments and errors as of :func:`..twin.identify_flight.read`."""
    return Flight(*identify_flight.read(path, base, mass, namespace))


def _draw(flight: Flight, axes: str) -> Any:
    return result.drawn_force(
        flight.found.t, flight.found.measured, flight.found.fit.residual, axes)


def _source(command: str, flight: Flight, value: Value) -> str:
    return f'{command}, {flight.name}, 95 %: {value.low:.4g} to {value.high:.4g}'


def drag_report(flight: Flight, part: str) -> result.Report:
    """Return the linear drag over the mass along the axes of a part, 1/s."""
    values = {f'drag {axis}': flight.value(f'drag {axis}') for axis in AXES[part]}
    found = list(values.values())
    mean = float(np.mean([v.value for v in found]))
    if not mean > 0.0:
        raise IdentifyError(f'{flight.name}: a drag of {mean:.3g} 1/s drives the vehicle: check '
                            'axes and signs of velocity and accelerometer')
    sag = voltage_notes(flight.found, flight.base, 'drag z') if part == 'vertical' else []
    return based(result.Report(
        f'{part} drag of {flight.name}', values, flight.facts(),
        [f'{flight.unknown}the drag is that of the accelerometer against the velocity of '
         'the motion capture, per mass', *sag, *reading_notes(flight.recorded)],
        drag_parameters(flight.found, f'identify_drag, {flight.name}'),
        _draw(flight, AXES[part]), method=METHOD), flight.base)


def thrust_report(flight: Flight) -> result.Report:
    """Return the power law of one motor at the mean voltage, N over command."""
    model, mass = flight.found.model, flight.vehicle.mass
    kappa, b = flight.value('thrust'), flight.value('exponent')
    thrust = Value(*(mass * x for x in kappa[:3]), 'N')
    a = mass * model.thrust / model.command ** model.exponent
    hover = identify_flight.hover_command(flight.found).value
    source = _source('identify_thrust', flight, b)
    return based(result.Report(
        f'motor map of {flight.name}', {'thrust at the mean command': thrust, 'b': b},
        {**flight.facts(), 'a [N]': f'{a:.6g}', 'hover command': hover},
        [f'{flight.unknown}thrust is mass times specific force, over the command and the '
         'voltage of the battery; a holds at the mean voltage and belongs to b',
         *voltage_notes(flight.found, flight.base, 'a, b and the hover command'),
         *identify_flight.command_notes(flight.name, hover, flight.vehicle),
         *reading_notes(flight.recorded)],
        {'mass': (mass, 'as given, or of the base'), 'thrust_map': ('power', source),
         'power_a': (a, source), 'power_b': (model.exponent, source),
         'linear_gain': (hover / (mass * GRAVITY / 4.0), f'{source}; through the hover')},
        _draw(flight, 'z'), method=METHOD), flight.base)


def motor_report(flight: Flight) -> result.Report:
    """Return the lag of the motors, with the motor map of the flight itself."""
    lag = flight.value('motor lag')
    return based(result.Report(
        f'lag of the motors of {flight.name}',
        {'time constant': lag},
        {**flight.facts(), 'exponent of the map': flight.found.model.exponent},
        [f'{flight.unknown}the motor map is that of this flight, with its battery',
         'a delay of the commands counts as lag, late stamps of theirs as less',
         *voltage_notes(flight.found, flight.base, 'lag and exponent'),
         *reading_notes(flight.recorded)],
        {'motor_time_constant': (lag.value, _source('identify_motor', flight, lag))},
        _draw(flight, 'z'), method=METHOD), flight.base)
