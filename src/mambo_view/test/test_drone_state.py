"""What the page shows: angles, distances, histories."""

import math

from hypothesis import given, strategies as st
from mambo_view.drone_state import (
    DroneState, ESTIMATE, History, Pose, REFERENCE, ROLES, SIGNALS, TRUTH)
import numpy as np
import pytest

LEVEL = (1.0, 0.0, 0.0, 0.0)


def flown(t, x=0.0, attitude=LEVEL):
    return DroneState(t, {TRUTH: Pose((x, 2.0 * x, 1.5), attitude)}, (1.0, 2.0, 3.0, 4.0))


@given(st.floats(-math.pi, math.pi), st.floats(0.0, math.pi), st.floats(-3.0, 3.0))
def test_tilt_is_the_angle_of_the_rotation_about_any_horizontal_axis(heading, angle, yaw):
    s = math.sin(angle / 2)
    w, x, y = math.cos(angle / 2), s * math.cos(heading), s * math.sin(heading)
    a, b = math.cos(yaw / 2), math.sin(yaw / 2)  # then a yaw in the body, which is no tilt
    q = (w * a, x * a + y * b, y * a - x * b, w * b)
    assert flown(0.0, attitude=q).tilt(TRUTH) == pytest.approx(math.degrees(angle), abs=1e-5)


def test_what_is_not_known_is_nan():
    state = DroneState()
    assert math.isnan(state.tilt(TRUTH)) and math.isnan(state.distance(TRUTH, ESTIMATE))
    assert all(math.isnan(curve.value(state)) for curves in SIGNALS.values() for curve in curves)


def test_distances_are_between_the_roles_of_their_curves():
    state = flown(0.0, 1.0)
    state.poses[ESTIMATE] = Pose((1.0, 2.0, 1.8), LEVEL)
    state.poses[REFERENCE] = Pose((4.0, 6.0, 1.5), LEVEL)
    estimate, tracking = (curve.value(state) for curve in SIGNALS['errors, m'])
    assert estimate == pytest.approx(0.3) and tracking == 5.0


def test_columns_are_those_of_the_plot_and_keep_the_newest():
    history = History(3)
    for i in range(5):
        history.add(flown(float(i), 0.1 * i))
    for name, curves in SIGNALS.items():
        t, *values = history.columns(name)
        assert t.tolist() == [2.0, 3.0, 4.0] and len(values) == len(curves)
    np.testing.assert_allclose(history.columns('y, m')[1], [0.4, 0.6, 0.8])
    assert history.columns('motors, PWM')[3].tolist() == [3.0] * 3
    path = history.segments(TRUTH)
    assert path.shape == (2, 2, 3)
    np.testing.assert_array_equal(path[0, 1], path[1, 0])
    assert not len(history.segments(ESTIMATE))


def test_a_time_that_goes_back_begins_anew_and_one_that_stays_adds_nothing():
    history = History(9)
    for t in (1.0, 2.0, 2.0):
        history.add(flown(t, t))
    assert len(history.columns('x, m')[0]) == 2 and history.version == 2
    history.add(flown(0.5))
    assert history.columns('x, m')[0].tolist() == [0.5]
    assert not len(history.segments(TRUTH))


def test_every_role_has_a_label_and_every_plot_a_unit():
    assert set(ROLES) == {'truth', 'estimate', 'optitrack', 'reference'}
    assert all(', ' in name for name in SIGNALS)
