"""The command identify_drift: what it finds in a bag, says in a sentence and refuses."""

import json

from drift_flights import flown, TOPICS, write
from mambo_analysis.importers.common import Publisher
from mambo_bags.writer import BagWriter
from mambo_thesis.drift import experiments, identify_drift
from mambo_thesis.drift.evidence import Fit, Noise
from mambo_thesis.drift.flight import read
from mambo_thesis.drift.mechanisms import MECHANISMS
import numpy as np
import pytest

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
    ('optical_flow', 'no optical_flow in it'), ('optitrack/pose', 'no optitrack/pose')])
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
    assert 'no flight has flow without a gap for a window of 60 s' in capsys.readouterr().err


def test_little_rotation_raises_a_doubt():
    flight = experiments.fly('drift_w_1/d2')  # rotation of 0.05 rad/s
    assert 'D and G may be taken for others' in identify_drift.caveat([
        flight._replace(rate_noise=0.01)])
    assert not identify_drift.caveat([flight])
    assert not identify_drift.caveat([experiments.fly('drift_w_2/d2')])


def fit(model, probability, **values):
    sigmas = dict.fromkeys(values, 0.01)
    return Fit(model, values, sigmas, -10.0, 5.0, probability)


def test_a_model_is_a_word():
    assert identify_drift.label(('A', 'D')) == 'A+D' and identify_drift.label(()) == 'none'


def test_one_sentence_says_what_the_flights_support():
    sure = identify_drift.sentence([fit(('D',), 0.97), fit((), 0.03)])
    assert sure == ('the flights support D (rotational flow left in (+) or removed twice (-)), '
                    'probability 0.97')
    small = identify_drift.sentence([fit(('D', 'E'), 0.6), fit(('D',), 0.39)], ['E'])
    assert small.endswith('probability 0.99; E beside it adds less than the noise: no finding')
    nothing = identify_drift.sentence([fit((), 0.99)])
    assert 'no mechanism: a constant scale is enough' in nothing
    torn = identify_drift.sentence([fit(('A',), 0.5), fit(('A', 'D'), 0.47), fit((), 0.03)])
    assert torn == ('these flights cannot separate A (0.50) from A+D; A is part of it '
                    '(at least 0.95)')


def test_advice_names_the_experiment_of_the_best_odds(monkeypatch):
    noise, two = Noise(np.zeros(8), 0.01), [fit(('A',), 0.5), fit(('D',), 0.5)]
    assert identify_drift.advice([fit(('A',), 1.0)], noise, None) == ''
    monkeypatch.setattr(identify_drift, 'separating', lambda *_: {'slow': 2.0, 'fast': 41.6})
    assert identify_drift.advice(two, noise, None) == (
        'A and D would be separated best by 30 s of fast (ln odds 42)')
    monkeypatch.setattr(identify_drift, 'separating', lambda *_: {'slow': 2.0, 'fast': 2.5})
    assert identify_drift.advice(two, noise, None).endswith('(at best fast, ln odds 2.5)')


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
                                ['said'])
    again = json.loads(json.dumps(found))
    assert again['flights'][0]['flow_lag_s'] == 0.03 and again['says'] == ['said']
    assert again['noise'] == {'sigma_rad_s': 0.1, 'coefficients': [1.0, 1.0]}
    assert again['models'][0]['values'] == {'scale': 1.0}
