"""
Flights that compare controllers: every controller on every course under every condition.

A condition sets how the true vehicle and the wind differ from the controllers' model. The
differences depend on the condition and the number of the draw alone, so that every controller
flies the same vehicles in the same wind on every course.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
import math
from typing import Any, NamedTuple

from mambo_control.controllers import REGISTRY
from mambo_model.components import absolute
from mambo_model.errors import InputError
from mambo_model.motion import uav_trajectories
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

from ..course import function_course, minimum_snap
from ..scenario import override, replaced, Scenario, scenario, SEEDS

DURATION = 30.0  # s
WRONG = 0.2      # relative error of mass and drag
GUST = 0.5       # m/s, standard deviation on each axis


class Entrant(NamedTuple):
    """A controller with its settings."""

    controller: str  # built-in, a file, or an installed one
    settings: dict[str, Any]  # parameters that differ from the defaults
    title: str


ENTRANTS = {
    'cascaded': Entrant('cascaded', {}, 'cascade of the thesis'),
    'feedforward': Entrant('cascaded', {'drag_feedforward': True},
                           'the same with its drag feed-forward'),
    'extended': Entrant('extended', {}, 'the same, drag and mass estimated, exact integral'),
    'geometric': Entrant('geometric', {}, 'Lee 2010'),
    'flatness_drag': Entrant('flatness_drag', {}, 'Faessler 2018'),
    'integral': Entrant('flatness_drag', {'k_i': 30.0}, 'the same with integral action'),
    'indi': Entrant('indi', {}, 'Smeur 2016, Sun 2022'),
    'predictive': Entrant('predictive', {}, 'Mueller 2013, solved by OSQP'),
}
SLOW = ('predictive',)
"""Entrants that are not compiled, and slow: a race has them only if they are named."""
NAMES = (*ENTRANTS, *(name for name in REGISTRY.names if name not in ENTRANTS))
"""Names that ``--controllers`` takes: the entrants, then the other built-in controllers."""


def enter(names: Sequence[str]) -> dict[str, Entrant]:
    """
    Return the controllers to compare, by the name on the page.

    Parameters
    ----------
    names
        Of :data:`NAMES`, files (``mine.py``, ``mine.py:Name``) or installed
        controllers.

    Raises
    ------
    InputError
        If there is no such controller, or two have the same name.

    """
    out: dict[str, Entrant] = {}
    for name in names:
        if name in ENTRANTS:
            label, entrant = name, ENTRANTS[name]
        else:
            found = REGISTRY.find(name, NAMES)
            title = found.describe() if found.own else 'built-in'
            label, entrant = found.name, Entrant(absolute(name), {}, title)
            if label in ENTRANTS:
                raise InputError(
                    f'{name}: {label} is already the name of another controller: rename yours')
        if label in out:
            raise InputError(f'{name}: {label} is given twice')
        out[label] = entrant
    return out


def lemniscate(t: float) -> tuple[float, float, float]:
    """Return Gerono's lemniscate, 2 m long, 1.5 m high, in 8 s a turn; (3,) m, inertial NED."""
    w = 0.25 * math.pi
    return math.sin(w * t), 0.5 * math.sin(2.0 * w * t), -1.5


@lru_cache(maxsize=1)
def _lemniscate() -> str:
    return uav_trajectories.to_text(function_course.fit(lemniscate, 16.0, 'lemniscate'))


@lru_cache(maxsize=1)
def _minimum_snap() -> str:
    """Return a course through eight gates at up to 2 m/s, as text."""
    points = np.array([
        (0.0, 0.0, -1.5), (1.2, 0.6, -1.8), (1.8, -0.6, -1.4), (0.6, -1.4, -1.1),
        (-0.8, -0.8, -1.6), (-1.6, 0.4, -2.0), (-0.6, 1.2, -1.5), (0.0, 0.0, -1.5)])
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    t = np.concatenate(([0.0], np.cumsum(legs / 1.1 + np.array([0.6, 0, 0, 0, 0, 0, 0.6]))))
    return uav_trajectories.to_text(
        minimum_snap.minimum(minimum_snap.from_points(t, points), 'snap'))


def _plan(course: str) -> dict[str, Any]:
    """Return parameters of the flight plan for a course."""
    texts = {'lemniscate': _lemniscate, 'minimum_snap': _minimum_snap}
    if course in texts:
        return {'trajectory': 'course', 'course': texts[course]()}
    return {'trajectory': course}


COURSES = ('circle', 'circle_fast', 'lemniscate', 'vertical_circle', 'step', 'minimum_snap')


def known(draw: int) -> dict[str, Any]:
    """Return the true parameters of the condition known: those of the model."""
    return {}


def twenty_percent(draw: int) -> dict[str, Any]:
    """Return mass and drag that differ by exactly 20 %, and gusts of 0.5 m/s."""
    mass, drag = (1.0 + sign * WRONG for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1))[draw % 4])
    return _true(mass, drag, (0.0, 0.0, 0.0), 0.0, 1.0)


def everything(draw: int) -> dict[str, Any]:
    """Return mass and drag that differ by up to 20 %, battery, motor lag, wind and gusts."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(draw, spawn_key=(1,))))
    mass, drag = rng.uniform(1.0 - WRONG, 1.0 + WRONG, 2).tolist()
    wind = rng.uniform(-0.5, 0.5, 2).tolist()
    lag, supply = float(rng.uniform(0.0, 0.03)), float(rng.uniform(3.5, 4.0)) / 3.7
    return _true(mass, drag, (*wind, 0.0), lag, supply)


def _true(mass: float, drag: float, wind: tuple, lag: float, supply: float) -> dict[str, Any]:
    """Return true parameters: factors of mass and drag, wind m/s, lag s, supply over 3.7 V."""
    believed, at = Vehicle(), 'sim_node.simulator.'
    return {
        f'{at}vehicle.mass': mass * believed.mass,
        f'{at}vehicle.drag_coefficient': drag * believed.drag_coefficient,
        # a motor at the command X does what it did at X V/V_ref: mambo_model.vehicle.battery
        f'{at}vehicle.power_a': supply ** believed.power_b * believed.power_a,
        f'{at}vehicle.motor_time_constant': lag,
        f'{at}wind.velocity': wind, f'{at}wind.gust': (GUST, GUST, GUST)}


TRUE, ESTIMATED, AIDED = 'true', 'estimated', 'aided'
STATES = {
    TRUE: {},  # flown without sensors
    ESTIMATED: {'estimator_node.estimator': 'joint'},
    AIDED: {'estimator_node.estimator': 'joint', 'estimator_node.joint.pose.enabled': True,
            'controller_node.estimate': 'map'}}
"""The state that a controller gets, and the parameters that select it."""
CONDITIONS = {'known': known, 'twenty_percent': twenty_percent, 'everything': everything}


class Start(NamedTuple):
    """Identification of one flight."""

    entrant: str
    course: str
    condition: str
    draw: int  # from 0; determines the true vehicle, the wind and the noise


class Comparison:
    """
    The flights of a comparison, by number, each built when it is requested.

    Parameters
    ----------
    entrants
        Result of :func:`enter`.
    courses, conditions
        Names in :data:`COURSES` and :data:`CONDITIONS`.
    draws
        Flights of each combination; one if nothing is random.
    state
        Name in :data:`STATES`.

    """

    def __init__(
        self, entrants: Mapping[str, Entrant], courses: Sequence[str], conditions: Sequence[str],
        draws: int, state: str,
    ) -> None:
        self.entrants, self.state = entrants, state
        self._bases: dict[tuple[str, str], Scenario] = {}
        self.starts = [
            Start(entrant, course, condition, draw)
            for entrant in entrants for condition in conditions for course in courses
            for draw in range(1 if condition == 'known' and state == TRUE else draws)]

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, number: int) -> Scenario:
        start = self.starts[number]
        key = (start.entrant, start.course)
        if key not in self._bases:  # takes as long as a flight: once for all draws
            self._bases[key] = self._base(*key)
        return replaced(self._bases[key], {
            **dict.fromkeys(SEEDS, start.draw + 1), **CONDITIONS[start.condition](start.draw)})

    def _base(self, name: str, course: str) -> Scenario:
        """Return the flight of a controller over a course without model errors."""
        entrant, node = self.entrants[name], 'controller_node.'
        flight = scenario(controller=entrant.controller, duration=DURATION, land=False)
        return override(flight, {
            **{f'reference_node.plan.{key}': value for key, value in _plan(course).items()},
            **{f'{node}{entrant.controller}.{key}': value
               for key, value in entrant.settings.items()},
            **STATES[self.state]})
