"""
Names of logged signals: those of known models, and a mapping file for others.

A known name is one of ``LAYOUTS`` behind the prefix ``rt_``, also a repeated one, or before the
suffix ``_rt``; or behind any other prefix that the file gives to all three accelerations. Other
names need a map, a YAML file with the variable of each signal:

.. code-block:: yaml

    accel_y: rx_a_y              # a variable with one column
    gyro: rt_imu[3:6]            # columns 3, 4 and 5, counted from 0
    sonar: -rt_ScopeData1[1]     # the sign turned
    accel_z: 9.81 * rt_g_z       # in other units
    pressure: none               # left out, whatever is there

What can stand on the left is in ``QUANTITIES``: a vector, or one of its parts.
"""

from __future__ import annotations

import difflib
from pathlib import Path
import re
from typing import NamedTuple

from mambo_bags.mcap_reader import BagError
from mambo_model.yaml_nodes import Reader
from yaml import Node

from .mat_file import Signal

XYZ = ('x', 'y', 'z')
QUANTITIES = {
    'accel': tuple(f'accel_{axis}' for axis in XYZ),
    'gyro': tuple(f'gyro_{axis}' for axis in XYZ),
    'sonar': ('sonar',), 'pressure': ('pressure',),
    'flow': ('flow_x', 'flow_y'), 'flow_flag': ('flow_flag',),
    'motors': ('motor_1', 'motor_2', 'motor_3', 'motor_4'),
    'battery': ('battery_voltage', 'battery_percent'),
    'calibration': ('calib_accel_x', 'calib_accel_y', 'calib_accel_z', 'calib_gyro_x',
                    'calib_gyro_y', 'calib_gyro_z'),
    'position': ('x', 'y', 'z'), 'attitude': ('yaw', 'pitch', 'roll'),
    'velocity': ('u', 'v', 'w'), 'rates': ('p', 'q', 'r'),
    'reference': ('ref_x', 'ref_y', 'ref_z', 'ref_yaw', 'ref_pitch', 'ref_roll')}
"""Signals of a log, SI units, NED and FRD; position to rates are the onboard estimate."""
PARTS = tuple(part for parts in QUANTITIES.values() for part in parts)

_IMU = QUANTITIES['accel'] + QUANTITIES['gyro']
_ESTIMATE = tuple(part for name in ('position', 'attitude', 'velocity', 'rates')
                  for part in QUANTITIES[name])
_TEN = (*_IMU, 'sonar', 'pressure', *QUANTITIES['battery'])
_SCALARS = {
    'a_x': 'accel_x', 'a_y': 'accel_y', 'a_z': 'accel_z', 'p': 'gyro_x', 'q': 'gyro_y',
    'r': 'gyro_z', 'pressure': 'pressure', 'z_ultrasonic': 'sonar', 'u': 'flow_x', 'v': 'flow_y',
    'w': 'flow_flag'}
_OWN = {'phi': 'roll', 'theta': 'pitch', 'psi': 'yaw'} | {name: name for name in 'xyzuvwpqr'}
LAYOUTS: dict[str, tuple[str | None, ...]] = {
    'sensor': _TEN, 'optical': (None, 'flow_x', 'flow_y', None, 'flow_flag'),
    'calib': QUANTITIES['calibration'],
    'estim': _ESTIMATE, 'estimatedStates': _ESTIMATE,
    'motor': QUANTITIES['motors'], 'motors': QUANTITIES['motors'],
    'motor_speeds': QUANTITIES['motors'], 'Actuators': QUANTITIES['motors'],
    'motor_speeds_2': QUANTITIES['motors'],
    'ref': QUANTITIES['reference'], 'References': QUANTITIES['reference'],
    'optical_flow': ('flow_x', 'flow_y', 'flow_flag'),
    **{stem: (part,) for stem, part in _SCALARS.items()},
    **{f'{stem}_{whose}': (part,) for whose in ('drone', 'est') for stem, part in _OWN.items()}}
"""Meaning of the columns of known names; of several synonyms the first counts."""
LEAST = {'sensor': 6, 'optical': 5, 'optical_flow': 2}
"""Columns that a name requires, if not all."""
TOOLBOX_FLOW = ('optical',)
"""Names of a flow in the units of the educational toolbox."""
_SOURCE = re.compile(
    r'(?:(?P<minus>-)|(?P<scale>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\*)?\s*'
    r'(?P<name>[A-Za-z][\w/ ]*?)\s*(?:\[(?P<first>\d+)(?::(?P<last>\d+))?\])?')


class Column(NamedTuple):
    """One column of a signal, times a number."""

    signal: Signal
    index: int
    scale: float = 1.0
    stem: str = ''  # the known name it was found by; empty if a map says it


def near(name: str, names: list[str]) -> str:
    """Return the names most similar to a name, as text."""
    best = difflib.get_close_matches(name, names, 3, 0.5)
    return ', '.join(best) if best else 'none is like it'


def _prefixes(names: list[str]) -> set[str]:
    """Return the prefixes that a file gives to all three accelerations."""
    found = {name[:-len('a_x')] for name in names if name.endswith('_a_x')}
    return {prefix for prefix in found if {f'{prefix}a_y', f'{prefix}a_z'} <= set(names)}


def _stem(name: str, prefixes: set[str]) -> str | None:
    """Return the known name behind the prefix or before the suffix of a variable."""
    variable, _, block = name.partition('/')
    if block in LAYOUTS:
        return block
    bare = re.sub(r'(_rt)+$', '', re.sub(r'^(rt_)+', '', variable))
    stems = {bare} if bare != variable else set()
    stems |= {variable[len(prefix):] for prefix in prefixes if variable.startswith(prefix)}
    return next((stem for stem in sorted(stems) if stem in LAYOUTS), None)


def by_name(path: Path, signals: dict[str, Signal]) -> dict[str, Column]:
    """
    Return {part: column} of the signals whose names are known.

    Raises
    ------
    BagError
        If one has fewer columns than its name needs.

    """
    prefixes, order = _prefixes(list(signals)), list(LAYOUTS)
    stems = {name: stem for name in signals if (stem := _stem(name, prefixes))}
    out: dict[str, Column] = {}
    for name in sorted(stems, key=lambda name: (order.index(stems[name]), len(name), name)):
        stem, values = stems[name], signals[name].values
        layout = LAYOUTS[stem]
        if values.shape[1] < LEAST.get(stem, len(layout)):
            raise BagError(
                f'{path}: {name} has the shape {values.shape}, expected '
                f'({len(values)}, {LEAST.get(stem, len(layout))}) or wider')
        if stem == 'sensor' and values.shape[1] < len(_TEN):
            layout = _IMU
        for index, part in enumerate(layout[:values.shape[1]]):
            if part is not None:
                out.setdefault(part, Column(signals[name], index, 1.0, stem))
    return out


def _source(
    reader: Reader, node: Node, key: str, signals: dict[str, Signal], width: int,
) -> list[Column]:
    """Return the columns that the right side of a line of a map names."""
    text = reader.text(node, key)
    match = _SOURCE.fullmatch(text.strip())
    if match is None:
        reader.fail(node, key, f'{text!r} is not of the form NAME, NAME[COLUMN], NAME[FIRST:END], '
                               '-NAME or NUMBER * NAME')
    name = match['name']
    if name not in signals:
        reader.fail(node, key, f'no logged variable {name}; nearest: {near(name, list(signals))}')
    try:
        scale = -1.0 if match['minus'] else float(match['scale'] or 1.0)
    except ValueError:
        reader.fail(node, key, f'{match["scale"]!r} is not a number')
    has = signals[name].values.shape[1]
    first = int(match['first'] or 0)
    last = int(match['last']) if match['last'] else first + 1 if match['first'] else has
    if last > has or last - first != width:
        reader.fail(node, key, f'needs {width} column{"s" * (width > 1)}, {text} is '
                               f'[{first}:{last}] of {has} in {name}')
    return [Column(signals[name], index, scale) for index in range(first, last)]


def by_map(file: Path, signals: dict[str, Signal]) -> dict[str, Column | None]:
    """
    Return {part: column, or None to leave it out} of a map.

    Raises
    ------
    mambo_model.schema.ParameterError
        For a quantity or a variable that there is not, or one of the wrong shape.

    """
    reader = Reader(file)
    out: dict[str, Column | None] = {}
    for key, (key_node, node) in reader.mapping(reader.root(), 'map').items():
        parts = QUANTITIES.get(key, (key,))
        if key not in QUANTITIES and key not in PARTS:
            known = [*QUANTITIES, *PARTS]
            reader.fail(key_node, key, f'not known; nearest: {near(key, known)}; all: '
                                       f'{", ".join(dict.fromkeys(known))}')
        if set(parts) & set(out):
            reader.fail(key_node, key, 'is given twice')
        if reader.text(node, key).lower() in ('none', 'null', '~'):
            out |= dict.fromkeys(parts)
        else:
            out |= dict(zip(parts, _source(reader, node, key, signals, len(parts)), strict=True))
    return out
