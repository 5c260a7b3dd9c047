"""Refuse parameters that would do nothing: of who does not fly, of what a world does not have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_control.parameters import ReferenceNodeParams
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_model import schema
from mambo_sim.world import WorldParams

_KINDS = {'estimator_node': ESTIMATORS, 'controller_node': CONTROLLERS}
_PLAN = 'reference_node.plan.'
_PLANNED = ('trajectory', 'takeoff', 'landing', 'stretch')  # what else says how a plan is flown
_BACKUP = 'cascaded'  # lands a vehicle whose own controller has failed, and has its limits
_OCCLUSION = ('cameras', 'camera_distance', 'camera_height', 'min_cameras', 'body_radius',
              'body_height')


def refuse(
        places: Mapping[str, str], *, estimators: Iterable[str],
        controllers: Iterable[str] = ()) -> None:
    """
    Refuse parameters of an estimator or a controller that no flight has.

    Parameters
    ----------
    places
        {'node.parameter': where it is set}, such as file and line, or an option.
    estimators, controllers
        Names of all that are flown; none if nothing of the kind flies, as in an estimate of a bag.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line that names the parameter and the components that are flown.

    """
    names = {'estimator_node': set(estimators), 'controller_node': set(controllers)}
    for name, where in places.items():
        node, _, rest = name.partition('.')
        group = rest.partition('.')[0]
        if node not in _KINDS or group not in _KINDS[node].built_in or group in names[node]:
            continue
        if group == _BACKUP and names[node] - set(_KINDS[node].names):
            continue
        kind = node.removesuffix('_node')
        raise schema.ParameterError(
            f'{where}: {name}: has no effect, as the {kind} is '
            f'{" or ".join(sorted(names[node])) or "not flown"}: '
            f'choose {kind}: {group}, or leave it out')


def refuse_world(names: Iterable[str], world: WorldParams) -> None:
    """
    Refuse parameters ``world.*`` that a world does not use.

    Parameters
    ----------
    names
        That were set, such as ``world.delay``.
    world
        With all of them.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line that names the parameter and what it needs.

    """
    formation = f'the formation is {world.formation}'
    idle = {}
    if world.formation != 'follow':
        idle['world.delay'] = f'{formation}: choose world.formation: follow'
    if world.formation != 'exchange':
        idle['world.turn_time'] = f'{formation}: choose world.formation: exchange'
    if not world.downwash.enabled:
        reason = 'downwash is off: set world.downwash.enabled: true'
        idle |= {f'world.downwash.{name}': reason for name, _ in schema.walk(type(world.downwash))
                 if name != 'enabled'}
    if not world.capture.occlusion:
        reason = 'no drone hides another: set world.capture.occlusion: true'
        idle |= {f'world.capture.{name}': reason for name in _OCCLUSION}
    if not world.capture.swap_distance > 0.0:
        idle['world.capture.swap_time'] = (
            'no drone is taken for another: set world.capture.swap_distance')
    for name in names:
        if name in idle:
            raise schema.ParameterError(
                f'{name}: has no effect, as {idle[name]}, or leave it out')


def refuse_trajectory(where: str, trajectory: str, world: WorldParams) -> None:
    """Refuse a trajectory, set at ``where``, that the drones of an exchange do not fly."""
    if world.formation == 'exchange' and trajectory != 'hover':
        what = where if ':=' in where else f'{where}: {trajectory}'
        raise schema.ParameterError(
            f'{what} has no effect, as the formation is exchange: choose hover, or another '
            'world.formation')


def refuse_plan(reference: ReferenceNodeParams, places: Mapping[str, str]) -> None:
    """Refuse what sets a flight plan, {name: where}, if the flight is made by commands."""
    if not reference.commands.enabled:
        return
    for name, where in places.items():
        if name in _PLANNED or name.startswith(_PLAN):
            what = where if name in where else f'{where}: {name}'
            raise schema.ParameterError(
                f'{what}: has no effect, as the flight is made by commands: leave it out, or fly '
                'without them')


def refuse_alone(world: WorldParams, where: str) -> None:
    """Refuse a section ``world`` that says more than its one drone; ``where`` it stands."""
    if world.drones == 1 and world != WorldParams():
        raise schema.ParameterError(
            f'{where}: world: has no effect, as one drone flies: set world.drones, or leave it '
            'out')
