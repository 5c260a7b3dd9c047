"""Rows of simulated flights: every case there is, and short ones of each kind."""

import math

from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.filter_error import with_unknowns
from mambo_flight.scenario import override
from mambo_sim.faults import KINDS, READINGS
from mambo_thesis.estimators import simulated_rows
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


def test_a_stuck_accelerometer_does_not_lead_either_estimator_astray():
    for estimator in ('kalman', 'joint'):
        off, away = simulated_rows.after_fault('accel', 'stuck', 2.0, estimator, 2)
        assert 0.0 < off < 0.15 and away < 0.45
