"""Errors of other estimators: what is compared with what."""

from types import SimpleNamespace

from mambo_flight.accuracy import beside
from mambo_flight.accuracy.error_statistics import (
    Measured, MOTION, QUANTITIES, Row, summary, table_beside)
from mambo_flight.scenario import override, Scenario
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

FLIGHT, START, SETTLED = Scenario(), 4, 2000
N = SETTLED + 12
JOINT = Measured(tuple(Row(1.0, 4.0, 2.0, n) for n in (2, 1, 2, 1, 2, 3, 3, 1, 1)), (1.0,) * 3)


def compared(state, stride, monkeypatch, truth):
    """Return what is measured of some states, where the bound is one everywhere."""
    monkeypatch.setattr(beside, '_states', lambda *_: (state, stride))
    return beside.measured_beside(FLIGHT, SimpleNamespace(truth=truth), START, JOINT, 'kalman')


def true_flight():
    """Return true states at random attitudes."""
    rng = np.random.default_rng(2)
    q = Rotation.random(N, rng).as_quat()[:, [3, 0, 1, 2]]
    return np.hstack([rng.normal(size=(N, 6)), q, np.zeros((N, 3))])


@pytest.mark.parametrize('stride', [1, 2])
def test_every_state_is_compared_with_the_truth_of_its_step(stride, monkeypatch):
    truth, off = true_flight(), np.zeros(13)
    off[:6] = 1.0, -2.0, 3.0, 0.1, -0.2, 0.3
    state = truth[::stride] - off
    state[:(START + SETTLED) // stride, 2:6] += 7.0  # not settled: only the end and what follows
    found = compared(state, stride, monkeypatch, truth)
    # the mean of both axes; and no tilt
    assert [row.reached for row in found.rows] == pytest.approx([2.5, 9.0, 0.025, 0.09, 0.0])
    assert [(row.bound, row.components) for row in found.rows] == [
        (1.0, n) for n in (2, 1, 2, 1, 2)]


def test_a_drift_is_that_of_the_last_state(monkeypatch):
    truth = true_flight()
    state = truth.copy()
    state[:-1, :2] += 5.0
    assert compared(state, 1, monkeypatch, truth).rows[0].reached == 0.0


def test_a_tilt_counts_and_a_yaw_does_not(monkeypatch):
    truth = true_flight()
    truth[:, 6:10] = 1.0, 0.0, 0.0, 0.0
    state = truth.copy()
    turn = Rotation.from_euler('ZYX', [80.0, 0.0, 2.0], degrees=True)
    state[:, 6:10] = turn.as_quat()[[3, 0, 1, 2]]
    tilt = compared(state, 1, monkeypatch, truth).rows[4].reached
    assert np.degrees(np.sqrt(2.0 * tilt)) == pytest.approx(2.0, rel=1e-3)


def test_its_table_has_motion_and_no_consistency(monkeypatch):
    truth = true_flight()
    report = summary([compared(truth + 0.5, 1, monkeypatch, truth)] * 3)
    assert [line.name for line in report.lines] == [q.name for q in QUANTITIES[:MOTION]]
    assert report.lines[0].reached == pytest.approx(0.5) and report.lines[0].ratio == 0.5
    text = table_beside(report, 'kalman')
    assert text.splitlines()[0] == 'kalman on the same samples' and 'nan' not in text


def test_the_firmware_is_told_the_true_noise_and_drag_only_if_asked_for():
    made = override(FLIGHT, {
        'sim_node.simulator.optical_flow.noise': 0.0251,
        'sim_node.simulator.optical_flow.rate': 60.0,
        'sim_node.simulator.sonar.noise': 0.01, 'sim_node.simulator.sonar.resolution': 0.0,
        'sim_node.simulator.vehicle.drag_reading': 'acceleration',
        'sim_node.simulator.vehicle.drag_coefficient': 0.32})
    found = beside.told(made, True)
    assert found == pytest.approx((0.0251, 60.0, 0.01, 0.32))
    assert beside.told(made, False).drag == 0.0
