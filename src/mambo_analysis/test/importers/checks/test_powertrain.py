"""Voltages and motor commands that cannot be those of a flight are told."""

from mambo_analysis.importers.checks import bag_doubts, powertrain
from mambo_analysis.importers.common import Publisher
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
import numpy as np
import pytest


@pytest.mark.parametrize('pwm, line', [
    ([0.2, 0.3, 0.4, 0.6], 'motor_pwm: the commands are up to 0.6: they are shares'),
    ([0.0] * 4, 'motor_pwm: the commands are 0 throughout: the motors stand'),
    ([300.0, 310.0, 290.0, 305.0], '')])
def test_commands_in_another_unit_are_told(tmp_path, pwm, line):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'motor_pwm': 'mambo_interfaces/msg/MotorPwm'})
        for k in range(50):
            out.publish('motor_pwm', 10_000_000 * k, '', pwm=np.array(pwm))
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag'))
    assert [text[:len(line)] for text in found] == [line] * bool(line)


def test_two_motors_with_the_same_commands_are_told(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'motor_pwm': 'mambo_interfaces/msg/MotorPwm'})
        for k in range(50):
            out.publish('motor_pwm', 10_000_000 * k, '', pwm=np.array(
                [300.0 + k, 300.0 - k, 290.0 + k % 2, 300.0 - k]))
    assert bag_doubts.doubts(read_bag(tmp_path / 'bag')) == [
        'motor_pwm: motors 2 and 4 have the same commands throughout, the others differ: check '
        'their columns']


@pytest.mark.parametrize('factor, said', [
    (1.0, []), (1.6, []), (0.6, []),
    (0.3, ['motor_pwm: in flight motor 2 has 0.3 times the command of the others (median): check '
           'its column and unit'])])
def test_one_motor_of_another_scale_is_told(tmp_path, factor, said):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'motor_pwm': 'mambo_interfaces/msg/MotorPwm'})
        for k in range(150):
            out.publish('motor_pwm', 10_000_000 * k, '', pwm=np.array(
                [300.0 + k % 3, factor * (300.0 + k % 5), 300.0 + k % 2, 300.0 - k % 7])
                if k > 50 else np.zeros(4))
    assert bag_doubts.doubts(read_bag(tmp_path / 'bag')) == said


def test_one_motor_that_stands_is_told(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'motor_pwm': 'mambo_interfaces/msg/MotorPwm'})
        for k in range(50):
            out.publish('motor_pwm', 10_000_000 * k, '', pwm=np.array(
                [300.0 + k, 0.0, 290.0 + k % 2, 310.0 - k]))
    assert bag_doubts.doubts(read_bag(tmp_path / 'bag')) == [
        'motor_pwm: motor 2 has the command 0 throughout, while others change: check its column']


@pytest.mark.parametrize('volts, said', [
    (np.nan, []), (3.7, []), (0.0037, ['battery: it has a median of 0.0037 V: check its column'])])
def test_a_battery_is_told_where_it_was_measured(tmp_path, volts, said):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'battery': 'sensor_msgs/msg/BatteryState'})
        for k in range(9):
            out.publish('battery', 10**9 * k, '', **out.battery(volts, 50.0))
    found = bag_doubts.doubts(read_bag(tmp_path / 'bag', namespace='/mambo'))
    assert [line[:40] for line in found] == [line[:40] for line in said]


@pytest.mark.parametrize(('low', 'said'), [
    ({}, []), ({30: 2.0}, []),  # 2 V of 3.7 V: a deep sag
    ({30: 5.5}, []),
    ({30: 0.0}, ['battery: 1 of 50 voltages are less than half of their median, 3.7 V, down to '
                 '0 V, the first at 3.00 s: were they measured?']),
    (dict.fromkeys(range(20, 40), 255.0), ['battery: 20 of 50 voltages are more than 1.5 times '
                                           'their median, 3.7 V, up to 255 V, the first at '
                                           '2.00 s: were they measured?'])])
def test_voltages_that_were_not_measured_are_told(tmp_path, low, said):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'battery': 'sensor_msgs/msg/BatteryState'})
        for k in range(50):
            out.publish('battery', 10**8 * k, '', **out.battery(low.get(k, 3.7), 50.0))
    assert powertrain.battery(read_bag(tmp_path / 'bag', namespace='/mambo')) == said


@pytest.mark.parametrize(('first', 'last', 'told'), [
    (200, 255, True), (200, 245, False), (0, 100, False), (900, 999, False)])
@pytest.mark.parametrize('every', [1, 2])
def test_a_motor_without_commands_for_a_while_is_told(first, last, told, every):
    t, rng = 0.01 * np.arange(1000), np.random.default_rng(0)
    pwm = 300.0 + 20.0 * rng.normal(size=(1000, 4))
    pwm[(t < 1.0) | (t > 9.0)] = 0.0  # on the floor
    if first == 200:  # in the air
        last = first + every * (last - first)
    pwm[first:last + 1:every, 2] = 0.0
    found = powertrain.stopped(t, pwm)
    assert len(found) == told
    for line in found:
        assert line.startswith('motor_pwm: motor 3 has the command 0 for 0.56 s, from 2.00 to ')


@pytest.mark.parametrize(('span', 'value', 'said'), [
    ((0, 0), 0.0, False), ((200, 300), 0.0, True), ((150, 420), None, True),
    ((200, 240), 0.0, False),  # 0.4 s
    ((0, 100), 0.0, False), ((500, 600), 0.0, False)])  # carried by hand
def test_commands_that_stand_while_the_vehicle_moves_are_told(tmp_path, span, value, said):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'motor_pwm': 'mambo_interfaces/msg/MotorPwm',
                                 'optitrack/pose': 'geometry_msgs/msg/PoseStamped'})
        pwm = np.array([300.0, 310.0, 290.0, 305.0]) + np.random.default_rng(0).normal(
            0.0, 3.0, (600, 4))
        pwm[slice(*span)] = pwm[span[0]] if value is None else value
        for k in range(600):
            out.publish('motor_pwm', 10_000_000 * k, '', pwm=pwm[k])
            out.publish('optitrack/pose', 10_000_000 * k, 'map', pose=out.pose(
                (np.sin(0.02 * k), 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)))
    found = [line for line in bag_doubts.doubts(read_bag(tmp_path / 'bag')) if 'motor' in line]
    assert found == [
        f'motor_pwm: the commands stand from {0.01 * span[0]:.2f} to {0.01 * span[1] - 0.01:.2f} '
        's, while the vehicle moves: were they recorded there?'] * said
