"""
The table of a flight: ``compare BAG``.

For a flight with a reference: tracking error (ground truth, or Optitrack without it, minus
reference) and estimation error (estimate minus Optitrack), before and after the end of the
take-off. For an imported flight: the estimate against the drone's own. For any: messages, rates
and losses of each topic.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from . import metrics
from .bag import Bag, BagError, Messages, read_bag
from .cli import guard
from .metrics import Floats, Ints

STEP = 5_000_000  # [ns] of the 200 Hz topics
STEADY = (
    'imu/data_raw', 'sensor_tick', 'ground_truth/odom', 'estimate/odom', 'estimator/state',
    'reference', 'controller/state', 'motor_pwm', 'onboard/odom', 'onboard/reference')
COUNTED = {
    'imu/data_raw': 'imu', 'sonar/range': 'sonar', 'optical_flow': 'optical_flow',
    'barometer/pressure': 'barometer'}
"""Topics whose samples ``sensor_tick`` counts: the field that does."""
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
BLEND = 3.0  # [s] to the trajectory where the bag does not say how long it takes


class Phases(NamedTuple):
    """Stamps [ns] that part a flight; None where the bag does not tell."""

    takeoff_end: int | None
    landing_start: int | None
    text: str  # how the take-off ended


def _plan(content: Any) -> dict[str, float]:
    """Return the mapping inside a scenario that holds ``blend_duration``, or an empty one."""
    if isinstance(content, dict):
        if isinstance(content.get('blend_duration'), (int, float)):
            return content
        for inner in content.values():
            if found := _plan(inner):
                return found
    return {}


def phases(bag: Bag) -> Phases:
    """Return when take-off ends and landing begins, by the phases of the reference."""
    if 'reference' not in bag:
        return Phases(None, None, '')
    reference = bag['reference']
    phase, stamps = reference.phase, reference.stamp
    track = phase == reference.constant('PHASE_TRACK')
    landing = np.isin(
        phase, (reference.constant('PHASE_LANDING'), reference.constant('PHASE_LANDED')))
    landing &= stamps > (stamps[track][0] if track.any() else -1)
    landing_start = int(stamps[landing][0]) if landing.any() else None
    if not track.any():
        return Phases(None, landing_start, 'the trajectory is never reached')
    begin = int(stamps[track][0])
    if track[0]:
        return Phases(begin, landing_start, 'no take-off, on the trajectory from the start')
    blend = _plan(bag.scenario).get('blend_duration')
    seconds = BLEND if blend is None else float(blend)
    return Phases(
        begin + round(seconds * 1e9), landing_start,
        f'phase TRACK from {begin * 1e-9:.2f} s and {seconds:g} s of blend'
        f'{" (assumed, the bag does not tell)" if blend is None else ""}')


def _row(name: str, stamps: Ints, errors: Floats, begin: int | None, end: int | None,
         ) -> dict[str, Any]:
    """Return the statistics of one part of a flight, begin <= stamp < end."""
    inside = np.ones(len(stamps), bool)
    if begin is not None:
        inside &= stamps >= begin
    if end is not None:
        inside &= stamps < end
    s = metrics.statistics(errors[inside])
    return {'part': name, 'count': s.count, 'rms': list(s.rms), 'rms_total': s.rms_total,
            'maximum': list(s.maximum), 'maximum_total': s.maximum_total}


def _section(
    title: str, unit: str, axes: tuple[str, ...], stamps: Ints, errors: Floats, parts: Phases,
) -> dict[str, Any]:
    """Return an error signal as rows: whole flight, take-off, after it, landing."""
    rows = [_row('whole flight', stamps, errors, None, None)]
    if parts.takeoff_end is not None:
        rows.append(_row('take-off', stamps, errors, None, parts.takeoff_end))
        rows.append(_row('after take-off', stamps, errors, parts.takeoff_end, parts.landing_start))
        if parts.landing_start is not None:
            rows.append(_row('landing', stamps, errors, parts.landing_start, None))
    return {'title': title, 'unit': unit, 'axes': list(axes),
            'rows': [row for row in rows if row['count']] or rows[:1]}


XYZ = ('x', 'y', 'z')


def position_errors(signal: Messages, truth: Messages) -> tuple[Ints, Floats]:
    """
    Return stamps (n,) ns and position errors (n, 3) m of a signal, at its own stamps.

    The truth is interpolated by its stamps, not over gaps of more than three of its periods and
    not beyond its ends: NaN there.
    """
    gap = metrics.usual_period(truth.stamp)
    gap = STEP if math.isnan(gap) else gap
    there = metrics.interpolate(signal.stamp, truth.stamp, truth.position, round(3.5 * gap))
    return signal.stamp, signal.position - there


def _tracking(bag: Bag, parts: Phases, notes: list[str]) -> list[dict[str, Any]]:
    source = next((name for name in ('ground_truth/odom', 'optitrack/pose') if name in bag), None)
    if 'reference' not in bag or source is None:
        notes.append('no tracking error: it needs reference and ground_truth/odom or '
                     'optitrack/pose')
        return []
    stamps, errors = position_errors(bag['reference'], bag[source])
    return [_section(
        f'tracking error: {source} minus reference', 'm', XYZ, stamps, errors, parts)]


def _estimation(bag: Bag, parts: Phases, notes: list[str]) -> list[dict[str, Any]]:
    if 'estimate/odom' not in bag:
        notes.append('no estimate/odom in the bag')
        return []
    sections = [
        _section(f'estimation error: estimate/odom minus {source}', 'm', XYZ,
                 *position_errors(bag['estimate/odom'], bag[source]), parts)
        for source in ('optitrack/pose', 'ground_truth/odom') if source in bag]
    if not sections and 'onboard/odom' not in bag:
        notes.append('no estimation error: it needs optitrack/pose or ground_truth/odom')
    return sections[:1]


class Aligned(NamedTuple):
    """Two odometries at common stamps, the first turned and moved onto the start of the other."""

    stamps: Ints       # (n,) ns
    position: Floats   # (n, 3) m, difference
    velocity: Floats   # (n, 3) m/s, body FLU, difference
    attitude: Floats   # (n, 3) deg, roll, pitch, yaw in z-up axes, difference
    yaw: float         # deg by which the first was turned


def align(odometry: Messages, other: Messages) -> Aligned | None:
    """
    Return the differences of two odometries, position and yaw made equal at the first stamp.

    None if they have no stamp in common.
    """
    here, there = metrics.common(odometry.stamp, other.stamp)
    if not len(here):
        return None
    angles, own = (
        Rotation.from_quat(messages.orientation[index]).as_euler('ZYX')[:, ::-1]
        for messages, index in ((other, there), (odometry, here)))
    turn = angles[0, 2] - own[0, 2]
    own = own + np.array([0.0, 0.0, turn])
    p = odometry.position[here]
    p = Rotation.from_euler('z', turn).apply(p - p[0]) + other.position[there][0]
    wrapped = (own - angles + math.pi) % (2.0 * math.pi) - math.pi
    return Aligned(
        odometry.stamp[here], p - other.position[there],
        odometry.velocity[here] - other.velocity[there], np.degrees(wrapped),
        math.degrees((turn + math.pi) % (2.0 * math.pi) - math.pi))


def _against_onboard(
    estimate: Messages, onboard: Messages, parts: Phases, notes: list[str],
) -> list[dict[str, Any]]:
    aligned = align(estimate, onboard)
    if aligned is None:
        notes.append('estimate/odom and onboard/odom have no stamp in common: not compared')
        return []
    notes.append(
        f'against onboard/odom: position and yaw made equal at {aligned.stamps[0] * 1e-9:.3f} s '
        f'(turned by {aligned.yaw:.2f} deg); an onboard estimate is no ground truth')
    what = 'estimate/odom minus onboard/odom'
    return [
        _section(f'position, {what}', 'm', XYZ, aligned.stamps, aligned.position, parts),
        _section(f'velocity in body axes, {what}', 'm/s', XYZ, aligned.stamps, aligned.velocity,
                 parts),
        _section(f'attitude, {what}', 'deg', ('roll', 'pitch', 'yaw'), aligned.stamps,
                 aligned.attitude, parts)]


def _lost(bag: Bag, topic: str, messages: Messages) -> int | None:
    """Return how many messages a topic lacks; None if nothing in the bag tells."""
    if topic in COUNTED and 'sensor_tick' in bag:
        tick = bag['sensor_tick']
        last = int(np.argmax(tick.stamp))
        have = int((messages.stamp <= tick.stamp[last]).sum())
        return max(int(tick[COUNTED[topic]][last]) - have, 0)
    if topic in STEADY:
        return metrics.missing(messages.stamp, STEP)
    if topic == 'optitrack/pose':
        period = metrics.usual_period(messages.stamp)
        return 0 if math.isnan(period) else metrics.missing(messages.stamp, period)
    return None


def check_types(bag: Bag) -> None:
    """Raise BagError if a topic that is compared or drawn has another type than expected."""
    for topic, expected in TYPES.items():
        found = bag.topics.get(bag.name(topic), expected)
        if found != expected:
            raise BagError(
                f'{bag.path}: {bag.name(topic)} has the type {found}, expected {expected}')


def _topics(bag: Bag) -> list[dict[str, Any]]:
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
                entry['lost'] = _lost(bag, topic, messages)
            except BagError:  # of an unknown encoding: counted, not decoded
                stamps = messages.log_time
            span = int(stamps.max() - stamps.min()) * 1e-9
            entry['rate'] = (len(messages) - 1) / span if span > 0.0 else None
        out.append(entry)
    return out


def _factor(bag: Bag) -> float | None:
    """Return the real-time factor that the bag tells, if any."""
    for values in (bag.custom_data, *bag.metadata.values()):
        try:
            return float(values['real_time_factor'])
        except (KeyError, ValueError):
            continue
    return None


def compare(bag: Bag) -> dict[str, Any]:
    """
    Compare what a bag says about one flight.

    Parameters
    ----------
    bag
        Of :func:`mambo_analysis.bag.read_bag`, any topics may be missing.

    Returns
    -------
    ``bag``, ``duration`` [s], ``real_time_factor``, ``source`` (of an imported flight),
    ``takeoff_end`` [s], ``landing_start`` [s], ``takeoff``; ``errors``: a list of sections with
    ``title``, ``unit``, ``axes`` and ``rows`` (``part``, ``count``, ``rms``, ``rms_total``,
    ``maximum``, ``maximum_total``); ``topics`` with ``messages``, ``rate`` [Hz] and ``lost``;
    ``notes``. Plain numbers, lists and texts throughout.

    Raises
    ------
    BagError
        If a topic has another type than in ``TYPES``.

    """
    check_types(bag)
    parts, notes = phases(bag), []
    imported = 'onboard/odom' in bag
    errors = [] if imported and 'reference' not in bag else _tracking(bag, parts, notes)
    if imported and 'estimate/odom' not in bag:
        notes.append('an imported flight without estimate/odom: let the estimator fly it with '
                     f'ros2 run mambo_bringup replay {bag.path}')
    else:
        errors += _estimation(bag, parts, notes)
    if imported and 'estimate/odom' in bag:
        errors += _against_onboard(bag['estimate/odom'], bag['onboard/odom'], parts, notes)
    return {
        'bag': bag.path.name, 'duration': (bag.end - bag.start) * 1e-9,
        'real_time_factor': _factor(bag),
        'source': bag.metadata.get('import', {}).get('source_file'),
        'takeoff_end': _seconds(parts.takeoff_end), 'landing_start': _seconds(parts.landing_start),
        'takeoff': parts.text, 'errors': errors, 'topics': _topics(bag), 'notes': notes}


def _seconds(stamp: int | None) -> float | None:
    return None if stamp is None else stamp * 1e-9


def _errors_table(section: Mapping[str, Any]) -> list[str]:
    axes, unit = section['axes'], section['unit']
    head = ''.join(f'{axis:>9}' for axis in (*axes, 'total'))
    lines = [section['title'], f'{f"RMS [{unit}]":<18}{head}{"max":>9}{"samples":>9}']
    for row in section['rows']:
        if not row['count']:
            lines.append(f'  {row["part"]:<16}  nothing to compare')
            continue
        numbers = ''.join(
            f'{value:9.4f}' for value in (*row['rms'], row['rms_total'], row['maximum_total']))
        lines.append(f'  {row["part"]:<16}{numbers}{row["count"]:9d}')
    return lines


def table(result: Mapping[str, Any]) -> str:
    """Return the result of :func:`compare` as plain text of at most 80 columns where it can."""
    head = f'{result["bag"]}: {result["duration"]:.2f} s'
    if result['real_time_factor'] is not None:
        head += f', real-time factor {result["real_time_factor"]:.2f}'
    if result['source']:
        head += f', imported from {result["source"]}'
    lines = [head]
    if result['takeoff_end'] is not None:
        lines.append(f'take-off ends at {result["takeoff_end"]:.2f} s: {result["takeoff"]}')
    elif result['takeoff']:
        lines.append(result['takeoff'])
    if result['landing_start'] is not None:
        lines.append(f'landing begins at {result["landing_start"]:.2f} s')
    for section in result['errors']:
        lines += ['', *_errors_table(section)]
    width = max([len(entry['topic']) for entry in result['topics']] + [10])
    lines += ['', f'{"topic":<{width}}{"messages":>10}{"Hz":>9}{"lost":>7}']
    for entry in result['topics']:
        rate = '-' if entry['rate'] is None else f'{entry["rate"]:.1f}'
        lost = '-' if entry['lost'] is None else str(entry['lost'])
        lines.append(f'{entry["topic"]:<{width}}{entry["messages"]:>10}{rate:>9}{lost:>7}')
    if result['notes']:
        lines += ['', *(f'note: {note}' for note in result['notes'])]
    return '\n'.join(lines)


def _identical(recorded: Messages, replayed: Messages) -> list[str]:
    """Say how a replayed estimate differs from the recorded one, payload by payload."""
    here, there = metrics.common(recorded.stamp, replayed.stamp)
    equal = sum(recorded.raw[i] == replayed.raw[j] for i, j in zip(here, there))
    lines = [f'estimate/odom: {equal} of {len(recorded)} recorded messages answered bit for bit, '
             f'{len(replayed)} replayed']
    if equal < len(here):
        different = [(i, j) for i, j in zip(here, there) if recorded.raw[i] != replayed.raw[j]]
        first = recorded.stamp[different[0][0]] * 1e-9
        apart = np.linalg.norm(
            recorded.position[[i for i, _ in different]]
            - replayed.position[[j for _, j in different]], axis=1).max()
        lines.append(f'first difference at {first:.3f} s, largest {apart:.3g} m')
    return lines


def compare_replay(source: Path, replayed: Path) -> str:
    """
    Compare a replayed estimate with what the source bag holds.

    Parameters
    ----------
    source
        Bag whose sensors were replayed.
    replayed
        Bag with the estimate that answered.

    Returns
    -------
    Text: the share of recorded estimates answered bit for bit, if the source has any; the error
    of the replayed estimate against Optitrack or ground truth, and against ``onboard/odom``.

    Raises
    ------
    BagError
        If a bag cannot be read or the replay holds no estimate.

    """
    origin, answer = read_bag(source), read_bag(replayed)
    for bag in (origin, answer):
        check_types(bag)
    if 'estimate/odom' not in answer:
        raise BagError(f'{replayed}: no estimate/odom, the estimator did not answer')
    estimate, parts, lines = answer['estimate/odom'], phases(origin), []
    notes: list[str] = []
    sections = []
    if 'estimate/odom' in origin:
        lines += _identical(origin['estimate/odom'], estimate)
    for name in ('optitrack/pose', 'ground_truth/odom'):
        if name in origin:
            sections.append(_section(
                f'estimation error: replayed estimate/odom minus {name}', 'm', XYZ,
                *position_errors(estimate, origin[name]), parts))
            break
    if 'onboard/odom' in origin:
        sections += _against_onboard(estimate, origin['onboard/odom'], parts, notes)
    for section in sections:
        lines += ['', *_errors_table(section)]
    if not lines:
        notes.append(f'{source.name} has nothing to compare the estimate with')
    return '\n'.join([*lines, '', *(f'note: {note}' for note in notes)]).strip('\n')


def _plain(value: Any) -> Any:
    """Return a result without NaN, which JSON does not know."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``compare``."""
    parser = argparse.ArgumentParser(
        prog='compare', description='Print the table of a flight; with --out, write its page.')
    parser.add_argument('bag', type=Path, help='rosbag2 directory or .mcap file')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='write flight.png and index.html into this directory')
    parser.add_argument('--json', action='store_true', help='print numbers as JSON, no table')
    parser.add_argument('--namespace', help='of the drone, if the bag has several')
    options = parser.parse_args(arguments)

    def work() -> None:
        bag = read_bag(options.bag, namespace=options.namespace)
        result = compare(bag)
        print(json.dumps(_plain(result), indent=2, allow_nan=False) if options.json
              else table(result))
        if options.out:
            from .page import write_page
            written = write_page(bag, result, options.out)
            if not options.json:
                print(f'\npage: {written}')

    return guard('compare', work)


if __name__ == '__main__':
    raise SystemExit(main())
