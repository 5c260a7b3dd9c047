"""Flights in one process, from a script."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
import inspect
from pathlib import Path
import tempfile
from typing import Any, TYPE_CHECKING
import warnings

from mambo_analysis.compare import figures
from mambo_bags.reader import Bag, read_bag
from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_flight import flight_options, recording_to_bag, scenario_file, supervised, unused
from mambo_flight.closed_loop import Recording
from mambo_flight.course import function_course
from mambo_flight.fly import failure as failure_of
from mambo_flight.scenario import override, Scenario
from mambo_flight.scenario_file import Place
from mambo_flight.sweep import monte_carlo
from mambo_model.components import look_again
from mambo_model.errors import InputError, readable
from mambo_model.whole_file import refuse_existing
import numpy as np
from numpy.typing import NDArray
import pandas

from . import given

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STATE = ('x', 'y', 'z', 'u', 'v', 'w', 'qw', 'qx', 'qy', 'qz', 'p', 'q', 'r')
"""Columns of a state: position m, NED; velocity m/s, body; quaternion; rates rad/s, body."""


@dataclass(frozen=True, eq=False)  # arrays have no single truth value
class Flight:
    """
    A simulated flight.

    Attributes
    ----------
    name : str
        Of the experiment, or of the choices.
    scenario : Scenario
        Every parameter of every node.
    recording : Recording
        The flight as arrays, one row per control step.
    fault : str
        What a controller or estimator of yours did wrong, with file and line; empty: nothing.

    """

    name: str
    scenario: Scenario
    recording: Recording = field(repr=False)
    fault: str = ''

    def __repr__(self) -> str:
        m = self.metrics
        tracking = 'carried by hand' if self.scenario.sim_node.simulator.hand.enabled else (
            f'tracking RMS {m["tracking_rms"]:.4g} m')
        errors = 'never took off' if monte_carlo.never_took_off(m) else (
            f'{tracking}, estimation RMS {m["estimation_rms"]:.4g} m')
        failed = f', {self.failure}' if self.failure else ''
        return f'<Flight {self.name}: {self.t[-1]:g} s, {errors}{failed}>'

    @property
    def t(self) -> NDArray[np.float64]:
        """Return the time of each control step, (n,) s."""
        return self.recording.t * 1e-9

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """
        Return tracking and estimation errors [m], saturation, energy [J] and endings by name.

        See :func:`mambo_flight.sweep.monte_carlo.metrics`, also for a vehicle that a hand carries.
        """
        return monte_carlo.measure(self.scenario, self.recording)

    @cached_property
    def failure(self) -> str:
        """Return why the flight was not flown as asked, as ``mambo fly`` says; empty: it was."""
        failed = failure_of(self.scenario, self.recording, self.metrics)
        return '; '.join(filter(None, (self.fault, failed)))

    def to_pandas(self) -> pandas.DataFrame:
        """
        Return the flight as a table, a row per control step.

        Index ``t`` [s]. Columns by two names: ``truth``, ``estimate`` and ``reference`` with
        :data:`STATE` (inertial NED, body FRD), ``pwm`` with ``1`` to ``4``, ``command`` with
        ``thrust`` [N], ``phase`` and ``stopped``. ``table['truth']['x']`` is one of them.
        """
        r = self.recording
        blocks = {
            'truth': (STATE, r.truth), 'estimate': (STATE, r.estimate),
            'reference': (STATE, r.reference), 'pwm': ('1234', r.pwm)}
        columns = {(block, name): rows[:, i] for block, (names, rows) in blocks.items()
                   for i, name in enumerate(names)}
        columns |= {('command', 'thrust'): r.thrust, ('command', 'phase'): r.phase,
                    ('command', 'stopped'): r.stopped}
        return pandas.DataFrame(columns, index=pandas.Index(self.t, name='t'))

    def save(self, path: Path | str) -> Bag:
        """
        Write the bag of the flight, byte for byte that of the graph in lockstep; return it read.

        Raises
        ------
        InputError
            If the path exists or cannot be made.

        """
        path = given.path(path, 'path')
        refuse_existing(path, 'give another path')
        recording_to_bag.check(self.scenario)
        recording_to_bag.write(path, self.scenario, self.recording)
        return read_bag(path)

    @cached_property
    def bag(self) -> Bag:
        """Return the flight as a bag in memory."""
        with tempfile.TemporaryDirectory(prefix='mambo_') as folder:
            return self.save(Path(folder) / readable(self.name))

    def plot(self) -> Figure:
        """Return the figures of the flight on one sheet, as on the page of ``./run``."""
        return figures.overview(self.bag, self.name)


def _refuse_two(chosen: Mapping[str, Place], values: Mapping[str, Any]) -> None:
    """Raise InputError for a parameter that contradicts an argument, as the command does."""
    settings = {name: place.value for name, place in chosen.items()}
    if (found := scenario_file.contradicted(settings, values)) is not None:
        name, full = found
        raise InputError(f'parameters: {full} = {values[full]!r} contradicts {name} = '
                         f'{settings[name]!r}: leave one out')


def _named(what: str, thing: Any, offer: Callable[[Any], str]) -> str | None:
    """Return the name of what is flown: itself, or one under which an object is offered."""
    if thing is None or isinstance(thing, str):
        return thing
    if isinstance(thing, Path):
        return str(thing)
    if not (callable(thing) or hasattr(thing, 'step') or inspect.ismodule(thing)):
        raise InputError(f'{what}: {thing!r} is neither a name, a path, a function nor a class')
    return offer(thing)


def fly(
    scenario: Scenario | Path | str | None = None, *,
    trajectory: str | Path | Callable[[float], Any] | None = None, estimator: Any = None,
    controller: Any = None, duration: float | None = None, seed: int | None = None,
    vehicle: str | None = None, believed: str | None = None, noise: bool | None = None,
    landing: bool | None = None, parameters: Mapping[str, Any] | None = None,
) -> Flight:
    """
    Fly in one process, with the numbers of the graph in lockstep, and return the flight.

    Before the flight one UserWarning names what the vehicle cannot fly, and which changes, faults
    and commands have no effect.

    Parameters
    ----------
    scenario
        An experiment as ``mambo fly`` takes it (``'fig_5_11'``, ``'experiment/flight'``, a file),
        or a :class:`Scenario`; None: the circle with the choices below.
    trajectory
        What is flown: a name as the command takes it, or a function of time: t [s] to x, y, z
        [m], inertial NED, and yaw [rad] or nothing, or up to five rows of these with the
        derivatives. Its attribute ``duration`` [s], if it has one, says how long it is. None: as
        the scenario says.
    estimator, controller
        By what: a name, a class or module with ``Params``, ``initial`` and ``step``, or a
        function that takes the arguments of ``step`` without memory and parameters and returns
        the answer. One that is given itself is flown as plain Python. None: as the scenario says.
    duration : s
        From start to end.
    seed
        Of every noise stream.
    vehicle, believed
        Known vehicles or vehicle files: the true one, and the one the controller believes in.
    noise
        Whether sensors have noise and bias.
    landing
        Whether to descend at the end.
    parameters
        {'node.parameter': value}, applied last, as ``--set`` of ``./run``.

    Raises
    ------
    InputError
        For an unknown name, a value out of range, or a component or function that does not
        answer as it must, in one line.

    """
    look_again()
    choices = {
        'trajectory': _named('trajectory', trajectory, function_course.offer),
        'estimator': _named('estimator', estimator, ESTIMATORS.offer),
        'controller': _named('controller', controller, CONTROLLERS.offer),
        'duration': duration, 'seed': seed, 'vehicle': vehicle, 'believed': believed,
        'noise': noise, 'landing': landing}
    chosen_ones = {name: Place(given.plain(value), name)
                   for name, value in choices.items() if value is not None}
    values = given.parameters(parameters)
    if isinstance(scenario, Scenario):
        if chosen_ones:
            raise InputError(
                f'{", ".join(chosen_ones)}: a Scenario has its own; give them as parameters')
        name, chosen = 'scenario', scenario
    elif scenario is None:
        chosen = scenario_file.from_settings(chosen_ones)
        name = '_'.join(Path(one).stem.partition(' ')[0] for one in (
            choices['trajectory'] or 'circle', chosen.estimator_node.estimator))
    else:
        name, chosen = scenario_file.load_alone(
            str(given.path(scenario, 'scenario')),
            chosen_ones | scenario_file.command_limits(values, 'parameters'))
    _refuse_two(chosen_ones, values)
    chosen = override(chosen, values)
    unused.refuse(
        dict.fromkeys(values, 'parameters'),
        estimators=[chosen.estimator_node.estimator],
        controllers=[chosen.controller_node.controller])
    unused.refuse_plan(chosen.reference_node, {
        **{name: place.where for name, place in chosen_ones.items()},
        **dict.fromkeys(values, 'parameters')})
    if not chosen.sim_node.duration > 0.0:
        raise InputError(f'{name}: sim_node.duration must be more than 0 s')
    if lines := [*flight_options.idle(chosen), *flight_options.impossible(chosen)]:
        warnings.warn('\n'.join(lines), stacklevel=2)
    recording, fault = supervised.fly(chosen, inner=True)
    return Flight(name, chosen, recording, fault)
