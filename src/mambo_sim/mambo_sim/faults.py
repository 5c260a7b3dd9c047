"""
Sensor faults between sensing and delivery: wrong readings, and lost or delayed samples.

A reading may be NaN, infinite, stuck at the one before or wild; a sample may be missing, late,
repeated or out of order. Each sensor has one kind of its own, in a window of time, of all samples
or of a share of them. Without faults (None) the simulator draws no random numbers for them.

How a sample is delivered is one of ``DELIVERY_*``: one that is late or out of order reaches the
estimator after the step it belongs to. :class:`Outbox` delivers the messages accordingly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.vector import Vec3
from mambo_model.schema import choice, flag, group, quantity
from mambo_model.values import derived, Parameters, values_type
import numpy as np
from numpy.random import Generator

from .sensors.sampling import STEP

# Not nan and inf: a ROS parameter file would take them for numbers.
KINDS = ('none', 'not_a_number', 'infinite', 'stuck', 'wild', 'missing', 'late', 'repeated',
         'out_of_order')
NONE, NAN, INF, STUCK, WILD, MISSING, LATE, REPEATED, OUT_OF_ORDER = range(len(KINDS))
READINGS = KINDS[:MISSING]                # what happens to a value
DELIVERIES = ('none', *KINDS[MISSING:])   # what happens to a message

# Delivery of a sample: published in time, never, some time later, twice, after the next one.
DELIVERY_SENT, DELIVERY_LOST, DELIVERY_LATE, DELIVERY_TWICE, DELIVERY_HELD = range(5)

# Wild readings are spread evenly over what common sensors can read.
GYRO_SPAN = (-34.9, 34.9)      # rad/s, 2000 deg/s
ACCEL_SPAN = (-39.2, 39.2)     # m/s^2, 4 g
SONAR_SPAN = (0.434, 5.26)     # m, limits of the recordings
FLOW_SPAN = (-5.0, 5.0)        # rad/s
PRESSURE_SPAN = (9e4, 1.1e5)   # Pa

_NEW, _SOURCE = 'design choice', 'what goes wrong with it'


@dataclass(frozen=True)
class FaultParams(Parameters):
    """One fault of one sensor."""

    kind: str = choice('none', KINDS, _SOURCE)
    start: float = quantity(10.0, 's', 0.0, 86400.0, _NEW)
    duration: float = quantity(2.0, 's', 0.0, 86400.0, _NEW)
    share: float = quantity(1.0, '1', 0.0, 1.0, 'design choice: of the samples in this time')
    delay: float = quantity(0.1, 's', STEP, 1.0, 'design choice: of late samples')

    @derived('', 'kind')
    def code(self) -> int:
        """Index of the kind in KINDS."""
        return KINDS.index(self.kind)

    @derived('ticks', 'start')
    def first_tick(self) -> int:
        """Tick at which it begins."""
        return round(self.start / STEP)

    @derived('ticks', 'duration')
    def end_tick(self) -> int:
        """Tick at which it is over."""
        return round((self.start + self.duration) / STEP)

    @derived('ticks', 'delay')
    def delay_ticks(self) -> int:
        """Delay of late samples, at least 1."""
        return max(1, round(self.delay / STEP))


FaultValues = values_type(FaultParams)


@dataclass(frozen=True)
class ReadingFaultParams(FaultParams):
    """A fault of the readings of one half of the inertial sensors."""

    kind: str = choice('none', READINGS, _SOURCE)


@dataclass(frozen=True)
class DeliveryFaultParams(FaultParams):
    """A fault of the delivery of the inertial sensors, whose two halves are one message."""

    kind: str = choice('none', DELIVERIES, _SOURCE)


@dataclass(frozen=True)
class FaultsParams(Parameters):
    """Faults of all sensors."""

    gyro: ReadingFaultParams = group(ReadingFaultParams)
    accel: ReadingFaultParams = group(ReadingFaultParams)
    imu: DeliveryFaultParams = group(DeliveryFaultParams)
    sonar: FaultParams = group(FaultParams)
    optical_flow: FaultParams = group(FaultParams)
    barometer: FaultParams = group(FaultParams)
    changeable: bool = flag(
        False, 'whether the compiled step has faults even if none is set, so that one can be '
        'set in flight')

    def values(self) -> FaultsValues | None:
        """Return the values for compiled code; None without faults."""
        return super().values() if self.changeable or self.present() else None

    def present(self) -> list[str]:
        """Return the sensors that have a fault."""
        return [one for one in ('gyro', 'accel', 'imu', 'sonar', 'optical_flow', 'barometer')
                if getattr(self, one).kind != KINDS[NONE]]


FaultsValues = values_type(FaultsParams, without=('changeable',))


class FaultMemory(NamedTuple):
    """The last readings without fault, and which streams hold a sample back."""

    gyro: Vec3                       # (3,) rad/s, body FRD
    accel: Vec3                      # (3,) m/s^2, body FRD
    sonar: float                     # m
    flow: tuple[float, float, int]   # rad/s, body x forward and y right, quality
    pressure: float                  # Pa
    held: tuple[bool, bool, bool, bool]  # imu, sonar, optical flow, barometer


START = FaultMemory(
    (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), math.nan, (math.nan, math.nan, 0), math.nan,
    (False, False, False, False))


@jit
def _strikes(tick: int, rng: Generator, p: FaultValues) -> bool:
    """Return whether the sample of this tick is faulty."""
    if p.code == NONE or not p.first_tick <= tick < p.end_tick:
        return False
    return p.share >= 1.0 or rng.random() < p.share


@jit
def _wild(rng: Generator, span: tuple[float, float]) -> float:
    """Return a number anywhere in a span, unit of the span."""
    return span[0] + rng.random() * (span[1] - span[0])


@jit
def _reading(
    value: float, last: float, kind: int, rng: Generator, span: tuple[float, float],
) -> float:
    """Return the reading of a faulty sensor, unit of the value."""
    if kind == NAN:
        return math.nan
    if kind == INF:
        return math.inf
    if kind == STUCK:
        return last
    if kind == WILD:
        return _wild(rng, span)
    return value


@jit
def vector(
    value: Vec3, last: Vec3, tick: int, rng: Generator, p: FaultValues,
    span: tuple[float, float],
) -> tuple[Vec3, Vec3]:
    """Return the reading of a three-axis sensor, and its last reading without fault, (3,)."""
    if not _strikes(tick, rng, p):
        return value, value
    return (_reading(value[0], last[0], p.code, rng, span),
            _reading(value[1], last[1], p.code, rng, span),
            _reading(value[2], last[2], p.code, rng, span)), last


@jit
def _is_reading(p: FaultValues) -> bool:
    return NONE < p.code < MISSING


@jit
def scalar(
    value: float, last: float, tick: int, rng: Generator, p: FaultValues,
    span: tuple[float, float],
) -> tuple[float, float]:
    """Return the reading of a scalar sensor, and its last reading without fault."""
    if not (_is_reading(p) and _strikes(tick, rng, p)):
        return value, value
    return _reading(value, last, p.code, rng, span), last


@jit
def flow(
    value: tuple[float, float, int], last: tuple[float, float, int], tick: int, rng: Generator,
    p: FaultValues,
) -> tuple[tuple[float, float, int], tuple[float, float, int]]:
    """Return the reading of the flow sensor with its quality, and its last one without fault."""
    if not (_is_reading(p) and _strikes(tick, rng, p)):
        return value, value
    x = _reading(value[0], last[0], p.code, rng, FLOW_SPAN)
    y = _reading(value[1], last[1], p.code, rng, FLOW_SPAN)
    return (x, y, last[2] if p.code == STUCK else value[2]), last


@jit
def delivery(new: bool, held: bool, tick: int, rng: Generator, p: FaultValues) -> tuple[int, bool]:
    """Return the delivery of a sample, and whether the stream now holds one back."""
    if not new:
        return DELIVERY_LOST, held
    if p.code < MISSING or held or not _strikes(tick, rng, p):
        return DELIVERY_SENT, False
    if p.code == MISSING:
        return DELIVERY_LOST, False
    if p.code == LATE:
        return DELIVERY_LATE, False
    if p.code == REPEATED:
        return DELIVERY_TWICE, False
    return DELIVERY_HELD, True


@jit
def in_time(what: int) -> bool:
    """Return whether a sample with this delivery reaches the estimator in its step."""
    return what == DELIVERY_SENT or what == DELIVERY_TWICE


@jit
def narrow(x: float) -> float:
    """Return x as the message of the sonar carries it, a float32 number."""
    return np.float64(np.float32(x))


class Outbox:
    """
    Publishes the messages of one sensor according to their ``DELIVERY_*``.

    Parameters
    ----------
    publish
        Takes the bytes of a message.
    delay : ticks
        Of late messages.

    Attributes
    ----------
    count : int
        Messages published since the start.
    delay : ticks
        Of the next late messages.

    """

    def __init__(self, publish: Callable[[bytes], None], delay: int = 1) -> None:
        self.count = 0
        self._publish, self.delay = publish, delay
        self._late: deque[tuple[int, bytes]] = deque()
        self._held: bytes | None = None

    def _send(self, data: bytes) -> None:
        self.count += 1
        self._publish(data)

    def catch_up(self, tick: int) -> None:
        """Publish the late messages that arrive at a tick; to be called before :meth:`put`."""
        while self._late and self._late[0][0] <= tick:
            self._send(self._late.popleft()[1])

    def put(self, tick: int, data: bytes, what: int) -> None:
        """Publish, drop or hold the message of a tick."""
        if what == DELIVERY_LATE:
            self._late.append((tick + self.delay, data))
        elif what == DELIVERY_HELD:
            self._held = data
        elif what != DELIVERY_LOST:
            self._send(data)
            if what == DELIVERY_TWICE:
                self._send(data)
            if self._held is not None:
                self._send(self._held)
                self._held = None
