"""Flights with extreme parameters, and what their bags must not hold."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
import random
from typing import Any

from mambo_bags.reader import read_bag
from mambo_flight.scenario import Scenario
from mambo_model import schema
from mambo_model.vehicle.parameters import Vehicle
from mambo_ros import messages, topics

SECONDS = ('1.5', '6', '12')  # of flight: on the floor, in the take-off, on the trajectory
TRAJECTORIES = ('hover', 'circle', 'vertical_circle', 'incline')
ESTIMATORS = ('joint', 'kalman')
CONTROLLERS = ('flatness_drag', 'cascaded')
_OF_OTHERS = tuple(
    f'{node}.{name}.' for node, names in (
        ('estimator_node', ('joint', 'kalman', 'toolbox')),
        ('controller_node', ('cascaded', 'extended', 'flatness_drag', 'geometric', 'indi',
                             'predictive', 'toolbox'))) for name in names)
_TIMES = ('sim_node.duration', 'sim_node.patience', 'sim_node.start_patience')
_LIMITS = ('pwm_min', 'pwm_max')


def numbers() -> dict[str, Any]:
    """Return the field of every parameter with a range, by NODE.PARAMETER."""
    return {f'{node.name}.{name}': field for node in dataclasses.fields(Scenario)
            for name, field in schema.walk(node.metadata['group'])
            if 'unit' in field.metadata and f'{node.name}.{name}' not in _TIMES}


def value(rng: random.Random, field: Any) -> str:
    """Return an extreme value of a parameter: at a limit, near it, or outside."""
    low, high, default = field.metadata['low'], field.metadata['high'], field.default
    whole = isinstance(low, int) and isinstance(high, int)
    kind = rng.randrange(10)
    if kind < 4:
        number = low if kind % 2 else high
    elif kind < 6:
        number = rng.uniform(low, high)
    elif kind < 9:
        size = default if isinstance(default, (int, float)) and default else high
        number = min(max(size * 10.0 ** rng.uniform(-4.0, 4.0), low), high)
    else:
        return rng.choice(('nan', 'inf', '-inf', '1e308', '-1e308', '1e-320', '-1', '1e400'))
    text = repr(round(number)) if whole else repr(float(number))
    return f'[{", ".join([text] * len(default))}]' if isinstance(default, tuple) else text


def line(rng: random.Random, out: Path, fields: dict[str, Any]) -> list[str]:
    """Return the command line of a flight, without ``mambo``."""
    estimator, controller = rng.choice(ESTIMATORS), rng.choice(CONTROLLERS)
    words = ['fly', '--trajectory', rng.choice(TRAJECTORIES), '--duration', rng.choice(SECONDS),
             '--estimator', estimator, '--controller', controller, '--no-landing', '-o', str(out)]
    flown = (f'estimator_node.{estimator}.', f'controller_node.{controller}.')
    names = [name for name in sorted(fields)  # those of other components are refused at once
             if name.startswith(flown) or not name.startswith(_OF_OTHERS)]
    for name in rng.sample(names, rng.randint(1, 3)):
        words += ['--set', f'{name}={value(rng, fields[name])}']
    return words


def wrong(bag: Path, words: list[str]) -> str:
    """
    Return what is wrong with the bag of a flight; empty if nothing, or if there is no bag.

    Motor commands are within the limits of the vehicle, and neither truth nor estimate holds
    anything that is not a number.
    """
    if not bag.exists():
        return ''
    recorded = read_bag(bag)
    limit = Vehicle().pwm_max
    if any(name in word for word in words for name in _LIMITS):
        limit = 65535.0
    for data in recorded[f'{topics.NAMESPACE}/{topics.MOTOR_PWM.name}'].raw:
        t, pwm, _ = messages.decode_motor_pwm(data)
        if not all(0.0 <= each <= limit for each in pwm):
            return f'PWM {pwm} at {t * 1e-9:.3f} s'
    for topic in (topics.GROUND_TRUTH, topics.ESTIMATE):
        for data in recorded[f'{topics.NAMESPACE}/{topic.name}'].raw:
            t, state = messages.decode_odometry(data)
            if not all(math.isfinite(number) for part in state for number in part):
                return f'{topic.name} {state} at {t * 1e-9:.3f} s'
    return ''
