r"""
Optical flow of a flat floor: the projective model (2.17)-(2.20) and the sensor built on it.

The camera looks along b3, its axes are the body axes. An image moves against the vehicle; the
sensor delivers the rate with the vehicle's sign and without the part due to rotation:

.. math:: flow = -\frac{OF}{f_1} + [-\omega_2, \omega_1] = \frac{[\nu_1, \nu_2]}{Z}, \quad
          Z = \frac{h}{\cos\phi \cos\theta}

divided by a factor Q(h) that depends on the height, so that ``h Q(h) flow`` is the velocity. The
other ways in which the sensor may be wrong are switches, zero by default. What belongs to the
estimator (tilt ignored, velocity not rotated) is not here.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import exp
from mambo_model.arithmetic.normal import standard_normal
from mambo_model.arithmetic.trigonometry import cos
from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import Vec3
from mambo_model.schema import choice, ParameterError, quantity
from mambo_model.values import derived, Parameters, values_type
from numpy.random import Generator

from .sampling import clamp, due_in_bursts, period_ns, STEP, tilt_cosine

Vec2 = tuple[float, float]

DELAY_TICKS = 30  # longest delay, 0.15 s

FACTOR_LAWS = ('linear', 'exponential')
FACTOR_LINEAR, FACTOR_EXPONENTIAL = range(len(FACTOR_LAWS))


@jit
def project(point: Vec3, f1: float) -> Vec2:
    """Return where a point, (3,) m in camera axes, Z > 0, is seen, (2,) in units of f1 (2.17)."""
    return (f1 * point[0] / point[2], f1 * point[1] / point[2])


@jit
def image_flow(point: Vec3, V: Vec3, omega: Vec3, f1: float) -> Vec2:
    """
    Return the motion in the image of a point at rest, (2,) units of f1 per s (2.18)-(2.20).

    Parameters
    ----------
    point : (3,) m, camera axes (x forward, y right, z along the optical axis)
        Where the point is, Z > 0.
    V, omega : (3,) m/s, (3,) rad/s, camera axes
        Velocity and rate of the camera, not of the point.
    f1
        Focal length; the unit of image coordinates (1: tangent of the viewing angle).

    """
    x, y = project(point, f1)
    Z = point[2]
    return (
        (-f1 * V[0] + x * V[2]) / Z
        + x * y / f1 * omega[0] - (f1 + x * x / f1) * omega[1] + y * omega[2],
        (-f1 * V[1] + y * V[2]) / Z
        + (f1 + y * y / f1) * omega[0] - x * y / f1 * omega[1] - x * omega[2])


class FlowMemory(NamedTuple):
    """Memory of the sensor."""

    heights: tuple[float, ...]  # (31,) m, oldest first, the last one now; NaN: unknown
    x: tuple[float, ...]        # (31,) rad/s, rates along x, in the order of heights; NaN: none
    y: tuple[float, ...]        # (31,) rad/s, likewise


class FlowSample(NamedTuple):
    """Output of the sensor at one tick."""

    new: bool     # there is one at this tick
    rate: Vec2    # (2,) rad/s along body x forward, y right, the vehicle's sign; NaN: no value
    quality: int  # 0 ... 255; 0 if not new


_UNKNOWN = (math.nan,) * (DELAY_TICKS + 1)
START = FlowMemory(_UNKNOWN, _UNKNOWN, _UNKNOWN)


@dataclass(frozen=True)
class OpticalFlowParams(Parameters):
    """
    Rate, noise, factor and switchable errors of the optical flow sensor.

    The letters are those of the hypotheses for the drift of the estimate: A factor over height,
    B ``height_delay``, H ``height_offset`` (the sensor scales its rate by a height that is
    late or wrong), D1 ``leakage`` 1 and D2 ``leakage`` -1, E ``vertical_coupling``,
    F ``nonlinearity``, I a constant factor (``factor_slope`` 0) other than the estimator's.
    """

    rate: float = quantity(
        32.0, 'Hz', 1.0, 200.0,
        'new value each 6.3 steps of 5 ms, mean of 8 free flights of RollingSpiderEdu')
    noise: float = quantity(
        0.015, 'rad/s', 0.0, 10.0,
        'second differences over sqrt(6), robust, of the cleanest of these: 4.1e-4 rad in 28 ms')
    burst: int = quantity(
        15, '1', 1, 1000,
        'values from pause to pause, median of each of 12 recordings (identify_sensors)')
    pause: float = quantity(
        0.0, 's', 0.0, 10.0,
        'design choice: 0, none; medians of 12 recordings 0.085 to 0.13 s (identify_sensors)')
    texture: float = quantity(
        1.0, '1', 0.01, 1.0, 'design choice: scales quality, divides into the noise')
    dropout: float = quantity(
        0.0, '1', 0.0, 1.0, 'failed measurements, quality 0; none but at the start of recordings')
    texture_dropout: float = quantity(
        0.0, '1', 0.0, 1.0,
        'times 1 - texture: more failures; none in 18 s over a bad texture (data_5b_badtexture)')
    latency: float = quantity(
        0.0, 's', 0.0, DELAY_TICKS * STEP,
        'whole steps of 5 ms; design choice, as that of the Mambo is unknown; 0.12 s in the '
        'flights of its predecessor (identify_sensors)')
    min_height: float = quantity(
        0.4, 'm', 0.0, 5.0, 'thesis sec. 5.2: no flow below; no value there')
    max_tilt: float = quantity(1.0, 'rad', 0.1, 1.5, 'assumed; no value beyond')
    factor_law: str = choice(
        'linear', FACTOR_LAWS, 'Q = offset + slope h (C.2b), or offset + slope exp(h) (C.2a)')
    factor_offset: float = quantity(0.92, '1', 0.1, 10.0, '(C.2b); 0.95 in (C.2a)')
    factor_slope: float = quantity(0.07, '1/m', -1.0, 1.0, '(C.2b); 0.011 (no unit) in (C.2a)')
    factor_low: float = quantity(0.5, 'm', 0.0, 10.0, 'Q is constant below, thesis sec. 5.4')
    factor_high: float = quantity(2.5, 'm', 0.0, 20.0, 'Q is constant above, thesis sec. 5.4')
    leakage: float = quantity(
        0.0, '1', -2.0, 2.0, 'share of the rotational part of (2.20) left in; unknown')
    nonlinearity: float = quantity(
        0.0, 's^2', -10.0, 10.0, 'c of rate (1 + c rate^2), each axis; unknown')
    vertical_coupling: Vec2 = quantity(
        (0.0, 0.0), '1', -1.0, 1.0, 'x/f1, y/f1 of (2.19): image centre off the axis; unknown')
    height_offset: float = quantity(0.0, 'm', -1.0, 1.0, 'unknown')
    height_delay: float = quantity(0.0, 's', 0.0, DELAY_TICKS * STEP, 'unknown')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.factor_low > self.factor_high:
            raise ParameterError(
                f'factor_low = {self.factor_low:g} m must not exceed '
                f'factor_high = {self.factor_high:g} m')
        curve = exp if self.factor_law == 'exponential' else float
        lowest = min(
            self.factor_offset + self.factor_slope * curve(h)
            for h in (self.factor_low, self.factor_high))
        if lowest < 0.1:
            raise ParameterError(
                f'factor_slope = {self.factor_slope:g} makes the factor '
                f'{lowest:.3g} between factor_low and factor_high; it must stay above 0.1')

    @derived('ns', 'rate')
    def period(self) -> int:
        """Time between samples."""
        return period_ns(self.rate)

    @derived('ns', 'pause')
    def pause_ns(self) -> int:
        """Time from the last sample of a burst to the next one, at least the period."""
        return max(round(self.pause * 1e9), self.period())

    @derived('-', 'dropout', 'texture_dropout')
    def failure(self) -> float:
        """Probability of a failed measurement over this texture."""
        return min(self.dropout + self.texture_dropout * (1.0 - self.texture), 1.0)

    @derived('ticks', 'latency')
    def latency_ticks(self) -> int:
        """Delay of the samples."""
        return round(self.latency / STEP)

    @derived('-', 'max_tilt')
    def min_cosine(self) -> float:
        """Cosine of the largest tilt with a value."""
        return cos(self.max_tilt)

    @derived('ticks', 'height_delay')
    def height_ticks(self) -> float:
        """Delay of the height by which the sensor scales its rate."""
        return self.height_delay / STEP


FlowValues = values_type(OpticalFlowParams)


@jit
def true_factor(height: float, p: FlowValues) -> float:
    """Return Q(h) of the sensor at a height in m: the velocity is ``h Q(h)`` times its rate."""
    h = clamp(height, p.factor_low, p.factor_high)
    if p.factor_law == FACTOR_EXPONENTIAL:
        return p.factor_offset + p.factor_slope * exp(h)
    return p.factor_offset + p.factor_slope * h


@jit
def deliver(body: State, believed_height: float, p: FlowValues) -> Vec2:
    """
    Return the output of the sensor without noise, (2,) rad/s, body x forward and y right.

    Parameters
    ----------
    body
        True state, above the floor.
    believed_height : m
        Height by which the sensor scales its rate: the true one unless it lags or is off.
    p
        From :meth:`OpticalFlowParams.values`.

    """
    nu, omega = body.nu, body.omega
    h = -body.rho[2]
    Z = h / tilt_cosine(body.q)
    x = (nu[0] - p.vertical_coupling[0] * nu[2]) / Z + p.leakage * omega[1]
    y = (nu[1] - p.vertical_coupling[1] * nu[2]) / Z - p.leakage * omega[0]
    scaling = believed_height / h / true_factor(h, p)
    return (
        scaling * x * (1.0 + p.nonlinearity * x * x), scaling * y * (1.0 + p.nonlinearity * y * y))


@jit
def _delayed_height(memory: FlowMemory, ticks: float) -> float:
    """
    Return the height in m some ticks ago, 0 ... 30, linearly between ticks.

    Before the first tick the vehicle counts as where it is now.
    """
    whole = int(ticks)
    late = memory.heights[DELAY_TICKS - whole]
    early = memory.heights[max(DELAY_TICKS - whole - 1, 0)]
    if math.isnan(early):
        return memory.heights[DELAY_TICKS]
    return late + (ticks - whole) * (early - late)


@jit
def _see(memory: FlowMemory, body: State, p: FlowValues) -> Vec2:
    """Return the current rates, (2,) rad/s; NaN near the floor or tilted too far."""
    h = -body.rho[2]
    if h < p.min_height or tilt_cosine(body.q) < p.min_cosine:
        return (math.nan, math.nan)
    believed = h
    if p.height_ticks > 0.0:
        believed = _delayed_height(memory, p.height_ticks)
    return deliver(body, believed + p.height_offset, p)


@jit_inside
def step(
    memory: FlowMemory, tick: int, body: State, rng: Generator, noise: bool, p: FlowValues,
) -> tuple[FlowMemory, FlowSample]:
    """
    Take a sample if one is due; to be called once per tick.

    Below ``min_height``, beyond ``max_tilt`` and where the measurement fails, a sample comes with
    quality 0 and NaN rates.

    Parameters
    ----------
    memory
        Result of the previous call; ``START`` at first.
    tick : 5 ms
        Number of the control step.
    body
        True state.
    rng
        The generator of this sensor.
    noise
        False: no noise, no failures, and nothing drawn.
    p
        From :meth:`OpticalFlowParams.values`.

    """
    if p.height_ticks > 0.0:
        memory = FlowMemory(memory.heights[1:] + (-body.rho[2],), memory.x, memory.y)
    if p.latency_ticks > 0:
        x, y = _see(memory, body, p)
        memory = FlowMemory(memory.heights, memory.x[1:] + (x,), memory.y[1:] + (y,))
    if not due_in_bursts(tick, p.period, p.burst, p.pause_ns):
        return memory, FlowSample(False, (math.nan, math.nan), 0)
    error_x, error_y, failed = 0.0, 0.0, False
    if noise:
        sigma = p.noise / p.texture
        error_x, error_y = sigma * standard_normal(rng), sigma * standard_normal(rng)
        if p.failure > 0.0:
            failed = rng.random() < p.failure
    if p.latency_ticks > 0:
        x, y = memory.x[DELAY_TICKS - p.latency_ticks], memory.y[DELAY_TICKS - p.latency_ticks]
    else:
        x, y = _see(memory, body, p)
    if failed or math.isnan(x):
        return memory, FlowSample(True, (math.nan, math.nan), 0)
    return memory, FlowSample(
        True, (x + error_x, y + error_y), int(math.floor(255.0 * p.texture + 0.5)))
