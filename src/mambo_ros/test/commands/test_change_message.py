"""Changes of parameters as statuses on /diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray
from mambo_model.motion.parameter_change import Change
from mambo_model.schema import ParameterError
from mambo_ros import diagnostics
from mambo_ros.commands import change_message
import pytest
from rclpy.serialization import deserialize_message

VALUES = {'cascaded.k_p': 0.1 + 0.2, 'bias': (1.0, 1 / 3), 'kind': 'late', 'on': True}


def test_a_change_reads_back_exactly():
    data = change_message.encode(5_000_000_000, 'sim_node', VALUES)
    assert change_message.decode(data) == [
        ('sim_node', Change(5_000_000_000, {**VALUES, 'bias': [1.0, 1 / 3]}))]


def test_a_reader_of_diagnostics_sees_what_changed():
    data = change_message.encode(5_000_000_000, 'sim_node', {'speed': 2.0})
    (status,) = deserialize_message(data, DiagnosticArray).status
    assert (status.name, status.level) == ('sim_node: parameters', diagnostics.OK)
    assert status.message == 'changed: speed = 2.0'


def test_a_status_of_one_of_several_drones_is_read_too():
    data = change_message.encode(0, 'mambo2/sim_node', {'speed': 2.0})
    assert change_message.decode(data, '/mambo2')[0][0] == 'sim_node'
    assert change_message.decode(data) == change_message.decode(data, '/mambo') == []


def test_other_statuses_are_no_changes():
    for name in ('sim_node', 'a: parameters of it', 'sim_node: inputs'):
        assert change_message.decode(
            diagnostics.report(0, name, diagnostics.OK, 'a: parameters', {'x': 1})) == []


def test_a_value_that_cannot_be_read_is_one_line():
    data = diagnostics.report(0, 'sim_node: parameters', diagnostics.OK, '', {'speed': 'fast'})
    with pytest.raises(ParameterError, match='a recorded parameter of sim_node cannot be read'):
        change_message.decode(data)
