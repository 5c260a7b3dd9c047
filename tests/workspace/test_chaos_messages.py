"""Attacked flights are survived, the judge notices one that is not, and attacks repeat."""

import math
from pathlib import Path
import random
import sys

from mambo_bags.writer import BagWriter, Qos
from mambo_model.motion.rigid_body import State
from mambo_ros import messages, topics
import pytest

sys.path.append(str(Path(__file__).parents[2] / 'tools'))
from chaos_files import flown, hostile, wild  # scripts of tools/, not a package

ATTACK = hostile.Attack('values', 'processes', 'flight', 5, 1)
ZERO, LEVEL = (0.0,) * 3, (1.0, 0.0, 0.0, 0.0)


@pytest.mark.long
def test_an_attacked_flight_is_survived_and_one_that_differs_is_lost(tmp_path, monkeypatch):
    # long enough for the stranger to come in time
    monkeypatch.setitem(hostile.MODES, 'processes', ['run', '--processes', '--duration=60'])
    calm = hostile.calm(tmp_path, 'processes')
    (tmp_path / 'attacked').mkdir()
    flight, ended = hostile.attacked(ATTACK, tmp_path / 'attacked')
    assert hostile.judge(ATTACK, ended, calm, flight) == ''
    assert ended.deed['sent'] == 300 and ended.deed['target'].startswith('/')
    wrong = {**calm.digests, 'bag ground_truth/odom': ''}
    differs = hostile.judge(ATTACK, ended, calm._replace(digests=wrong), flight)
    assert differs == 'other than in the undisturbed flight: bag ground_truth/odom'
    grown = ended._replace(memory=calm.memory + (2 << 30))
    assert ' MB instead of ' in hostile.judge(ATTACK, grown, calm, flight)
    (flight.bag / 'metadata.yaml').unlink()
    assert 'not closed' in hostile.judge(ATTACK, ended, calm, flight)


def ended(code, out, err):
    return hostile.Ended(code, out, err, 0, {})


@pytest.mark.parametrize('code, out, err', [
    (0, 'flew 9 s\n', ''), (1, '', 'run: the recorder was ended by SIGKILL\n'),
    (0, '', 'warning: a line\n'), (2, '', 'replay: bag is damaged\n')])
def test_an_end_with_a_reason_is_survived(code, out, err):
    assert hostile.wrong_words(ended(code, out, err)) == ''


@pytest.mark.parametrize('code, out, err, wrong', [
    (1, '', '', 'exit code 1 behind []'), (1, '', 'a\nrun: b\n', "behind ['a', 'run: b']"),
    (-11, '', 'run: b\n', 'exit code -11'), (0, '', 'Traceback (most', 'Traceback'),
    (0, 'x\n' * 201, '', '201 lines'), (0, 'x' * 3000, '', '3000 characters'),
    (1, '', 'run: \n', 'exit code 1')])
def test_any_other_end_is_lost(code, out, err, wrong):
    assert wrong in hostile.wrong_words(ended(code, out, err))


def bag_of(path, pwm, height, tilt):
    q = (math.cos(tilt / 2), math.sin(tilt / 2), 0.0, 0.0)
    state = State((0.0, 0.0, -height), ZERO, q, ZERO)
    bag = BagWriter(path)
    made = {topics.MOTOR_PWM: messages.motor_pwm(0, (pwm,) * 4, False, 0),
            topics.GROUND_TRUTH: messages.ground_truth(0, state)}
    for topic in made:
        bag.add_topic(f'/mambo/{topic.name}', topic.type_name, Qos(depth=10))
    for topic, data in made.items():
        bag.write(f'/mambo/{topic.name}', data, 0, now_ns=0)
    bag.close()
    return path.parent


@pytest.mark.parametrize('pwm, height, tilt, wrong', [
    (200.0, 1.5, 0.2, ''), (70_000.0, 1.5, 0.2, 'PWM'), (math.nan, 1.5, 0.2, 'PWM'),
    (200.0, 2.6, 0.2, '2.60 m high'), (200.0, 1.5, 1.1, '63 degrees'),
    (200.0, math.nan, 0.2, 'truth')])
def test_a_vehicle_that_flies_off_is_lost(tmp_path, pwm, height, tilt, wrong):
    found = flown.wrong(bag_of(tmp_path / 'bag', pwm, height, tilt))
    assert wrong in found and bool(found) == bool(wrong)


def test_what_is_refused_must_be_said(tmp_path):
    deed = {'target': '/mambo/imu/data_raw', 'readers': ['estimator_node'], 'sent': 300,
            'matched': 2, 'from': 10**9, 'to': 3 * 10**9}
    silent = ended(0, 'flew', '')._replace(deed=deed)
    assert hostile.unsaid(ATTACK, silent, tmp_path) == (
        '300 messages on /mambo/imu/data_raw refused without a word')
    said = silent._replace(out='warning: refused: 300 /mambo/imu/data_raw not finite')
    assert hostile.unsaid(ATTACK, said, tmp_path) == ''


def test_the_same_seed_gives_the_same_attacks_and_messages():
    chosen = [[hostile.chosen(kind, seed, number) for kind in hostile.KINDS
               for number in range(20)] for seed in (1, 1, 2)]
    assert chosen[0] == chosen[1]
    assert [each[1:3] for each in chosen[0]] != [each[1:3] for each in chosen[2]]
    assert {each.mode for each in chosen[0]} == set(hostile.MODES)
    data = messages.clock(5)
    first, again, other = (
        [wild.garbage(random.Random(f'{seed} {number}'), data) for number in range(20)]
        for seed in (1, 1, 2))
    assert first == again != other


@pytest.mark.parametrize('topic', topics.RECORDED, ids=lambda topic: topic.name)
def test_wild_messages_are_messages_of_the_type(topic):
    from rclpy.serialization import deserialize_message, serialize_message
    rng = random.Random(topic.name)
    for _ in range(10):
        message = topic.msg_type()
        wild.spoil(rng, message)
        assert wild.stamp(message, -1, 10**9) or topic in (topics.TF,)
        data = serialize_message(message)
        assert type(deserialize_message(data, topic.msg_type)) is topic.msg_type
    assert len(wild.enlarged(rng, topic.msg_type())) > 1_000_000
