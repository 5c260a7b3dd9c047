"""
Flight logs of Parrot minidrones as bags: ``import_minidrone LOG.mat OUT``.

Two kinds are read. The logs of Simulink models on a Mambo are read by :mod:`.simulink`; the rest
of this text is about the educational toolbox. Content of a file that is not imported is
listed.

A log is ``rt_yout`` of the educational toolbox (RollingSpiderEdu, ``rsedu_control.c``): 29 signals
at 200 Hz in NED/FRD, among them raw sensors, motor commands and the drone's own estimate. Slow
sensors are held between their samples; only samples with a new value become messages. A new
sample that repeats its predecessor to the bit cannot be told from a held one (1 to 10 % of the
sonar's, which has steps of 1.3 mm). Stamps are i * 5 ms, when the onboard code read the sample.

Optical flow
    The onboard code reads it as ``velocity = 20 * flow`` in body axes, x forward and y right,
    without height and without a gyro term (``opticalFlowToVelocity_gain``, also in the crash
    check of ``rsedu_control.c``); regression of the logged onboard velocity on the flow gives
    16.5 to 19.5 (correlation 0.94 to 0.99; 14.7 in one flight that oscillates). The later package
    carries the gain 1: the same quantity with the 20 moved into the sensor, and the thesis shows
    for that quantity that it is an angular rate (velocity = height * Q * flow, sec. 5.4 and
    app. C). The importer hence publishes ``rate = 20 * flow`` [rad/s], y to the left.

    What the eight flights among twelve public logs say:

    * Sign: that of the vehicle's motion on both axes, against the velocity integrated from tilt:
      the factor is positive in all 13 cases (8 flights, 2 axes) that give it to 25 % or better.
    * Rotation: compensated by the sensor. The factor of the gyro term, 1 for a raw camera, is
      0.03 and 0.05 in the flight with the best data (RSdata_exampleflight).
    * Scale: in that flight markers on the floor give positions; displacement against the
      integral of height * flow (tilt error of the marker position fitted along, R^2 0.97)
      gives 16.4 +- 1.4, 18.1 +- 1.3, 18.3 +- 1.3 rad/s per unit over 0.5, 1, 2 s. Velocity from
      tilt gives 16.9 (x) and 13.1 (y) there, +- 3 %, and 23 to 72 in the other flights; in most
      of these the sonar reads 0.4 to 0.8 of the barometer's height, so that the height is not
      known. 20 lies between; ``--flow-scale`` sets another value.
    * Height: whether the signal is a rate or a velocity cannot be decided from these logs; the
      best exponent of the height is 0.4 with the height from the barometer.
    * Delay: the fit is best with the flow 80 to 100 ms behind the motion. The stamps are left
      as logged.

    Zero on both axes is "no flow yet" to the onboard code and is not published. The log holds
    only samples that the sensor called valid, without its quality figure: quality is 255.

Sonar
    0.0 is a missing echo. Below 0.434 m there is nothing: on the floor the sensor reports 0.434
    to 0.5 m. The toolbox cuts at 0.44 m (``altSenor_min``) and the onboard code takes no
    altitude above 4 m for a reference; these are ``min_range`` and ``max_range``. Values outside
    (isolated ones up to 5.26 m) are kept, and invalid by the convention of sensor_msgs/Range.

Motor order
    Signs (+, -, +, -) are spin directions and dropped. The order is that of (3.2): angular
    acceleration regressed on the four commands has the signs (+, -, -, +) in roll and
    (+, +, -, -) in pitch in all eight flights.

Onboard velocity
    The onboard position is, to rounding, the sum of R(yaw, pitch, roll) (dx, dy, dz) * 5 ms: the
    three are used as a body velocity, and ``onboard/odom`` gives them as one.

Calibration
    ``sensordataCalib`` is the mean of the resting drone. The onboard estimator subtracts it (its
    p and q are the gyro minus the calibration, median difference at most 2e-4 and 5e-3 rad/s)
    and takes the ground for level. The published samples are raw; the values are in the bag's
    metadata.

Doubtful values
    Sensors with values that no minidrone has (:data:`.checks.plausible.MINIDRONE`), and what
    contradicts the drone's own estimate (:mod:`.checks.minidrone_doubts`), are imported as they
    are, with a line that names them.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser
from mambo_bags.mcap_reader import BagError
from mambo_bags.writer import BagWriter
from mambo_model.frames import flip_vector, wire_quaternion
from mambo_model.motion.quaternion import from_euler
import numpy as np
from numpy.typing import NDArray

from .checks import bag_doubts, plausible
from .checks.minidrone_doubts import onboard_doubts, sensor_doubts
from .common import (
    estimator_parameters, importer_parser, is_sound, new_samples, provenance, Publisher,
    read_source, refuse_options, report, shortened, Source, unused)
from .mat_file import columns, variables
from .simulink import is_package_log, PackageLog, publish, read_package_log

Array = NDArray[np.float64]
STEP_NS = 5_000_000
GRAVITY = 9.81  # [m/s^2] as the estimator's
LARGEST_BIAS = 2.0  # [m/s^2] of an accelerometer, generously
LARGEST_RATE = 1.0  # [rad/s] of a gyro at rest, likewise
FLOW_SCALE = 20.0  # [rad/s] per unit, estimParams.pos.opticalFlowToVelocity_gain
SONAR_RANGE = (0.44, 4.0)  # [m]
FULL_QUALITY = 255
MOTOR_SIGNS = (1.0, -1.0, 1.0, -1.0)
SIGNALS = {
    'motors_refout': 4, 'X': 1, 'Y': 1, 'Z': 1, 'yaw': 1, 'pitch': 1, 'roll': 1, 'dx': 1, 'dy': 1,
    'dz': 1, 'pb': 1, 'qb': 1, 'rb': 1, 'pose_refout': 6, 'ddxb': 1, 'ddyb': 1, 'ddzb': 1, 'pa': 1,
    'qa': 1, 'ra': 1, 'altitude_sonarb': 1, 'prsb': 1, 'opticalFlow_datout': 3,
    'sensordataCalib_datout': 7, 'batteryStatus_datout': 2}
"""Signals needed, by the last part of their block name, and how many values each has."""
TOPICS = {
    'imu/data_raw': 'sensor_msgs/msg/Imu', 'sonar/range': 'sensor_msgs/msg/Range',
    'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
    'barometer/pressure': 'sensor_msgs/msg/FluidPressure',
    'motor_pwm': 'mambo_interfaces/msg/MotorPwm', 'onboard/odom': 'nav_msgs/msg/Odometry',
    'onboard/reference': 'geometry_msgs/msg/PoseStamped',
    'battery': 'sensor_msgs/msg/BatteryState'}


@dataclasses.dataclass(frozen=True)
class Log:
    """
    A minidrone log, unchanged.

    Attributes
    ----------
    signals
        {name: (n,) or (n, k)} for the names of ``SIGNALS``, NED/FRD, SI.
    name, sha256
        Of the file.
    ignored
        What else the file holds.

    """

    signals: dict[str, Array]
    name: str
    sha256: str
    ignored: list[str]

    def __len__(self) -> int:
        return len(self.signals['X'])

    def columns(self, *names: str) -> Array:
        """Return scalar signals side by side, (n, k)."""
        return np.stack([self.signals[name] for name in names], axis=1)


def _toolbox(path: Path, found: dict[str, Any]) -> dict[str, Any]:
    """Return rt_yout of the variables of a mat file."""
    output = found.get('rt_yout')
    if not isinstance(output, dict) or not {'time', 'signals'} <= set(output):
        raise BagError(f'{path}: no minidrone log: it has no rt_yout or other structures '
                       f'with time and signals, it has {shortened(list(found)) or "nothing"}')
    return output


def _checked(path: Path, found: dict[str, Any]) -> tuple[dict[str, Array], list[str]]:
    """Return the needed signals, each of the right shape and finite, and the names of others."""
    try:
        time = np.asarray(found['time'], float).reshape(-1)
        entries = found['signals'] if isinstance(found['signals'], list) else [found['signals']]
        values = {str(e['blockName']).split('/')[-1]: e['values'] for e in entries}
    except (TypeError, ValueError, KeyError, IndexError):
        raise BagError(f'{path}: rt_yout is not built as a minidrone log: time, and signals with '
                       'blockName and values') from None
    if len(time) < 2 or not np.allclose(np.diff(time), STEP_NS * 1e-9, rtol=0.0, atol=1e-6):
        raise BagError(f'{path}: the steps of rt_yout.time are not 5 ms each')
    signals = {}
    for name, width in SIGNALS.items():
        if name not in values:
            raise BagError(
                f'{path}: signal {name} is missing; it has {shortened(list(values), 40)}')
        signal = columns(path, f'signal {name}', values[name], len(time))
        if signal.shape[1] != width:
            raise BagError(f'{path}: signal {name} has the shape {signal.shape}, '
                           f'expected ({len(time)}, {width})')
        if not is_sound(signal):
            raise BagError(
                f'{path}: signal {name} has values that are not finite or absurdly large')
        signals[name] = np.ascontiguousarray(signal if width > 1 else signal[:, 0])
    if (signals['motors_refout'] * MOTOR_SIGNS < 0.0).any():
        raise BagError(f'{path}: signal motors_refout has not the signs + - + - of a minidrone')
    return signals, [name for name in values if name not in SIGNALS]


def read_log(source: Source, found: dict[str, Any]) -> Log:
    """
    Return the log of the educational toolbox from a mat file's variables.

    Parameters
    ----------
    source
        The file.
    found
        Its variables, as of :func:`mat_file.variables`.

    Raises
    ------
    BagError
        If it is no such log, a signal is missing or malformed, or the attitude is not in rad or
        the ranges not in m.

    """
    signals, others = _checked(source.path, _toolbox(source.path, found))
    times = STEP_NS * 1e-9 * np.arange(len(signals['X']))
    for name, most in (('pitch', plausible.QUARTER), ('roll', plausible.HALF)):
        plausible.refuse_steep(f'{source.path}: {name}', times, signals[name], most)
    plausible.refuse_ranges(f'{source.path}: altitude_sonarb', signals['altitude_sonarb'])
    others += [name for name in found if name not in ('rt_yout', 'rt_tout')]
    return Log(signals, source.path.name, source.sha256, others)


def _flip(vectors: Array) -> list[list[float]]:
    """Turn (n, 3) between NED/FRD and z up/FLU."""
    return np.stack(flip_vector(tuple(vectors.T)), axis=1).tolist()


def _attitudes(yaw_pitch_roll: Array) -> list[tuple[float, ...]]:
    """Return x y z w, FLU to z up, of (n, 3) rad, NED."""
    return [wire_quaternion(from_euler(roll, pitch, yaw))
            for yaw, pitch, roll in yaw_pitch_roll.tolist()]


def _publish_imu(log: Log, out: Publisher) -> None:
    accel, gyro = _flip(log.columns('ddxb', 'ddyb', 'ddzb')), _flip(log.columns('pa', 'qa', 'ra'))
    for step, (a, w) in enumerate(zip(accel, gyro)):
        out.publish('imu/data_raw', step * STEP_NS, 'base_link', **out.imu(w, a))


def _publish_slow_sensors(log: Log, out: Publisher, flow_scale: float) -> None:
    sonar = log.signals['altitude_sonarb']
    for step in new_samples(sonar).tolist():
        out.publish('sonar/range', step * STEP_NS, 'base_link', radiation_type=0,
                    min_range=SONAR_RANGE[0], max_range=SONAR_RANGE[1], range=float(sonar[step]))
    flow = log.signals['opticalFlow_datout']
    for step in new_samples(flow[:, :2]).tolist():
        x, y, _ = flip_vector((*(flow_scale * flow[step, :2]).tolist(), 0.0))
        if x or y:
            out.publish('optical_flow', step * STEP_NS, 'base_link', rate_x=x, rate_y=y,
                        quality=FULL_QUALITY)
    pressure = log.signals['prsb']
    for step in new_samples(pressure).tolist():
        out.publish('barometer/pressure', step * STEP_NS, 'base_link',
                    fluid_pressure=float(pressure[step]))


def _publish_onboard(log: Log, out: Publisher) -> None:
    motors = np.abs(log.signals['motors_refout'])
    position = _flip(log.columns('X', 'Y', 'Z'))
    attitude = _attitudes(log.columns('yaw', 'pitch', 'roll'))
    velocity = _flip(log.columns('dx', 'dy', 'dz'))
    omega = _flip(log.columns('pb', 'qb', 'rb'))
    goal = log.signals['pose_refout']
    goals, headings = _flip(goal[:, :3]), _attitudes(goal[:, 3:])
    for step in range(len(log)):
        out.publish('motor_pwm', step * STEP_NS, '', pwm=motors[step])
        out.publish(
            'onboard/odom', step * STEP_NS, 'odom',
            **out.odometry(out.pose(position[step], attitude[step]), velocity[step], omega[step]))
        out.publish('onboard/reference', step * STEP_NS, 'odom',
                    pose=out.pose(goals[step], headings[step]))


def _publish_battery(log: Log, out: Publisher) -> None:
    battery = log.signals['batteryStatus_datout']
    for step in [0, *new_samples(battery).tolist()]:
        out.publish('battery', step * STEP_NS, '', **out.battery(*battery[step].tolist()))


def _alignment(accel: list[float], gyro: list[float], **more: int) -> dict[str, Any]:
    """
    Return parameters of the alignment with the log's calibration.

    Empty where that mean is no bias: a vehicle that did not stand level, or values of nothing.

    Parameters
    ----------
    accel, gyro
        Mean at rest, m/s^2 without gravity and rad/s, FRD.
    more
        Other parameters of the alignment. Without ``samples=0`` the estimator aligns itself, and
        takes the calibration where the log does not begin at rest.

    """
    if not (max(map(abs, accel)) <= LARGEST_BIAS and max(map(abs, gyro)) <= LARGEST_RATE):
        return {}
    return {**more, 'gyro_bias': gyro, 'accel_bias': accel}


def _parameters(alignment: dict[str, Any]) -> dict[str, str]:
    """Return the parameter file of both estimators, which begin with the same alignment."""
    return estimator_parameters('rolling_spider', dict.fromkeys(
        ('kalman', 'joint'), {'alignment': alignment}) if alignment else {})


def _calibration(log: Log) -> dict[str, Any]:
    """Return it of a log, which begins when the motors start; its mean is of the rest before."""
    ax, ay, az, *gyro = log.signals['sensordataCalib_datout'][0][:6].tolist()
    return _alignment([ax, ay, az + GRAVITY], gyro, samples=0)


def _metadata(log: Log, flow_scale: float) -> dict[str, dict[str, str]]:
    calibration = log.signals['sensordataCalib_datout'][0].tolist()

    def text(*values: float) -> str:
        return ' '.join(f'{value:.9g}' for value in values)

    return provenance(log.name, log.sha256, 'import_minidrone', 'Parrot minidrone rt_yout', {
        'steps': len(log), 'step_seconds': '0.005', 'flow_scale_rad_per_s': flow_scale,
        'flow_stamps': 'as logged, some 0.09 s behind the motion',
        'sonar_valid_m': text(*SONAR_RANGE),
        'calibration_accel_flu': text(*flip_vector(tuple(calibration[:3]))),
        'calibration_gyro_flu': text(*flip_vector(tuple(calibration[3:6]))),
        'calibration_pressure_pa': text(calibration[6]),
        'calibration_note': 'mean at rest before the flight; subtracted by the onboard estimator, '
                            'which takes the ground for level; not subtracted in this bag'})


def import_minidrone(
    source: Path, target: Path, flow_scale: float | None = None, names: Path | None = None,
    gyro_unit: str = 'auto',
) -> tuple[dict[str, int], list[str]]:
    """
    Write a bag from a minidrone log.

    Parameters
    ----------
    source
        mat file with ``rt_yout``, or of a Simulink model.
    target
        Directory to make.
    flow_scale
        rad/s for a flow of 1; default: 20 in the units of the toolbox, else 1.
    names
        File that says what the variables of a Simulink model hold, see :mod:`.simulink_names`.
    gyro_unit
        Of the log of a Simulink model: ``rad/s``, ``deg/s`` or ``auto``.

    Returns
    -------
    {topic: messages}; what was decided and what was not used, one line each.

    Raises
    ------
    BagError
        If the log is not usable; nothing is written then.
    mambo_model.schema.ParameterError
        If the map of names does not fit the log.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    file = read_source(source)
    found = variables(source, file.content)
    if is_package_log(found, names is not None):
        return _import_package(file, target, read_package_log(
            source, found, names, gyro_unit, flow_scale))
    refuse_options(source, {'map': names is not None, 'gyro-unit': gyro_unit != 'auto'},
                   'this is a log of the toolbox, whose names and units are known')
    log, scale = read_log(file, found), flow_scale or FLOW_SCALE
    with BagWriter(target, attachments=_parameters(_calibration(log)),
                   metadata=_metadata(log, scale)) as writer:
        out = Publisher(writer, TOPICS)
        _publish_imu(log, out)
        _publish_slow_sensors(log, out, scale)
        _publish_onboard(log, out)
        _publish_battery(log, out)
    return writer.counts, (sensor_doubts(log, scale) + onboard_doubts(log)
                           + bag_doubts.imported(target, from_floor=True) + unused(log.ignored))


def _import_package(
    source: Source, target: Path, log: PackageLog,
) -> tuple[dict[str, int], list[str]]:
    """Write a bag from the log of a Simulink model."""
    notes, alignment = list(log.notes), {}
    if log.calibration is not None:
        ax, ay, az, *gyro = log.calibration.tolist()
        az += GRAVITY if az < -0.5 * GRAVITY else 0.0  # with gravity in some versions
        alignment = _alignment([ax, ay, az], gyro)
        notes += [] if alignment else [
            'the calibration in the log is no bias of a level vehicle: not used']
    record = provenance(
        source.path.name, source.sha256, 'import_minidrone', 'RSdata.mat of Simulink',
        {'ignored': ', '.join(log.ignored) or 'nothing', 'decided': '; '.join(notes) or 'nothing'})
    with BagWriter(target, attachments=_parameters(alignment), metadata=record) as writer:
        publish(log, Publisher(writer, log.topics), SONAR_RANGE, FULL_QUALITY)
    return writer.counts, (notes + bag_doubts.imported(target, from_floor=True)
                           + unused(log.ignored))


def parser() -> Parser:
    """Return the command line."""
    out = importer_parser('import_minidrone', __doc__, 'log', 'mat file of a flight')
    out.add_argument('--flow-scale', type=real(0.0, 1e4, 'rad/s', above=True),
                     metavar='RAD_PER_S',
                     help='rad/s for a logged optical flow of 1 (default: 20 for the units of '
                          "the toolbox, 1 for those of the later package's signals)")
    out.add_argument('--map', type=Path, metavar='FILE', dest='names',
                     help='YAML file of what variables of other names hold, for example '
                          'accel_y: rx_a_y')
    out.add_argument('--gyro-unit', choices=('auto', 'rad/s', 'deg/s'), default='auto',
                     help='of a Simulink log (default: %(default)s, by the tilt that it gives)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``import_minidrone``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        counts, notes = import_minidrone(
            options.log, options.output, options.flow_scale, options.names, options.gyro_unit)
        report(options.log, options.output, counts, *notes)

    return guard('import_minidrone', work)


if __name__ == '__main__':
    raise SystemExit(main())
