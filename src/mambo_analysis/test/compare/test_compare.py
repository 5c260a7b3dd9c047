"""The table of a flight whose errors and losses are known by construction."""

import json

from mambo_analysis.compare.compare import (
    align, compare, compare_bags, compare_replay, main, phases, table)
from mambo_bags.reader import BagError, read_bag
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import (
    BLEND, E_TOTAL, ESTIMATION, LANDING, make_flight, Maker, START, STEP, TRACKING)

DROPPED = {'estimate/odom': {300, 301, 2000}, 'sonar/range': {5, 9}, 'optical_flow': {1},
           'optitrack/pose': {100, 101, 102}, 'imu/data_raw': {77}}


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return make_flight(tmp_path_factory.mktemp('bags') / 'flight', 18.0, drop=DROPPED)


@pytest.fixture(scope='module')
def result(flight):
    return compare(read_bag(flight))


def section(result, beginning):
    found, = [s for s in result['errors'] if s['title'].startswith(beginning)]
    return found, {row['part']: row for row in found['rows']}


@pytest.mark.parametrize('size', [0.0, 3.0])
def test_an_estimate_that_was_reset_beside_lost_samples_is_noted(tmp_path, size):
    maker = Maker(tmp_path / 'b', ('onboard/odom',))
    for step in range(400):
        if step % 7:
            maker.odometry('onboard/odom', step * STEP, (size * (step > 200), 0.0, 1.0))
    maker.writer.close()
    notes = compare(read_bag(tmp_path / 'b'))['notes']
    assert [note[:46] for note in notes if 'leaps' in note] == [
        'onboard/odom: the position leaps by 3.00 m at '] * (size > 0.0)


@pytest.mark.long
def test_tracking_error_is_truth_minus_reference_before_and_after_the_blend(result):
    found, rows = section(result, 'tracking error: ground_truth/odom minus reference')
    assert (found['unit'], found['axes']) == ('m', ['x', 'y', 'z'])
    assert rows['after take-off']['rms'] == pytest.approx(np.abs(TRACKING))
    assert rows['take-off']['rms'] == pytest.approx(2.0 * np.abs(TRACKING))
    assert rows['take-off']['count'] == (START + BLEND) * 200
    assert rows['after take-off']['count'] == (LANDING - START - BLEND) * 200
    assert rows['landing']['count'] == 2.0 * 200
    assert rows['whole flight']['maximum_total'] == pytest.approx(
        2.0 * np.linalg.norm(TRACKING))


def test_estimation_error_is_against_optitrack_interpolated_by_its_stamps(result):
    _, rows = section(result, 'estimation error: estimate/odom minus optitrack/pose')
    row = rows['after take-off']
    # between two frames the circle bends away from the chord: a h^2 / 8 = 9 um
    assert row['rms'] == pytest.approx(np.abs(ESTIMATION), abs=1e-5)
    assert row['rms_total'] == pytest.approx(E_TOTAL, abs=1e-5)


def test_take_off_ends_with_the_blend_of_the_scenario(result):
    assert result['takeoff_end'] == START + BLEND
    assert result['landing_start'] == LANDING
    assert result['takeoff'] == 'phase TRACK from 5.00 s and 3 s of blend'


def test_a_recording_that_ends_before_the_take_off_says_so(tmp_path):
    found = compare(read_bag(make_flight(tmp_path / 'b', 6.0)))
    assert found['takeoff_end'] is None
    assert table(found).splitlines()[1] == (
        'the recording ends before the take-off, at 8.00 s: phase TRACK from 5.00 s and 3 s of '
        'blend')


def test_messages_that_nobody_can_read_are_left_out_with_a_note(tmp_path, capsys):
    maker = Maker(tmp_path / 'b', ('reference', 'ground_truth/odom', 'motor_pwm'))
    for step in range(10):
        maker.write('reference', step * STEP, phase=2)
        maker.odometry('ground_truth/odom', step * STEP, (1.0, 0.0, 0.0))
        maker.writer.write('/mambo/motor_pwm', b'\0\1\0\0\1', step * STEP)
    maker.writer.close()
    assert main([str(tmp_path / 'b')]) == 0
    out = capsys.readouterr().out
    assert 'note: 10 of 10 messages of /mambo/motor_pwm are not a mambo' in out
    assert '  whole flight       1.0000' in out


@pytest.mark.parametrize('topic', ['estimate/odom', 'ground_truth/odom'])
def test_positions_that_are_lost_on_the_way_are_noted(tmp_path, topic, capsys):
    topics = ('estimate/odom', 'ground_truth/odom')
    maker = Maker(tmp_path / 'b', topics)
    for step in range(200):
        for name in topics:
            lost = name == topic and step >= 120
            maker.odometry(name, step * STEP, (np.nan if lost else 0.01 * step, 0.0, 1.0))
    maker.writer.close()
    assert main([str(tmp_path / 'b')]) == 0
    line = (f'/mambo/{topic}: 80 of 200 positions are not finite, the first at 0.600 s: they '
            'are not compared. None of the last 0.400 s is: the last one that counts is at '
            '0.595 s')
    assert f'note: {line}' in capsys.readouterr().out
    bag, again = read_bag(tmp_path / 'b'), read_bag(tmp_path / 'b')
    text = compare_replay(bag, again)
    assert f'note: recorded: {line}' in text and f'note: replayed: {line}' in text
    notes = compare_bags(bag, again)[0]['notes']
    assert f'A: {line}' in notes and f'B: {line}' in notes


def test_an_unknown_blend_is_assumed_and_said(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b', 6.0, attachments={}))
    parts = phases(bag)
    assert parts.takeoff_end == 8 * 10**9
    assert 'assumed: the bag does not hold it' in parts.text


def test_a_flight_without_take_off_is_all_after_it(tmp_path):
    maker = Maker(tmp_path / 'b', ('reference', 'ground_truth/odom'))
    for step in range(10):
        maker.write('reference', step * STEP, phase=2)
        maker.odometry('ground_truth/odom', step * STEP, (1.0, 0.0, 0.0))
    maker.writer.close()
    result = compare(read_bag(tmp_path / 'b'))
    _, rows = section(result, 'tracking')
    assert 'no take-off' in result['takeoff'] and 'take-off' not in rows
    assert rows['after take-off']['rms'] == [1.0, 0.0, 0.0]


def test_lost_messages_are_counted_by_what_tells_of_them(result):
    lost = {entry['topic']: entry['lost'] for entry in result['topics']}
    assert lost == {
        '/mambo/imu/data_raw': 1, '/mambo/sonar/range': 2, '/mambo/optical_flow': 1,
        '/mambo/barometer/pressure': 0, '/mambo/optitrack/pose': 3, '/mambo/estimate/odom': 3,
        '/mambo/sensor_tick': 0, '/mambo/ground_truth/odom': 0, '/mambo/estimator/state': 0,
        '/mambo/reference': 0, '/mambo/motor_pwm': 0}
    rates = {entry['topic']: entry['rate'] for entry in result['topics']}
    assert rates['/mambo/motor_pwm'] == pytest.approx(200.0)
    assert rates['/mambo/optitrack/pose'] == pytest.approx(120.0, rel=0.01)


def test_losses_of_a_drone_with_another_rate_are_counted_by_its_own_period(tmp_path):
    maker = Maker(tmp_path / 'b', ('imu/data_raw',))
    for step in (0, 1, 2, 3, 6, 7, 8):  # of 10 ms
        maker.write('imu/data_raw', 2 * step * STEP)
    maker.writer.close()
    result = compare(read_bag(tmp_path / 'b', namespace='/mambo'))
    assert {e['topic']: e['lost'] for e in result['topics']}['/mambo/imu/data_raw'] == 2


def test_samples_behind_the_last_watermark_do_not_hide_lost_ones(tmp_path):
    maker = Maker(tmp_path / 'b', ('sonar/range', 'sensor_tick'))
    for step in (0, 2, 3, 5):
        maker.write('sonar/range', step * STEP)
    maker.write('sensor_tick', 3 * STEP, sonar=4)  # one of the four is lost
    maker.writer.close()
    result = compare(read_bag(tmp_path / 'b', namespace='/mambo'))
    assert {e['topic']: e['lost'] for e in result['topics']}['/mambo/sonar/range'] == 1


def test_the_estimate_is_not_compared_across_a_gap_of_optitrack(tmp_path):
    bag = read_bag(make_flight(
        tmp_path / 'b', 6.0, drop={'optitrack/pose': set(range(300, 420))}))
    _, rows = section(compare(bag), 'estimation')
    assert rows['whole flight']['count'] == pytest.approx(1200 - 200, abs=3)


def test_real_time_factor_comes_from_metadata_yaml(result):
    assert result['real_time_factor'] == 4.25


def test_table_reads_as_text_and_json_as_numbers(flight, result, capsys):
    text = table(result)
    assert 'flight: 18.00 s, real-time factor 4.25' in text
    assert 'take-off ends at 8.00 s: phase TRACK from 5.00 s and 3 s of blend' in text
    assert 'after take-off 0.0100 0.0200 0.0300 0.0374 0.0374 1600' in ' '.join(text.split())
    assert max(map(len, text.splitlines())) <= 80
    assert main([str(flight)]) == 0
    assert capsys.readouterr().out.strip() == text
    assert main([str(flight), '--json']) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(result))


@pytest.mark.slow
@pytest.mark.parametrize('missing', [
    ('reference',), ('ground_truth/odom',), ('optitrack/pose',), ('estimate/odom',),
    ('ground_truth/odom', 'optitrack/pose'), ('sensor_tick',), ('estimator/state', 'motor_pwm'),
    ('reference', 'estimate/odom', 'ground_truth/odom', 'optitrack/pose')])
def test_missing_topics_are_said_and_the_rest_is_compared(tmp_path, missing, capsys):
    path = make_flight(tmp_path / 'b', 2.0, leave_out=missing)
    assert main([str(path), '--out', str(tmp_path / 'page')]) == 0
    text = capsys.readouterr().out
    result = compare(read_bag(path))
    titles = ' '.join(s['title'] for s in result['errors'])
    assert ('tracking' in titles) == ('reference' not in missing and len(missing) < 2
                                      or missing[0] == 'estimator/state')
    if 'estimate/odom' in missing:
        assert 'note: no estimate/odom' in text
    if missing == ('ground_truth/odom',):
        assert 'tracking error: optitrack/pose minus reference' in titles
    if missing == ('optitrack/pose',):
        assert 'estimation error: estimate/odom minus ground_truth/odom' in titles
    assert (tmp_path / 'page' / 'index.html').stat().st_size > 10_000


def turned(path, yaw, shift, error):
    """Write a flight of two odometries: the drone's own, and an estimate in another frame."""
    maker = Maker(path, ('estimate/odom', 'onboard/odom'), attachments={})
    turn = Rotation.from_euler('z', yaw)
    for step in range(200):
        attitude = Rotation.from_euler('ZYX', [0.3 + 0.001 * step, 0.1, -0.05])
        position = np.array([0.01 * step, 0.02 * step, 1.0])
        maker.odometry('onboard/odom', step * STEP, position, attitude.as_quat(),
                       velocity=(1.0, 2.0, 3.0))
        maker.odometry(
            'estimate/odom', step * STEP,
            turn.apply(position + (error if step else 0.0)) + shift,
            (turn * attitude).as_quat(), velocity=(1.1, 2.0, 3.0))
    maker.writer.close()
    return read_bag(path)


def test_odometries_are_aligned_at_their_first_common_pose(tmp_path):
    error = np.array([0.1, -0.2, 0.3])
    bag = turned(tmp_path / 'b', 2.5, [5.0, -7.0, 1.0], error)
    aligned = align(bag['estimate/odom'], bag['onboard/odom'])
    # it hovers: what the estimate is told of the height after its first pose is no error
    np.testing.assert_allclose(aligned.position[0], [0.0, 0.0, -0.3], atol=1e-12)
    np.testing.assert_allclose(
        aligned.position[1:], np.tile([0.1, -0.2, 0.0], (199, 1)), atol=1e-12)
    np.testing.assert_allclose(aligned.velocity, np.tile([0.1, 0.0, 0.0], (200, 1)), atol=1e-12)
    np.testing.assert_allclose(aligned.attitude, 0.0, atol=1e-9)
    result = compare(bag)
    assert [s['title'].split(',')[0] for s in result['errors']] == [
        'position', 'velocity in body axes', 'attitude']
    _, rows = section(result, 'velocity')
    assert rows['whole flight']['rms'] == pytest.approx([0.1, 0.0, 0.0], abs=1e-12)
    assert 'made equal to onboard/odom at 0.000 s (turned by -143.24 deg)' in table(result)


def test_an_imported_flight_without_estimate_says_how_to_get_one(tmp_path):
    maker = Maker(tmp_path / 'b', ('onboard/odom',))
    for step in range(3):
        maker.odometry('onboard/odom', step * STEP, (0.0, 0.0, 0.0))
    maker.writer.close()
    result = compare(read_bag(tmp_path / 'b'))
    assert result['errors'] == [] and 'replay to make one' in result['notes'][0]


def test_a_joined_recording_has_the_error_of_the_onboard_estimate(tmp_path):
    maker = Maker(tmp_path / 'b', ('onboard/odom', 'optitrack/pose', 'imu/data_raw'))
    for step in range(400):
        t, x = step * STEP, np.sin(0.02 * step)
        maker.odometry('onboard/odom', t, (x, 0.0, 1.0))
        maker.write('optitrack/pose', t, pose=maker.pose((x, 0.1 * (step > 300), 1.0)))
        maker.write('imu/data_raw', t)
    maker.writer.close()
    result = compare(read_bag(tmp_path / 'b'))
    error, = [entry for entry in result['errors'] if entry['quantity'] == 'position']
    assert error['title'] == 'error of the onboard estimate: onboard/odom minus optitrack/pose'
    assert error['rows'][0]['drift'][1] == pytest.approx(-0.1, abs=0.01)
    assert any('mambo replay' in note for note in result['notes'])


@pytest.mark.long
def test_a_replay_that_answers_bit_for_bit_is_told_from_one_that_does_not(tmp_path, flight):
    text = compare_replay(read_bag(flight), read_bag(flight))
    assert 'estimate/odom: 3597 of 3597 recorded messages answered bit for bit' in text
    assert 'replayed estimate/odom minus optitrack/pose' in text
    other = make_flight(tmp_path / 'other', 18.0, noise=1e-9)
    text = compare_replay(read_bag(flight), read_bag(other))
    assert 'estimate/odom: 0 of 3597' in text and 'first difference at 0.000 s' in text


def test_a_replay_of_an_imported_flight_is_compared_with_its_own_estimate(tmp_path):
    bag = turned(tmp_path / 'source', 0.0, [0.0, 0.0, 0.0], np.zeros(3))
    text = compare_replay(bag, bag)
    assert 'position, estimate/odom minus onboard/odom' in text
    silent = make_flight(tmp_path / 'silent', 1.0, leave_out=('estimate/odom',))
    with pytest.raises(BagError, match='the estimator did not answer'):
        compare_replay(read_bag(make_flight(tmp_path / 'whole', 1.0)), read_bag(silent))


@pytest.mark.parametrize('lacking', [
    ('imu/data_raw',), ('sonar/range',), ('sonar/range', 'optical_flow')])
def test_a_replay_without_an_estimate_says_which_samples_its_recording_lacks(tmp_path, lacking):
    """The estimator waits for all that the watermarks count."""
    origin = read_bag(make_flight(tmp_path / 'origin', 1.0, leave_out=lacking))
    silent = make_flight(tmp_path / 'silent', 1.0, leave_out=('estimate/odom',))
    with pytest.raises(BagError, match=f' has no samples of {" and ".join(lacking)}$'):
        compare_replay(origin, read_bag(silent))


def test_a_topic_of_another_type_is_named(tmp_path, capsys):
    maker = Maker(tmp_path / 'b', ('motor_pwm',))
    maker.writer.add_topic('/mambo/reference', 'geometry_msgs/msg/PoseStamped')
    maker.write('motor_pwm', 0)
    maker.writer.close()
    assert main([str(tmp_path / 'b')]) == 2
    assert capsys.readouterr().err.endswith(
        '/mambo/reference has the type geometry_msgs/msg/PoseStamped, expected '
        'mambo_interfaces/msg/Reference\n')


def test_wrong_use_ends_in_one_line(tmp_path, flight, capsys):
    (tmp_path / 'file').touch()
    for arguments, text in (
            ([tmp_path / 'none'], 'no such bag'),
            ([flight, '--namespace', '/other'], 'nothing in the namespace /other'),
            ([flight, '--no-align'], '--no-align and --equal-at need two bags')):
        assert main([str(a) for a in arguments]) == 2
        error = capsys.readouterr().err
        assert error.startswith('compare: ') and text in error and error.count('\n') == 1
    for words, text in (([], 'required: A'),
                        ([flight, '--out', tmp_path / 'file'], 'file is not a folder')):
        with pytest.raises(SystemExit) as usage:
            main([str(word) for word in words])
        error = capsys.readouterr().err
        assert usage.value.code == 2 and text in error and error.count('\n') == 1


def test_metadata_of_another_bag_is_noted(flight):
    bag = read_bag(flight)
    assert not any('another bag' in note for note in compare(bag)['notes'])
    bag.notes = ['metadata.yaml: the file may be of another bag']
    assert compare(bag)['notes'][0] == bag.notes[0]
    assert f'note: {bag.notes[0]}' in compare_replay(bag, bag)


def test_a_height_that_contradicts_the_range_is_noted(flight):
    bag = read_bag(flight)
    poses = bag['optitrack/pose']
    assert not any('range' in note for note in compare(bag)['notes'])
    poses._cache['pose.position'] = poses['pose.position'] * [1.0, 1.0, 3.28]
    assert any('times as much as the range' in note for note in compare(bag)['notes'])
