"""Clocks that jump contradict the offset of a whole flight; noise, gaps and rest do not."""

from mambo_signals import clock_check
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

T = 0.01 * np.arange(6000)
S = 0.01 * np.arange(-500, 6500)


def rate(seed, scale=1.0):
    """Return a rate of about 1 Hz at the times S."""
    values = gaussian_filter1d(np.random.default_rng(seed).standard_normal(len(S)), 15.0)
    return scale * values / values.std()


def pairs(jump=0.0, at=30.0, noise=0.0, names=('roll rate', 'pitch rate'), scale=1.0):
    """Return rates of a flight and of a capture whose clock jumps at a time, both in s."""
    out = {}
    for seed, name in enumerate(names):
        true, rng = rate(seed, scale), np.random.default_rng(100 + seed)
        out[name] = (T, np.interp(T, S, true) + noise * rng.standard_normal(len(T)),
                     T + np.where(T > at, jump, 0.0), np.interp(T, S, true))
    return out


@pytest.mark.parametrize('noise', [0.0, 0.3])
@pytest.mark.parametrize('jump', [0.4, 1.0, -1.0, 3.0])
@pytest.mark.parametrize('late', [0.0, 1.0])
def test_a_jump_is_told_from_both_sides(jump, noise, late):
    """Whichever side the offset fits: late is whether it fits what comes after the jump."""
    said = clock_check.contradiction(pairs(jump, noise=noise), -jump * late)
    assert said.startswith('the clocks jump, or run differently: about t = ')
    other = -jump * (1.0 - late)
    assert f'fits an offset of {other:+.2f}' in said.replace('-0.000', '+0.000') or (
        abs(float(said.split('an offset of ')[1].split()[0]) - other) < 0.03)


@pytest.mark.parametrize('noise', [0.0, 0.5, 2.0, 20.0])
@pytest.mark.parametrize('offset', [0.0, 0.03, -0.05])
def test_one_clock_is_none(noise, offset):
    """Nor is a small error of the offset, as delays make it, or noise that hides the motion."""
    assert clock_check.contradiction(pairs(noise=noise), offset) == ''


def test_an_offset_that_fits_nowhere_is_no_jump():
    assert clock_check.contradiction(pairs(), 0.5) == ''


def test_a_climb_rate_is_not_known_in_a_gap():
    kept = (T < 20.0) | (T > 30.0)
    at, _ = clock_check.climb(T[kept], np.sin(T[kept]))
    assert len(at) and not ((at > 20.2) & (at < 29.8)).any()


def test_rest_and_signals_that_do_not_belong_together_say_nothing():
    assert clock_check.contradiction(pairs(1.0, scale=0.01), 0.0) == ''
    mixed = pairs(names=('roll rate',))
    mixed['roll rate'] = (*mixed['roll rate'][:2], T, np.interp(T, S, rate(50)))
    assert clock_check.contradiction(mixed, 0.0) == ''
    empty = np.empty(0)
    assert clock_check.contradiction({'roll rate': (empty, empty, T, T)}, 0.0) == ''
    assert clock_check.contradiction({'roll rate': (T[:300], T[:300], T, T)}, 0.0) == ''


def test_a_vote_says_when_and_by_how_much():
    """The lag is to be added to the offset: the capture's clock is 1.5 s ahead after the jump."""
    t, a, clock, b = pairs(1.5)['roll rate']
    found = list(clock_check.votes(t, a, clock, b, 0.0))
    before = [vote for vote in found if vote.t < 28.0]
    after = [vote for vote in found if vote.t > 34.0]
    assert len(before) >= 5 and all(vote.lag == 0.0 for vote in before)
    assert len(after) >= 4 and all(abs(vote.lag + 1.5) < 0.02 for vote in after)
    assert all(vote.there > 0.95 > 0.5 > vote.here for vote in after)


@pytest.mark.parametrize('rate', [0.97, 0.98, 1.02, 1.03])
def test_clocks_that_run_differently_are_told(rate):
    """The offset fits the middle; the beginning and the end show others."""
    one = {name: (t, a, s * rate, b) for name, (t, a, s, b) in pairs().items()}
    assert 'run differently' in clock_check.contradiction(one, 30.0 * (1.0 - rate))


@pytest.mark.parametrize('offset', [0.0, 0.04])
def test_a_motion_that_repeats_fits_at_each_period(offset):
    """A circle: a whole period beside the offset fits as well, and is no contradiction."""
    one = {}
    for name, phase in (('roll rate', 0.0), ('pitch rate', 1.5)):
        true = np.sin(2.5 * T + phase) + 0.05 * np.random.default_rng(1).standard_normal(len(T))
        one[name] = (T, true, T, np.sin(2.5 * T + phase))
    assert clock_check.contradiction(one, offset) == ''


def test_a_ramp_fits_every_offset_and_shows_none():
    one = pairs(names=('roll rate',))
    ramp = {'yaw rate': (T, 0.1 * T, T, np.where(T < 20.0, 0.1 * T, 8.0 - 0.1 * T))}
    assert clock_check.contradiction(one | ramp, 0.0) == ''


def test_gaps_and_missing_values_are_left_out():
    one = pairs(noise=0.1)
    for name, (t, a, s, b) in one.items():
        a[1000:1400] = np.nan
        keep = (s < 40.0) | (s > 45.0)
        one[name] = (t, a, s[keep], b[keep])
    assert clock_check.contradiction(one, 0.0) == ''


@pytest.mark.parametrize('jump', [0.0, 1.0])
def test_a_climb_alone_is_enough_if_it_is_beyond_doubt(jump):
    """A take-off at 10 s and a landing at 50 s."""
    height = 0.5 * (np.tanh((T - 10.0) / 0.6) - np.tanh((T - 50.0) / 0.6))
    seen = height + 0.005 * np.random.default_rng(0).standard_normal(len(T))
    clock = T + np.where(T > 30.0, jump, 0.0)
    climb = {'climb rate': (*clock_check.climb(T[::4], seen[::4]),
                            *clock_check.climb(clock, height))}
    said = clock_check.contradiction(climb, 0.0)
    assert ('the climb rate fits an offset of -1.0' in said) == bool(jump)
    assert len(clock_check.climb(T[:1], seen[:1])[0]) == 0
