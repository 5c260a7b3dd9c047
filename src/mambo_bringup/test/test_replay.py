"""The command ``mambo replay``: what it refuses before any node is started."""

from mambo_bags.reader import BagError
from mambo_bags.writer import BagWriter
from mambo_bringup import processes, replay
from mambo_ros import messages, topics
import pytest

TICK = topics.SENSOR_TICK


def test_a_damaged_bag_is_not_replayed(tmp_path, monkeypatch):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/clock', 'rosgraph_msgs/msg/Clock')
        bag.write('/clock', bytes(12), 0)
    data = bag.file.read_bytes()
    bag.file.write_bytes(data[:len(data) // 2])
    monkeypatch.setattr(replay, 'NodeGroup', None)  # nothing is started
    with pytest.raises(BagError, match='recover'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out', estimator_file=tmp_path / 'file.yaml')
    bag.file.write_bytes(data)
    with pytest.raises(processes.FlightInputError, match='file.yaml: there is no such parameter'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out', estimator_file=tmp_path / 'file.yaml')


@pytest.mark.parametrize(('wrong', 'there', 'refused'), [
    (TICK, topics.IMU, True), (topics.IMU, None, True), (topics.IMU, TICK, False)])
def test_steps_that_could_not_be_answered_are_refused_before_any_node_waits(
        tmp_path, monkeypatch, wrong, there, refused):
    """Late inertial samples are left out where the ticks say which step is meant."""
    still = ((0.0, 0.0, 0.0),) * 4
    stamps = {wrong: (0, 1, 2, 1), there: (0, 1, 2, 3)}
    with BagWriter(tmp_path / 'bag') as bag:
        for topic in filter(None, stamps):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k in range(4):
            for topic in filter(None, stamps):
                t = stamps[topic][k] * 10**9
                bag.write(f'/mambo/{topic.name}', messages.sensor_tick(
                    t, k, 0, 0, 0) if topic is TICK else messages.imu(t, *still), k)

    def start(*_):
        raise LookupError('nodes are started')
    monkeypatch.setattr(replay, 'NodeGroup', start)
    told = f'/mambo/{wrong.name}: stamps go back, first from 2.000 to' if refused else 'are start'
    with pytest.raises(BagError if refused else LookupError, match=told):
        replay.replay(tmp_path / 'bag', tmp_path / 'out')
