"""
Convert sensor samples in any order of arrival to one ordered sequence of filter steps.

DDS keeps the order within a topic only. The watermark (``SensorTick``) states how many samples of
each topic were published up to its stamp; a step is released when all of them have arrived, and
uses no others. The result of the filter therefore depends on stamped data alone: in a live graph,
in a replay and offline, even if samples are late, repeated or out of order.

A sample that was lost on the way never arrives. It is not waited for any longer once a sample of
its topic has arrived that is newer than the watermark: what was published before that one is lost
or here. From then on as many samples less are due.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import math
from typing import Any, NamedTuple

from mambo_model.limits import AHEAD_NS

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
    dropped: tuple[int, int, int, int]  # samples left out since start: IMU, sonar, flow, pressure


def _nothing() -> None:
    """Do nothing."""


_LATENCY = 50_000_000  # ns, by which a sample of a driver without watermark may be late


class Synchroniser:
    """
    Queue of the four sensor streams; each ``add_*`` returns the steps that it completes.

    Parameters
    ----------
    watermark
        True: a step waits for all samples that ``add_tick`` announces. False (a sensor driver
        that sends no watermark): an IMU sample is a step with what has arrived by then.

    A sample is dropped if it is late (older than the previous step), not newer than an earlier
    sample of its stream, overtaken within one step, or more than 0.1 s ahead of the step it
    arrives with. A sample that is less ahead waits for its own step. With watermarks, it also says
    that the samples of its stream that are still missing at this step were lost.

    Attributes
    ----------
    pull
        Called when a sample is ahead of all watermarks by more than 0.1 s, to handle those that
        have arrived: after a gap they tell it from one with a wrong stamp.

    """

    def __init__(self, watermark: bool = True) -> None:
        self._watermark = watermark
        self._arrived: tuple[deque, ...] = tuple(deque() for _ in range(4))  # not yet announced
        self._ready: tuple[deque, ...] = tuple(deque() for _ in range(4))
        self._newest = [-1, -1, -1, -1]
        self._received = [0, 0, 0, 0]
        self._dropped = [0, 0, 0, 0]
        self._ticks: deque[tuple[int, tuple[int, int, int, int]]] = deque()
        self._missed: list[int] | None = None  # samples from before the first watermark
        self._joined = -1  # ns, stamp of the first watermark
        self._lost = [0, 0, 0, 0]  # samples since then that were taken for lost
        self._last_t: int | None = None
        self._bound = -1  # ns, above which a sample is ahead of the newest watermark
        self.pull: Callable[[], Any] = _nothing

    def add_imu(self, t: int, gyro: Vec3, accel: Vec3) -> list[Step]:
        """Queue an IMU sample (ns, rad/s, m/s^2, body FRD)."""
        return self._add(0, t, (gyro, accel))

    def add_sonar(self, t: int, distance: float) -> list[Step]:
        """Queue a slant range (ns, m)."""
        return self._add(1, t, distance)

    def add_flow(self, t: int, flow: tuple[float, float], quality: int) -> list[Step]:
        """Queue optical flow (ns, rad/s body FRD, 0..255)."""
        return self._add(2, t, (flow, quality))

    def add_pressure(self, t: int, pressure: float) -> list[Step]:
        """Queue a pressure (ns, Pa)."""
        return self._add(3, t, pressure)

    def add_tick(self, t: int, counts: tuple[int, int, int, int]) -> list[Step]:
        """
        Queue the watermark: ``counts`` samples of each stream were published up to ``t``.

        A consumer that joins a running flight treats the samples received by its first watermark
        as complete.
        """
        if self._missed is None:
            self._joined = t
            self._missed = [0] * 4 if counts[0] <= 1 else [
                count - received for count, received in zip(counts, self._received, strict=True)]
        self._ticks.append((t, counts))
        self._bound = t + AHEAD_NS
        return self._completed()

    def skip(self, stream: int) -> list[Step]:
        """Count a sample of a stream (0 to 3) that arrived but cannot be read."""
        return self._add(stream, -1, None)

    def forget(self, stream: int) -> None:
        """Drop what a stream (0 to 3) had before the first step: its publisher has left."""
        if self._last_t is None and self._watermark:
            self._arrived[stream].clear()
            self._received[stream] = 0

    def _add(self, stream: int, t: int, sample: object) -> list[Step]:
        if t > self._bound:
            self.pull()
        self._received[stream] += 1
        self._arrived[stream].append((t, sample))
        if self._watermark:
            return self._completed()
        return self._release(t, self._received) if stream == 0 else []

    def _completed(self) -> list[Step]:
        """Return every step whose data are complete."""
        out: list[Step] = []
        while self._ticks:
            t, counts = self._ticks[0]
            due = [count - missed - lost for count, missed, lost in zip(
                counts, self._missed, self._lost, strict=True)]
            if any(self._received[k] < due[k] and not self._has_later(k, t) for k in range(4)):
                break
            out += self._release(t, due)
            self._ticks.popleft()
        return out

    def _is_later(self, t: int, now: int) -> bool:
        """Return whether a sample was published after the watermark of ``now``."""
        return now < t <= self._bound  # else its stamp is wrong

    def _has_later(self, stream: int, now: int) -> bool:
        """Return whether a sample of a stream has arrived after all up to ``now``."""
        return any(self._is_later(t, now) for t, _ in self._arrived[stream])

    def _admit(self, stream: int, due: int, now: int) -> None:
        """Make the first ``due`` samples of a stream ready; drop those that come too late."""
        arrived, last = self._arrived[stream], self._last_t
        if last is not None and not self._watermark and stream:
            last -= _LATENCY
        left = due - self._received[stream] + len(arrived)
        while left > 0:
            if self._watermark and self._is_later(arrived[0][0], now):
                self._lost[stream] += left
                return
            t, sample = arrived.popleft()
            left -= 1
            if t > now + AHEAD_NS:
                self._dropped[stream] += 1
                continue
            if t <= self._newest[stream] or last is not None and t <= last:
                self._dropped[stream] += 1
                if last is not None and 0 <= t <= last:
                    self._admit_late(stream, t)
            else:
                self._ready[stream].append((t, sample))
            self._newest[stream] = max(self._newest[stream], t)

    def _admit_late(self, stream: int, t: int) -> None:
        """Count on a sample again that was on its way when it was not waited for."""
        if self._missed is not None and t <= self._joined and self._missed[stream]:
            self._missed[stream] -= 1
        elif self._lost[stream]:
            self._lost[stream] -= 1

    def _take(self, stream: int, t: int):
        """Return the newest sample of an aiding stream up to ``t``; drop those it overtakes."""
        queue, found = self._ready[stream], None
        while queue and queue[0][0] <= t:
            if found is not None:
                self._dropped[stream] += 1
            found = queue.popleft()[1]
        return found

    def _release(self, t: int, due: list[int]) -> list[Step]:
        """Return the steps up to a stamp; with a watermark there is one at the stamp itself."""
        for stream in range(4):
            self._admit(stream, due[stream], t)
        queue, samples, out = self._ready[0], [], []
        while queue and queue[0][0] <= t:
            samples.append(queue.popleft())
        if self._watermark and (not samples or samples[-1][0] < t):
            samples.append((t, (NAN3, NAN3)))  # the sensor skipped this step: it is bridged
        for i, (stamp, (gyro, accel)) in enumerate(samples):
            sonar, flow, pressure = (self._take(k, stamp) for k in (1, 2, 3))
            dt = 0.0 if self._last_t is None else (stamp - self._last_t) * 1e-9
            self._last_t = stamp
            out.append(Step(
                stamp, dt, gyro, accel, NAN if sonar is None else sonar,
                NAN2 if flow is None else flow[0], 0 if flow is None else flow[1],
                NAN if pressure is None else pressure, i == len(samples) - 1,
                tuple(self._dropped)))
        return out
