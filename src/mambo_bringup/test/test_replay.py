"""The command ``mambo replay``: what it refuses before any node is started."""

from types import SimpleNamespace
from unittest.mock import MagicMock

from mambo_bags.reader import BagError
from mambo_bags.writer import BagWriter
from mambo_bringup import processes, replay
from mambo_model.schema import ParameterError
from mambo_ros import messages, topics
import pytest

TICK = topics.SENSOR_TICK
STILL = ((0.0, 0.0, 0.0),) * 4


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
    stamps = {wrong: (0, 2, 1, 1), there: (0, 1, 2, 3)}
    with BagWriter(tmp_path / 'bag') as bag:
        for topic in filter(None, stamps):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k in range(4):
            for topic in filter(None, stamps):
                t = stamps[topic][k] * 10**9
                bag.write(f'/mambo/{topic.name}', messages.sensor_tick(
                    t, k, 0, 0, 0) if topic is TICK else messages.imu(t, *STILL), k)

    def start(*_):
        raise LookupError('nodes are started')
    monkeypatch.setattr(replay, 'NodeGroup', start)
    told = f'/mambo/{wrong.name}: stamps go back, first from 2.000 to' if refused else 'are start'
    with pytest.raises(BagError if refused else LookupError, match=told):
        replay.replay(tmp_path / 'bag', tmp_path / 'out')


def test_stamps_below_zero_are_refused_before_any_node_waits(tmp_path, monkeypatch):
    monkeypatch.setattr(replay, 'NodeGroup', lambda *_: pytest.fail('nodes are started'))
    with BagWriter(tmp_path / 'bag') as bag:
        for topic in (topics.IMU, topics.BAROMETER):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k in range(4):
            bag.write(f'/mambo/{topics.IMU.name}', messages.imu(k * 10**9, *STILL), k * 10**9)
            bag.write(f'/mambo/{topics.BAROMETER.name}', messages.pressure(
                (k - 3) * 10**9, 1e5, 1.0), k * 10**9)
    with pytest.raises(BagError, match='barometer/pressure: 3 of 4 stamps are below 0'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out')


def test_a_replay_that_fails_says_what_is_odd_about_the_stamps(tmp_path, monkeypatch):
    class Failed(MagicMock):
        fault, children = 'no estimate/odom for t = 3604.000 s', []
        interrupts = SimpleNamespace(first=None)

        def __enter__(self):
            return self
    monkeypatch.setattr(replay, 'NodeGroup', lambda *_: Failed(folder=tmp_path))
    with BagWriter(tmp_path / 'bag') as bag:
        for topic in (topics.SENSOR_TICK, topics.IMU):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k, t in enumerate((0, 3600, 2, 3)):
            bag.write(f'/mambo/{topics.SENSOR_TICK.name}', messages.sensor_tick(
                k * 10**9, k, 0, 0, 0), k * 10**9)
            bag.write(f'/mambo/{topics.IMU.name}', messages.imu(t * 10**9, *STILL), k * 10**9)
    with pytest.raises(processes.FlightError, match=(
            'for t = 3604.000 s; /mambo/imu/data_raw: stamps go back, first from 3600.000')):
        replay.replay(tmp_path / 'bag', tmp_path / 'out')


@pytest.mark.parametrize('rate', ['1e-9', '0.009', '-1', '1001', 'fast'])
def test_a_rate_that_would_take_for_ever_is_refused(rate, capsys):
    with pytest.raises(SystemExit) as end:
        replay.parser().parse_args(['bag', f'--rate={rate}'])
    error = capsys.readouterr().err
    assert end.value.code == 2 and '--rate: ' in error and error.count('\n') == 1
    for good in (0.0, 0.01, 1000.0):
        assert replay.parser().parse_args(['bag', f'--rate={good}']).rate == good


def test_a_parameter_file_without_the_estimator_is_refused_before_any_node(tmp_path, monkeypatch):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/clock', 'rosgraph_msgs/msg/Clock')
        bag.write('/clock', messages.clock(0), 0)
    file = tmp_path / 'file.yaml'
    file.write_text('/mambo/controller_node: {ros__parameters: {controller: indi}}')
    monkeypatch.setattr(replay, 'NodeGroup', None)  # nothing is started
    with pytest.raises(ParameterError, match='file.yaml: holds no parameters of estimator_node'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out', estimator_file=file)


@pytest.mark.parametrize('names', [('\udcfc', 'out'), ('bag', '\udcfc'), ('bag', 'out', '\udcfc')])
def test_paths_that_no_node_can_open_are_refused_before_any_node(tmp_path, monkeypatch, names):
    monkeypatch.setattr(replay, 'NodeGroup', None)  # nothing is started
    bag, output, *file = (tmp_path / name for name in names)
    with pytest.raises(processes.FlightInputError) as error:
        replay.replay(bag, output, 0.0, *file)
    assert str(error.value).startswith(
        rf'{tmp_path}/\xfc is not UTF-8, and no node can open it: ')


def test_one_drone_of_several_is_chosen(tmp_path, monkeypatch):
    with BagWriter(tmp_path / 'bag') as bag:
        names = [f'/mambo{k}/imu/data_raw' for k in (1, 2)]
        for name in names:
            bag.add_topic(name, topics.IMU.type_name)
        for name in names:
            bag.write(name, messages.imu(0, *[(0.0,) * 3] * 4), 0)
    monkeypatch.setattr(replay, 'NodeGroup', None)  # nothing is started
    with pytest.raises(BagError, match='/mambo1, /mambo2; choose one .* --namespace'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out')
    with pytest.raises(TypeError):  # where nodes would start
        replay.replay(tmp_path / 'bag', tmp_path / 'out', namespace='/mambo2')
    assert replay.parser().parse_args(['bag', '--namespace', '/mambo2']).namespace == '/mambo2'
