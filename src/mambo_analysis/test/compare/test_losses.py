"""A topic that begins late or ends early in a flight is counted and named; one at rest is not."""

import csv
import json

from mambo_analysis.compare import compare as command, losses
from mambo_analysis.compare.losses import Span
from mambo_bags.reader import read_bag
import numpy as np
import pytest
from synthetic import make_flight, Maker, STEP

S = 10**9  # ns
HOP = (2.0, 8.0)  # s, in the air
ODOMETRIES = ('onboard/odom', 'estimate/odom')


def hop(t):
    """Return the position, m, of a drone that stands, is in the air and stands again."""
    rise = min(max(t - HOP[0], 0.0), max(HOP[1] - t, 0.0), 1.0)
    return np.array([0.2 * max(min(t, HOP[1]) - HOP[0], 0.0), 0.0, rise])


def real(path, seconds=12.0, motors=True, at=hop, **cut):
    """
    Return a bag of a real flight at 50 Hz.

    ``cut`` has begin and end of topics, s, with __ for /; they are those of the bag otherwise.
    """
    cut = {name.replace('__', '/'): span for name, span in cut.items()}
    topics = ['onboard/odom', 'optitrack/pose', *(['motor_pwm'] if motors else [])]
    maker = Maker(path, topics)
    for step in range(0, round(seconds * 200), 4):
        t = step * 0.005
        for name in topics:
            begin, end = cut.get(name, (0.0, seconds))
            if not begin <= t < end:
                continue
            if name == 'motor_pwm':
                maker.write(name, step * STEP, pwm=np.full(4, 200.0 * (HOP[0] <= t <= HOP[1])))
            elif name == 'onboard/odom':
                maker.odometry(name, step * STEP, at(t))
            else:
                maker.write(name, step * STEP, frame='map', pose=maker.pose(at(t)))
    maker.writer.close()
    return read_bag(path)


def lost(result):
    """Return the losses of each topic of a result, without the namespace."""
    return {entry['topic'].removeprefix('/mambo/'): entry['lost'] for entry in result['topics']}


def notes(result):
    """Return the notes of a result on topics that are absent from a part of the flight."""
    return [note for note in result['notes'] if 'of the flight: numbers' in note]


@pytest.mark.parametrize(('topic', 'cut', 'where', 'missing'), [
    ('onboard/odom', (0.0, 5.0), 'from 4.980 to', 150),
    ('optitrack/pose', (0.0, 5.0), 'from 4.980 to', 150),
    ('onboard/odom', (4.0, 12.0), 'to 4.000 s', 100),
    ('optitrack/pose', (4.0, 12.0), 'to 4.000 s', 100),
    ('motor_pwm', (0.0, 5.0), 'from 4.980 to', 150)])
def test_what_lacks_in_flight_is_counted_and_named(tmp_path, topic, cut, where, missing):
    result = command.compare(real(tmp_path / 'b', **{topic.replace('/', '__'): cut}))
    found, = notes(result)
    assert found.startswith(f'/mambo/{topic}: no message from ') and where in found
    counts = lost(result)
    # the ends of the flight are known to a smoothed 0.1 s: 5 messages
    assert counts.pop(topic) == pytest.approx(missing, abs=6)
    assert set(counts.values()) == {0}


@pytest.mark.parametrize('cut', [
    {'onboard__odom': (1.5, 8.5)},  # the log runs in flight only
    {'optitrack__pose': (1.5, 8.5)},
    {'onboard__odom': (0.0, 7.7)},  # some tenths of a second between the ends
    {'onboard__odom': (2.3, 12.0), 'motor_pwm': (2.4, 12.0)},
    {'motor_pwm': (1.9, 8.1)}])
def test_what_begins_and_ends_at_rest_or_a_moment_apart_is_no_loss(tmp_path, cut):
    result = command.compare(real(tmp_path / 'b', **cut))
    assert notes(result) == [] and set(lost(result).values()) == {0}
    assert not result['errors'][0]['ends_early']


def test_a_recording_that_an_operator_ends_in_the_air_has_no_loss(tmp_path):
    result = command.compare(real(
        tmp_path / 'b', 6.0, onboard__odom=(0.0, 5.6), motor_pwm=(0.0, 5.8)))
    assert notes(result) == [] and set(lost(result).values()) == {0}


def test_motors_that_turn_tell_that_it_flies_on_without_any_position(tmp_path):
    cut = {'onboard__odom': (0.0, 5.0), 'optitrack__pose': (0.0, 5.0)}
    found = notes(command.compare(real(tmp_path / 'b', **cut)))
    assert [line.partition(':')[0] for line in found] == [
        '/mambo/onboard/odom', '/mambo/optitrack/pose']
    assert all('from 4.980 to 8.000 s' in line for line in found)
    assert not notes(command.compare(real(tmp_path / 'c', motors=False, **cut)))


def test_a_hover_that_is_recorded_in_the_air_lasts_as_long_as_any_position(tmp_path):
    bag = real(tmp_path / 'b', motors=False, at=lambda t: (np.sin(t), 0.0, 1.0),
               onboard__odom=(3.0, 9.0))
    assert losses.span(bag) == Span(0, 11_980_000_000)
    found, = notes(command.compare(bag))
    assert 'from 0.000 to 3.000 s and from 8.980 to 11.980 s of the flight' in found


def test_an_estimate_that_drifts_on_the_floor_moves_no_end_of_the_flight(tmp_path):
    maker = Maker(tmp_path / 'b', ODOMETRIES)
    for step in range(0, 2400, 4):
        t = step * 0.005
        if 1.0 <= t < 9.0:
            maker.odometry('onboard/odom', step * STEP, hop(t))
        maker.odometry('estimate/odom', step * STEP, hop(t) + [0.0, 0.0, 0.1 * t])
    maker.writer.close()
    bag = read_bag(tmp_path / 'b')
    flight = losses.span(bag)
    assert flight.begin == pytest.approx(2 * S, abs=0.2 * S)
    assert flight.end == pytest.approx(8 * S, abs=0.2 * S)
    assert losses.describe(bag, flight) == []


def test_a_drone_that_never_moves_lacks_nothing(tmp_path):
    bag = real(tmp_path / 'b', motors=False, at=lambda t: (0.0, 0.0, 0.0),
               onboard__odom=(3.0, 9.0))
    assert losses.span(bag) is None and notes(command.compare(bag)) == []


def test_a_simulation_lasts_until_the_end_of_its_recording(tmp_path):
    """Its nodes work until then; the first poses come after the take-off."""
    drop = {'estimate/odom': range(1200, 1600), 'optitrack/pose': range(360)}
    bag = read_bag(make_flight(tmp_path / 'b', 8.0, drop=drop))
    flight = losses.span(bag)
    assert flight.end == 8 * S - STEP
    assert flight.begin == pytest.approx(1.2 * S, abs=0.2 * S)
    result = command.compare(bag)
    assert lost(result)['estimate/odom'] == 400 and lost(result)['ground_truth/odom'] == 0
    text = command.table(result)
    assert '  at 6.00 s [m]  ' in text and '  at the end [m]  ' in text
    assert ('note: /mambo/estimate/odom: no message from 5.995 to 7.995 s of the flight: '
            'numbers that need it cover only the rest') in text
    assert '/mambo/optitrack/pose: no message from 1.' in text


def test_one_wrong_stamp_is_not_the_end_of_a_recording(tmp_path):
    maker = Maker(tmp_path / 'b', ('ground_truth/odom', 'estimate/odom', 'sensor_tick'))
    for step in range(400):
        for name in ('ground_truth/odom', 'estimate/odom'):
            maker.odometry(name, step * STEP, (0.01 * step, 0.0, 1.0))
        maker.write('sensor_tick', (step + 10**6 * (step == 399)) * STEP)
    maker.writer.close()
    bag = read_bag(tmp_path / 'b')
    assert losses.span(bag).end == 399 * STEP and losses.describe(bag, losses.span(bag)) == []


def test_a_sensor_that_failed_is_judged_by_its_count(tmp_path):
    """The watermark goes on without new samples: none was published, and none is lost."""
    topics = ('ground_truth/odom', 'estimate/odom', 'sensor_tick', 'imu/data_raw')
    for name, count in (('failed', 200), ('cut', 400)):
        maker = Maker(tmp_path / name, topics)
        for step in range(400):
            for topic in topics[:2]:
                maker.odometry(topic, step * STEP, (0.01 * step, 0.0, 1.0))
            maker.write('sensor_tick', step * STEP, imu=min(step + 1, count))
            if step < 200:
                maker.write('imu/data_raw', step * STEP)
        maker.writer.close()
        result = command.compare(read_bag(tmp_path / name))
        assert lost(result)['imu/data_raw'] == count - 200
        assert len(notes(result)) == (count > 200)


def test_a_topic_of_long_and_irregular_periods_lacks_nothing_in_one_of_them():
    flight, rng = Span(0, 20 * S), np.random.default_rng(1)
    often = np.arange(0, 19 * S, S // 50)
    assert losses.absent(often, flight) == [Span(int(often[-1]), 20 * S)]
    seldom = np.sort(rng.choice(often[:-1], 60, replace=False))  # one in 0.3 s
    assert losses.absent(np.append(seldom, often[-1]), flight) == []
    assert losses.absent(often[:1], Span(-S, 2 * S)) == [Span(-S, 0), Span(0, 2 * S)]
    assert losses.absent(often, None) == []


def test_table_page_json_and_csv_say_when_the_last_error_is(tmp_path, capsys):
    real(tmp_path / 'b', onboard__odom=(0.0, 5.0))
    names = [tmp_path / name for name in ('n.json', 'n.csv', 'n.html')]
    assert command.main([str(tmp_path / 'b'), '--json', str(names[0]), '--csv', str(names[1]),
                         '--html', str(names[2])]) == 0
    text = capsys.readouterr().out
    assert 'at 4.98 s [m]' in text and 'at the end' not in text
    error, = json.loads(names[0].read_text())['errors'][:1]
    assert error['ends_early'] and error['rows'][0]['drift_at'] == pytest.approx(4.98)
    with names[1].open(newline='') as file:
        assert {round(float(row['drift_at_s']), 6) for row in csv.DictReader(file)
                if row['part'] == 'whole flight'} == {4.98}
    page = names[2].read_text()
    assert '<dd class="what">at 4.98 s</dd>' in page and '0.0000 at 4.98 s' in page
    assert '/mambo/onboard/odom: no message from 4.980 to ' in page


@pytest.mark.parametrize('cut', ['first', 'second'])
def test_two_bags_are_compared_until_one_of_their_flights_ends(tmp_path, cut):
    a = real(tmp_path / 'a', onboard__odom=(0.0, 5.0 if cut == 'first' else 12.0))
    b = real(tmp_path / 'b', 11.0, onboard__odom=(0.0, 5.0 if cut == 'second' else 11.0))
    result = command.compare_bags(a, b, 'onboard/odom', 'onboard/odom', ())[0]
    assert [note[:2] for note in notes(result)] == ['A:' if cut == 'first' else 'B:']
    assert all(entry['ends_early'] for entry in result['errors'] if entry['quantity'] != 'PWM')
    shorter = real(tmp_path / 'c', 6.0)  # its recording ends in the air: nothing of it lacks
    result = command.compare_bags(a if cut == 'second' else b, shorter, what=())[0]
    assert notes(result) == [] and not result['errors'][0]['ends_early']


def test_a_replayed_estimate_that_ends_early_says_so(tmp_path):
    origin = read_bag(make_flight(tmp_path / 'a', 6.0))
    answer = read_bag(make_flight(tmp_path / 'b', 4.0))
    text = command.compare_replay(origin, answer)
    assert 'at 4.00 s [m]' in text
    assert ('note: replayed: /mambo/estimate/odom: no message from 3.995 to 5.995 s of the '
            'flight') in text
    assert 'note: recorded:' not in text
