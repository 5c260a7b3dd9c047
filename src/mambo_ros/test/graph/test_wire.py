"""What nodes change in their messages on request: dates, frames, hardware ids."""

import calendar

from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_ros import cdr, diagnostics, messages, node, topics, transforms
from mambo_ros.graph.wire import WireParams
from mambo_ros.loop import Loop
import pytest
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message

AT = State((1.0, -2.0, -1.5), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
DATE, OFFSET = '2026-05-01T12:00:00Z', calendar.timegm((2026, 5, 1, 12, 0, 0)) * 10**9
T = 1_230_000_000
SAMPLES = {
    topics.CLOCK: messages.clock(T), topics.GROUND_TRUTH: messages.ground_truth(T, AT),
    topics.IMU: messages.imu(T, *((0.1, 0.2, 0.3),) * 4),
    topics.SONAR: messages.sonar(T, 1.25, 0.4, 4.0, 0.7),
    topics.OPTICAL_FLOW: messages.optical_flow(T, (0.1, 0.2), 200),
    topics.MOTOR_PWM: messages.motor_pwm(T, (1.0, 2.0, 3.0, 4.0), False, 0),
    topics.OPTITRACK: messages.optitrack(T, AT.rho, AT.q)}


def changed(wire, topic, data=None):
    """Return a message as it is published, twice: the first and a later one are alike."""
    change = wire.outgoing(topic, '/mambo1', topics.full_name(topic, '/mambo1'))
    first, again = (change(SAMPLES[topic] if data is None else data) for _ in range(2))
    assert first == again
    return deserialize_message(first, topic.msg_type)


def test_without_parameters_nothing_is_changed():
    assert all(WireParams().outgoing(topic, space, topics.full_name(topic, space)) is None
               for topic in topics.RECORDABLE for space in ('/mambo', '/mambo1', '/'))
    assert WireParams().incoming(messages.decode_pose) is messages.decode_pose


@pytest.mark.parametrize('topic', SAMPLES, ids=lambda topic: topic.name)
def test_a_date_moves_the_stamp_alone_and_is_taken_out_again(topic):
    wire = WireParams(start_date=DATE)
    data = wire.outgoing(topic, '/mambo', topic.name)(SAMPLES[topic])
    assert cdr.stamp_ns(data) == OFFSET + T
    assert cdr.restamped(data, T) == SAMPLES[topic]
    if topic is topics.OPTITRACK:
        assert wire.incoming(messages.decode_pose)(data) == messages.decode_pose(SAMPLES[topic])


def test_every_stamp_of_transforms_and_diagnostics_moves():
    wire = WireParams(start_date=DATE)
    moved = changed(wire, topics.TF, transforms.encode(T, AT, None, True))
    for one in moved.transforms:
        assert one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == OFFSET + T
    report = diagnostics.report(T, 'sim_node', diagnostics.OK, 'flying', {'steps': 3})
    moved = changed(wire, topics.DIAGNOSTICS, report)
    assert moved.header.stamp.sec == (OFFSET + T) // 10**9
    assert (moved.status[0].name, moved.status[0].hardware_id) == ('sim_node', '')


def test_messages_that_come_in_may_name_a_frame_with_or_without_the_prefix_or_not_at_all():
    assert WireParams().frames('odom') == ('odom', '')
    assert WireParams(frame_prefix='m1/').frames('odom', 'map') == (
        'm1/odom', 'm1/map', 'odom', 'map', '')


def test_frames_get_their_prefix_and_sensors_their_own():
    wire = WireParams(frame_prefix='mambo1/', sensor_frames=True)
    truth = changed(wire, topics.GROUND_TRUTH)
    assert (truth.header.frame_id, truth.child_frame_id) == ('mambo1/map', 'mambo1/base_link')
    assert truth.pose.pose.position.y == 2.0
    assert changed(wire, topics.IMU).header.frame_id == 'mambo1/imu_link'
    sonar = changed(wire, topics.SONAR)
    assert (sonar.header.frame_id, sonar.range) == ('mambo1/sonar_link', 1.25)
    assert changed(wire, topics.OPTICAL_FLOW).header.frame_id == 'mambo1/base_link'
    assert changed(wire, topics.MOTOR_PWM).header.frame_id == ''
    tf = changed(wire, topics.TF, transforms.encode(T, AT, None, True))
    assert [(one.header.frame_id, one.child_frame_id) for one in tf.transforms] == [
        ('mambo1/odom', 'mambo1/base_link'), ('mambo1/map', 'mambo1/odom')]


def test_diagnostics_have_hardware_id_and_namespace():
    report = diagnostics.report(T, 'sim_node', diagnostics.WARN, 'slow', {})
    [status] = changed(WireParams(hardware_id='mambo1'), topics.DIAGNOSTICS, report).status
    assert (status.hardware_id, status.name, status.message) == (
        'mambo1', 'mambo1/sim_node', 'slow')


def test_another_drone_on_the_shared_diagnostics_is_named_without_being_asked_to():
    report = diagnostics.report(T, 'sim_node', diagnostics.WARN, 'slow', {'steps': 5})
    name = topics.DIAGNOSTICS.name
    beside = WireParams().outgoing(topics.DIAGNOSTICS, '/shadow', name)(report)
    [status] = deserialize_message(beside, topics.DIAGNOSTICS.msg_type).status
    assert (status.name, status.hardware_id, status.message) == ('shadow/sim_node', '', 'slow')
    assert cdr.stamp_ns(beside) == T
    for space in ('/mambo', '/'):
        assert WireParams().outgoing(topics.DIAGNOSTICS, space, name) is None
    assert WireParams().outgoing(topics.TF, '/shadow', topics.TF.name) is None


@pytest.mark.parametrize('date, line', [
    ('yesterday', "start_date = 'yesterday' is not a date such as"),
    ('1969-12-31', 'must be from 1970 to 2037'), ('2038-02-01', 'must be from 1970 to 2037')])
def test_a_wrong_date_gets_one_line(date, line):
    with pytest.raises(ParameterError, match=line):
        WireParams(start_date=date)


class Echo(node.MamboNode[type(None)]):
    """Publishes poses and takes them."""

    def __init__(self, **wire):
        super().__init__('echo', WireParams, parameter_overrides=[
            Parameter(f'wire.{name}', value=value) for name, value in wire.items()])
        self.got = []
        self.accept(topics.OPTITRACK, messages.decode_pose, lambda *pose: self.got.append(pose))
        self.publish = self.advertise(topics.OPTITRACK)


def test_a_node_publishes_dates_and_takes_flight_times(ros):
    echo = Echo(start_date=DATE, frame_prefix='a/')
    loop, sent = Loop(echo), []
    echo.outputs[-1].local.append(sent.append)
    echo.publish(SAMPLES[topics.OPTITRACK])
    loop.once(0.0)
    assert [pose[0] for pose in echo.got] == [T]
    assert cdr.stamp_ns(sent[0]) == OFFSET + T and b'a/map' in sent[0]
    assert echo.get_parameter('wire.start_date').value == DATE
    loop.close()


def test_an_unknown_parameter_is_refused(ros):
    with pytest.raises(ParameterError, match='wire.date: unknown parameter'):
        Echo(date=DATE)


@pytest.mark.parametrize(
    'prefix', ['/', '/a/', 'a b/', 'a//b', 'a\n', 'a\0/', 'é/', 'x' * 201, '"'])
def test_a_prefix_that_makes_no_name_of_a_frame_is_refused(prefix):
    with pytest.raises(ParameterError, match='^frame_prefix = .* must be letters') as error:
        WireParams(frame_prefix=prefix)
    assert len(str(error.value)) < 250 and '\n' not in str(error.value)


@pytest.mark.parametrize('name', ['a\nb', '\x1b[2J', '\0', '\u202e', 'x' * 1_000_000])
def test_a_hardware_id_that_breaks_lines_is_refused(name):
    with pytest.raises(ParameterError, match='^hardware_id = .* must be a text without') as error:
        WireParams(hardware_id=name)
    assert len(str(error.value)) < 250 and '\n' not in str(error.value)


def test_names_as_programs_have_them_pass():
    assert WireParams(frame_prefix='a1/b_2/', hardware_id='Mambo 7, ü #3').frame_prefix
