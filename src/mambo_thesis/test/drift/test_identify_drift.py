"""The command identify_drift: what it finds in a bag, says in a conclusion and refuses."""

import json
import re

from drift_flights import flown, TOPICS, TRUE, write
from mambo_analysis.importers.common import Publisher
from mambo_bags.writer import BagWriter
from mambo_thesis.drift import evidence, experiments, identify_drift
from mambo_thesis.drift.evidence import Evidence, Fit, LEAST_NOISE, misfit, Noise
from mambo_thesis.drift.flight import read
from mambo_thesis.drift.mechanisms import MECHANISMS, PARAMETERS
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

@pytest.mark.long
def test_the_command_finds_a_mechanism_in_a_bag(tmp_path, capsys):
    bag = write(tmp_path / 'bag', {'slope': 0.07, 'scale': 1.03})
    _, lag = read([bag])
    assert lag == pytest.approx(0.03, abs=0.004)
    assert identify_drift.main([
        str(bag), '--json', str(tmp_path / 'a.json'), '--figure', str(tmp_path / 'a.png')]) == 0
    found = json.loads((tmp_path / 'a.json').read_text())
    # a second mechanism that adds less than the noise is as likely as none: either comes first
    assert 'A' in found['models'][0]['model']
    assert found['models'][0]['values']['slope'] == pytest.approx(0.07, abs=0.01)
    assert (tmp_path / 'a.png').stat().st_size > 5000
    probable = [name for name, odds in found['mechanisms'].items() if odds > 0.5]
    assert probable == ['A'] and found['mechanisms']['A'] > 0.95
    assert 'the flights support A (factor rises with height, linear)' in capsys.readouterr().out


@pytest.mark.parametrize(('lacks', 'says'), [
    ('optical_flow', 'no topic optical_flow;'), ('optitrack/pose', 'no topic optitrack/pose;')])
def test_a_bag_that_lacks_something_is_refused_in_one_line(lacks, says, tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as writer:
        out = Publisher(writer, {k: v for k, v in TOPICS.items() if k != lacks})
        for k in range(200):
            if lacks != 'optical_flow':
                out.publish('optical_flow', k * 10**7, 'base_link', rate_x=0.1, quality=9)
            out.publish('imu/data_raw', k * 10**7, 'base_link', **out.imu((0.0,) * 3, (0.0,) * 3))
    assert identify_drift.main([str(tmp_path / 'bag')]) == 2
    output = capsys.readouterr().err.strip()
    assert says in output
    assert '\n' not in output


def test_too_long_a_window_is_refused(tmp_path, capsys):
    bag = write(tmp_path / 'bag', {})
    assert identify_drift.main([str(bag), '--window', '60']) == 2
    error = capsys.readouterr().err
    assert 'no flight has 60 s of flow without a gap; give a shorter --window' in error


def test_little_rotation_gives_a_warning():
    flight = experiments.fly('drift_w_1/d2')  # rotation of 0.05 rad/s
    assert 'D and G may be mistaken for other mechanisms' in identify_drift.rotation_warning([
        flight._replace(rate_noise=0.01)])
    assert not identify_drift.rotation_warning([flight])
    assert not identify_drift.rotation_warning([experiments.fly('drift_w_2/d2')])


def fit(model, probability, **values):
    sigmas = dict.fromkeys(values, 0.01)
    return Fit(model, values, sigmas, -10.0, 5.0, probability)


def test_a_model_has_a_short_name():
    assert identify_drift.label(('A', 'D')) == 'A+D' and identify_drift.label(()) == 'none'


def test_the_conclusion_names_what_the_flights_support():
    sure = identify_drift.conclusion([fit(('D',), 0.97), fit((), 0.03)])
    assert sure == ('the flights support D (rotational flow left in (+) or removed twice (-)), '
                    'probability 0.97')
    small = identify_drift.conclusion([fit(('D', 'E'), 0.6), fit(('D',), 0.39)], ['E'])
    assert small.endswith('probability 0.99; E adds less than the noise and is not a finding')
    nothing = identify_drift.conclusion([fit((), 0.99)])
    assert 'no mechanism: a constant scale is enough' in nothing
    torn = identify_drift.conclusion([fit(('A',), 0.5), fit(('A', 'D'), 0.47), fit((), 0.03)])
    assert torn == ('these flights cannot separate A (0.50) from A+D; A present with '
                    'probability of at least 0.95')


def test_the_recommendation_is_the_experiment_with_the_best_odds(monkeypatch):
    noise, two = Noise(np.zeros(8), 0.01), [fit(('A',), 0.5), fit(('D',), 0.5)]
    assert identify_drift.recommendation([fit(('A',), 1.0)], noise, None) == ''
    monkeypatch.setattr(identify_drift, 'separating_odds', lambda *_: {'slow': 2.0, 'fast': 41.6})
    assert identify_drift.recommendation(two, noise, None) == (
        '30 s of fast would separate A and D best (ln odds 42)')
    monkeypatch.setattr(identify_drift, 'separating_odds', lambda *_: {'slow': 2.0, 'fast': 2.5})
    assert identify_drift.recommendation(two, noise, None).endswith('(best: fast, ln odds 2.5)')


def test_the_apparent_factor_is_that_of_the_sensor_at_each_height():
    f = flown('C.4', {'slope': 0.1}, 0, noise=0.0)
    edges = np.linspace(0.6, 2.4, 7)
    found = identify_drift.apparent_factor(f, f.flow, edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    # the height within a bin is not even: half of a bin of 0.3 m times the slope
    np.testing.assert_allclose(found, 1.0 + 0.1 * (middle - 1.5), atol=0.1 * 0.15)
    assert np.isnan(identify_drift.apparent_factor(f, f.flow, np.array([4.0, 5.0]))).all()


def test_a_table_has_intervals_and_every_mechanism():
    lines = identify_drift.table([fit(('A',), 0.9, scale=1.03, slope=0.07),
                                  fit((), 0.1, scale=1.0)]).splitlines()
    assert lines[1].split()[:3] == ['A', '0.9000', '-10.0']
    assert 'scale 1.03 +- 0.02, slope 0.07 +- 0.02 1/m' in lines[1]
    assert lines[2].startswith('none ')
    shares = {line.split()[0]: float(line.split()[1]) for line in lines[5:]}
    assert shares['A'] == 0.9 and shares['D'] == 0.0 and len(shares) == len(MECHANISMS)


def test_the_figure_has_a_bar_for_each_mechanism_and_a_line_for_each_flight():
    flights = [flown('C.4', {'slope': 0.1}, k) for k in range(2)]
    found = [fit(('A',), 0.9, scale=1.0, slope=0.1), fit((), 0.1, scale=1.0)]
    left, right = identify_drift.draw(flights, found).axes
    assert [bar.get_height() for bar in left.patches][:1] == [0.9]
    assert len(left.patches) == len(MECHANISMS) and len(right.lines) == 4
    assert right.get_title() == 'line: A'


def test_data_for_json_is_plain():
    f = flown('C.4', {}, 0)
    found = identify_drift.data([f], 0.03, [fit((), 1.0, scale=1.0)], Noise(np.ones(2), 0.1),
                                ['a sentence'])
    again = json.loads(json.dumps(found))
    assert again['flights'][0]['flow_lag_s'] == 0.03 and again['summary'] == ['a sentence']
    assert again['noise'] == {'sigma_rad_s': 0.1, 'coefficients': [1.0, 1.0]}
    assert again['models'][0]['values'] == {'scale': 1.0}


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['--window', '-1'], '--window: -1 must be more than 0'),
    (['--min-height', '0'], '--min-height: 0 must be more than 0'),
    (['--flow-lag', '2'], '--flow-lag: 2 must be within -1 to 1 s'),
    (['--height', 'barometer'], "'barometer' is not one of optitrack, sonar")])
def test_wrong_options_are_refused_before_a_bag_is_read(arguments, expected, capsys):
    with pytest.raises(SystemExit) as exit_:
        identify_drift.main(['nowhere', *arguments])
    assert exit_.value.code == 2 and expected in capsys.readouterr().err


@pytest.mark.parametrize(('text', 'lag'), [('auto', None), ('0.03', 0.03), ('-0.5', -0.5)])
def test_a_lag_is_a_number_of_seconds_or_found(text, lag):
    assert identify_drift.parser().parse_args(['BAG', '--flow-lag', text]).flow_lag == lag


def rotating(noise, rate=0.5):
    """Return a flight that pitches at a rate, measured with a noise."""
    f = flown('C.4', {}, 0)
    omega = np.tile([0.0, rate, 0.0], (len(f.track.t), 1))
    return f._replace(track=f.track._replace(omega=omega), rate_noise=noise)


@pytest.mark.parametrize(('noise', 'warned'), [(0.0, False), (0.05, False), (0.1, True)])
def test_rotation_is_warned_of_by_its_share_of_noise(noise, warned):
    """The power of the noise over that of the rotation, (0.5^2)/2 per axis, against 3 %."""
    share = noise**2 / (0.5**2 / 2.0)
    assert (share > identify_drift.MAX_NOISE_SHARE) == warned
    text = identify_drift.rotation_warning([rotating(noise)])
    assert bool(text) == warned
    if warned:
        assert '0.354 rad/s measured with a noise of 0.100 rad/s' in text


def test_the_table_shows_at_most_twelve_models_that_are_not_separated():
    many = [fit((letter,), 0.05) for letter in MECHANISMS] * 2
    rows = identify_drift.table(many).splitlines()
    assert rows.index('') == 1 + 12
    few = [fit(('A',), 0.99), *[fit((letter,), 0.001) for letter in 'CDEFGHI']]
    assert identify_drift.table(few).splitlines().index('') == 1 + identify_drift.SHOWN_MODELS


def test_an_estimate_is_examined_in_place_of_the_flow(monkeypatch, capsys):
    calls = []

    def read(paths, namespace, lag, height, min_height, estimate):
        calls.append((lag, height, min_height, estimate))
        return [flown('C.4', {'slope': 0.07}, 0)], 0.0
    monkeypatch.setattr(identify_drift, 'read', read)
    assert identify_drift.main(['BAG', '--estimate', 'estimate/odom', '--height', 'sonar',
                                '--flow-lag', '0.01', '--min-height', '0.6']) == 0
    assert calls == [(0.01, 'sonar', 0.6, 'estimate/odom')]
    output = capsys.readouterr().out
    assert output.startswith('C.4: ') and 'flow lags by 0 ms' in output
    assert 'probability of each mechanism, alone or in a pair' in output


def test_json_on_the_terminal_replaces_the_text(monkeypatch, capsys):
    monkeypatch.setattr(identify_drift, 'read', lambda *_: (
        [flown('C.4', {'slope': 0.07}, 0)], 0.025))
    assert identify_drift.main(['BAG', '--json', '-']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['flights'][0]['flow_lag_s'] == 0.025
    assert found['models'][0]['model'] == ['A'] and found['summary'][0].startswith('the')
    assert sum(model['probability'] for model in found['models']) == pytest.approx(1.0)


def spoilt(f, late=0.0, degrees=0.0):
    """Return a flight whose flow is late, in s, and turned."""
    turn = Rotation.from_euler('z', degrees, degrees=True).as_matrix()[:2, :2]
    t = f.track.t
    return f._replace(flow=np.column_stack([
        np.interp(t - late, t, column) for column in f.flow.T]) @ turn.T)


@pytest.mark.parametrize(('path', 'late', 'degrees', 'reason'), [
    ('C.4', 0.1, 0.0, 'needs delay = '), ('C.4', 0.2, 0.0, 'needs delay = '),
    ('(5.4)', 0.0, 5.0, 'needs delay = '), ('C.4', 0.0, 5.0, 'leaves 0.049 rad/s that follow')])
def test_data_that_no_mechanism_explains_have_no_probabilities(
        path, late, degrees, reason, monkeypatch, tmp_path, capsys):
    f = spoilt(flown(path, {'slope': 0.07, 'scale': 1.03}, 0), late, degrees)
    monkeypatch.setattr(identify_drift, 'read', lambda *_: ([f], 0.0))
    assert identify_drift.main(['BAG', '--json', str(tmp_path / 'a.json')]) == 1
    out, error = capsys.readouterr()
    assert not out and error.count('\n') == 1 and not (tmp_path / 'a.json').exists()
    assert f'{path}: none of the mechanisms explains these flights: the best, ' in error
    assert reason in error


@pytest.mark.parametrize(('offset', 'explains'), [(-0.2, True), (-0.95, False)])
def test_an_offset_that_leaves_nothing_of_the_height_explains_nothing(
        offset, explains, monkeypatch):
    asked = Evidence([flown('C.4', {}, 0)])
    low = asked.flights[0].track.height.min()
    fit = asked.fit(('H',))._replace(values={'height_offset': offset * low})
    asked.window = 1.0  # s: its values alone are asked
    monkeypatch.setitem(PARAMETERS, 'height_offset', PARAMETERS['height_offset']._replace(
        width=1.0))
    reason = misfit(asked, fit)
    assert (reason == '') == explains
    assert explains or f'which leaves {0.05 * low:.2g} m of a height of {low:.2f} m' in reason


@pytest.mark.parametrize(('step', 'warned'), [(0.0, False), (0.5, False), (1.1, True)])
def test_a_flow_coarser_than_the_motion_is_warned_of(step, warned):
    f = flown('C.4', {}, 0)
    step *= np.sqrt(np.mean((f.track.nu[:, :2] / f.track.depth[:, None]) ** 2))  # rad/s
    if step:
        f = f._replace(flow=step * np.round(f.flow / step))
    line = identify_drift.resolution_warning([f])
    assert bool(line) == warned
    assert not warned or line.startswith(f'coarse flow: its least value, {step:.3f} rad/s, is not')
    assert identify_drift.resolution_warning([f._replace(flow=0.0 * f.flow)]) == ''


@pytest.mark.parametrize('path', ['C.4', '(5.4)'])
@pytest.mark.parametrize('letter', ['A', 'B', 'D', 'E', 'F', 'G'])
def test_a_true_mechanism_explains_its_flight(path, letter):
    asked = Evidence([flown(path, TRUE[letter], 0)])
    assert misfit(asked, asked.fit((letter,))) == ''


def test_a_flow_without_noise_is_no_error_of_mathematics():
    exact = Evidence([flown('C.4', {'slope': 0.07}, 0, noise=0.0)])
    assert exact.noise.sigma >= LEAST_NOISE


def test_a_gyro_noisier_than_the_flow_allows_leaves_a_noise_of_the_flow():
    """White noise of which a smooth residual has none: the rest would have a power below 0."""
    rng = np.random.default_rng(0)
    r = gaussian_filter1d(0.1 * rng.standard_normal((2000, 2)), 2.0, axis=0)
    found = evidence._autoregression([r], [np.full_like(r, 0.5 * r.std())])
    plain = evidence._autoregression([r], [np.zeros_like(r)])
    assert 0.3 * plain.sigma < found.sigma <= plain.sigma


@pytest.mark.parametrize('far, reason', [(1.0, ''), (3.0, ''), (6.0, 'standard deviations')])
def test_values_that_are_improbable_by_their_prior_are_those_of_no_mechanism(far, reason):
    """Three standard deviations happen once in 370 flights, six once in 500 million."""
    asked = Evidence([flown('C.4', {'slope': 0.07}, 0)])
    fit = asked.fit(('A',))
    width = evidence.PARAMETERS['slope'].width
    moved = fit._replace(values={**fit.values, 'slope': far * width})
    # displacements only: what is left of the samples is not looked at
    found = misfit(Evidence(asked.flights, 2 * np.pi), moved)
    assert (reason in found) if reason else found == ''
    if reason:
        assert found.startswith('needs slope = ') and f'{far:.1f} ' in found


def test_what_follows_the_motion_is_told_with_its_size():
    """Without its mechanism a flight's residual is the drift that this one explains."""
    asked = Evidence([flown('C.4', {'slope': 0.3}, 0)])
    fit = asked.fit(('A',))
    text = misfit(asked, fit._replace(values={**fit.values, 'slope': 0.0}))
    assert re.match(r'leaves 0\.\d{3} rad/s that follow the motion', text)
