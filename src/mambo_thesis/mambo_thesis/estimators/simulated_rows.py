"""Rows of simulated flights: errors beside the bound, and what a failing sensor does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
import math

from mambo_flight import closed_loop
from mambo_flight.accuracy.beside import measured_beside
from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.error_statistics import Measured, measured, MOTION, QUANTITIES
from mambo_flight.accuracy.filter_error import DT, evaluate_recording, with_unknowns
from mambo_flight.scenario import Scenario, scenario
from mambo_sim.faults import KINDS, READINGS
import numpy as np

from .case import Case
from .paired_rows import Row

PATHS = {
    'circle': '(5.3)', 'circle_rising': '(5.4)', 'vertical_circle': '(5.6)',
    'figure_3_3': '(3.31)', 'vertical_circle_large': 'C.4', 'hover': 'hover'}
SLOPES = (0.0, -0.07, 0.14)     # 1/m, true slope of the scale of the flow
DRIFTING = ('circle_rising', 'vertical_circle', 'figure_3_3', 'vertical_circle_large')
FAULT_BEGIN = 14.0              # s
FAULT_LENGTH = 2.0              # s
GYRO_FAULT_LENGTH = 0.1         # s: nothing stabilises the vehicle without a gyro
LOST_FOR_GOOD = 16.0            # s: to the end of the flight
FAULTY_FLIGHT = 30.0            # s
OFF = ('estimate off [m]', 'vehicle off [m]')


def _compared(flights: Iterable[Scenario], others: list[str]) -> tuple[
        list[Measured], dict[str, list[Measured]]]:
    """Fly on the joint filter; return its errors and those of others on the same samples."""
    own: list[Measured] = []
    beside: dict[str, list[Measured]] = {name: [] for name in ('kalman', *others)}
    for flight in flights:
        samples = closed_loop.fly(flight)
        error = evaluate_recording(flight, samples)
        own.append(measured(error))
        for name, found in beside.items():
            found.append(measured_beside(flight, samples, error.start, own[-1], name))
    return own, beside


def motion_rows(
    name: str, flights: Iterable[Scenario], others: list[str], quantities: int = MOTION,
) -> list[Row]:
    """
    Return the errors of the motion over flights whose sensors every estimator reads.

    Parameters
    ----------
    name
        Name of the case.
    flights
        Scenarios that fly on the joint filter, one for each seed.
    others
        Estimators to show besides, of ``mambo_flight.accuracy.beside.ESTIMATORS``.
    quantities
        The first so many of ``QUANTITIES``.

    """
    own, beside = _compared(flights, others)
    rows = []
    for i, quantity in enumerate(QUANTITIES[:quantities]):
        squares = {key: quantity.factor ** 2 * np.array([one.rows[i].reached for one in found])
                   for key, found in (('joint', own), *beside.items())}
        bound = quantity.factor * math.sqrt(float(np.mean([one.rows[i].bound for one in own])))
        rows.append(Row(
            name, f'{quantity.name} [{quantity.unit}]', bound, squares['kalman'],
            squares['joint'],
            {key: math.sqrt(float(squares[key].mean())) for key in others}))
    return rows


def _thesis(path: str, seeds: range, others: list[str]) -> list[Row]:
    flight = flight_of(path)
    return motion_rows(
        PATHS[path], (with_unknowns(flight, seed, True) for seed in seeds), others)


def _slope(path: str, slope: float, seeds: range, others: list[str]) -> list[Row]:
    flight = flight_of(path)
    return motion_rows(
        f'{PATHS[path]}, {slope:g} 1/m',
        (with_unknowns(flight, seed, True, slope) for seed in seeds), others, 1)


def _flow_deck(seeds: range, others: list[str]) -> list[Row]:
    flight = flight_of('flow_deck_circle')
    return motion_rows(
        'flow_deck_circle', (with_unknowns(flight, seed, False) for seed in seeds), others)


def _default(seeds: range, others: list[str]) -> list[Row]:
    return motion_rows(
        './run', (scenario(seed=seed, estimator='joint') for seed in seeds), others)


def after_fault(
    sensor: str, kind: str, length: float, estimator: str, seed: int,
) -> tuple[float, float]:
    """
    Fly on an estimator with a fault; return the largest distances after its begin.

    Parameters
    ----------
    sensor, kind
        Of ``mambo_sim.faults.FaultsParams`` and ``KINDS``.
    length : s
        Duration of the fault.
    estimator, seed
        What flies.

    Returns
    -------
    Of the estimate and of the path of the reference from the vehicle, m.

    """
    part = f'sim_node.simulator.faults.{sensor}'
    flight = scenario(
        duration=FAULTY_FLIGHT, seed=seed, land=False, estimator=estimator, overrides={
            f'{part}.kind': kind, f'{part}.start': FAULT_BEGIN, f'{part}.duration': length})
    r, on = closed_loop.fly(flight), round(FAULT_BEGIN / DT)
    off, away = (float(np.linalg.norm((r.truth - other)[on:, :3], axis=1).max())
                 for other in (r.estimate, r.reference))
    return off, away


def _fault(
    name: str, sensor: str, kind: str, length: float, seeds: range, others: list[str],
) -> list[Row]:
    """Return the largest distances; other estimators do not fly."""
    kalman, joint = (
        np.array([after_fault(sensor, kind, length, estimator, seed) for seed in seeds])
        for estimator in ('kalman', 'joint'))
    return [Row(name, quantity, math.nan, kalman[:, i] ** 2, joint[:, i] ** 2,
                dict.fromkeys(others, math.nan)) for i, quantity in enumerate(OFF)]


def _faults() -> Iterator[Case]:
    """Return every fault of every sensor."""
    for sensor, kinds, length in (
            ('sonar', KINDS, FAULT_LENGTH), ('optical_flow', KINDS, FAULT_LENGTH),
            ('barometer', KINDS, FAULT_LENGTH), ('accel', READINGS, FAULT_LENGTH),
            ('gyro', READINGS, GYRO_FAULT_LENGTH)):
        for kind in kinds[1:]:
            name = f'{sensor} {kind}'
            yield Case('faults', name, partial(_fault, name, sensor, kind, length))
    for sensor in ('sonar', 'optical_flow', 'barometer'):
        name = f'{sensor} lost for good'
        yield Case('faults', name, partial(_fault, name, sensor, 'missing', LOST_FOR_GOOD))


def cases() -> list[Case]:
    """Return every simulated case."""
    return [
        *(Case('thesis', path, partial(_thesis, path)) for path in PATHS),
        *(Case('slopes', f'{path} {slope:g}', partial(_slope, path, slope))
          for path in DRIFTING for slope in SLOPES),
        Case('flow_deck', 'flow_deck_circle', _flow_deck),
        Case('run', 'run', _default), *_faults()]
