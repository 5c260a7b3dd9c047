"""
Logs of Simulink models on a minidrone: ``RSdata.mat`` of MathWorks's minidrone support package.

Such a file holds a structure with time for each To Workspace block or scope, named ``rt_`` and
the name of the block. Two families are known from public flights and the scripts that
read them; :mod:`.simulink_names` has the names, and a map for others:

===================================  ==========================================================
``rt_sensor``                        accelerometer, gyro; sonar, pressure, battery V and %
``rt_optical``                       columns 1 and 2 the flow, 4 a flag
``rt_calib``                         accelerometer without g and gyro at rest, pressure
``rt_estim``, ``rt_estimatedStates``  x y z, yaw pitch roll, dx dy dz, p q r and maybe more
``rt_motor``, ``rt_motors``          four motor commands, signs + - + - or none
``rt_ref``, ``rt_References``        x y z, yaw pitch roll and maybe more
``rt_a_x`` ..., ``rt_p`` ...         accelerometer and gyro, a signal each
``rt_z_ultrasonic``, ``rt_pressure``  sonar and barometer
``rt_u``, ``rt_v``, ``rt_w``         optical flow and its flag; or ``rt_optical_flow``
``rt_phi_drone``, ``rt_u_est`` ...   parts of the onboard estimate
===================================  ==========================================================

All in NED and FRD; the onboard velocity is that in body axes. What else is there is named and left
out.

Clocks
    Each structure has its own time. Parts of one vector that differ are brought to the times of
    its first part, linearly or, of held sensors, by the value before. Rows outside of the time of
    a part, or in a gap of it, are left out and counted. A signal that begins or
    ends more than a second outside of the inertial sensors' time is on another clock: refused.

Held sensors
    Sonar, pressure, flow and battery are held between their samples; only new values become
    messages, as in :mod:`.import_minidrone`.

Units and signs
    Accelerometer: at rest (0, 0, -9.8) m/s^2. The median length must be near g and the median of
    z, of a vehicle upright, negative; other units and signs are told by a map.

    Gyro: rad/s or deg/s. Gravity keeps the tilt of a flying vehicle bounded, so that the integral
    of the gyro about x and y, less a line through each 4 s, is bounded too. Its largest RMS is
    0.03 to 0.14 rad in eight public flights in rad/s (deg/s would make it 2 to 8), below 0.01 in
    four at rest or on a bench. From 0.25 to 1 it is not told, and must be given.

    Sonar: NED, negative upwards, in some logs. The sign of most values is taken. Ranges in mm and
    pressures in hPa are refused.

    Angles: rad. Pitches beyond a quarter turn and rolls beyond half a turn are left out and
    counted, and refused where they are many.

    Flow: ``rt_optical`` is in units of the educational toolbox, 20 rad/s each; the later package
    has moved that factor into the sensor. A flag is believed where it is -99 or 0 and 1; -99 and
    0 on both axes are no flow.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import math
from pathlib import Path
from typing import Any

from mambo_bags.mcap_reader import BagError
from mambo_model.frames import flip_vector, wire_quaternion
from mambo_model.motion.quaternion import from_euler
import numpy as np
from numpy.typing import NDArray

from .checks.plausible import (
    constant, HALF, QUARTER, refuse_pressure, refuse_ranges, refuse_steep, tilt_of, TILTS, unusual,
    unusual_gyro)
from .common import is_sound, LONGEST, new_samples, Publisher, shortened, stamps_ns
from .mat_file import logged, Signal
from .simulink_names import by_map, by_name, Column, LAYOUTS, near, QUANTITIES, TOOLBOX_FLOW

Floats = NDArray[np.float64]
STEP = 0.005  # [s]
MOTOR_SIGNS = (1.0, -1.0, 1.0, -1.0)
NO_FLOW = -99.0  # where there is none
GAP = 3.5  # usual steps; samples that are further apart have a gap between them
OUTSIDE = 1.0  # [s] by which a signal may be outside of the inertial sensors' time
STANDARD_GRAVITY = (7.0, 13.0)  # [m/s^2] median length of a specific force
TOPICS = {
    'imu': ('imu/data_raw', 'sensor_msgs/msg/Imu'),
    'sonar': ('sonar/range', 'sensor_msgs/msg/Range'),
    'flow': ('optical_flow', 'mambo_interfaces/msg/OpticalFlow'),
    'pressure': ('barometer/pressure', 'sensor_msgs/msg/FluidPressure'),
    'motors': ('motor_pwm', 'mambo_interfaces/msg/MotorPwm'),
    'onboard': ('onboard/odom', 'nav_msgs/msg/Odometry'),
    'reference': ('onboard/reference', 'geometry_msgs/msg/PoseStamped'),
    'battery': ('battery', 'sensor_msgs/msg/BatteryState')}
GROUPS: dict[str, tuple[str, ...]] = {
    'imu': QUANTITIES['accel'] + QUANTITIES['gyro'], 'sonar': QUANTITIES['sonar'],
    'flow': QUANTITIES['flow'], 'pressure': QUANTITIES['pressure'],
    'motors': QUANTITIES['motors'], 'reference': QUANTITIES['reference'],
    'onboard': tuple(part for name in ('position', 'attitude', 'velocity', 'rates')
                     for part in QUANTITIES[name]),
    'battery': QUANTITIES['battery']}
HELD = ('sonar', 'flow', 'pressure', 'battery')


@dataclasses.dataclass(frozen=True)
class PackageLog:
    """
    The known parts of a log.

    Attributes
    ----------
    parts
        {name of ``GROUPS``: (times (n,) s, values (n, k))}, NED/FRD, SI, the flow in rad/s; of
        held sensors new values alone.
    calibration : (6,)
        Biases of accelerometer [m/s^2] and gyro [rad/s] that the log gives; None without.
    notes
        What was decided, one line each.
    ignored
        What the file holds and nothing is made of.

    """

    parts: dict[str, tuple[Floats, Floats]]
    calibration: Floats | None
    notes: list[str]
    ignored: list[str]

    @property
    def topics(self) -> dict[str, str]:
        """Return {topic: type} of the signals that are present."""
        return dict(TOPICS[part] for part in self.parts)


def _sound(path: Path, column: Column) -> None:
    """Check the times and values of a column; BagError names it."""
    name, t, _ = column.signal
    if len(t) < 2 or not np.isfinite(t).all() or t[0] < 0.0 or t[-1] > LONGEST:
        raise BagError(f'{path}: the times of {name} are not 0 or more seconds, two at least')
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if len(back):
        raise BagError(f'{path}: the times of {name} do not increase after {t[back[0]]:g} s')
    if not is_sound(column.scale * column.signal.values[:, column.index]):
        raise BagError(f'{path}: {name} has values that are not finite or absurdly large')


def _at(column: Column, times: Floats, held: bool) -> Floats:
    """Return the values of a column at times, (n,)."""
    t, v = column.signal.times, column.scale * column.signal.values[:, column.index]
    if np.array_equal(t, times):
        return v
    if held:
        return v[np.clip(np.searchsorted(t, times + 1e-6, 'right') - 1, 0, len(t) - 1)]
    return np.interp(times, t, v)


def _covered(t: Floats, times: Floats) -> NDArray[np.bool_]:
    """
    Return at which times, (n,), a signal sampled at t is known.

    There a sample is at most one usual step away, or the samples around have no gap between them.
    """
    usual = float(np.median(np.diff(t))) + 1e-6
    after = np.searchsorted(t, times)
    padded = np.concatenate([[-np.inf], t, [np.inf]])
    since, until = times - padded[after], padded[after + 1] - times
    return (np.minimum(since, until) <= usual) | (since + until <= GAP * usual)


class _Reader:
    """Converts the columns of a log, and notes its decisions."""

    def __init__(self, path: Path, names: list[str], columns: Mapping[str, Column | None],
                 gyro_unit: str, flow_scale: float | None) -> None:
        self.path, self.names, self.columns = path, names, columns
        self.gyro_unit, self.flow_scale = gyro_unit, flow_scale
        self.parts: dict[str, tuple[Floats, Floats]] = {}
        self.notes: list[str] = []
        self.used: set[tuple[str, int]] = set()
        self.gyro_factor = 1.0
        self.imu_times: Floats | None = None  # also those that were left out

    def group(self, name: str, names: tuple[str, ...]) -> tuple[Floats, Floats] | None:
        """Return times and values of a vector, None if it is not complete."""
        columns = [column for part in names if (column := self.columns.get(part))]
        if len(columns) < len(names):
            return None
        times = columns[0].signal.times
        known, lacking = np.ones(len(times), bool), []
        for column in columns:
            _sound(self.path, column)
            self.used.add((column.signal.name, column.index))
            t = column.signal.times
            if not np.array_equal(t, times):
                self._same_clock(column, columns[0].signal.name, times)
                self.notes.append(f'{column.signal.name} was brought to the times of '
                                  f'{columns[0].signal.name}')
                covered = _covered(t, times)
                known &= covered
                lacking += [] if covered.all() else [column.signal.name]
        if self.imu_times is not None:
            self._same_clock(columns[0], 'the inertial sensors', self.imu_times)
        if name == 'imu':
            self.imu_times = times
        if lacking:
            self._left_out(name, known, list(dict.fromkeys(lacking)))
        self.notes = list(dict.fromkeys(self.notes))
        values = np.stack([_at(column, times, name in HELD) for column in columns], axis=1)
        return times[known], values[known]

    def _left_out(self, name: str, known: NDArray[np.bool_], lacking: list[str]) -> None:
        """Note the rows of a vector that lack parts; BagError if too few are left."""
        topic = TOPICS[name][0] if name in TOPICS else name
        rows = f'{int((~known).sum())} of {len(known)} rows lie outside of the times of ' \
            f'{shortened(lacking)} or in their gaps'
        if known.sum() < 2:
            raise BagError(f'{self.path}: {topic}: {rows}: log its parts together, or leave it '
                           'out with --map (NAME: none)')
        self.notes.append(f'{topic}: {rows}: left out')

    def _same_clock(self, column: Column, whose: str, times: Floats) -> None:
        t = column.signal.times
        if t[0] < times[0] - OUTSIDE or t[-1] > times[-1] + OUTSIDE:
            raise BagError(
                f'{self.path}: {column.signal.name} ({t[0]:.3f} to {t[-1]:.3f} s) is on another '
                f'clock than {whose} ({times[0]:.3f} to {times[-1]:.3f} s); leave it out with '
                '--map (NAME: none)')

    def imu(self) -> None:
        """Take the inertial sensors; BagError if a part of them is missing or in other units."""
        parts = GROUPS['imu']
        missing = [part for part in parts if not self.columns.get(part)]
        given = [part for part in parts if part in self.columns]
        if missing and len(given) > sum(self.columns[part] is None for part in given):
            self._incomplete([part for part in missing if part not in self.columns])
        found = self.group('imu', parts)
        if found is None:
            return
        times, values = found
        self._check_force(values[:, :3])
        self.notes += [constant(f'{part} in {self._whose(part)}', 0.0)
                       for part, x in zip(parts, values.T) if not x.any()]
        self.gyro_factor = self._gyro_factor(times, values[:, 3:5])
        values[:, 3:] *= self.gyro_factor
        self.parts['imu'] = times, values
        steps = np.diff(times)
        usual = float(np.median(steps))
        if abs(usual - STEP) > 1e-6:
            self.notes.append(f'the inertial sensors have a step of {1e3 * usual:.3g} ms, not 5')
        if (steps > GAP * usual).any():
            self.notes.append(f'the inertial sensors have {int((steps > GAP * usual).sum())} '
                              f'gaps, up to {steps.max():.3g} s')

    def _incomplete(self, missing: list[str]) -> None:
        """Raise BagError for inertial sensors of which some have no known name."""
        if not missing:
            return
        stems = {part: next(stem for stem, layout in LAYOUTS.items() if layout == (part,))
                 for part in missing}
        told = {column.signal.name for column in self.columns.values() if column}
        others = [name for name in self.names if name not in told]
        said = '; '.join(f'{part} (such as rt_{stem}; nearest: {near(f"rt_{stem}", others)})'
                         for part, stem in stems.items())
        raise BagError(
            f'{self.path}: of the inertial sensors is missing {said}: say with --map which '
            f'variable it is ({missing[0]}: NAME), or leave them out (accel: none, gyro: none)')

    def _check_force(self, accel: Floats) -> None:
        """Raise BagError if the accelerometer does not measure specific force in FRD."""
        length = float(np.median(np.linalg.norm(accel, axis=1)))
        down = float(np.median(accel[:, 2]))
        if not STANDARD_GRAVITY[0] < length < STANDARD_GRAVITY[1]:
            raise BagError(
                f'{self.path}: the accelerometer has a median length of {length:.3g}, not 9.8 '
                'm/s^2; in g: --map with accel_x: 9.81 * NAME and so on')
        if down > 0.5 * length:
            raise BagError(
                f'{self.path}: the accelerometer has a median of z of {down:+.3g} m/s^2; it is '
                '-9.8 of specific force with z down: turn its signs with --map (accel_z: -NAME), '
                'and those of y or of x and y, as the axes are')

    def _gyro_factor(self, times: Floats, rates: Floats) -> float:
        """Return the unit of a gyro in rad/s; BagError if it is unknown."""
        if self.gyro_unit != 'auto':
            return 1.0 if self.gyro_unit == 'rad/s' else math.pi / 180.0
        tilt = tilt_of(times, rates)
        if TILTS[0] < tilt < TILTS[1]:
            raise BagError(
                f'{self.path}: whether the gyro is in rad/s or deg/s is not told by its integral '
                f'(a tilt of {tilt:.2f} rad or deg RMS); give --gyro-unit')
        unit = 'deg/s' if tilt >= TILTS[1] else 'rad/s'
        self.notes.append(
            f'gyro taken for {unit}: its integral is a tilt of {math.degrees(tilt):.2g} deg RMS '
            f'in rad/s, of {tilt:.2g} deg in deg/s (--gyro-unit sets it)')
        return math.pi / 180.0 if unit == 'deg/s' else 1.0

    def sonar(self) -> None:
        """Take the new values of the sonar, positive."""
        found = self.group('sonar', GROUPS['sonar'])
        if found is None:
            return
        times, values = found
        if (values < 0.0).sum() > (values > 0.0).sum():
            self.notes.append('sonar is negative upwards: its sign was turned')
            values = -values
        new = new_samples(values)
        refuse_ranges(f'{self.path}: {self._whose("sonar")}', values[new, 0])
        self.notes += unusual(
            f'sonar in {self._whose("sonar")}', 'sonar', values[:, 0])
        self.parts['sonar'] = times[new], values[new] + 0.0

    def flow(self) -> None:
        """Take the new values of the flow that its flag does not refuse, in rad/s."""
        found = self.group('flow', GROUPS['flow'])
        if found is None:
            return
        times, values = found
        valid = values.any(axis=1) & (values != NO_FLOW).all(axis=1)
        if (flag := self.columns.get('flow_flag')) is not None:
            valid &= self._flagged(flag, times)
        first = self.columns['flow_x']
        toolbox = first is not None and first.stem in TOOLBOX_FLOW
        scale = self.flow_scale or (20.0 if toolbox else 1.0)
        given = 'given' if self.flow_scale else 'by the name of the signal, --flow-scale sets it'
        self.notes.append(f'flow of 1 taken for {scale:g} rad/s ({given})')
        self.notes += unusual(
            f'flow in {self._whose("flow_x")}', 'flow',
            scale * np.linalg.norm(np.where(valid[:, None], values, 0.0), axis=1))
        new = new_samples(values)
        new = new[valid[new]]
        self.parts['flow'] = times[new], scale * values[new]

    def _flagged(self, flag: Column, times: Floats) -> NDArray[np.bool_]:
        """Return a mask of the flow samples that a flag accepts; all without a flag."""
        _sound(self.path, flag)
        values = _at(flag, times, True)
        kinds = set(np.unique(values).tolist()) if len(np.unique(values)) < 9 else set()
        if NO_FLOW in values or kinds == {0.0, 1.0}:
            self.used.add((flag.signal.name, flag.index))
            passed = (values != NO_FLOW) if NO_FLOW in values else values == 1.0
            passed &= _covered(flag.signal.times, times)
            self.notes.append(f'{flag.signal.name}[{flag.index}] refuses the flow at '
                              f'{int((~passed).sum())} of {len(times)} steps')
            return passed
        return np.ones(len(times), bool)

    def plain(self, name: str) -> None:
        """Take a vector as it is; of a held signal only its new values."""
        found = self.group(name, GROUPS[name])
        if found is None:
            return
        times, values = found
        if name == 'motors':
            signs = values * MOTOR_SIGNS
            if (signs < 0.0).any() and (values < 0.0).any():
                raise BagError(
                    f'{self.path}: the motor commands have not the signs + - + - of a minidrone')
        kinds = {'motors': ('motors',), 'pressure': ('pressure',),
                 'battery': ('battery', 'percent')}.get(name, ())
        for kind, part, x in zip(kinds, GROUPS[name], [values] if name == 'motors' else values.T):
            self.notes += unusual(f'{part} in {self._whose(part)}', kind, x.ravel())
        if name in HELD:
            new = new_samples(values)
            new = np.r_[0, new] if name == 'battery' else new
            times, values = times[new], values[new]
        if name == 'pressure':
            refuse_pressure(f'{self.path}: {self._whose("pressure")}', values[:, 0])
        if name == 'reference':
            times, values = self._upright(name, 'ref_', times, values)
        self.parts[name] = times, values

    def _whose(self, part: str) -> str:
        """Return the name of the signal that holds a part."""
        column = self.columns[part]
        return column.signal.name if column else part

    def _upright(self, name: str, prefix: str, times: Floats,
                 values: Floats) -> tuple[Floats, Floats]:
        """Leave out the few rows of a vector whose angles cannot be; BagError for many."""
        wrong = np.zeros(len(times), bool)
        for angle, most in (('pitch', QUARTER), ('roll', HALF)):
            part = f'{prefix}{angle}'
            wrong |= refuse_steep(f'{self.path}: {part} in {self._whose(part)}', times,
                                  values[:, GROUPS[name].index(part)], most)
        if wrong.any():
            self.notes.append(f'{TOPICS[name][0]}: {int(wrong.sum())} of {len(wrong)} rows have a '
                              'pitch beyond a quarter turn or a roll beyond half a turn: left out')
        return times[~wrong], values[~wrong]

    def onboard(self) -> None:
        """Take the onboard estimate if it has a pose; NaN where velocity or rates are missing."""
        pose = QUANTITIES['position'] + QUANTITIES['attitude']
        rest = [QUANTITIES['velocity'], QUANTITIES['rates']]
        there = [part for parts in rest if all(self.columns.get(p) for p in parts)
                 for part in parts]
        found = self.group('onboard', pose + tuple(there))
        if found is None:
            return
        times, some = found
        values = np.full((len(times), 12), math.nan)
        values[:, [GROUPS['onboard'].index(part) for part in (*pose, *there)]] = some
        self.parts['onboard'] = self._upright('onboard', '', times, values)
        if 'imu' in self.parts and len(times) > 1:
            t, imu = self.parts['imu']
            rates = [np.interp(t, times, x, math.nan, math.nan) for x in values[:, 9:].T]
            self.notes += unusual_gyro(QUANTITIES['gyro'], imu[:, 3:], np.stack(rates, axis=1))

    def calibration(self) -> Floats | None:
        """Return the biases of accelerometer and gyro that the log gives, (6,)."""
        found = self.group('calibration', QUANTITIES['calibration'])
        if found is None:
            return None
        biases = np.median(found[1], axis=0)
        biases[3:] *= self.gyro_factor
        return biases


def is_package_log(found: Mapping[str, Any], mapped: bool) -> bool:
    """Return whether a file was logged by a Simulink model, not by the toolbox."""
    output = found.get('rt_yout')
    entries = output.get('signals') if isinstance(output, dict) else None
    entries = entries if isinstance(entries, list) else [entries]
    blocks = {str(entry.get('blockName')).split('/')[-1] for entry in entries
              if isinstance(entry, dict)}
    if blocks & {'motors_refout', 'ddxb', 'opticalFlow_datout'}:
        return False
    return mapped or 'Actuators' in blocks or any(
        isinstance(value, dict) and {'time', 'signals'} <= set(value) and name != 'rt_yout'
        for name, value in found.items())


def _ignored(
    signals: dict[str, Signal], used: set[tuple[str, int]], others: list[str],
) -> list[str]:
    """Return the unused columns and variables as text."""
    out = []
    for name, signal in signals.items():
        width = signal.values.shape[1]
        left = [i for i in range(width) if (name, i) not in used]
        if len(left) == width:
            out.append(f'{name} {signal.values.shape}')
        elif left:
            out.append(f'{name}[{",".join(map(str, left))}]')
    return out + others


def read_package_log(
    path: Path, found: dict[str, Any], names: Path | None = None, gyro_unit: str = 'auto',
    flow_scale: float | None = None,
) -> PackageLog:
    """
    Return the known parts of a mat file's variables.

    Parameters
    ----------
    path
        Of the log, for errors.
    found
        As of :func:`mambo_analysis.importers.mat_file.variables`.
    names
        Map of other names, see :mod:`.simulink_names`.
    gyro_unit
        ``rad/s``, ``deg/s``, or ``auto``: by its integral.
    flow_scale
        rad/s for a flow of 1; default: by its name.

    Raises
    ------
    BagError
        If nothing is known, or a known variable is malformed.
    mambo_model.schema.ParameterError
        If the map does not fit.

    """
    signals, others = logged(path, found)
    columns: dict[str, Column | None] = dict(by_name(path, signals))
    columns |= by_map(names, signals) if names is not None else {}
    reader = _Reader(path, list(signals), columns, gyro_unit, flow_scale)
    reader.imu()
    reader.sonar()
    reader.flow()
    for name in ('pressure', 'motors', 'reference', 'battery'):
        reader.plain(name)
    reader.onboard()
    calibration = reader.calibration()
    ignored = _ignored(signals, reader.used, others)
    if not reader.parts:
        raise BagError(
            f'{path}: a log of a Simulink model without a variable whose meaning is known (such '
            f'as rt_sensor, rt_a_x, rt_estim, rt_motor); say it with --map; it has '
            f'{shortened(ignored) or "none"}')
    return PackageLog(reader.parts, calibration, reader.notes, ignored)


def publish(
    log: PackageLog, out: Publisher, sonar_range: tuple[float, float], quality: int,
) -> None:
    """Write the messages of a log; the sonar's limits in m, the quality of all flow."""
    for part, (times, values) in log.parts.items():
        topic, _ = TOPICS[part]
        for stamp, row in zip(stamps_ns(times).tolist(), values.tolist()):
            if part == 'motors':
                out.publish(topic, stamp, '', pwm=np.abs(row))
            elif part == 'imu':
                out.publish(topic, stamp, 'base_link', **out.imu(
                    flip_vector(tuple(row[3:6])), flip_vector(tuple(row[:3]))))
            elif part == 'sonar':
                out.publish(topic, stamp, 'base_link', radiation_type=0, range=row[0],
                            min_range=sonar_range[0], max_range=sonar_range[1])
            elif part == 'flow':
                x, y, _ = flip_vector((*row, 0.0))
                out.publish(topic, stamp, 'base_link', rate_x=x, rate_y=y, quality=quality)
            elif part == 'pressure':
                out.publish(topic, stamp, 'base_link', fluid_pressure=row[0])
            elif part == 'battery':
                out.publish(topic, stamp, '', **out.battery(*row))
            elif part == 'reference':
                out.publish(topic, stamp, 'odom', pose=_pose(out, row))
            else:
                out.publish(topic, stamp, 'odom', **out.odometry(
                    _pose(out, row), flip_vector(tuple(row[6:9])), flip_vector(tuple(row[9:12]))))


def _pose(out: Publisher, row: list[float]) -> Any:
    """Return x y z, yaw pitch roll in NED as a pose with z up."""
    yaw, pitch, roll = row[3:6]
    return out.pose(flip_vector(tuple(row[:3])), wire_quaternion(from_euler(roll, pitch, yaw)))
