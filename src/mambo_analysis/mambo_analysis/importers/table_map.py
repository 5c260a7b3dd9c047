r"""
Mapping file of a table: the quantity, unit, frame and clock of each column.

.. code-block:: yaml

    time: {column: t, unit: s}       # stamps count from its first row
    world: z_up                      # axes of positions: z_up, z_down (NED) or y_up
    body: flu                        # axes of the body: flu, frd or y_up
    topics:
      optitrack/pose:
        position: {columns: [px, py, pz], unit: mm}
        quaternion: {columns: [qx, qy, qz, qw], order: xyzw}
      imu/data_raw:
        angular_velocity: {columns: [gx, gy, gz], unit: deg/s}
        acceleration: [ax, ay, az]   # in SI units
      battery:
        voltage: [vbat]
        time: {column: t, offset: -0.02}

A quantity is a list of different columns in SI units, or a mapping with ``columns`` and ``unit``.
An attitude is a ``quaternion`` with its ``order``, or ``euler`` angles about the axes of the
moving body in the ``order`` of their columns (``ZYX``: yaw, pitch, roll). The ``velocity`` of
``onboard/odom`` is in the axes of the world, or with ``velocity_axes: body`` in those of the
body. A topic may name a ``time`` and a ``body`` of its own. ``only_changes: true`` publishes a
value only when it is new, for a column that holds the last one: without it, a slower sensor in a
faster table has the rate of the table. ``valid: [xy_ok, z_ok]`` names columns that are 0 in rows
which the logger marks as unusable: these are left out.

Cells of a CSV file are separated by commas, or by the character of ``delimiter: ';'`` (one ASCII
character, ``'\t'`` for a tab) beside ``time`` and ``topics``. Numbers have decimal points.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mambo_bags.command import nearest
from mambo_model.yaml_nodes import Reader, WORDS
from yaml import Node, SequenceNode

UNITS = {
    'time': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9},
    'length': {'m': 1.0, 'cm': 0.01, 'mm': 0.001},
    'speed': {'m/s': 1.0, 'cm/s': 0.01, 'mm/s': 0.001},
    'rate': {'rad/s': 1.0, 'deg/s': 0.017453292519943295, 'mrad/s': 0.001},
    'angle': {'rad': 1.0, 'deg': 0.017453292519943295},
    'acceleration': {'m/s^2': 1.0, 'g': 9.80665, 'mg': 0.00980665},
    'pressure': {'Pa': 1.0, 'hPa': 100.0, 'mbar': 100.0, 'kPa': 1000.0},
    'voltage': {'V': 1.0, 'mV': 0.001},
    'number': {'1': 1.0, '%': 0.01}}
"""Units by dimension, with the factor to the first unit."""
WORLDS, BODIES = ('z_up', 'z_down', 'y_up'), ('flu', 'frd', 'y_up')
ORDERS = {'quaternion': ('xyzw', 'wxyz'), 'euler': ('ZYX', 'XYZ', 'ZXY', 'YXZ', 'XZY', 'YZX')}
_POSE = {'position': (3, 'length'), 'quaternion': (4, 'number'), 'euler': (3, 'angle')}
QUANTITIES = {
    'optitrack/pose': _POSE,
    'onboard/odom': {**_POSE, 'velocity': (3, 'speed'), 'angular_velocity': (3, 'rate')},
    'onboard/reference': {**_POSE, 'yaw': (1, 'angle')},
    'imu/data_raw': {'angular_velocity': (3, 'rate'), 'acceleration': (3, 'acceleration')},
    'sonar/range': {'range': (1, 'length')},
    'optical_flow': {'rate': (2, 'rate')},
    'barometer/pressure': {'pressure': (1, 'pressure')},
    'motor_pwm': {'pwm': (4, 'number')},
    'battery': {'voltage': (1, 'voltage')}}
"""{topic: {quantity: (columns, dimension)}}."""
NEEDED = {
    'optitrack/pose': ('position', 'attitude'),
    'onboard/odom': ('position', 'attitude', 'velocity'), 'onboard/reference': ('position',)}
"""Required quantities; other topics require all of theirs, except those of the IMU."""
_OPTIONS = ('time', 'body', 'only_changes', 'valid', 'velocity_axes')


class Quantity(NamedTuple):
    """Columns of a table, with the conversion to SI units."""

    columns: tuple[str, ...]
    factor: float = 1.0
    order: str = ''


class Clock(NamedTuple):
    """A column of times; ``factor`` turns it into seconds, to which ``offset`` s are added."""

    column: str
    factor: float
    offset: float = 0.0


class Topic(NamedTuple):
    """Mapping of columns to one topic."""

    quantities: dict[str, Quantity]
    clock: Clock
    body: str
    only_changes: bool = False
    velocity_axes: str = 'world'
    valid: tuple[str, ...] = ()

    def columns(self) -> list[str]:
        """Return the names of its columns but that of the clock."""
        return [*(name for one in self.quantities.values() for name in one.columns), *self.valid]


class Map(NamedTuple):
    """A mapping file as it was read."""

    clock: Clock
    world: str
    delimiter: str
    topics: dict[str, Topic]

    def clocks(self) -> dict[str, list[str]]:
        """Return the columns that are wanted at the times of each clock, each once."""
        out: dict[str, list[str]] = {self.clock.column: []}
        for topic in self.topics.values():
            out.setdefault(topic.clock.column, []).extend(topic.columns())
        return {clock: list(dict.fromkeys(names)) for clock, names in out.items()}

    def columns(self) -> list[str]:
        """Return the names of all columns that it needs, each once."""
        names = [self.clock.column]
        for topic in self.topics.values():
            names += [topic.clock.column, *topic.columns()]
        return list(dict.fromkeys(names))


def read_map(path: Path) -> Map:
    """
    Read a mapping file.

    Raises
    ------
    mambo_model.schema.ParameterError
        Naming file, line and key, for an unknown key, unit or order, or a missing quantity.

    """
    reader = Reader(path)
    root = reader.root()
    entries = reader.mapping(root, 'mapping')
    _known(reader, entries, ('time', 'world', 'body', 'delimiter', 'topics'))
    for key in ('time', 'topics'):
        if key not in entries:
            reader.fail(root, key, 'is missing')
    clock = _clock(reader, entries['time'][1], None)
    world = _choice(reader, entries, 'world', WORLDS)
    body = _choice(reader, entries, 'body', BODIES)
    delimiter = ','
    if 'delimiter' in entries:
        node = entries['delimiter'][1]
        delimiter = str(node.value).replace('\\t', '\t')  # a tab counts as text
        if len(delimiter) != 1 or not delimiter.isascii() or delimiter in '"\r\n\0':
            reader.fail(node, 'delimiter', 'must be one ASCII character, no quotation mark and no '
                        'end of a line, or \\t for a tab')
    topics = {}
    found = reader.mapping(entries['topics'][1], 'topics')
    if not found:
        reader.fail(entries['topics'][0], 'topics', 'holds none')
    for name, (node, value) in found.items():
        if name not in QUANTITIES:
            reader.fail(node, name, f'no topic of an import{nearest(name, QUANTITIES)}; known: '
                                    f'{", ".join(QUANTITIES)}')
        topics[name] = _topic(reader, name, node, value, clock, body)
    return Map(clock, world, delimiter, topics)


def _known(reader: Reader, entries: dict[str, tuple[Node, Node]], known: tuple[str, ...]) -> None:
    for key, (node, _) in entries.items():
        if key not in known:
            reader.fail(node, key, f'unknown{nearest(key, known)}; known: {", ".join(known)}')


def _choice(
    reader: Reader, entries: dict[str, tuple[Node, Node]], key: str, known: tuple[str, ...],
    default: str | None = None,
) -> str:
    """Return one of some words; without a value the default or the first word."""
    if key not in entries:
        return known[0] if default is None else default
    word = reader.text(entries[key][1], key)
    if word not in known:
        reader.fail(entries[key][1], key, f'{word!r} is not one of {", ".join(known)}')
    return word


def _unit(
    reader: Reader, entries: dict[str, tuple[Node, Node]], dimension: str,
) -> float:
    return UNITS[dimension][_choice(reader, entries, 'unit', tuple(UNITS[dimension]))]


def _clock(reader: Reader, node: Node, default: Clock | None) -> Clock:
    """Return a time mapping; that of a topic inherits missing keys from the default."""
    entries = reader.mapping(node, 'time')
    _known(reader, entries, ('column', 'unit', 'offset'))
    if 'column' not in entries and default is None:
        reader.fail(node, 'time', 'needs a column')
    column = default.column if default else ''
    if 'column' in entries:
        column = reader.text(entries['column'][1], 'column')
    factor = _unit(reader, entries, 'time') if 'unit' in entries or default is None \
        else default.factor
    offset = reader.number(entries['offset'][1], 'offset') if 'offset' in entries else 0.0
    if not abs(offset) < 1e9:
        reader.fail(entries['offset'][1], 'offset', f'{offset:g} s is absurd')
    return Clock(column, factor, offset)


def _topic(
    reader: Reader, name: str, key: Node, node: Node, clock: Clock, body: str,
) -> Topic:
    known = QUANTITIES[name]
    entries = reader.mapping(node, name)
    options = _OPTIONS if 'velocity' in known else _OPTIONS[:-1]
    _known(reader, entries, (*known, *options))
    found = {quantity: _quantity(reader, quantity, entries[quantity][1], *known[quantity])
             for quantity in known if quantity in entries}
    if {'quaternion', 'euler'} <= set(found):
        reader.fail(entries['euler'][0], 'euler', 'the attitude is given as a quaternion, too')
    has = {'attitude' if one in ORDERS else one for one in found}
    needed = NEEDED.get(name, () if name == 'imu/data_raw' else tuple(known))
    missing = [one for one in needed if one not in has]
    if missing or not found:
        reader.fail(key, name, f'needs {", ".join(missing or known)}'.replace(
            'attitude', 'attitude (quaternion or euler)'))
    own = _clock(reader, entries['time'][1], clock) if 'time' in entries else clock
    turned = _choice(reader, entries, 'body', BODIES, body)
    if name == 'optical_flow' and turned == 'y_up':
        reader.fail(key, name, 'is along x and y of a body with z up or down: give it '
                               'body: flu or frd of its own')
    changes = False
    if 'only_changes' in entries:
        word = reader.text(entries['only_changes'][1], 'only_changes').lower()
        if word not in WORDS:
            reader.fail(entries['only_changes'][1], 'only_changes', 'must be true or false')
        changes = WORDS[word]
    valid = _names(reader, 'valid', entries['valid'][1]) if 'valid' in entries else ()
    return Topic(found, own, turned, changes,
                 _choice(reader, entries, 'velocity_axes', ('world', 'body')), valid)


def _quantity(reader: Reader, name: str, node: Node, count: int, dimension: str) -> Quantity:
    """Return a list of columns, or a mapping of columns, unit and order."""
    columns, factor, order = node, 1.0, ''
    if not isinstance(node, SequenceNode):
        entries = reader.mapping(node, name)
        _known(reader, entries, ('columns', 'unit', *(('order',) if name in ORDERS else ())))
        if 'columns' not in entries:
            reader.fail(node, name, 'needs columns')
        columns, factor = entries['columns'][1], _unit(reader, entries, dimension)
        if 'order' in entries:
            order = _choice(reader, entries, 'order', ORDERS[name])
    if name in ORDERS and not order:
        reader.fail(node, name, f'needs an order: {", ".join(ORDERS[name])}')
    return Quantity(_names(reader, name, columns, count), factor, order)


def _names(reader: Reader, name: str, columns: Node, count: int | None = None) -> tuple[str, ...]:
    """Return the names of so many different columns; of one or more, if no count is given."""
    if not isinstance(columns, SequenceNode) or not columns.value or (
            count not in (None, len(columns.value))):
        many = 'columns' if count is None else f'{count} column{"s" * (count > 1)}'
        reader.fail(columns, name, f'must name {many}: [...]')
    names = [reader.text(element, name) for element in columns.value]
    again = next((one for one in names if names.count(one) > 1), None)
    if again is not None:
        reader.fail(columns, name, f'names column {again} twice')
    return tuple(names)
