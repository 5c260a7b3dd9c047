"""
A drone's log and the motion capture of the same flight as one bag.

Both recorded the same motion on two clocks. The offset of the clocks is found by correlation: the
body rates of the tracked attitude with the gyro, the tracked height with the sonar, the tracked
pose with the drone's own. The signal with the smallest standard error gives the offset, if the
others that determine one agree with it; signals that cannot determine it are listed. One offset
must hold for the whole flight: clocks that jump or run at different rates are refused, by the
same signals stretched in time and in windows (:mod:`mambo_signals.clock_check`). At this offset
all that both recorded must show one flight (:mod:`.checks.same_flight`). All of the
flight is copied, and ``optitrack/pose`` of the other is added on the flight's clock, that of its
stamps, and with log times as late as those of the flight. A tracked body that is turned about z is
told.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
import re
from typing import NamedTuple

from mambo_bags import mcap_reader
from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag, bag_files, read_bag
from mambo_bags.recover import declare, extras, in_order, OWN_RECORD
from mambo_bags.writer import BagWriter, BagWriterError
from mambo_model.whole_file import refuse_existing
from mambo_ros import cdr
from mambo_signals import clock_check, gyro_check, motion
from mambo_signals.derivative import body_rates
from mambo_signals.time_offset import (
    AlignError, Floats, most_precise, offsets, pose_offset, Poses, RANGE_LATE, refuse_uncertain,
    unclipped_ranges)
import numpy as np

from .checks import bag_doubts, plausible, same_flight, turned

POSE = 'optitrack/pose'
_ADVICE = r'[;:]? (or )?give --offset SECONDS'
LONGEST = 2e9  # [s] of an offset: log times since boot and since 1970
RATES = ('roll rate', 'pitch rate', 'yaw rate')
OWN = ('onboard/odom', 'estimate/odom')
"""Poses of the drone itself."""
LATE = {'height': RANGE_LATE, **dict.fromkeys(OWN, 0.1)}
"""Largest delay of signals behind the motion [s]: of ranges and of filtered values."""
HEIGHT = 1.25
"""Largest relative difference of range and tracked height [-]; beyond, the echo is wrong."""


class Clock(NamedTuple):
    """Offset between the clocks of motion capture and flight."""

    offset: float       # s, to add to the motion capture's
    sigma: float        # s, standard error; NaN if the offset was given
    source: str         # what it comes from
    unused: tuple[str, ...] = ()  # signals that give none, each with the reason
    doubt: str = ''     # about the axes of the tracked body; empty: none


def signals(bag: Bag, poses: Poses) -> dict[str, tuple[Floats, Floats, Floats, Floats]]:
    """
    Return the signals of the same motion that both recorded.

    Parameters
    ----------
    bag
        With ``imu/data_raw`` or ``sonar/range``.
    poses
        Of the motion capture, body FLU.

    Returns
    -------
    {name: times [s] and values of the flight, times [s] and values of the motion capture}; rates
    in rad/s, the height in m.

    """
    out: dict[str, tuple[Floats, Floats, Floats, Floats]] = {}
    if 'imu/data_raw' in bag:
        gyro, q = bag['imu/data_raw'], poses.orientation
        valid = np.isfinite(q).all(axis=1) & (np.abs((q * q).sum(axis=1) - 1.0) < 0.1)
        t, rates = body_rates(poses.t[valid], q[valid])
        for axis, name in enumerate(RATES):
            out[name] = (gyro.t, gyro.angular_velocity[:, axis], t, rates[:, axis])
        out['turn rate'] = (gyro.t, np.linalg.norm(gyro.angular_velocity, axis=1),
                            t, np.linalg.norm(rates, axis=1))
    if 'sonar/range' in bag:
        out['height'] = (*unclipped_ranges(bag), poses.t, poses.position[:, 2])
    return out


def find_clock(bag: Bag, poses: Poses) -> Clock:
    """
    Return the offset of the clock of a motion capture.

    Raises
    ------
    AlignError
        If nothing determines it, what determines it disagrees, it changes during the flight, or
        the gyro contradicts the tracked attitude (:mod:`mambo_signals.gyro_check`).

    """
    pairs = signals(bag, poses)
    turns = {name: pairs[name] for name in RATES if name in pairs}
    if said := clock_check.wrong_rate(clock_check.while_flying(
            turns, pairs.get('height'), *same_flight.motors_run(bag))):
        raise AlignError(f'{said}; or give --offset SECONDS')
    found, reasons = offsets(pairs)
    for name, one in list(found.items()):
        if not 1.0 / gyro_check.UNIT < one.factor < gyro_check.UNIT:
            raise AlignError(
                f'{name}: that of the flight is {one.factor:.3g} times that of the motion '
                'capture; one of them is not in SI units: import it with the right ones')
        if name == 'height' and not 1.0 / HEIGHT < one.factor < HEIGHT:
            reasons[name] = AlignError(
                f'the range changes by {one.factor:.2f} m for a metre of tracked height')
            del found[name]
    for topic in OWN:
        if topic in bag:
            try:
                found[topic] = pose_offset(bag[topic], poses)[0]
            except AlignError as error:
                reasons[topic] = error
    if not found:
        why = '; '.join(f'{name}: {text}' for name, text in reasons.items())
        why = why or 'no gyro, sonar or pose of the drone'
        raise AlignError(f'the clocks cannot be aligned ({why}); give --offset SECONDS')
    try:
        best, offset = most_precise(found, LATE)
    except AlignError as error:
        raise AlignError(
            f'{error}: another flight, or wrong axes of the tracked body (import_motive --nose); '
            'or give --offset SECONDS') from None
    rates = clock_check.while_flying(
        turns, pairs['height'] if 'height' in found else None, -math.inf, math.inf)
    if said := clock_check.contradiction(rates, offset.offset):
        raise AlignError(f'{said}; or give --offset SECONDS')
    alike = {name: pairs[name] for name in found
             if name in pairs and LATE.get(name) == LATE.get(best)}
    try:
        sigma = offset.sigma
        if changes := clock_check.change(alike, offset.offset, LATE):
            sigma = math.hypot(sigma, changes)
            refuse_uncertain(offset.offset, sigma)
    except AlignError as error:
        raise AlignError(f'{error}; or give --offset SECONDS') from None
    turning = None
    if gyro := same_flight.gyro_of(bag):
        turning = gyro_check.compare(*gyro, poses.t + offset.offset, poses.orientation)
        gyro_check.refuse(turning)
    return Clock(offset.offset, sigma, f'{best} of {", ".join(found)}',
                 tuple(f'{name}: {reason}' for name, reason in reasons.items()),
                 gyro_check.turned_body(turning))


def _span(bag: Bag) -> tuple[int, int, int]:
    """
    Return the first and the last stamp of a flight, and by how much its log is later, ns.

    The stamps are those that the clock is found with: the times of a log may be on another clock.
    """
    named = [bag[topic] for topic in ('imu/data_raw', 'sonar/range', *OWN) if topic in bag]
    parts = [one for one in named if len(one)] or [
        bag[topic] for topic in bag.topics if len(bag[topic])]
    stamps = np.concatenate([one.stamp for one in parts])
    late = np.concatenate([one.log_time for one in parts]) - stamps
    return max(int(stamps.min()), 0), int(stamps.max()), int(np.median(late))


def _check_path(path: Path, own: motion.Motion, tracked: motion.Motion, shift: int) -> str:
    """
    Return a line, or '', on a capture, so many ns late, that contradicts the drone's own path.

    Its positions are turned against its attitude, or in another scale.

    Raises
    ------
    BagError
        If the capture shows the path mirrored or upside down.

    """
    tracked = dataclasses.replace(tracked, stamps=tracked.stamps + shift)
    ours, theirs = plausible.common_path(own, tracked)
    flat = ours[:, :2], theirs[:, :2]
    if said := plausible.upside_down(ours, theirs) or plausible.mirrored(*flat):
        raise BagError(f'{path}: {said}: import it with the right axes')
    said = turned.describe(own, tracked) or plausible.other_scale(*flat)
    return f'warning: {path}: {said}\n' if said else ''


def _check_flight(
    mocap: Path, bag: Bag, tracked: motion.Motion, clock: Clock, given: bool,
) -> list[str]:
    """
    Return lines on what contradicts a capture at an offset.

    Raises
    ------
    BagError
        If it is not of this flight and the offset was not given.

    """
    moved = dataclasses.replace(tracked, stamps=tracked.stamps + round(clock.offset * 1e9))
    found = same_flight.of_bag(bag, moved, OWN)
    if found.refuted and not given:
        raise BagError(
            f'{mocap}: {found.refuted} at {clock.offset:+.3f} s, the offset by {clock.source}: '
            'it is of another flight: give the one of this flight, or give '
            f'--offset {clock.offset:.3f} to join it all the same')
    return [f'{line}: is it of another flight?' for line in found.lines]


def _check_given(offset: float, bag: Bag, tracked: motion.Motion) -> tuple[str, str]:
    """Return a line, or '', on an offset that is not the one by correlation, and on the axes."""
    try:
        found = find_clock(bag, tracked)
    except AlignError as error:  # which may be why one is given
        reason = re.split(_ADVICE, str(error))[0]
        return f'nothing confirms the given offset: {reason}', ''
    if abs(offset - found.offset) <= max(clock_check.CHANGE, clock_check.DISTINCT * found.sigma):
        return '', found.doubt
    return (f'by {found.source} the offset is {found.offset:+.3f} s, not the given '
            f'{offset:+.3f} s: leave --offset out to take it'), found.doubt


def join(flight: Path, mocap: Path, target: Path, offset: float | None = None,
         namespace: str | None = None) -> str:
    """
    Write a bag of a flight with the motion capture of another one.

    Parameters
    ----------
    flight, mocap
        Bags; only read. The second has ``optitrack/pose``.
    target
        Directory to make.
    offset : s
        To add to the stamps of the motion capture; default: found.
    namespace
        Of the drone, if the bag of the flight has several.

    Returns
    -------
    What was done, one line for each.

    Raises
    ------
    BagError
        If a bag cannot be read, the flight has its motion capture already, the clocks cannot be
        aligned, or the capture is of another flight, or shows the mirror image of the path that
        the drone estimates; nothing is written then.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    refuse_existing(target, error=BagWriterError)
    bag, other = read_bag(flight, namespace=namespace), read_bag(mocap, [POSE])
    poses = other.messages(POSE)
    if POSE in bag:
        raise BagError(f'{flight}: has {bag.name(POSE)} already')
    tracked = motion.read(other, POSE)
    clock = Clock(offset, math.nan, 'given') if offset is not None else find_clock(bag, tracked)
    shift = round(clock.offset * 1e9)
    said, doubt = ('', clock.doubt) if offset is None else _check_given(offset, bag, tracked)
    lines = [said, *(line and f'{mocap}: {line}' for line in [
        doubt, *bag_doubts.capture(tracked),
        *_check_flight(mocap, bag, tracked, clock, offset is not None)])]
    note = ''.join(f'warning: {line}\n' for line in lines if line) + next(filter(None, [
        _check_path(mocap, motion.read(bag, topic), tracked, shift)
        for topic in OWN if topic in bag]), '')
    parts = [mcap_reader.scan(file) for file in bag_files(flight)[0]]
    copied = [message for part in parts for message in in_order(part)]
    begin, end, late = _span(bag)
    stamps = poses.stamp + shift
    inside = (stamps >= begin) & (stamps <= end)
    added = [(bag.name(POSE), max(stamp + late, 0), max(stamp + late, 0),
              cdr.restamped(data, stamp))
             for data, stamp, is_in in zip(poses.raw, stamps.tolist(), inside) if is_in]
    if not added:
        raise BagError(
            f'{mocap}: no pose is within the flight with an offset of {clock.offset:.3f} s: its '
            f'stamps then are {stamps.min() * 1e-9:.2f} to {stamps.max() * 1e-9:.2f} s, those of '
            f'the flight {begin * 1e-9:.2f} to {end * 1e-9:.2f} s')
    attachments, metadata = extras(parts)
    details = {'flight': flight.name, 'motion_capture': mocap.name,
            'offset_s': f'{clock.offset:.15g}', 'offset_sigma_s': f'{clock.sigma:.9g}',
            'offset_from': clock.source}
    metadata |= {f'{name}_motion_capture': record for name, record in other.metadata.items()
                 if name != OWN_RECORD}
    with BagWriter(target, attachments, {**metadata, 'join': details}) as writer:
        known: dict[str, bytes] = {}
        for part in parts:
            declare(writer, part, known)
        if bag.name(POSE) not in known:
            writer.add_topic(bag.name(POSE), poses.type_name)
        for topic, log_time, publish_time, data in sorted(
                copied + added, key=lambda message: message[1]):
            writer.write(topic, data, log_time, publish_time)
    error = '' if offset is not None else f' +- {1.96e3 * clock.sigma:.1f} ms (95 %)'
    unused = ''.join(f'not used, {reason}\n' for reason in clock.unused)
    return (f'clock of the motion capture moved by {clock.offset:+.4f} s{error}, by '
            f'{clock.source}\n{unused}{note}{len(added)} poses added, {int((~inside).sum())} '
            f'outside of the flight left out\nbag: {target}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('join', __doc__)
    out.add_argument('flight', type=Path, help="bag of the drone's log")
    out.add_argument('mocap', type=Path, help='bag with optitrack/pose of the same flight')
    out.add_output('BAG', 'bag to create', required=True, positional=True)
    out.add_argument('--offset', type=real(-LONGEST, LONGEST, 's'), metavar='SECONDS',
                     help="to add to the motion capture's clock; default: by correlation")
    out.add_argument('--namespace', help='of the drone, if FLIGHT has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``join``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        print(join(options.flight, options.mocap, options.output, options.offset,
                   options.namespace))
    return guard('join', work)


if __name__ == '__main__':
    raise SystemExit(main())
