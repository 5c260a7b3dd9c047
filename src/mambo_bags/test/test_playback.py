"""Messages of a bag in the order in which they were recorded; what is no bag is one line."""

from hypothesis import given, strategies as st
from mambo_bags import playback
from mambo_bags.playback import Hesitation, Losses, Watermarks
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_model import limits
from mambo_model.schema import ParameterError
from mambo_ros import messages, topics
import numpy as np
import pytest
from synthetic import make_flight

TOPICS = {'/mambo/imu/data_raw', '/mambo/sonar/range'}


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return make_flight(tmp_path_factory.mktemp('bags') / 'flight', 2.0)


def test_the_named_topics_come_in_the_order_of_their_log_time(flight):
    found = list(playback.recorded(flight, TOPICS))
    bag = read_bag(flight)
    assert {topic for topic, _, _ in found} == TOPICS
    for topic in TOPICS:
        assert [data for name, _, data in found if name == topic] == bag[topic].raw
        assert {kind for name, kind, _ in found if name == topic} == {bag.topics[topic]}
    left = {topic: iter(bag[topic].log_time.tolist()) for topic in TOPICS}
    times = [next(left[topic]) for topic, _, _ in found]
    assert times == sorted(times)
    assert list(playback.recorded(flight, {'/nothing'})) == []


def test_a_folder_a_file_and_a_folder_without_a_listing_are_bags(flight, tmp_path):
    file, = playback.bag_files(flight)
    assert playback.bag_files(file) == [file]
    (tmp_path / 'b.mcap').write_bytes(file.read_bytes())
    (tmp_path / 'a.mcap').write_bytes(file.read_bytes())
    assert playback.bag_files(tmp_path) == [tmp_path / 'a.mcap', tmp_path / 'b.mcap']


@pytest.mark.parametrize(('text', 'message'), [
    ('rosbag2_bagfile_information: {relative_file_paths: [gone.mcap]}',
     'gone.mcap: listed in metadata.yaml but missing'),
    ('rosbag2_bagfile_information: {relative_file_paths: []}', 'not a bag'),
    ('rosbag2_bagfile_information: 3', 'metadata.yaml: not the metadata of a rosbag2 bag'),
    ('a: [', 'metadata.yaml: not the metadata'), ('', 'metadata.yaml: not the metadata'),
    ('[1]', 'metadata.yaml: not the metadata')])
def test_a_listing_that_does_not_fit_is_one_line(tmp_path, text, message):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(ParameterError, match=message) as refused:
        playback.bag_files(tmp_path)
    assert '\n' not in str(refused.value)


def test_what_is_no_bag_is_one_line(tmp_path):
    for path in (tmp_path, tmp_path / 'none'):
        with pytest.raises(ParameterError, match='not a bag; give a rosbag2 directory'):
            playback.bag_files(path)


@pytest.mark.parametrize('share', [0.0, 0.3, 0.9])
def test_a_file_cut_short_is_told_and_recover_is_named(flight, tmp_path, share):
    content = playback.bag_files(flight)[0].read_bytes()
    file = tmp_path / 'cut.mcap'
    file.write_bytes(content[:round(share * len(content))])
    with pytest.raises(ParameterError, match='cut.mcap: not a readable MCAP file .*try recover'):
        list(playback.recorded(file, TOPICS))


def marks(*stamps):
    """Return watermarks to which one stream of samples was logged."""
    one = Watermarks(1)
    for stamp in stamps:
        one.add(0, stamp)
    return one


def test_a_made_watermark_announces_no_sample_of_its_own_future():
    one = marks(3, 5, 4, 9)
    assert [one.announced(t)[0] for t in (0, 3, 4, 5, 8, 9, 10)] == [0, 1, 1, 3, 3, 4, 4]


def test_a_made_watermark_waits_once_for_a_stamp_that_is_far_off():
    stamp = 5 + limits.AHEAD_NS
    assert [marks(stamp, 2).announced(t)[0] for t in (5, 4)] == [0, 0]
    one = marks(10**18, 2)
    assert [one.announced(t)[0] for t in (5, 6, 7)] == [0, 2, 2]


def test_a_sample_of_a_gap_belongs_to_the_inertial_sample_after_it():
    one = marks(1, 130_000_000, 150_000_000)
    assert [one.announced(t * 1_000_000)[0] for t in (5, 140, 145, 150)] == [1, 2, 2, 3]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 9)), max_size=30), st.data())
def test_made_watermarks_found_at_once_are_those_found_one_by_one(periods, data):
    """Of two streams, logged before watermarks of 5 ms, some samples up to 200 ms ahead."""
    t = np.arange(1, len(periods) + 1) * 5_000_000
    logged = np.cumsum(np.array(periods, np.int64).reshape(-1, 2), axis=0)
    ends = logged[-1].tolist() if periods else [0, 0]
    stamps = [np.array(data.draw(st.lists(
        st.integers(0, 40 if data.draw(st.booleans()) else 0), min_size=n, max_size=n)),
        np.int64) * 5_000_000 for n in ends]
    one, want, begun = Watermarks(2), [], [0, 0]
    for now, end in zip(t.tolist(), logged.tolist()):
        for stream in range(2):
            for stamp in stamps[stream][begun[stream]:end[stream]].tolist():
                one.add(stream, stamp)
        begun = end
        want.append(list(one.announced(now)))
    assert playback.announced(t, logged, stamps).tolist() == want


def stream(path, counts, again=(), first=0, gap=()):
    """
    Write inertial samples of 5 ms, some repeated or missing, and watermarks; return the bag.

    ``counts`` are those of the watermarks, ``first`` the samples before the recording.
    """
    with BagWriter(path) as bag:
        for topic in (topics.IMU, topics.SENSOR_TICK):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k, count in enumerate(counts):
            t = 5_000_000 * k
            data = messages.imu(t, (float(k), 0.0, 0.0), *[(0.0,) * 3] * 3)
            for _ in range(0 if k in gap else 1 + (k in again)):
                bag.write('/mambo/imu/data_raw', data, t)
            bag.write('/mambo/sensor_tick', messages.sensor_tick(t, first + count, 0, 0, 0), t)
    return path


def played(path, left_out=None):
    """Return the steps of a replay: stamp, and names and data."""
    known = {f'/mambo/{topic.name}': topic for topic in (topics.IMU, topics.SENSOR_TICK)}
    if left_out is None:
        left_out = playback.uncounted(read_bag(path), '/mambo/')
    return list(playback.steps(
        ((known[name], data) for name, _, data in playback.recorded(path, set(known))), left_out))


def gyros(path):
    return [[messages.decode_imu(data)[1][0] for topic, data in held if topic is topics.IMU]
            for _, held in played(path)]


@pytest.mark.parametrize('first', [0, 100])
def test_repeated_samples_are_left_out_where_no_watermark_counts_them(tmp_path, first):
    plain, twice = [[float(k)] for k in range(6)], [[float(k)] * 2 for k in range(6)]
    for number, (counts, again, wanted) in enumerate((
            (range(1, 7), (), plain), (range(1, 7), (1, 4, 5), plain),
            (range(2, 14, 2), range(6), twice),
            ((1, 3, 4, 5, 7, 9), (1, 4, 5), [
                plain[0], twice[1], plain[2], plain[3], twice[4], twice[5]]),
            ((1, 2, 3, 4, 6, 8), (1, 4, 5), [*plain[:4], twice[4], twice[5]]))):
        assert gyros(stream(tmp_path / str(number), counts, again, first)) == wanted


def test_a_watermark_without_an_inertial_sample_is_a_step(tmp_path):
    path = stream(tmp_path / 'bag', [1, 2, 3, 4, 5, 6], gap=(2, 3))
    assert [t for t, _ in played(path)] == [5_000_000 * k for k in range(6)]


def test_a_watermark_that_is_not_newer_is_left_out(tmp_path):
    sent = [(topic, data) for _, held in played(stream(tmp_path / 'bag', range(1, 7)))
            for topic, data in held]
    again = sent[:4] + sent[1:4:2] + sent[4:]  # the watermarks of 0 and 5 ms
    assert list(playback.steps(again, {})) == list(playback.steps(sent, {}))


@given(st.lists(st.tuples(st.integers(1, 3), st.booleans()), min_size=1, max_size=30))
def test_no_sample_is_left_out_that_is_no_repeat_or_is_counted(periods):
    """Samples of which some repeat the one before, and watermarks that count some of these."""
    raw, logged, due, count = [], [], [], 0
    for k, (times, counts) in enumerate(periods):
        raw += [b'%d' % k] * times
        count += times if counts else 1
        logged.append(len(raw))
        due.append(count)
    kept = playback.counted(raw, np.array(logged), np.array(due))
    assert [raw[k] for k in kept] == [
        b'%d' % k for k, (times, counts) in enumerate(periods)
        for _ in range(times if counts else 1)]


def answers(steps, first=0):
    """Return which steps are answered, and the losses; a step is of samples and a watermark."""
    losses, found = Losses(), []
    for samples, counts in steps:
        for topic in samples:
            losses.play(topic, b'')
        if counts is not None:
            losses.play(topics.SENSOR_TICK, messages.sensor_tick(
                0, *(first + n for n in counts), 0, 0))
        found.append(losses.answered(0))
    return found, str(losses)


I, S = topics.IMU, topics.SONAR


def test_a_step_is_answered_when_a_later_sample_tells_of_those_that_are_lost():
    for first in (0, 100):  # the recording began in flight
        assert answers([
            ([I], (1, 0)), ([S], (2, 0 + 1)), ([I], (3, 1)), ([I, S], (4, 2)), ([I], (5, 3)),
            ([I], (6, 3)), ([I, S], (7, 4))], first) == (
                [True, False, True, True, False, False, True],
                '; not in the bag: 1 samples of imu/data_raw, 1 samples of sonar/range')


def test_a_step_without_watermark_has_no_answer_and_one_without_losses_has():
    assert answers([([I], (1, 0)), ([I, S], None), ([I], (3, 1))]) == ([True, False, True], '')


def test_a_lost_pose_delays_the_answer_too():
    losses, found = Losses(), []
    for poses, count in ((1, 1), (0, 2), (0, 2), (1, 3)):
        for _ in range(poses):
            losses.play(topics.OPTITRACK, b'')
        losses.play(topics.CAPTURE_TICK, messages.capture_tick(0, count))
        losses.play(topics.SENSOR_TICK, messages.sensor_tick(0, 0, 0, 0, 0))
        found.append(losses.answered(0))
    assert found == [True, False, False, True]
    assert str(losses) == '; not in the bag: 1 samples of optitrack/pose'


def test_a_replay_hesitates_once_for_a_missing_answer_and_goes_on_for_a_while():
    one = Hesitation()
    assert not one.over(100) and not one.goes_on(100, Hesitation.WAIT)
    assert one.goes_on(100, Hesitation.WAIT + 0.01)
    for _ in range(Hesitation.BEHIND - 1):
        assert one.over(100) and one.goes_on(100, 0.0)
    assert not one.over(100) and not one.goes_on(100, 60.0)


def test_each_missing_answer_is_hesitated_for():
    one = Hesitation()
    for newest in (100, 200, 100):
        assert not one.over(newest) and not one.goes_on(newest, 0.0)
        assert one.goes_on(newest, 1.0) and one.over(newest)


def test_a_sample_ends_a_gap_where_the_estimator_has_no_newer_estimate():
    def step(k, *sensors):
        return [(topic, messages.imu(5_000_000 * k, *[(0.0,) * 3] * 4)) for topic in sensors]
    one = Hesitation()
    assert not one.ends_gap(step(0, I, S), -1)
    assert [one.ends_gap(step(k, I), 0) for k in range(1, 60)] == [False] * 59  # the sonar's gap
    assert one.ends_gap(step(60, I, S), 0)
    assert not one.ends_gap(step(110, S), 5_000_000 * 109)  # slow and answered: no gap
    assert one.ends_gap(step(111, I), 5_000_000 * 60)
