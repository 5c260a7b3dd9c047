"""Raw sensor samples of a bag or of a Parrot log, in body FRD."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag, read_bag
from mambo_signals import stamps
import numpy as np
from numpy.typing import NDArray

from ..importers.common import ONLY_CHANGES, read_source, Source
from ..importers.mat_file import variables
from ..importers.minidrone import FLOW_SCALE, new_samples, read_log, STEP_NS

Array = NDArray[np.float64]
STEP = STEP_NS * 1e-9
TOPICS = ('imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure', 'motor_pwm')
FLU_TO_FRD = np.array([1.0, -1.0, -1.0])


class Stream(NamedTuple):
    """The samples of one sensor."""

    t: Array       # (n,) s, not decreasing
    values: Array  # (n,) or (n, k); NaN: the sensor said that it has no value


@dataclass(frozen=True)
class Recording:
    """
    Sensor samples, in body FRD and SI units; None for a missing sensor.

    Attributes
    ----------
    name
        Of the file.
    gyro, accel : (n, 3) rad/s, m/s^2
    sonar : (n,) m; flow : (n, 2) rad/s with the vehicle's sign; barometer : (n,) Pa
    pwm : (n, 4)
    held
        Only new values could be told from held ones: a repeated value is not there.
    changes
        Topics of which the import published only changes.

    """

    name: str
    gyro: Stream | None = None
    accel: Stream | None = None
    sonar: Stream | None = None
    flow: Stream | None = None
    barometer: Stream | None = None
    pwm: Stream | None = None
    held: bool = False
    changes: frozenset[str] = frozenset()


def _resting(path: Path, noise: Any) -> Recording:
    """Return the bench recording of a resting IMU: acceleration and rate each 5 ms, (n, 6)."""
    if not isinstance(noise, np.ndarray) or noise.dtype.kind not in 'fiu':
        raise BagError(f'{path}: noisedata is no matrix of numbers')
    values = noise.astype(float)
    if values.ndim != 2 or values.shape[1] != 6 or not np.isfinite(values).all():
        raise BagError(f'{path}: noisedata has the shape {values.shape}, or values that are not '
                       'finite; expected (n, 6)')
    t = np.arange(len(values)) * STEP
    return Recording(path.name, Stream(t, values[:, 3:]), Stream(t, values[:, :3]))


def _changes(signal: Array) -> Stream:
    """Return the new values of a held signal, with the first one."""
    steps = np.r_[0, new_samples(signal)]
    return Stream(steps * STEP, signal[steps])


def _flight(source: Source, found: dict[str, Any]) -> Recording:
    """
    Return a minidrone log; see :mod:`mambo_analysis.importers.minidrone` for its signals.

    The gyro is ``pa, qa, ra``: of the rates of the onboard estimate, ``pb, qb, rb``, the last is
    filtered.
    """
    log = read_log(source, found)
    t = np.arange(len(log)) * STEP
    sonar = _changes(log.signals['altitude_sonarb'])
    flow = _changes(log.signals['opticalFlow_datout'][:, :2])
    seen = flow.values.any(axis=1)
    return Recording(
        source.path.name, Stream(t, log.columns('pa', 'qa', 'ra')),
        Stream(t, log.columns('ddxb', 'ddyb', 'ddzb')),
        Stream(sonar.t, np.where(sonar.values > 0.0, sonar.values, np.nan)),
        Stream(flow.t[seen], FLOW_SCALE * flow.values[seen]), _changes(log.signals['prsb']),
        Stream(t, np.abs(log.signals['motors_refout'])), held=True)


def _stream(bag: Bag, topic: str, read: Callable) -> Stream | None:
    """Return a topic as a stream in the order of its stamps; None if the bag does not have it."""
    if topic not in bag:
        return None
    messages = bag[topic]
    try:
        values = np.asarray(read(messages), float)
    except AttributeError as error:
        raise BagError(f'{bag.path}: {error}') from None
    t, first = np.unique(messages.t, return_index=True)  # in order, a repeated stamp once
    return Stream(t, values[first])


def _bag(path: Path, namespace: str | None) -> Recording:
    """Return the sensor samples and commands of a bag, in FRD."""
    bag = read_bag(path, TOPICS, namespace)
    stamps.refuse_wrong(bag, TOPICS)
    stamps.refuse_mixed(bag)

    def flow(m):
        rates = np.stack([m.rate_x, -m.rate_y], axis=1).astype(float)
        return np.where((m.quality > 0)[:, None], rates, np.nan)

    def sonar(m):
        return np.where((m.range > 0.0) & np.isfinite(m.range), m.range, np.nan)

    def inertial(m):
        return np.hstack([m.angular_velocity * FLU_TO_FRD, m.acceleration * FLU_TO_FRD])

    imu = _stream(bag, TOPICS[0], inertial)
    gyro = accel = None
    if imu is not None:
        whole = np.isfinite(imu.values).all(axis=1)
        gyro = Stream(imu.t[whole], imu.values[whole, :3])
        accel = Stream(imu.t[whole], imu.values[whole, 3:])
    record = bag.metadata.get('import', {})
    found = Recording(
        path.name, gyro, accel, _stream(bag, 'sonar/range', sonar),
        _stream(bag, 'optical_flow', flow),
        _stream(bag, 'barometer/pressure', lambda m: m.pressure),
        _stream(bag, 'motor_pwm', lambda m: m.pwm),
        held='minidrone' in record.get('source_kind', ''),
        changes=frozenset(filter(None, record.get(ONLY_CHANGES, '').split(', '))))
    if not any((found.gyro, found.sonar, found.flow, found.barometer)):
        raise BagError(f'{path}: no sensor in it; wanted one of {", ".join(TOPICS[:4])}, it has '
                       f'{", ".join(sorted(bag.topics))}')
    return found


def read_sensors(path: Path, namespace: str | None = None) -> Recording:
    """
    Read the sensors of a bag, of a minidrone log (``rt_yout``) or of ``noisedata.mat``.

    Raises
    ------
    BagError
        If the file is none of these, damaged, or without any sensor.

    """
    if path.suffix != '.mat' or path.is_dir():
        return _bag(path, namespace)
    source = read_source(path)
    found = variables(path, source.content)
    if 'noisedata' in found:
        return _resting(path, found['noisedata'])
    return _flight(source, found)
