"""Rows of simulated flights: every case there is, and short ones of each kind."""

import math
from types import SimpleNamespace

from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.filter_error import with_unknowns
from mambo_flight.scenario import override
from mambo_sim.faults import KINDS, READINGS
from mambo_thesis.estimators import simulated_rows
import numpy as np
import pytest


def test_every_fault_of_every_sensor_is_a_case():
    names = {case.name for case in simulated_rows.cases() if case.section == 'faults'}
    assert {f'sonar {kind}' for kind in KINDS[1:]} <= names
    assert {f'accel {kind}' for kind in READINGS[1:]} <= names
    assert 'barometer lost for good' in names and len(names) == 3 * 8 + 2 * 4 + 3


def test_sections_hold_the_trajectories_of_the_thesis_and_their_slopes():
    cases = simulated_rows.cases()
    assert [case.name for case in cases if case.section == 'thesis'] == list(simulated_rows.PATHS)
    assert sum(case.section == 'slopes' for case in cases) == 12
    assert len({(case.section, case.name) for case in cases}) == len(cases)


@pytest.fixture(scope='module')
def rows():
    """Return the rows of one flight over the trajectory that needs the slope."""
    flight = override(flight_of('circle_rising'), {'sim_node.duration': 30.0})
    return simulated_rows.motion_rows(
        'short', [with_unknowns(flight, seed, True, 0.14) for seed in (1, 2)], ['toolbox'])


def test_both_estimators_stand_beside_the_bound(rows):
    assert [row.quantity for row in rows] == [
        'drift at the end [m]', 'height [m]', 'horizontal velocity [mm/s]',
        'vertical velocity [mm/s]', 'tilt [deg]']
    for row in rows:
        assert row.kalman.shape == row.joint.shape == (2,) and row.bound > 0.0
        assert row.others['toolbox'] > 0.0
    drift, _, velocity, _, tilt = rows
    assert drift.joint.max() < drift.kalman.max()  # the slope that only one of them finds
    assert 1.0 < math.sqrt(velocity.joint.mean()) < 10.0 < math.sqrt(velocity.kalman.mean())
    assert math.sqrt(tilt.joint.mean()) < 0.05


@pytest.mark.long
def test_a_stuck_accelerometer_does_not_lead_either_estimator_astray():
    for estimator in ('kalman', 'joint'):
        off, away = simulated_rows.after_fault('accel', 'stuck', 2.0, estimator, 2)
        assert 0.0 < off < 0.15 and away < 0.45


@pytest.fixture
def asked(monkeypatch):
    """Return the calls of `motion_rows`, whose flights are made but not flown."""
    calls = []

    def motion_rows(name, flights, others, quantities=simulated_rows.MOTION):
        calls.append((name, list(flights), others, quantities))
        return []
    monkeypatch.setattr(simulated_rows, 'motion_rows', motion_rows)
    return calls


def slopes_of(flights):
    return [flight.sim_node.simulator.optical_flow.factor_slope for flight in flights]


def of(section):
    return [case for case in simulated_rows.cases() if case.section == section]


def test_a_trajectory_is_flown_once_for_each_seed_on_the_joint_filter(asked):
    for case in of('thesis'):
        assert case.rows(range(5, 8), ['toolbox']) == []
    assert [name for name, *_ in asked] == list(simulated_rows.PATHS.values())
    for _, flights, others, quantities in asked:
        assert len(flights) == 3 and others == ['toolbox'] and quantities == 5
        assert all(flight.estimator_node.estimator == 'joint' for flight in flights)
        assert len(set(slopes_of(flights))) == 3  # drawn anew for each seed


def test_unknowns_of_a_seed_are_the_same_whenever_they_are_drawn(asked):
    case = of('thesis')[0]
    for _ in range(2):
        case.rows(range(3), [])
    assert asked[0][1] == asked[1][1]


def test_drift_is_shown_with_the_slope_that_the_case_names(asked):
    for case in of('slopes'):
        case.rows(range(2), [])
    assert [name for name, *_ in asked][:3] == [
        '(5.4), 0 1/m', '(5.4), -0.07 1/m', '(5.4), 0.14 1/m']
    for (_, flights, _, quantities), slope in zip(asked, simulated_rows.SLOPES * 4, strict=True):
        assert slopes_of(flights) == [slope] * 2
        assert quantities == 1  # the drift alone
        first, second = (flight.sim_node.simulator.optical_flow for flight in flights)
        assert first.factor_offset != second.factor_offset  # scale and latency stay unknown


def test_the_default_flight_has_no_unknowns_and_the_flow_deck_its_own_noise(asked):
    of('run')[0].rows(range(2), [])
    of('flow_deck')[0].rows(range(2), [])
    (_, default, *_), (_, deck, *_) = asked
    assert len(set(slopes_of(default))) == 1
    assert default[0].sim_node.simulator.optical_flow != deck[0].sim_node.simulator.optical_flow
    assert all(flight.estimator_node.estimator == 'joint' for flight in (*default, *deck))


def test_a_fault_has_the_largest_distances_of_each_flight(monkeypatch):
    flown = []

    def after_fault(sensor, kind, length, estimator, seed):
        flown.append((sensor, kind, length, estimator, seed))
        return (2.0, 4.0) if estimator == 'kalman' else (1.0, 3.0)
    monkeypatch.setattr(simulated_rows, 'after_fault', after_fault)
    case = next(case for case in of('faults') if case.name == 'gyro stuck')
    off, away = case.rows(range(1, 3), ['toolbox'])
    assert flown == [('gyro', 'stuck', simulated_rows.GYRO_FAULT_LENGTH, estimator, seed)
                     for estimator in ('kalman', 'joint') for seed in (1, 2)]
    assert (off.quantity, away.quantity) == simulated_rows.OFF
    assert off.kalman.tolist() == [4.0, 4.0] and off.joint.tolist() == [1.0, 1.0]
    assert away.kalman.tolist() == [16.0, 16.0] and away.joint.tolist() == [9.0, 9.0]
    assert math.isnan(off.bound) and math.isnan(off.others['toolbox'])  # others do not fly


def test_only_what_comes_after_the_begin_of_a_fault_counts(monkeypatch):
    on = round(simulated_rows.FAULT_BEGIN / simulated_rows.DT)
    truth = np.zeros((on + 100, 10))
    estimate, reference = truth.copy(), truth.copy()
    estimate[on - 1, 0] = reference[on - 1, 0] = 9.0
    estimate[on, :3] = (0.0, 0.3, 0.4)
    reference[on + 99, 2] = -2.0
    asked = []

    def fly(flight):
        asked.append(flight)
        return SimpleNamespace(truth=truth, estimate=estimate, reference=reference)
    monkeypatch.setattr(simulated_rows.closed_loop, 'fly', fly)
    assert simulated_rows.after_fault('sonar', 'missing', 2.0, 'kalman', 7) == (0.5, 2.0)
    fault = asked[0].sim_node.simulator.faults.sonar
    assert (fault.kind, fault.start, fault.duration) == ('missing', 14.0, 2.0)
    assert asked[0].estimator_node.estimator == 'kalman'
