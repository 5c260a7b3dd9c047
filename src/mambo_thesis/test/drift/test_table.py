"""The table of mechanisms: drift in one turn, against the audit, an integral and theory."""

import math

from mambo_thesis.drift import table
from mambo_thesis.drift.mechanisms import flow
from mambo_thesis.drift.paths import DRAG_RATE, LEVEL, one_turn, PATHS
import numpy as np
import pytest
from scipy.integrate import quad

@pytest.mark.parametrize('name', table.ROWS)
def test_drift_per_period_is_that_of_the_audit(name):
    expected = np.array(table.ROWS[name].audit)
    found = np.array([table.drift(table.ROWS[name], path) for path in PATHS])
    given = np.isfinite(expected)
    digits = 0.005 if name == 'G' else 0.0015  # printed with two digits, with three
    np.testing.assert_allclose(found[given], expected[given], atol=digits)


def test_drift_of_a_small_loop_is_pi_A_B_slope_over_Q_at_any_speed():
    Q, slope, size = 0.92 + 0.07 * 1.5, 0.07, 0.3
    exact = quad(lambda a: (Q / (0.92 + 0.07 * (1.5 + size * math.sin(a))) - 1)
                 * -size * math.sin(a), 0, 2 * math.pi)[0]
    assert exact == pytest.approx(math.pi * size**2 * slope / Q, rel=1e-3)
    row = table.Row('', (), {}, Q)
    for speed in (0.5, 1.0, 2.0):
        assert table.drift(row, LEVEL, speed, size)[0] == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize('name', ['C2', 'D2'])
def test_drift_of_tilt_and_rotation_is_pi_A_B_speed_squared_over_g(name):
    for speed in (0.5, 1.0):
        found = table.drift(table.ROWS[name], 'C.4', speed, 0.2)[0]
        assert found == pytest.approx(math.pi * 0.2**2 * speed**2 / 9.81, rel=0.02)  # first order


@pytest.mark.parametrize('path', list(PATHS))
def test_a_perfect_sensor_and_estimator_do_not_drift(path):
    exact = table.Row('', (), table.EXACT)
    np.testing.assert_allclose(table.drift(exact, path), 0.0, atol=1e-9)


def test_a_scale_that_is_wrong_alone_drifts_by_tilt_and_not_along_a_level_path():
    """A constant factor on a closed level path comes back to where it was."""
    scaled = table.Row('', (), table.EXACT, scale=1.1)
    np.testing.assert_allclose(table.drift(scaled, LEVEL), 0.0, atol=1e-9)
    assert abs(table.drift(scaled, 'C.4')[0]) > 0.01


def test_estimators_without_a_term_differ_by_that_term():
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE, steps=40)
    seen = flow(turn, turn.height, {})
    np.testing.assert_allclose(table.exact_velocity(turn, seen), turn.velocity[:, :2], atol=1e-12)
    # C2: the body velocity itself; C1: its horizontal part shrinks by the cosine of the tilt
    np.testing.assert_allclose(table.without_rotation(turn, seen), turn.nu[:, :2], atol=1e-12)
    cosine = turn.R[:, 2, 2]
    body = np.column_stack([turn.nu[:, :2] * cosine[:, None], turn.nu[:, 2]])
    np.testing.assert_allclose(table.without_tilt(turn, seen),
                               np.einsum('nij,nj->ni', turn.R, body)[:, :2], atol=1e-12)
    body = turn.nu + np.cross(turn.omega, turn.nu) * [1, 1, 0]
    np.testing.assert_allclose(table.without_coriolis(turn, seen),
                               np.einsum('nij,nj->ni', turn.R, body)[:, :2], atol=1e-12)


def test_a_sensor_that_lags_uses_the_height_of_before():
    turn = one_turn('(5.3)', steps=20)
    higher = turn._replace(position=turn.position - [0.0, 0.0, 0.3])
    ratio = table.sensed(turn, table.EXACT, higher) / table.sensed(turn, table.EXACT, turn)
    np.testing.assert_allclose(ratio[np.isfinite(ratio)], 1.8 / 1.5, rtol=1e-9)


def test_the_table_has_a_drift_in_x_and_y_for_every_row_and_path(monkeypatch):
    monkeypatch.setattr(
        table, 'drift', lambda row, path: np.array([len(row.description), len(path)]))
    found = table.table()
    assert list(found) == list(table.ROWS)
    assert all(drifts.shape == (len(PATHS), 2) for drifts in found.values())
    assert found['E'][0].tolist() == [len(table.ROWS['E'].description), len('(5.3)')]
