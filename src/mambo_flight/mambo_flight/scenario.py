"""
One flight as data: the parameters of every node of the graph.

A scenario file is a ROS 2 parameter file, so that ``ros2 run <package> <node> --ros-args
--params-file scenario.yaml`` flies it node by node; the closed loop in one process reads the same
file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import dataclasses
from pathlib import Path
import re
from typing import Any, NamedTuple

from mambo_control.parameters import ControllerNodeParams, ReferenceNodeParams
from mambo_estimation.filters import DEFAULT
from mambo_estimation.parameters import EstimatorNodeParams
from mambo_model import schema
from mambo_model.components import absolute
from mambo_model.errors import readable
from mambo_model.motion.trajectory import FlightPlanParams
from mambo_model.vehicle.parameters import find
from mambo_model.yaml_nodes import dump, dump_value, load as load_yaml, Loader, Reader, reason
from mambo_sim.parameters import OptitrackNodeParams, SimNodeParams
import yaml

from .course import course_file


@dataclasses.dataclass(frozen=True)
class Scenario:
    """Parameters of the five nodes of a simulated flight, by node name."""

    sim_node: SimNodeParams = schema.group(SimNodeParams)
    optitrack_node: OptitrackNodeParams = schema.group(OptitrackNodeParams)
    estimator_node: EstimatorNodeParams = schema.group(EstimatorNodeParams)
    reference_node: ReferenceNodeParams = schema.group(ReferenceNodeParams)
    controller_node: ControllerNodeParams = schema.group(ControllerNodeParams)

    def __post_init__(self) -> None:
        if self.controller_node.estimate == 'map' and not self.estimator_node.aided:
            raise schema.ParameterError(
                'controller_node.estimate: map needs motion capture: set '
                'estimator_node.estimator: joint and estimator_node.joint.pose.enabled: true')
        if self.reference_node.commands.enabled and self.sim_node.simulator.hand.enabled:
            raise schema.ParameterError(
                'reference_node.commands.enabled: a vehicle that a hand carries takes no '
                'commands: leave out carried')

    @property
    def seed(self) -> int:
        """Return the seed of every noise stream."""
        return self.sim_node.simulator.seed


NODES = tuple(field.name for field in dataclasses.fields(Scenario))
LEAVES = dict(schema.walk(Scenario))
COMPONENTS = {name: field.metadata['component'] for name, field in LEAVES.items()
              if 'component' in field.metadata}
"""Parameters that choose a component, with the registry that finds it."""
SEEDS = ('sim_node.simulator.seed', 'optitrack_node.seed')
"""Parameters that seed the noise streams."""
MAX_SEED = LEAVES[SEEDS[0]].metadata['high']
LONGEST = LEAVES['reference_node.plan.landing_time'].metadata['high']
"""Longest flight, s; the flight plan sets it."""


def own_leaves(chosen: Iterable[tuple[str, Any]]) -> dict[str, dataclasses.Field]:
    """
    Return the parameters of the user's components.

    Parameters
    ----------
    chosen
        Pairs of a name in ``COMPONENTS``, or its last part, and the component; others are
        ignored.

    Raises
    ------
    mambo_model.schema.ParameterError
        If a component is not found or is not valid.

    """
    out: dict[str, dataclasses.Field] = {}
    for name, value in chosen:
        for full, registry in COMPONENTS.items():
            if name in (full, full.rpartition('.')[2]) and isinstance(value, str) and (
                    registry.is_own(value)):
                found = registry.find(value)
                out.update(schema.walk(
                    found.params, f'{full.rpartition(".")[0]}.{found.name}.'))
    return out


def scenario(
    trajectory: str = 'circle', estimator: str = DEFAULT, controller: str = 'cascaded',
    duration: float = 40.0, seed: int = 1, vehicle: str = 'identified', believed: str = '',
    noise: bool = True, land: bool = True, overrides: Mapping[str, Any] | None = None,
    carried: bool = False, folder: Path = Path(),
) -> Scenario:
    """
    Build a scenario from a few settings.

    Parameters
    ----------
    trajectory
        Name in ``mambo_model.motion.trajectory``, a file or a function: see
        :func:`course_file.plan`.
    estimator, controller
        Names, files or installed components: see :mod:`mambo_model.components`.
    duration : s
        Flight time from start to end.
    seed
        Seed of every noise stream.
    vehicle, believed
        Known vehicles or vehicle files: the true vehicle, and the vehicle model of reference and
        controller (empty: the true one).
    noise
        Whether sensors have noise and bias.
    land
        Whether to land at the end of ``duration``.
    overrides
        {'node.parameter': value}, applied last.
    carried
        Whether a hand carries the vehicle along the trajectory, level.
    folder
        Folder of relative paths of vehicle files, courses and components.

    Raises
    ------
    mambo_model.schema.ParameterError
        For an unknown name or a value out of range.

    """
    true_vehicle = dataclasses.asdict(find(vehicle, folder))
    believed_vehicle = dataclasses.asdict(find(believed or vehicle, folder))
    sections: dict[str, Any] = {
        'sim_node': {'duration': float(duration), 'simulator': {
            'seed': seed, 'noise': noise, 'vehicle': true_vehicle}},
        'optitrack_node': {'seed': seed, 'optitrack': {'noise': noise}},
        'estimator_node': {'estimator': absolute(estimator, folder)},
        'reference_node': {
            'vehicle': believed_vehicle,
            'plan': course_file.plan(trajectory, folder, _room(duration, land, overrides or {}))},
        'controller_node': {
            'controller': absolute(controller, folder), 'vehicle': believed_vehicle},
    }
    if not noise:  # without noise, equal samples do not mean a stuck sensor
        for one in ('kalman', 'joint'):
            sections['estimator_node'][one] = {
                sensor: {'stuck_samples': 0}
                for sensor in ('imu', 'sonar', 'optical_flow', 'barometer')}
    if land:
        sections['reference_node']['plan']['landing_time'] = landing_time(duration)
    flight = schema.build(Scenario, sections)
    if overrides:
        flight = override(flight, overrides)
    return by_hand(flight) if carried else flight


def _room(duration: float, land: bool, overrides: Mapping[str, Any]) -> float:
    """Return the time in s that a flight leaves for a course without a duration of its own."""
    plan = FlightPlanParams()
    takeoff, start, blend, rate = (
        overrides.get(f'reference_node.plan.{name}', getattr(plan, name))
        for name in ('takeoff', 'start_time', 'blend_duration', 'scale_rate'))
    begin = plan.timing._replace(
        takeoff=takeoff, start_time=start, blend_duration=blend).course_begin
    return (duration - (LANDING if land else 0.0) - course_file.REST - begin) * rate


def by_hand(flight: Scenario) -> Scenario:
    """Return the scenario with a hand that carries the vehicle along the reference."""
    plan = schema.flatten(flight.reference_node.plan)
    return override(flight, {
        'sim_node.simulator.hand.enabled': True,
        **{f'sim_node.simulator.hand.plan.{name}': value for name, value in plan.items()}})


def override(flight: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Return a scenario with other values, {'node.parameter': value}; may raise ParameterError."""
    flat = schema.flatten(flight)
    known = {**LEAVES, **own_leaves((name, values.get(name, flat[name])) for name in COMPONENTS)}
    for name in values:
        if name not in known:
            raise schema.ParameterError(schema.unknown(name, known))
    kept = {  # nearly all are defaults, to the sign of 0
        name: value for name, value in flat.items()
        if name in known and repr(value) != repr(known[name].default)}
    return schema.build(Scenario, {**kept, **values})


def replaced(params: Any, values: Mapping[str, Any]) -> Any:
    """
    Return parameters with other values of the right types, {dotted name: value}.

    A hundred times as fast as :func:`override`, which also reads the user's components. Values of
    a component that is not flown are ignored.
    """
    own: dict[str, Any] = {}
    below: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        head, _, tail = name.partition('.')
        if tail:
            below.setdefault(head, {})[tail] = value
        else:
            own[head] = value
    for head, inner in below.items():
        if not hasattr(params, head):
            continue
        own[head] = replaced(getattr(params, head), inner)
    return dataclasses.replace(params, **own)


LANDING = 9.0  # s before the end of a flight: blend out 3 s, descend 4 s, rest
SHORTEST = LANDING + 10.0  # s, shortest flight that lands


def landing_time(duration: float) -> float:
    """Return the time at which landing begins [s]; 0 (never) in a flight too short for it."""
    return duration - LANDING if duration >= SHORTEST else 0.0


def to_yaml(flight: Scenario, namespace: str = '/mambo') -> str:
    """Return the scenario as a ROS 2 parameter file."""
    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: plain(inner) for key, inner in value.items()
                    if inner != {}}  # a component without parameters: rcl reads no empty group
        return list(value) if isinstance(value, tuple) else value
    sections = {
        f'{namespace}/{field.name}': {
            'ros__parameters': plain(dataclasses.asdict(getattr(flight, field.name)))}
        for field in dataclasses.fields(flight)}
    return dump(sections)


def commented_yaml(flight: Scenario, namespace: str = '/mambo') -> str:
    """
    Return the scenario as a ROS 2 parameter file with comments.

    The values are those of :func:`to_yaml`, each with its unit, range and source.
    """
    lines = [
        '# Every parameter of a flight, a ROS 2 parameter file: [unit] lowest..highest, source.',
        '# What is left out keeps its default.']
    for field in dataclasses.fields(flight):
        lines += [f'{namespace}/{field.name}:', '  ros__parameters:']
        lines += _commented(getattr(flight, field.name), '    ')
    return readable('\n'.join(lines) + '\n')


def _commented(params: Any, indent: str) -> Iterator[str]:
    """Yield the lines of one section."""
    for field in dataclasses.fields(params):
        value = getattr(params, field.name)
        if 'group' in field.metadata:
            if dataclasses.fields(value):
                yield f'{indent}{field.name}:'
            yield from _commented(value, indent + '  ')
            continue
        if 'text' in field.metadata and '\n' in value:
            yield f'{indent}{field.name}: |  # {_comment(field.metadata, value)}'
            yield from (f'{indent}  {line}' for line in value.splitlines())
            continue
        plain = list(value) if isinstance(value, tuple) else value
        written = dump_value(plain)
        yield f'{f"{indent}{field.name}: {written}":<47} # {_comment(field.metadata, value)}'


def _comment(meta: Mapping[str, Any], value: Any) -> str:
    """Return unit, range and source of a parameter; for a component its origin."""
    if 'component' in meta:
        found = meta['component'].find(value)
        if found is not None and found.own:
            return found.describe()
        return f"{' | '.join(meta['component'].names)} | FILE.py[:NAME], {meta['source']}"
    if 'unit' in meta:
        low, high = (
            str(x) if isinstance(x, int) else f'{x:g}' for x in (meta['low'], meta['high']))
        return f"[{meta['unit']}] {low}..{high}, {meta['source']}"
    if 'options' in meta:
        return f"{' | '.join(meta['options'])}, {meta['source']}"
    return f"true | false, {meta['source']}" if 'flag' in meta else meta['source']


def read_value(text: str) -> Any:
    """
    Return a value or a whole document written in YAML.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line, if the text is not YAML.

    """
    try:
        return load_yaml(text)
    except yaml.YAMLError as error:
        raise schema.ParameterError(reason(error)) from None


class Place(NamedTuple):
    """A value and the file and line it comes from."""

    value: Any
    where: str


class ParameterReader(Reader):
    """
    Reads parameters of the nodes of a flight.

    Attributes
    ----------
    leaves
        Known parameters, by name.

    """

    leaves: Mapping[str, dataclasses.Field] = LEAVES

    def learn(self, node: yaml.Node, others: Mapping[str, Any] | None = None) -> None:
        """Add the parameters of the components chosen in a file or in ``others``."""
        chosen = [*self._chosen(node), *(others or {}).items()]
        for one in chosen:
            try:
                self.leaves = {**self.leaves, **own_leaves([one])}
            except schema.ParameterError:
                continue  # reported where the value is read

    def plain(self, node: yaml.Node, name: str) -> Any:
        """
        Return the lists, mappings and values of a key, whose file was measured when read.

        Raises
        ------
        mambo_model.schema.ParameterError
            For a duplicate key, and for what is no value, such as an impossible date.

        """
        self._check_keys(node, name)
        try:
            return Loader('').construct_object(node, deep=True)
        except (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError,
                ValueError) as error:
            self.fail(node, name, ' '.join(str(error).split()))

    def _check_keys(self, node: yaml.Node, name: str) -> None:
        """Raise ParameterError for a duplicate key at any depth of a node."""
        below = node.value if isinstance(node, yaml.SequenceNode) else (
            [value for _, value in self.mapping(node, name).values()]
            if isinstance(node, yaml.MappingNode) else [])
        for one in below:
            self._check_keys(one, name)

    def _chosen(self, node: yaml.Node) -> Iterator[tuple[str, str]]:
        """Yield every component that is chosen anywhere in a file."""
        if isinstance(node, yaml.SequenceNode):
            for below in node.value:
                yield from self._chosen(below)
        for key, below in node.value if isinstance(node, yaml.MappingNode) else ():
            several = below.value if isinstance(below, yaml.SequenceNode) else [below]
            yield from ((key.value, absolute(one.value, Path(self.path).parent)) for one in several
                        if isinstance(one, yaml.ScalarNode) and isinstance(key.value, str))
            yield from self._chosen(below)

    def parameters(self, node: yaml.Node, prefix: str) -> dict[str, Place]:
        """Return {node.parameter: value and place} of everything below a node, each once."""
        found: dict[str, Place] = {}
        for name, place in self._each(node, prefix):
            if name in found:
                raise schema.ParameterError(
                    f'{place.where}: {name}: is given twice, also at {found[name].where}')
            found[name] = place
        return found

    def _each(self, node: yaml.Node, prefix: str) -> Iterator[tuple[str, Place]]:
        for part, (key, below) in self.mapping(node, prefix.rstrip('.') or 'parameters').items():
            name = f'{prefix}{part}'
            if name in self.leaves:
                owner = name.rpartition('.')[0]
                yield name, Place(
                    self.leaf(owner, name, self.leaves[name], below), self.where(below))
            elif any(known.startswith(f'{name}.') for known in self.leaves):
                yield from self._each(below, f'{name}.')
            else:
                raise schema.ParameterError(
                    f'{self.where(key)}: {schema.unknown(name, self.leaves)}')

    def ros_parameters(
        self, keys: Mapping[str, tuple[yaml.Node, yaml.Node]], namespace: str = '',
    ) -> dict[str, Place]:
        """Return {node.parameter: value and place} of a ROS 2 parameter file, of one drone."""
        parameters: dict[str, Place] = {}
        for name, (key, section) in keys.items():
            inner = self.mapping(section, name)
            if list(inner) != ['ros__parameters']:
                self.fail(key, name, 'must hold ros__parameters and nothing else')
            drone, _, node = name.rpartition('/')
            drone = drone.strip('/')
            if namespace and drone and '*' not in drone and drone != namespace.strip('/'):
                self.fail(key, name, f'is of another drone than {namespace}')
            if any(known.startswith(f'{node}.') for known in parameters):
                self.fail(key, name, f'is a second section for {node}')
            if node not in NODES:
                self.fail(key, name, f'is not a node of a flight; known: {", ".join(NODES)}')
            parameters.update(self.parameters(inner['ros__parameters'][1], f'{node}.'))
        return parameters


def from_parameters(path: Path | str, parameters: Mapping[str, Place]) -> Scenario:
    """Return the scenario of the parameters of a file; all others keep their defaults."""
    try:
        return override(Scenario(), {name: place.value for name, place in parameters.items()})
    except schema.ParameterError as error:
        raise located(path, parameters, error) from None


def located(
    path: Path | str, places: Mapping[str, Place], error: schema.ParameterError,
) -> schema.ParameterError:
    """Return an error with file, line and key (or the option) of a value that it names."""
    text = str(error)
    words = re.findall(r'\w+', text)
    begun = [name for name in places if text.startswith(f'{name}: ')]
    for name in (*begun, *places):
        place, key = places[name], name.rpartition('.')[2]
        if name in begun or key in words or (
                isinstance(place.value, str) and place.value and place.value in text):
            text = text.removeprefix(f'{name}: ').removeprefix(f'{key}: ')
            named = place.where == name or place.where.startswith('--') or text.startswith(
                (f'{name} = ', f'{key} = '))
            return schema.ParameterError(f'{place.where}: {"" if named else f"{name}: "}{text}')
    return schema.ParameterError(f'{path}: {text}')


def from_yaml(text: str, where: str = 'scenario') -> Scenario:
    """
    Read a scenario from a ROS 2 parameter file; parameters not in it keep their defaults.

    Raises
    ------
    mambo_model.schema.ParameterError
        Naming line and key, for text that is not such a file, an unknown node or parameter, or
        a value out of range.

    """
    reader = ParameterReader(where)
    root = reader.parse(text)
    reader.learn(root)
    return from_parameters(where, reader.ros_parameters(reader.mapping(root, 'file')))


def load(path: Path, node: str = '', namespace: str = '') -> Scenario:
    """
    Read a ROS 2 parameter file, which must set one of ``node``'s; see :func:`from_yaml`.

    With the ``namespace`` of a drone, sections with another one are refused.
    """
    reader = ParameterReader(path)
    root = reader.root()
    reader.learn(root)
    parameters = reader.ros_parameters(reader.mapping(root, 'file'), namespace)
    if node and not any(name.startswith(f'{node}.') for name in parameters):
        raise schema.ParameterError(f'{path}: holds no parameters of {node}')
    return from_parameters(path, parameters)
