"""The node describes every drone, and does so for viewers that come late."""

import time

from mambo_description.description_node import DescriptionNode
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_ros import messages, topics, transforms
from mambo_ros.endpoints import qos
from mambo_ros.loop import Loop
import pytest
import rclpy
from rclpy.parameter import Parameter

AT = State((1.0, -2.0, -1.5), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
BOTH = ('/mambo1', '/mambo2')


def described(**given):
    return DescriptionNode(parameter_overrides=[
        Parameter(name, value=value) for name, value in given.items()])


class Viewer:
    """What a viewer gets: messages by full name of the topic."""

    def __init__(self, *names):
        self.node, self.got = rclpy.create_node('viewer'), {}
        for topic, space in names:
            name = topics.full_name(topic, space) if space else topic.name
            self.node.create_subscription(
                topic.msg_type, name,
                lambda message, name=name: self.got.setdefault(name, []).append(message),
                qos(topic, 100))

    def wait(self, done, step=lambda: None, seconds=30.0):
        end = time.monotonic() + seconds
        while not done(self.got) and time.monotonic() < end:
            step()
            rclpy.spin_once(self.node, timeout_sec=0.02)
        assert done(self.got), list(self.got)


def frames(message):
    return {(one.header.frame_id, one.child_frame_id) for one in message.transforms}


def test_a_late_viewer_gets_model_and_static_frames(ros):
    node = described()
    viewer = Viewer((topics.TF_STATIC, '/mambo'), (topics.ROBOT_DESCRIPTION, '/mambo'))
    viewer.wait(lambda got: len(got) == 2)
    [static], [model] = viewer.got['/tf_static'], viewer.got['/mambo/robot_description']
    assert ('base_link', 'sonar_link') in frames(static) and len(static.transforms) == 13
    assert '<link name="base_link">' in model.data
    assert not node.inputs and len(node.outputs) == 2  # the rest is on request


def test_drones_of_one_hall_have_one_tree(ros):
    node = described(drones=','.join(BOTH), prefixed=True, places='0 0 0; 0 1 0')
    loop, talker = Loop(node), rclpy.create_node('talker')
    speak = [talker.create_publisher(topics.TF.msg_type, f'{space}/tf', 10) for space in BOTH]
    viewer = Viewer((topics.TF_STATIC, ''), (topics.TF, ''), (topics.ROBOT_DESCRIPTION, '/mambo2'))

    def step():
        for publisher in speak:
            publisher.publish(transforms.encode(20_000_000, AT, None, True))
            publisher.publish(b'garbage')
        loop.once(0.02)
    viewer.wait(lambda got: len(got) == 3 and len(got['/tf']) > 3, step)
    known = frames(viewer.got['/tf_static'][0]).union(*map(frames, viewer.got['/tf']))
    parents = {child: parent for parent, child in known}
    assert len(parents) == len(known)  # no frame has two parents
    for space in BOTH:
        way = [f'{space[1:]}/sonar_link']
        while way[-1] in parents:
            way.append(parents[way[-1]])
        assert way[1:] == [f'{space[1:]}/{name}' for name in ('base_link', 'odom', 'map')] + [
            'hall']
    assert '<link name="mambo2/base_link">' in viewer.got['/mambo2/robot_description'][0].data
    loop.close()


def test_paths_markers_and_beam_come_on_request(ros):
    node = described(paths=True, markers=True)
    loop, talker = Loop(node), rclpy.create_node('talker', namespace='/mambo')
    shown = (topics.TRUE_PATH, topics.MARKERS, topics.BEAM)
    viewer = Viewer(*((topic, '/mambo') for topic in shown))
    truth = talker.create_publisher(topics.GROUND_TRUTH.msg_type, topics.GROUND_TRUTH.name, 10)
    sonar = talker.create_publisher(topics.SONAR.msg_type, topics.SONAR.name, 10)
    t = 0

    def step():
        nonlocal t
        t += 50_000_000
        truth.publish(b'\0\1\0\0')
        truth.publish(messages.ground_truth(t, AT._replace(rho=(1e-9 * t, -2.0, -1.5))))
        sonar.publish(messages.sonar(t, 1.25, 0.4, 4.0, 0.7))
        sonar.publish(b'\0\1\0\0')
        for _ in range(4):
            loop.once(0.01)
        node.frame(time.monotonic())
    viewer.wait(lambda got: len(got) == 3 and len(got['/mambo/path/true']) > 2, step)
    path, beam = viewer.got['/mambo/path/true'][-1], viewer.got['/mambo/sonar/beam'][0]
    assert path.header.frame_id == 'map' and len(path.poses) > 2
    assert path.poses[0].pose.position.y == 2.0 and path.poses[0].pose.position.z == 1.5
    assert (beam.header.frame_id, beam.range) == ('sonar_link', 1.25)
    assert viewer.got['/mambo/markers'][0].markers[0].text == 'mambo'
    loop.close()


@pytest.mark.parametrize('given, line', [
    ({'drones': 'mambo'}, 'must be namespaces such as'), ({'drones': ' , '}, 'must be namespaces'),
    ({'prefixed': True}, 'leave /mambo out of drones'),
    ({'vehicle': 'bee'}, "vehicle 'bee' is unknown"),
    ({'drones': '/a,/b', 'places': '1 2'}, 'must be 2 times x y z')])
def test_wrong_parameters_are_refused_in_one_line(ros, given, line):
    with pytest.raises(ParameterError, match=line) as refused:
        described(**given)
    assert '\n' not in str(refused.value)
