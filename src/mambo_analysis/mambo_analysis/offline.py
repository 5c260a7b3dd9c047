"""
Offline replay: recorded sensors through the estimator in one process, no middleware.

The estimator's step is the compiled one of the node, the samples are ordered by the same
watermark, so that the result equals the recorded estimate to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterator
import heapq
import itertools

from mambo_estimation import filters
from mambo_estimation.kalman import Estimate
from mambo_estimation.synchroniser import Step, Synchroniser
from mambo_ros import layout, messages, topics

from .bag import Bag

SENSORS = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)
"""In the order of the watermark."""


def steps(bag: Bag) -> Iterator[Step]:
    """
    Yield the filter steps of a flight, from a bag that was read with its sensors.

    Where a bag has no watermark (``sensor_tick``), as one of real hardware, it gets those of
    ``replay_node``: what is recorded before the next inertial sample is there at the one before.

    Raises
    ------
    mambo_analysis.bag.BagError
        If it has no inertial samples.

    """
    bag.messages(topics.IMU.name)
    sync, counts = Synchroniser(), dict.fromkeys(SENSORS, 0)
    take = {
        topics.IMU: lambda data: sync.add_imu(*messages.decode_imu(data)),
        topics.SONAR: lambda data: sync.add_sonar(*messages.decode_sonar(data)),
        topics.OPTICAL_FLOW: lambda data: sync.add_flow(*messages.decode_optical_flow(data)),
        topics.BAROMETER: lambda data: sync.add_pressure(*messages.decode_pressure(data)),
        topics.SENSOR_TICK: lambda data: sync.add_tick(*messages.decode_sensor_tick(data))}
    streams = [
        zip(bag[topic.name].log_time.tolist(), itertools.repeat(topic), bag[topic.name].raw)
        for topic in take if topic.name in bag]
    has_ticks, now = topics.SENSOR_TICK.name in bag, -1
    for _, topic, data in heapq.merge(*streams, key=lambda entry: entry[0]):
        if topic is topics.IMU and not has_ticks and (t := layout.stamp_ns(data)) > now:
            if now >= 0:
                yield from sync.add_tick(now, tuple(counts.values()))
            now = t
        if topic in counts:
            counts[topic] += 1
        yield from take[topic](data)
    if now >= 0:
        yield from sync.add_tick(now, tuple(counts.values()))


def estimate(
    bag: Bag, params: filters.Params,
) -> Iterator[tuple[int, Estimate, tuple[int, ...]]]:
    """
    Yield (stamp ns, estimate, samples dropped so far) for each message of the live estimator.

    Parameters
    ----------
    bag
        As of :func:`steps`.
    params
        Of the estimator, which they choose by their type.

    """
    memory, values = filters.initial(params), params.values()
    for s in steps(bag):
        memory, answer = filters.step(
            memory, s.dt, s.gyro, s.accel, s.sonar, s.flow, s.flow_quality, s.pressure, values)
        if s.last:
            yield s.t, answer, s.dropped
