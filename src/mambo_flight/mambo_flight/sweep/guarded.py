"""
Fly a batch of a sweep; a user's component that never ends costs its own flight only.

Flights with compiled code of the user are flown in a copy of this process, many in one. If one
stops advancing, the copy is killed, the flight is flown alone by :func:`supervised.fly`, which
finds the step that does not end, and the others go on in a new copy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import pickle
from typing import Any

from mambo_control import failsafe
from mambo_control.safety import REASON_CONTROLLER, REASON_ESTIMATE
from mambo_model import slots
from mambo_model.components import look_again, own_components
from mambo_model.errors import InputError, JobError

from . import monte_carlo
from .. import closed_loop, supervised
from ..scenario import replaced, Scenario
from .table import sources

Row = dict[str, Any]
_sweep = ''  # the last one of which this process got flights


def packed(flights: Sequence[Scenario]) -> bytes:
    """Return flights for :func:`fly_packed`, with the hashes of the user's components."""
    return pickle.dumps((sources(flights), list(flights)))


def fly_packed(sweep: str, batch: bytes, ideal: bool) -> list[Row]:
    """
    Return the rows of a batch in a worker, which may have flown for an earlier sweep.

    Parameters
    ----------
    sweep
        Unique for each sweep: at the first batch of one, the user's files are looked at again.
    batch
        Of :func:`packed`.
    ideal
        See :func:`fly`.

    Raises
    ------
    InputError
        If a file of the user is another one here than where the batch was packed.

    """
    global _sweep
    if sweep != _sweep:
        look_again()
        _sweep = sweep
    there, flights = pickle.loads(batch)
    _refuse_others(there, flights)
    return fly(flights, ideal)


def _refuse_others(there: Mapping[str, str], flights: Sequence[Scenario]) -> None:
    """Raise InputError if a file of the user is another one than the hash that it had."""
    for path, sha256 in sources(flights).items():
        if there[path] != sha256:
            raise InputError(f'{path}: is not the file that the sweep began with: keep it as it '
                             'is while a sweep lasts, and the same for every worker')


def fly(flights: Sequence[Scenario], ideal: bool) -> list[Row]:
    """
    Return a row for each flight: its metrics, and ``fault``.

    Parameters
    ----------
    flights
        In the order of the rows.
    ideal
        Whether to fly without sensors.

    Returns
    -------
    rows
        :func:`monte_carlo.metrics` with ``fault``: what a component of the user did wrong, one
        line with file and line, or empty. Of a flight with a step that never ends, the numbers
        until then.

    """
    slots.latest_fault()  # forget faults of earlier flights
    if not any(map(supervised.own_compiled, flights)):
        return list(_rows(flights, ideal))
    for flight in flights:  # compile before the fork
        _metrics(replaced(flight, {'sim_node.duration': closed_loop.STEP_NS * 1e-9}), ideal)
    rows: list[Row] = []
    while left := flights[len(rows):]:
        def work(give: Callable[[Row], None], left: Sequence[Scenario] = left) -> None:
            for row in _rows(left, ideal):
                give(row)
        flown, ended = supervised.in_copy(work)
        rows += flown
        if not ended:
            rows.append(_alone(left[len(flown)], ideal))
    return rows


def _metrics(flight: Scenario, ideal: bool) -> Row:
    if ideal:
        return next(iter(monte_carlo.fly_many([flight])))
    return monte_carlo.fly_with_sensors(flight)


def _rows(flights: Sequence[Scenario], ideal: bool) -> Iterator[Row]:
    there = sources(flights)
    for flight in flights:
        if not all(c.compiled for c in own_components(flight)):
            look_again()  # what plain Python keeps outside of its memory is of another flight
            _refuse_others(there, [flight])
        row = _metrics(flight, ideal)
        yield {**row, 'fault': slots.latest_fault()}


def _alone(flight: Scenario, ideal: bool) -> Row:
    """Return the row of a flight with a step that may never end."""
    if ideal:  # the same numbers, with every step on record
        flight = replaced(flight, {'estimator_node.estimator': 'ground_truth'})
    try:
        recording, fault = supervised.fly(flight)
    except JobError as error:  # nothing was flown
        return {**monte_carlo.metrics(monte_carlo.START, flight.sim_node.simulator.vehicle),
                **_ended(flight, 0.0), 'fault': str(error)}
    row = {**monte_carlo.measure(flight, recording), 'fault': fault}
    whole = len(recording.t) == closed_loop.step_count(flight)
    return row if whole else {**row, **_ended(flight, float(recording.t[-1]) * 1e-9)}


def _ended(flight: Scenario, t: float) -> Row:
    """Return what is said of a flight whose component did not answer after the time t in s."""
    own = own_components(flight.controller_node)
    return {'shutdown': True, 'shutdown_time': t, 'shutdown_reason': failsafe.REASONS[
        REASON_CONTROLLER if own else REASON_ESTIMATE]}
