"""
Messages that a bag lacks: between others, and at the beginning and the end of the flight.

A gap between two messages shows in their stamps. A topic that begins late or ends early shows
nothing: only the flight that goes on without it tells.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
import math
from typing import NamedTuple

from mambo_bags.reader import Bag, BagError, Messages
from mambo_signals import metrics, motion, resample, time_offset
from mambo_signals.flight_phases import LATE, Phases, phases
from mambo_signals.resample import Ints
import numpy as np

from . import pair

STEADY = (
    'imu/data_raw', 'sensor_tick', 'ground_truth/odom', 'estimate/odom', 'estimate/map',
    'estimator/state', 'reference', 'controller/state', 'motor_pwm', 'onboard/odom',
    'onboard/reference', 'optitrack/pose')
"""Topics with a constant period, estimated from their own stamps."""
COUNTED = {
    'imu/data_raw': 'imu', 'sonar/range': 'sonar', 'optical_flow': 'optical_flow',
    'barometer/pressure': 'barometer'}
"""Topics whose samples ``sensor_tick`` counts, with the field that holds the count."""

FLOWN = (*motion.TRUTH, 'onboard/odom')
"""Motions that show take-off and landing: an estimate that was made later may drift or diverge."""
ESTIMATED = tuple(name for name in motion.MOTIONS if name not in FLOWN)


class Span(NamedTuple):
    """Begin and end of a flight as stamps [ns]: every topic should cover it."""

    begin: int
    end: int


class _Seen(NamedTuple):
    """Ends of a flight in one signal [ns], and whether they are take-off and landing."""

    begin: int
    end: int
    takeoff: bool
    landing: bool


def _in_motion(found: motion.Motion) -> _Seen | None:
    """Return the flight that a motion shows; None if the vehicle stands throughout."""
    first, last = int(found.stamps[0]), int(found.stamps[-1])
    try:
        flown = time_offset.flight_by_position(found.t, found.position)
    except time_offset.AlignError:  # it stands, or hovers all the time
        moves = np.ptp(found.position, axis=0).max() > time_offset.LEAST_RISE
        return _Seen(first, last, False, False) if moves else None
    begin, end = flown.within(first * 1e-9, last * 1e-9)
    return _Seen(round(begin * 1e9), round(end * 1e9), flown.takeoff is not None,
                 flown.landing is not None)


def _in_motors(bag: Bag) -> _Seen | None:
    """Return the time in which motors turn, which may do so on the ground; None if never."""
    if 'motor_pwm' not in bag:
        return None
    motors = bag['motor_pwm']
    try:
        turning = motors.stamp[(motors.pwm > 0.0).any(axis=1)]
    except BagError:  # of an unknown encoding: its reader says so
        return None
    return _Seen(int(turning.min()), int(turning.max()), False, False) if len(turning) else None


def _seen(bag: Bag, names: Collection[str]) -> Iterator[_Seen]:
    """Yield what each of some motions of a bag shows of the flight."""
    for name in names:
        try:
            found = _in_motion(motion.read(bag, name)) if name in bag else None
        except BagError:  # of another type, or too few samples: its reader says so
            continue
        if found is not None:
            yield found


def _recording_end(bag: Bag) -> int | None:
    """Return the stamp [ns] that two steady topics reach: a single one may be wrong."""
    ends = sorted(int(bag[name].stamp.max()) for name in STEADY if name in bag and len(bag[name]))
    return ends[-2] if len(ends) > 1 else None


def span(bag: Bag) -> Span | None:
    """
    Return begin and end of the flight in a bag; None if nothing shows that the vehicle flies.

    From take-off to landing, in any motion that shows them: before and after, the logs and the
    motion capture of a real drone are started and stopped one by one. What begins or ends in the
    air is flown from its first or to its last message, or as long as the motors turn. In a
    simulation every node works until the end, so its flight ends with the recording.
    """
    flown, estimated = list(_seen(bag, FLOWN)), list(_seen(bag, ESTIMATED))
    motors = _in_motors(bag)
    every = [*flown, *estimated, *([motors] if motors else [])]
    if not every:
        return None
    begin, end = min(one.begin for one in every), max(one.end for one in every)
    for found in (estimated, flown):  # the last that knows decides
        begin = min([one.begin for one in found if one.takeoff], default=begin)
        end = max([one.end for one in found if one.landing], default=end)
    if pair.simulated(bag):
        end = _recording_end(bag) or end
    return Span(begin, end)


def flown(bag: Bag, flight: Span | None) -> Phases:
    """Return the phases of a flight, with its end."""
    return phases(bag)._replace(end=None if flight is None else flight.end)


def absent(stamps: Ints, flight: Span | None) -> list[Span]:
    """
    Return the parts of a flight before the first and after the last of some stamps.

    Parameters
    ----------
    stamps : (n,) ns
        One or more, in any order.
    flight
        Of :func:`span`. None: unknown, and nothing is absent.

    Returns
    -------
    At most two, each longer than ``LATE`` and than ``GAP_PERIODS`` mean periods of the topic: some
    real logs have one of these topics with irregular and long periods.

    """
    if flight is None:
        return []
    first, last = int(stamps.min()), int(stamps.max())
    mean = (last - first) / max(len(stamps) - 1, 1)
    least = max(LATE, resample.GAP_PERIODS * mean)
    return [part for part in (Span(flight.begin, min(first, flight.end)),
                              Span(max(last, flight.begin), flight.end))
            if part.end - part.begin > least]


def _counted(bag: Bag, topic: str) -> bool:
    """Return whether watermarks count the samples of a topic."""
    return topic in COUNTED and 'sensor_tick' in bag


def count(bag: Bag, topic: str, flight: Span | None) -> int | None:
    """Return the number of messages missing from a topic of a bag; None if nothing tells it."""
    messages = bag[topic]
    if _counted(bag, topic):
        tick = bag['sensor_tick']
        last = int(np.argmax(tick.stamp))
        have = int((messages.stamp <= tick.stamp[last]).sum())
        return max(int(tick[COUNTED[topic]][last]) - have, 0)
    if topic not in STEADY:
        return None
    period = resample.median_period(messages.stamp)
    if math.isnan(period):
        return 0
    return metrics.count_missing(messages.stamp, period) + sum(
        round((part.end - part.begin) / period) for part in absent(messages.stamp, flight))


def _line(messages: Messages, parts: list[Span]) -> str:
    """Return the line about a topic that is absent from parts of the flight."""
    where = ' and '.join(f'from {part.begin * 1e-9:.3f} to {part.end * 1e-9:.3f} s'
                         for part in parts)
    return (f'{messages.topic}: no message {where} of the flight: numbers that need it cover '
            'only the rest')


def describe(
    bag: Bag, flight: Span | None, topics: Collection[str] = (*STEADY, *COUNTED),
) -> list[str]:
    """
    Return a line about each topic that begins late in a flight or ends early.

    A sensor that the watermarks count is judged by its count alone: one that has failed sends no
    more.

    Parameters
    ----------
    bag
        Recording.
    flight
        Of :func:`span`.
    topics
        To look at; those without a constant period that nothing counts have no line.

    """
    out = []
    for topic in dict.fromkeys(topics):
        if topic not in bag or topic not in STEADY and not _counted(bag, topic):
            continue
        try:
            parts = absent(bag[topic].stamp, flight)
            if parts and (not _counted(bag, topic) or count(bag, topic, flight)):
                out.append(_line(bag[topic], parts))
        except BagError:  # of an unknown encoding: its reader says so
            continue
    return out
