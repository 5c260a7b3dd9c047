"""Gate: refuses outliers, opens for a filter that is wrong, never for a sensor that is stuck."""

from mambo_estimation import gate as g
import numpy as np
import pytest

DT, WIDTH, TIME = 0.04, 4.0, 1.0


def run(samples, gate=g.OPEN):
    """Judge (value, innovation) pairs, variance 1 of each component; return gate and verdicts."""
    verdicts = []
    for value, innovation in samples:
        gate = g.advance(gate, DT)
        ratio = innovation ** 2 / WIDTH ** 2
        trial = g.Trial((value, value), (innovation, innovation), 2.0, ratio)
        gate, verdict = g.judge(gate, trial, WIDTH, TIME)
        verdicts.append(verdict)
    return gate, verdicts


def test_small_innovations_pass_and_count_nothing():
    gate, verdicts = run([(0.0, 0.0), (1.0, 3.9), (2.0, -3.9)])
    assert verdicts == [g.ACCEPT] * 3 and gate.refused == 0


def test_an_outlier_is_refused_and_counted():
    gate, verdicts = run([(0.0, 0.1), (9.0, 9.0), (0.0, 0.1)])
    assert verdicts == [g.ACCEPT, g.REFUSE, g.ACCEPT] and gate.refused == 1 and gate.streak == 0


def test_refusals_that_agree_for_the_recovery_time_reset_the_filter():
    _, verdicts = run([(9.0 + 0.01 * k, 9.0) for k in range(40)])
    first = verdicts.index(g.RECOVER)
    assert first * DT == pytest.approx(TIME, abs=DT)  # age counts from the first refusal
    assert verdicts[:first] == [g.REFUSE] * first


def test_a_stuck_sensor_never_resets_the_filter():
    gate, verdicts = run([(9.0, 9.0 + 0.01 * k) for k in range(1000)])
    assert set(verdicts) == {g.REFUSE} and gate.refused == 1000


def test_a_stuck_sensor_stays_refused_when_the_filter_becomes_unsure():
    gate, verdicts = run([(9.0, 9.0), (9.0, 1.0), (9.0, 0.5), (9.1, 0.5)])
    assert verdicts == [g.REFUSE] * 3 + [g.ACCEPT]


def test_outliers_that_disagree_never_reset_the_filter():
    _, verdicts = run([(float(k), 20.0 if k % 2 else -20.0) for k in range(1000)])
    assert set(verdicts) == {g.REFUSE}


def test_one_good_sample_starts_the_clock_anew():
    bad = [(9.0 + 0.01 * k, 9.0) for k in range(20)]
    _, verdicts = run([*bad[:3], (0.0, 0.0), *bad])  # not yet distrusted: it is used
    assert g.RECOVER not in verdicts


def test_invalid_samples_are_only_counted():
    gate, _ = run([(9.0, 9.0)])
    after = g.refuse_invalid(gate)
    assert after.refused == gate.refused + 1 and after.streak == gate.streak


def test_a_sensor_that_is_mostly_refused_is_not_believed_where_a_sample_fits():
    wild = [(9.0, 9.0), (-9.0, -20.0), (20.0, 20.0), (-30.0, -30.0)]
    _, verdicts = run([*wild, *wild, (0.0, 0.1), *wild, (0.0, 0.1)])
    assert set(verdicts) == {g.REFUSE}


def test_it_is_believed_again_after_several_that_fit_and_agree():
    wild = [(30.0 * (-1) ** k + k, 30.0 * (-1) ** k) for k in range(20)]
    _, verdicts = run([*wild, *[(0.01 * k, 0.1) for k in range(10)]])
    again = g.MAX_NET_REFUSALS - g.DISTRUST + 2  # the first does not agree with the last one
    assert verdicts[20:] == [g.REFUSE] * again + [g.ACCEPT] * (10 - again)


@pytest.mark.parametrize('deviation', [0.5, 1.0, 3.0])
@pytest.mark.parametrize(('x', 'y', 'agrees'), [
    (3.99, 3.99, True), (4.01, 4.01, False), (5.6, 0.0, True), (5.7, 0.0, False),
    (0.0, -5.6, True), (0.0, -5.7, False)])
def test_refused_samples_agree_within_the_gate_over_both_components(deviation, x, y, agrees):
    # the limit: x^2 + y^2 = 4^2 times the sum of both variances
    gate, far = g.OPEN, 100.0 * deviation
    for k, innovation in enumerate([(far, far), (far + x * deviation, far + y * deviation)]):
        trial = g.Trial((float(k), 0.0), innovation, 2.0 * deviation ** 2, 99.0)
        gate, verdict = g.judge(gate, trial, WIDTH, TIME)
        assert verdict == g.REFUSE
    assert gate.streak == (2 if agrees else 1)


def test_one_sample_that_fits_takes_back_one_of_the_doubts():
    wild, fits = [(9.0, 9.0), (-9.0, -20.0), (20.0, 20.0)], (0.0, 0.1)
    _, verdicts = run([*wild, fits, (-30.0, -30.0), fits])
    assert verdicts[3] == verdicts[5] == g.ACCEPT  # three doubts, then two and one more
    _, verdicts = run([*wild, fits, (-30.0, -30.0), (40.0, 40.0), fits])
    assert verdicts[3] == g.ACCEPT and verdicts[6] == g.REFUSE  # two and two more


@pytest.mark.parametrize('seed', range(5))
def test_samples_that_scatter_about_one_value_reset_the_filter_in_spite_of_outliers(seed):
    rng = np.random.default_rng(seed)
    samples = 12.0 + 2.0 * rng.standard_normal(200)  # the limit of agreement is 5.7 apart
    samples[rng.random(200) < 0.15] += 30.0
    _, verdicts = run([(x, x) for x in samples.tolist()])
    assert TIME <= verdicts.index(g.RECOVER) * DT < 2.0 * TIME


@pytest.mark.parametrize('seed', range(5))
def test_samples_from_anywhere_never_reset_the_filter(seed):
    rng = np.random.default_rng(seed)
    samples = rng.uniform(5.0, 35.0, 1000)  # all on one side, a third of them agree with any
    assert g.RECOVER not in run([(x, x) for x in samples.tolist()])[1]


def test_a_sensor_that_is_distrusted_wins_the_vote_with_samples_that_fit():
    wild = [(30.0 * (-1) ** k + k, 30.0 * (-1) ** k) for k in range(20)]
    fits = [(1.5 * (k % 3), 3.9 * (k % 3 - 1)) for k in range(60)]  # next to each other or not
    _, verdicts = run([*wild, *fits])
    assert verdicts[-1] == g.ACCEPT


def test_scatter_is_half_the_squared_distance_from_the_centre_of_those_that_vote():
    gate = g.OPEN
    for k, innovation in enumerate([(50.0, 50.0), (53.0, 54.0)]):
        gate, _ = g.judge(gate, g.Trial((float(k), 0.0), innovation, 2.0, 99.0), WIDTH, TIME)
    assert gate.scatter == pytest.approx(g.FADE * 0.5 * (3.0 ** 2 + 4.0 ** 2))
    assert gate.innovation == pytest.approx((51.5, 52.0))  # half the way
    away, _ = g.judge(gate, g.Trial((9.0, 0.0), (-50.0, -50.0), 2.0, 99.0), WIDTH, TIME)
    assert away.scatter == gate.scatter and away.innovation == gate.innovation
    assert g.accept(gate).scatter == pytest.approx((1.0 - g.FADE) * gate.scatter)


def test_a_vote_against_the_centre_takes_one_for_it_back():
    _, verdicts = run([(9.0 + k, 9.0 if k % 5 < 3 else -20.0) for k in range(200)])
    assert g.RECOVER not in verdicts  # three of five for it: 0.2 of the votes more than against
    _, verdicts = run([(9.0 + k, 9.0 if k % 10 < 9 else -20.0) for k in range(200)])
    assert g.RECOVER in verdicts  # nine of ten: 0.8
