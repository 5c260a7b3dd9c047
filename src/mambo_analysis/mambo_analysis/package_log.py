"""
Logs of Simulink models on a Mambo: ``RSdata.mat`` of MathWorks's minidrone support package.

Such a file holds ``rt_tout``, the model's outputs ``rt_yout`` (blocks ``Actuators`` and ``Flag``,
the last 1000 steps alone) and a structure with time for each To Workspace block, named ``rt_``
and what the user called the block. Known here are the names of the package's own templates, as
public flights and the scripts that read them show:

=================================  ============================================================
``rt_estim``, ``rt_estimatedStates``  x y z, yaw pitch roll, dx dy dz, p q r and maybe more
``rt_motor``, ``rt_motors``        four motor commands, signs + - + -
``rt_sensor``                      accelerometer, gyro and maybe more
``rt_ref``, ``rt_References``      x y z, yaw pitch roll and maybe more
=================================  ============================================================

All in NED and FRD; the velocity is that in body axes. Other variables are named in the bag's
metadata and left out: nothing says what they hold.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path
from typing import Any

from mambo_model.frames import flip_vector, wire_quaternion
from mambo_model.quaternion import from_euler
import numpy as np
from numpy.typing import NDArray

from .importing import Publisher, stamps_ns
from .mcap_file import BagError

Floats = NDArray[np.float64]
STEP = 0.005  # [s]
MOTOR_SIGNS = (1.0, -1.0, 1.0, -1.0)
NAMES = {
    'estimate': ('rt_estim', 'rt_estimatedStates'), 'motors': ('rt_motor', 'rt_motors'),
    'sensor': ('rt_sensor',), 'reference': ('rt_ref', 'rt_References')}
WIDTHS = {'estimate': 12, 'motors': 4, 'sensor': 6, 'reference': 6}
TOPICS = {
    'estimate': ('onboard/odom', 'nav_msgs/msg/Odometry'),
    'motors': ('motor_pwm', 'mambo_interfaces/msg/MotorPwm'),
    'sensor': ('imu/data_raw', 'sensor_msgs/msg/Imu'),
    'reference': ('onboard/reference', 'geometry_msgs/msg/PoseStamped')}


@dataclasses.dataclass(frozen=True)
class PackageLog:
    """
    The known parts of a log, unchanged.

    Attributes
    ----------
    parts
        {estimate, motors, sensor or reference: (times (n,) s, values (n, k))}, NED/FRD, SI.
    ignored
        Names of the other variables.

    """

    parts: dict[str, tuple[Floats, Floats]]
    ignored: list[str]

    @property
    def topics(self) -> dict[str, str]:
        """Return {topic: type} of what is there."""
        return dict(TOPICS[part] for part in self.parts)


def is_package_log(variables: Mapping[str, Any]) -> bool:
    """Return whether a mat file's variables are those of a Simulink model on a drone."""
    blocks = {name.split('/')[-1] for name, _ in _outputs(variables)}
    known = {name for names in NAMES.values() for name in names}
    return 'Actuators' in blocks or ('rt_tout' in variables and 'rt_yout' not in variables) or (
        bool(known & set(variables)))


def _outputs(variables: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return block name and values of each signal of rt_yout."""
    found = variables.get('rt_yout')
    if not isinstance(found, dict):
        return []
    entries = np.atleast_1d(np.asarray(found.get('signals', []), object))
    return [(str(entry.get('blockName', '')), entry.get('values'))
            for entry in entries if isinstance(entry, dict)]


def _part(path: Path, name: str, time: Any, values: Any, width: int) -> tuple[Floats, Floats]:
    """Return one checked signal and its times."""
    try:
        t, v = np.asarray(time, float).reshape(-1), np.asarray(values, float)
    except (TypeError, ValueError):
        raise BagError(f'{path}: {name} holds what is no number') from None
    if v.ndim != 2 or len(v) != len(t) or v.shape[1] < width:
        raise BagError(f'{path}: {name} has the shape {v.shape}, expected ({len(t)}, {width}) or '
                       'wider')
    if len(t) < 2 or not np.allclose(np.diff(t), STEP, rtol=0.0, atol=1e-6) or t[0] < 0.0:
        raise BagError(f'{path}: the steps of {name} are not 5 ms each')
    v = np.ascontiguousarray(v[:, :width])
    if not np.isfinite(v).all():
        raise BagError(f'{path}: {name} has values that are not finite')
    return t, v


def read_package_log(path: Path, variables: Mapping[str, Any]) -> PackageLog:
    """
    Return the known parts of a mat file's variables.

    Raises
    ------
    BagError
        If nothing is known, or a known variable is malformed.

    """
    parts = {}
    for part, names in NAMES.items():
        name = next((name for name in names if name in variables), None)
        if name is None:
            continue
        found = variables[name]
        signal = found.get('signals') if isinstance(found, dict) else None
        if not isinstance(signal, dict) or 'time' not in found or 'values' not in signal:
            raise BagError(f'{path}: {name} is no structure with time and one signal')
        parts[part] = _part(path, name, found['time'], signal['values'], WIDTHS[part])
    for block, values in _outputs(variables):
        if block.split('/')[-1] == 'Actuators' and 'motors' not in parts:
            parts['motors'] = _part(
                path, block, variables['rt_yout'].get('time'), values, WIDTHS['motors'])
    known = {name for names in NAMES.values() for name in names} | {'rt_tout', 'rt_yout'}
    ignored = sorted(name for name in variables
                     if name.startswith('rt_') and name not in known)
    if not parts:
        raise BagError(
            f'{path}: a log of a Simulink model without a variable whose meaning is known '
            f'({", ".join(name for names in NAMES.values() for name in names)}); it has '
            f'{", ".join(ignored) or "none"}')
    if 'motors' in parts and (parts['motors'][1] * MOTOR_SIGNS < 0.0).any():
        raise BagError(f'{path}: the motor commands have not the signs + - + - of a minidrone')
    return PackageLog(parts, ignored)


def publish(log: PackageLog, out: Publisher) -> None:
    """Write the messages of a log."""
    for part, (times, values) in log.parts.items():
        topic, _ = TOPICS[part]
        for stamp, row in zip(stamps_ns(times).tolist(), values.tolist()):
            if part == 'motors':
                out.publish(topic, stamp, '', pwm=np.abs(row))
            elif part == 'sensor':
                out.publish(topic, stamp, 'base_link', **out.imu(
                    flip_vector(tuple(row[3:6])), flip_vector(tuple(row[:3]))))
            else:
                pose = _pose(out, row)
                if part == 'reference':
                    out.publish(topic, stamp, 'odom', pose=pose)
                else:
                    out.publish(topic, stamp, 'odom', **out.odometry(
                        pose, flip_vector(tuple(row[6:9])), flip_vector(tuple(row[9:12]))))


def _pose(out: Publisher, row: list[float]) -> Any:
    """Return x y z, yaw pitch roll in NED as a pose with z up."""
    yaw, pitch, roll = row[3:6]
    return out.pose(flip_vector(tuple(row[:3])), wire_quaternion(from_euler(roll, pitch, yaw)))
