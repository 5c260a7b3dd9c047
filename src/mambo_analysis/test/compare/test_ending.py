"""What ends a flight before its time is a line; a hand that carries the vehicle ends nothing."""

from mambo_analysis.compare.ending import (
    ended_early, ended_in_the_air, landed_by_itself, without_poses)
from mambo_analysis.compare.events import events
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_control.failsafe import describe, REASONS, STOPPED
from mambo_control.safety import REASON_ESTIMATE, REASON_GROUNDED
from mambo_model.motion import flight_command as fc
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import LANDED, LANDING, TRACK
from mambo_ros import diagnostics, messages
from mambo_ros.commands.command_message import encode
import pytest
import yaml

SECOND = 1_000_000_000  # ns
ZERO, LEVEL = (0.0,) * 3, (1.0, 0.0, 0.0, 0.0)
HIGH = Reference((0.0, 0.0, -1.0), ZERO, ZERO, ZERO, ZERO, LEVEL, ZERO, ZERO, 1.0, ZERO)
DOWN = HIGH._replace(rho=ZERO)
LINE = 'motors shut down: estimator not aligned'
IDLE = ('the motors turned for 1.00 s while the phase of the reference was GROUND or LANDED, in '
        'which they must stand still, longest from 2.00 to 3.00 s: the controller must answer '
        'these phases with PWM 0')


def bag(path, name, level, hand=False, seconds=3, motors=False, height=None, down=False,
        commanded=False, landed=False, lost=(), first=1, line=(LINE,) * 3, reason=0):
    """
    Return a bag of so many s of a flight of 3 s, in which a node says a line each second.

    With a height in m, or one for each second, the vehicle is there, and its reference 1 m high,
    from 1 s on; the reference has landed from 2 s on, on the floor, if it does. Motor commands
    are lost at some seconds. The lines begin at the first second that is given.
    """
    heights = height if isinstance(height, tuple) else (height,) * seconds
    scenario = {'/mambo/sim_node': {'ros__parameters': {
        'duration': 3.0, 'simulator': {'hand': {'enabled': hand}}}},
        '/mambo/reference_node': {'ros__parameters': {'commands': {'enabled': commanded}}}}
    writer = BagWriter(path, attachments={'scenario.yaml': yaml.safe_dump(scenario)})
    writer.add_topic('/clock', 'rosgraph_msgs/msg/Clock')
    writer.add_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    writer.add_topic('/mambo/motor_pwm', 'mambo_interfaces/msg/MotorPwm')
    if height is not None:
        writer.add_topic('/mambo/reference', 'mambo_interfaces/msg/Reference')
        writer.add_topic('/mambo/ground_truth/odom', 'nav_msgs/msg/Odometry')
    for second in range(seconds + 1):
        t = second * SECOND
        writer.write('/clock', messages.clock(t), t)
        if second not in lost:
            writer.write('/mambo/motor_pwm', messages.motor_pwm(
                t, (200.0 if motors else 0.0,) * 4, down and second == 2, reason), t)
        if second and height is not None:
            writer.write('/mambo/reference', messages.reference(
                t, *((DOWN, LANDED) if landed and second >= 2 else (HIGH, TRACK))), t)
            writer.write('/mambo/ground_truth/odom', messages.ground_truth(
                t, State((0.0, 0.0, -heights[second - 1]), ZERO, LEVEL, ZERO)), t)
        if second >= first:
            writer.write('/diagnostics', diagnostics.report(
                t, name, level, line[second - 1], {}), t)
    writer.close()
    return read_bag(path)


@pytest.mark.parametrize('motors', [False, True])
@pytest.mark.parametrize('name', ['controller_node', 'sim_node'])
def test_the_first_error_of_controller_or_vehicle_is_a_line_in_the_air_or_not(
        tmp_path, name, motors):
    flight = bag(tmp_path / 'bag', name, diagnostics.ERROR, motors=motors)
    assert ended_early(flight) == [f'{name} at 1.000 s: {LINE}']


@pytest.mark.parametrize('name, level', [
    ('controller_node', diagnostics.WARN), ('estimator_node', diagnostics.ERROR),
    ('shadow/controller_node', diagnostics.ERROR)])
def test_warnings_and_other_nodes_end_nothing(tmp_path, name, level):
    assert ended_early(bag(tmp_path / 'bag', name, level)) == []


def test_a_report_that_cannot_be_read_hides_no_other_one(tmp_path):
    bag(tmp_path / 'bag', 'controller_node', diagnostics.ERROR)
    source, damaged = read_bag(tmp_path / 'bag'), tmp_path / 'damaged'
    writer = BagWriter(damaged)
    writer.add_topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    writer.write('/diagnostics', bytes.fromhex(
        '00010000000000000000000001000000ffffffff00000000'), 0)
    for data in source['/diagnostics'].raw:
        writer.write('/diagnostics', data, SECOND)
    writer.close()
    assert ended_early(read_bag(damaged)) == [f'controller_node at 1.000 s: {LINE}']


def test_a_node_that_is_named_with_its_own_namespace_is_known(tmp_path):
    flight = bag(tmp_path / 'bag', 'mambo/controller_node', diagnostics.ERROR)
    assert ended_early(flight) == [f'controller_node at 1.000 s: {LINE}']


def test_a_controller_that_gives_up_does_not_end_a_flight_by_hand(tmp_path):
    assert ended_early(bag(tmp_path / 'a', 'controller_node', diagnostics.ERROR, hand=True)) == []
    assert ended_early(bag(tmp_path / 'b', 'sim_node', diagnostics.ERROR, hand=True))


def test_a_vehicle_on_the_floor_below_its_reference_has_not_flown_to_the_end(tmp_path):
    line = ('the vehicle never took off: on the floor from 1.00 to 3.00 s, up to 1.00 m below its '
            'reference')
    for name, height, said in (('a', 0.005, [line]), ('b', 0.02, [])):
        assert ended_early(bag(tmp_path / name, 'sim_node', diagnostics.OK, height=height)) == said
    carried = bag(tmp_path / 'c', 'sim_node', diagnostics.OK, hand=True, height=0.0)
    assert ended_early(carried) == []
    told = bag(tmp_path / 'd', 'controller_node', diagnostics.ERROR, height=0.0)
    assert ended_early(told) == [f'controller_node at 1.000 s: {LINE}']  # of the cause alone


def test_less_than_the_scenario_asks_for_is_a_line_unless_it_is_known(tmp_path):
    flight = bag(tmp_path / 'bag', 'sim_node', diagnostics.OK, seconds=2)
    assert ended_early(flight) == ['flew 2.00 of 3 s']
    assert ended_early(flight, is_told=True) == []


def test_motors_that_a_controller_shut_down_without_a_report_are_told(tmp_path):
    flight = bag(tmp_path / 'a', 'sim_node', diagnostics.OK, height=1.0, down=True)
    assert ended_early(flight) == ['the controller shut the motors down at 2.000 s']
    reported = bag(tmp_path / 'b', 'controller_node', diagnostics.ERROR, height=1.0, down=True)
    assert ended_early(reported) == [f'controller_node at 1.000 s: {LINE}']
    carried = bag(tmp_path / 'c', 'sim_node', diagnostics.OK, height=1.0, down=True, hand=True)
    assert ended_early(carried) == []


@pytest.mark.parametrize(('height', 'reason', 'told'), [
    ((9.0, 8.9, 8.7), 1, ', 8.90 m above the floor: tilt limit'),
    ((1.0, 0.9, 0.8), 200, ', 0.90 m above the floor'),
    ((0.2, 0.14, 0.0), 1, None)])
def test_a_shutdown_above_the_floor_after_a_failsafe_is_told(tmp_path, height, reason, told):
    blind = 'descending blind: estimate lost or unusable'
    flight = bag(tmp_path / 'bag', 'controller_node', diagnostics.ERROR, height=height, down=True,
                 reason=reason, line=(blind,) * 3)
    assert ended_early(flight) == [f'controller_node at 1.000 s: {blind}'] + (
        [] if told is None else [f'the controller shut the motors down at 2.000 s{told}'])


@pytest.mark.parametrize(('height', 'why'), [
    (0.0, REASONS[REASON_GROUNDED]), (0.4, REASONS[REASON_ESTIMATE])])
def test_a_vehicle_on_the_floor_by_its_estimate_was_lost_if_the_truth_has_it_in_the_air(
        tmp_path, height, why):
    told = describe(STOPPED, REASON_GROUNDED)
    flight = bag(tmp_path / 'bag', 'controller_node', diagnostics.ERROR, height=height, down=True,
                 reason=REASON_GROUNDED, line=(told,) * 3)
    line = f'motors shut down: {why}'
    assert ended_early(flight) == [f'controller_node at 1.000 s: {line}']
    said = [event.text for event in events(flight)]
    assert f'controller_node: {line}' in said
    assert f'failsafe: motors shut down: {why.partition(":")[0]}' in said
    unknown = bag(tmp_path / 'real', 'controller_node', diagnostics.ERROR, line=(told,) * 3)
    assert ended_early(unknown) == [f'controller_node at 1.000 s: {told}']


def test_a_controller_that_gives_up_after_the_landing_ends_nothing(tmp_path):
    for name, first, said in (('a', 1, [f'controller_node at 1.000 s: {LINE}']), ('b', 2, [])):
        assert ended_early(bag(tmp_path / name, 'controller_node', diagnostics.ERROR, height=0.0,
                               landed=True, first=first)) == said
    low = bag(tmp_path / 'c', 'sim_node', diagnostics.ERROR, height=0.0, landed=True, first=2)
    assert ended_early(low) == [f'sim_node at 2.000 s: {LINE}']


def test_the_fall_after_a_shutdown_is_told_with_it(tmp_path):
    one = bag(tmp_path / 'bag', 'controller_node', diagnostics.ERROR, height=(9.0, 5.0, 0.0))
    assert ended_early(one) == [
        f'controller_node at 1.000 s: {LINE}', 'the vehicle hit the floor at 3.00 s with 4.0 m/s']


def test_the_longest_time_without_poses_is_told(tmp_path):
    lines = ['nominal; motion capture refused for 1.0 s: position 1.00 m off',
             'nominal; motion capture refused for 2.0 s: position 1.20 m off', 'nominal']
    one = bag(tmp_path / 'a', 'estimator_node', diagnostics.WARN, line=lines)
    assert without_poses(one) == ['the estimate went on without poses until t = 2.00 s: motion '
                                  'capture refused for 2.0 s: position 1.20 m off']
    short = bag(tmp_path / 'b', 'estimator_node', diagnostics.WARN, line=[
        'nominal; no motion capture for 0.9 s', 'no motion capture for long', ''])
    assert without_poses(short) == []


def test_motors_that_stop_above_the_floor_after_the_landing_are_told(tmp_path):
    fell = ['the motors stopped at 2.00 s, as the reference had landed, with the vehicle 0.80 m '
            'above the floor: it fell from there']
    for name, given, said in (
            ('stop', {}, fell), ('turn', {'motors': True}, [IDLE]),
            ('gap', {'motors': True, 'lost': (2,)}, []),  # the former command holds
            ('failsafe', {'motors': True, 'reason': 3}, []),  # which follows no phase
            ('carried', {'motors': True, 'hand': True}, []),
            ('none', {'lost': range(4)}, fell), ('low', {'height': 0.1}, [])):
        one = bag(tmp_path / name, 'sim_node', diagnostics.OK, landed=True,
                  **{'height': 0.8} | given)
        assert ended_early(one) == said


@pytest.mark.parametrize('commanded', [False, True])
def test_a_commanded_flight_that_is_over_in_the_air_is_told(tmp_path, commanded):
    one = bag(tmp_path / 'bag', 'sim_node', diagnostics.OK, height=0.8, commanded=commanded,
              motors=True)
    assert ended_in_the_air(one) == [
        'the flight was over in the air, 0.80 m high: no landing ended within its duration'
    ] * commanded
    for name, given in (('floor', {'height': 0.0, 'motors': True}), ('still', {'height': 0.8}),
                        ('none', {'motors': True})):
        assert ended_in_the_air(bag(
            tmp_path / name, 'sim_node', diagnostics.OK, commanded=commanded, **given)) == []


@pytest.mark.parametrize(('kinds', 'reason', 'told'), [
    ((fc.TAKEOFF, fc.SETPOINT), 0, True), ((fc.TAKEOFF, fc.SETPOINT, fc.LAND), 0, False),
    ((fc.TAKEOFF, fc.VELOCITY), 0, False), ((), 0, False),
    ((fc.TAKEOFF, fc.SETPOINT), 3, False)])  # the failsafe flies, and tells that itself
def test_a_landing_that_no_command_asked_for_is_told(tmp_path, kinds, reason, told):
    writer = BagWriter(tmp_path / 'bag')
    for topic, name in (('command', 'Command'), ('reference', 'Reference'),
                        ('motor_pwm', 'MotorPwm')):
        writer.add_topic(f'/mambo/{topic}', f'mambo_interfaces/msg/{name}')
    for second, kind in enumerate(kinds):
        t = second * SECOND
        writer.write('/mambo/command', encode(fc.FlightCommand(t, kind)), t)
    for second in range(8):
        t = second * SECOND
        writer.write('/mambo/motor_pwm', messages.motor_pwm(t, (200.0,) * 4, False, reason), t)
        writer.write('/mambo/reference', messages.reference(
            t, HIGH, TRACK if second < 6 else LANDING), t)
    writer.close()
    assert landed_by_itself(read_bag(tmp_path / 'bag')) == [
        'no setpoint was followed after t = 1.00 s: the vehicle stopped and hovered, and from '
        't = 6.00 s on it landed by itself'] * told
