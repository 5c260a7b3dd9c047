"""Fixed frames: where the axes point and where the parts are."""

import math

from mambo_description.static_frames import Frame, rotor_places, static_frames
from mambo_model.frames import body_quaternion, flip_vector
from mambo_model.motion.quaternion import rotate
from mambo_model.values import values
from mambo_model.vehicle.motor_mixer import mix
from mambo_model.vehicle.parameters import preset, VehicleValues
import pytest

VEHICLE = preset('identified')
MARKERS = [(0.048, -0.042, -0.020), (0.058, 0.054, -0.020)]
FRAMES = {frame.name: frame for frame in static_frames(VEHICLE, MARKERS)}


def turned(frame, v):
    """Return a vector of a frame in its parent, both z up."""
    x, y, z, w = frame.quaternion
    # a rotation is the same whatever the axes are called
    return rotate((w, x, y, z), v)


def in_base(name, v):
    frame = FRAMES[name]
    v = turned(frame, v)
    return v if frame.parent == 'base_link' else in_base(frame.parent, v)


@pytest.mark.parametrize('name, axis, seen', [
    ('sonar_link', (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),  # the beam of sensor_msgs/Range
    ('camera_link', (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    ('camera_optical_frame', (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)),  # the view
    ('camera_optical_frame', (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)),  # top of the picture: forward
    ('imu_link', (1.0, 0.0, 0.0), (1.0, 0.0, 0.0))])
def test_axes_point_where_rep_103_has_them(name, axis, seen):
    assert in_base(name, axis) == pytest.approx(seen, abs=1e-12)


@pytest.mark.parametrize('rpy', [(0.3, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.5),
                                 (0.3, -0.7, 1.9)])
def test_angles_turn_about_fixed_axes_in_their_order(rpy):
    v = (0.2, -0.5, 0.9)
    expected = v
    for angle, axis in zip(rpy, range(3)):
        half = [0.0, 0.0, 0.0]
        half[axis] = math.sin(angle / 2)
        expected = rotate((math.cos(angle / 2), *half), expected)
    assert turned(Frame('a', 'b', (0.0,) * 3, rpy), v) == pytest.approx(expected, abs=1e-12)


def test_rotors_stand_where_their_torques_say():
    vv = values(VEHICLE, VehicleValues)
    for number, place in enumerate(rotor_places(VEHICLE)):
        thrust = tuple(float(number == one) for one in range(4))
        _, (roll, pitch, _) = mix(thrust, vv)
        x, y, _ = flip_vector(place)  # forward, right
        assert (x, y) == pytest.approx((pitch, -roll))
        assert FRAMES[f'rotor_{number + 1}'].position == place


def test_markers_are_left_and_up_where_the_vehicle_has_them_right_and_down():
    assert FRAMES['marker_2'].position == (0.058, -0.054, 0.020)


def test_parents_come_before_their_children():
    known = {'base_link'}
    for frame in static_frames(VEHICLE, MARKERS):
        assert frame.parent in known
        known.add(frame.name)
    assert len(known) == 1 + 4 + 4 + len(MARKERS)


def test_a_quaternion_here_is_one_of_the_wire():
    x, y, z, w = FRAMES['sonar_link'].quaternion
    assert rotate(body_quaternion(x, y, z, w), (1.0, 0.0, 0.0)) == pytest.approx(
        (0.0, 0.0, 1.0))  # NED: down
