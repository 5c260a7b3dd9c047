"""Clocks matched over a simulated channel: delays, loss, reordering, drift and steps."""

from mambo_mocap.clock_match import BIN, ClockMatch, line_below, lower_hull, WINDOW
import numpy as np
import pytest

SECOND = 1_000_000_000
OFFSET = 1_795_000_000 * SECOND  # of this host's clock over the server's
DELAYS = {  # s: what is added to the least delay of a message
    'uniform': lambda rng: rng.uniform(0.0, 5e-3),
    'exponential': lambda rng: rng.exponential(5e-3),
    'gaussian': lambda rng: abs(rng.normal(0.0, 5e-3)),
    'triangular': lambda rng: rng.triangular(0.0, 5e-3, 5e-3)}
WORST = {'triangular': 5e-4}  # s, the others: 2e-4; of its messages hardly any is on time
ECHOES = 20.0  # Hz


def local(server, drift):
    """Return this host's time, ns, at one of the server's, s."""
    return OFFSET + round(server * (1.0 + drift) * 1e9)


def play(match, delay, drift, seconds, rate=120.0, least=2e-4, seed=1, begin=0.0, echo=True):
    """Stream frames and echoes over a channel; return (time s, error of the match s)."""
    rng = np.random.default_rng(seed)
    events = []
    for k in range(int(seconds * rate)):
        if rng.random() < 0.1:
            continue  # lost
        sent = begin + k / rate
        events.append((sent + least + delay(rng), sent, None))
    for k in range(int(seconds * ECHOES) if echo else 0):
        if rng.random() < 0.1:
            continue
        asked = begin + k / ECHOES + 0.013
        there = asked + least + delay(rng)
        events.append((there + least + delay(rng), there, asked))
    errors = []
    for arrived, sent, asked in sorted(events):  # by arrival: later ones overtake earlier ones
        if asked is None:
            match.add_arrival(round(sent * 1e9), local(arrived, drift))
            found = match.local(round(sent * 1e9))
            errors.append((sent, (found - local(sent, drift)) * 1e-9))
        else:
            match.add_echo(local(asked, drift), round(sent * 1e9), local(arrived, drift))
    return np.array(errors)


@pytest.mark.parametrize('name', DELAYS)
@pytest.mark.parametrize('drift', [0.0, 80e-6, -80e-6])
def test_stamps_are_within_a_fifth_of_a_millisecond(name, drift):
    for seed in range(3):
        match = ClockMatch()
        errors = play(match, DELAYS[name], drift, 60.0, seed=seed)
        settled = errors[errors[:, 0] > 10.0, 1]
        assert abs(settled).max() < WORST.get(name, 2e-4), (name, drift, seed)
        assert match.line.drift == pytest.approx(drift, abs=10e-6) and match.resets == 0


def test_without_echoes_stamps_are_late_by_the_least_delay():
    match = ClockMatch()
    errors = play(match, DELAYS['uniform'], 20e-6, 40.0, least=1e-3, echo=False)
    settled = errors[errors[:, 0] > 10.0, 1]
    assert not match.answered
    assert abs(settled - 1e-3).max() < 1e-4


@pytest.mark.parametrize('step', [-3.0, 0.5, 3600.0])
def test_a_clock_that_is_set_is_matched_anew(step):
    match = ClockMatch()
    play(match, DELAYS['uniform'], 0.0, 20.0)
    late = [match.resets]
    for k in range(4000):  # the server's clock is set: the same times of this host mean others
        server = 20.0 + k / 120.0
        match.add_arrival(round(server * 1e9), local(server - step, 0.0))
        late.append(match.resets)
    assert late[-1] == 1
    assert match.local(round(server * 1e9)) == pytest.approx(local(server - step, 0.0), abs=1e5)


def test_what_is_kept_is_bounded_whatever_comes():
    match = ClockMatch()
    rng = np.random.default_rng(1)
    for server, here in rng.integers(0, 2**63, (2000, 2)).tolist():
        match.add_arrival(server, here)
        match.add_echo(here, server, here + 1)
        match.local(server)
    for k in range(5000):
        match.add_arrival(k * BIN, k * BIN)
    assert len(match._late) <= WINDOW + 1 and len(match._early) <= WINDOW + 1
    assert match.local(5 * BIN) is not None


def test_before_the_first_message_there_is_no_time():
    match = ClockMatch()
    assert match.local(5) is None and match.line is None
    match.add_echo(10, 5, 8)  # received before it was sent: no echo
    assert match.local(5) is None


def test_the_line_lies_below_all_points_and_has_least_distances():
    rng = np.random.default_rng(3)
    x = np.sort(rng.uniform(0.0, 2e10, 40))
    y = 50e-6 * x + rng.exponential(1e6, 40)
    points = list(zip(x.tolist(), y.tolist()))
    slope, value = line_below(points)
    gaps = y - value - slope * x
    assert gaps.min() > -1e-3
    others = [(y - (s * x + (y - s * x).min())).sum() for s in np.linspace(-2e-4, 3e-4, 501)]
    assert gaps.sum() <= min(others) + 1e-3
    hull = lower_hull(points)
    assert hull[0] == points[0] and hull[-1] == points[-1]
