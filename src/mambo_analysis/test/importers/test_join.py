"""A flight and its motion capture, recorded apart, become one bag on one clock."""

import dataclasses
from pathlib import Path
import re
from types import SimpleNamespace

from mambo_analysis.importers import join
from mambo_analysis.importers.common import Publisher
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_ros import cdr
from mambo_signals import motion
from mambo_signals.time_offset import AlignError
from mambo_thesis.drift import identify_drift
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

CIRCLE = Path(__file__).parents[4] / 'bags/circle_short'
BEGAN = 2.5  # s into the flight
BODY_RATES = 'roll rate', 'pitch rate'  # a circle is flown with both
POSE = '/mambo/optitrack/pose'


def copy(path, keep, shift=0, end=np.inf, late=0):
    """
    Write the topics of the repository's flight up to end, ns, stamps moved by so many ns.

    They are logged so many ns late.
    """
    bag = read_bag(CIRCLE)
    with BagWriter(path) as writer:
        for topic in keep:
            writer.add_topic(bag.name(topic), bag[topic].type_name)
        for topic in keep:
            for stamp, data in zip((bag[topic].stamp + shift).tolist(), bag[topic].raw):
                if 0 <= stamp < end:
                    writer.write(bag.name(topic), cdr.restamped(data, stamp), stamp + late)
    return path


@pytest.fixture(scope='module')
def log(tmp_path_factory):
    """Return a bag as a drone alone would record it."""
    return copy(tmp_path_factory.mktemp('log') / 'log', (
        'imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure'))


@pytest.fixture(scope='module')
def take(tmp_path_factory):
    """Return what the cameras saw, on the clock of a take that began later."""
    return copy(tmp_path_factory.mktemp('take') / 'take', ('optitrack/pose',),
                -round(BEGAN * 1e9))


def test_the_clock_comes_back_and_nothing_of_the_flight_is_lost(log, take, tmp_path):
    message = join.join(log, take, tmp_path / 'joined')
    joined, before, circle = (read_bag(path) for path in (tmp_path / 'joined', log, CIRCLE))
    offset = float(joined.metadata['join']['offset_s'])
    assert offset == pytest.approx(BEGAN, abs=2e-3)  # half a sample of the gyro
    assert f'moved by {offset:+.4f} s' in message
    best, _, every = joined.metadata['join']['offset_from'].partition(' of ')
    assert best in BODY_RATES and every == 'roll rate, pitch rate, turn rate, height'
    assert float(joined.metadata['join']['offset_sigma_s']) < 1e-3  # the height alone: 5e-3
    for topic in before.topics:
        assert joined[topic].raw == before[topic].raw
    poses, truth = joined['optitrack/pose'], circle['optitrack/pose']
    late = truth.stamp >= round(BEGAN * 1e9)
    assert len(poses) == late.sum()
    np.testing.assert_allclose(poses.stamp, truth.stamp[late], atol=2e6)  # ns
    np.testing.assert_array_equal(poses.position, truth.position[late])
    assert joined.topics[POSE] == 'geometry_msgs/msg/PoseStamped'


def test_a_given_offset_is_taken_and_poses_outside_of_the_flight_are_counted(log, take, tmp_path):
    message = join.join(log, take, tmp_path / 'joined', -1.0)
    assert 'moved by -1.0000 s, by given' in message and '120 outside' in message  # 1 s at 120 Hz
    assert read_bag(tmp_path / 'joined')[POSE].stamp[0] >= 0
    assert re.search(rf'^warning: by .* the offset is \+{BEGAN:g}.* s, not the given -1.000 s',
                     message, re.MULTILINE)
    assert 'warning' not in join.join(log, take, tmp_path / 'right', BEGAN)


@pytest.mark.parametrize('shift, late', [
    (0, 1_700_000_000 * 10**9),             # stamps since the start, logged by a wall clock
    (1_700_000_000 * 10**9, -1_700_000_000 * 10**9),  # the other way round
    (40 * 10**9, 25 * 10**6)])              # the flight begins 40 s into its log, 25 ms late
def test_the_flight_is_where_its_stamps_are_whenever_it_was_logged(take, tmp_path, shift, late):
    copy(tmp_path / 'log', ('imu/data_raw', 'sonar/range'), shift, late=late)
    join.join(tmp_path / 'log', take, tmp_path / 'joined')
    joined = read_bag(tmp_path / 'joined')
    poses, imu = joined['optitrack/pose'], joined['imu/data_raw']
    assert float(joined.metadata['join']['offset_s']) == pytest.approx(
        shift * 1e-9 + BEGAN, abs=2e-3)
    assert len(poses) == len(read_bag(take)['optitrack/pose'])
    assert (poses.log_time - poses.stamp == late).all()
    assert (imu.log_time - imu.stamp == late).all()
    assert poses.stamp.min() >= imu.stamp[0] and poses.stamp.max() <= imu.stamp[-1]


def test_poses_before_the_flight_are_left_out(take, tmp_path):
    copy(tmp_path / 'log', ('imu/data_raw', 'sonar/range'), 40 * 10**9)
    end = read_bag(tmp_path / 'log')['imu/data_raw'].t[-1]
    said = join.join(tmp_path / 'log', take, tmp_path / 'joined', 39.0)
    assert '120 outside of the flight left out' in said  # 1 s at 120 Hz
    with pytest.raises(BagError, match=r'its stamps then are 0\.01 to .* s, those of the '
                                       rf'flight 40\.00 to {end:.2f} s$'):
        join.join(tmp_path / 'log', take, tmp_path / 'other', 0.0)


@pytest.mark.parametrize('offset', [None, BEGAN, BEGAN + 1.0])
def test_a_doubt_about_the_axes_of_the_body_is_printed(log, take, tmp_path, monkeypatch, offset):
    monkeypatch.setattr(join, 'find_clock', lambda *_: join.Clock(
        BEGAN, 0.001, 'roll rate', doubt='the tracked body is turned'))
    said = join.join(log, take, tmp_path / 'joined', offset)
    assert said.count(f'warning: {take}: the tracked body is turned\n') == 1


def test_a_capture_that_hardly_moves_is_told(log, take, tmp_path, monkeypatch):
    def small(bag, name, read=motion.read):
        found = read(bag, name)
        return dataclasses.replace(found, position=0.001 * found.position)
    monkeypatch.setattr(join.motion, 'read', small)  # metres that were imported as millimetres
    assert (f'warning: {take}: optitrack/pose: the positions stay within 0.00') in join.join(
        log, take, tmp_path / 'joined')


def test_an_offset_for_another_flight_is_not_confirmed(log, take, tmp_path, monkeypatch):
    def differ(*_):
        raise AlignError('the signals differ: another flight; or give --offset SECONDS')
    monkeypatch.setattr(join, 'find_clock', differ)
    assert ('warning: nothing confirms the given offset: the signals differ: another flight\n'
            in join.join(log, take, tmp_path / 'joined', BEGAN))


def test_what_is_joined_can_be_asked_for_the_drift(log, take, tmp_path, capsys):
    join.join(log, take, tmp_path / 'joined')
    assert identify_drift.main([str(tmp_path / 'joined')]) == 0
    assert 'probability of each mechanism, alone or in a pair' in capsys.readouterr().out


@pytest.mark.parametrize('own', ['estimate/odom', 'onboard/odom'])
@pytest.mark.parametrize('change, said', [
    ([1.0, 1.0, -1.0], 'falls where the drone rises'),
    ([1.0, -1.0, 1.0], 'mirror image'), ([0.5, 0.5, 1.0], '')])
def test_a_capture_is_compared_with_whatever_the_drone_says_of_itself(
        tmp_path, own, change, said):
    circle = read_bag(CIRCLE)
    poses, truth = circle['optitrack/pose'], circle['estimate/odom']
    with BagWriter(tmp_path / 'flight') as writer:
        out = Publisher(writer, {own: 'nav_msgs/msg/Odometry',
                                 'imu/data_raw': 'sensor_msgs/msg/Imu'})
        for stamp, p, q in zip(truth.stamp.tolist(), truth.position, truth.orientation):
            out.publish(own, stamp, 'odom', **out.odometry(
                out.pose(p, q), np.zeros(3), np.zeros(3)))
        imu = circle['imu/data_raw']
        for stamp, w, a in zip(imu.stamp.tolist(), imu.angular_velocity,
                               imu.linear_acceleration):
            out.publish('imu/data_raw', stamp, 'base_link', **out.imu(w, a))
    with BagWriter(tmp_path / 'take') as writer:
        out = Publisher(writer, {'optitrack/pose': 'geometry_msgs/msg/PoseStamped'})
        for stamp, p, q in zip(poses.stamp.tolist(), poses.position, poses.orientation):
            out.publish('optitrack/pose', stamp, 'map', pose=out.pose(p * change, q))
    arguments = tmp_path / 'flight', tmp_path / 'take', tmp_path / 'joined', 0.0
    if said:
        with pytest.raises(BagError, match=said):
            join.join(*arguments)
    else:
        assert 'warning: ' in join.join(*arguments)


def test_a_body_tracked_with_wrong_axes_is_told(log, take):
    bag, poses = read_bag(log), read_bag(take).messages('optitrack/pose')
    known = join.signals(bag, poses)
    turned = Rotation.from_quat(poses.orientation) * Rotation.from_euler('z', 90.0, degrees=True)
    poses._cache['pose.orientation'] = turned.as_quat()
    found = join.signals(bag, poses)
    np.testing.assert_allclose(found['turn rate'][3], known['turn rate'][3], atol=1e-9)
    np.testing.assert_allclose(found['roll rate'][3], known['pitch rate'][3], atol=1e-9)
    with pytest.raises(AlignError, match='wrong axes of the tracked body') as refused:
        join.find_clock(bag, poses)
    assert 'turn rate +2.49' in str(refused.value)  # how fast it turns has no axes
    assert 'pitch rate +2.9' in str(refused.value)


def test_the_take_of_another_flight_is_refused(log, tmp_path):
    bag = read_bag(CIRCLE)
    rng = np.random.default_rng(1)
    with BagWriter(tmp_path / 'other') as writer:
        writer.add_topic(POSE, 'geometry_msgs/msg/PoseStamped')
        order = rng.permutation(len(bag['optitrack/pose']) // 100)
        raw = np.array(bag['optitrack/pose'].raw, dtype=object)
        for stamp, data in zip(bag['optitrack/pose'].stamp.tolist(),
                               np.concatenate([raw[100 * i:100 * i + 100] for i in order])):
            writer.write(POSE, cdr.restamped(data, stamp), stamp)
    with pytest.raises(AlignError, match='--offset SECONDS'):
        join.join(log, tmp_path / 'other', tmp_path / 'joined')
    assert not (tmp_path / 'joined').exists()


def test_wrong_use_ends_in_one_line_and_leaves_no_bag(log, take, tmp_path, capsys):
    out = tmp_path / 'joined'
    for arguments, says in (
            ((CIRCLE, take, out), 'has /mambo/optitrack/pose already'),
            ((log, log, out), 'no topic /mambo/optitrack/pose'),
            ((log, take, out, '--offset', '100'), 'no pose is within the flight'),
            ((log, take, take), 'exists'),
            ((log, tmp_path / 'none', out), 'no such bag')):
        assert join.main([str(argument) for argument in arguments]) == 2
        error = capsys.readouterr().err
        assert error.startswith('join: ') and error.count('\n') == 1 and says in error
        assert not out.exists()


def test_a_stamp_is_written_in_the_byte_order_of_the_message():
    for order, flag in (('little', 1), ('big', 0)):
        data = cdr.restamped(bytes([0, flag, 0, 0]) + bytes(8) + b'rest', 3_000_000_007)
        assert int.from_bytes(data[4:8], order) == 3 and int.from_bytes(data[8:12], order) == 7
        assert data[12:] == b'rest'


def test_a_drone_without_gyro_sonar_and_pose_is_told_what_to_give(take, tmp_path):
    poor = copy(tmp_path / 'poor', ('optical_flow',))
    with pytest.raises(BagError, match='no gyro, sonar or pose of the drone'):
        join.join(poor, take, tmp_path / 'joined')


def test_the_standard_error_of_a_range_knows_that_a_range_is_late(log, take, tmp_path):
    poses = read_bag(take)['optitrack/pose']
    ranged = copy(tmp_path / 'ranged', ('sonar/range',))
    turned = copy(tmp_path / 'turned', ('imu/data_raw',))
    by_range, by_gyro = (join.find_clock(read_bag(path), poses) for path in (ranged, turned))
    assert by_range.source == 'height of height' and by_range.sigma >= join.RANGE_LATE
    assert abs(by_range.offset - BEGAN) < 1.96 * by_range.sigma
    assert 'height' not in by_gyro.source  # a log without a range is aligned as well
    assert by_gyro.offset == pytest.approx(BEGAN, abs=2e-3) and by_gyro.sigma < 1e-3
    assert join.find_clock(read_bag(log), poses).source.startswith(BODY_RATES)


def recorded_apart(seed, offset, seconds=20.0):
    """Return gyro and sonar of a random flight, and poses on a clock behind by ``offset`` s."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, seconds, 1e-3)

    def smooth(size, width=0.25):
        x = gaussian_filter1d(rng.standard_normal(len(fine)), width / 1e-3)
        return size * x / x.std()
    turns = Rotation.from_euler('ZYX', np.column_stack([smooth(0.4), smooth(0.1), smooth(0.1)]))
    height = 1.2 + smooth(0.3, 0.5)
    step = 5  # ms
    rates = (turns[:-step].inv() * turns[step:]).as_rotvec() / (1e-3 * step)
    rows = np.arange(0, len(fine) - step, step)
    gyro = rates[rows] + 0.02 * rng.standard_normal((len(rows), 3)) + [0.01, -0.02, 0.03]
    echo = np.arange(0, len(fine), 40)
    frames = np.arange(0, len(fine), 8)
    bag = {'imu/data_raw': SimpleNamespace(
        t=fine[rows] + 0.5e-3 * step, angular_velocity=gyro),
        'sonar/range': SimpleNamespace(
            t=fine[echo], range=height[echo] + 0.005 * rng.standard_normal(len(echo)),
            min_range=np.full(len(echo), 0.1), max_range=np.full(len(echo), 4.0))}
    wobble = Rotation.from_rotvec(1e-3 * rng.standard_normal((len(frames), 3)))
    poses = SimpleNamespace(
        t=fine[frames] - offset, orientation=(turns[frames] * wobble).as_quat(),
        position=np.column_stack([np.zeros((len(frames), 2)), height[frames]]))
    return bag, poses


@pytest.mark.long
def test_the_clock_is_as_sure_as_it_says_and_no_surer():
    """Over seeded flights: within 1.96 standard errors near 95 %, and the errors no smaller."""
    offsets = np.random.default_rng(0).uniform(-50.0, 50.0, 25)
    clocks = [join.find_clock(*recorded_apart(seed, offset))
              for seed, offset in enumerate(offsets)]
    assert all(clock.source.partition(' of ')[0] != 'height' for clock in clocks)
    z = np.array([(clock.offset - offset) / clock.sigma
                  for clock, offset in zip(clocks, offsets)])
    # 25 flights: the RMS of z is known to 14 %, so to 1.42 for honest errors; they are widened
    # where the four signals scatter, which makes it 0.65 here: errors twice as wide are seen
    assert 0.45 < np.sqrt(np.mean(z**2)) < 1.42
    assert np.mean(np.abs(z) < 1.96) >= 0.84  # 95 % less two and a half binomial deviations
    assert np.median([clock.sigma for clock in clocks]) < 1e-3


def test_a_range_alone_is_no_surer_than_it_may_be_late():
    bag, poses = recorded_apart(3, 7.0)
    clock = join.find_clock({'sonar/range': bag['sonar/range']}, poses)
    assert clock.offset == pytest.approx(7.0, abs=0.01)
    assert clock.sigma >= 0.03 and clock.source == 'height of height'


def moved(poses, t):
    return SimpleNamespace(**{**vars(poses), 't': t})


@pytest.mark.parametrize('seed', range(4))
def test_a_clock_that_jumps_or_runs_at_another_rate_is_refused(seed):
    bag, poses = recorded_apart(seed, 7.0)
    t = poses.t
    with pytest.raises(AlignError, match=r'the clocks jump: the offset is \+[67].* and \+6.*cut'):
        join.find_clock(bag, moved(poses, t + 0.15 * (t > t[0] + 10.0)))
    with pytest.raises(AlignError, match='the clock .* runs (1|0.9.?|1.1) % too fast'):
        join.find_clock(bag, moved(poses, t[0] + 1.01 * (t - t[0])))
    with pytest.raises(AlignError, match='the clock .* runs (1|0.9.?|1.1) % too slow'):
        join.find_clock(bag, moved(poses, t[0] + 0.99 * (t - t[0])))


def test_a_small_drift_of_the_clock_widens_the_interval():
    bag, poses = recorded_apart(1, 7.0)
    plain = join.find_clock(bag, poses)
    drifting = join.find_clock(bag, moved(poses, poses.t[0] + 1.001 * (poses.t - poses.t[0])))
    assert plain.sigma < 1e-3
    # 20 ms in 20 s, evenly: a standard deviation of 20 / sqrt(12)
    assert drifting.sigma == pytest.approx(20e-3 / np.sqrt(12.0), rel=0.3)


def test_what_is_not_used_is_printed_with_the_reason(tmp_path, take):
    log = copy(tmp_path / 'log', ('imu/data_raw', 'sonar/range'))
    poses = read_bag(take)[POSE]
    message = join.join(log, take, tmp_path / 'joined')
    assert '\nnot used, yaw rate: ' in message
    assert [one.partition(':')[0] for one in join.find_clock(read_bag(log), poses).unused] == [
        'yaw rate']


def test_signals_that_disagree_are_told():
    bag, poses = recorded_apart(4, 0.0)
    sonar = bag['sonar/range']
    bag['sonar/range'] = SimpleNamespace(**{**vars(sonar), 't': sonar.t + 0.4})
    with pytest.raises(AlignError, match='the signals give different clock offsets .*height'):
        join.find_clock(bag, poses)


def test_without_a_signal_it_says_what_to_give():
    _, poses = recorded_apart(5, 0.0, 5.0)
    with pytest.raises(AlignError, match='no gyro, sonar or pose of the drone.*--offset SECONDS'):
        join.find_clock({}, poses)


def test_the_range_of_a_short_flight_agrees_although_it_begins_at_the_shortest(tmp_path, take):
    """While the floor is too near the range stays: the rise seems 0.2 s late and a third less."""
    log = copy(tmp_path / 'log', ('imu/data_raw', 'sonar/range'), end=5.0e9)
    bag, poses = read_bag(log), motion.read(read_bag(take), POSE)
    found, reasons = join.offsets(join.signals(bag, poses))
    assert found['height'].offset == pytest.approx(BEGAN, abs=0.02)  # half a period of the sonar
    assert found['height'].factor == pytest.approx(1.0, abs=0.05)
    assert join.find_clock(bag, poses).offset == pytest.approx(BEGAN, abs=0.02)


@pytest.mark.parametrize('names, factor, said', [
    (BODY_RATES, 57.3, 'one of them is not in SI units'), (('height',), 100.0, 'not in SI units'),
    (('height',), 0.7, None)])
def test_a_log_in_another_unit_is_told_and_a_cut_off_range_left_out(
        log, take, monkeypatch, names, factor, said):
    bag, poses, plain = read_bag(log), motion.read(read_bag(take), POSE), join.signals

    def other_unit(*recordings):
        return {name: (t, values * factor if name in names else values, *rest)
                for name, (t, values, *rest) in plain(*recordings).items()}
    monkeypatch.setattr(join, 'signals', other_unit)
    if said is None:
        assert 'height' not in join.find_clock(bag, poses).source
    else:
        with pytest.raises(AlignError, match=said):
            join.find_clock(bag, poses)


@pytest.mark.parametrize('change, said', [
    (0.01, 'not in SI units'), ([1.0, 1.0, -1.0], 'yaw rate: .* turn differently')])
def test_a_gyro_that_gives_no_clock_is_compared_all_the_same(change, said):
    """Too small a one does not turn enough to be aligned by; the height gives the clock."""
    bag, poses = recorded_apart(3, 7.0)
    imu = bag['imu/data_raw']
    bag['imu/data_raw'] = SimpleNamespace(t=imu.t, angular_velocity=imu.angular_velocity * change)
    with pytest.raises(AlignError, match=said):
        join.find_clock(bag, poses)


@pytest.mark.parametrize('degrees', [5.0, 20.0, -35.0])
def test_a_body_that_is_turned_a_little_is_told(degrees):
    bag, poses = recorded_apart(3, 7.0)
    turn = Rotation.from_euler('z', degrees, degrees=True)
    poses.orientation = (Rotation.from_quat(poses.orientation) * turn).as_quat()
    clock = join.find_clock(bag, poses)
    assert clock.offset == pytest.approx(7.0, abs=0.02)
    found = re.search(r'the tracked body is turned by (.*) deg about z against the gyro', (
        clock.doubt))
    assert bool(found) is (abs(degrees) > 12.0)  # 0.21 rad, gyro_check.ASKEW
    assert not found or float(found[1]) == pytest.approx(degrees, abs=3.0)


def test_a_gyro_that_turns_after_the_motors_stop_is_no_contradiction():
    """A drone that is carried away, as on a public flight of a Crazyflie."""
    bag, poses = recorded_apart(6, 2.0)
    gyro = bag['imu/data_raw']
    late = gyro.t > 18.0
    gyro.angular_velocity[late, 2] = 25.0 * np.sin(4.0 * gyro.t[late])
    with pytest.raises(AlignError, match='yaw rate'):
        join.find_clock(bag, poses)
    pwm = np.where(np.arange(0.0, 20.0, 0.1)[:, None] < 17.0, 100.0, np.zeros(4))
    bag['motor_pwm'] = SimpleNamespace(t=np.arange(0.0, 20.0, 0.1), pwm=pwm)
    assert join.find_clock(bag, poses).offset == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize('change', [[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], None])
def test_a_mirrored_capture_is_refused(change):
    t = np.arange(0.0, 12.0, 0.01)
    stamps = np.round(t * 1e9).astype(np.int64)
    path = np.stack([0.5 * np.cos(t) + 0.05 * t, 0.5 * np.sin(t), 1.0 + 0.0 * t], axis=1)
    unknown = np.full((len(t), 4), np.nan)
    own = motion.Motion('onboard/odom', stamps, path + [3.0, 1.0, 0.0], unknown)
    seen = motion.Motion('optitrack/pose', stamps - 5_000_000_000, path, unknown)
    assert join._check_path(Path('take'), own, seen, 5_000_000_000) == ''
    larger = dataclasses.replace(seen, position=1.5 * path)
    assert join._check_path(Path('take'), own, larger, 5_000_000_000) == (
        'warning: take: the path in the motion capture is 1.5 times as large as the one that the '
        'drone estimates: its unit, or the scale of the optical flow, is wrong\n')
    climb = path + np.outer(np.sin(0.8 * t), [0.0, 0.0, 0.3])
    rising = dataclasses.replace(own, position=climb + [3.0, 1.0, 0.0])
    assert join._check_path(Path('take'), rising, dataclasses.replace(
        seen, position=climb), 5_000_000_000) == ''
    with pytest.raises(BagError, match='take: the motion capture falls where the drone rises'):
        join._check_path(Path('take'), rising, dataclasses.replace(
            seen, position=climb * [1.0, 1.0, -1.0]), 5_000_000_000)
    seen = dataclasses.replace(seen, position=path * change if change else path[:, [1, 0, 2]])
    with pytest.raises(BagError, match='take: the motion capture shows the mirror image .* axes'):
        join._check_path(Path('take'), own, seen, 5_000_000_000)


@pytest.mark.parametrize('degrees', [0.0, 40.0, 180.0])
def test_positions_that_are_turned_against_the_attitude_are_told(degrees):
    t = np.arange(0.0, 20.0, 0.01)
    stamps = np.round(t * 1e9).astype(np.int64)
    path = np.stack([np.sin(0.8 * t), 0.6 * np.sin(1.6 * t), 1.0 + 0.0 * t], axis=1)
    yaw = np.tile(Rotation.from_euler('z', 0.3).as_quat(), (len(t), 1))
    own = motion.Motion('onboard/odom', stamps, path, yaw)
    seen = motion.Motion('optitrack/pose', stamps - 5_000_000_000, Rotation.from_euler(
        'z', degrees, degrees=True).apply(path), yaw)
    said = join._check_path(Path('take'), own, seen, 5_000_000_000)
    assert not said if degrees == 0.0 else said.startswith(
        'warning: take: the positions of the motion capture are turned by ')


def test_a_capture_that_contradicts_the_gyro_at_the_offset_found_is_refused(
        log, take, tmp_path, monkeypatch, capsys):
    """As by one axis that is alike by chance: the offset of another flight, here 1.5 s wrong."""
    wrong = join.Clock(BEGAN + 1.5, 0.002, 'pitch rate of pitch rate')
    monkeypatch.setattr(join, 'find_clock', lambda *_: wrong)
    arguments = [str(log), str(take), str(tmp_path / 'joined')]
    assert join.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'do not turn alike' in error
    assert 'at +4.000 s, the offset by pitch rate of pitch rate' in error
    assert error.endswith('or give --offset 4.000 to join it all the same\n')
    assert not (tmp_path / 'joined').exists()
    assert join.main([*arguments, '--offset', '4.000']) == 0
    assert re.search(f'warning: {take}: gyro and .* do not turn alike .*: is it of another flight',
                     capsys.readouterr().out)


def test_a_capture_of_another_height_is_told_beside_a_gyro_that_agrees(
        log, take, tmp_path, monkeypatch):
    def bobbing(bag, name, read=motion.read):
        found = read(bag, name)
        return dataclasses.replace(found, position=found.position + np.outer(
            np.sin(2.0 * found.t), [0.0, 0.0, 0.3]))
    assert 'warning' not in join.join(log, take, tmp_path / 'right')
    monkeypatch.setattr(join.motion, 'read', bobbing)
    assert f'warning: {take}: the range does not follow the height of optitrack/pose' in (
        join.join(log, take, tmp_path / 'joined'))
