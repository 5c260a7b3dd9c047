"""Recordings from a script: opened, compared, estimated again."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from mambo_analysis.compare import (
    compare as comparing, estimate as estimating, report, tables)
from mambo_analysis.compare.pair import WHAT
from mambo_bags.reader import Bag, read_bag
from mambo_flight import offline_replay, scenario, unused
from mambo_model.components import look_again
from mambo_model.errors import InputError
from mambo_model.whole_file import PAGE, refuse_other_kind
import pandas

from . import given
from .flights import Flight, STATE


def open_bag(path: Path | str, namespace: str | None = None) -> Bag:
    """
    Read a bag: a rosbag2 directory or an ``.mcap`` file.

    ``bag['estimate/odom'].position`` is (n, 3) m, ``bag['imu/data_raw'].to_pandas()`` a table.

    Parameters
    ----------
    path
        Of the bag.
    namespace
        Of the drone, if the bag has several.

    Raises
    ------
    InputError
        If it cannot be read.

    """
    if not isinstance(namespace, str | None):
        raise InputError(f'namespace: must be text, not {namespace!r}')
    return read_bag(given.path(path, 'bag'), None, namespace)


def _bag(source: Bag | Flight | Path | str) -> Bag:
    """Return the bag of what a user may give as one."""
    if isinstance(source, Flight):
        return source.bag
    return source if isinstance(source, Bag) else open_bag(source)


class Comparison(dict):
    """
    Result of :func:`compare`: a dict of plain values, printed as the table of ``mambo compare``.

    The keys are those of ``mambo compare --json``.
    """

    def __init__(
        self, values: dict[str, Any], text: str, page: Callable[[], report.Report],
    ) -> None:
        super().__init__(values)
        self._text, self._page = text, page

    def __repr__(self) -> str:
        return self._text

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return f'<pre>{escape(self._text)}</pre>'

    def to_html(self, path: Path | str) -> Path:
        """
        Write the page of ``./run`` and ``mambo compare --html``, one file; return its path.

        Raises
        ------
        InputError, JobError
            If the file cannot be written, exists and is not a page, or is named as part of a bag.

        """
        target = given.path(path, 'path')
        refuse_other_kind(target, PAGE)  # before the page is made
        return report.write(target, self._page())

    def to_pandas(self) -> pandas.DataFrame:
        """Return the errors as a table: a row per quantity and part of the flight."""
        rows = []
        for section in self['errors']:
            for row in section['rows']:
                per_axis = {f'rms_{axis}': value
                            for axis, value in zip(section['axes'], row['rms'])}
                rows.append({
                    'quantity': section['title'], 'unit': section['unit'], 'part': row['part'],
                    'count': row['count'], 'rms': row['rms_total'], 'max': row['maximum_total'],
                    **per_axis})
        return pandas.DataFrame(rows)


def compare(
    a: Bag | Flight | Path | str, b: Bag | Flight | Path | str | None = None, *,
    a_topic: str | None = None, b_topic: str | None = None, what: Collection[str] | None = None,
) -> Comparison:
    """
    Compare what one flight says of itself, or two flights: A minus B.

    Parameters
    ----------
    a, b
        Bags, flights or paths of bags; without ``b`` (and topics) the streams of ``a``.
    a_topic, b_topic
        Odometry or PoseStamped to compare; default: the best that both have.
    what
        To be made equal first, as ``--align`` of ``mambo compare``.

    Raises
    ------
    InputError
        If a bag cannot be read, the two have nothing in common, or ``what`` is unknown.

    """
    first = _bag(a)
    _check(what)
    if b is None and a_topic is None and b_topic is None:
        if what is not None:
            raise InputError('what: aligns two recordings; leave it out for one')
        result = comparing.compare(first)
        return Comparison(result, tables.table(result), lambda: report.of_one(first, result))
    other = None if b is None else _bag(b)
    found = comparing.compare_bags(first, other, a_topic, b_topic, what)
    return Comparison(
        found[0], tables.table(found[0]), lambda: report.of_two(first, other, *found))


def _check(what: Any) -> None:
    """Raise InputError for what cannot be made equal."""
    if what is not None and (isinstance(what, str) or not isinstance(what, Collection) or not all(
            one in WHAT for one in what)):
        raise InputError(f'what: must be some of {list(WHAT)}, not {what!r}')


@dataclass(frozen=True, eq=False)  # arrays have no single truth value
class Estimate:
    """
    What an estimator makes of the sensors of a bag.

    Attributes
    ----------
    bag : Bag
        ``estimate/odom`` and ``estimator/state``, in memory.
    comparison : str
        How it differs from what the recording holds.
    verdict : str
        Which sensors were absent or rejected, and whether the estimate diverged.
    numbers : mambo_flight.offline_replay.Estimates
        States and covariances as arrays, inertial NED and body FRD.

    """

    bag: Bag = field(repr=False)
    comparison: str
    verdict: str
    numbers: offline_replay.Estimates = field(repr=False)

    def __repr__(self) -> str:
        return f'{self.comparison}\n{self.verdict}'

    def to_pandas(self) -> pandas.DataFrame:
        """Return the states, a row per answer: index ``t`` [s], columns :data:`flights.STATE`."""
        return pandas.DataFrame(
            self.numbers.state, columns=list(STATE),
            index=pandas.Index(self.numbers.t * 1e-9, name='t'))


def estimate(
    source: Bag | Flight | Path | str, estimator: str | None = None, *,
    parameters: Mapping[str, Any] | None = None,
) -> Estimate:
    """
    Estimate the flight of a bag again from its sensors, as the live estimator would to the bit.

    Parameters
    ----------
    source
        Bag, flight, or path of a bag.
    estimator
        Which one; default: that of the bag.
    parameters
        {'kalman.flow.Q': value}: parameters of ``estimator_node``, with or without the name of
        the node, applied last.

    Raises
    ------
    InputError
        If the bag has no sensors, or for an unknown name or value.

    """
    look_again()
    bag = _bag(source)
    node = estimating.parameters(bag)
    values = {name.removeprefix('estimator_node.'): value
              for name, value in given.parameters(parameters).items()}
    if estimator is not None:
        if 'estimator' in values:
            raise InputError('estimator: is given twice, also in parameters')
        values['estimator'] = estimator
    changed = {f'estimator_node.{name}': value for name, value in values.items()}
    node = scenario.override(scenario.Scenario(estimator_node=node), changed).estimator_node
    unused.refuse(dict.fromkeys(changed, 'parameters'), estimators=[node.estimator])
    if node.estimator == 'ground_truth':
        raise InputError('estimator ground_truth estimates nothing; name another')
    ours = estimating.answer(bag, node)
    return Estimate(ours.bag, ours.comparison, ours.verdict, ours.found)
