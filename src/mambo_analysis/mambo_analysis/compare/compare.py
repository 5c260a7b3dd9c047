"""
Errors of a flight, ``compare BAG``, or of one flight against another, ``compare A B``.

For a flight with a reference: tracking error (ground truth, or Optitrack without it, minus
reference) and estimation error (estimate minus Optitrack), before and after the end of the
take-off. For an imported flight: the estimate against the drone's own. For any: messages, rates
and losses of each topic.

For two bags, or two topics of one: A minus B, see :func:`compare_bags`.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser, write_json
from mambo_bags.reader import Bag, BagError, Messages, read_bag
from mambo_flight.world import separation
from mambo_signals import damaged, height_check, metrics, motion, stamps
from mambo_signals.flight_phases import detect_phases, Phases, phases
from mambo_signals.resample import continuous_quaternions, Floats, Ints
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import losses, pair, tables
from ..importers.checks import same_flight, slips
from .ending import (
    ended_early, ended_in_the_air, landed_by_itself, refused_messages, without_poses)
from .events import parameters
from .losses import COUNTED
from .pair import Alignment, Comparison, Quantity
from .tables import table

_ODOMETRY = 'nav_msgs/msg/Odometry'
TYPES = {
    'imu/data_raw': 'sensor_msgs/msg/Imu', 'sonar/range': 'sensor_msgs/msg/Range',
    'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
    'barometer/pressure': 'sensor_msgs/msg/FluidPressure',
    'sensor_tick': 'mambo_interfaces/msg/SensorTick', 'ground_truth/odom': _ODOMETRY,
    'estimate/odom': _ODOMETRY, 'onboard/odom': _ODOMETRY,
    'optitrack/pose': 'geometry_msgs/msg/PoseStamped',
    'estimator/state': 'mambo_interfaces/msg/EstimatorState',
    'reference': 'mambo_interfaces/msg/Reference', 'motor_pwm': 'mambo_interfaces/msg/MotorPwm'}
"""Types of the topics that are compared and drawn."""


class Aligned(NamedTuple):
    """Two odometries at common stamps, the first turned and moved onto the other."""

    stamps: Ints       # (n,) ns
    position: Floats   # (n, 3) m, difference
    velocity: Floats   # (n, 3) m/s, body FLU, difference
    attitude: Floats   # (n, 3) deg, roll, pitch, yaw in z-up axes, difference
    text: str          # how


def align(odometry: Messages, other: Messages) -> Aligned | None:
    """
    Return the differences of two odometries at common stamps, by :func:`pair.own_origin`.

    None if they have no stamp in common.
    """
    here, there = metrics.common_stamps(odometry.stamp, other.stamp)
    if not len(here):
        return None
    ours, theirs = (
        motion.Motion(name, m.stamp[index], m.position[index],
                      continuous_quaternions(m.orientation[index]))
        for name, m, index in (('estimate/odom', odometry, here), ('onboard/odom', other, there)))
    alignment = pair.own_origin(ours, theirs, pair.begins_in_air(
        motion.Motion('', other.stamp, other.position, other.orientation), ours.stamps[0]))
    ours = alignment.moved(ours)
    own, angles = (Rotation.from_quat(m.quaternion).as_euler('ZYX')[:, ::-1]
                   for m in (ours, theirs))
    wrapped = (own - angles + math.pi) % (2.0 * math.pi) - math.pi
    return Aligned(
        ours.stamps, ours.position - theirs.position,
        odometry.velocity[here] - other.velocity[there], np.degrees(wrapped), alignment.text)


def _against_onboard(
    estimate: Messages, onboard: Messages, parts: Phases, notes: list[str],
) -> list[dict[str, Any]]:
    aligned = align(estimate, onboard)
    if aligned is None:
        notes.append('estimate/odom and onboard/odom have no stamp in common: not compared')
        return []
    notes.append(f'{aligned.text}; an onboard estimate is no ground truth')
    rpy = ('roll', 'pitch', 'yaw')
    return [
        pair.section(
            Quantity(name, unit, axes, aligned.stamps, errors, np.full(errors.shape, np.nan),
                     errors), f'{name}, estimate/odom minus onboard/odom', parts)
        for name, unit, axes, errors in (
            ('position', 'm', pair.XYZ, aligned.position),
            ('velocity in body axes', 'm/s', pair.XYZ, aligned.velocity),
            ('attitude', 'deg', rpy, aligned.attitude))]


def check_types(bag: Bag) -> None:
    """Raise BagError if a topic that is compared or drawn has another type than expected."""
    for topic, expected in TYPES.items():
        found = bag.topics.get(bag.name(topic), expected)
        if found != expected:
            raise BagError(
                f'{bag.path}: {bag.name(topic)} has the type {found}, expected {expected}')


def _topics(bag: Bag, flight: losses.Span | None) -> list[dict[str, Any]]:
    """Return messages, rate by the stamps and losses of every topic."""
    out = []
    for name in sorted(bag.topics):
        prefix = f'{bag.namespace}/'
        topic = name[len(prefix):] if bag.namespace and name.startswith(prefix) else name
        entry: dict[str, Any] = {'topic': name, 'messages': 0, 'rate': None, 'lost': None}
        if name in bag:
            messages = bag[name]
            entry['messages'] = len(messages)
            try:
                stamps = messages.stamp
                entry['lost'] = losses.count(bag, topic, flight)
            except BagError:  # unknown encoding: count the messages without decoding
                stamps = messages.log_time
            span = int(stamps.max() - stamps.min()) * 1e-9
            entry['rate'] = (len(messages) - 1) / span if span > 0.0 else None
        out.append(entry)
    return out


def _factor(bag: Bag) -> float | None:
    """Return the real-time factor stored in the bag, if any."""
    for values in (bag.custom_data, *bag.metadata.values()):
        try:
            return float(values['real_time_factor'])
        except (KeyError, ValueError):
            continue
    return None


def _doubts(bag: Bag, flight: losses.Span | None) -> list[str]:
    """Return what a reader must know about the messages of a bag, one line each."""
    return [*bag.notes, *refused_messages(bag), *without_poses(bag), *landed_by_itself(bag),
            *ended_in_the_air(bag), *stamps.doubtful(bag), *damaged.not_finite(bag),
            *damaged.poses_not_finite(bag), *losses.describe(bag, flight),
            *stamps.repeated(bag, motion.MOTIONS), *slips.own_leap(bag),
            *height_check.of_bag(bag), *_other_flight(bag)]


def _other_flight(bag: Bag) -> list[str]:
    """Return lines on sensors of a recorded flight that are not of that of its capture."""
    if pair.simulated(bag) or 'optitrack/pose' not in bag:
        return []
    try:
        tracked = motion.read(bag, 'optitrack/pose')
    except BagError:  # what compares it says so
        return []
    return [f'{line}: is the motion capture of another flight?'
            for line in same_flight.of_bag(bag, tracked).lines]


def compare(bag: Bag) -> dict[str, Any]:
    """
    Return tracking errors, estimation errors and message losses of a flight.

    Parameters
    ----------
    bag
        Of :func:`mambo_bags.reader.read_bag`, any topics may be missing.

    Returns
    -------
    ``bag``, ``duration`` [s], ``real_time_factor``, ``source`` (of an imported flight),
    ``takeoff_end`` [s], ``landing_start`` [s], ``takeoff``; ``ending``: what ended the flight
    before its time, a line each; ``errors``: a list of sections with
    ``title``, ``unit``, ``axes`` and ``rows`` (``part``, ``count``, ``rms``, ``rms_total``,
    ``maximum``, ``maximum_total``); ``topics`` with ``messages``, ``rate`` [Hz] and ``lost``;
    ``notes``. Plain numbers, lists and texts throughout.

    Raises
    ------
    BagError
        If a topic has another type than in ``TYPES``.

    """
    check_types(bag)
    flight = losses.span(bag)
    parts, notes = losses.flown(bag, flight), _doubts(bag, flight)
    errors = [pair.section(comparison['position'], comparison.title, parts)
              for comparison in pair.within(bag, parts, notes)]
    if 'onboard/odom' in bag and 'estimate/odom' in bag:
        errors += _against_onboard(bag['estimate/odom'], bag['onboard/odom'], parts, notes)
    return {
        'bag': bag.path.name, 'duration': (bag.end - bag.start) * 1e-9,
        'real_time_factor': _factor(bag),
        'source': bag.metadata.get('import', {}).get('source_file'),
        **_takeoff(parts, bag.end), 'landing_start': _seconds(parts.landing_start),
        'ending': ended_early(bag), 'errors': errors,
        'topics': _topics(bag, flight), 'notes': list(dict.fromkeys(notes))}


def _seconds(stamp: int | None) -> float | None:
    return None if stamp is None else stamp * 1e-9


def _takeoff(parts: Phases, end: int) -> dict[str, Any]:
    """Return when the take-off ends, if the recording goes on until then, and how it is known."""
    if parts.takeoff_end is None or parts.takeoff_end <= end:
        return {'takeoff_end': _seconds(parts.takeoff_end), 'takeoff': parts.text}
    return {'takeoff_end': None, 'takeoff': (
        f'the recording ends before the take-off, at {parts.takeoff_end * 1e-9:.2f} s: '
        f'{parts.text}')}


def _rows(table: NDArray, index: Ints) -> NDArray:
    """Return rows of a table, without a copy where it is all of them."""
    return table if np.array_equal(index, np.arange(len(table))) else table[index]


def _identical(recorded: Messages, replayed: Messages) -> list[str]:
    """Describe how a replayed estimate differs from the recorded one, message by message."""
    here, there = metrics.common_stamps(recorded.stamp, replayed.stamp)
    a, b = recorded.table, replayed.table
    if a is not None and b is not None and a.shape[1] == b.shape[1]:
        same = (_rows(a, here) == _rows(b, there)).all(axis=1)
    else:
        same = np.array(
            [recorded.raw[i] == replayed.raw[j] for i, j in zip(here, there)], bool)
    lines = [f'estimate/odom: {same.sum()} of {len(recorded)} recorded messages answered '
             f'bit for bit, {len(replayed)} replayed']
    if not same.all():
        first = recorded.stamp[here[~same][0]] * 1e-9
        apart = np.linalg.norm(
            recorded.position[here[~same]] - replayed.position[there[~same]], axis=1).max()
        lines.append(f'first difference at {first:.3f} s, largest {apart:.3g} m')
    return lines


def _lacking(origin: Bag) -> list[str]:
    """Return the topics without samples that the estimator waits for: IMU and what is counted."""
    ticks = origin['sensor_tick'] if 'sensor_tick' in origin else None
    return [name for name, field in COUNTED.items()
            if not (name in origin and len(origin[name]))
            and (name == 'imu/data_raw' or ticks is not None and ticks[field].any())]


def compare_replay(origin: Bag, answer: Bag) -> str:
    """
    Compare a replayed estimate with the recorded one.

    Parameters
    ----------
    origin
        Bag whose sensors were replayed.
    answer
        Bag with the estimate that answered.

    Returns
    -------
    Text: the share of recorded estimates answered bit for bit, if the source has any; the error
    of the replayed estimate against Optitrack or ground truth, and against ``onboard/odom``.

    Raises
    ------
    BagError
        If the replay holds no estimate, or a topic has another type than in ``TYPES``.

    """
    for bag in (origin, answer):
        check_types(bag)
    if 'estimate/odom' not in answer:
        lacking = _lacking(origin)
        why = (f'as {origin.path} has no samples of {" and ".join(lacking)}'
               if lacking else 'the estimator did not answer')
        raise BagError(f'{answer.path}: no estimate/odom, {why}')
    flight = losses.span(origin)
    estimate, parts, lines = answer['estimate/odom'], losses.flown(origin, flight), []
    notes = [*origin.notes, *stamps.doubtful(origin), *damaged.not_finite(origin),
             *(f'{name}: {line}' for name, bag in (('recorded', origin), ('replayed', answer))
               for line in (*damaged.poses_not_finite(bag), *losses.describe(bag, flight)))]
    sections = []
    if 'estimate/odom' in origin:
        lines += _identical(origin['estimate/odom'], estimate)
    for name in ('optitrack/pose', 'ground_truth/odom'):
        if name in origin:
            ours, truth = motion.read(answer, 'estimate/odom'), motion.read(origin, name)
            notes += pair.left_out((truth,))
            alignment = pair.replay_alignment(origin, ours, truth)
            if alignment is not None:
                notes.append(alignment.text)
                ours = alignment.moved(ours)
            error = pair.positions(ours, truth)
            sections.append(pair.section(
                error, f'estimation error: replayed estimate/odom minus {name}', parts))
            break
    if 'onboard/odom' in origin:
        sections += _against_onboard(estimate, origin['onboard/odom'], parts, notes)
    for section in sections:
        lines += ['', *tables.section(section)]
    if not lines:
        notes.append(f'{origin.path.name} has nothing to compare the estimate with')
    return '\n'.join([*lines, '', *(f'note: {note}' for note in notes)]).strip('\n')


def _parts(a: Bag, b: Bag, ours: motion.Motion, theirs: motion.Motion, offset: int) -> Phases:
    """Return the flight phases on B's clock: recorded by B or A, else detected from a height."""
    for recorded, moved in ((phases(b), 0), (phases(a), offset)):
        if recorded.takeoff_end is not None:
            return recorded.moved(moved)
    seen = detect_phases(theirs)
    return seen if seen.takeoff_end is not None else detect_phases(ours)


def _reference(a: Bag, b: Bag, alignment: Alignment) -> str | None:
    """Return whether two flights had the same reference; None if one has no reference."""
    if a is b or 'reference' not in a or 'reference' not in b:
        return None
    apart = []
    for offset in (0, alignment.offset):  # each on its own clock, then on a common one
        try:
            ours = motion.read(a, 'reference').moved(offset, 0.0, np.zeros(3))
            error = pair.motions(ours, motion.read(b, 'reference'))[0].error
            apart.append(float(np.nanmax(np.linalg.norm(error, axis=1))))
        except BagError:
            continue
    if not apart:
        return 'the references have no time in common'
    if min(apart) < 1e-6:
        return 'both flew the same reference'
    return f'the flights had different references, up to {min(apart):.3f} m apart'


def _differences(a: Bag, b: Bag) -> list[list[Any]]:
    """Return (parameter, value in A, value in B) of all parameters that differ."""
    if a.scenario is None or b.scenario is None:
        return []
    ours, theirs = parameters(a.scenario), parameters(b.scenario)
    return [[name, ours.get(name), theirs.get(name)] for name in {**ours, **theirs}
            if ours.get(name) != theirs.get(name)]


def compare_bags(
    a: Bag, b: Bag | None = None, a_topic: str | None = None, b_topic: str | None = None,
    what: Collection[str] | None = None, equal_at: float | None = None,
) -> tuple[dict[str, Any], Comparison, Alignment]:
    """
    Compare two flights, or two topics of one: A minus B, on the clock and in the frame of B.

    Parameters
    ----------
    a, b
        Simulation and experiment, say; without ``b`` both topics are of ``a``.
    a_topic, b_topic
        Odometry or PoseStamped; default: the best that both have, of ground truth, Optitrack,
        estimate and the drone's own estimate, in this order.
    what
        To be made equal first, of ``pair.WHAT``; default: nothing for two simulated flights or
        two topics of one bag, everything otherwise.
    equal_at : s
        After take-off: the positions are made equal there, as in section 5.4.

    Returns
    -------
    result
        ``bags``, ``compared`` (topics), ``duration`` [s] in common, ``alignment``,
        ``takeoff_end`` [s], ``landing_start`` [s], ``takeoff``, ``ending``, ``errors``
        (:func:`mambo_analysis.compare.pair.section`, one a quantity), ``differences`` of the
        scenarios (parameter, A, B) and ``notes``. Plain numbers, lists and texts.
    comparison, alignment
        The signals behind it.

    Raises
    ------
    BagError
        If a topic lacks or holds no motion, or the two have nothing in common.

    """
    other = a if b is None else b
    ours = motion.read(a, motion.choose(a, a_topic, other, b_topic))
    theirs = motion.read(other, motion.choose(other, b_topic, a, a_topic))
    if other is a and ours.name == theirs.name:
        raise BagError(f'{a.path}: {ours.name} with itself; name another --a-topic or --b-topic')
    own = what is None and equal_at is None and other is a and not pair.simulated(a) \
        and ours.frame != theirs.frame
    if what is None:
        what = () if b is None or pair.simulated(a) and pair.simulated(b) else pair.WHAT
    begin = None
    if equal_at is not None:
        start = _parts(a, other, ours, theirs, 0) if other is a else _parts(
            other, other, theirs, theirs, 0)
        if start.liftoff is None:
            raise BagError(f'--equal-at counts from take-off: {start.text or "none is recorded"}')
        begin = start.liftoff * 1e-9 + equal_at
    alignment = pair.own_origin(ours, theirs, pair.begins_in_air(
        theirs, max(ours.stamps[0], theirs.stamps[0]))) if own else pair.aligned(
            ours, theirs, what, begin)
    ours = alignment.moved(ours)
    flights = [losses.span(a)] if other is a else [losses.span(a), losses.span(other)]
    ends = [flight.end + offset for flight, offset in zip(flights[::-1], (0, alignment.offset))
            if flight is not None]
    parts = _parts(a, other, ours, theirs, alignment.offset)._replace(end=min(ends, default=None))
    quantities = pair.motions(ours, theirs)
    if other is not a:
        quantities += pair.commands(a, other, alignment.offset)
    comparison = Comparison(
        f'{ours.name} of A minus {theirs.name} of B', (f'A: {ours.name}', f'B: {theirs.name}'),
        tuple(quantities), parts)
    both = (('', a),) if other is a else (('A: ', a), ('B: ', other))
    notes = [*(f'{name}{line}' for (name, bag), flight in zip(both, flights)
               for line in _doubts(bag, flight)),
             alignment.text, _reference(a, other, alignment), *pair.left_out((ours, theirs)),
             *(f'no {name}: only compared where both tell it'
               for name in ('velocity', 'attitude') if name not in {q.name for q in quantities})]
    there = quantities[0].stamps[np.isfinite(quantities[0].error).all(axis=1)]
    return {
        'bags': [a.path.name, other.path.name], 'compared': [ours.name, theirs.name],
        'duration': float(there[-1] - there[0]) * 1e-9, 'alignment': alignment._asdict(),
        'takeoff_end': _seconds(parts.takeoff_end), 'landing_start': _seconds(parts.landing_start),
        'takeoff': parts.text,
        'ending': [f'{name}{line}' for name, bag in both for line in ended_early(bag)],
        'errors': comparison.sections(),
        'differences': _differences(a, other), 'notes': [note for note in notes if note],
    }, comparison, alignment


def _plain(value: Any) -> Any:
    """Return a result with NaN replaced, as JSON has no NaN."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def parser() -> Parser:
    """Return the command line of ``compare``."""
    out = Parser(
        'compare',
        'Print the errors of a flight, or of flight A against flight B; write them '
                    'as a page, CSV or JSON.',
        epilog='examples:\n'
               '  compare FLIGHT                          tracking and estimation error\n'
               '  compare SIMULATION EXPERIMENT --html report.html\n'
               '  compare FOLDER --html report.html       several drones in one hall\n'
               '  compare A B --a-topic estimate/odom --align time,yaw --equal-at 6\n'
               '  compare FLIGHT --a-topic estimate/odom --b-topic ground_truth/odom\n')
    add = out.add_argument
    add('bag', type=Path, metavar='A', help='rosbag2 directory or .mcap file, or '
        'the folder that holds the bags of several drones in one hall')
    add('other', type=Path, metavar='B', nargs='?', help='the bag to compare with')
    add('--html', type=Path, metavar='FILE', help='write a report with plots and the flight, one '
        'file that needs no network; an older file is replaced')
    add('--csv', type=Path, metavar='FILE', help='write the numbers, one a line; an older '
        'file is replaced')
    out.add_json()
    out.add_output('DIR', 'write this report as index.html, and flight.png with the plots of A on '
                          'one sheet, into this directory; older files are replaced')
    add('--a-topic', metavar='TOPIC', help='of A, an Odometry or a PoseStamped (default: the '
        'best that both have of ground_truth/odom, optitrack/pose, estimate/odom, onboard/odom)')
    add('--b-topic', metavar='TOPIC', help='of B, or of A without B')
    add('--align', metavar='LIST', help='what of A is made equal to B first: '
        f'{",".join(pair.WHAT)} (default: all, nothing for simulated flights and for one bag)')
    add('--no-align', action='store_true', help='take clocks and frames as they are')
    add('--equal-at', type=real(0.0, 1e6, 's'), metavar='S',
        help='make the positions equal S seconds after take-off (section 5.4)')
    add('--namespace', help='of the drone, if a bag has several')
    return out


def _what(options: argparse.Namespace) -> Collection[str] | None:
    """Return the quantities to align; BagError for an unknown one."""
    if options.no_align and (options.align or options.equal_at is not None):
        raise BagError('--no-align contradicts --align and --equal-at: give one of them')
    if options.no_align or options.align is None:
        return () if options.no_align else None
    what = {name.strip() for name in options.align.split(',')}
    if unknown := sorted(what - set(pair.WHAT)):
        raise BagError(
            f'--align {options.align}: {unknown[0]!r} is none of {", ".join(pair.WHAT)}')
    return what


def _work(options: argparse.Namespace) -> None:
    if separation.is_folder(options.bag):
        from . import separation_page
        separation_page.work(options)
        return
    bag = read_bag(options.bag, namespace=options.namespace)
    what = _what(options)
    is_pair = options.other is not None or options.a_topic or options.b_topic
    if is_pair:
        other = read_bag(options.other, namespace=options.namespace) if options.other else None
        found = compare_bags(bag, other, options.a_topic, options.b_topic, what, options.equal_at)
        result = found[0]
    else:
        if what is not None or options.equal_at is not None:
            raise BagError('--align, --no-align and --equal-at need two bags or two topics')
        bag.leave_out_unreadable()
        result = compare(bag)
    if options.json != '-':
        print(table(result))
    written = []
    if options.json:
        written.append(('numbers', write_json(
            options.json, json.dumps(_plain(result), indent=2, allow_nan=False))))
    if options.csv:
        written.append(('numbers', tables.write_csv(result, options.csv)))
    if options.html or options.output:
        from . import figures, report
        page = report.of_two(bag, other, *found) if is_pair else report.of_one(bag, result)
        written += [('page', report.write(path, page)) for path in (
            options.html, options.output and options.output / 'index.html') if path]
        if options.output:
            figures.write_overview(bag, options.output / 'flight.png', bag.path.name)
    if options.json != '-':
        for what, path in written:
            print(f'\n{what}: {path}')


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``compare``."""
    options = parser().parse_args(arguments)
    return guard('compare', lambda: _work(options))


if __name__ == '__main__':
    raise SystemExit(main())
