"""
A drone's log and the motion capture of the same flight as one bag: ``join FLIGHT MOCAP OUT``.

Both recorded the same motion on two clocks. The offset of the clocks is found by
correlation (:mod:`mambo_signals.time_offset`): the body rates of the tracked attitude
with the gyro, the tracked height with the sonar, the tracked pose with the drone's own. The signal
with the smallest standard error gives the offset, if the others that determine one agree with it.
All of the flight is copied, ``optitrack/pose`` of the other is added on the flight's clock.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from mambo_bags import mcap_reader
from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag, bag_files, read_bag
from mambo_bags.recover import declare, extras, in_order, OWN_RECORD
from mambo_bags.writer import BagWriter, BagWriterError
from mambo_ros import cdr
from mambo_signals import motion
from mambo_signals.derivative import body_rates
from mambo_signals.time_offset import (
    AlignError, Floats, most_precise, offsets, pose_offset, Poses, RANGE_LATE, unclipped_ranges)
import numpy as np

POSE = 'optitrack/pose'
LONGEST = 2e9  # [s] of an offset: log times since boot and since 1970
OWN = ('onboard/odom', 'estimate/odom')
"""Poses of the drone itself."""
LATE = {'height': RANGE_LATE, **dict.fromkeys(OWN, 0.1)}
"""Largest delay of signals behind the motion [s]: of ranges and of filtered values."""
UNIT = 5.0
"""By which a signal of one unit may differ from that of the other [-]: noise of a differentiated
pose makes its rates larger than the gyro's."""
HEIGHT = 1.25
"""Largest relative difference of range and tracked height [-]; beyond, the echo is wrong."""


class Clock(NamedTuple):
    """Offset between the clocks of motion capture and flight."""

    offset: float       # s, to add to the motion capture's
    sigma: float        # s, standard error; NaN if the offset was given
    source: str         # what it comes from


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
        for axis, name in enumerate(('roll rate', 'pitch rate', 'yaw rate')):
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
        If nothing determines it, or what determines it disagrees.

    """
    found, reasons = offsets(signals(bag, poses))
    for name, one in list(found.items()):
        if not 1.0 / UNIT < one.factor < UNIT:
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
    return Clock(offset.offset, offset.sigma, f'{best} of {", ".join(found)}')


def join(flight: Path, mocap: Path, target: Path, offset: float | None = None) -> str:
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

    Returns
    -------
    What was done, one line for each.

    Raises
    ------
    BagError
        If a bag cannot be read, the flight has its motion capture already, or the clocks cannot
        be aligned; nothing is written then.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    if target.exists():
        raise BagWriterError(f'{target} exists: give another --output or remove it')
    bag, other = read_bag(flight), read_bag(mocap, [POSE])
    poses = other.messages(POSE)
    if POSE in bag:
        raise BagError(f'{flight}: has {bag.name(POSE)} already')
    clock = Clock(offset, math.nan, 'given') if offset is not None else find_clock(
        bag, motion.read(other, POSE))
    shift = round(clock.offset * 1e9)
    parts = [mcap_reader.scan(file) for file in bag_files(flight)[0]]
    copied = [message for part in parts for message in in_order(part)]
    end = max(log_time for _, log_time, _, _ in copied)
    stamps = poses.stamp + shift
    inside = (stamps >= 0) & (stamps <= end)
    added = [(bag.name(POSE), stamp, stamp, cdr.restamped(data, stamp))
             for data, stamp, is_in in zip(poses.raw, stamps.tolist(), inside) if is_in]
    if not added:
        raise BagError(f'{mocap}: no pose is within the flight with an offset of '
                       f'{clock.offset:.3f} s')
    attachments, metadata = extras(parts)
    details = {'flight': flight.name, 'motion_capture': mocap.name,
            'offset_s': f'{clock.offset:.9g}', 'offset_sigma_s': f'{clock.sigma:.9g}',
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
    return (f'clock of the motion capture moved by {clock.offset:+.4f} s{error}, by '
            f'{clock.source}\n{len(added)} poses added, {int((~inside).sum())} outside of the '
            f'flight left out\nbag: {target}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('join', __doc__)
    out.add_argument('flight', type=Path, help="bag of the drone's log")
    out.add_argument('mocap', type=Path, help='bag with optitrack/pose of the same flight')
    out.add_output('BAG', 'bag to create', required=True, positional=True)
    out.add_argument('--offset', type=real(-LONGEST, LONGEST, 's'), metavar='SECONDS',
                     help="to add to the motion capture's clock; default: by correlation")
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``join``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        print(join(options.flight, options.mocap, options.output, options.offset))
    return guard('join', work)


if __name__ == '__main__':
    raise SystemExit(main())
