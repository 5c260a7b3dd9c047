"""
Evaluate the public recordings again: ``validate_recordings DATA``.

The command prints the tables of docs/evidence/real_recordings.md: motor bench and flights of the
Rolling Spider, flights and pendulum of the Crazyflie, and poses of a motion capture system.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import math
from pathlib import Path
import tempfile
from typing import NamedTuple

from mambo_analysis.capture import captured
from mambo_analysis.identify import columns, inertia, thrust
from mambo_analysis.identify.regression import Value
from mambo_bags.command import guard, Parser, write_json
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import read_bag
from mambo_sim.sensors.optitrack import OptitrackParams
import numpy as np

from . import validate_flights as flights

PACKAGE_GAIN = 1530.72681  # PWM/N, Parrot's toolbox
FLOW_SCALES = (20.0, 16.4)  # rad/s per unit: in the onboard code; from markers on the floor
IDENTIFIED_ON = 'lab02_square'
Cell = str | float


class Table(NamedTuple):
    """A table; each column has a number format, and text cells are printed as they are."""

    title: str
    columns: tuple[str, ...]
    formats: tuple[str, ...]
    rows: list[tuple[Cell, ...]]

    def cells(self) -> list[list[str]]:
        """Return the header and the rows as text."""
        return [list(self.columns)] + [
            [x if isinstance(x, str) else format(x, f)
             for x, f in zip(row, self.formats, strict=True)] for row in self.rows]

    def text(self) -> str:
        """Return the table as aligned text for a terminal."""
        cells = self.cells()
        widths = [max(map(len, column)) for column in zip(*cells)]
        return '\n'.join([self.title, *(
            '  ' + '  '.join(
                f'{x:<{w}}' if k == 0 else f'{x:>{w}}'
                for k, (x, w) in enumerate(zip(row, widths))).rstrip() for row in cells)])

    def markdown(self) -> str:
        """Return the table as Markdown."""
        head, *rows = self.cells()
        lines = [head, ['---'] + ['---:'] * (len(head) - 1), *rows]
        return '\n'.join(
            [f'### {self.title}', '', *(f'| {" | ".join(line)} |' for line in lines)])


def find(folder: Path, pattern: str) -> list[Path]:
    """Return the files that match a pattern, sorted; raise BagError if there are none."""
    found = sorted(folder.glob(pattern))
    if not found:
        raise BagError(f'{folder}: no file {pattern} there; give the folder with the recordings '
                       'that docs/evidence/real_recordings.md lists')
    return found


def _interval(v: Value, digits: int) -> str:
    return f'{v.low:.{digits}f} to {v.high:.{digits}f}'


def bench(data: Path, _: Path) -> list[Table]:
    """Return both motor maps of the Rolling Spider beside those of the toolbox and the thesis."""
    path = find(data / 'rolling_spider_bench', 'thrustdata.mat')[0]
    table = columns.read(path)
    pwm, force = (columns.column(table, f'thrust_recdata.data[{k}]', path)[1] for k in (0, 3))
    found = thrust.fit_thrust(pwm, force)
    a, b = thrust.THESIS
    share = [found.a.value * x ** found.b.value / (a * x ** b) for x in (100.0, 250.0, 400.0)]
    hover = [found.a.value * 250.0 ** found.b.value, a * 250.0 ** b]
    return [Table('Rolling Spider bench: motor map', ('', 'measured', '95 %', 'reference'),
                  ('', '.5g', '', '.5g'), [
        ('gain of the line [PWM/N], toolbox', found.gain.value, _interval(found.gain, 1),
         PACKAGE_GAIN),
        ('a of the power law [1e-4 N], thesis (Mambo)', 1e4 * found.a.value,
         _interval(Value(*(1e4 * x for x in found.a[:3]), ''), 2), 1e4 * a),
        ('b of the power law, thesis (Mambo)', found.b.value, _interval(found.b, 3), b),
        ('thrust at 250 [N]', hover[0], '', hover[1]),
        ('thrust over that of the thesis at 100', share[0], '', 1.0),
        ('the same at 250', share[1], '', 1.0), ('the same at 400', share[2], '', 1.0)])]


def pendulum(data: Path, _: Path) -> list[Table]:
    """Return frequency and damping of the pendulum swings about three axes."""
    rows: list[tuple[Cell, ...]] = []
    for axis in 'xyz':
        path = find(data / 'crazyflie_optitrack', f'*lab03_{axis}_data*.json')[0]
        own, rate = columns.column(columns.read(path), f'gyro.{axis}', path)
        one = inertia.fit_swing(own, np.radians(rate))
        rows.append((axis, one.frequency.value, _interval(one.frequency, 3),
                     one.quadratic.value, _interval(one.quadratic, 3), one.linear.value,
                     _interval(one.linear, 3), one.amplitude,
                     100.0 * one.fit.rms / float(np.std(np.radians(rate)))))
    return [Table(
        'Crazyflie pendulum: fit of (4.2)',
        ('axis', 'omega_0 [rad/s]', '95 %', 'K_D/J [1/rad]', '95 %', 'C/J [1/s]', '95 %',
         'largest [rad]', 'left over [%]'),
        ('', '.3f', '', '.3f', '', '.3f', '', '.2f', '.1f'), rows)]


def hall(data: Path, _: Path) -> list[Table]:
    """Return rate and gaps of a recorded motion capture beside those of the simulated one."""
    path = find(data / 'mcap_bags', 'cub_stabilize*.mcap')[0]
    t = read_bag(path, ('cub1/pose',))['/cub1/pose'].t
    steps = np.diff(t)
    period = float(np.median(steps))
    lost = np.round(steps / period).astype(int) - 1
    mock = OptitrackParams()
    return [Table('Motion capture in a hall, and the mock', ('', 'recorded', 'mock'),
                  ('', '.4g', '.4g'), [
        ('duration [s]', float(t[-1] - t[0]), ''), ('rate [Hz]', 1.0 / period, mock.rate),
        ('gaps of one lost pose or more', float((lost > 0).sum()), ''),
        ('gaps over 20 ms', float((steps > 0.02).sum()), ''),
        ('poses lost [%]', 100.0 * float(lost.sum() / (lost.sum() + len(t))),
         100.0 * mock.frame_loss),
        ('mean poses in a gap', float(lost[lost > 0].mean()), mock.loss_length),
        ('longest gap [s]', float(steps.max()), '')])]


def _factors(bags: dict[str, Path]) -> list[tuple[Cell, ...]]:
    rows: list[tuple[Cell, ...]] = []
    for name, path in bags.items():
        samples = flights.samples_of(path)
        one = flights.factor_of(samples)
        slope = flights.factor_of(samples, 'linear').slope
        counts = float(read_bag(path, ()).metadata['import']['counts_per_radian'])
        rows.append((
            name, float(len(samples.t)), float(np.sqrt(np.mean(samples.velocity ** 2))),
            f'{samples.height.min():.2f} to {samples.height.max():.2f}', one.offset.value,
            _interval(one.offset, 3), counts / one.offset.value, one.leak.value,
            _interval(one.leak, 2), _interval(slope, 1)))
    return rows


def _flown(bags: dict[str, Path], found: flights.Identified) -> list[tuple[Cell, ...]]:
    rows: list[tuple[Cell, ...]] = []
    for name, path in bags.items():
        bag = read_bag(path)
        truth = captured.mocap_truth(bag)
        for variant, params in flights.variants(found).items():
            rows.append((name, variant, *captured.errors(
                captured.replayed(bag, params), truth, markers=captured.range_offset(bag))))
        onboard = bag['onboard/odom']
        own = captured.Odometry(
            onboard.stamp, onboard.position, onboard.velocity, onboard.orientation)
        rows.append((name, 'onboard estimate', *captured.errors(own, truth)))
    return rows


def _joint(bags: dict[str, Path]) -> list[tuple[Cell, ...]]:
    rows: list[tuple[Cell, ...]] = []
    for name, path in bags.items():
        bag = read_bag(path)
        truth = captured.mocap_truth(bag)
        own = captured.replayed(bag, flights.joint_params('crazyflie'))
        for longest in (flights.SQUARE_DURATION, math.inf):
            rows.append((name, *captured.errors(
                own, truth, longest, captured.range_offset(bag))))
    return rows


def rejected_poses(bags: dict[str, Path]) -> list[Table]:
    """Return a table of the impossible poses that the import rejected; [] if it rejected none."""
    counts = {name: float(read_bag(path, ()).metadata['import']['mocap_poses_impossible'])
              for name, path in bags.items()}
    rows: list[tuple[Cell, ...]] = [row for row in counts.items() if row[1]]
    return [Table('Crazyflie: impossible poses rejected by the import', ('flight', 'poses'),
                  ('', '.0f'), rows)] if rows else []


def crazyflie(data: Path, folder: Path) -> list[Table]:
    """Return the flow factors, and the errors of the estimator against motion capture."""
    logs = [path for path in find(data / 'crazyflie_optitrack', '*.json')
            if 'lab03' not in path.name]
    out = []
    for treatment, words in (('leave', 'repeated counts left out'),
                             ('zero', 'repeated counts as zero')):
        bags = flights.import_crazyflies(logs, folder, treatment)
        if IDENTIFIED_ON not in bags:
            raise BagError(f'{data}: no flight {IDENTIFIED_ON}, which the sensors are identified '
                           'on; download it')
        found = flights.identify(bags[IDENTIFIED_ON])
        if treatment == 'leave':
            out += rejected_poses(bags)
            out.append(Table(
                f'Crazyflie: sensor parameters identified on {IDENTIFIED_ON}',
                ('', 'value'), ('', '.3g'), [
                    ('range noise [m]', found.range_noise),
                    ('mean height of the sensor [m]', found.height),
                    ('lag of the flow, best fit [s]', found.lag),
                    ('missing acceleration, density [m/s^2/sqrt(Hz)]', found.missing_density),
                    ('missing acceleration, mean over 1 s [m/s^2]', found.missing_mean)]))
        out.append(Table(
            f'Crazyflie: factor of the flow, {words}',
            ('flight', 'samples', 'rms [m/s]', 'heights [m]', 'Q', '95 %', 'counts/rad',
             'rotation', '95 %', 'dQ/dh, 95 % [1/m]'),
            ('', '.0f', '.3f', '', '.3f', '', '.0f', '.2f', '', ''), _factors(bags)))
        out.append(Table(
            f'Crazyflie: estimator against motion capture, {words}',
            ('flight', 'estimator', 'time [s]', 'xy rms [m]', 'xy drift [m]', 'z rms [m]',
             'velocity xy rms [m/s]', 'tilt rms [deg]'),
            ('', '', '.1f', '.3f', '.3f', '.3f', '.3f', '.2f'), _flown(bags, found)))
    bags = flights.import_crazyflies(logs, folder, 'zero', flights.JOINT_COUNTS)
    out.append(Table(
        'Crazyflie: joint filter against motion capture',
        ('flight', 'time [s]', 'xy rms [m]', 'xy drift [m]', 'z rms [m]',
         'velocity xy rms [m/s]', 'tilt rms [deg]'),
        ('', '.1f', '.3f', '.3f', '.3f', '.3f', '.2f'), _joint(bags)))
    return out


def rolling_spider(data: Path, folder: Path) -> list[Table]:
    """Return the replayed estimate minus the onboard one for both flow scales, and the heights."""
    rows: list[tuple[Cell, ...]] = []
    heights: list[tuple[Cell, ...]] = []
    for log in find(data / 'rolling_spider_flights', '*.mat'):
        kalman, joint = flights.height_errors(log, folder)
        heights.append((flights.recording_name(log), *kalman[:4], *joint[:4]))
        first, second = (flights.against_onboard(log, folder, scale) for scale in FLOW_SCALES)
        rows.append((flights.recording_name(log), *first, second[1], second[3]))
    a, b = (f'{scale:g}' for scale in FLOW_SCALES)
    return [Table(
        'Rolling Spider: replayed minus onboard estimate',
        ('flight', 'time [s]', f'xy rms, {a} [m]', 'z rms [m]', f'velocity rms, {a} [m/s]',
         'tilt rms [deg]', 'yaw rms [deg]', f'xy rms, {b} [m]', f'velocity rms, {b} [m/s]'),
        ('', '.1f', '.2f', '.2f', '.2f', '.2f', '.2f', '.2f', '.2f'), rows), Table(
        'Rolling Spider: estimated height minus sonar height',
        ('flight', *(f'{name}, {what}' for name in ('kalman', 'joint')
                     for what in ('rms [m]', 'within 0.3 m [%]', 'lowest [m]', 'highest [m]'))),
        ('', *2 * ('.2f', '.0f', '.2f', '.2f')), heights)]


SECTIONS: dict[str, Callable[[Path, Path], list[Table]]] = {
    'bench': bench, 'pendulum': pendulum, 'crazyflie': crazyflie,
    'rolling_spider': rolling_spider, 'hall': hall}


def validate(data: Path, only: list[str] | None = None) -> list[Table]:
    """
    Evaluate the recordings and return the tables.

    Parameters
    ----------
    data
        Folder that holds the folders of recordings.
    only
        Names of sections; default: all.

    Raises
    ------
    BagError, IdentifyError
        If recordings are missing or damaged; the message is one line.

    """
    if not data.is_dir():
        raise BagError(f'{data}: not a folder; the recordings are not part of this repository, '
                       'docs/evidence/real_recordings.md says where to get them')
    with tempfile.TemporaryDirectory() as folder:
        return [table for name in only or SECTIONS
                for table in SECTIONS[name](data, Path(folder))]


def parser() -> Parser:
    """Return the command line."""
    out = Parser('validate_recordings', 'Evaluate the public recordings again.')
    out.add_argument('data', type=Path, help='folder with the recordings')
    out.add_argument('--only', nargs='+', choices=tuple(SECTIONS), help='only these sections')
    out.add_argument('--markdown', action='store_true',
                     help='print Markdown, as in docs/evidence/real_recordings.md')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``validate_recordings``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        """Evaluate the recordings and print the tables."""
        found = validate(options.data, options.only)
        if options.json:
            write_json(options.json, json.dumps(
                [table._asdict() for table in found], indent=1, allow_nan=False))
        if options.json != '-':
            print('\n\n'.join(
                table.markdown() if options.markdown else table.text() for table in found))
    return guard('validate_recordings', work)


if __name__ == '__main__':
    raise SystemExit(main())
