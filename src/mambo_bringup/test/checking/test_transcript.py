"""Verdicts on what was heard of a node, without a graph."""

import time

from mambo_bringup.checking.contract import CONTRACTS
from mambo_bringup.checking.transcript import BROKEN, Heard, KEPT, Transcript, UNSEEN
import pytest

STEP = 5_000_000


@pytest.fixture
def transcript():
    """Return ten steps, each answered after 1 ms, the last five in real time."""
    one = Transcript(CONTRACTS['controller'])
    for k in range(10):
        one.asked[k * STEP] = 100.0 + k
        one.heard.append(Heard(100.001 + k, k * STEP, ''))
    one.paced = {k * STEP for k in range(5, 10)}
    return one


def verdicts(transcript):
    return {one.rule: one for one in transcript.findings()}


def test_what_was_not_tried_was_not_observed(transcript):
    found = verdicts(transcript)
    kept = {rule for rule, one in found.items() if one.verdict == KEPT}
    assert kept == {'answers', 'stamps', 'order', 'values', 'real time'}
    assert {one.verdict for rule, one in found.items() if rule not in kept} == {UNSEEN}
    assert found['answers'].seen == 'one for each of 10 steps'
    assert found['real time'].seen.startswith('median 1.0 ms, 99 % 1.0 ms, largest 1.0 ms; 0 of 5')
    assert {one.verdict for one in Transcript(CONTRACTS['controller']).findings()} == {UNSEEN}


@pytest.mark.parametrize(('stamp', 'broken', 'seen'), [
    (3 * STEP, {'answers', 'order'}, '1 of 10 steps have several, the first 0.015 s'),
    (7, {'stamps', 'order'}, '1 of 11 are not those of its inputs, the first is 0.000 s'),
    (time.time_ns(), {'stamps'}, 's, the wall clock')])
def test_an_answer_too_many_is_told_from_a_wrong_stamp(transcript, stamp, broken, seen):
    transcript.heard.append(Heard(111.0, stamp, ''))
    found = verdicts(transcript)
    assert {rule for rule, one in found.items() if one.verdict == BROKEN} == broken
    assert any(seen in one.seen for one in found.values())


def test_a_missing_answer_is_told_unless_its_input_never_came(transcript):
    del transcript.heard[4]
    assert verdicts(transcript)['answers'].seen == (
        '1 of 10 steps have none, the first 0.020 s; wanted one for each')
    transcript.optional.add(4 * STEP)
    assert verdicts(transcript)['answers'].verdict == KEPT


@pytest.mark.parametrize(('late', 'verdict', 'seen'), [
    (0.006, BROKEN, '5 of 5 later than 5 ms; wanted most in time'),
    (0.6, BROKEN, 'after 0.5 s without a command the motors are stopped')])
def test_answers_in_real_time_are_in_time(transcript, late, verdict, seen):
    transcript.heard[5:] = [
        one._replace(wall=transcript.asked[one.stamp] + late) for one in transcript.heard[5:]]
    found = verdicts(transcript)['real time']
    assert found.verdict == verdict and found.seen.endswith(seen)


def test_half_of_the_answers_in_time_are_not_most(transcript):
    assert verdicts(transcript)['real time'].verdict == KEPT
    paced = [at for at, one in enumerate(transcript.heard) if one.stamp in transcript.paced]
    for at in paced[:(len(paced) + 1) // 2]:
        one = transcript.heard[at]
        transcript.heard[at] = one._replace(wall=transcript.asked[one.stamp] + 0.006)
    assert verdicts(transcript)['real time'].verdict == BROKEN


def test_numbers_out_of_limits_are_told_with_their_time(transcript):
    transcript.heard[6] = transcript.heard[6]._replace(wrong='pwm = nan')
    found = verdicts(transcript)['values']
    assert found.verdict == BROKEN and found.seen == '1 messages, the first at 0.030 s: pwm = nan'


def test_who_has_a_rate_of_its_own_is_not_asked_for_every_step():
    one = Transcript(CONTRACTS['optitrack'])
    one.asked = {k * STEP: 100.0 for k in range(201)}
    one.heard = [Heard(100.0, k * 8_333_333, '') for k in range(120)]
    found = verdicts(one)
    assert found['answers'].seen == '120.0 messages a second of flight'
    assert found['stamps'].verdict == found['order'].verdict == KEPT
    assert not {'ready', 'backlog', 'real time'} & set(found)
    one.heard.append(Heard(100.0, 2_000_000_000, ''))
    assert verdicts(one)['stamps'].verdict == BROKEN


def test_a_verdict_stays_broken(transcript):
    transcript.note('ready', False, 'early')
    transcript.note('ready', True, 'waits')
    assert verdicts(transcript)['ready'].seen == 'early'


def test_damaged_messages_are_wrong_and_no_answers(transcript):
    transcript.hear(b'\x00\x01')
    found = verdicts(transcript)
    assert 'cannot be read' in found['values'].seen
