"""Clocks that jump contradict the offset of a whole flight; noise, gaps and rest do not."""

from mambo_signals import clock_check
from mambo_signals.time_offset import AlignError
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


T_WINDOWS = np.arange(10.0, 70.0, 10.0)  # s, middles of windows


def scattered(offset, noise=3e-3):
    """Return offsets of windows with an error of each, s."""
    return offset + noise * np.random.default_rng(4).standard_normal(len(T_WINDOWS))


@pytest.mark.parametrize('ppm', [0.0, 50.0, 500.0, -500.0])
def test_crystals_that_differ_are_no_wrong_rate(ppm):
    """The worst of cheap crystals is 100 ppm off: 6 ms in a minute."""
    clock_check.refuse_slope(T_WINDOWS, scattered(0.4 + ppm * 1e-6 * T_WINDOWS))


@pytest.mark.parametrize('rate, word', [(0.01, 'slow'), (-0.01, 'fast'), (0.004, 'slow')])
def test_a_wrong_rate_is_told_with_its_size_and_sign(rate, word):
    size = 100.0 * abs(1.0 / (1.0 + rate) - 1.0)
    with pytest.raises(AlignError, match=f'runs {size:.2g} % too {word} for the flig'):
        clock_check.refuse_slope(T_WINDOWS, scattered(rate * T_WINDOWS, noise=1e-4))


@pytest.mark.parametrize('size', [0.15, -0.4])
@pytest.mark.parametrize('after', [1, 3, 5])
def test_a_jump_is_told_with_both_offsets(size, after):
    offset = scattered(1.2 + size * (np.arange(6) >= after), noise=1e-3)
    with pytest.raises(AlignError, match=r'the clocks jump: the offset is \+1\.\d+ s until') as e:
        clock_check.refuse_jump(T_WINDOWS, offset)
    before, later = (float(part.split(' s')[0]) for part in (
        str(e.value).split('offset is ')[1], str(e.value).split(' and ')[1]))
    assert later - before == pytest.approx(size, abs=0.01)


@pytest.mark.parametrize('offset', [
    np.zeros(6), scattered(0.3), scattered(0.3, noise=0.03), 0.3 + 0.01 * (np.arange(6) >= 3)])
def test_offsets_that_scatter_are_no_jump(offset):
    clock_check.refuse_jump(T_WINDOWS, offset)


def test_a_window_that_met_a_jump_counts_to_neither_side():
    offset = np.array([0.5, 0.5, 0.5, 0.61, 0.7, 0.7]) + 1e-4 * np.arange(6)
    with pytest.raises(AlignError, match=r'until t = 30.0 s .* from 50.0 s on'):
        clock_check.refuse_jump(T_WINDOWS, offset)


def stretched(rate, **kwargs):
    """Return rates of a flight and of a capture whose times are all multiplied by a rate."""
    return {name: (t, a, rate * s + 7.0, b) for name, (t, a, s, b) in pairs(**kwargs).items()}


@pytest.mark.parametrize('noise', [0.0, 0.5])
@pytest.mark.parametrize('rate, said', [
    (1.01, '1 % too fast'), (0.99, '0.99 % too slow'), (1.05, '5 % too fast'),
    (1.2, '20 % too fast'), (100.0 / 120.0, '17 % too slow')])
def test_a_wrong_rate_is_told_without_an_offset(rate, said, noise):
    assert clock_check.wrong_rate(stretched(rate, noise=noise)) == (
        f'the clock of the motion capture runs {said} for the flight: import it with the right '
        'frame rate')


@pytest.mark.parametrize('rate', [1.0, 1.0001, 0.999])
@pytest.mark.parametrize('noise', [0.0, 0.5, 2.0, 20.0])
def test_a_right_rate_is_not_told_whatever_the_noise(rate, noise):
    assert clock_check.wrong_rate(stretched(rate, noise=noise)) == ''


@pytest.mark.parametrize('seconds', [0.7, 1.5])
@pytest.mark.parametrize('noise', [0.5, 2.0])
def test_a_gyro_of_a_second_tells_no_rate(seconds, noise):
    """Any motion is like a part of another at one of many rates: 3 to 11 of 12 were told."""
    there = (T > 20.0) & (T < 20.0 + seconds)
    for seed in range(12):
        true, rng = rate(10 * seed), np.random.default_rng(seed)
        gyro = np.interp(T[there], S, true) + noise * rng.standard_normal(there.sum())
        one = {'roll rate': (T[there], gyro, T, np.interp(T, S, true))}
        assert clock_check.best_rate(one) == 1.0


@pytest.mark.parametrize('rate', [1.0, 0.97, 1.03])
def test_a_slow_sine_of_the_height_tells_a_rate(rate):
    """A few periods of a motion are few independent samples, but what is left of them is noise."""
    t = T[:3000]
    height = 0.3 * np.sin(1.8 * t)
    seen = height + 0.005 * np.random.default_rng(0).standard_normal(len(t))
    climb = {'climb rate': (*clock_check.climb(t[::4], seen[::4]),
                            *clock_check.climb(rate * t, height))}
    assert bool(clock_check.wrong_rate(climb)) == (rate != 1.0)


@pytest.mark.parametrize('jump', [0.15, -0.3, 0.6, 3.0])
@pytest.mark.parametrize('at', [20.0, 30.0, 45.0])
def test_a_jump_is_no_wrong_rate(jump, at):
    """A rate fits better than none, but each side of the jump fits best without it."""
    assert clock_check.wrong_rate(pairs(jump, at=at)) == ''


def test_a_signal_of_noise_hides_no_wrong_rate():
    rng, one = np.random.default_rng(9), stretched(1.02, names=('roll rate',))
    for name in ('pitch rate', 'yaw rate', 'climb rate'):
        one[name] = (T, rng.standard_normal(len(T)), 1.02 * T + 7.0, rng.standard_normal(len(T)))
    assert '2 % too fast' in clock_check.wrong_rate(one)


@pytest.mark.parametrize('rate', [1.0, 1.01])
def test_the_ends_of_a_climb_of_which_a_part_is_missing_tell_no_rate(rate):
    """Ranges below 0.15 m are not known, at take-off and landing; smoothing changes those ends."""
    height = 0.6 * (np.tanh((T - 10.0) / 0.6) - np.tanh((T - 50.0) / 0.6))
    low = height < 0.15
    climb = {'climb rate': (*clock_check.climb(T[~low][::4], height[~low][::4]),
                            *clock_check.climb(rate * T, height))}
    assert bool(clock_check.wrong_rate(climb)) == (rate != 1.0)


def test_rest_gaps_and_other_motions_have_no_rate():
    assert clock_check.wrong_rate({}) == ''
    assert clock_check.wrong_rate(stretched(1.02, scale=0.01)) == ''
    empty = np.empty(0)
    assert clock_check.wrong_rate({'roll rate': (empty, empty, T, T)}) == ''
    other = {name: (t, a, s, rate(50 + k)[500:6500]) for k, (name, (t, a, s, _)) in enumerate(
        pairs().items())}
    assert clock_check.wrong_rate(other) == ''
    one = stretched(1.02)
    for name, (t, a, s, b) in one.items():
        a[1000:1400] = np.nan
        keep = (T < 40.0) | (T > 45.0)
        one[name] = (t, a, s[keep], b[keep])
    assert '2 % too fast' in clock_check.wrong_rate(one)


def test_of_a_long_recording_the_part_that_moves_most_is_stretched():
    rest = 20000
    one = {}
    for name, (t, a, _, b) in stretched(1.01).items():
        still = np.zeros(rest)
        times = 0.01 * np.arange(2 * rest + len(t))
        one[name] = (times, np.concatenate([still, a, still]), 1.01 * times,
                     np.concatenate([still, b, still]))
    assert '1 % too fast' in clock_check.wrong_rate(one)


@pytest.mark.parametrize('rate', [1.0, 1.0005, 0.999])
def test_the_change_of_the_offset_is_that_of_a_drift(rate):
    """Evenly over 60 s; the middles of six windows span 50 s of them."""
    one = stretched(rate)
    middle = 30.0 * (1.0 - rate) - 7.0
    windows = clock_check.window_offsets(one, middle, {})
    assert len(windows) == 6 and (windows[:, 2] < 2e-3).all()
    np.testing.assert_allclose(windows[:, 1] - middle, (1.0 - rate) * np.linspace(
        -25.0, 25.0, 6), atol=2e-3)
    if abs(rate - 1.0) < 6e-4:
        spread = abs(1.0 - rate) * np.linspace(-25.0, 25.0, 6).std()
        assert clock_check.change(one, middle, {}) == pytest.approx(spread, abs=1e-3)
        assert clock_check.change(one, middle, dict.fromkeys(one, 0.03)) == 0.0
    else:
        with pytest.raises(AlignError, match=r'runs 0.1 % too slow for the flight'):
            clock_check.change(one, middle, {})


def test_no_signals_and_a_short_flight_have_no_windows():
    assert clock_check.window_offsets({}, 0.0, {}).shape == (0, 3)
    short = {name: (t[:700], a[:700], s[:700], b[:700]) for name, (t, a, s, b) in pairs().items()}
    assert clock_check.change(short, 0.0, {}) == 0.0


def test_a_ramp_has_no_offset_of_its_own():
    """It fits every offset with another bias."""
    one = pairs(names=('roll rate',))
    slow = 0.5 * T + 0.01 * np.sin(T)
    windows = clock_check.window_offsets({'yaw rate': (T, slow, T, slow)}, 0.0, {})
    assert len(windows) == 0
    assert clock_check.change(one | {'yaw rate': (T, slow, T, slow)}, 0.0, {}) == 0.0


def test_a_rate_of_a_few_seconds_counts_from_its_change_on():
    """1 % of 4 s is 0.04 s, less than ``CHANGE``; 3 % is more."""
    for rate, told in ((1.01, False), (1.03, True)):
        short = {name: (t[:400], a[:400], rate * s[:400], b[:400])
                 for name, (t, a, s, b) in pairs().items()}
        assert bool(clock_check.wrong_rate(short)) == told


@pytest.mark.parametrize('names, least, found', [
    (('roll rate',), 1, 0.98), (('roll rate',), 2, 1.0), (('roll rate', 'pitch rate'), 2, 0.98)])
def test_so_many_signals_must_show_a_rate(names, least, found):
    rate = clock_check.best_rate(stretched(1.02, names=names), least=least)
    assert rate == pytest.approx(found, abs=1e-9)


def test_a_rate_must_fit_as_clearly_as_is_asked():
    """With a noise as large as half of the signal a rate explains less of it."""
    one = stretched(1.02, noise=0.5)
    assert clock_check.best_rate(one, 2.0) == pytest.approx(0.98, abs=1e-9)
    assert clock_check.best_rate(one, 1e3) == 1.0


def test_what_a_line_leaves_of_values():
    bend = np.sin(T)
    np.testing.assert_allclose(
        clock_check._bend(T, bend + 3.0 * T - 2.0), clock_check._bend(T, bend), atol=1e-9)
    assert np.abs(clock_check._bend(T, 3.0 * T - 2.0)).max() < 1e-9
    assert len(clock_check._bend(T[:2], T[:2])) == 0


@pytest.mark.parametrize('ranged', [True, False])
def test_the_climb_joins_the_turn_rates_and_only_the_flight_counts(ranged):
    heights = (T, 0.5 * T, S, 0.5 * S) if ranged else None
    turns = pairs()
    found = clock_check.while_flying(turns, heights, 10.0, 20.0)
    assert list(found) == [*turns, *['climb rate'] * ranged] and len(turns) == 2
    for name, (t, values, *other) in found.items():
        assert len(t) == len(values) and 10.0 <= t.min() < t.max() <= 20.0
        if name in turns:
            np.testing.assert_array_equal(other, turns[name][2:])
    if ranged:
        _, climb, _, captured = found['climb rate']
        assert climb == pytest.approx(0.5) and captured[100:-100] == pytest.approx(0.5)


@pytest.mark.parametrize(('sigma', 'least', 'most'), [(0.1, 1000.0, None), (30.0, None, 16.0)])
def test_evidence_for_a_rate_grows_with_what_the_signal_shows(sigma, least, most):
    rng = np.random.default_rng(4)
    true = gaussian_filter1d(rng.standard_normal(2000), 5.0, mode='wrap')
    true /= true.std()
    seen = np.interp(np.arange(0.0, 1999.0, 1.05), np.arange(2000), true)  # too fast by 5 %
    grids = [clock_check.Grid(0.0, 0.02, one + sigma * rng.standard_normal(len(one)),
                              np.ones(len(one), bool)) for one in (true, seen)]
    found = clock_check._evidence({'a': grids[0]}, {'a': grids[1]}, 1.05)
    assert (least is None or found > least) and (most is None or found < most)
    assert clock_check._evidence({'a': grids[0]}, {'a': grids[1]}, 1.0) == 0.0


def test_a_signal_is_stretched_and_compared_where_both_are_there():
    there = np.arange(10) != 4
    one = clock_check.Grid(0.0, 0.5, np.arange(10.0), there)
    long = clock_check._stretched(one, 2.0)
    np.testing.assert_array_equal(long.values, np.arange(0.0, 9.0, 0.5))
    assert (long.values[~long.there] > 3.4).all() and (long.values[~long.there] < 4.6).all()
    a, b = clock_check._common(one, one, 3)
    np.testing.assert_array_equal(a - 3.0, b)
    assert 4.0 not in a and 4.0 not in b and len(a) == 5
