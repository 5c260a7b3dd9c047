"""Command line options that select a flight, shared by ``mambo fly`` and ``./run``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mambo_bags.cli.option_types import declared, whole
from mambo_bags.command import Parser
from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import DEFAULT, REGISTRY as ESTIMATORS
from mambo_model import schema
from mambo_model.components import remarks as component_remarks
from mambo_model.errors import InputError
from mambo_model.motion.trajectory import COURSE, TRAJECTORIES
from mambo_model.vehicle.parameters import PRESETS
from mambo_sim.world import MOST, WorldParams

from . import changes, commanded, scenario as scenarios, unused
from .course import course_file, course_warnings, feasibility
from .scenario import Scenario
from .scenario_file import (
    build_world, command_limits, contradicted, FIELDS, load_world, long_enough, Place, SETS)


DRONES = whole(1, MOST)
"""Type of an option for the number of drones in one hall."""
_WORLD = 'world.'


def add(out: Parser, trajectory: str = '', controller: str = 'cascaded') -> None:
    """
    Add the options to a parser.

    Parameters
    ----------
    out
        Parser.
    trajectory, controller
        Defaults that the help shows; empty: none.

    """
    def default(name: str) -> str:
        return f' (default: {name})' if name else ''
    add = out.add_argument
    out.complete(TRAJECTORIES, add(
        '--trajectory', metavar='NAME',
        help=f"one of: {', '.join(TRAJECTORIES)}; the file of a course; a function FILE.py or "
        f'FILE.py:NAME; or the name of an installed one{default(trajectory)}'))
    for kind, registry, usual in (
            ('estimator', ESTIMATORS, DEFAULT), ('controller', CONTROLLERS, controller)):
        out.complete(registry.names, add(
            f'--{kind}', metavar='NAME',
            help=f"one of: {', '.join(registry.names)}; FILE.py or FILE.py:NAME; or the name of "
            f'an installed one{default(usual)}'))
    add('--duration', type=_setting('duration'), metavar='S',
        help='flight time in s, landing included where it fits (default: 40)')
    add('--seed', type=_setting('seed'), metavar='N',
        help='seed of every noise stream (default: 1)')
    add('--vehicle', metavar='NAME',
        help=f"true vehicle, one of: {', '.join(PRESETS)}, or a file (default: identified)")
    add('--believed', metavar='NAME',
        help='vehicle model of the controller (default: the true one)')
    add('--no-noise', dest='noise', action='store_false', default=None,
        help='sensors without noise and bias')
    add('--no-landing', dest='landing', action='store_false', default=None,
        help='stay on the trajectory to the end')
    add('--stretch', metavar='FACTOR',
        help='fly the trajectory in FACTOR times its time; auto: slow down a course that the '
        'vehicle, as the controller knows it, cannot fly, by the smallest factor')
    add('--set', action='append', default=[], metavar='NODE.PARAMETER=VALUE',
        help='set any parameter of any node; repeatable')
    add('--drones', type=DRONES, metavar='N',
        help='number of drones in one hall, in namespaces /mambo1 to /mamboN, with consecutive '
        'seeds from --seed on, each with its own bag; --set world.formation=... and others of '
        'world.* say how they fly (default: 1, or as the scenario says)')
    add('--print-scenario', action='store_true',
        help='print every parameter with unit, range and source and end')


def _setting(name: str) -> Callable[[str], Any]:
    """Return the type of the option of a numeric setting: within the range of the setting."""
    field = FIELDS[name]
    return declared(field.default, *(field.metadata[key] for key in ('low', 'high', 'unit')))


def given(options: argparse.Namespace) -> dict[str, Place]:
    """Return the settings given on the command line, each with its option as its place."""
    return {name: Place(value, _option(name, value)) for name in FIELDS
            if (value := getattr(options, name, None)) is not None}


def over(options: argparse.Namespace) -> dict[str, Place]:
    """Return what of the command line counts before a scenario file is checked, by name."""
    return given(options) | command_limits(overrides(options.set), '--set')


def _option(name: str, value: Any) -> str:
    """Return the option that gives a setting a value."""
    return f'--no-{name}' if value is False else f'--{name}'


def only_prints(options: argparse.Namespace) -> bool:
    """Return whether the flight is printed and not flown; InputError if a bag is asked for too."""
    if options.print_scenario and options.output:
        raise InputError('--print-scenario prints and flies nothing: leave out -o/--output')
    return options.print_scenario


def timed(options: argparse.Namespace) -> bool:
    """Return whether the command line sets the duration of the flight."""
    return options.duration is not None or SETS['duration'][0] in overrides(options.set)


def overrides(assignments: list[str]) -> dict[str, Any]:
    """
    Read ``node.parameter=value`` arguments of ``--set``.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line that names the argument.

    """
    out = {}
    for assignment in assignments:
        name, equals, value = assignment.partition('=')
        if not equals:
            raise schema.ParameterError(f'--set {assignment}: write node.parameter=value')
        if name.strip() in out:
            raise schema.ParameterError(
                f'--set {assignment}: {name.strip()} is set twice: leave one out')
        try:
            out[name.strip()] = scenarios.read_value(value)
        except schema.ParameterError:
            raise schema.ParameterError(f'--set {assignment}: cannot read the value') from None
    return out


def _changed(options: argparse.Namespace) -> dict[str, Any]:
    """Return the values of ``--set``; ParameterError for one that contradicts an option."""
    out = overrides(options.set)
    if (found := contradicted(vars(options), out)) is not None:
        name, full = found
        value = getattr(options, name)
        shown = f'{value:.15g}' if isinstance(value, float) else value
        given = _option(name, value) + ('' if isinstance(value, bool) else f' {shown}')
        asked = next(one for one in options.set if one.partition('=')[0].strip() == full)
        raise schema.ParameterError(f'--set {asked} contradicts {given}: leave one out')
    return out


def world(options: argparse.Namespace) -> WorldParams:
    """
    Return the world of a flight: of its scenario, with ``--drones`` and ``--set world.*``.

    Raises
    ------
    mambo_model.schema.ParameterError
        For a value that cannot be set, or one of several drones where there is one.

    """
    changed = _changed(options)
    values = {name: value for name, value in changed.items() if name.startswith(_WORLD)}
    given = next(iter(values), '')
    if options.drones is not None:
        values[f'{_WORLD}drones'] = options.drones
    limits = command_limits(changed, '--set')
    out = build_world(
        values, load_world(options.scenario, limits) if options.scenario else None)
    if given and out.drones == 1:
        raise schema.ParameterError(f'--set {given}: needs several drones: give --drones')
    if options.trajectory is not None:
        unused.refuse_trajectory('--trajectory', options.trajectory, out)
    unused.refuse_alone(out, str(options.scenario))
    return out


def applied(flight: Scenario, options: argparse.Namespace) -> Scenario:
    """
    Return a flight with the changes of ``--set`` and ``--stretch``.

    If the flight is as long as its course needs, its duration changes with the course.

    Raises
    ------
    mambo_model.errors.MamboError
        For a value that cannot be set, or a course that no speed makes feasible.

    """
    changed = {name: value for name, value in _changed(options).items()
               if not name.startswith(_WORLD)}
    flight = scenarios.override(flight, changed)
    unused.refuse(
        dict.fromkeys(changed, '--set'), estimators=[flight.estimator_node.estimator],
        controllers=[flight.controller_node.controller])
    unused.refuse_plan(flight.reference_node, {
        **{name: place.where for name, place in given(options).items()},
        **({} if options.stretch is None else {'stretch': '--stretch'}),
        **dict.fromkeys(changed, '--set')})
    if options.stretch is None:
        return flight
    plan = flight.reference_node.plan
    if options.stretch != 'auto':
        factor = feasibility.factor(options.stretch, '--stretch')
    elif plan.trajectory == COURSE:
        factor = feasibility.stretch(plan.flown_course(), flight.reference_node.vehicle)
    else:
        raise InputError(f'--stretch auto is for courses: give a number for {plan.trajectory}')
    rate, landing = 'reference_node.plan.scale_rate', bool(plan.landing_time)
    slower = {rate: plan.scale_rate / factor}
    if plan.trajectory == COURSE and flight.sim_node.duration == long_enough(plan, landing):
        # built without landing: between the old and the new times, a course may not fit
        untimed = scenarios.override(flight, {**slower, 'reference_node.plan.landing_time': 0.0})
        duration = long_enough(untimed.reference_node.plan, landing)
        slower['sim_node.duration'] = duration
        slower['reference_node.plan.landing_time'] = (
            scenarios.landing_time(duration) if landing else 0.0)
    return scenarios.override(flight, slower)


def idle(flight: Scenario) -> Iterator[str]:
    """Yield what of a flight has no effect, one line each: changes, faults and commands."""
    yield from changes.late(flight)
    yield from changes.idle_faults(flight)
    yield from commanded.late(flight)


def impossible(flight: Scenario, stretch: bool = False) -> Iterator[str]:
    """Yield what the vehicle cannot fly, one line each, with ``--stretch`` as a remedy or not."""
    simulator, reference = flight.sim_node.simulator, flight.reference_node
    if not simulator.hand.enabled and (heavy := feasibility.too_heavy(simulator.vehicle)):
        yield heavy
    yield from course_warnings.describe(reference.plan, reference.vehicle, stretch)


def remarks(
    flight: Scenario, stretch: str | None = None, trajectory: str | None = None,
) -> Iterator[str]:
    """
    Yield warnings about a flight, one line each: slow code, and what the vehicle cannot fly.

    Parameters
    ----------
    flight
        Scenario that is flown.
    stretch, trajectory
        Values of ``--stretch`` and ``--trajectory``; None: not given.

    """
    if stretch is not None:
        yield (f'stretched: flown at {flight.reference_node.plan.scale_rate:.4f} of its speed, '
               f'{flight.sim_node.duration:g} s in all')
    yield from component_remarks(flight)
    yield from idle(flight)
    for line in impossible(flight, stretch=True):
        yield f'warning: {line}'
    plan = flight.reference_node.plan
    if plan.trajectory == COURSE and stretch is not None and trajectory is not None:
        for line in course_file.left(Path(trajectory).expanduser(), plan.flown_course()):
            yield f'warning: {line}: --stretch does not keep it'
