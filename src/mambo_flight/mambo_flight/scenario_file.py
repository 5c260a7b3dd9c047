"""
Scenario files: one readable file per experiment, with one flight or several.

The experiments of the thesis are in the folder ``scenarios`` beside this module, named after its
figures. A file holds only what differs from the defaults:

    title: Figure 5.11, a circle that rises and falls
    trajectory: circle_rising
    believed: identified
    parameters:
      estimator_node: {kalman: {optical_flow: {constant: 1.06}}}
    flights:
      other_seed: {seed: 2}

The keys are those of :class:`Settings`, for all flights or for one under ``flights``;
``parameters`` takes any parameter of any node. ``commands`` makes a commanded flight of it: a list
of commands with times, see :mod:`.commanded`. ``changes`` changes parameters in flight, see
:mod:`.changes`. ``world`` makes it a flight of several drones, with
the keys of :class:`mambo_sim.world.WorldParams`. A ROS 2 parameter file can be read, too.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import os
from pathlib import Path
import re
from typing import Any, NamedTuple

from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import DEFAULT, REGISTRY as ESTIMATORS
from mambo_model import schema
from mambo_model.components import absolute
from mambo_model.motion.trajectory import FlightPlanParams, TAKEOFFS
from mambo_sim.parameters import STEP_NS
from mambo_sim.world import WorldParams
import yaml

from . import changes, commanded, scenario as scenarios, unused
from .course import course_file
from .scenario import ParameterReader, Place

FOLDER = Path(__file__).with_name('scenarios')
_JUDGED_BY = ('reference_node.commands.', 'reference_node.vehicle.')  # whether a command is flown
_FLIGHT = re.compile(r'\w[\w.-]{0,99}')  # name of one in a file


@dataclasses.dataclass(frozen=True)
class Settings:
    """Main settings of a flight; every other parameter follows from them."""

    trajectory: str = schema.text(
        'circle', 'what is flown: a built-in one, the file of a course, or a function')
    takeoff: str = schema.choice('smooth', TAKEOFFS, 'how it is reached')
    landing: bool = schema.flag(True, 'whether to descend at the end')
    duration: float = schema.quantity(
        40.0, 's', STEP_NS * 1e-9, scenarios.LONGEST,
        'of the flight; without one a course is flown to its end')
    vehicle: str = schema.text('identified', 'true vehicle: a known one, or a vehicle file')
    believed: str = schema.text('', 'that of reference and controller; empty: the true one')
    estimator: str = schema.component(DEFAULT, ESTIMATORS, 'of estimator_node')
    controller: str = schema.component('cascaded', CONTROLLERS, 'of controller_node')
    noise: bool = schema.flag(True, 'whether sensors have noise and bias')
    carried: bool = schema.flag(False, 'whether a hand carries the vehicle, level')
    seed: int = schema.quantity(1, '1', 0, scenarios.MAX_SEED, 'of every noise stream')

    def __post_init__(self) -> None:
        schema.check(self)
        course_file.check_name(self.trajectory)


SETS = {
    'trajectory': ('reference_node.plan.trajectory',),
    'estimator': ('estimator_node.estimator',), 'controller': ('controller_node.controller',),
    'duration': ('sim_node.duration',), 'seed': scenarios.SEEDS,
    'noise': ('sim_node.simulator.noise',), 'landing': ('reference_node.plan.landing_time',),
    'drones': ('world.drones',), 'mode': ('sim_node.mode',), 'speed': ('sim_node.speed',),
    'paused': ('sim_node.paused',), 'commanded': ('reference_node.commands.enabled',)}
"""Parameters that a setting, an option or a launch argument of this name gives its value."""
FIELDS = {field.name: field for field in dataclasses.fields(Settings)}
WORLD = {f'world.{name}': field for name, field in schema.walk(WorldParams)}


def command_limits(values: Mapping[str, Any], where: str) -> dict[str, Place]:
    """
    Return those parameters by which the commands of a flight are judged, for :func:`read`.

    Parameters
    ----------
    values
        {'node.parameter': value} that override a scenario once it is read.
    where
        Where they were given, such as ``--set``.

    """
    return {name: Place(value, where) for name, value in values.items()
            if name in scenarios.LEAVES and name.startswith(_JUDGED_BY)}


def contradicted(
    settings: Mapping[str, Any], parameters: Mapping[str, Any],
) -> tuple[str, str] | None:
    """Return the first setting, and the parameter that gives it another value; None: all agree."""
    for name, (full, *_) in SETS.items():
        value, given = settings.get(name), parameters.get(full)
        if value is None or given is None or given == value:
            continue
        # True asks for the default of a number, such as the time of landing
        if value is not True or isinstance(given, bool):
            return name, full
    return None


class Experiment(NamedTuple):
    """A scenario file: its flights by name, in order; a single flight has the name ''."""

    name: str
    title: str
    flights: dict[str, scenarios.Scenario]
    world: WorldParams = WorldParams()  # of several drones


class Selected(NamedTuple):
    """One flight of an experiment."""

    name: str                   # of both
    flight: scenarios.Scenario
    others: list[str]           # the flights after it in a file of which none was named


class _Layer(NamedTuple):
    """Settings and parameters of one part of a file."""

    settings: dict[str, Place]
    parameters: dict[str, Place]

    def over(self, base: _Layer) -> _Layer:
        """Return the union of two layers, in which this one overrides ``base``."""
        return _Layer({**base.settings, **self.settings}, {**base.parameters, **self.parameters})


class _Reader(ParameterReader):
    """Reads the parts of a scenario file."""

    def layer(self, keys: Mapping[str, tuple[yaml.Node, yaml.Node]]) -> _Layer:
        """Read the settings of all flights of a file, or of one."""
        settings, parameters = {}, {}
        for name, (key, node) in keys.items():
            if name == 'parameters':
                parameters |= self.parameters(node, '')
            elif name == 'commands':
                parameters |= commanded.parameters(self, node)
            elif name == 'changes':
                parameters |= changes.parameters(self, node)
            elif name in FIELDS:
                settings[name] = Place(
                    self.leaf('', name, FIELDS[name], node), self.where(node))
            else:
                known = [*FIELDS, 'parameters', 'commands', 'changes']
                raise schema.ParameterError(
                    f'{self.where(key)}: {schema.unknown(name, known)}')
        return _Layer(settings, parameters)

    def world(self, node: yaml.Node) -> WorldParams:
        """Read the section ``world`` of a file."""
        self.leaves = {**self.leaves, **WORLD}
        values = self.parameters(node, 'world.')
        try:
            return build_world({name: place.value for name, place in values.items()})
        except schema.ParameterError as error:
            raise scenarios.located(self.path, values, error) from None


def build_world(values: Mapping[str, Any], base: WorldParams | None = None) -> WorldParams:
    """
    Return a world of values {'world.name': value} over those of another one.

    Raises
    ------
    mambo_model.schema.ParameterError
        For an unknown name, a value out of range, or one that has no effect in this world.

    """
    for name in values:
        if name not in WORLD:
            raise schema.ParameterError(schema.unknown(name, WORLD))
    out = schema.build(WorldParams, {
        **({} if base is None else schema.flatten(base)),
        **{name.removeprefix('world.'): value for name, value in values.items()}}, 'world.')
    unused.refuse_world(values, out)
    return out


def names() -> list[str]:
    """Return the names of the scenarios that come with the package, figures first and in order."""
    def order(name: str) -> tuple[bool, list[tuple[bool, int, str]]]:
        return not name.startswith('fig_'), [
            (not part.isdigit(), int(part) if part.isdigit() else 0, part)
            for part in name.split('_')]
    return sorted((path.stem for path in FOLDER.glob('*.yaml')), key=order)


def find(name: str) -> Path:
    """
    Return the file of a scenario.

    Parameters
    ----------
    name
        One of :func:`names`, or the path of a file.

    Raises
    ------
    mambo_model.schema.ParameterError
        If there is no such scenario; the message lists the known ones.

    """
    if name in names():
        return FOLDER / f'{name}.yaml'
    if Path(name).suffix in ('.yaml', '.yml'):
        return Path(name)
    file, _, flight = name.rpartition('/')
    if Path(file).suffix in ('.yaml', '.yml') and Path(file).is_file():
        raise schema.ParameterError(f'a flight of a file is written {file}:{flight}')
    is_bag = Path(name).suffix == '.mcap' or os.path.isfile(os.path.join(name, 'metadata.yaml'))
    what = 'a bag' if is_bag else 'unknown'
    raise schema.ParameterError(
        f'scenario {schema.shown(name)} is {what}: give a file (.yaml) or one of '
        f'{", ".join(names())}')


def read(path: Path, over: Mapping[str, Place] | None = None) -> Experiment:
    """
    Read a scenario file.

    Parameters
    ----------
    path
        Scenario file.
    over
        Settings that replace those of every flight, by name, with their places; also parameters
        of :func:`command_limits`, by which the commands of every flight are judged.

    Raises
    ------
    mambo_model.schema.ParameterError
        Naming file, line and key of an unknown key or of a wrong value.

    """
    reader = _Reader(Path(path))
    root = reader.root()
    chosen = {name: place for name, place in (over or {}).items() if name in FIELDS}
    limits = {name: place for name, place in (over or {}).items() if name not in FIELDS}
    last = _Layer(_relative_to_user(chosen, Path(path).parent), limits)
    reader.learn(root, {name: place.value for name, place in last.settings.items()})
    keys = reader.mapping(root, 'file')
    if any(name.startswith('/') or name.endswith('_node') for name in keys):
        if chosen:
            raise schema.ParameterError(
                f'{path}: a ROS 2 parameter file cannot be combined with {", ".join(chosen)}')
        flights = {'': scenarios.from_parameters(path, reader.ros_parameters(keys) | limits)}
        return Experiment(Path(path).stem, '', flights)
    if 'title' not in keys:
        raise schema.ParameterError(f'{path}: title: missing; describe the flight in one line')
    title = reader.text(keys.pop('title')[1], 'title')
    world = reader.world(keys.pop('world')[1]) if 'world' in keys else WorldParams()
    flights = {}
    if 'flights' in keys:
        node = keys.pop('flights')[1]
        flights = {
            name: reader.layer(reader.mapping(below, name))
            for name, (_, below) in reader.mapping(node, 'flights').items()}
        if not flights:
            reader.fail(node, 'flights', 'holds no flight')
        for name, (key, _) in reader.mapping(node, 'flights').items():
            if not _FLIGHT.fullmatch(name):  # its bag is named after it
                reader.fail(key, 'flights', f'{schema.shown(name)} is no name of a flight: letters'
                            ', digits, _, - and points, the first no point')
    common = reader.layer(keys)
    layers = {
        name: last.over(layer.over(common)) for name, layer in (flights or {'': common}).items()}
    for layer in layers.values():
        if trajectory := layer.settings.get('trajectory'):
            unused.refuse_trajectory(trajectory.where, trajectory.value, world)
    built = {name: _build(path, layer) for name, layer in layers.items()}
    unused.refuse(
        {key: place.where for layer in layers.values() for key, place in layer.parameters.items()
         if place.where},
        estimators=[flight.estimator_node.estimator for flight in built.values()],
        controllers=[flight.controller_node.controller for flight in built.values()])
    _refuse_plans(layers, built)
    return Experiment(Path(path).stem, title, built, world)


def _refuse_plans(layers: Mapping[str, _Layer], built: Mapping[str, scenarios.Scenario]) -> None:
    """Raise ParameterError for what sets the plan of flights that are all made by commands."""
    places = {name: {key: place.where for key, place in (
        layer.settings | layer.parameters).items()} for name, layer in layers.items()}
    commanded = [name for name, flight in built.items() if flight.reference_node.commands.enabled]
    planned = {place for name in {*places}.difference(commanded) for place in places[name].items()}
    for name in commanded:
        unused.refuse_plan(built[name].reference_node, dict(
            place for place in places[name].items() if place not in planned))


def load(name: str, over: Mapping[str, Place] | None = None) -> tuple[str, scenarios.Scenario]:
    """
    Return the name and the scenario of one flight.

    Parameters
    ----------
    name
        ``experiment`` for its first flight, ``experiment/flight`` for another; a file's flight
        as ``file.yaml:flight``.
    over
        See :func:`read`.

    Raises
    ------
    mambo_model.schema.ParameterError
        See :func:`find` and :func:`read`; also if there is no flight of that name.

    """
    return select(name, over)[:2]


def select(name: str, over: Mapping[str, Place] | None = None) -> Selected:
    """Return a flight as :func:`load` does, and the names of those of its file left out."""
    experiment, flight = _parts(name)
    found, others = read(find(experiment), over), []
    if not flight:
        flight, *others = found.flights
        others = [] if experiment in names() else [f'{experiment}:{other}' for other in others]
    elif flight not in found.flights:
        known = ', '.join(filter(None, found.flights)) or 'one without a name'
        raise schema.ParameterError(
            f'{experiment}: no flight {schema.shown(flight)}; known: {known}')
    unused.refuse_plan(
        found.flights[flight].reference_node,
        {key: place.where for key, place in (over or {}).items()})
    return Selected('_'.join(filter(None, (found.name, flight))), found.flights[flight], others)


def load_alone(
    name: str, over: Mapping[str, Place] | None = None,
) -> tuple[str, scenarios.Scenario]:
    """Return what :func:`load` does, errors alike; also refuse a file of several drones."""
    found = load(name, over)
    refuse_several(name, over)
    return found


def refuse_several(name: str, over: Mapping[str, Place] | None = None) -> None:
    """Raise ParameterError for a file of several drones where one is flown."""
    if (drones := load_world(name, over).drones) > 1:
        raise schema.ParameterError(
            f'{name}: world.drones = {drones}: only one drone can be flown here; fly several '
            'with mambo fly or ./run')


def _parts(name: str) -> tuple[str, str | None]:
    """Return experiment and flight of a name as for :func:`load`."""
    if found := re.fullmatch(rf'(.+\.ya?ml):({_FLIGHT.pattern})', name):
        return found[1], found[2]
    if name.endswith(('.yaml', '.yml')):
        return name, None
    experiment, _, flight = name.partition('/')
    return (experiment, flight) if experiment in names() else (name, None)


def load_world(name: str, over: Mapping[str, Place] | None = None) -> WorldParams:
    """Return the section ``world`` of the file of a flight, as for :func:`load`; errors alike."""
    return read(find(_parts(name)[0]), over).world


def _relative_to_user(settings: Mapping[str, Place], folder: Path) -> dict[str, Place]:
    """Return settings whose relative paths start at the user's folder, not at the file's."""
    def here(name: str, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if name in ('trajectory', 'vehicle', 'believed') and folder != Path():
            return course_file.absolute(value, Path())
        return absolute(value) if 'component' in FIELDS[name].metadata else value
    return {name: Place(here(name, place.value), place.where)
            for name, place in settings.items()}


def from_settings(settings: Mapping[str, Place]) -> scenarios.Scenario:
    """Return the scenario of settings without a file; errors as in :func:`read`."""
    return _build(Path('scenario'), _Layer(_relative_to_user(settings, Path()), {}))


def _build(path: Path, layer: _Layer) -> scenarios.Scenario:
    """Return the scenario of one flight."""
    try:
        s = Settings(**{name: place.value for name, place in layer.settings.items()})
        if 'duration' not in layer.settings and course_file.is_course(s.trajectory) and (
                course_file.states_duration(s.trajectory, path.parent)):
            s = dataclasses.replace(s, duration=_duration(s, layer, path.parent))
        return scenarios.scenario(
            s.trajectory, s.estimator, s.controller, s.duration, s.seed, s.vehicle, s.believed,
            s.noise, s.landing, {
                'reference_node.plan.takeoff': s.takeoff,
                **{name: place.value for name, place in layer.parameters.items()}},
            s.carried, path.parent)
    except schema.ParameterError as error:
        raise scenarios.located(
            path, {**layer.settings, **layer.parameters}, error) from None


def _duration(s: Settings, layer: _Layer, folder: Path) -> float:
    """Return the duration in s that a flight needs to finish its course and land."""
    prefix = 'reference_node.plan.'
    plan = schema.build(FlightPlanParams, {
        **course_file.plan(s.trajectory, folder), 'takeoff': s.takeoff,
        **{name.removeprefix(prefix): place.value for name, place in layer.parameters.items()
           if name.startswith(prefix)}})
    return long_enough(plan, s.landing)


def long_enough(plan: FlightPlanParams, landing: bool) -> float:
    """Return how long a flight is, in s, that flies its course to the end and lands if asked."""
    return max(course_file.end(plan) + (scenarios.LANDING if landing else 0.0),
               scenarios.SHORTEST)
