"""The batch of drones: checks of actions, shares of its threads, drones that do not take off."""

from mambo_control import failsafe
from mambo_flight.gym import episode
from mambo_flight.gym.configuration import configure
from mambo_flight.gym.drone_batch import DroneBatch
from mambo_model.errors import InputError, JobError
import numpy as np
import pytest

N = 5


@pytest.fixture
def batch():
    made = DroneBatch(configure('hover'), N, threads=2)
    yield made
    made.close()


def test_actions_are_clipped_to_the_limits_of_their_channels(batch):
    high = batch.channels()[0].high
    actions = np.tile([-1.0, 0.5 * high, high, 2.0 * high], (N, 1))
    np.testing.assert_allclose(
        batch.checked(actions, N), np.tile([0.0, 0.5 * high, high, high], (N, 1)))


def test_one_drone_takes_a_vector(batch):
    checked = batch.checked([1.0, 2.0, 3.0, 4.0], None)
    assert checked.shape == (N, 4)
    np.testing.assert_array_equal(checked[0], [1.0, 2.0, 3.0, 4.0])
    assert not checked[1:].any()


def test_actions_with_fewer_channels_leave_the_rest_zero():
    batch = DroneBatch(configure('track', action='setpoint'), 2, threads=1)
    np.testing.assert_array_equal(
        batch.checked([[0.1, -0.2, 7.0]] * 2, 2), [[0.1, -0.2, 1.0, 0.0]] * 2)


@pytest.mark.parametrize(('actions', 'count', 'message'), [
    (np.zeros((N, 3)), N, r'^action has shape \(5, 3\), must have \(5, 4\): motor_1 \[PWM\], '),
    (np.zeros(4), N, r'^action has shape \(4,\), must have \(5, 4\)'),
    (np.zeros((1, 4)), None, r'^action has shape \(1, 4\), must have \(4,\)'),
    ('up', N, r'^action must be numbers: motor_1 \[PWM\]'),
    ([10**400, 0.0, 0.0, 0.0], None, r'^action has a number that is too large: motor_1 \[PWM\]'),
    (np.full(4, 1j), None, '^action must be numbers: motor_1'),
    (np.full(4, np.datetime64('2020')), None, '^action must be numbers: motor_1'),
    ([[0.0, 0.0, np.nan, 0.0]] + [[0.0] * 4] * (N - 1), N,
     '^action of drone 0 has motor_3 = nan, must be finite'),
    ([[0.0] * 4] * (N - 1) + [[0.0, np.inf, 0.0, 0.0]], N,
     '^action of drone 4 has motor_2 = inf, must be finite'),
    ([0.0, 0.0, 0.0, -np.inf], None, '^action has motor_4 = -inf, must be finite')])
def test_a_wrong_action_is_named(batch, actions, count, message):
    with pytest.raises(InputError, match=message):
        batch.checked(actions, count)


@pytest.mark.parametrize('rows', [[], [3], [0, 1, 2, 3, 4]])
def test_each_row_is_the_share_of_one_thread(batch, rows):
    shares = batch._shares(rows)
    assert len(shares) == min(2, len(rows)) and all(len(share) for share in shares)
    assert [row for share in shares for row in share] == rows


def test_there_are_no_more_threads_than_drones():
    batch = DroneBatch(configure('hover'), 1, threads=8)
    assert batch._pool is None and len(batch._shares([0])) == 1
    batch.close()  # nothing to end


def test_all_work_is_done_whatever_the_threads(batch, monkeypatch):
    done = []
    monkeypatch.setattr(episode, 'fly', lambda row, rows, actions, kind, repeat, *_: done.append(
        (tuple(rows), kind, repeat)))
    work = [((0, 1), 3, 7), ((2,), 0, 1), ((3, 4), 0, 1)]
    batch._fly(np.zeros((N, 4)), work)
    assert sorted(done) == sorted(work)


def begin(batch, monkeypatch, stages):
    """Begin episodes of all drones, which are then in some stages of the failsafe."""
    monkeypatch.setattr(batch, '_prepare', lambda i, rng: None)
    monkeypatch.setattr(batch, '_fly', lambda actions, work: batch.out.stage.__setitem__(
        slice(None), stages))
    batch.out.reward[:], batch.out.reason[:] = 9.0, episode.FLOOR
    batch.advance(np.zeros((N, 4)), range(N), [None] * N, [])


def test_an_episode_begins_without_reward_and_without_an_end(batch, monkeypatch):
    begin(batch, monkeypatch, [failsafe.FLYING] * 4 + [failsafe.HOLDING])
    assert not batch.out.reward.any()
    assert (batch.out.reason == episode.NOTHING).all()


def test_a_controller_that_does_not_reach_the_handover_is_named(batch, monkeypatch):
    with pytest.raises(JobError, match='^the controller cascaded has not brought the vehicle to '
                       f'the handover .*: it is {failsafe.STAGES[failsafe.LANDING]}$'):
        begin(batch, monkeypatch, [failsafe.FLYING] * 4 + [failsafe.LANDING])
