"""
Commands at given times as text, a YAML list; axes are z-up as on the topics.

    - {time: 2.0, takeoff: {height: 1.0}}
    - {time: 6.0, go_to: {goal: [1.0, 0.0, 1.0], yaw: 0.5, duration: 4.0}}
    - {time: 12.0, stop: {}}
    - {time: 14.0, land: {}}
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
import json
import sys
from typing import Any

from mambo_model.frames import flip_vector
from mambo_model.motion import flight_command as fc
from mambo_model.motion.flight_command import FlightCommand
from mambo_model.schema import ParameterError, shown, unknown
from mambo_model.vehicle.parameters import Vehicle
from mambo_model.yaml_nodes import load, reason
import yaml

from .command_params import CommandParams
from .demand import STEP
from .timeline import fold, Timeline

STEP_NS = round(1e9 * STEP)  # the control period of section 4.2, 200 Hz
MOST = 20_000  # commands of a script
_VECTORS = {'goal': 'position', 'position': 'position', 'velocity': 'velocity',
            'acceleration': 'acceleration', 'jerk': 'jerk', 'snap': 'snap'}
_KEYS = {  # of each kind
    'takeoff': ('height', 'duration'),
    'land': ('height', 'duration'),
    'go_to': ('goal', 'yaw', 'relative', 'duration'),
    'follow': ('trajectory', 'timescale', 'relative', 'duration'),
    'stop': (),
    'velocity': ('velocity', 'yaw_rate', 'duration'),
    'setpoint': ('position', 'velocity', 'acceleration', 'jerk', 'snap', 'yaw', 'yaw_rate')}
_NEEDED = {'takeoff': ('height',), 'go_to': ('goal',), 'follow': ('trajectory',),
           'velocity': ('velocity', 'duration'), 'setpoint': ('position',)}
_NEGATIVE = ('yaw', 'yaw_rate')  # change their sign from z-up to NED


def at_step(seconds: float) -> int:
    """Return the first control step at or after a time in s, as its stamp in ns."""
    return -(-round(seconds * 1e9) // STEP_NS) * STEP_NS


def _number(value: Any, where: str) -> float:
    """Return a finite number; ParameterError naming its place."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ParameterError(f'{where} = {shown(value)} must be a number')
    if not -sys.float_info.max <= value <= sys.float_info.max:
        raise ParameterError(f'{where} = {shown(value)} must be finite')
    return float(value)


def _value(name: str, value: Any, where: str) -> tuple[str, Any]:
    """Return the field of a command and its value, of a key of the script."""
    where = f'{where}: {name}'
    if name in _VECTORS:
        if not isinstance(value, list) or len(value) != 3:
            raise ParameterError(f'{where} = {shown(value)} must be 3 numbers: [x, y, z]')
        x, y, z = (_number(element, where) for element in value)
        return _VECTORS[name], flip_vector((x, y, z))
    if name == 'relative':
        if not isinstance(value, bool):
            raise ParameterError(f'{where} = {shown(value)} must be true or false')
        return name, value
    if name == 'trajectory':
        if not isinstance(value, str):
            raise ParameterError(f'{where} must be the text of a course')
        return name, value
    number = _number(value, where)
    return name, -number if name in _NEGATIVE else number


def _command(entry: Any, where: str) -> FlightCommand:
    """Return the command of one entry."""
    if not isinstance(entry, Mapping) or 'time' not in entry or len(entry) != 2:
        raise ParameterError(
            f'{where}: must hold a time and one command, such as '
            '{time: 2.0, takeoff: {height: 1.0}}')
    name = next(key for key in entry if key != 'time')
    if name not in _KEYS:
        raise ParameterError(f'{where}: {unknown(str(name), _KEYS)}'.replace(
            'parameter', 'command'))
    time = _number(entry['time'], f'{where}: time')
    if not 0.0 <= time <= 86400.0:
        raise ParameterError(f'{where}: time = {time:g} s is outside [0, 86400] s')
    given = entry[name] or {}
    if not isinstance(given, Mapping):
        raise ParameterError(f'{where}: {name} must hold names and values')
    missing = [key for key in _NEEDED.get(name, ()) if key not in given]
    if missing:
        raise ParameterError(f'{where}: {name} needs {" and ".join(missing)}')
    fields = {}
    for key, value in given.items():
        if key not in _KEYS[name]:
            raise ParameterError(f'{where}: {name}: {unknown(str(key), _KEYS[name])}')
        field, number = _value(key, value, f'{where}: {name}')
        fields[field] = number
    return FlightCommand(at_step(time), fc.NAMES.index(name), **fields)


def commands(entries: Any, where: str = 'script') -> list[FlightCommand]:
    """
    Return the commands of a list of entries, such as YAML gives it.

    Parameters
    ----------
    entries
        As in the docstring of this module.
    where
        Begins every message.

    Raises
    ------
    ParameterError
        Naming the entry and the key that is wrong, or for entries out of order.

    """
    if not isinstance(entries, list) or len(entries) > MOST:
        raise ParameterError(f'{where}: must be a list of at most {MOST} commands')
    out = [_command(entry, f'{where}: command {number}')
           for number, entry in enumerate(entries, 1)]
    for number, (before, after) in enumerate(zip(out, out[1:]), 2):
        if after.t < before.t:
            raise ParameterError(f'{where}: command {number}: is earlier than the one before it')
    return out


def parse(text: str) -> list[FlightCommand]:
    """Return the commands of a text; errors as of :func:`commands`."""
    if not text.strip():
        return []
    try:
        entries = load(text)
    except yaml.YAMLError as error:
        raise ParameterError(f'script: {reason(error)}') from None
    return commands(entries)


def to_text(given: Iterable[FlightCommand]) -> str:
    """Return commands as the text of a script, whose numbers read back exactly."""
    lines = []
    for c in given:
        name = fc.NAMES[c.kind]
        values = {}
        for key in _KEYS[name]:
            value = getattr(c, _VECTORS.get(key, key))
            if key in _VECTORS:
                value = list(flip_vector(value))
            values[key] = -value if key in _NEGATIVE else value
        lines.append('- ' + json.dumps({'time': c.t * 1e-9, name: values}))
    return '\n'.join(lines) + '\n' if lines else ''


@lru_cache(maxsize=8)
def flown(p: CommandParams, vehicle: Vehicle) -> Timeline:
    """Return the timeline of a script; ParameterError if a command of it is refused."""
    return fold(parse(p.script), p, vehicle)
