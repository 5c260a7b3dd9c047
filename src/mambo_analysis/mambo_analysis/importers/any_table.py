"""
Import of tables, PX4 logs and MATLAB files: ``import_table FLIGHT.csv BAG --map MAPPING.yaml``.

The mapping assigns columns to topics, with unit, frame and clock
(:mod:`mambo_analysis.importers.table_map`). Mappings that come with the package are chosen by
name: ``nanobench`` for the data set of that name (a Crazyflie 2.1 under Vicon, 100 Hz), ``px4``
for a log of PX4.

Stamps count from the first row. A row without all values of a topic gives no message on it, and is
counted; likewise a row that repeats the time of the one before or is out of order
(:mod:`.logs.stray_times`), one that the logger marks as not valid, and one with a quaternion of
zeros, which loggers write while there is no attitude. Impossible poses are left out
(:mod:`mambo_signals.poses.outliers`), and ends that were extrapolated
(:mod:`.checks.extrapolated`). Topics that contradict each other are told
(:mod:`.checks.bag_doubts`), unused columns are printed.
"""

from __future__ import annotations

import argparse
from functools import cached_property
from pathlib import Path
from typing import Any

from mambo_bags.command import guard, nearest, Parser
from mambo_bags.mcap_reader import BagError
from mambo_bags.writer import BagWriter
from mambo_signals.poses import frozen, outliers
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .checks import assignments, bag_doubts, extrapolated, plausible
from .common import (
    importer_parser, LONGEST, NAMESPACE, new_samples, ONLY_CHANGES, provenance, Publisher,
    read_source, report, stamps_ns, unused)
from .logs import stray_times, ulog
from .logs.named_columns import read_columns
from .table_file import row_name
from .table_map import Map, Quantity, read_map, Topic

Floats = NDArray[np.float64]
Strays = dict[str, NDArray[np.bool_]]  # {column of times: rows that are out of order}
MAPS = Path(__file__).parent / 'maps'
_UPRIGHT = Rotation.from_euler('x', 90.0, degrees=True)
_OVER = Rotation.from_euler('x', 180.0, degrees=True)
WORLD = {'z_up': Rotation.identity(), 'z_down': _OVER, 'y_up': _UPRIGHT}
"""Turns positions of a table into z up; y up as Motive's: (x, -z, y)."""
BODY = {'flu': Rotation.identity(), 'frd': _OVER, 'y_up': _UPRIGHT}
"""Turns vectors of the body into FLU."""
TYPES = {
    'optitrack/pose': 'geometry_msgs/msg/PoseStamped', 'onboard/odom': 'nav_msgs/msg/Odometry',
    'onboard/reference': 'geometry_msgs/msg/PoseStamped', 'imu/data_raw': 'sensor_msgs/msg/Imu',
    'sonar/range': 'sensor_msgs/msg/Range',
    'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
    'barometer/pressure': 'sensor_msgs/msg/FluidPressure',
    'motor_pwm': 'mambo_interfaces/msg/MotorPwm', 'battery': 'sensor_msgs/msg/BatteryState'}
MOTIONS = ('optitrack/pose', 'onboard/odom', 'imu/data_raw')
"""Topics whose pace tells whether the unit of time is right."""
LOOSE_NORM = 0.1       # [-] how far from 1 the norm of a quaternion may be
RANGE_LIMITS = (0.0, 10.0)  # [m] of a range finder that is not known
FULL_QUALITY = 255
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def shipped() -> dict[str, Path]:
    """Return the mappings that come with the package, by name."""
    return {file.stem: file for file in sorted(MAPS.glob('*.yaml'))}


def find_map(word: str) -> Path:
    """Return the file of a mapping by name or path; BagError if it is neither."""
    if word in shipped():
        return shipped()[word]
    if not Path(word).is_file():
        raise BagError(f'{word}: no mapping file, nor the name of one{nearest(word, shipped())}; '
                       f'names: {", ".join(shipped())}')
    return Path(word)


def _stray(path: Path, table: dict[str, Floats], mapping: Map) -> tuple[Strays, list[str]]:
    """Return the rows of each clock that are out of order, (n,), and lines; BagError: no clock."""
    out, notes = {}, []
    used = {topic.clock.column for topic in mapping.topics.values()}

    def place(row: int) -> str:
        """Return where a row is in the file."""
        return row_name(path, row, mapping.delimiter)
    for column in mapping.clocks():
        values = table[column]
        if not len(values):
            raise BagError(f'{path}: no rows')
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise BagError(f'{path}: {place(row)}: no time in column {column}: write it there, or '
                           'remove the row')
        if column not in used:  # it gives the first time alone
            out[column] = np.zeros(len(values), bool)
            continue
        out[column], lines = stray_times.stray_rows(path, column, values, place)
        notes += lines
        kept = np.flatnonzero(~out[column])
        again = kept[1:][np.diff(values[kept]) == 0.0]
        if stray_times.too_many(len(again), len(kept)):
            raise BagError(
                f'{path}: {place(int(again[0]))}: the time in column {column} does not increase '
                f'({values[again[0]]:.15g}), and {len(again)} of {len(values)} rows repeat the '
                'one before: write times with more digits, or give each topic the column of its '
                'own times')
    return out, notes


def _seconds(
    path: Path, table: dict[str, Floats], mapping: Map, stray: Strays,
) -> dict[str, Floats]:
    """Return the times of each topic, (n,) s from the first row; those out of order are 0."""
    def start(column: str) -> float:
        """Return the first time of a clock."""
        return float(table[column][~stray[column]][0])
    first, out = start(mapping.clock.column), {}
    for name, topic in mapping.topics.items():
        clock = topic.clock
        # the difference first, in the unit of the file: it is exact for counts of ns
        begin = first if clock.factor == mapping.clock.factor else (
            first * mapping.clock.factor / clock.factor)
        times = np.where(stray[clock.column], begin, table[clock.column])
        out[name] = (times - begin) * clock.factor + clock.offset
        if not np.abs(out[name]).max() < LONGEST:
            raise BagError(f'{path}: column {clock.column} spans more than {LONGEST:g} s: its '
                           'unit is not as the mapping says')
    return out


def _vectors(table: dict[str, Floats], quantity: Quantity) -> Floats:
    return quantity.factor * np.column_stack([table[name] for name in quantity.columns])


def _attitude(
    path: Path, table: dict[str, Floats], mapping: Map, topic: Topic, usable: NDArray[np.bool_],
) -> Floats:
    """Return x y z w of FLU in a world with z up, (n, 4), upright where not usable."""
    world = WORLD[mapping.world]
    out = np.tile(UPRIGHT, (len(usable), 1))
    if 'quaternion' in topic.quantities:
        quantity = topic.quantities['quaternion']
        given = _vectors(table, quantity)[usable]
        given = given if quantity.order == 'xyzw' else given[:, [1, 2, 3, 0]]
        wrong = np.flatnonzero(np.abs(np.linalg.norm(given, axis=1) - 1.0) > LOOSE_NORM)
        if len(wrong):
            where = row_name(path, int(np.flatnonzero(usable)[wrong[0]]), mapping.delimiter)
            raise BagError(f'{path}: {where}: the quaternion in {", ".join(quantity.columns)} has '
                           f'the norm {np.linalg.norm(given[wrong[0]]):.3g}, not 1')
        turns = Rotation.from_quat(given)
    else:
        quantity = topic.quantities['euler']
        angles = _vectors(table, quantity)[usable]
        steep = plausible.beyond_quarter(angles[:, 1])
        if steep is not None:
            where = row_name(path, int(np.flatnonzero(usable)[steep]), mapping.delimiter)
            raise BagError(
                f'{path}: {where}: the middle one of the Euler angles, column '
                f'{quantity.columns[1]}, is {angles[steep, 1]:.4g} rad, beyond a quarter turn: '
                'their unit or order is not as the mapping says')
        turns = Rotation.from_euler(quantity.order, angles)
    out[usable] = (world * turns * BODY[topic.body].inv()).as_quat()
    return out


class _Rows:
    """Publishes the rows of one topic."""

    def __init__(self, path: Path, table: dict[str, Floats], mapping: Map) -> None:
        self.path, self.table, self.mapping = path, table, mapping
        self.stray, self.notes = _stray(path, table, mapping)
        self.times = _seconds(path, table, mapping, self.stray)

    def publish(self, name: str, out: Publisher) -> None:
        """Write the messages of a topic from the rows."""
        topic = self.mapping.topics[name]
        found = self._found(name)
        values = np.concatenate(list(found.values()), axis=1)
        usable = np.isfinite(values).all(axis=1)
        if not usable.all():
            columns = [column for one in topic.quantities.values() for column in one.columns]
            self._lacking(name, topic, columns, ~np.isfinite(values))
        stray = self.stray[topic.clock.column]
        again = ~(stray | self._rising(name))
        usable &= ~stray
        none = usable & (np.linalg.norm(found['quaternion'], axis=1) == 0.0) if (
            'quaternion' in found) else np.zeros(len(usable), bool)
        marked = {name: np.nan_to_num(self.table[name]) == 0.0 for name in topic.valid}
        by = ', '.join(name for name, rows in marked.items() if rows.any())
        invalid = np.any([np.zeros(len(usable), bool), *marked.values()], axis=0)
        for wrong, what in ((again, f'repeat the time before in {topic.clock.column}'),
                            (invalid, f'are marked as not valid by {by}'),
                            (none, 'have a quaternion of zeros, no attitude')):
            if wrong.any():
                self.notes.append(
                    f'{name}: {int(wrong.sum())} of {len(usable)} rows {what}: left out')
                usable &= ~wrong
        if name in MOTIONS:
            plausible.refuse_pace(f'{self.path}: column {topic.clock.column} of {name}',
                                  self.times[name][usable])
        if topic.only_changes:
            new = np.zeros(len(usable), bool)
            ordered = np.flatnonzero(~stray)
            new[ordered[new_samples(values[ordered])]] = True
            new[ordered[:1]] = True
            usable &= new
        before = usable & (self.times[name] < 0.0)
        if before.any():
            self.notes.append(f'{name}: {int(before.sum())} rows before the first time left out')
            usable &= ~before
        if name in (*extrapolated.NOISY, *extrapolated.WITH_THEM) and self._continued < np.inf:
            self._extrapolated(name, values, usable)
        fields = _FIELDS[name](self, topic, found, usable, out)
        frame = {'optitrack/pose': 'map', 'onboard/odom': 'odom', 'onboard/reference': 'odom',
                 'motor_pwm': ''}.get(name, 'base_link')
        stamps = stamps_ns(self.times[name]).tolist()
        for row in np.flatnonzero(usable).tolist():
            out.publish(name, stamps[row], frame, **fields(row))

    def _rising(self, name: str) -> NDArray[np.bool_]:
        """Return the rows of a topic, (n,), whose time is in order and after that before it."""
        out = ~self.stray[self.mapping.topics[name].clock.column]
        out[out] = np.diff(self.times[name][out], prepend=-np.inf) > 0.0
        return out

    def _found(self, name: str) -> dict[str, Floats]:
        """Return the quantities of a topic, (n, k) each, in SI units."""
        return {key: _vectors(self.table, one)
                for key, one in self.mapping.topics[name].quantities.items()}

    @cached_property
    def _continued(self) -> float:
        """Return when the last value of a topic with noise was measured that ends in a line, s."""
        ends = [np.inf]
        for name in extrapolated.NOISY:
            if name in self.mapping.topics:
                t = self.times[name]
                values = np.concatenate(list(self._found(name).values()), axis=1)
                good = np.isfinite(values).all(axis=1) & self._rising(name)
                last = extrapolated.begin(t[good], values[good])
                ends.append(np.inf if last is None else float(t[good][last]))
        return min(ends)

    def _extrapolated(self, name: str, values: Floats, usable: NDArray[np.bool_]) -> None:
        """Leave out the end of a topic, (n, k), that was not measured, and note it."""
        rows, t = np.flatnonzero(usable), self.times[name]
        last = extrapolated.begin(t[rows], values[rows])
        if last is None:
            last = extrapolated.begin_since(t[rows], values[rows], self._continued)
        if last is None:
            return
        end = rows[last + 1:]
        usable[end] = False
        self.notes.append(f'{name}: {len(end)} rows left out, from {t[end[0]]:.2f} s to the end: '
                          'they continue those before in a straight line, and were not measured')

    def _lacking(
        self, name: str, topic: Topic, columns: list[str], lacking: NDArray[np.bool_],
    ) -> None:
        """Note the rows of a topic without a value, by the columns (k,) that lack (n, k) most."""
        lost, counts, clock = int(lacking.any(axis=1).sum()), lacking.sum(axis=0), topic.clock
        most = columns[int(np.argmax(counts))]
        text = f'{name}: {lost} of {len(lacking)} rows lack a value in {most}'
        if self.path.suffix.lower() == '.ulg' and (
                ulog.split(most)[:2] != ulog.split(clock.column)[:2]):
            text = (f'{name}: {lost} of {len(lacking)} rows have no sample of {most} near their '
                    f'time in {clock.column}: is it the clock of this topic?')
        self.notes.append(text)

    def _pose(self, topic: Topic, found: dict[str, Floats], usable: Any) -> tuple[Any, Any]:
        world = WORLD[self.mapping.world]
        position = world.apply(np.where(usable[:, None], found['position'], 0.0))
        return position, _attitude(self.path, self.table, self.mapping, topic, usable)

    def _optitrack_pose(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        position, turn = self._pose(topic, found, usable)
        rows = np.flatnonzero(usable)
        times = self.times['optitrack/pose'][rows]
        still, wrong, turned = plausible.doubtful_poses(
            f'{self.path}: optitrack/pose', 'optitrack/pose', times, position[rows], turn[rows],
            self._turnings())
        for doubtful, about in ((still, frozen), (wrong, outliers)):
            if doubtful.any():
                usable[rows[doubtful]] = False
                self.notes.append(about.describe('optitrack/pose', int(doubtful.sum())))
        self.notes += turned
        return lambda row: {'pose': out.pose(position[row].tolist(), turn[row].tolist())}

    def _turnings(self) -> list[assignments.Turning]:
        """Return how the body turns by the gyro and by the onboard attitude, if they are there."""
        out = []
        for name in ('imu/data_raw', 'onboard/odom'):
            topic = self.mapping.topics.get(name)
            if topic is None:
                continue
            found = self._found(name)
            if {'angular_velocity', 'quaternion', 'euler'}.isdisjoint(found):
                continue
            good = np.isfinite(np.concatenate(list(found.values()), axis=1)).all(axis=1)
            good &= self._rising(name)
            if 'quaternion' in found:
                good &= np.linalg.norm(found['quaternion'], axis=1) > 0.0
            times = self.times[name][good]
            out.append(assignments.Turning('the gyro', times, BODY[topic.body].apply(
                found['angular_velocity'][good])) if name == 'imu/data_raw' else (
                    assignments.of_attitude(f'the attitude of {name}', times, _attitude(
                        self.path, self.table, self.mapping, topic, good)[good])))
        return out

    def _onboard_odom(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        position, turn = self._pose(topic, found, usable)
        velocity = np.where(usable[:, None], found['velocity'], 0.0)
        if topic.velocity_axes == 'world':
            velocity = Rotation.from_quat(turn).inv().apply(
                WORLD[self.mapping.world].apply(velocity))
        else:
            velocity = BODY[topic.body].apply(velocity)
        rates = np.full(position.shape, np.nan)
        if 'angular_velocity' in found:
            rates = BODY[topic.body].apply(found['angular_velocity'])
        return lambda row: out.odometry(
            out.pose(position[row].tolist(), turn[row].tolist()), velocity[row].tolist(),
            rates[row].tolist())

    def _onboard_reference(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        world = WORLD[self.mapping.world]
        position = world.apply(np.where(usable[:, None], found['position'], 0.0))
        if {'quaternion', 'euler'} & set(found):
            turn = _attitude(self.path, self.table, self.mapping, topic, usable)
        elif 'yaw' in found:  # about the axis that points down or up in the file
            sign = -1.0 if self.mapping.world == 'z_down' else 1.0
            yaw = np.where(usable, sign * found['yaw'][:, 0], 0.0)
            turn = Rotation.from_euler('z', yaw[:, None]).as_quat()
        else:
            turn = np.tile(UPRIGHT, (len(usable), 1))
        return lambda row: {'pose': out.pose(position[row].tolist(), turn[row].tolist())}

    def _imu_data_raw(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        unknown = np.full((len(usable), 3), np.nan)
        body = BODY[topic.body]
        rates, force = (body.apply(found[key]) if key in found else unknown
                        for key in ('angular_velocity', 'acceleration'))
        where, remedy = f'{self.path}: imu/data_raw', 'give its unit in the mapping'
        if 'angular_velocity' in found:
            plausible.refuse_degrees(
                where, self.times['imu/data_raw'][usable], rates[usable], remedy)
        if 'acceleration' in found:
            plausible.refuse_g(where, force[usable, 2], remedy)
        return lambda row: out.imu(rates[row].tolist(), force[row].tolist())

    def _sonar_range(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        plausible.refuse_ranges(f'{self.path}: sonar/range', found['range'][usable, 0])
        return lambda row: {'radiation_type': 1, 'min_range': RANGE_LIMITS[0],
                            'max_range': RANGE_LIMITS[1], 'range': float(found['range'][row, 0])}

    def _optical_flow(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        # along x and y of the body; the rotations to FLU keep x and may turn y over
        sign = -1.0 if topic.body == 'frd' else 1.0
        return lambda row: {'rate_x': float(found['rate'][row, 0]),
                            'rate_y': sign * float(found['rate'][row, 1]),
                            'quality': FULL_QUALITY}

    def _barometer_pressure(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        plausible.refuse_pressure(f'{self.path}: barometer/pressure',
                                  found['pressure'][usable, 0])
        return lambda row: {'fluid_pressure': float(found['pressure'][row, 0])}

    def _motor_pwm(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        rows = np.flatnonzero(usable)
        wrong = plausible.refuse_commands(f'{self.path}: motor_pwm', found['pwm'][rows])
        if wrong.any():
            usable[rows[wrong]] = False
            self.notes.append(
                f'motor_pwm: {int(wrong.sum())} of {len(usable)} rows have a command outside of 0 '
                f'to {plausible.LARGEST_PWM:g}: left out')
        return lambda row: {'pwm': found['pwm'][row]}

    def _battery(self, topic: Topic, found: Any, usable: Any, out: Publisher) -> Any:
        plausible.refuse_voltage(f'{self.path}: battery', found['voltage'][usable, 0])
        return lambda row: out.battery(float(found['voltage'][row, 0]), float('nan'))


_FIELDS = {
    'optitrack/pose': _Rows._optitrack_pose, 'onboard/odom': _Rows._onboard_odom,
    'onboard/reference': _Rows._onboard_reference, 'imu/data_raw': _Rows._imu_data_raw,
    'sonar/range': _Rows._sonar_range, 'optical_flow': _Rows._optical_flow,
    'barometer/pressure': _Rows._barometer_pressure, 'motor_pwm': _Rows._motor_pwm,
    'battery': _Rows._battery}
"""Functions that make the message fields of a row, by topic."""


def import_table(
    source: Path, target: Path, mapping: Path,
) -> tuple[dict[str, int], list[str]]:
    """
    Write a bag from a table.

    Parameters
    ----------
    source
        CSV, Parquet, ``.ulg`` or ``.mat`` file.
    target
        Directory to make.
    mapping
        Mapping file, as :func:`find_map` finds it.

    Returns
    -------
    {topic: messages}; lines on what was left out, and on topics that contradict each other.

    Raises
    ------
    BagError
        If the table is not usable; nothing is written then.
    mambo_model.schema.ParameterError
        If the mapping is wrong.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    wanted = read_map(mapping)
    file = read_source(source)
    table, others, damage = read_columns(file, wanted)
    rows = _Rows(source, table, wanted)
    changes = ', '.join(name for name, topic in wanted.topics.items() if topic.only_changes)
    clock = wanted.clock.column
    record = provenance(source.name, file.sha256, 'import_table', 'table', {
        **({ONLY_CHANGES: changes} if changes else {}),
        'mapping': mapping.name, 'mapping_sha256': read_source(mapping).sha256,
        'time_zero': repr(float(table[clock][~rows.stray[clock]][0])),
        'ignored': ', '.join(others) or 'nothing'})
    with BagWriter(target, metadata=record) as writer:
        out = Publisher(writer, {name: TYPES[name] for name in wanted.topics})
        for name in wanted.topics:
            rows.publish(name, out)
        if not any(writer.counts.values()):
            raise BagError(f'{source}: no row has a value of any topic of the mapping')
        for name in wanted.topics:
            if not writer.counts[f'{NAMESPACE}/{name}']:
                reasons = [note.removeprefix(f'{name}: ') for note in rows.notes
                           if note.startswith(f'{name}: ')]
                why = f' ({"; ".join(reasons)})' if reasons else ''
                raise BagError(f'{source}: no row makes a message of {name}{why}: mend its '
                               'columns, or take it out of the mapping')
    told = bag_doubts.imported(target)
    return writer.counts, [*damage, *rows.notes, *told, *unused(others)]


def parser() -> Parser:
    """Return the command line."""
    out = importer_parser('import_table', __doc__, 'table', 'CSV, Parquet, .ulg or .mat file')
    option = out.add_argument('--map', required=True, metavar='MAPPING',
                              help='YAML file, or one of: ' + ', '.join(shipped()))
    Parser.complete(shipped(), option)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``import_table``; return the exit code."""
    options: argparse.Namespace = parser().parse_args(arguments)

    def work() -> None:
        """Import, and print a summary."""
        counts, notes = import_table(options.table, options.output, find_map(options.map))
        report(options.table, options.output, counts, *notes)

    return guard('import_table', work)


if __name__ == '__main__':
    raise SystemExit(main())
