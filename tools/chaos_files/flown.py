"""What the bags of an attacked flight must hold."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

from mambo_bags.reader import Bag, BagError, read_bag
from mambo_bringup.stuck import is_closed
from mambo_flight import scenario
from mambo_ros import messages, topics

HIGHEST = 2.5    # m above the floor; the flights are at 1.5 m
STEEPEST = 60.0  # degrees of tilt
_EXACT = tuple(topic.name for topic in topics.RECORDED if not topic.shared)
Digests = dict[str, str]


def bags(folder: Path) -> list[Path]:
    """Return the bags that a flight has made."""
    return sorted({file.parent for file in folder.rglob('*.mcap')})


def digests(folder: Path) -> Digests:
    """Return a digest of what each drone's bag holds of each topic with one publisher."""
    out = {}
    for path in bags(folder):
        bag = read_bag(path)
        for topic in _EXACT:
            data = b''.join(bag[topic].raw) if topic in bag else b''
            out[f'{path.relative_to(folder)} {topic}'] = hashlib.sha256(data).hexdigest()
    return out


def other(folder: Path, expected: Digests) -> str:
    """Return which topics differ from those of the undisturbed flight; '' if none."""
    found = digests(folder)
    differ = sorted(name for name in {*found, *expected}
                    if found.get(name) != expected.get(name))
    return f'other than in the undisturbed flight: {", ".join(differ)}' if differ else ''


def unclosed(folder: Path) -> str:
    """Return which bag is not closed; '' if there are bags and all are."""
    there = bags(folder)
    left = [path for path in there if not is_closed(path)]
    return f'not closed: {left}' if left else '' if there else 'no bag'


def wrong(folder: Path) -> str:
    """Return what is wrong in the closed bags: motor commands, or where a vehicle went."""
    for path in bags(folder):
        if not is_closed(path):
            continue
        try:
            if found := _wrong(read_bag(path)):
                return f'{path.name}: {found}'
        except BagError as error:
            return f'{path.name} cannot be read: {error}'
    return ''


def _wrong(bag: Bag) -> str:
    """Return what is wrong in one bag."""
    for each in bag:
        len(each.raw)
    limit = 65535.0
    text = bag.attachments.get('scenario.yaml')
    if text is not None:
        limit = scenario.from_yaml(text).sim_node.simulator.vehicle.pwm_max
    for data in bag[topics.MOTOR_PWM.name].raw if topics.MOTOR_PWM.name in bag else ():
        t, pwm, _ = messages.decode_motor_pwm(data)
        if not all(0.0 <= each <= limit for each in pwm):
            return f'PWM {pwm} at {t * 1e-9:.3f} s'
    truth = bag[topics.GROUND_TRUTH.name].raw if topics.GROUND_TRUTH.name in bag else ()
    for data in truth:
        t, state = messages.decode_odometry(data)
        if not math.isfinite(sum(map(sum, state))):
            return f'truth {state} at {t * 1e-9:.3f} s'
        tilt = math.degrees(2.0 * math.asin(min(math.hypot(state.q[1], state.q[2]), 1.0)))
        if -state.rho[2] > HIGHEST or tilt > STEEPEST:
            return f'{-state.rho[2]:.2f} m high, {tilt:.0f} degrees steep at {t * 1e-9:.3f} s'
    return ''
