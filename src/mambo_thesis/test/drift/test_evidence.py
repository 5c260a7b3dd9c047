"""Which mechanisms flights of known truth support, and how sure that is."""

import math
from types import SimpleNamespace

from drift_flights import ALONE, experiments_of, flown, NOISE, thesis_of, TRUE
from mambo_thesis.drift import evidence, experiments, table
from mambo_thesis.drift.evidence import credible_models, Evidence, inclusion, separating_odds
from mambo_thesis.drift.flight import from_estimate
from mambo_thesis.drift.mechanisms import MECHANISMS, PARAMETERS
from mambo_thesis.drift.paths import DRAG_RATE
import numpy as np
import pytest
from scipy.signal import lfilter

pytestmark = pytest.mark.slow


@pytest.mark.parametrize('letter', TRUE)
@pytest.mark.long
def test_every_mechanism_is_recovered_from_the_experiments(letter):
    fits = Evidence(experiments_of(TRUE[letter])).compare()
    assert fits[0].model == (letter,)
    assert inclusion(fits)[letter] > 0.99
    for name, value in TRUE[letter].items():  # 4 sigma: 1 of 16000 fails
        assert fits[0].values[name] == pytest.approx(value, abs=4 * fits[0].sigmas[name])


def test_a_perfect_flow_needs_no_mechanism():
    fits = Evidence(experiments_of({'scale': 1.06})).compare(ALONE)
    assert fits[0].model == ()


@pytest.mark.parametrize('letter', ['A', 'C2', 'D'])
@pytest.mark.long
def test_drift_on_the_paths_of_the_thesis_does_not_separate_three_mechanisms(letter):
    fits = Evidence(thesis_of(TRUE[letter], drag=0.0), 2 * math.pi).compare()
    left = {f.model for f in credible_models(fits)}
    assert {('A',), ('C2',), ('D',)} <= left
    assert fits[0].probability < 0.5
    assert () not in left


@pytest.mark.long
def test_the_tilt_of_drag_separates_the_factor_from_the_other_two_but_not_these():
    of_a = Evidence(thesis_of(TRUE['A'], DRAG_RATE), 2 * math.pi).compare()
    assert inclusion(of_a)['C2'] + inclusion(of_a)['D'] < 0.1
    of_d = Evidence(thesis_of(TRUE['D'], DRAG_RATE), 2 * math.pi).compare()
    assert inclusion(of_d)['A'] < 0.05
    assert {('C2',), ('D',)} <= {f.model for f in credible_models(of_d)}


def test_the_experiment_that_separates_the_factor_from_rotation_is_another_speed_or_the_hand():
    fits = {f.model: f for f in Evidence(
        thesis_of(TRUE['A'], 0.0), 2 * math.pi).compare([('A',), ('D',)])}
    noise = evidence.Noise(np.zeros(8), NOISE)
    odds = separating_odds(fits['A',], fits['D',], noise, 4 * math.pi)
    assert max(odds, key=odds.get) in ('drift_w_2', 'drift_hand_loop', 'drift_w_half')
    assert max(odds.values()) > 5.0


@pytest.mark.long
def test_probabilities_come_true_as_often_as_they_say():
    """Mechanism and value from the prior, a short and noisy flight: often undecided."""
    rng, predicted, hits, trials = np.random.default_rng(7), 0.0, 0, 60
    noise = evidence.Noise(np.zeros(8), 0.15)
    spread = 0.0
    for seed in range(trials):
        model = ALONE[rng.choice(len(ALONE), p=[1 / 7, *[6 / 70] * 10])]
        values = {name: PARAMETERS[name].width * rng.normal()
                  for letter in model for name in MECHANISMS[letter].parameters}
        values['scale'] = 1.0 + 0.1 * rng.normal()
        best = Evidence([flown('(5.4)', values, seed, duration=10.0, noise=0.15)],
                        noise=noise).compare(ALONE)[0]
        predicted, hits = predicted + best.probability, hits + (best.model == model)
        spread += best.probability * (1.0 - best.probability)
    assert 0.2 * trials < predicted < 0.95 * trials  # neither always sure nor never
    assert abs(hits - predicted) < 3.0 * math.sqrt(spread)


@pytest.mark.long
def test_intervals_cover_the_truth_as_often_as_they_say():
    inside, trials = 0, 60
    for seed in range(trials):
        fit = Evidence([flown('C.4', {'slope': 0.07}, seed)],
                       noise=evidence.Noise(np.zeros(8), NOISE)).fit(('A',))
        inside += abs(fit.values['slope'] - 0.07) < 1.96 * fit.sigmas['slope']
    assert inside >= 51  # 57 expected; fewer: 1 of 400 even if the level is right


def test_a_noise_with_memory_widens_the_intervals():
    f = flown('C.4', {'slope': 0.07}, 0, duration=100.0, noise=0.0)
    rng, slow = np.random.default_rng(1), np.zeros(f.flow.shape)
    for k in range(1, len(slow)):
        slow[k] = 0.9 * slow[k - 1] + NOISE * rng.normal(size=2)
    found = Evidence([f._replace(flow=f.flow + slow)]).noise
    assert found.coefficients[0] == pytest.approx(0.9, abs=0.06)  # 3 sigma of 3200 samples
    assert found.long_run == pytest.approx(NOISE / 0.1, rel=0.4)


def test_an_estimate_that_is_not_turned_to_inertial_axes_is_found():
    flights = []
    for k, f in enumerate(experiments_of({}, seed=3)):
        body = table.without_rotation(f.track, f.flow)
        path = np.column_stack([np.cumsum(body / 32, axis=0), f.track.position[:, 2]])
        flights.append(from_estimate(f._replace(name=str(k)), f.track.t, path))
    assert Evidence(flights).compare(ALONE)[0].model == ('C2',)


def test_a_white_process_has_its_own_deviation_in_the_long_run():
    assert evidence.Noise(np.zeros(8), 0.3).long_run == 0.3
    assert evidence.Noise(np.array([0.5, 0.3]), 0.3).long_run == pytest.approx(1.5)
    assert evidence.Noise(np.array([1.2]), 0.3).long_run == pytest.approx(6.0)  # bounded


def test_windows_are_whole_and_hold_no_gap():
    t = np.delete(np.arange(0.0, 10.0, 0.1), np.arange(34, 40))  # 3.3 to 4.0 s are missing
    found = evidence._windows(SimpleNamespace(track=SimpleNamespace(t=t)), 1.0)
    spans = [(t[rows][0], t[rows][-1]) for rows in found]
    assert all(rows.stop - rows.start == 10 for rows in found)
    assert all(end - begin == pytest.approx(0.9) for begin, end in spans)
    assert [round(begin, 6) for begin, _ in spans] == [0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]


def test_the_noise_of_a_known_process_is_found():
    """AR(2) of poles 0.6 +- 0.3i: coefficients 1.2 and -0.45."""
    rng = np.random.default_rng(2)
    r = lfilter([1.0], [1.0, -1.2, 0.45], 0.02 * rng.standard_normal((20_000, 2)), axis=0)
    found = evidence._autoregression([r + [0.5, -0.3]], [np.zeros_like(r)])  # a mean is no noise
    assert found.coefficients[:2] == pytest.approx([1.2, -0.45], abs=0.03)
    assert np.abs(found.coefficients[2:]).max() < 0.03
    assert found.sigma == pytest.approx(0.02, rel=0.02)


def test_known_white_noise_is_no_part_of_the_process():
    rng = np.random.default_rng(3)
    r = lfilter([1.0], [1.0, -0.6], 0.02 * rng.standard_normal((20_000, 2)), axis=0)
    noisy = r + 0.03 * rng.standard_normal(r.shape)
    found = evidence._autoregression([noisy], [np.full_like(r, 0.03)])
    # a tenth of the white noise stays, in case that it explains all
    assert found.coefficients[0] == pytest.approx(0.6, abs=0.1)
    assert evidence._autoregression([noisy], [np.zeros_like(r)]).coefficients[0] < 0.4


@pytest.mark.long
@pytest.mark.parametrize(('key', 'letter'), [('d2', 'D'), ('f', 'F')])
def test_a_noisy_gyro_does_not_lead_astray(key, letter):
    """A closed loop whose rotation of 0.05 rad/s is measured with vibration of 0.013 rad/s."""
    asked = Evidence([experiments.fly(f'drift_w_1/{key}')])
    fits = asked.compare()
    assert inclusion(fits)[letter] > 0.95
    small = evidence.negligible(asked.flights, fits[0], asked.noise)
    assert tuple(x for x in fits[0].model if x not in small) == (letter,)


def test_a_mechanism_below_the_noise_is_minor_beside_a_larger_one():
    f = flown('C.4', {'leakage': -1.0}, 0)
    noise = evidence.Noise(np.zeros(8), NOISE)

    def of(model, **values):
        return evidence.Fit(model, {'scale': 1.0, **values}, {}, 0.0, 0.0)
    for coupling, small in ((0.02, ['E']), (0.2, [])):
        fit = of(('D', 'E'), leakage=-1.0, coupling_x=coupling, coupling_y=0.0)
        assert evidence.negligible([f], fit, noise) == small
    assert not evidence.negligible([f], of(('E',), coupling_x=0.001, coupling_y=0.0), noise)


def fits(*rows):
    return [evidence.Fit(model, {}, {}, 0.0, 0.0, probability) for model, probability in rows]


def test_a_mechanism_is_in_every_model_that_names_it():
    found = inclusion(fits((('A',), 0.5), (('A', 'D'), 0.3), (('D',), 0.15), ((), 0.05)))
    assert found['A'] == pytest.approx(0.8) and found['D'] == pytest.approx(0.45)
    assert found['F'] == 0.0 and list(found) == list(MECHANISMS)


def test_the_fewest_models_that_hold_the_level_are_not_separated():
    found = fits((('A',), 0.5), (('D',), 0.44), (('F',), 0.06))
    assert [f.model for f in credible_models(found)] == [('A',), ('D',), ('F',)]
    assert [f.model for f in credible_models(found, 0.9)] == [('A',), ('D',)]
    assert [f.model for f in credible_models(found, 0.5)] == [('A',)]


def test_priors_are_shared_by_models_of_one_size_and_probabilities_are_one_in_all():
    """Of data that say nothing the probabilities are the priors."""
    one = Evidence([flown('C.4', {}, 0, duration=6.0)], noise=evidence.Noise(np.zeros(8), 1e4))
    found = {f.model: f.probability for f in one.compare()}
    assert sum(found.values()) == pytest.approx(1.0)
    alone = [p for model, p in found.items() if len(model) == 1]
    assert sum(alone) == pytest.approx(evidence.PRIOR[1], abs=1e-3)
    assert max(alone) == pytest.approx(min(alone), rel=1e-3)
    assert found[()] == pytest.approx(evidence.PRIOR[0], abs=1e-3)


def test_a_fit_that_is_known_is_the_prior_of_the_next():
    one = Evidence([flown('C.4', {}, 0, duration=6.0)], noise=evidence.Noise(np.zeros(8), 1e4))
    known = evidence.Fit(('A',), {'scale': 1.3, 'delay': 0.0, 'slope': 0.2},
                         {'scale': 0.01, 'delay': 0.001, 'slope': 0.02}, 0.0, 0.0)
    fit = one.fit(('A',), known)
    assert fit.values['slope'] == pytest.approx(0.2, abs=1e-3)
    assert fit.sigmas['slope'] == pytest.approx(0.02, rel=1e-2)


@pytest.mark.parametrize('letter', TRUE)
def test_the_residuals_of_the_true_values_are_the_noise_alone(letter):
    known = evidence.Noise(np.zeros(8), NOISE)
    flights = [flown('(5.4)', TRUE[letter], 0, duration=6.0, noise=0.0)]
    exact, = Evidence(flights, noise=known).residuals(TRUE[letter])
    np.testing.assert_allclose(exact, 0.0, atol=2e-6)  # the height is interpolated
    without, = Evidence(flights, noise=known).residuals({})
    assert np.abs(without).max() > 1e-3


def test_whitened_residuals_of_the_true_values_have_unit_variance_in_both_forms():
    flights = [flown('(5.4)', TRUE['A'], seed) for seed in range(8)]
    known = evidence.Noise(np.zeros(8), NOISE)
    samples = Evidence(flights, noise=known).whitened(TRUE['A'])
    count = sum(2 * (len(f.track.t) - evidence.ORDER) for f in flights)
    assert len(samples) == 2 * count  # and as many terms of the width, all 0 for an exact gyro
    assert np.sum(samples ** 2) == pytest.approx(count, rel=4 * math.sqrt(2.0 / count))
    windows = Evidence(flights, 2.0, known).whitened(TRUE['A'])
    assert len(windows) < 0.05 * count
    assert np.sum(windows ** 2) == pytest.approx(
        len(windows), rel=4 * math.sqrt(2.0 / len(windows)))


def test_the_noise_of_the_gyro_widens_what_a_mechanism_of_the_rotation_explains():
    quiet = flown('(5.4)', TRUE['D'], 0, duration=6.0)
    noisy = quiet._replace(rate_noise=NOISE)  # as large as that of the flow
    known = evidence.Noise(np.zeros(8), NOISE)
    narrow, wide = (Evidence([f], noise=known).whitened(TRUE['D']) for f in (quiet, noisy))
    half = len(narrow) // 2
    np.testing.assert_allclose(wide[:half], narrow[:half] / math.sqrt(2.0), rtol=1e-12)
    np.testing.assert_allclose(wide[half:] ** 2, math.log(2.0))
    assert not narrow[half:].any()


def test_a_fit_is_the_least_of_its_cost():
    found = Evidence([flown('(5.4)', TRUE['A'], 3)], noise=evidence.Noise(np.zeros(8), NOISE))
    best = found.fit(('A',))
    for name, sigma in best.sigmas.items():
        for side in (-1.0, 1.0):
            moved = {**best.values, name: best.values[name] + side * sigma}
            assert np.sum(found.whitened(moved) ** 2) > best.chi_square
