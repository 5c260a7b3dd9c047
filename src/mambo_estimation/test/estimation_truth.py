"""
Independent truth for the estimator's tests: paths, inertial sensors and their defects.

A path is a quintic spline, so position, velocity and acceleration belong together exactly. The
attitude is chosen (along the thrust, or level in the hand, and any yaw), the specific force is
what the accelerometer then must read, R^T (a - g e_3), whatever forces are at work; the body rate
is a central difference of scipy rotations. Nothing here comes from the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from mambo_estimation import filters, kalman
from mambo_model.compiled import jit
import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

G = 9.81
DT = 0.005
NAN = float('nan')


def ramp(t, start, length):
    """Return a smooth step from 0 to 1 (derivatives up to the fourth vanish at both ends)."""
    x = np.clip((np.asarray(t) - start) / length, 0.0, 1.0)
    return x ** 5 * (126 - 420 * x + 540 * x ** 2 - 315 * x ** 3 + 70 * x ** 4)


def circle(rate=1.0, radius=1.0, height=1.5, takeoff=1.0):
    """Take off, circle from 5 s on: (5.3) at rate 1."""
    return lambda t: np.stack([
        radius * ramp(t, 5, 3) * np.cos(rate * t), radius * ramp(t, 5, 3) * np.sin(rate * t),
        -height * ramp(t, takeoff, 3)], axis=-1)


def vertical_circle(rate=1.0, radius=1.0, height=1.5):
    """Take off at 1 s, then circle in the x-z plane from 5 s on: (C.4) at radius 1, rate 1."""
    return lambda t: np.stack([
        radius * ramp(t, 5, 3) * np.cos(rate * t), 0.0 * t,
        -height * ramp(t, 1, 3) - radius * ramp(t, 5, 3) * np.sin(rate * t)], axis=-1)


def hover(height=1.5, takeoff=1.0):
    """Take off and hold still."""
    return lambda t: np.stack([0.0 * t, 0.0 * t, -height * ramp(t, takeoff, 3)], axis=-1)


@dataclass(frozen=True)
class Truth:
    """A flight: (N,) times and (N, 3) vectors, NED and FRD."""

    t: np.ndarray
    p: np.ndarray
    v: np.ndarray
    a: np.ndarray
    R: Rotation
    omega: np.ndarray

    @property
    def height(self):
        return -self.p[:, 2]

    @property
    def tilt_cos(self):
        return self.R.as_matrix()[:, 2, 2]

    @property
    def nu(self):
        return self.R.inv().apply(self.v)

    @property
    def specific_force(self):
        return self.R.inv().apply(self.a - [0.0, 0.0, G])


def _thrust_attitude(a, v, drag, yaw):
    b3 = np.array([0.0, 0.0, G]) - a - drag * v * [1.0, 1.0, 0.0]
    b3 /= np.linalg.norm(b3, axis=1, keepdims=True)
    x_c = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=-1)
    b2 = np.cross(b3, x_c)
    b2 /= np.linalg.norm(b2, axis=1, keepdims=True)
    return Rotation.from_matrix(np.stack([np.cross(b2, b3), b2, b3], axis=-1))


def fly(path, duration, attitude='thrust', drag=0.0, yaw=lambda t: 0.0 * t, dt=DT):
    """
    Return the truth of a path.

    Parameters
    ----------
    path
        (M,) times to (M, 3) positions, NED.
    duration : s
    attitude
        'thrust': body z against the thrust that the motion and drag need; 'level': R of the yaw
        alone, as in a hand; or a function of time giving a Rotation.
    drag : 1/s
        Horizontal deceleration per velocity that the thrust must balance.
    yaw
        Function of time, rad.
    dt : s
        Between samples.

    """
    knots = np.arange(-0.5, duration + 0.5, 0.02)
    spline = make_interp_spline(knots, path(knots), k=5)

    def attitude_at(t):
        if callable(attitude):
            return attitude(t)
        if attitude == 'level':
            return Rotation.from_euler('z', np.asarray(yaw(t))[:, None])
        return _thrust_attitude(spline(t, 2), spline(t, 1), drag, yaw(t))

    t = np.arange(0, round(duration / dt)) * dt
    eps = 1e-4  # the error of the central difference is eps^2 / 6 of the rate's 2nd derivative
    omega = (attitude_at(t - eps).inv() * attitude_at(t + eps)).as_rotvec() / (2 * eps)
    return Truth(t, spline(t), spline(t, 1), spline(t, 2), attitude_at(t), omega)


@dataclass(frozen=True)
class Noise:
    """Defects of the sensors; zeros make them perfect."""

    gyro: float = 0.0          # rad/s per sample
    accel: float = 0.0         # m/s^2 per sample
    sonar: float = 0.0         # m
    flow: float = 0.0          # rad/s
    pressure: float = 0.0      # Pa
    gyro_bias: tuple = (0.0, 0.0, 0.0)
    accel_bias: tuple = (0.0, 0.0, 0.0)
    scale: float = 1.06        # Q of the true sensor at 1.5 m
    slope: float = 0.0         # 1/m, dQ/dh
    leak: float = 0.0          # part of the rotational flow in the signal


QUIET = Noise()
TYPICAL = Noise(
    gyro=0.002, accel=0.05, sonar=0.01, flow=0.015, pressure=5.0, gyro_bias=(0.02, -0.01, 0.015),
    accel_bias=(0.3, -0.15, 0.4))


@dataclass
class Samples:
    """Sensor samples, one row per IMU sample; NaN: none."""

    dt: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    sonar: np.ndarray
    flow: np.ndarray
    quality: np.ndarray
    pressure: np.ndarray

    def copy(self):
        """Return a copy to be spoilt."""
        return replace(self, **{k: v.copy() for k, v in vars(self).items()})


def sense(truth, noise=QUIET, seed=0, flow_every=5, sonar_every=9, baro_every=3):
    """
    Return what the sensors read: flow at 40 Hz, sonar at 22 Hz, barometer at 67 Hz.

    The sonar reads 0.434 m where the floor is nearer, as the real one does.
    """
    rng = np.random.default_rng(seed)
    n = len(truth.t)
    h = truth.height
    slant = h / truth.tilt_cos
    gyro = truth.omega + noise.gyro_bias + noise.gyro * rng.standard_normal((n, 3))
    accel = truth.specific_force + noise.accel_bias + noise.accel * rng.standard_normal((n, 3))
    sonar = np.maximum(slant, 0.434) + noise.sonar * rng.standard_normal(n)
    factor = noise.scale + noise.slope * (h - 1.5)
    with np.errstate(divide='ignore', invalid='ignore'):
        flow = truth.nu[:, :2] / (np.maximum(slant, 1e-3) * factor)[:, None]
    flow = flow + noise.leak * np.stack([truth.omega[:, 1], -truth.omega[:, 0]], axis=-1)
    flow = flow + noise.flow * rng.standard_normal((n, 2))
    pressure = 101325.0 * (1 - (h + 120.0) / 44330.769) ** (1 / 0.19026312)
    pressure = pressure + noise.pressure * rng.standard_normal(n)
    k = np.arange(n)
    sonar[k % sonar_every != 3] = NAN
    flow[k % flow_every != 1] = NAN
    pressure[k % baro_every != 2] = NAN
    dt = np.full(n, DT if n < 2 else truth.t[1] - truth.t[0])
    dt[0] = 0.0
    return Samples(dt, gyro, accel, sonar, flow, np.full(n, 255), pressure)


@jit
def _store(row, e):
    k = 0
    for x in e.state.rho:
        row[k] = x
        k += 1
    for x in e.state.nu:
        row[k] = x
        k += 1
    for x in e.state.q:
        row[k] = x
        k += 1
    for x in e.state.omega:
        row[k] = x
        k += 1
    for x in e.pose_covariance:
        row[k] = x
        k += 1
    for x in e.twist_covariance:
        row[k] = x
        k += 1
    for x in e.gyro_bias:
        row[k] = x
        k += 1
    for x in e.accel_bias:
        row[k] = x
        k += 1
    for x in (float(e.status), e.height, e.vertical_velocity, e.barometer_offset,
              e.sonar_innovation, e.sonar_test_ratio, e.flow_innovation[0],
              e.flow_innovation[1], e.flow_test_ratio, e.barometer_innovation,
              e.barometer_test_ratio, float(e.sonar_refused), float(e.flow_refused),
              float(e.barometer_refused), float(e.invalid_samples)):
        row[k] = x
        k += 1
    for i in e.health.health:
        row[k] = float(i)
        k += 1
    for x in e.health.age:
        row[k] = x
        k += 1
    for i in e.health.not_finite:
        row[k] = float(i)
        k += 1


@jit
def run_rows(memory, dt, gyro, accel, sonar, flow, quality, pressure, values, out):
    """Run the estimator over all samples in one compiled loop; rows of ``out`` are estimates."""
    for k in range(dt.shape[0]):
        memory, e = filters.step(
            memory, dt[k], (gyro[k, 0], gyro[k, 1], gyro[k, 2]),
            (accel[k, 0], accel[k, 1], accel[k, 2]), sonar[k], (flow[k, 0], flow[k, 1]),
            quality[k], pressure[k], values)
        _store(out[k], e)
    return memory


class Run:
    """Estimates of a run as arrays, by name."""

    def __init__(self, rows, memory):
        self.rows, self.memory = rows, memory
        sizes = {
            'rho': 3, 'nu': 3, 'q': 4, 'omega': 3, 'pose_covariance': 36,
            'twist_covariance': 36, 'gyro_bias': 3, 'accel_bias': 3, 'status': 1, 'height': 1,
            'vertical_velocity': 1, 'barometer_offset': 1, 'sonar_innovation': 1,
            'sonar_test_ratio': 1, 'flow_innovation': 2, 'flow_test_ratio': 1,
            'barometer_innovation': 1, 'barometer_test_ratio': 1, 'sonar_refused': 1,
            'flow_refused': 1, 'barometer_refused': 1, 'invalid_samples': 1, 'health': 5,
            'age': 5, 'not_finite': 5}
        k = 0
        for name, size in sizes.items():
            column = rows[:, k:k + size]
            if size == 36:
                column = column.reshape(-1, 6, 6)
            setattr(self, name, column[:, 0] if size == 1 else column)
            k += size

    @property
    def R(self):
        return Rotation.from_quat(self.q[:, [1, 2, 3, 0]])

    def rotation_error(self, truth):
        """Return delta of R_true = exp(delta) R, (N, 3) rad, inertial axes."""
        return (truth.R * self.R.inv()).as_rotvec()

    def tilt_error(self, truth):
        """Return the angle between true and estimated vertical, (N,) rad."""
        a, b = truth.R.as_matrix()[:, 2], self.R.as_matrix()[:, 2]
        return np.linalg.norm(np.cross(a, b), axis=1)


COLUMNS = 13 + 2 * 36 + 6 + 15 + 15


def estimate(samples, params=None, memory=None):
    """Run the estimator over the samples; return a :class:`Run`."""
    params = params or kalman.EstimatorParams()
    s = samples
    out = np.empty((len(s.dt), COLUMNS))
    memory = run_rows(
        memory or filters.initial(params.values()), s.dt, s.gyro, s.accel, s.sonar, s.flow,
        s.quality.astype(np.int64), s.pressure, params.values(), out)
    return Run(out, memory)


@jit
def run_prior(memory, dt, gyro, accel, sonar, flow, quality, pressure, values, out, prior):
    """As :func:`run_rows`; rows of ``prior`` are the estimates without the aiding samples."""
    for k in range(dt.shape[0]):
        inertial = ((gyro[k, 0], gyro[k, 1], gyro[k, 2]), (accel[k, 0], accel[k, 1], accel[k, 2]))
        _, e = filters.step(
            memory, dt[k], inertial[0], inertial[1], NAN, (NAN, NAN), 0, NAN, values)
        _store(prior[k], e)
        memory, e = filters.step(
            memory, dt[k], inertial[0], inertial[1], sonar[k], (flow[k, 0], flow[k, 1]),
            quality[k], pressure[k], values)
        _store(out[k], e)
    return memory


def estimate_with_prior(samples, params):
    """Return the :class:`Run` over the samples, and that of each step without aiding samples."""
    s = samples
    out, prior = np.empty((len(s.dt), COLUMNS)), np.empty((len(s.dt), COLUMNS))
    memory = run_prior(
        filters.initial(params.values()), s.dt, s.gyro, s.accel, s.sonar, s.flow,
        s.quality.astype(np.int64), s.pressure, params.values(), out, prior)
    return Run(out, memory), Run(prior, memory)
