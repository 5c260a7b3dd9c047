"""Stamps that go back and gaps are told, with topic, place and number."""

from mambo_bags.reader import BagError, read_bag
from mambo_signals import stamps
import pytest
from synthetic import Maker, TYPES

IMU, TICK = 'imu/data_raw', 'sensor_tick'
STEP = 5_000_000  # ns


def bag_of(path, offsets):
    """Return a bag whose IMU stamps are later than the log times by offsets in steps."""
    maker = Maker(path, [IMU, 'estimate/odom'])
    for k, offset in enumerate(offsets):
        data = maker.message(TYPES[IMU], (k + offset) * STEP, 'base_link')
        maker.writer.write(f'/mambo/{IMU}', data, k * STEP)
    maker.odometry('estimate/odom', 0, (0, 0, 0))
    maker.writer.close()
    return read_bag(path)


@pytest.mark.parametrize(('offsets', 'told'), [
    ([0] * 8, []), ([3] * 8, []), ([0, 0, 1, 0, 1, 0], []),
    ([0] * 4 + [-3] * 4, [
        'stamps go back, first from 0.015 to 0.005 s: 2 of 8 samples are not newer']),
    ([-2] * 4, ['2 of 4 stamps are below 0, the first is -0.010 s: no node takes them']),
    ([0] * 4 + [300] * 4, ['no sample for 1.5 s after 0.015 s'])])
def test_stamps_that_go_back_and_long_gaps_are_told(tmp_path, offsets, told):
    found = stamps.doubtful(bag_of(tmp_path / 'bag', offsets))
    assert len(found) == len(told)
    for line, wanted in zip(found, told):
        assert line.startswith(f'/mambo/{IMU}: {wanted}')


def test_only_the_topics_that_are_asked_for_are_looked_at(tmp_path):
    bag = bag_of(tmp_path / 'bag', [0, 0, -2, 0])
    assert stamps.wrong(bag, [TICK, 'estimate/odom']) == []
    assert len(stamps.wrong(bag, [TICK, IMU])) == 1


def test_a_bag_without_inertial_samples_has_no_gap_to_tell(tmp_path):
    maker = Maker(tmp_path / 'bag', ['estimate/odom'])
    maker.odometry('estimate/odom', 0, (0, 0, 0))
    maker.odometry('estimate/odom', 10**10, (0, 0, 0))
    maker.writer.close()
    assert stamps.doubtful(read_bag(tmp_path / 'bag')) == []


def test_a_topic_that_cannot_be_decoded_is_left_to_who_reads_it(tmp_path):
    maker = Maker(tmp_path / 'bag', [IMU])
    maker.writer.write(f'/mambo/{IMU}', b'\0\1\0\0' + bytes(3), 0)
    maker.writer.close()
    bag = read_bag(tmp_path / 'bag')
    with pytest.raises(BagError):
        bag[IMU].stamp
    assert stamps.doubtful(bag) == []


def test_stamps_of_every_topic_are_looked_at(tmp_path):
    maker = Maker(tmp_path / 'bag', [IMU, 'estimate/odom'])
    for k, stamp in enumerate((0, 3, 1, 2, 4)):
        data = maker.message(TYPES[IMU], stamp * STEP, 'base_link')
        maker.writer.write(f'/mambo/{IMU}', data, k * STEP)
        maker.odometry('estimate/odom', k * STEP, (0, 0, 0))
    maker.writer.close()
    line, = stamps.wrong(read_bag(tmp_path / 'bag'))
    assert line.startswith(f'/mambo/{IMU}: stamps go back, first from 0.015 to 0.005 s: 2 of 5')


def test_a_bag_is_refused_for_the_topics_that_are_needed(tmp_path):
    bag = bag_of(tmp_path / 'bag', [0, 0, -2, 0])
    stamps.refuse_wrong(bag, ['estimate/odom'])
    with pytest.raises(BagError, match=f'{bag.path}: /mambo/{IMU}: stamps go back, first from'):
        stamps.refuse_wrong(bag)


def test_messages_that_repeat_a_stamp_are_counted(tmp_path):
    bag = bag_of(tmp_path / 'bag', [0, 0, 1, 0, 1, 0])
    assert stamps.repeated(bag) == [
        f'/mambo/{IMU}: 2 of 6 messages repeat the stamp of another: the first of each is used']
    assert stamps.repeated(bag, [TICK, 'estimate/odom']) == []


def test_some_stamps_that_go_back_are_left_to_who_leaves_them_out(tmp_path):
    for name, offsets, refused in (
            ('some', [0, 0, 0, -2, 0], False), ('most', [0, 3, 0, 0], True)):
        bag = bag_of(tmp_path / name, offsets)
        if refused:
            with pytest.raises(BagError, match='stamps go back, first from'):
                stamps.refuse_mostly_wrong(bag, IMU)
        else:
            stamps.refuse_mostly_wrong(bag, IMU)
            with pytest.raises(BagError, match='stamps go back'):
                stamps.refuse_wrong(bag, [IMU])


def streams(path, ahead):
    """Return a bag whose estimate is stamped ahead of the inertial samples around it, in steps."""
    maker = Maker(path, [IMU, 'estimate/odom'])
    for k in range(400):
        for topic, later in ((IMU, 0), ('estimate/odom', ahead)):
            data = maker.message(TYPES[topic], (k + later + 500) * STEP, 'base_link')
            maker.writer.write(f'/mambo/{topic}', data, (k + 500) * STEP)
    maker.writer.close()
    return read_bag(path)


@pytest.mark.parametrize(('ahead', 'said'), [
    (0, None), (20, None), (-20, None), (-190, None), (40, '0.2 s ahead of'),
    (720_000, '3.6e+03 s ahead of'), (-400, '2 s behind')])
def test_a_topic_of_another_clock_is_told(tmp_path, ahead, said):
    found = stamps.other_clock(streams(tmp_path / 'bag', ahead), ['estimate/odom', TICK])
    assert len(found) == bool(said)
    if said:
        assert found[0] == (f'/mambo/estimate/odom: stamped {said} the inertial samples that were '
                            'recorded with it: it has another clock')


@pytest.mark.parametrize('every, differ, refused', [
    (1, True, True), (1, False, False), (10, True, False)])
def test_two_flights_in_one_recording_are_refused(tmp_path, every, differ, refused):
    maker = Maker(tmp_path / 'bag', [IMU])
    for k in range(200):
        for copy in range(2 if k % every == 0 else 1):
            rate = maker.Vector3(0.0, 0.5 * copy * differ, 0.0)
            maker.write(IMU, k * STEP, angular_velocity=rate)
    maker.writer.close()
    bag = read_bag(tmp_path / 'bag')
    if not refused:
        return stamps.refuse_mixed(bag)
    with pytest.raises(BagError, match='200 of the 400 samples of /mambo/imu/data_raw have'):
        stamps.refuse_mixed(bag)
