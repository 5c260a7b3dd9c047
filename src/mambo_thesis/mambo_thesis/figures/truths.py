"""
Mutated drones, which test whether a claim can fail. A claim that holds for all proves nothing.

A mutation changes the simulated drone of the experiments, but not the model under test: chapter 6
compares the experiments with the flights named ``simulation``. Figures 3.3 and 6.3 have no
experiment; there the simulated drone is changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import contextlib
from typing import Any, NamedTuple

from mambo_flight.scenario import replaced, Scenario
from mambo_model.schema import flatten
from mambo_model.vehicle.parameters import preset, Vehicle

SEEDS = (1, 2, 3, 4, 5)
VEHICLE = 'sim_node.simulator.vehicle.'
FLOW = 'sim_node.simulator.optical_flow.'


class Scaled(NamedTuple):
    """A change that multiplies a value, or each of several, by a factor."""

    factor: float

    def applied_to(self, value: Any) -> Any:
        """Return the changed value."""
        if isinstance(value, tuple):
            return tuple(self.factor * each for each in value)
        return self.factor * value


class Mutation(NamedTuple):
    """
    A change of the simulated drone.

    Attributes
    ----------
    name, description
        Short name, and the change in words.
    changes
        {parameter of a scenario: value, or Scaled}.
    noise_free
        Whether flights on the true state, without sensors, are changed too.

    """

    name: str
    description: str
    changes: Mapping[str, Any]
    noise_free: bool = True


def _factor(offset: float, slope: float) -> dict[str, float]:
    return {f'{FLOW}factor_offset': offset, f'{FLOW}factor_slope': slope}


def _drag(reading: str, coefficient: float) -> dict[str, Any]:
    return {f'{VEHICLE}drag_reading': reading, f'{VEHICLE}drag_coefficient': coefficient}


HOVER_RATE = 9.81 * 0.22 / 4.0  # 1/s, deceleration by (3.13) over speed, in hover
QUADRATIC = 0.068 * HOVER_RATE  # kg/m: the same drag as (3.13) at 1 m/s

MUTATIONS = {m.name: m for m in (
    Mutation('drag absent', 'k_c = 0', {f'{VEHICLE}drag_coefficient': Scaled(0.0)}),
    Mutation('drag x 2', 'k_c = 0.44 s/m', {f'{VEHICLE}drag_coefficient': Scaled(2.0)}),
    Mutation('drag x 4', 'k_c = 0.88 s/m', {f'{VEHICLE}drag_coefficient': Scaled(4.0)}),
    Mutation('drag quadratic', 'drag with the square of the speed, equal to (3.13) at 1 m/s', {
        f'{VEHICLE}drag_reading': 'none', f'{VEHICLE}drag.parasitic': True,
        f'{VEHICLE}drag.parasitic_coefficient': (QUADRATIC, QUADRATIC, 0.0)}, False),
    Mutation('drag without thrust', 'drag linear in speed and independent of thrust, equal to '
             '(3.13) in hover', _drag('acceleration', HOVER_RATE), False),
    Mutation('slope 0', 'Q = 1.025 at every height', _factor(1.025, 0.0)),
    Mutation('slope reversed', 'Q falls by 0.07 per metre, 1.025 at 1.5 m',
             _factor(1.13, -0.07)),
    Mutation('slope x 2', 'Q rises by 0.14 per metre, 1.025 at 1.5 m', _factor(0.815, 0.14)),
    Mutation('factor -10 %', 'Q a tenth lower at every height', _factor(0.828, 0.063)),
    Mutation('leak +1', 'rotation of the vehicle left in the flow', {f'{FLOW}leakage': 1.0}),
    Mutation('leak -1', 'rotation of the vehicle removed from the flow twice',
             {f'{FLOW}leakage': -1.0}),
    Mutation('flow late', 'optical flow with a delay of 0.1 s', {f'{FLOW}latency': 0.1}),
    Mutation('motors late', 'thrust follows the command with a time constant of 0.1 s',
             {f'{VEHICLE}motor_time_constant': 0.1}),
    Mutation('motor map', "motors with the support package's linear map",
             {f'{VEHICLE}thrust_map': 'linear'}),
    Mutation('mass +10 %', 'mass 10 % larger', {f'{VEHICLE}mass': Scaled(1.1)}),
    Mutation('inertia x 2', 'twice the moments of inertia', {f'{VEHICLE}inertia': Scaled(2.0)}),
    Mutation('floor slopes', 'take-off from a floor that slopes by 0.01 rad in roll and pitch',
             {'sim_node.simulator.plant.floor_slope': (0.01, 0.01)}, False),
    Mutation('calibration', 'bias of the accelerometer walks by 0.1 m/s^2 in a second',
             {'sim_node.simulator.imu.accel_walk': 0.1}),
    Mutation('wind', 'wind of 0.5 m/s forward and to the right',
             {'sim_node.simulator.wind.velocity': (0.5, 0.5, 0.0)}, False),
)}


class _Context(NamedTuple):
    mutation: Mutation | None = None
    seeds: tuple[int, ...] = SEEDS


_contexts = [_Context()]


@contextlib.contextmanager
def mutated(mutation: Mutation | None, seeds: tuple[int, ...] = SEEDS) -> Iterator[None]:
    """Fly the mutated drone, with these seeds, in all figures within the block."""
    _contexts.append(_Context(mutation, seeds))
    try:
        yield
    finally:
        _contexts.pop()


def seeds() -> tuple[int, ...]:
    """Return the seeds of the experiments."""
    return _contexts[-1].seeds


def mutation_of(name: str, flight: Scenario) -> str:
    """Return the name of the mutation that changes the flight of this name; '': none."""
    mutation = _contexts[-1].mutation
    model = name.rpartition('/')[2].startswith('simulation')
    if mutation is None or model:
        return ''
    perfect = flight.estimator_node.estimator == 'ground_truth'
    if perfect and not (mutation.noise_free and any(
            key.startswith(VEHICLE) for key in mutation.changes)):
        return ''
    return mutation.name


def mutate(flight: Scenario, mutation: Mutation) -> Scenario:
    """Return the scenario with the mutated drone."""
    flat = flatten(flight)
    return replaced(flight, {
        key: change.applied_to(flat[key]) if isinstance(change, Scaled) else change
        for key, change in mutation.changes.items()})


def vehicle(name: str = 'identified') -> Vehicle:
    """Return the true vehicle, mutated, for figures without a flight."""
    known, mutation = preset(name), _contexts[-1].mutation
    if mutation is None:
        return known
    flat = flatten(known)
    changes = {key.removeprefix(VEHICLE): change for key, change in mutation.changes.items()
               if key.startswith(VEHICLE)}
    return replaced(known, {
        key: change.applied_to(flat[key]) if isinstance(change, Scaled) else change
        for key, change in changes.items()})
