"""Two bags of one motion: known offsets, turns and delays come out, and what lacks is said."""

import csv
import dataclasses
import json
import math
from pathlib import Path

from mambo_analysis.compare import pair, report, tables
from mambo_analysis.compare.compare import compare, compare_bags, main
from mambo_analysis.importers.checks import same_flight
from mambo_analysis.importers.common import Publisher, read_source
from mambo_analysis.importers.mat_file import variables
from mambo_analysis.importers.minidrone import read_log
from mambo_bags.reader import BagError, read_bag
from mambo_bags.writer import BagWriter
from mambo_model.motion.rigid_body import State
from mambo_ros import messages
from mambo_signals import metrics, motion
from mambo_signals.flight_phases import detect_phases, Phases, phases
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from synthetic import LANDING, make_flight, Maker, STEP, truth_position

TOPICS = ('optitrack/pose', 'estimate/odom')
REAL = sorted((Path(__file__).resolve().parents[5] / 'shared' / 'data'
               / 'rolling_spider_flights').glob('*.mat'))
needs_data = pytest.mark.skipif(
    not REAL, reason='flight logs are not beside the repo (../shared/data)')


def flown(path, topics=('estimate/odom',), offset=0.0, turn=0.0, shift=(0.0, 0.0, 0.0),
          late=0.0, seconds=18.0, attitude=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)):
    """Write the motion of the synthetic flight: clock behind by offset, frame turned, late."""
    maker, rotation = Maker(path, topics, attachments={}), Rotation.from_euler('z', turn)
    q = (rotation * Rotation.from_euler('ZYX', attitude, degrees=True)).as_quat()
    for step in range(round(seconds * 200)):
        p = rotation.apply(truth_position(step * 0.005 - late)) + shift
        ns = step * STEP - round(offset * 1e9) + 10**10
        for topic in topics:
            if topic == 'optitrack/pose':
                maker.write(topic, ns, pose=maker.pose(p, q))
            else:
                maker.odometry(topic, ns, p, q, velocity)
    maker.writer.close()
    return read_bag(path)


def rows(result, quantity):
    section, = [entry for entry in result['errors'] if entry['quantity'] == quantity]
    return {row['part']: row for row in section['rows']}


@pytest.fixture(scope='module')
def flights(tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    return (flown(folder / 'a', offset=3.2, turn=0.7, shift=(1.0, -2.0, 0.1)),
            flown(folder / 'b'))


@pytest.mark.long
def test_clock_turn_and_shift_of_a_second_recording_are_taken_out(flights):
    result, _, alignment = compare_bags(*flights)
    assert alignment.offset * 1e-9 == pytest.approx(3.2, abs=2e-3)
    assert alignment.turn == pytest.approx(-0.7, abs=2e-3)
    # 2 ms of clock at 1 m/s
    assert rows(result, 'position')['whole flight']['rms_total'] < 3e-3
    assert 'clock moved by +3.2' in result['notes'][0]


def test_only_what_is_asked_for_is_aligned(flights):
    result, _, alignment = compare_bags(*flights, what=('time',))
    assert (alignment.turn, alignment.shift) == (0.0, (0.0, 0.0, 0.0))
    # the floor is 0.1 m higher in A, and a turn about the vertical leaves heights alone
    assert rows(result, 'position')['whole flight']['rms'][2] == pytest.approx(0.1, abs=3e-3)


def test_positions_are_made_equal_some_time_after_take_off(flights):
    result, comparison, _ = compare_bags(*flights, what=('time',), equal_at=6.0)
    error, seen = comparison['position'], detect_phases(motion.read(flights[1], 'estimate/odom'))
    at = np.abs(error.stamps - (seen.liftoff + 6_000_000_000)).argmin()
    # equal on the mean of 0.1 s, over which the turned path moves on by 0.07 m
    assert np.linalg.norm(error.error[at]) < 5e-3
    assert rows(result, 'position')['after take-off']['rms_total'] > 0.3


@pytest.mark.long
def test_the_delay_of_one_signal_behind_another_is_found_on_each_axis(tmp_path):
    a, b = flown(tmp_path / 'a', late=0.137), flown(tmp_path / 'b')
    result, _, _ = compare_bags(a, b, what=())
    row = rows(result, 'position')['after take-off']
    assert row['delay'][:2] == pytest.approx([0.137] * 2, abs=2e-3)
    assert rows(compare_bags(b, a, what=())[0], 'position')[
        'after take-off']['delay'][0] == pytest.approx(-0.137, abs=2e-3)


def test_signals_that_do_not_move_or_do_not_agree_have_no_delay():
    t = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(1)
    assert np.isnan(metrics.delay(np.ones(len(t)), np.sin(t), 0.01))
    assert np.isnan(metrics.delay(rng.standard_normal(len(t)), np.sin(t), 0.01))
    assert metrics.delay(np.sin(t - 0.2), np.sin(t), 0.01) == pytest.approx(0.2, abs=1e-4)


def test_running_rms_counts_time_and_not_samples():
    stamps = np.concatenate([np.arange(0, 100), np.arange(100, 200, 10)]) * 10_000_000
    errors = np.where(stamps < 10**9, 0.0, 2.0)[:, None]
    assert metrics.running_rms(stamps, errors)[-1] == pytest.approx(np.sqrt(2.0), abs=1e-12)
    errors[5] = np.nan
    assert np.isfinite(metrics.running_rms(stamps, errors)).all()


def test_drift_is_the_last_error_that_is_known():
    errors = np.array([[1.0, 2.0], [3.0, 4.0], [np.nan, 5.0]])
    np.testing.assert_array_equal(metrics.drift(errors), [3.0, 4.0])
    assert np.isnan(metrics.drift(errors[2:])).all()


def test_attitude_error_is_the_rotation_between_the_two(tmp_path):
    angles = (170.0, 40.0, -30.0)
    a = flown(tmp_path / 'a', attitude=angles, seconds=4.0)
    b = flown(tmp_path / 'b', attitude=(-150.0, 10.0, 20.0), seconds=4.0)
    result, comparison, _ = compare_bags(a, b, what=())
    here, there = (Rotation.from_euler('ZYX', e, degrees=True)
                   for e in (angles, (-150.0, 10.0, 20.0)))
    expected = np.degrees((there.inv() * here).as_rotvec())
    np.testing.assert_allclose(comparison['attitude'].error[100], expected, atol=1e-9)
    assert rows(result, 'attitude')['whole flight']['rms_total'] == pytest.approx(
        np.linalg.norm(expected))


def test_velocity_of_the_body_is_compared_in_the_world(tmp_path):
    a = flown(tmp_path / 'a', attitude=(90.0, 0.0, 0.0), velocity=(1.0, 0.0, 0.0), seconds=2.0)
    b = flown(tmp_path / 'b', seconds=2.0)
    _, comparison, _ = compare_bags(a, b, what=())
    np.testing.assert_allclose(comparison['velocity'].error[50], [0.0, 1.0, 0.0], atol=1e-12)


def test_take_off_and_landing_are_found_in_the_height(tmp_path):
    seen = detect_phases(motion.read(flown(tmp_path / 'a', seconds=22.0), 'estimate/odom'))
    start = 10.0  # of the clock of these bags
    # climbs from 1 s to 4 s, slower than 0.1 m/s for half a second at 4.4 s, sinks from 16 s
    assert seen.takeoff_end * 1e-9 - start == pytest.approx(4.0, abs=0.2)
    assert seen.landing_start * 1e-9 - start == pytest.approx(LANDING, abs=0.2)
    assert seen.liftoff * 1e-9 - start == pytest.approx(1.0, abs=0.3)


def test_topics_are_the_ones_asked_for_or_the_best_of_both(tmp_path):
    a, b = flown(tmp_path / 'a', TOPICS, seconds=4.0), flown(tmp_path / 'b', seconds=4.0)
    assert compare_bags(a, b, what=())[0]['compared'] == ['estimate/odom'] * 2
    result = compare_bags(a, b, 'optitrack/pose', what=())[0]
    assert result['compared'] == ['optitrack/pose', 'estimate/odom']
    assert any('no velocity' in note for note in result['notes'])
    assert compare_bags(a, None, 'estimate/odom')[0]['compared'] == [
        'estimate/odom', 'optitrack/pose']


@pytest.mark.long
def test_two_simulated_flights_share_clock_and_frame(tmp_path):
    a, b = (read_bag(make_flight(tmp_path / name, 9.0)) for name in 'ab')
    result, _, alignment = compare_bags(a, b)
    assert alignment == pair.Alignment()
    assert 'both flew the same reference' in result['notes']
    assert [entry['quantity'] for entry in result['errors']] == [
        'position', 'velocity', 'attitude', 'PWM']
    for entry in result['errors']:
        assert entry['rows'][0]['maximum_total'] == 0.0
    assert result['takeoff_end'] == 8.0


@pytest.mark.parametrize(('arguments', 'text'), [
    (['A', 'FAR', '--no-align'], 'no time in common'),
    (['A', 'SHORT', '--no-align'], 'has 1 usable sample of 1; two are needed'),
    (['A', 'NAN', '--no-align'], 'has 0 usable samples of 9; two are needed'),
    (['A', 'MUTE', '--no-align'], 'no topic with a motion'),
    (['A', 'FOREIGN'], 'not an MCAP file'),
    (['A', 'B', '--align', 'time,colour'], "'colour' is none of time, position, yaw"),
    (['A', 'B', '--a-topic', 'motor_pwm'], 'no topic'),
    (['A', 'B', '--no-align', '--equal-at', '6'], '--no-align contradicts'),
    (['A', 'B', '--no-align', '--html', 'A/metadata.yaml/x.html'], 'cannot be written'),
    (['A', 'B', '--no-align', '--csv', 'A/metadata.yaml/x.csv'], 'cannot be written'),
    (['A', '--a-topic', 'estimate/odom'], 'no topic with a motion')])
def test_what_cannot_be_compared_ends_in_one_line(tmp_path, monkeypatch, capsys, arguments, text):
    monkeypatch.chdir(tmp_path)
    flown('A', seconds=2.0), flown('B', seconds=2.0)
    flown('FAR', seconds=2.0, offset=-100.0), flown('SHORT', seconds=0.005)
    flown('NAN', seconds=0.045, shift=(np.nan, 0.0, 0.0))
    maker = Maker('MUTE', ('motor_pwm',))
    maker.write('motor_pwm', 0)
    maker.writer.close()
    (tmp_path / 'FOREIGN').write_text('no bag')
    try:
        code = main(arguments)
    except SystemExit as end:  # before anything is read
        code = end.code
    error = capsys.readouterr().err
    assert code == 2 and error.startswith('compare: ') and text in error and error.count('\n') == 1


def test_numbers_as_table_csv_and_json_agree(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    flown('A', late=0.1), flown('B')
    assert main(['A', 'B', '--no-align', '--csv', 'n.csv']) == 0
    text = capsys.readouterr().out
    assert main(['A', 'B', '--no-align', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    row = result['errors'][0]['rows'][0]
    assert f'{row["rms_total"]:.4f}' in text and 'numbers: n.csv' in text
    with open('n.csv', newline='') as file:
        lines = [line for line in csv.DictReader(file)
                 if (line['quantity'], line['part'], line['axis'])
                 == ('position', 'whole flight', 'total')]
    assert float(lines[0]['rms']) == row['rms_total']
    assert float(lines[0]['final_drift']) == row['drift_total']


def test_a_topic_is_a_data_frame_with_the_stamp_as_index(tmp_path):
    bag = flown(tmp_path / 'a', seconds=1.0)
    frame = bag['estimate/odom'].to_pandas()
    assert frame.index.name == 't' and frame.index[0] == 10.0
    np.testing.assert_array_equal(
        frame[[f'pose.pose.position.{axis}' for axis in 'xyz']], bag['estimate/odom'].position)
    assert frame['pose.covariance[35]'].eq(0.0).all()
    assert set(frame['child_frame_id']) == {'base_link'}


def test_a_turn_that_neither_path_nor_attitude_tells_is_said():
    stamps = np.arange(10) * STEP
    still = motion.Motion('x', stamps, np.zeros((10, 3)), np.full((10, 4), np.nan))
    with pytest.raises(BagError, match='take yaw out of --align'):
        pair.aligned(still, still, ('yaw',))


T = np.arange(1000) * 0.005


def moving(path, yaw=None, name='a'):
    """Return a motion along a path, (1000, 3), with one yaw; None: without attitude."""
    q = (np.full(4, np.nan) if yaw is None else Rotation.from_euler('z', yaw).as_quat())
    return motion.Motion(name, np.arange(1000) * STEP, path, np.tile(q, (1000, 1)))


SMALL = 0.01 * np.column_stack([np.sin(T), np.cos(2.0 * T), 0.0 * T])
OTHER = 0.01 * np.column_stack([np.sin(T + 0.3), np.cos(2.0 * T + 0.5), 0.0 * T])
# an error of 0.5 cm leaves a standard error of 3.3 deg
NEAR = Rotation.from_euler('z', 0.7).apply(SMALL + 0.005 * np.column_stack(
    [np.sin(5.0 * T), np.cos(6.3 * T), 0.0 * T]))


def test_a_path_too_small_to_tell_the_turn_gives_way_to_the_attitudes():
    found = pair.aligned(moving(SMALL, 0.1), moving(OTHER, 0.3, 'b'), ('yaw',))
    assert found.turn == pytest.approx(0.2, abs=1e-9)
    assert 'turned by +11.46 deg (by the attitudes, as the paths are too small' in found.text
    assert 'right only if both attitudes are of the same body axes)' in found.text
    far = Rotation.from_euler('z', 0.7).apply(SMALL) + 0.1 * OTHER
    found = pair.aligned(moving(SMALL, 0.1), moving(far, 0.3, 'b'), ('yaw',))
    assert found.turn == pytest.approx(0.7, abs=0.1)
    assert '(by the paths, standard error ' in found.text
    # nobody knows which is right: a circle looks the same at another time
    assert f'; {math.degrees(found.turn - 0.2):.0f} deg from the turn of the attitudes: ' in (
        found.text)
    agreed = pair.aligned(moving(SMALL, 0.1), moving(far, 0.75, 'b'), ('yaw',))
    assert agreed.turn == found.turn and 'attitudes' not in agreed.text


@pytest.mark.parametrize(('change', 'said'), [
    ((1.0, 1.0), None), ((1.0, -1.0), 'shows the mirror image of the path'),
    ((1.4, 1.4), '1.4 times as large')])
def test_a_capture_that_contradicts_the_path_of_the_drone_is_told(change, said):
    t = 0.01 * np.arange(1000)
    path = np.stack([np.cos(t), np.sin(2.0 * t), 0.0 * t], axis=1)
    found = pair._contradictions(moving(path), moving(path * (*change, 1.0)))
    assert len(found) == bool(said) and (not said or said in found[0])


@pytest.mark.parametrize('frame', ['map', 'odom'])
@pytest.mark.parametrize('degrees', [0.0, 40.0])
def test_positions_that_are_turned_against_the_attitude_are_told(tmp_path, degrees, frame):
    yaw = (0.0, 0.0, math.sin(0.15), math.cos(0.15))
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'optitrack/pose': 'geometry_msgs/msg/PoseStamped',
                                 'onboard/odom': 'nav_msgs/msg/Odometry'})
        for i in range(600):
            p = np.array([math.sin(0.016 * i), 0.6 * math.sin(0.032 * i), 1.0])
            seen = Rotation.from_euler('z', degrees, degrees=True).apply(p)
            out.publish('onboard/odom', i * 20_000_000, 'odom', **out.odometry(
                out.pose(p, yaw), np.zeros(3), np.zeros(3)))
            out.publish('optitrack/pose', i * 20_000_000, frame, pose=out.pose(seen, yaw))
    bag, notes = read_bag(tmp_path / 'bag'), []
    pair._between(bag, 'onboard/odom', 'optitrack/pose', 'error', None, notes)
    told = [line for line in notes if 'turned by +40 deg about z against its attitude' in line]
    assert len(told) == (degrees != 0.0), notes


@pytest.mark.parametrize('names, told', [
    (('map',), False), (('map', ''), False), (('map', 'lab'), True)])
def test_poses_of_several_frames_in_one_topic_are_told(tmp_path, names, told):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {'optitrack/pose': 'geometry_msgs/msg/PoseStamped'})
        for i in range(10):
            out.publish('optitrack/pose', i * 10_000_000, names[i % len(names)],
                        pose=out.pose((0.01 * i, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)))
    found = motion.read(read_bag(tmp_path / 'bag'), 'optitrack/pose')
    assert found.frame == 'map'
    assert pair.left_out((found,)) == ([
        "optitrack/pose: its poses are in 2 frames, frame_id 'lab', 'map': they are compared as "
        'if in one'] if told else [])


@pytest.mark.parametrize('nothing', [None, 0.0])
def test_the_identity_and_no_attitude_tell_no_turn(nothing):
    found = pair.aligned(moving(SMALL, nothing), moving(NEAR, 0.3, 'b'), ('yaw',))
    sigma = float(found.text.partition('standard error ')[2].partition(' deg')[0])
    assert sigma == pytest.approx(3.3, abs=0.1)
    assert found.turn == pytest.approx(0.7, abs=3.0 * np.radians(sigma))
    assert 'deg; a of A measured no attitude that could tell it better)' in found.text
    with pytest.raises(BagError, match='^no yaw found: .*; b of B measured no attitude; take yaw'):
        pair.aligned(moving(SMALL, 0.1), moving(OTHER, nothing, 'b'), ('yaw',))


def test_a_bag_of_which_every_message_is_doubled_is_remarked(flights, tmp_path):
    maker = Maker(tmp_path / 'twice', ('estimate/odom',), attachments={})
    for step in range(3600):
        for _ in range(2):
            maker.odometry('estimate/odom', step * STEP + 10**10, truth_position(step * 0.005),
                           (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    maker.writer.close()
    twice = read_bag(tmp_path / 'twice')
    told = '/mambo/estimate/odom: 3600 of 7200 messages repeat the stamp of another'
    assert any(note.startswith(f'A: {told}') for note in compare_bags(
        twice, flights[1], what=())[0]['notes'])
    assert not any('repeat' in note for note in compare_bags(*flights)[0]['notes'])


class FramedMaker(Maker):
    """Names the frame of a motion capture otherwise than that of an estimate."""

    def message(self, topic, ns, frame='odom', **fields):
        return super().message(topic, ns, 'map' if topic == 'optitrack/pose' else frame, **fields)


def tracked(path, begin, origin, late_height=0.0):
    """Write poses, and an estimate whose origin is where it began; floors may be found later."""
    maker = FramedMaker(path, TOPICS, attachments={})
    start = truth_position(begin)
    for step in range(round(begin * 200), 3000):
        p = truth_position(step * 0.005)
        ns = step * STEP
        maker.write('optitrack/pose', ns, pose=maker.pose(p + origin))
        own = p - start
        if step * 0.005 > begin + late_height > begin:
            own[2] = p[2]
        maker.odometry('estimate/odom', ns, own + [0.0, 0.0, 0.01])
    maker.writer.close()
    return read_bag(path)


@pytest.mark.parametrize(('begin', 'late'), [(0.0, 0.0), (9.0, 0.0), (9.0, 0.5)])
def test_an_estimate_that_begins_in_the_air_has_no_error_of_its_altitude(tmp_path, begin, late):
    result = compare(tracked(tmp_path / 'b', begin, np.array([3.0, -2.0, 0.4]), late))
    entry, = result['errors']
    row, note = entry['rows'][0], ' '.join(result['notes'])
    assert row['rms'][0] < 0.01 and row['rms'][1] < 0.01
    assert row['drift'][2] == pytest.approx(0.0, abs=0.011)
    assert 'estimate/odom has an origin of its own' in note
    assert ('begins in the air: height made equal in the median' in note) == (begin > 0.0)


@needs_data
@pytest.mark.parametrize('name', ['exampleflight', 'p9_trial4', 'speed1', 'square_1'])
def test_a_real_log_that_begins_in_flight_begins_in_the_air_wherever_it_was_cut(name):
    path = next(one for one in REAL if name in one.stem)
    log = read_log(read_source(path), variables(path, path.read_bytes()))
    position = log.columns('X', 'Y', 'Z') * [1.0, -1.0, -1.0]
    stamps = STEP * np.arange(len(log))

    def begins(first):
        return pair.begins_in_air(motion.Motion(
            'onboard/odom', stamps[first:], position[first:],
            np.tile([0.0, 0.0, 0.0, 1.0], (len(log) - first, 1))), stamps[first])
    assert not begins(0)
    assert all(begins(first) for first in range(400, len(log) - 600, 100))


def test_what_lands_and_takes_off_again_begins_in_the_air():
    t = np.arange(0.0, 20.0, 0.01)
    height = np.interp(t, [0.0, 2.0, 4.0, 8.0, 10.0], [0.6, 0.6, 0.0, 0.0, 2.0])
    stamps = np.rint(t * 1e9).astype(np.int64)
    one = motion.Motion('optitrack/pose', stamps, np.column_stack([0.0 * t, 0.0 * t, height]),
                        np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)))
    assert pair.begins_in_air(one, stamps[0])
    assert not pair.begins_in_air(one, stamps[500])
    assert pair.begins_in_air(one, stamps[1000])


def test_a_part_of_too_few_samples_has_no_statistics(flights):
    _, comparison, _ = compare_bags(*flights)
    quantity = comparison['position']
    for few, expected_text in ((1, '1 sample: too few'), (9, '9 samples: too few'), (10, None)):
        stamp = quantity.stamps[np.flatnonzero(np.isfinite(quantity.error[:, 0]))[-few]]
        entry = pair.section(quantity, 'x', Phases(int(stamp), None, ''))
        parts = {row['part'] for row in entry['rows']}
        assert ('after take-off' in parts) == (expected_text is None)
        assert tables.main_row(entry)['part'] == (
            'after take-off' if expected_text is None else 'whole flight')
        if expected_text:
            assert f'after take-off    {expected_text}' in '\n'.join(tables.section(entry))


def resting(path, seed):
    """Write what a motion capture says of a vehicle on the floor."""
    rng = np.random.default_rng(seed)
    maker = Maker(path, ('optitrack/pose',), attachments={})
    wander = np.cumsum(rng.normal(size=(2000, 3)), axis=0) * 1e-5
    turns = Rotation.from_rotvec(1e-3 * rng.normal(size=(2000, 3))).as_quat()
    for step, p in enumerate(wander + 1e-4 * rng.normal(size=(2000, 3))):
        maker.write('optitrack/pose', step * 2 * STEP, pose=maker.pose(p, turns[step]))
    maker.writer.close()
    return read_bag(path)


def test_recordings_that_never_leave_the_floor_keep_their_clocks(tmp_path):
    result, _, alignment = compare_bags(resting(tmp_path / 'a', 1), resting(tmp_path / 'b', 2))
    assert alignment.offset == 0
    assert 'clocks taken as they are, as no motion tells their offset' in result['notes'][0]
    assert 'height: it changes by 0.00' in result['notes'][0]


def test_signals_that_disagree_about_the_clocks_align_nothing(tmp_path):
    t = np.arange(0.0, 18.0, 0.01)
    p, q = truth_position(t), np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))
    p[:, 0] += 0.3 * np.sin(0.7 * t * t)
    a = motion.Motion('a', np.rint(t * 1e9).astype(int), p, q)
    p = p.copy()
    p[:, 2] = truth_position(t - 0.4)[:, 2]
    b = motion.Motion('b', a.stamps, p, q)
    with pytest.raises(BagError, match='signals give different clock offsets.*take time out'):
        pair.aligned(a, b)


def test_a_small_difference_is_no_staircase_on_the_page(flights):
    result, comparison, alignment = compare_bags(*flights, what=('time',))
    page = report.of_two(*flights, result, comparison, alignment)
    figure, = [one for one in page.figures if one.title == 'Position error']
    shown = report._figure_data(figure)['panels'][0]['lines'][0]
    drawn = {y for y in shown['y'] if y is not None}
    assert np.diff(sorted(drawn)).min() < 5e-5  # m, not in steps of 0.1 mm


@pytest.mark.parametrize('rate, said', [
    (1.01, '1 % too fast for B, or A flew that much slower'),
    (0.99, '0.99 % too slow for B, or A flew that much faster'), (1.0, None), (0.999, None)])
def test_a_clock_that_runs_at_another_rate_is_told(rate, said):
    """Of 20 s of a path without repetition, which both measure with errors of 1 mm."""
    t, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(3)
    path = gaussian_filter1d(rng.standard_normal((len(t), 3)), 40.0, axis=0)
    path = 0.5 * path / path.std(axis=0)
    q = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))
    a, b = (motion.Motion(name, np.round(1e9 * times).astype(np.int64),
                          path + 1e-3 * rng.standard_normal(path.shape), q)
            for name, times in (('a', 5.0 + rate * t), ('b', t)))
    text = pair.aligned(a, b, ('time',)).text
    assert ('the clock of A runs' in text) == bool(said) and (said or '') in text
    if rate != 1.01:
        return
    a = dataclasses.replace(a, stamps=np.round(1.06 / rate * a.stamps).astype(np.int64))
    with pytest.raises(BagError, match='the clock of A runs 5.8 % too fast for B.*; take time'):
        pair.aligned(a, b, ('time',))


def test_the_estimate_in_map_is_compared_with_the_truth_and_not_with_poses_of_another_body(
        tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    off = {'ground_truth/odom': 0.0, 'estimate/odom': 0.1, 'estimate/map': 1.0}
    for name in off:
        writer.add_topic(f'/mambo/{name}', 'nav_msgs/msg/Odometry')
    writer.add_topic('/mambo/optitrack/pose', 'geometry_msgs/msg/PoseStamped')
    level, still = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for t in range(0, 2_000_000_000, 5_000_000):
        x = 0.1 * t * 1e-9
        for name, wrong in off.items():
            writer.write(f'/mambo/{name}', messages.ground_truth(
                t, State((x + wrong, 0.0, -1.0), still, level, still)), t)
        pose = messages.optitrack(t, (x + 1.0, 0.0, -1.0), level)
        writer.write('/mambo/optitrack/pose', pose, t)
    writer.close()
    bag = read_bag(tmp_path / 'bag')
    found = {one.title: one for one in pair.within(bag, phases(bag), [])}
    assert np.abs(found['estimation error: estimate/odom minus optitrack/pose'][
        'position'].error[:, 0] + 0.9).max() < 1e-9
    assert np.abs(found['estimation error in map: estimate/map minus ground_truth/odom'][
        'position'].error[:, 0] - 1.0).max() < 1e-9


def test_an_alignment_that_the_heights_or_paths_contradict_says_so():
    t = np.arange(0.0, 30.0, 0.01)
    stamps = np.round(t * 1e9).astype(np.int64)
    wander = gaussian_filter1d(np.random.default_rng(2).standard_normal((3, len(t))), 60.0)
    x, y, z = wander / wander.std(axis=1, keepdims=True)
    level = Rotation.from_euler('z', 0.3 * x[:, None]).as_quat()
    a = motion.Motion('onboard/odom', stamps, np.stack([x, y, 0.3 * z], axis=1), level)
    b = dataclasses.replace(a, name='optitrack/pose', stamps=stamps + 2_000_000_000)
    assert 'follow' not in pair.aligned(a, b).text and 'is not that' not in pair.aligned(a, b).text
    other = dataclasses.replace(b, position=np.stack([x, y, 0.3 * z[::-1]], axis=1))
    said = pair.aligned(a, other, ['time']).text
    assert 'the height of onboard/odom does not follow the height of optitrack/pose' in said
    assert 'is not that' not in said


def test_a_recording_with_the_capture_of_another_flight_is_told(tmp_path, monkeypatch):
    bag = flown(tmp_path / 'flight', ('estimate/odom', 'optitrack/pose'))
    verdict = same_flight.Verdict('they do not turn alike')
    monkeypatch.setattr(same_flight, 'of_bag', lambda *_: verdict)
    assert 'they do not turn alike: is the motion capture of another flight?' in (
        compare(bag)['notes'])
    monkeypatch.setattr(pair, 'simulated', lambda _: True)
    assert not any('another flight' in line for line in compare(bag)['notes'])
