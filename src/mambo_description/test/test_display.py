"""Messages for viewers: places, transforms, paths, markers."""

import math

from mambo_description import display
from mambo_description.static_frames import rotor_places, static_frames
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import preset
from mambo_view.drone_state import DroneState, Pose, REFERENCE
import pytest
from rclpy.serialization import serialize_message

UP = (1.0, 0.0, 0.0, 0.0)
VEHICLE = preset('identified')


def test_places_are_three_numbers_a_drone():
    assert display.places('0 0 0; 1 -2 0.5', 2) == [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)]
    assert display.places('', 3) == [(0.0, 0.0, 0.0)] * 3


@pytest.mark.parametrize('text', ['0 0', '0 0 0', '0 0 0; 1 1 x', '0 0 0; 1 1 nan', ';',
                                  '0 0 0; 1e9 0 0'])
def test_other_places_are_refused_in_one_line(text):
    with pytest.raises(ParameterError, match='must be 2 times x y z in m, separated by ;'):
        display.places(text, 2)


def test_static_transforms_are_the_frames_with_their_prefix():
    frames = static_frames(VEHICLE)
    for frame, one in zip(frames, display.static_transforms(frames, 'mambo1/')):
        assert one.header.frame_id == f'mambo1/{frame.parent}'
        assert one.child_frame_id == f'mambo1/{frame.name}'
        assert (one.header.stamp.sec, one.header.stamp.nanosec) == (0, 0)
        q = one.transform.rotation
        assert (q.x, q.y, q.z, q.w) == frame.quaternion
        assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1.0)
    place = display.place_in_hall('mambo1/', (1.0, 2.0, 3.0))
    assert (place.header.frame_id, place.child_frame_id) == ('hall', 'mambo1/map')
    assert place.transform.translation.y == 2.0


def test_a_prefix_is_put_once():
    message = display.TFMessage(transforms=display.static_transforms(static_frames(VEHICLE)))
    for _ in range(2):
        message = display.prefixed(message, 'a/')
    assert {one.header.frame_id for one in message.transforms} == {'a/base_link', 'a/camera_link'}
    message.transforms *= 50
    assert len(display.prefixed(message, 'a/').transforms) == 100


def test_a_trail_grows_by_steps_forgets_its_begin_and_begins_again():
    trail = display.Trail('map', 0.1, 3)
    added = [trail.add(0.1 * k, Pose((0.06 * k, 0.0, 1.0), UP)) for k in range(9)]
    assert added == [True, False] * 4 + [True]
    path = trail.message()
    assert [pose.pose.position.x for pose in path.poses] == pytest.approx([0.24, 0.36, 0.48])
    assert path.header.frame_id == path.poses[0].header.frame_id == 'map'
    assert path.header.stamp.nanosec == 800_000_000
    assert trail.add(0.0, Pose((9.0, 0.0, 0.0), UP))  # the next flight
    assert len(trail.message().poses) == 1
    serialize_message(trail.message())


def test_markers_show_name_commands_and_reference():
    state = DroneState(2.5, {REFERENCE: Pose((1.0, 2.0, 3.0), UP)}, (0.0, 250.0, 500.0, 9e9))
    shown = display.markers('mambo1', state, rotor_places(VEHICLE), 500.0, 'mambo1/').markers
    assert shown[0].text == 'mambo1'
    lengths = [one.points[1].z - one.points[0].z for one in shown if one.ns == 'motors']
    assert lengths == pytest.approx([0.0, 0.05, 0.1, 0.1])
    assert shown[-1].header.frame_id == 'mambo1/odom' and shown[-1].pose.position.y == 2.0
    assert len({(one.ns, one.id) for one in shown}) == len(shown) == 6
    assert all(one.header.stamp.sec == 2 and one.color.a > 0.0 for one in shown)
    serialize_message(display.MarkerArray(markers=shown))


def test_markers_of_an_unknown_state_are_the_name_alone():
    state = DroneState(0.0)
    assert [one.ns for one in display.markers(
        'a', state, rotor_places(VEHICLE), 500.0).markers] == ['name']
