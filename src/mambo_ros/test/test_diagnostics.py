"""Health reports: bytes of one status, the line of refusals, and the first fault of a node."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from mambo_ros import diagnostics
from rclpy.serialization import deserialize_message


def test_a_report_is_one_status_at_the_time_of_the_flight():
    data = diagnostics.report(12_000_000_345, 'estimator_node', diagnostics.WARN, 'sonar stuck',
                              {'sonar': 'stuck', 'count': 3})
    found = deserialize_message(bytes(data), DiagnosticArray)
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (12, 345)
    status, = found.status
    assert (status.name, status.level, status.message) == (
        'estimator_node', diagnostics.WARN, 'sonar stuck')
    assert [(pair.key, pair.value) for pair in status.values] == [
        ('sonar', 'stuck'), ('count', '3')]


def test_refusals_are_one_line():
    line = diagnostics.refusals_line({'estimate/odom not finite': 3, 'reference late': 1})
    assert line == f'{diagnostics.REFUSED} 3 estimate/odom not finite, 1 reference late'


class Node(diagnostics.Faulty):
    """A node that keeps what it logs."""

    def __init__(self):
        self.logged = []

    def get_logger(self):
        return SimpleNamespace(error=self.logged.append)


def test_the_first_fault_is_kept_and_told_once():
    node, other = Node(), Node()
    node.fail('')
    assert not node.fault and not node.logged
    node.fail('the disk is full')
    node.fail('and again')
    assert node.fault == 'the disk is full' and node.logged == ['the disk is full']
    assert not other.fault
