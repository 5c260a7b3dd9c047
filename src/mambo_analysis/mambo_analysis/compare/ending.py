"""End of a flight and messages refused by its nodes, read from the bag alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
import re
from typing import Any

from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag
from mambo_control.failsafe import REASONS, STAGES
from mambo_control.safety import REASON_ESTIMATE, REASON_GROUNDED
from mambo_estimation.capture.report import longest
from mambo_model.motion.flight_command import SETPOINT
from mambo_model.motion.height_check import DROP, flight_fault, idle_fault, over_in_the_air
from mambo_model.motion.rigid_body import LIFTED
from mambo_model.motion.trajectory import in_flight, LANDED, LANDING
from mambo_model.script import python
from mambo_signals.resample import Ints
import numpy as np
from numpy.typing import NDArray

REPORTS = ('/diagnostics', 'diagnostics')
"""Topics of diagnostic reports."""
ENDINGS = ('/clock', 'clock', *REPORTS, 'reference', 'ground_truth/odom', 'motor_pwm',
           'command')
"""Topics that show how a flight ended."""
_STEP = 0.005  # s
_ERROR = 2
_FINALS = ('sim_node', 'controller_node')  # nodes whose error ends a flight
_WITHOUT = re.compile(r'(?:motion capture refused|no motion capture) for (\d+\.\d) s')
_REFUSED = 'refused messages: '
_INPUTS = ': inputs'  # suffix of the diagnostic status with the messages that a node refused


def _parameter(bag: Bag, node_name: str, *path: str) -> Any:
    """Return a parameter of a node from the scenario in a bag; None without a scenario."""
    for name, node in (bag.scenario or {}).items():
        if str(name).endswith(f'/{node_name}'):
            for part in ('ros__parameters', *path):
                node = node.get(part) if isinstance(node, dict) else None
            return node
    return None


def _planned(bag: Bag) -> float:
    """Return the duration of the scenario in a bag, s; 0 if it has none."""
    try:
        return float(_parameter(bag, 'sim_node', 'duration') or 0.0)
    except (TypeError, ValueError):
        return 0.0


def _carried(bag: Bag) -> bool:
    """Return whether a hand carries the vehicle, which then needs no controller."""
    return _parameter(bag, 'sim_node', 'simulator', 'hand', 'enabled') is True


def _beside_reference(bag: Bag, topic: str) -> tuple[Ints, Ints] | None:
    """Return the rows of a topic and of the reference with the same stamps; None without both."""
    if topic not in bag or 'reference' not in bag:
        return None
    _, rows, asked = np.intersect1d(bag[topic].stamp, bag['reference'].stamp, return_indices=True)
    return rows, asked


def _flight_fault(bag: Bag, ended: bool) -> str:
    """Return how the vehicle did not follow its reference, or fell after its end, or ''."""
    if (rows := _beside_reference(bag, 'ground_truth/odom')) is None:
        return ''
    (true, asked), truth, reference = rows, bag['ground_truth/odom'], bag['reference']
    floor = _parameter(bag, 'sim_node', 'simulator', 'plant', 'ground') is not False
    return flight_fault(
        reference.t[asked], truth.position[true], reference.position[asked],
        reference.phase[asked], _turning(bag, reference.stamp[asked]), floor, ended)


def _idle_fault(bag: Bag) -> str:
    """Return for how long a simulated vehicle's motors turned while none were asked for, or ''."""
    if any(name not in bag or not len(bag[name])
           for name in ('ground_truth/odom', 'motor_pwm', 'reference')):
        return ''
    motors, reference = bag['motor_pwm'], bag['reference']
    order = np.argsort(motors.stamp, kind='stable')
    newest = _newest(reference.stamp, motors.stamp[order])
    follows = ~motors['shutdown'].astype(bool) & (motors['reason'] == 0)
    turning = (follows & (motors.pwm > 0.0).any(axis=1))[order] & (newest >= 0)
    return idle_fault(motors.t[order], reference.phase[newest], turning)


def _had_landed(bag: Bag, t: float) -> bool:
    """Return whether the reference had landed at a time in s."""
    if 'reference' not in bag:
        return False
    reference = bag['reference']
    before = reference.t <= t
    return bool(before.any()) and int(reference.phase[before][-1]) == LANDED


def _turning(bag: Bag, stamps: Ints) -> NDArray[np.bool_]:
    """Return whether motors turn at these times, by the newest command; not without commands."""
    if 'motor_pwm' not in bag or not len(bag['motor_pwm']):
        return np.zeros(len(stamps), bool)
    motors = bag['motor_pwm']
    newest = _newest(motors.stamp, stamps)
    return (newest >= 0) & (motors.pwm > 0.0).any(axis=1)[newest]


def _newest(stamps: Ints, at: Ints) -> Ints:
    """Return the rows with the newest of some stamps at these times; -1 where there is none."""
    order = np.argsort(stamps, kind='stable')
    found = np.searchsorted(stamps[order], at, 'right') - 1
    return np.where(found >= 0, order[found], -1)


def _height(bag: Bag, stamp: int) -> float:
    """Return the true height above the floor at a time in ns, m; NaN without the truth."""
    if 'ground_truth/odom' not in bag or not len(bag['ground_truth/odom']):
        return math.nan
    truth = bag['ground_truth/odom']
    newest = int(_newest(truth.stamp, np.array([stamp]))[0])
    return float(truth.position[max(newest, 0), 2])


def reason_in_words(bag: Bag, stamp: int, reason: int) -> str:
    """
    Return a reason of ``motor_pwm`` in words, as far as it is known.

    The controller that stops on the floor knows the height by its estimate alone. Where the bag
    has the truth and the vehicle was above the floor, the estimate was lost.

    Parameters
    ----------
    bag
        Of :func:`mambo_bags.reader.read_bag`.
    stamp : ns
        When the reason was given first.
    reason
        ``MotorPwm.REASON_*``.

    """
    if reason == REASON_GROUNDED and _height(bag, stamp) > LIFTED:
        reason = REASON_ESTIMATE
    return REASONS[reason] if 0 <= reason < len(REASONS) else f'reason {reason}'


def _shut_down(bag: Bag, told: Sequence[str]) -> str:
    """
    Return when the controller shut the motors down in flight, or ''.

    After what is told already only how high above the floor it did, if that is not told.
    """
    if (rows := _beside_reference(bag, 'motor_pwm')) is None:
        return ''
    (at, asked), motors = rows, bag['motor_pwm']
    down = motors['shutdown'][at].astype(bool) & python(in_flight)(bag['reference'].phase[asked])
    if not down.any():
        return ''
    row = at[down.argmax()]
    t, reason = motors.t[row], int(motors['reason'][row])
    said = f'the controller shut the motors down at {t:.3f} s'
    if not told:
        return said
    if any(STAGES[-1] in line for line in told):
        return ''
    stamp = int(motors.stamp[row])
    height = _height(bag, stamp)
    why = f': {reason_in_words(bag, stamp, reason)}' if 0 < reason < len(REASONS) else ''
    return f'{said}, {height:.2f} m above the floor{why}' if height > DROP else ''


def statuses(bag: Bag) -> Iterator[tuple[float, Any]]:
    """
    Yield every diagnostic status of a bag with the stamp of its report, s.

    The names of the drone's own nodes are without its namespace; those of another drone, which
    may share ``/diagnostics``, begin with that one's.
    """
    own = f'{bag.namespace.strip("/")}/'
    for topic in REPORTS:
        try:
            reports = list(bag[topic].readable().objects()) if topic in bag else []
        except BagError:  # of an unknown type
            continue
        for report in reports:
            t = report.header.stamp.sec + report.header.stamp.nanosec * 1e-9
            for status in report.status:
                status.name = status.name.removeprefix(own)
                if REASONS[REASON_GROUNDED] in status.message:
                    status.message = status.message.replace(
                        REASONS[REASON_GROUNDED],
                        reason_in_words(bag, round(t * 1e9), REASON_GROUNDED))
                yield t, status


def refused_messages(bag: Bag) -> list[str]:
    """Return the numbers of messages that each node refused, one line per node."""
    counts = {
        status.name.removesuffix(_INPUTS): status.message.removeprefix(_REFUSED)
        for _, status in statuses(bag)  # the last report of a node includes all earlier ones
        if status.name.endswith(_INPUTS) and status.message.startswith(_REFUSED)}
    return [f'{node} {_REFUSED}{count}' for node, count in counts.items()]


def without_poses(bag: Bag) -> list[str]:
    """Return a line about the longest time in which the estimator used no pose, if it is long."""
    worst = (0.0, 0.0, '')
    for t, status in statuses(bag):
        said = status.message.rpartition('; ')[2]
        if status.name == 'estimator_node' and (found := _WITHOUT.match(said)):
            worst = max(worst, (float(found[1]), t, said))
    age, t, said = worst
    return [line for line in [longest(t, age, said)] if line]


def ended_in_the_air(bag: Bag) -> list[str]:
    """Return a line about a flight that was over before its landing, or that of a command."""
    lands = _parameter(bag, 'reference_node', 'commands', 'enabled') is True or _parameter(
        bag, 'reference_node', 'plan', 'landing_time')
    if not lands or 'ground_truth/odom' not in bag or any(
            name not in bag or not len(bag[name]) for name in ('reference', 'motor_pwm')):
        return []
    said = over_in_the_air(
        float(bag['ground_truth/odom'].position[-1, 2]),
        bool((bag['motor_pwm'].pwm[-1] > 0.0).any()))
    return [said] if said else []


def landed_by_itself(bag: Bag) -> list[str]:
    """Return a line about a landing that began as no setpoint was followed any more."""
    if any(name not in bag or not len(bag[name])
           for name in ('command', 'reference', 'motor_pwm')):
        return []
    commands, reference, motors = bag['command'], bag['reference'], bag['motor_pwm']
    down = np.flatnonzero(np.diff(reference.phase == LANDING, prepend=False))
    down = down[reference.phase[down] == LANDING]  # where a landing begins
    newest = _newest(commands.stamp, reference.stamp[down])
    motor = _newest(motors.stamp, reference.stamp[down])
    flown = ~motors['shutdown'].astype(bool)[motor] & (motors['reason'][motor] == 0)
    alone = np.flatnonzero((newest >= 0) & (commands['kind'][newest] == SETPOINT) & flown)
    return [f'no setpoint was followed after t = {commands.t[newest[k]]:.2f} s: the vehicle '
            f'stopped and hovered, and from t = {reference.t[down[k]]:.2f} s on it landed by '
            'itself'
            for k in alone[:1]]


def ended_early(bag: Bag, is_told: bool = False) -> list[str]:
    """
    Return the reasons for an early end of a flight, one line each; empty if it ended as planned.

    Parameters
    ----------
    bag
        Of :func:`mambo_bags.reader.read_bag`, with the topics ``ENDINGS`` or all.
    is_told
        Whether it is known already that the flight is shorter than planned.

    Returns
    -------
    Lines: a failsafe that ended the flight before its landing, and motors stopped by their
    watchdog; motors that a controller shut down in flight, after a failsafe only above the floor,
    as it stops them when it has landed; a vehicle that was far from its reference or fell; motors
    that turned while the reference asked for none; less flown than the scenario in the bag asks
    for.

    """
    lines, first = [], set()
    carried = _carried(bag)
    for t, status in statuses(bag):
        if status.level != _ERROR or status.name in first or status.name not in _FINALS:
            continue
        if status.name == 'sim_node' or not (carried or _had_landed(bag, t)):
            first.add(status.name)
            lines.append(f'{status.name} at {t:.3f} s: {status.message}')
    if not carried:
        lines += filter(None, [_shut_down(bag, lines)])
        lines += filter(None, [_flight_fault(bag, bool(lines)), _idle_fault(bag)])
    clock = next((name for name in ('/clock', 'clock') if name in bag), None)
    planned = _planned(bag)
    if clock and planned and not is_told:
        flown = float(bag[clock].t.max())
        if flown < planned - _STEP:
            lines.insert(0, f'flew {flown:.2f} of {planned:g} s')
    return lines
