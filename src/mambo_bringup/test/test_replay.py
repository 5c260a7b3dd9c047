"""The command ``mambo replay``: what it refuses before any node is started."""

from mambo_bags.reader import BagError
from mambo_bags.writer import BagWriter
from mambo_bringup import processes, replay
from mambo_ros import messages, topics
import pytest


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


def test_steps_that_could_not_be_answered_are_refused_before_any_node_waits(tmp_path, monkeypatch):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/mambo/sensor_tick', topics.SENSOR_TICK.type_name)
        for k, stamp in enumerate((0, 1, 2, 1)):
            bag.write('/mambo/sensor_tick', messages.sensor_tick(stamp * 10**9, k, 0, 0, 0), k)
    monkeypatch.setattr(replay, 'NodeGroup', None)  # nothing is started
    with pytest.raises(BagError, match='/mambo/sensor_tick: stamps go back, first from 2.000 to'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out')
