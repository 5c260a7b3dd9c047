"""
Sweep files: a table of parameters with a row for each flight.

    title: Mass and wind
    scenario: fig_5_10          # an experiment, experiment/flight, or a scenario file
    design: random              # or grid
    samples: 100
    seed: 7                     # of the draws; the seed of a flight is a parameter
    vary:
      seed: {range: [1, 100]}
      vehicle: [identified, toolbox]
      sim_node.simulator.vehicle.mass: {normal: [0.068, 0.001]}
      sim_node.simulator.wind:
        velocity: [[0, 0, 0], [1, 0, 0]]
        gust_time: {uniform: [0.5, 2.0]}

``vary`` takes settings of a scenario file (vehicle, trajectory, seed, ...) and parameters of any
node, each with one value, a list, ``range: [first, last]`` of whole numbers or ``range:
[first, last, count]``, ``uniform: [low, high]`` or ``normal: [mean, standard deviation]``. A grid
crosses lists and ranges and draws distributions ``samples`` times at each of its points; a random
design has ``samples`` flights and draws everything. Draws depend on ``seed``, the name of the
parameter and the number of the draw alone. Seeds of flights are drawn without replacement from a
list or a range: each is drawn once before any is drawn again. ``samples`` and ``seed`` are refused
where nothing is drawn.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
import dataclasses
import itertools
from pathlib import Path
from typing import Any, NamedTuple

from mambo_model import schema
import numpy as np
import yaml

from .. import scenario as scenarios, scenario_file, unused
from ..course import course_file
from ..scenario import ParameterReader, Place
from ..scenario_file import FIELDS, SETS, Settings

DISTRIBUTIONS = ('normal', 'range', 'uniform')
MOST = 10_000_000  # flights of a sweep at most


@dataclasses.dataclass(frozen=True)
class _Head:
    """The keys of a sweep file other than ``vary``."""

    title: str = schema.text('', 'in one line what is varied')
    scenario: str = schema.text('', 'what is flown; empty: the default circle')
    design: str = schema.choice('grid', ('grid', 'random'), 'how values are combined')
    samples: int = schema.quantity(1, 'flights', 1, MOST, 'draws of each distribution')
    seed: int = schema.quantity(0, '1', 0, scenarios.MAX_SEED, 'of the draws')


HEAD = {field.name: field for field in dataclasses.fields(_Head)}


class Axis(NamedTuple):
    """A varied parameter: its values, or its distribution."""

    name: str
    where: str  # file and line
    field: dataclasses.Field
    values: tuple[Any, ...]  # empty for a distribution
    kind: str  # 'values', 'uniform' or 'normal'
    first: Any = None  # low or mean
    second: Any = None  # high or standard deviation


class Sweep(NamedTuple):
    """A sweep as read: flight i has the values ``rows[i]``, in the order of ``axes``."""

    path: Path
    head: _Head
    axes: tuple[Axis, ...]
    rows: list[tuple[Any, ...]]


class _Reader(ParameterReader):
    """Reads a sweep file."""

    def axes(self, node: yaml.Node, prefix: str = '') -> Iterator[Axis]:
        """Yield the parameters under ``vary``; names may be dotted or nested."""
        for part, (key, below) in self.mapping(node, prefix.rstrip('.') or 'vary').items():
            name = f'{prefix}{part}'
            field = self.leaves.get(name) or (None if prefix else FIELDS.get(name))
            if field is not None:
                yield self.axis(name, field, below)
            elif any(known.startswith(f'{name}.') for known in self.leaves):
                yield from self.axes(below, f'{name}.')
            else:
                known = self.leaves if '.' in name else [*FIELDS, *self.leaves]
                raise schema.ParameterError(f'{self.where(key)}: {schema.unknown(name, known)}')

    def axis(self, name: str, field: dataclasses.Field, node: yaml.Node) -> Axis:
        """Return one parameter."""
        def leaf(below: yaml.Node) -> Any:
            return self.leaf(name.rpartition('.')[0], name, field, below)
        if isinstance(node, yaml.MappingNode):
            return self.spread(name, field, node)
        many = isinstance(node, yaml.SequenceNode)
        if many and isinstance(field.default, tuple):  # one vector, or a list of vectors
            many = all(isinstance(below, yaml.SequenceNode) for below in node.value)
        if many and not node.value:
            self.fail(node, name, 'is an empty list')
        values = tuple(map(leaf, node.value)) if many else (leaf(node),)
        return Axis(name, self.where(node), field, values, 'values')

    def spread(self, name: str, field: dataclasses.Field, node: yaml.Node) -> Axis:
        """Return a range or a distribution."""
        keys = self.mapping(node, name)
        if len(keys) != 1 or next(iter(keys)) not in DISTRIBUTIONS:
            self.fail(node, name, f'must have one of {", ".join(DISTRIBUTIONS)}')
        if 'unit' not in field.metadata:
            self.fail(node, name, 'is not a number: give a list')
        (kind, (_, below)), = keys.items()
        if kind == 'range':
            values = self.range(name, field, below)
            for value in values:
                self.check(name, field, value, self.where(below))
            return Axis(name, self.where(below), field, values, 'values')
        if not isinstance(below, yaml.SequenceNode) or len(below.value) != 2:
            self.fail(below, name, f'{kind} must be two values: [...]')
        if isinstance(field.default, tuple):
            first, second = (
                np.array(self.numbers(one, name, len(field.default))) for one in below.value)
        else:
            first, second = (self.number(one, name) for one in below.value)
        if kind == 'uniform' and np.any(np.greater(first, second)):
            self.fail(below, name, 'uniform must be [low, high]')
        if kind == 'normal' and np.any(np.less(second, 0.0)):
            self.fail(below, name, 'normal must be [mean, standard deviation], the latter >= 0')
        return Axis(name, self.where(below), field, (), kind, first, second)

    def range(self, name: str, field: dataclasses.Field, node: yaml.Node) -> tuple[Any, ...]:
        """Return evenly spaced values, both ends included."""
        whole = isinstance(field.default, int)
        if (not isinstance(node, yaml.SequenceNode) or len(node.value) not in (2, 3)
                or isinstance(field.default, tuple)):
            self.fail(node, name, 'range must be [first, last] or [first, last, count]')
        numbers = [self.number(one, name) for one in node.value]
        if len(numbers) == 2:
            numbers.append(numbers[1] - numbers[0] + 1.0)
            if not whole:
                self.fail(node, name, 'range of a fraction must be [first, last, count]')
        first, last, count = numbers
        if not (count.is_integer() and 1 <= count <= MOST):
            self.fail(node, name, f'range of {count:g} values')
        values = np.linspace(first, last, int(count)).tolist()
        if whole and not all(value.is_integer() for value in values):
            self.fail(node, name, 'range must have whole numbers')
        return tuple(int(value) if whole else value for value in values)

    def check(self, name: str, field: dataclasses.Field, value: Any, where: str) -> None:
        """Raise ParameterError with the place of a value that is not valid."""
        try:
            schema.check_field(name.rpartition('.')[0], field, value)
        except schema.ParameterError as error:
            raise schema.ParameterError(f'{where}: {error}') from None


def _is_seed(axis: Axis) -> bool:
    """Return whether a parameter is a seed of the flights."""
    return axis.name == 'seed' or axis.name in scenarios.SEEDS


def _is_drawn(axis: Axis, head: _Head) -> bool:
    """Return whether the values of a parameter are drawn."""
    return head.design == 'random' or axis.kind != 'values'


def _draw(axis: Axis, seed: int, count: int) -> list[Any]:
    """Draw ``count`` values of a parameter; the first ones do not depend on ``count``."""
    sequence = np.random.SeedSequence(seed, spawn_key=tuple(axis.name.encode()))
    rng = np.random.Generator(np.random.PCG64(sequence))
    if axis.kind == 'values' and _is_seed(axis):
        size = len(axis.values)
        rounds = rng.random((-(-count // size), size)).argsort(axis=1, kind='stable')
        return [axis.values[i] for i in rounds.ravel()[:count].tolist()]
    if axis.kind == 'values':
        return [axis.values[int(u * len(axis.values))] for u in rng.random(count)]
    shape = (count, *np.shape(axis.first))
    if axis.kind == 'uniform':
        drawn = axis.first + (np.subtract(axis.second, axis.first)) * rng.random(shape)
    else:
        drawn = axis.first + np.multiply(axis.second, rng.standard_normal(shape))
    if isinstance(axis.field.default, int):
        return np.rint(drawn).astype(int).tolist()
    return [tuple(row) for row in drawn.tolist()] if drawn.ndim > 1 else drawn.tolist()


def _table(axes: tuple[Axis, ...], head: _Head, reader: _Reader) -> list[tuple[Any, ...]]:
    """Return the values of each flight."""
    drawn = [axis for axis in axes if _is_drawn(axis, head)]
    crossed = [axis for axis in axes if axis not in drawn]
    repeats = head.samples if drawn else 1
    count = repeats
    for axis in crossed:
        count *= len(axis.values)
    if count > MOST:
        raise schema.ParameterError(f'{reader.path}: {count} flights are more than {MOST}')
    grid = itertools.product(*(axis.values for axis in crossed))
    columns = {axis.name: column for axis, column in zip(
        crossed, zip(*(point for point in grid for _ in range(repeats))))}
    for axis in drawn:
        columns[axis.name] = _draw(axis, head.seed, count)
        for value in columns[axis.name] if axis.kind != 'values' else ():
            reader.check(axis.name, axis.field, value, f'{axis.where}: drawn')
    return list(zip(*(columns[axis.name] for axis in axes))) or [()]


def read(path: Path) -> Sweep:
    """
    Read a sweep file.

    Raises
    ------
    mambo_model.schema.ParameterError
        Naming file, line and key of an unknown key or a wrong value.

    """
    reader = _Reader(Path(path))
    root = reader.root()
    keys = reader.mapping(root, 'file')
    if 'scenario' in keys and isinstance(keys['scenario'][1], yaml.ScalarNode):
        base = _base(Path(path), keys['scenario'][1].value, {})
        if name := keys['scenario'][1].value:
            scenario_file.refuse_several(scenario_in(name, Path(path).parent))
        reader.learn(root, schema.flatten(base))
        usual = base.estimator_node.estimator, base.controller_node.controller
    else:
        reader.learn(root)
        usual = Settings().estimator, Settings().controller
    if not keys:
        raise schema.ParameterError(
            f'{path}: is empty: give vary, what differs from flight to flight, or a scenario')
    settings, axes = {}, ()
    for name, (key, node) in keys.items():
        if name == 'vary':
            axes = tuple(reader.axes(node))
        elif name in HEAD:
            settings[name] = reader.leaf('', name, HEAD[name], node)
        else:
            raise schema.ParameterError(
                f'{reader.where(key)}: {schema.unknown(name, [*HEAD, "vary"])}')
    names = [axis.name for axis in axes]
    for axis in axes:
        if names.count(axis.name) > 1:
            raise schema.ParameterError(f'{axis.where}: {axis.name}: duplicate key')
    head = _Head(**settings)
    if head.design == 'random' and 'samples' not in settings:
        raise schema.ParameterError(f'{path}: samples: missing; a random design needs it')
    for name in ('samples', 'seed'):
        if name in settings and not any(_is_drawn(axis, head) for axis in axes):
            raise schema.ParameterError(
                f'{reader.where(keys[name][0])}: {name}: has no effect, as nothing is drawn: '
                'vary something by uniform or normal, or in design: random, or leave it out')
    estimators, controllers = (
        [value for axis in axes if axis.name in (kind, *SETS[kind]) for value in axis.values]
        or [chosen] for kind, chosen in zip(('estimator', 'controller'), usual, strict=True))
    unused.refuse(
        {axis.name: axis.where for axis in axes}, estimators=estimators, controllers=controllers)
    for axis in axes:
        if _is_seed(axis):
            _refuse_repeats(axis)
    for key in ('seed', 'estimator', 'controller'):
        twice = next((axis for axis in axes if axis.name in SETS[key]), None)
        if twice and key in names:
            raise schema.ParameterError(
                f'{twice.where}: {twice.name}: the key {key} sets it as well: leave one out')
    rows = _table(axes, head, reader)
    if 'samples' in settings:
        _refuse_one_sample(axes, rows, reader.where(keys['samples'][0]))
    return Sweep(Path(path), head, axes, rows)


def _refuse_one_sample(axes: tuple[Axis, ...], rows: list[tuple[Any, ...]], where: str) -> None:
    """
    Raise ParameterError if drawn flights repeat and nothing but their seeds varies.

    Where something else varies, the summary of the result counts the flights that repeat.
    """
    different = len(set(rows))
    varied = [axis for axis, column in zip(axes, zip(*rows), strict=True) if len(set(column)) > 1]
    if different == len(rows) or not all(map(_is_seed, varied)):
        return
    why = (f'nothing but the seed varies: give fewer samples or more seeds, seed: {{range: [1, '
           f'{len(rows)}]}} for instance' if varied else 'nothing varies: vary something')
    raise schema.ParameterError(
        f'{where}: samples: of {len(rows)} flights {different} would be different, as {why}')


def _refuse_repeats(axis: Axis) -> None:
    """Raise ParameterError for a seed that a list has twice: its flights would be one sample."""
    for value, count in Counter(axis.values).most_common(1):
        if count > 1:
            raise schema.ParameterError(
                f'{axis.where}: {axis.name}: {value} is there {count} times; flights of one seed '
                'are one sample: give different ones')


def _base(
    path: Path, name: str, settings: Mapping[str, Place],
) -> scenarios.Scenario:
    """Return the scenario of a sweep file, with settings applied."""
    if not name:
        return scenario_file.from_settings(settings)
    return scenario_file.load(scenario_in(name, path.parent), settings)[1]


def scenario_in(name: str, folder: Path) -> str:
    """Return the name of a scenario; if it names a file, with the folder where that starts."""
    return str(folder / name) if '.yaml' in name or '.yml' in name else name


class Flights:
    """The scenarios of a sweep, built one by one; flights with equal settings share a base."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        self.bases: dict[tuple[Any, ...], scenarios.Scenario] = {}

    def __len__(self) -> int:
        return len(self.sweep.rows)

    def _base(self, settings: dict[str, Place]) -> scenarios.Scenario:
        key = tuple(place.value for place in settings.values())
        if key not in self.bases:
            self.bases[key] = _base(self.sweep.path, self.sweep.head.scenario, settings)
        return self.bases[key]

    def __getitem__(self, number: int) -> scenarios.Scenario:
        """
        Return the scenario of one flight.

        Raises
        ------
        mambo_model.schema.ParameterError
            If its values contradict each other; with file and line of one of them.

        """
        settings, parameters = {}, {}
        for axis, value in zip(self.sweep.axes, self.sweep.rows[number]):
            if axis.name == 'seed':
                parameters.update(dict.fromkeys(scenarios.SEEDS, value))
            elif axis.name in FIELDS or axis.name in scenarios.COMPONENTS:
                if isinstance(value, str):
                    value = course_file.absolute(value, self.sweep.path.parent)
                settings[axis.name.rpartition('.')[2]] = Place(value, axis.where)
            else:
                parameters[axis.name] = value
        try:
            flight = scenarios.replaced(self._base(settings), parameters)
        except schema.ParameterError as error:
            raise self._located(error, number) from None
        if not flight.sim_node.duration > 0.0:
            raise schema.ParameterError(
                f'{self.sweep.path}: sim_node.duration: must be more than 0 s')
        return flight

    def _located(self, error: schema.ParameterError, number: int) -> schema.ParameterError:
        """Return an error with file and line of a parameter that it names."""
        text = str(error)
        for axis in self.sweep.axes:
            if text.startswith(axis.where):
                return error
            if axis.name.rpartition('.')[2] in text:
                return schema.ParameterError(f'{axis.where}: flight {number}: {text}')
        return schema.ParameterError(f'{self.sweep.path}: flight {number}: {text}')
