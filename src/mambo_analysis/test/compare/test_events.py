"""Events of a flight: when, what, and how bad."""

from mambo_analysis.compare import events
from mambo_analysis.compare.events import Event
from mambo_bags.reader import read_bag
import numpy as np
import pytest
from synthetic import DIAGNOSTICS, Maker, STEP

FAULTS = """
/mambo/sim_node:
  ros__parameters:
    simulator:
      faults:
        gyro: {kind: none, start: 0.1, duration: 0.1}
        sonar: {kind: stuck, start: 0.1, duration: 0.2}
        barometer: {kind: wild, start: what, duration: 0.2}
/mambo/optitrack_node:
  ros__parameters: {optitrack: {fault: flip, fault_begin: 0.2, fault_end: 99.0}}
"""


def made(path, motors=(), states=(), reports=(), scenario=''):
    maker = Maker(path, ('motor_pwm', 'estimator/state'),
                  attachments={'scenario.yaml': scenario})
    if reports:
        maker.writer.add_topic('/diagnostics', DIAGNOSTICS)
    for topic, rows in (('motor_pwm', motors), ('estimator/state', states)):
        for k, row in enumerate(rows):
            maker.write(topic, k * STEP, **row)
    types = maker.store.types
    for level, name, text, ns in reports:
        status = types['diagnostic_msgs/msg/DiagnosticStatus'](level, name, text, '', [])
        maker.writer.write(
            '/diagnostics', maker.message(DIAGNOSTICS, ns, '', status=[status]), ns)
    maker.writer.close()
    return read_bag(path)


def test_the_failsafe_is_told_when_it_acts_and_when_it_ends(tmp_path):
    rows = [{}, {'reason': 3}, {'reason': 3}, {}, {'reason': 5, 'shutdown': True}, {'reason': 99}]
    found = events.events(made(tmp_path / 'bag', motors=rows))
    assert [one._replace(t=round(one.t, 6)) for one in found] == [
        Event(0.005, 'bad', 'failsafe: holding or landing: estimate lost or unusable'),
        Event(0.015, 'half', 'failsafe: as planned again'),
        Event(0.02, 'bad', 'failsafe: motors shut down: crash'),
        Event(0.025, 'bad', 'failsafe: holding or landing: reason 99')]


def test_injected_faults_come_from_the_scenario_and_only_inside_the_flight(tmp_path):
    bag = made(tmp_path / 'bag', motors=[{}] * 100, scenario=FAULTS)
    assert [(one.t, one.text) for one in events.events(bag)] == [
        (0.1, 'injected fault begins: sonar stuck'),
        (0.2, 'injected fault begins: motion capture flip'),
        (pytest.approx(0.3), 'injected fault ends: sonar stuck')]


def test_a_sensor_is_unhealthy_from_when_to_when(tmp_path):
    good, far, stuck = ({'health': np.array([0, 0, code, 0, 0], np.uint8)} for code in (0, 1, 5))
    bag = made(tmp_path / 'bag', states=[good, far, stuck, stuck, far])
    assert events.events(bag) == [
        Event(0.01, 'half', 'sonar stuck'), Event(0.02, 'half', 'sonar good again')]


def test_of_the_errors_of_a_node_the_first_counts(tmp_path):
    bag = made(tmp_path / 'bag', motors=[{}] * 100, reports=[
        (1, 'node', 'a warning', 1000), (2, 'node', 'wrong', 10**8),
        (2, 'node', 'more', 2 * 10**8)])
    assert events.events(bag) == [Event(0.1, 'bad', 'node: wrong')]


def test_there_are_never_more_than_a_page_can_hold(tmp_path):
    rows = [{'reason': k % 2} for k in range(1000)]
    states = [{'sonar_refused': k} for k in range(2000)]
    bag = made(tmp_path / 'bag', motors=rows, states=states)
    assert len(events.events(bag)) == events.MOST
    found, = events.rejected(bag)
    assert (found.sensor, found.count) == ('sonar', 1999) and 200 < len(found.t) <= events.MARKS


def test_rejected_samples_stand_where_the_counter_rises(tmp_path):
    bag = made(tmp_path / 'bag', states=[
        {'flow_refused': k} for k in (0, 0, 2, 2, 3)])
    found, = events.rejected(bag)
    assert (found.sensor, found.count, found.bag) == ('optical flow', 3, '')
    np.testing.assert_allclose(found.t, [0.01, 0.02])


def test_parameters_are_named_by_node_and_numbers_are_finite():
    values = events.parameters(
        {'/a/b': {'ros__parameters': {'c': {'d': 1}, 'e': '.'}}, 7: {'x': 2}})
    assert values == {'b.c.d': 1, 'b.e': '.', '7.x': 2}
    assert events.number(values, 'b.c.d') == 1.0
    assert np.isnan([events.number({'x': x}, 'x') for x in (None, 'a', float('inf'), [])]).all()


def test_a_bag_without_any_of_it_has_no_events(tmp_path):
    bag = made(tmp_path / 'bag', motors=[{}], scenario='a: [')
    assert events.events(bag) == [] and events.rejected(bag) == []
