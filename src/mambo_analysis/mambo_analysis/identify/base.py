"""
The vehicle that an identified one starts from: its base.

A bag of a simulated flight says in its scenario which vehicle flew. That one is the base, unless
``--base`` names another. The importers keep parameters of the estimator under the name of a
scenario: they say nothing of a flight.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import Bag, read_bag
from mambo_flight.scenario import from_yaml, ParameterReader, Scenario
from mambo_model.schema import flatten, ParameterError
from mambo_model.vehicle.parameters import find, PRESETS, Vehicle

from .result import DEFAULT, Report


class Base(NamedTuple):
    """A vehicle to start from."""

    vehicle: Vehicle
    name: str                             # known vehicle or file that a vehicle file starts from
    kept: dict[str, tuple[Any, str]]      # {name: (value, source)} in which ``vehicle`` differs
    notes: tuple[str, ...] = ()           # where it comes from, if that was not said
    simulated: bool = False               # whether the bag holds the scenario of its flight
    battery: bool = True                  # False: simulated without one, so nothing sagged
    own: bool = False                     # whether it is the vehicle of the scenario itself

    def unless_sagged(self, doubt: str, values: str, remedy: str) -> list[str]:
        """
        Return a note that values hold only if the battery did not sag; none if there was none.

        Parameters
        ----------
        doubt
            Why a sag is not accounted for.
        values
            What a sag would falsify.
        remedy
            What to do.

        """
        if not self.battery:
            return []
        return [f'{doubt}: {values} hold only if the battery did not sag; {remedy}']


def flown(bag: Bag) -> Scenario | None:
    """
    Return the scenario of the flight in a bag; None if it holds none.

    Raises
    ------
    mambo_model.schema.ParameterError
        If ``scenario.yaml`` in the bag is no parameter file.

    """
    text = bag.attachments.get('scenario.yaml')
    if not isinstance(text, str):
        return None
    where = f'{bag.path}: scenario.yaml'
    reader = ParameterReader(where)
    root = reader.parse(text)
    reader.learn(root)
    names = reader.ros_parameters(reader.mapping(root, 'file'))
    return from_yaml(text, where) if any(name.startswith('sim_node.') for name in names) else None


def _differing(one: Vehicle, other: Vehicle) -> list[str]:
    """Return the names of the parameters in which two vehicles differ."""
    mine, theirs = flatten(one), flatten(other)
    return [name for name, value in mine.items() if value != theirs[name]]


def _listed(names: list[str]) -> str:
    return ', '.join(names[:3]) + (f' and {len(names) - 3} more' if len(names) > 3 else '')


def choose(given: str | None, flight: Scenario | None) -> Base:
    """
    Return the base: as given, else the vehicle of the flight, else the default.

    Parameters
    ----------
    given
        Name or file of a vehicle; None if nobody said.
    flight
        Scenario of the flight; None if there is none.

    Raises
    ------
    mambo_model.schema.ParameterError
        If the vehicle is unknown or its file is wrong.

    """
    simulated = flight is not None
    if flight is None:
        notes = () if given else (
            f'no --base and no scenario in the bag: all else is as of {DEFAULT}, a Mambo',)
        return Base(find(given or DEFAULT), given or DEFAULT, {}, notes)
    vehicle = flight.sim_node.simulator.vehicle
    battery = vehicle.battery.enabled
    if given:
        differ = _differing(find(given), vehicle)
        notes = (f'--base: {given} is not the vehicle of the scenario: they differ in '
                 f'{_listed(differ)}',) if differ else ()
        return Base(find(given), given, {}, notes, simulated, battery)
    name = min(PRESETS, key=lambda known: len(_differing(PRESETS[known], vehicle)))
    differ, values = _differing(PRESETS[name], vehicle), flatten(vehicle)
    kept = {key: (values[key], 'as the scenario of the flight') for key in differ}
    note = f'the base is the vehicle of the scenario: {name}'
    return Base(vehicle, name, kept, (
        f'{note}, with another {_listed(differ)}' if differ else note,), simulated,
        battery, own=True)


def of_bag(given: str | None, path: Path, namespace: str | None) -> Base:
    """
    Return the base for the bag of a flight.

    Parameters
    ----------
    given
        Name or file of a vehicle; None: :func:`choose` says which.
    path, namespace
        Of the bag, and of the drone in it.

    Raises
    ------
    mambo_bags.reader.BagError, mambo_model.schema.ParameterError
        If the bag cannot be read, or the scenario or vehicle that is needed.

    """
    if given:
        find(given)  # a wrong name is told before the bag is read
    bag = read_bag(path, (), namespace)
    try:
        return choose(given, flown(bag))
    except ParameterError as error:
        if not given:
            raise ParameterError(f'{error}; give --base') from None
        return choose(given, None)._replace(notes=(f'not compared with --base: {error}',))


def based(report: Report, base: Base) -> Report:
    """Return a report with its base: where it comes from, and what a vehicle file keeps of it."""
    return report._replace(
        base=base.name, notes=[*report.notes, *base.notes],
        vehicle=base.kept | report.vehicle if report.vehicle else {})
