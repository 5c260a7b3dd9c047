"""How a bag is played step by step, without a graph: clock, samples and watermarks."""

from collections import Counter
import struct
from types import SimpleNamespace

from mambo_bags import replay_node
from mambo_bags.playback import Hesitation
from mambo_bags.replay_node import ReplayNode, ReplayNodeParams
from mambo_model.schema import ParameterError
from mambo_ros import messages, topics
import numpy as np
import pytest
import synthetic
from synthetic import Maker, STEP

SENSORS = {topics.IMU: 1, topics.SONAR: 2, topics.OPTICAL_FLOW: 3}
FIELDS = {'sonar/range': 'range', 'optical_flow': 'rate_x'}


def bag(path, ticks=False):
    """Write four steps of an IMU, a sonar in every second and a flow in every third."""
    names = [topic.name for topic in SENSORS] + (['sensor_tick'] if ticks else [])
    maker = Maker(path, names, attachments={})
    for k in range(4):
        for topic, period in SENSORS.items():
            if k % period == 0:
                values = {FIELDS[topic.name]: float(k)} if topic.name in FIELDS else {}
                maker.write(topic.name, k * STEP, **values)
        if ticks:
            maker.write('sensor_tick', k * STEP, imu=k + 1)
    maker.writer.close()
    return path


class Player:
    """A replay node without ROS: what it publishes is kept in order."""

    steps, _publish_step = ReplayNode.steps, ReplayNode._publish_step
    _recorded = ReplayNode._recorded
    wait_for_answer = ReplayNode.wait_for_answer

    def __init__(self, path, root='/mambo'):
        self.published, self._path, self._t, self._due = [], path, -1, -1
        self._root, self._hesitation = f'{root}/', Hesitation()
        self._estimates = SimpleNamespace(last=-1)
        self._topics = {f'{root}/{topic.name}': topic
                        for topic in (*replay_node.SENSORS, topics.SENSOR_TICK)}
        self._outputs = {topic: self.out(topic.name) for topic in self._topics.values()}
        self._clock_output = self.out('/clock')

    def out(self, name):
        return lambda data: self.published.append((name, bytes(data)))


def played(path):
    player = Player(path)
    return player, list(player.steps())


def test_a_step_is_the_clock_its_samples_and_a_watermark(tmp_path):
    player, stamps = played(bag(tmp_path / 'bag'))
    assert stamps == [k * STEP for k in range(4)]
    names = [name for name, _ in player.published]
    assert names == [  # of one stamp in the order of the file: by name
        '/clock', 'imu/data_raw', 'optical_flow', 'sonar/range', 'sensor_tick',
        '/clock', 'imu/data_raw', 'sensor_tick',
        '/clock', 'imu/data_raw', 'sonar/range', 'sensor_tick',
        '/clock', 'imu/data_raw', 'optical_flow', 'sensor_tick']


def test_one_drone_of_several_is_played(tmp_path):
    maker = Maker(tmp_path / 'bag', ['imu/data_raw'])
    maker.writer.add_topic('/other/imu/data_raw', topics.IMU.type_name)
    for k in range(3):
        data = maker.message('imu/data_raw', k * STEP)
        maker.writer.write('/other/imu/data_raw', data, k * STEP)
    maker.write('imu/data_raw', 9 * STEP)
    maker.writer.close()
    assert list(Player(tmp_path / 'bag', '/other').steps()) == [k * STEP for k in range(3)]


def test_the_clock_is_the_stamp_of_the_step(tmp_path):
    player, stamps = played(bag(tmp_path / 'bag'))
    clocks = [struct.unpack_from('<iI', data, 4) for name, data in player.published
              if name == '/clock']
    assert [s * 10**9 + ns for s, ns in clocks] == stamps


def test_a_watermark_counts_the_samples_so_far(tmp_path):
    player, _ = played(bag(tmp_path / 'bag'))
    seen, counts = Counter(), []
    for name, data in player.published:
        seen[name] += 1
        if name == 'sensor_tick':
            counts.append(struct.unpack_from('<4Q', data[-32:]) if len(data) >= 44
                          else struct.unpack_from('<4I', data[-16:]))
            assert counts[-1][:3] == (seen['imu/data_raw'], seen['sonar/range'],
                                      seen['optical_flow'])
    assert len(counts) == 4


def test_recorded_watermarks_are_played_and_none_are_made(tmp_path):
    player, _ = played(bag(tmp_path / 'bag', ticks=True))
    names = Counter(name for name, _ in player.published)
    assert names['sensor_tick'] == 4  # one a step: those of the bag


def test_a_topic_of_another_type_is_refused_by_name(tmp_path, monkeypatch):
    monkeypatch.setitem(synthetic.TYPES, 'sonar/range', 'sensor_msgs/msg/Imu')
    path = tmp_path / 'bag'
    maker = Maker(path, ['imu/data_raw', 'sonar/range'], attachments={})
    maker.write('imu/data_raw', 0)
    maker.write('sonar/range', 0)
    maker.writer.close()
    with pytest.raises(ParameterError, match='/mambo/sonar/range has type sensor_msgs/msg/Imu, '
                                             'expected sensor_msgs/msg/Range'):
        played(path)


def test_a_bag_without_an_imu_has_no_step(tmp_path):
    maker = Maker(tmp_path / 'bag', ['sonar/range'], attachments={})
    maker.write('sonar/range', 0)
    maker.writer.close()
    assert played(tmp_path / 'bag')[1] == []


class Loop:
    """A graph that answers after so many turns, or stops."""

    def __init__(self, player, answers=np.inf, stops=np.inf):
        self.player, self.answers, self.stops, self.turns = player, answers, stops, 0

    def once(self, _):
        self.turns += 1
        if self.turns >= self.answers:
            self.player._estimates.last = 10**9

    @property
    def stopping(self):
        return self.turns >= self.stops


@pytest.fixture
def waiting(monkeypatch):
    """Return a player that waits for 30 s, each look at the clock a second long."""
    now = iter(range(10**6))
    monkeypatch.setattr(replay_node.time, 'monotonic', lambda: next(now))
    player, errors = SimpleNamespace(), []
    player.params = ReplayNodeParams(bag='b', patience=30.0)
    player._estimates, player._hesitation = SimpleNamespace(last=-1), Hesitation()
    for _ in range(Hesitation.BEHIND):
        player._hesitation.goes_on(-1, 0.0)
    player._losses, player._due = '; not in the bag: all', 10**9
    player.get_logger = lambda: SimpleNamespace(error=errors.append)
    return player, errors


def test_an_answer_is_waited_for(waiting):
    player, errors = waiting
    loop = Loop(player, answers=3)
    assert ReplayNode.wait_for_answer(player, loop) and loop.turns == 3
    assert ReplayNode.wait_for_answer(player, loop) and loop.turns == 3  # is there
    assert not errors


def test_patience_ends_with_what_is_missing(waiting):
    player, errors = waiting
    player._due = 1_005_000_000
    assert not ReplayNode.wait_for_answer(player, Loop(player))
    assert errors == ['no estimate/odom for t = 1.005 s within 30 s; not in the bag: all']


def test_a_suspension_is_no_wait(waiting, monkeypatch):
    player, errors = waiting
    now = iter(range(0, 10**6, 3600))
    monkeypatch.setattr(replay_node.time, 'monotonic', lambda: next(now))
    assert ReplayNode.wait_for_answer(player, Loop(player, answers=30)) and not errors


def test_an_answer_that_a_lost_sample_delays_is_not_waited_for_but_the_last_is(waiting):
    player, errors = waiting
    player._estimates.last = 10**9
    loop = Loop(player)
    for k in range(1, 41):  # as far as a sample may be ahead, here after a gap of 5 s
        player._due = 6 * 10**9 + k * STEP
        assert ReplayNode.wait_for_answer(player, loop)
    assert loop.turns == 40 and not errors  # the first hesitates, the others have no need to
    assert not ReplayNode.wait_for_answer(player, loop, last=True)
    player._due += STEP
    assert not ReplayNode.wait_for_answer(player, loop)
    assert len(errors) == 2


def test_a_stop_ends_the_wait_without_a_word(waiting):
    player, errors = waiting
    assert not ReplayNode.wait_for_answer(player, Loop(player, stops=2))
    assert not errors


def replayed(player, loop, rate=0.0, wait_for=''):
    lines = []
    player.params = ReplayNodeParams(bag='my_bag', rate=rate, wait_for=wait_for)
    player.get_logger = lambda: SimpleNamespace(error=lines.append, info=lines.append)
    player.links = SimpleNamespace(wait=lambda *_: True, alone=lambda _: True)
    return replay_node.replay(player, loop), lines


def test_a_replay_tells_its_length_and_steps(tmp_path):
    player = Player(bag(tmp_path / 'bag'))
    player._estimates = SimpleNamespace(last=10**9)
    code, (line,) = replayed(player, Loop(player))
    assert code == 0 and line.startswith('replayed 0.015 s, 4 steps, in ')


def test_a_rate_is_kept_by_the_wall_clock(tmp_path, monkeypatch):
    player, clock = Player(bag(tmp_path / 'bag')), SimpleNamespace(now=0.0)
    monkeypatch.setattr(replay_node.time, 'monotonic', lambda: clock.now)

    class Turning(Loop):
        def once(self, left):
            clock.now += left
    assert replayed(player, Turning(player), rate=0.5)[0] == 0
    assert clock.now == pytest.approx(0.015 / 0.5)


def test_a_bag_without_sensors_is_an_error(tmp_path):
    maker = Maker(tmp_path / 'bag', ['motor_pwm'], attachments={})
    maker.write('motor_pwm', 0)
    maker.writer.close()
    player = Player(tmp_path / 'bag')
    code, lines = replayed(player, Loop(player))
    assert code == 1 and lines == ['my_bag: no sensor messages under /mambo']


def test_a_damaged_bag_is_one_line(tmp_path):
    path = bag(tmp_path / 'bag', ticks=True)
    file, = path.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:200])
    code, (line,) = replayed(Player(path), Loop(None))
    assert code == 1 and str(file) in line and '\n' not in line


def test_repeated_samples_that_no_watermark_counts_are_not_played(tmp_path):
    maker = Maker(tmp_path / 'bag', ['imu/data_raw', 'sonar/range', 'sensor_tick'], attachments={})
    for k in range(4):
        for _ in range(1 + (k == 2)):
            maker.write('imu/data_raw', k * STEP)
            maker.write('sonar/range', k * STEP, range=float(k))
        maker.write('sensor_tick', k * STEP, imu=k + 1, sonar=k + 1)
    maker.writer.close()
    player, stamps = played(tmp_path / 'bag')
    assert stamps == [k * STEP for k in range(4)]
    assert Counter(name for name, _ in player.published) == {
        '/clock': 4, 'imu/data_raw': 4, 'sonar/range': 4, 'sensor_tick': 4}


def test_the_end_of_a_gap_waits_for_the_watermarks_of_the_gap(tmp_path, monkeypatch):
    slept = []
    monkeypatch.setattr(replay_node.time, 'sleep', slept.append)
    maker = Maker(tmp_path / 'bag', ['imu/data_raw', 'sensor_tick'], attachments={})
    for k in range(60):
        if not 10 <= k < 40:
            maker.write('imu/data_raw', k * STEP)
        maker.write('sensor_tick', k * STEP, imu=k + 1)
    maker.writer.close()
    player = Player(tmp_path / 'bag')
    assert len(list(player.steps())) == 60
    assert slept == [Hesitation.WAIT]
    assert player._due == 59 * STEP


def test_watermarks_of_a_recording_that_begins_in_flight_count_from_there(tmp_path):
    maker = Maker(tmp_path / 'bag', ['imu/data_raw', 'sonar/range', 'sensor_tick'], attachments={})
    for k in range(4):
        maker.write('imu/data_raw', k * STEP)
        maker.write('sonar/range', k * STEP, range=float(k))
        maker.write('sensor_tick', k * STEP, imu=101 + k, sonar=21 + k)
    maker.writer.close()
    player, _ = played(tmp_path / 'bag')
    counts = [messages.decode_sensor_tick(data)[1] for name, data in player.published
              if name == 'sensor_tick']
    assert counts == [(k + 1, k + 1, 0, 0) for k in range(4)]
    assert player._due == 3 * STEP


def captured(path, poses=True, gap=()):
    """Write 50 steps with a pose and a watermark of the motion capture each, but in a gap."""
    maker = Maker(path, [
        'imu/data_raw', 'sensor_tick', 'optitrack/pose', 'optitrack/tick'], attachments={})
    for k in range(50):
        maker.write('imu/data_raw', k * STEP)
        maker.write('sensor_tick', k * STEP, imu=k + 1)
        if poses:
            maker.write('optitrack/pose', k * STEP)
        if k not in gap:
            maker.write('optitrack/tick', k * STEP, poses=k + 1)
    maker.writer.close()
    player = Player(path)
    for topic in (topics.OPTITRACK, topics.CAPTURE_TICK):
        player._topics[f'/mambo/{topic.name}'] = topic
        player._outputs[topic] = player.out(topic.name)
    return player


def test_a_step_waits_for_the_watermark_of_the_motion_capture(tmp_path):
    player, due = captured(tmp_path / 'bag', gap=range(10, 40)), []
    for _ in player.steps():
        due.append(player._due // STEP)
    assert due == [*range(10), *[9] * 30, *range(40, 50)]


def test_watermarks_of_a_motion_capture_without_poses_announce_none(tmp_path):
    player = captured(tmp_path / 'bag', poses=False)
    assert [player._due // STEP for _ in player.steps()] == [*range(50)]
    assert [messages.decode_capture_tick(data)[1] for name, data in player.published
            if name == 'optitrack/tick'] == [0] * 50
