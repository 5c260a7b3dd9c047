"""The closed loop in one process: whole, without sensors, part by part, and idle."""

from __future__ import annotations

from functools import cache
from pathlib import Path
import shutil

from mambo_flight import closed_loop, recording_to_bag, scenario
from mambo_flight.sweep import monte_carlo
import numpy as np

from . import elimination
from .measure import Contender, Gap, timed

DURATION = 40.0  # s, of the circle with take-off and landing
STEPS = round(DURATION / 0.005) + 1
IDLE = 2000  # control steps in a piece of an idle flight


def _flights(quick: bool, folder: Path) -> list[Contender]:
    """Return whole flights: without sensors, with all, with the other stack, with a bag."""
    often = 2 if quick else 10

    def whole(flight: scenario.Scenario) -> None:
        closed_loop.fly(flight)

    def with_bag(flight: scenario.Scenario) -> None:
        shutil.rmtree(folder / 'in_one_process', ignore_errors=True)
        recording = closed_loop.fly(flight, inner=True)
        recording_to_bag.write(folder / 'in_one_process', flight, recording)

    def ideal(flight: scenario.Scenario) -> None:
        list(monte_carlo.fly_many([flight]))

    def contender(name, title, detail, fly, flight, factor):
        return Contender(
            'closed_loop', name, title,
            lambda: timed(often * DURATION, lambda: [fly(flight) for _ in range(often)]),
            lambda: fly(flight), detail, {'factor': factor})
    default = scenario.scenario(estimator='kalman', duration=DURATION)
    joint = scenario.scenario(estimator='joint', duration=DURATION)
    toolbox = scenario.scenario(estimator='toolbox', controller='toolbox', duration=DURATION)
    return [
        contender('closed_loop_ideal', 'without sensors',
                  'plant, flight plan, cascaded controller and failsafe, as sweeps fly it',
                  ideal, default, 2000.0),
        contender('closed_loop', 'closed loop',
                  'all sensors with noise, motion capture, Kalman filters, cascaded controller, '
                  'all recorded as arrays', whole, default, 500.0),
        contender('closed_loop_joint', 'closed loop, joint filter',
                  'the same with the joint filter in place of the three', whole, joint, 500.0),
        contender('closed_loop_toolbox', 'closed loop, support package',
                  'the same with estimator and controller of the support package', whole,
                  toolbox, 500.0),
        contender('closed_loop_bag', 'closed loop with bag',
                  'the closed loop, then its bag with all topics of the graph', with_bag, default,
                  100.0)]


@cache
def _taped() -> tuple[scenario.Scenario, elimination.Tape]:
    """Return the flight of the three filters and its tape, checked against the closed loop."""
    flight = scenario.scenario(estimator='kalman', duration=DURATION)
    tape = elimination.tape(STEPS)
    mind, chance = elimination.begin(flight)
    elimination.fly(
        mind, chance, closed_loop.settings(flight), tape, 0, STEPS, elimination.ALL)
    known = closed_loop.fly(flight)
    if not (np.array_equal(tape.plant[:, :13], known.truth)
            and np.array_equal(tape.command[:, :4], known.pwm)):
        raise Gap('the loop that leaves parts out does not fly as the closed loop does')
    return flight, tape


def _profile(quick: bool) -> list[Contender]:
    """Return the flight whole and with each part left out."""
    often = 2 if quick else 10

    def run(parts: int) -> dict[str, float]:
        flight, tape = _taped()
        settings = closed_loop.settings(flight)
        starts = [elimination.begin(flight) for _ in range(often)]

        def work() -> None:
            for mind, chance in starts:
                elimination.fly(mind, chance, settings, tape, 0, STEPS, parts)
        return {'step': 1e6 * 0.005 / timed(often * DURATION, work)['cpu_factor']}

    def prepare() -> None:
        _taped()
    whole = [Contender('profile', 'profile_whole', 'whole control step',
                       lambda: run(elimination.ALL), prepare)]
    return whole + [
        Contender('profile', f'profile_{part.replace(" ", "_")}', part,
                  lambda bit=1 << i: run(elimination.ALL & ~bit), prepare)
        for i, part in enumerate(elimination.PARTS)]


def _waiting(where: str) -> scenario.Scenario:
    """Return a flight that waits on the floor without noise: before take-off or after landing."""
    overrides = {'ground': {'reference_node.plan.takeoff_time': 590.0,
                            'reference_node.plan.start_time': 600.0},
                 'landed': {'reference_node.plan.landing_time': 12.0}}[where]
    return scenario.scenario(
        estimator='kalman', duration=DURATION, noise=False, land=False, overrides=overrides)


def idle(where: str, seconds: float) -> tuple[list[float], elimination.FlightMemory]:
    """Wait so long; return the CPU time in s of each piece of ``IDLE`` steps, and the memories."""
    flight = _waiting(where)
    settings, tape = closed_loop.settings(flight), elimination.tape(IDLE)
    mind, chance = elimination.begin(flight)
    everything, took = elimination.ALL & ~elimination.RECORDING, []

    def piece(start: int) -> None:
        nonlocal mind
        mind, _ = elimination.fly(
            mind, chance, settings, tape, start, start + IDLE, everything)
    for start in range(0, round(seconds / 0.005), IDLE):
        took.append(1.0 / timed(1.0, lambda start=start: piece(start))['cpu_factor'])
    return took, mind


def subnormal(value: object) -> int:
    """Return how many numbers of nested tuples and arrays are so small that they are slow."""
    if isinstance(value, tuple):
        return sum(map(subnormal, value))
    if isinstance(value, float | np.ndarray) and np.asarray(value).dtype.kind == 'f':
        size = np.abs(value)
        return int(np.sum((size > 0.0) & (size < np.finfo(float).tiny)))
    return 0


def _idle(quick: bool) -> list[Contender]:
    """Return what waiting costs at its end over its begin, on the floor and after a landing."""
    seconds = 500.0 if quick else 550.0

    def run(where: str) -> dict[str, float]:
        took, mind = idle(where, seconds)
        first = 5 if where == 'ground' else 10  # the flight is over by then
        early, late = np.median(took[first:first + 10]), np.median(took[-10:])
        return {'slowdown': late / early, 'subnormal': float(subnormal(mind))}

    def prepare() -> None:
        idle('ground', 10.0)
    titles = {'ground': 'on the floor before take-off', 'landed': 'on the floor after landing'}
    return [
        Contender('idle', f'idle_{where}', title, lambda where=where: run(where), prepare,
                  at_most={'slowdown': 1.2})
        for where, title in titles.items()]


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return everything that is measured in this process."""
    return [*_flights(quick, folder), *_profile(quick), *_idle(quick)]
