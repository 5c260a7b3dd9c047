"""What happened in a flight and when: failsafe, faults, unhealthy sensors, rejected samples."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from mambo_bags.reader import Bag, BagError
from mambo_estimation import health
from mambo_signals.metrics import Floats
import numpy as np

from .ending import reason_in_words, statuses
from .verdict import AIDING

MOST = 60  # events of a bag, the first ones
MARKS = 300  # times at which rejected samples of a sensor are marked
HEALTH = ('', '', 'missing', 'not finite', 'implausible', 'stuck')
"""Texts of ``EstimatorState.HEALTH_*``; the first two are no fault."""
_ERROR = 2


class Event(NamedTuple):
    """An event of a flight."""

    t: float   # s
    role: str  # colour of its mark: bad for what ends or endangers the flight, else half
    text: str
    bag: str = ''  # A or B on a page of two


class Rejected(NamedTuple):
    """Rejected samples of a sensor."""

    sensor: str
    count: int
    t: Floats  # (at most ``MARKS``,) s
    bag: str = ''


def parameters(content: Any, name: str = '') -> dict[str, Any]:
    """Return {node.parameter: value} of a scenario."""
    if not isinstance(content, dict):
        return {name: content}
    return {key: value for inner, section in content.items() for key, value in parameters(
        section, name if inner == 'ros__parameters'
        else f'{name}.{inner}' if name else str(inner).rsplit('/', 1)[-1]).items()}


def number(values: dict[str, Any], name: str) -> float:
    """Return a parameter as a finite number; NaN if it is none."""
    value = values.get(name)
    known = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if known else float('nan')


def _injected(bag: Bag) -> list[Event]:
    """Return begin and end of the faults that the scenario injects."""
    values, out = parameters(bag.scenario or {}), []
    faults = 'sim_node.simulator.faults.'
    for key, kind in values.items():
        if not key.endswith('.kind') or not key.startswith(faults) or kind == 'none':
            continue
        start = number(values, f'{key[:-4]}start')
        end = start + number(values, f'{key[:-4]}duration')
        out.append((f'{key[len(faults):-5]} {kind}', start, end))
    camera = 'optitrack_node.optitrack.fault'
    if values.get(camera, 'none') != 'none':
        out.append((f'motion capture {values[camera]}', number(values, f'{camera}_begin'),
                    number(values, f'{camera}_end')))
    return [Event(t, 'half', f'injected fault {what}: {name}') for name, *span in out
            for t, what in zip(span, ('begins', 'ends'), strict=True)]


def _failsafe(bag: Bag) -> list[Event]:
    """Return changes of the reason and of the shutdown in the motor commands."""
    if 'motor_pwm' not in bag:
        return []
    motors, out = bag['motor_pwm'], []
    state = np.stack([motors['reason'].astype(int), motors['shutdown'].astype(int)], axis=1)
    for k in np.flatnonzero(np.diff(state, axis=0, prepend=[[0, 0]]).any(axis=1))[:MOST]:
        reason, stopped = state[k].tolist()
        # without the advice after it, such as to start again
        why = reason_in_words(bag, int(motors.stamp[k]), reason).partition(':')[0]
        if why or stopped:
            out.append(Event(float(motors.t[k]), 'bad', 'failsafe: ' + ': '.join(filter(None, (
                'motors shut down' if stopped else 'holding or landing', why)))))
        elif k:
            out.append(Event(float(motors.t[k]), 'half', 'failsafe: as planned again'))
    return out


def _unhealthy(bag: Bag) -> list[Event]:
    """Return when a sensor became unhealthy, and good again."""
    if 'estimator/state' not in bag:
        return []
    state, out = bag['estimator/state'], []
    found = state['health'].astype(int)
    t = state.t
    for k, name in enumerate(health.NAMES[:found.shape[1]]):
        bad = (found[:, k] > health.OUT_OF_REACH) & (found[:, k] < len(HEALTH))
        column = np.where(bad, found[:, k], health.GOOD)
        for at in np.flatnonzero(np.diff(column, prepend=0))[:MOST]:
            out.append(Event(float(t[at]), 'half', f'{name} {HEALTH[column[at]] or "good again"}'))
    return out


def _reported(bag: Bag) -> list[Event]:
    """Return the first error of each node in the diagnostics."""
    first: dict[str, Event] = {}
    for t, status in statuses(bag):
        if status.level == _ERROR and status.name not in first:
            first[status.name] = Event(t, 'bad', f'{status.name}: {status.message}')
    return list(first.values())


def events(bag: Bag) -> list[Event]:
    """
    Return what happened in a flight, in the order of time, at most ``MOST``.

    Faults that the scenario injects, what the failsafe did, errors in the diagnostics, and
    sensors that the estimator found unhealthy.
    """
    found: list[Event] = []
    for source in (_failsafe, _reported, _injected, _unhealthy):
        try:
            found += source(bag)
        except (BagError, ValueError, IndexError, TypeError):  # messages without these fields
            continue
    inside = [event for event in found
              if math.isfinite(event.t) and bag.start * 1e-9 <= event.t <= bag.end * 1e-9]
    return sorted(inside[:MOST])


def rejected(bag: Bag) -> list[Rejected]:
    """Return the rejected samples of each sensor that has some."""
    if 'estimator/state' not in bag:
        return []
    out = []
    for sensor, (_, field) in zip(health.NAMES[health.SONAR:], AIDING, strict=True):
        try:
            state = bag['estimator/state']
            count = state[field].astype(float)
            at = np.flatnonzero(np.diff(count, prepend=0.0) > 0.0)
        except (BagError, ValueError, TypeError):
            continue
        if len(at):
            out.append(Rejected(sensor, int(count.max()), state.t[at[::-(-len(at) // MARKS)]]))
    return out
