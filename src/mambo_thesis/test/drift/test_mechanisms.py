"""The equation of all mechanisms, against the simulated sensor and wrong estimators."""

import math

from hypothesis import given, settings, strategies as st
from mambo_thesis.drift import table
from mambo_thesis.drift.flight import flow_of
from mambo_thesis.drift.mechanisms import (
    dead_reckoned, factor, flow, level_part, MECHANISMS, PARAMETERS, rate_share)
from mambo_thesis.drift.paths import DRAG_RATE, one_turn, Track
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

@pytest.mark.parametrize(('values', 'sensor'), [
    ({'slope': 0.07 / 1.025, 'scale': 1.025}, {}),
    ({'gain': 0.011 / 1.0, 'scale': 0.95 + 0.011 * math.exp(1.5)},
     {'factor_law': 'exponential', 'factor_offset': 0.95, 'factor_slope': 0.011}),
    ({'height_offset': 0.14}, {**table.EXACT, 'height_offset': 0.14}),
    ({'leakage': -1.0}, {**table.EXACT, 'leakage': -1.0}),
    ({'coupling_x': 0.05, 'coupling_y': -0.03},
     {**table.EXACT, 'vertical_coupling': (0.05, -0.03)}),
    ({'cubic': 0.1}, {**table.EXACT, 'nonlinearity': 0.1})])
def test_the_equation_is_that_of_the_simulated_sensor(values, sensor):
    if 'gain' in values:
        values = {**values, 'gain': 0.011 / values['scale']}
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE, steps=50)
    np.testing.assert_allclose(flow(turn, turn.height, values),
                               table.sensed(turn, sensor, turn), atol=1e-12)  # rounding


def test_flow_and_the_velocity_of_5_2_are_inverse():
    turn = one_turn('swapped', drag_rate=DRAG_RATE)
    seen = np.random.default_rng(0).normal(size=(len(turn.t), 2))
    exact = flow(turn, turn.height, {})
    np.testing.assert_allclose(dead_reckoned(turn, exact), turn.velocity[:, :2], atol=1e-12)
    level = turn._replace(R=np.tile(np.eye(3), (len(turn.t), 1, 1)))
    np.testing.assert_allclose(flow_of(level, dead_reckoned(level, seen)), seen, atol=1e-12)


@pytest.mark.parametrize(('path', 'tolerance'), [
    ('C.4', 1e-9),
    ('(5.4)', 6e-3)])  # roll turns the heading of a body that pitches: 0.1^2 of 0.6 rad/s
def test_the_equation_of_c2_is_that_of_a_velocity_that_is_not_turned(path, tolerance):
    turn = one_turn(path, drag_rate=DRAG_RATE)
    unturned = flow_of(turn, table.without_rotation(turn, flow(turn, turn.height, {})))
    np.testing.assert_allclose(flow(turn, turn.height, {'frame': 1.0}), unturned, rtol=0.0,
                               atol=tolerance)


@pytest.mark.parametrize(('name', 'values'), [
    ('C1', {'tilt_ignored': 1.0}), ('G', {'coriolis': 1.0})])
def test_the_equation_has_the_errors_of_an_estimator(name, values):
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE)
    wrong = table.ROWS[name].estimator(turn, flow(turn, turn.height, {}))
    np.testing.assert_allclose(flow(turn, turn.height, values), flow_of(turn, wrong),
                               atol=1e-3)  # tilt squared (0.02) times the error (0.05 rad/s)


def test_the_factor_is_1_at_the_reference_height():
    turn = one_turn('(5.4)')
    level = turn._replace(position=turn.position * [1.0, 1.0, 0.0] - [0.0, 0.0, 1.5])
    for values in ({'slope': 0.1}, {'gain': 0.01}):
        np.testing.assert_allclose(flow(level, level.height, values),
                                   flow(level, level.height, {}), rtol=1e-12)


def test_c2_does_not_depend_on_the_heading():
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE)
    yaw = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    turned = turn._replace(position=turn.position @ yaw.T, velocity=turn.velocity @ yaw.T,
                           R=yaw @ turn.R)
    np.testing.assert_allclose(flow(turned, turn.height, {'frame': 1.0}),
                               flow(turn, turn.height, {'frame': 1.0}), atol=1e-12)


def test_the_flow_without_errors_is_velocity_over_depth():
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE, steps=50)
    np.testing.assert_allclose(flow(turn, turn.height, {}), turn.nu[:, :2] / turn.depth[:, None])


@pytest.mark.parametrize(('values', 'change'), [
    ({'scale': 1.25}, lambda turn, exact: exact / 1.25),
    ({'height_offset': 0.3}, lambda turn, exact: exact * ((turn.height + 0.3) / turn.height)[
        :, None]),
    ({'leakage': 1.0}, lambda turn, exact: exact + np.column_stack(
        [turn.omega[:, 1], -turn.omega[:, 0]])),
    ({'coupling_x': 0.1}, lambda turn, exact: exact - np.column_stack(
        [0.1 * turn.nu[:, 2] / turn.depth, np.zeros(len(turn.t))])),
    ({'coupling_y': 0.1}, lambda turn, exact: exact - np.column_stack(
        [np.zeros(len(turn.t)), 0.1 * turn.nu[:, 2] / turn.depth])),
    ({'cubic': 0.2}, lambda turn, exact: exact * (1.0 + 0.2 * exact**2)),
    ({'slope': 0.07}, lambda turn, exact: exact / (1.0 + 0.07 * (turn.height - 1.5))[:, None]),
    ({'tilt_ignored': 1.0}, lambda turn, exact: exact * turn.R[:, 2, 2][:, None]),
    ({'coriolis': 0.5}, lambda turn, exact: exact + 0.5 * np.cross(turn.omega, turn.nu)[
        :, :2] / turn.depth[:, None])])
def test_each_parameter_is_one_term(values, change):
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE, steps=50)
    exact = turn.nu[:, :2] / turn.depth[:, None]
    np.testing.assert_allclose(flow(turn, turn.height, values), change(turn, exact), atol=1e-12)


def test_a_height_that_lags_is_the_height_handed_over():
    turn = one_turn('(5.4)', steps=50)
    np.testing.assert_allclose(
        flow(turn, turn.height + 0.2, {}),
        flow(turn, turn.height, {}) * ((turn.height + 0.2) / turn.height)[:, None])


def test_every_parameter_belongs_to_one_mechanism_but_scale_and_delay():
    named = [name for m in MECHANISMS.values() for name in m.parameters]
    assert len(named) == len(set(named))
    assert set(PARAMETERS) - set(named) == {'scale', 'delay'}
    assert all(letter == m.letter and m.description for letter, m in MECHANISMS.items())
    assert all(p.width > 0.0 for p in PARAMETERS.values())


LEVEL_PARAMETERS = [name for name in PARAMETERS if name not in ('delay', 'height_lag')]


@given(name=st.sampled_from(LEVEL_PARAMETERS), value=st.floats(-0.1, 0.1))
@settings(deadline=None)
def test_without_its_parameter_a_mechanism_is_not_there(name, value):
    """The flow is exact with every parameter 0, and differs from it otherwise."""
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE, steps=20)
    exact = flow(turn, turn.height, {})
    neutral = 1.0 if name == 'scale' else 0.0
    np.testing.assert_array_equal(flow(turn, turn.height, {name: neutral}), exact)
    if abs(value) > 1e-3:
        changed = flow(turn, turn.height, {name: neutral + value})
        assert np.abs(changed - exact).max() > 1e-7


@given(scale=st.floats(0.5, 2.0), slope=st.floats(-0.2, 0.2), gain=st.floats(-0.02, 0.02))
def test_the_factor_scales_and_equals_the_scale_at_the_reference_height(scale, slope, gain):
    heights = np.array([0.5, 1.5, 2.5])
    found = factor(heights, scale, slope, gain)
    assert found[1] == pytest.approx(scale)
    np.testing.assert_allclose(found, scale * factor(heights, 1.0, slope, gain))
    assert (found[2] - found[1]) / scale == pytest.approx(
        slope + gain * (math.exp(2.5) - math.exp(1.5)), abs=1e-12)


@pytest.mark.parametrize('yaw', [0.0, 0.5, -2.0])
def test_the_level_part_is_the_vertical_speed_times_the_tilt(yaw):
    """A climb of 1 m/s along b3 with a pitch of 0.1 rad: to first order -0.1 m/s along b1."""
    R = Rotation.from_euler('ZYX', [yaw, 0.1, 0.0]).as_matrix()
    nu = np.array([0.0, 0.0, -1.0])
    track = Track(np.zeros(1), np.array([[0.0, 0.0, -1.5]]), (R @ nu)[None], R[None],
                  np.zeros((1, 3)))
    np.testing.assert_allclose(level_part(track), [[-0.1, 0.0]], atol=2e-3)


def test_a_level_vehicle_has_no_level_part():
    turn = one_turn('hand loop', steps=30)
    np.testing.assert_allclose(level_part(turn), 0.0, atol=1e-12)


@pytest.mark.parametrize('values', [
    {'leakage': 0.5}, {'coriolis': -0.7}, {'leakage': -1.0, 'scale': 1.06, 'slope': 0.07},
    {'leakage': 1.0, 'gain': 0.011}, {'slope': 0.07}])
def test_the_share_of_the_rate_is_how_the_flow_changes_with_it(values):
    turn = one_turn('(5.4)', drag_rate=DRAG_RATE, steps=50)
    share = rate_share(turn, values)
    for axis, (column, sign) in enumerate(((1, -1.0), (0, 1.0))):
        more = turn._replace(omega=turn.omega + 1e-3 * np.eye(3)[axis])
        change = (flow(more, more.height, values) - flow(turn, turn.height, values)) / 1e-3
        np.testing.assert_allclose(change[:, column], sign * share[:, column], atol=1e-9)
