"""
Sensor samples in any order of arrival become one ordered sequence of filter steps.

DDS keeps the order within a topic only. The watermark (``SensorTick``) says how many samples of
each topic exist up to its stamp; a step is released when all of them are there. What the filter
computes is therefore a function of stamped data: in a live graph, in a replay and offline.
"""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

Vec3 = tuple[float, float, float]
NAN = math.nan
NAN2, NAN3 = (NAN, NAN), (NAN, NAN, NAN)


class Step(NamedTuple):
    """One filter step: an IMU sample and the aiding samples since the one before (NaN: none)."""

    t: int  # ns, stamp of the IMU sample
    dt: float  # s since the step before, 0 at the first
    gyro: Vec3  # rad/s, body FRD
    accel: Vec3  # m/s^2, specific force, body FRD
    sonar: float  # m, slant range
    flow: tuple[float, float]  # rad/s, body FRD
    flow_quality: int  # 0..255
    pressure: float  # Pa
    last: bool  # whether it is the last step of its tick


class Synchroniser:
    """
    Queue of the four sensor streams; each ``add_*`` returns the steps that it completes.

    Parameters
    ----------
    watermark
        True: a step waits for all samples that ``add_tick`` announces. False (a sensor driver
        that sends no watermark): an IMU sample is a step with what has arrived by then.

    Attributes
    ----------
    invalid : int
        Samples that could not be used: repeated or out of order within their stream, or
        overtaken by a newer one of the same sensor within one step.

    """

    def __init__(self, watermark: bool = True) -> None:
        self.invalid = 0
        self._watermark = watermark
        self._imu: deque[tuple[int, Vec3, Vec3]] = deque()
        self._aiding: tuple[deque, deque, deque] = (deque(), deque(), deque())
        self._newest = [-1, -1, -1, -1]
        self._received = [0, 0, 0, 0]
        self._ticks: deque[tuple[int, tuple[int, int, int, int]]] = deque()
        self._offset: tuple[int, ...] | None = None
        self._last_t: int | None = None

    def _accept(self, stream: int, t: int) -> bool:
        self._received[stream] += 1
        if t <= self._newest[stream]:
            self.invalid += 1
            return False
        self._newest[stream] = t
        return True

    def add_imu(self, t: int, gyro: Vec3, accel: Vec3) -> list[Step]:
        """Queue an IMU sample (ns, rad/s, m/s^2, body FRD)."""
        if self._accept(0, t):
            self._imu.append((t, gyro, accel))
        return self._completed() if self._watermark else self._release(t, guaranteed=False)

    def add_sonar(self, t: int, distance: float) -> list[Step]:
        """Queue a slant range (ns, m)."""
        return self._add_aiding(1, t, distance)

    def add_flow(self, t: int, flow: tuple[float, float], quality: int) -> list[Step]:
        """Queue optical flow (ns, rad/s body FRD, 0..255)."""
        return self._add_aiding(2, t, (flow, quality))

    def add_pressure(self, t: int, pressure: float) -> list[Step]:
        """Queue a pressure (ns, Pa)."""
        return self._add_aiding(3, t, pressure)

    def add_tick(self, t: int, counts: tuple[int, int, int, int]) -> list[Step]:
        """
        Queue the watermark: ``counts`` samples of each stream exist up to ``t``.

        A consumer that joins a running flight takes what it has seen by its first watermark as
        complete.
        """
        if self._offset is None:
            self._offset = (0, 0, 0, 0) if counts[0] <= 1 else tuple(
                count - received for count, received in zip(counts, self._received, strict=True))
        self._ticks.append((t, counts))
        return self._completed()

    def _add_aiding(self, stream: int, t: int, sample: object) -> list[Step]:
        if self._accept(stream, t):
            self._aiding[stream - 1].append((t, sample))
        return self._completed()

    def _completed(self) -> list[Step]:
        """Return every step whose data are complete."""
        out: list[Step] = []
        while self._ticks and self._complete(self._ticks[0][1]):
            out += self._release(self._ticks.popleft()[0], guaranteed=True)
        return out

    def _complete(self, counts: tuple[int, int, int, int]) -> bool:
        return all(received + offset >= count for received, offset, count in zip(
            self._received, self._offset, counts, strict=True))

    def _take_aiding(self, stream: int, t: int):
        """Return the newest sample of an aiding stream up to ``t``; count those it overtakes."""
        queue, found = self._aiding[stream], None
        while queue and queue[0][0] <= t:
            if found is not None:
                self.invalid += 1
            found = queue.popleft()[1]
        return found

    def _release(self, t: int, guaranteed: bool) -> list[Step]:
        """Return the steps up to a stamp, with one at the stamp itself where ``guaranteed``."""
        samples, out = [], []
        while self._imu and self._imu[0][0] <= t:
            samples.append(self._imu.popleft())
        if guaranteed and (not samples or samples[-1][0] < t):
            samples.append((t, NAN3, NAN3))  # the sensor skipped this step: the filter bridges it
        for i, (stamp, gyro, accel) in enumerate(samples):
            sonar, flow, pressure = (self._take_aiding(k, stamp) for k in range(3))
            dt = 0.0 if self._last_t is None else (stamp - self._last_t) * 1e-9
            self._last_t = stamp
            out.append(Step(
                stamp, dt, gyro, accel, NAN if sonar is None else sonar,
                NAN2 if flow is None else flow[0], 0 if flow is None else flow[1],
                NAN if pressure is None else pressure, i == len(samples) - 1))
        return out
