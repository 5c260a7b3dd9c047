"""Lines of sight: a body hides what is behind it, and nothing else."""

import math

from mambo_sim.sensors.line_of_sight import count_cameras, is_hidden
import numpy as np
import pytest

RADIUS, HALF = 0.09, 0.02
LEVEL = (1.0, 0.0, 0.0, 0.0)
ON_EDGE = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # rolled by a quarter turn
CAMERA = (-5.0, 0.0, -1.0)


def hidden(marker, centre, q=LEVEL, camera=CAMERA):
    return is_hidden(camera, marker, centre, q, RADIUS, HALF)


def test_a_body_hides_what_is_behind_it():
    marker = (1.0, 0.0, -1.0)
    assert hidden(marker, (0.0, 0.0, -1.0))
    assert not hidden(marker, (2.0, 0.0, -1.0))  # behind the marker
    assert not hidden(marker, (-6.0, 0.0, -1.0))  # behind the camera


@pytest.mark.parametrize('q, across, up', [(LEVEL, RADIUS, HALF), (ON_EDGE, HALF, RADIUS)])
def test_a_body_hides_as_far_as_it_reaches_as_it_is_turned(q, across, up):
    marker = (5.0, 0.0, -1.0)
    for share, expected in ((0.999, True), (1.001, False)):
        assert hidden(marker, (0.0, share * across, -1.0), q) == expected
        assert hidden(marker, (0.0, 0.0, -1.0 + share * up), q) == expected


def test_a_marker_inside_a_body_is_hidden_from_all_sides():
    for camera in ((-5.0, 0.0, -1.0), (5.0, 1.0, -1.0), (0.0, 0.0, -3.0)):
        assert hidden((0.0, 0.0, -1.01), (0.0, 0.0, -1.0), camera=camera)


def test_a_camera_at_the_marker_sees_it():
    assert not hidden(CAMERA, (0.0, 0.0, -1.0))


def test_cameras_are_counted_past_all_others_but_not_oneself():
    cameras = np.array([[-5.0, 0.0, -1.0], [5.0, 0.0, -1.0], [0.0, 5.0, -1.0]])
    bodies = np.zeros((3, 7))
    bodies[:, 3] = 1.0
    bodies[:, :3] = [[0.0, 0.0, -1.0], [-1.0, 0.0, -1.0], [1.0, 0.0, -1.0]]

    def count(*here):
        return count_cameras((0.0, 0.0, -1.0), 0, cameras, bodies, np.array(here), RADIUS, HALF)

    assert count(True, False, False) == 3
    assert count(True, True, False) == 2
    assert count(True, True, True) == 1
