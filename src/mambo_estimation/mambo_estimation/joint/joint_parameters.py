"""Parameters of the joint filter, each with unit, range and source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mambo_model.schema import flag, group, quantity
from mambo_model.values import Parameters, values, values_type

from ..alignment import AlignmentParams
from ..capture.pose_parameters import AidedValues, PoseParams
from ..health import AgeParams
from ..measurements.barometer import BarometerParams
from ..measurements.imu import ImuParams
from ..measurements.sonar import SonarParams


@dataclass(frozen=True)
class MotionParams(Parameters):
    """Noise of the integrated inertial sensors, and initial uncertainties."""

    gyro_noise: float = quantity(
        5e-5, 'rad/sqrt(s)', 1e-7, 1.0,
        'density: Rolling Spider logs at rest; vibration does not accumulate')
    accel_noise: float = quantity(
        0.0013, 'm/s^2/sqrt(Hz)', 1e-5, 10.0,
        'density: 0.0011 to 0.0015, by axis, in Rolling Spider logs at rest; vibration does not '
        'accumulate')
    gyro_bias_walk: float = quantity(
        1.5e-5, 'rad/s/sqrt(s)', 0.0, 1.0, '1.5e-5 in Rolling Spider calibration values')
    accel_bias_walk: float = quantity(
        3.6e-4, 'm/s^2/sqrt(s)', 0.0, 1.0, 'Rolling Spider calibration values')
    held_gyro_noise: float = quantity(
        0.1, 'rad/sqrt(s)', 1e-7, 10.0,
        'density while a sample is missing: 0.3 rad/s wrong for 0.1 s')
    held_accel_noise: float = quantity(
        0.3, 'm/s^2/sqrt(Hz)', 1e-5, 100.0,
        'density while a sample is missing: 1 m/s^2 wrong for 0.1 s')
    held_thrust_noise: float = quantity(
        0.3, 'm/s^2/sqrt(Hz)', 0.0, 100.0,
        'more along the vertical meanwhile, by which the thrust changes: likewise')
    held_time: float = quantity(
        0.1, 's', 1e-3, 10.0,
        'time constant of rates and forces in controlled flight: autocorrelation in a flight of '
        'a Crazyflie')
    initial_tilt_std: float = quantity(
        0.1, 'rad', 1e-4, 1.5, 'tilt at start where the alignment failed')
    initial_yaw_std: float = quantity(
        1e-3, 'rad', 1e-6, 3.2, 'yaw is zero at start by definition')
    initial_gyro_bias_std: float = quantity(
        0.03, 'rad/s', 1e-6, 1.0,
        'bias where the alignment failed: 0.017 in calibration of 12 Rolling Spider flights')
    initial_velocity_std: float = quantity(
        1.0, 'm/s', 1e-3, 100.0, 'velocity where the alignment failed, or after a recovery')
    initial_height_std: float = quantity(
        0.005, 'm', 1e-4, 10.0, 'height at start: the vehicle stands on the floor')
    rate_noise: float = quantity(
        7e-4, 'rad/s', 1e-6, 10.0,
        'of one sample at rest, the least in the covariance of the body rate: Rolling Spider logs')
    lost_rate_growth: float = quantity(
        20.0, 'rad/s^2', 0.0, 1e4,
        'how fast the body rate becomes unknown without a gyro: a fifth of what the motors can do')
    floor_depth: float = quantity(
        0.1, 'm', 0.0, 10.0, 'no height is lower than this below the floor')


MotionValues = values_type(MotionParams)


@dataclass(frozen=True)
class FlowParams(Parameters):
    """Prior of the optical flow in the joint filter."""

    scale: float = quantity(1.06, '-', 0.1, 10.0, 'Q of (5.2), thesis sec. 5.4')
    scale_std: float = quantity(
        0.05, '-', 0.0, 1.0,
        'uncertainty of Q: 1.06 against 1.025 of (C.2b) at 1.5 m, and another sensor')
    slope: float = quantity(0.0, '1/m', -1.0, 1.0, 'dQ/dh: (5.2) has none')
    slope_std: float = quantity(
        0.07, '1/m', 0.0, 1.0, 'uncertainty of dQ/dh: 0.07 in (C.2b), 0.10 after its retuning')
    reference_height: float = quantity(
        1.5, 'm', 0.0, 10.0, 'where Q is that of `scale`: height of most flights of the thesis')
    factor_min_height: float = quantity(0.5, 'm', 0.0, 10.0, 'Q(h) is held below: not calibrated')
    factor_max_height: float = quantity(2.5, 'm', 0.0, 10.0, 'Q(h) is held above: not calibrated')
    scale_walk: float = quantity(
        3e-5, '1/sqrt(s)', 0.0, 1.0, 'change of Q, texture and light: judgement')
    excitation: float = quantity(
        4.0, 'sigma', 0.0, 100.0,
        'a slower motion, over its own deviation, calibrates nothing: it may be noise')
    latency: float = quantity(
        0.0, 's', 0.0, 0.25, 'of a sample behind its stamp, first guess; the filter corrects it')
    latency_std: float = quantity(
        0.05, 's', 0.0, 0.25, 'uncertainty: 0.12 in Rolling Spider logs, none known of the Mambo')
    rotation_leak: float = quantity(
        0.0, '-', -2.0, 2.0, 'share of the rotational flow in the signal, first guess')
    rotation_leak_std: float = quantity(
        0.0, '-', 0.0, 2.0, 'its uncertainty; on a level path it cannot be told from the scale')
    noise: float = quantity(
        0.015, 'rad/s', 1e-4, 10.0,
        'standard deviation of a sample, each axis: cleanest Rolling Spider flight')
    min_height: float = quantity(0.4, 'm', 0.01, 10.0, 'not used below, thesis sec. 5.2')
    max_rate: float = quantity(20.0, 'rad/s', 0.1, 1e3, 'no camera follows the ground faster')
    min_tilt_cos: float = quantity(
        0.7, '-', 0.1, 1.0, 'not used beyond 45 degrees of tilt')
    min_quality: int = quantity(1, '-', 0, 255, 'not used below; 0: no texture')
    gate: float = quantity(4.0, 'sigma', 1.0, 100.0, 'refuses 3e-4 of good samples (two axes)')
    recovery_time: float = quantity(
        0.5, 's', 0.0, 1e4, 'refusals that agree for so long mean that the filter is wrong')
    stuck_samples: int = quantity(
        8, '-', 0, 100000, 'so many equal rates but zero mean a dead sensor; 0: never')


FlowValues = values_type(FlowParams)


@dataclass(frozen=True)
class DragParams(Parameters):
    """Prior of the rotor drag in the joint filter."""

    enabled: bool = flag(
        True, 'the accelerometer reads drag, which tells its bias from a tilt; false: not used')
    coefficient: float = quantity(
        0.045, 's/m', 0.0, 1.0,
        'body x and y, over the specific force of the thrust: k_c/4 = 0.055 (3.13), 0.040 in 93 '
        'flights of a Crazyflie')
    coefficient_std: float = quantity(0.02, 's/m', 0.0, 1.0, 'uncertainty of both, as the source')
    noise: float = quantity(
        0.004, 'm/s^2', 1e-4, 10.0,
        'of a mean over `window`: vibration in Rolling Spider flights, 1.1, which is the '
        'difference of successive draws, over 200 samples, and some more')
    window: float = quantity(1.0, 's', 0.005, 10.0, 'over which the accelerometer is averaged')
    min_height: float = quantity(
        0.15, 'm', 0.0, 10.0, 'not used below: the floor may touch the vehicle')
    gate: float = quantity(4.0, 'sigma', 1.0, 100.0, 'refuses 3e-4 of good means (two axes)')


DragValues = values_type(DragParams)


@dataclass(frozen=True)
class RangeParams(SonarParams):
    """Sonar model of the joint filter: that of the altitude filter, and an offset."""

    noise: float = quantity(
        0.005, 'm', 1e-4, 1.0,
        'standard deviation of a slant range, cleanest Rolling Spider flight; more is found')
    offset_std: float = quantity(
        0.001, 'm', 0.0, 1.0, 'of a range of the sonar, constant: judgement')


RangeValues = values_type(RangeParams)


@dataclass(frozen=True)
class PressureParams(BarometerParams):
    """Barometer model of the joint filter: that of the altitude filter, but enabled."""

    enabled: bool = flag(True, 'bounds the height where the sonar sees no floor')


@dataclass(frozen=True)
class RestParams(AlignmentParams):
    """Alignment of the joint filter: that of the three, whose gyro bias does not walk."""

    gyro_bias_floor: float = quantity(
        3e-5, 'rad/s', 1e-7, 1.0,
        'the bias of a mean is not known better: lowest Allan deviation, sqrt(2 N K / sqrt(3)), '
        'of a gyro with N = `motion.gyro_noise` and K = `motion.gyro_bias_walk`')


@dataclass(frozen=True)
class JointParams(AgeParams):
    """Parameters of the joint filter: one group per sensor and per model."""

    alignment: AlignmentParams = group(RestParams)
    motion: MotionParams = group(MotionParams)
    imu: ImuParams = group(ImuParams)
    sonar: RangeParams = group(RangeParams)
    optical_flow: FlowParams = group(FlowParams)
    barometer: PressureParams = group(PressureParams)
    drag: DragParams = group(DragParams)
    pose: PoseParams = group(PoseParams)

    def values(self) -> Any:
        """Return what compiled code reads; with motion capture that of a filter that uses it."""
        own = values(self)
        return AidedValues(own, self.pose.values()) if self.pose.enabled else own


JointValues = values_type(JointParams, without=('pose',))
