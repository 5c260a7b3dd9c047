"""Sweep files: each point of a grid once, draws of the distributions asked for, refusals."""

from pathlib import Path
import re

from mambo_flight.sweep import design
from mambo_model import schema
import numpy as np
import pytest
from scipy import stats

MASS = 'sim_node.simulator.vehicle.mass'


@pytest.fixture
def sweep(tmp_path):
    def read(text, head='title: mine'):
        path = tmp_path / 'mine.yaml'
        path.write_text(f'{head}\n{text}\n')
        return design.read(path)
    return read


def column(found, name):
    return [row[[axis.name for axis in found.axes].index(name)] for row in found.rows]


def test_a_grid_has_every_point_once(sweep):
    found = sweep(
        f'vary:\n  trajectory: [hover, circle]\n  seed: {{range: [3, 5]}}\n  {MASS}: 0.07')
    assert [axis.name for axis in found.axes] == ['trajectory', 'seed', MASS]
    assert found.rows == [(t, s, 0.07) for t in ('hover', 'circle') for s in (3, 4, 5)]


def test_a_grid_draws_distributions_at_each_of_its_points(sweep):
    found = sweep(f'vary:\n  seed: [1, 2]\n  {MASS}: {{uniform: [0.06, 0.07]}}',
                  'samples: 4\ndesign: grid')
    assert column(found, 'seed') == [1] * 4 + [2] * 4
    assert len(set(column(found, MASS))) == 8


def test_nothing_to_vary_is_one_flight(sweep):
    assert sweep('').rows == [()]


@pytest.mark.parametrize(('spread', 'law'), [
    ('uniform: [0.06, 0.09]', stats.uniform(0.06, 0.03)),
    ('normal: [0.068, 0.001]', stats.norm(0.068, 0.001))])
def test_draws_have_the_distribution_asked_for(sweep, spread, law):
    found = sweep(f'vary: {{{MASS}: {{{spread}}}}}', 'design: random\nsamples: 2000')
    # fixed draws: one in a thousand honest sets would be further off
    assert stats.kstest(column(found, MASS), law.cdf).pvalue > 1e-3
    assert stats.kstest(column(found, MASS), stats.norm(0.07, 0.01).cdf).pvalue < 1e-6


def test_draws_depend_on_the_seed_the_name_and_their_number_alone(sweep):
    def masses(vary='', head='samples: 9\nseed: 1'):
        text = f'vary:\n{vary}  {MASS}: {{uniform: [0.06, 0.09]}}'
        return column(sweep(text, f'design: random\n{head}'), MASS)

    known = masses()
    assert masses('  trajectory: [hover, circle]\n') == known  # another one beside it
    assert masses(head='samples: 5\nseed: 1') == known[:5]
    assert masses(head='samples: 9\nseed: 2') != known


def test_two_parameters_are_drawn_independently(sweep):
    inertia = 'sim_node.simulator.vehicle.rotor.radius'
    low, high = (dict(schema.walk(design.scenarios.Scenario))[inertia].metadata[k]
                 for k in ('low', 'high'))
    found = sweep(f'vary:\n  {MASS}: {{uniform: [0.06, 0.09]}}\n'
                  f'  {inertia}: {{uniform: [{low}, {high}]}}', 'design: random\nsamples: 1000')
    r = np.corrcoef(column(found, MASS), column(found, inertia))[0, 1]
    assert abs(r) < 4.0 / np.sqrt(1000)


def test_a_random_design_takes_each_value_of_a_list_about_as_often(sweep):
    found = sweep('vary: {trajectory: [hover, circle, step]}', 'design: random\nsamples: 900')
    counts = [column(found, 'trajectory').count(name) for name in ('hover', 'circle', 'step')]
    assert stats.chisquare(counts).pvalue > 1e-3


def test_seeds_are_drawn_once_each_before_any_is_drawn_again(sweep):
    def seeds(samples, seed=0):
        return column(sweep(
            f'vary: {{seed: {{range: [1, 50]}}, {MASS}: {{uniform: [0.06, 0.09]}}}}',
            f'design: random\nsamples: {samples}\nseed: {seed}'), 'seed')

    known = seeds(120)
    assert sorted(known[:50]) == sorted(known[50:100]) == list(range(1, 51))
    assert known[:50] != known[50:100] and len(set(known[100:])) == 20
    assert seeds(30) == known[:30] != seeds(30, 1)
    assert len(set(column(sweep('vary: {seed: {range: [1, 40]}}', 'design: random\nsamples: 40'),
                          'seed'))) == 40


@pytest.mark.parametrize(('spread', 'values'), [
    ('range: [1, 4]', [1, 2, 3, 4]), ('range: [2, 10, 3]', [2, 6, 10]), ('[7, 2]', [7, 2]),
    ('range: [5, 5]', [5])])
def test_whole_numbers_stay_whole(sweep, spread, values):
    text = spread if spread.startswith('[') else f'{{{spread}}}'
    found = column(sweep(f'vary: {{seed: {text}}}'), 'seed')
    assert found == values and all(isinstance(value, int) for value in found)


def test_a_range_of_fractions_has_both_ends(sweep):
    found = column(sweep(f'vary: {{{MASS}: {{range: [0.06, 0.08, 5]}}}}'), MASS)
    np.testing.assert_allclose(found, [0.06, 0.065, 0.07, 0.075, 0.08])


def test_vectors_are_listed_and_drawn_by_component(sweep):
    wind = 'sim_node.simulator.wind.velocity'
    assert column(sweep(f'vary: {{{wind}: [1, 0, 0]}}'), wind) == [(1.0, 0.0, 0.0)]
    assert column(sweep(f'vary: {{{wind}: [[0, 0, 0], [1, 0, 2]]}}'), wind) == [
        (0.0, 0.0, 0.0), (1.0, 0.0, 2.0)]
    drawn = column(sweep(f'vary: {{{wind}: {{normal: [[1, 0, 0], [0, 0.5, 0]]}}}}',
                         'design: random\nsamples: 400'), wind)
    np.testing.assert_array_equal(np.array(drawn)[:, [0, 2]], [[1.0, 0.0]] * 400)
    assert np.std(np.array(drawn)[:, 1]) == pytest.approx(0.5, rel=0.15)


@pytest.mark.parametrize('name', ['estimator', 'estimator_node.estimator'])
def test_a_component_of_ones_own_is_varied_by_both_names(sweep, tmp_path, name):
    ours = Path(__file__).parents[4] / 'examples/alpha_beta_filter.py'
    (tmp_path / 'mine.py').write_text(ours.read_text())
    flights = design.Flights(sweep(f'vary: {{{name}: [mine.py, kalman]}}'))
    assert flights[0].estimator_node.mine.alpha == 0.3
    assert flights[1].estimator_node.estimator == 'kalman'


@pytest.mark.parametrize(('text', 'message'), [
    ('vary: {controller: [indi], controller_node.controller: [indi]}',
     ':2: controller_node.controller: the key controller sets it as well: leave one out'),
    ('vary: {sead: 1}', ':2: sead: unknown parameter; did you mean seed'),
    ('vary: {sim_node.sped: 1}', ':2: sim_node.sped: unknown parameter; did you mean'),
    ('vary: {seed: []}', ':2: seed: is an empty list'),
    ('vary: {seed: [4, 1, 1, 1]}', ':2: seed: 1 is there 3 times; flights of one seed are one'),
    ('vary: {seed: {range: [1, 1, 2]}}', ':2: seed: 1 is there 2 times'),
    ('vary: {sim_node.simulator.seed: [1, 1]}', ':2: sim_node.simulator.seed: 1 is there 2'),
    ('vary: {seed: {poisson: [1]}}', ':2: seed: must have one of normal, range, uniform'),
    ('vary: {trajectory: {uniform: [1, 2]}}', ':2: trajectory: is not a number: give a list'),
    ('vary: {seed: {uniform: [3, 1]}}', ':2: seed: uniform must be [low, high]'),
    ('vary: {seed: {normal: [3, -1]}}', ':2: seed: normal must be [mean, standard deviation]'),
    ('vary: {seed: {normal: [3]}}', ':2: seed: normal must be two values'),
    ('vary: {seed: {range: [1, 2, 3, 4]}}', ':2: seed: range must be [first, last]'),
    ('vary: {seed: {range: [1, 2, 3]}}', ':2: seed: range must have whole numbers'),
    ('vary: {seed: {range: [1, 4, 1.5]}}', ':2: seed: range of 1.5 values'),
    ('vary: {seed: {range: [4, 1]}}', ':2: seed: range of -2 values'),
    (f'vary: {{{MASS}: {{range: [1, 2]}}}}', 'range of a fraction must be [first, last, count]'),
    (f'vary: {{{MASS}: 50}}', f'{MASS} = 50.0 kg is outside'),
    (f'vary: {{{MASS}: {{range: [0.5, 50.5, 3]}}}}', f'{MASS} = 25.5 kg is outside'),
    (f'vary: {{{MASS}: {{uniform: [2, 3]}}}}', 'drawn: '),
    ('vary: {seed: {range: [0, 9000]}, sim_node.patience: {range: [1, 9, 5000]}}',
     '45005000 flights are more than 10000000'),
    ('design: random', 'samples: missing; a random design needs it'),
    ('samples: 0', ':2: samples = 0 flights is outside'),
    ('vary: {seed: [1, 2]}\nsamples: 50', ':3: samples: has no effect, as nothing is drawn'),
    ('vary: {seed: [1, 2]}\ndesign: grid\nseed: 3', ':4: seed: has no effect, as nothing is dr'),
    ('samples: 20', ':2: samples: has no effect, as nothing is drawn'),
    ('samples: 20\ndesign: random', ':2: samples: has no effect, as nothing is drawn'),
    ('vary: {seed: {range: [1, 5]}}\ndesign: random\nsamples: 6',
     ':4: samples: of 6 flights 5 would be different, as nothing but the seed varies: give fewer'),
    ('vary: {sim_node.simulator.seed: {uniform: [1, 5]}, vehicle: toolbox}\nsamples: 40',
     ':3: samples: of 40 flights 5 would be different, as nothing but the seed varies'),
    ('vary: {trajectory: hover}\ndesign: random\nsamples: 7',
     ':4: samples: of 7 flights 1 would be different, as nothing varies: vary some'),
    ('desing: grid', ':2: desing: unknown parameter; did you mean design')])
def test_what_is_wrong_is_named_by_file_line_and_key(sweep, tmp_path, text, message):
    with pytest.raises(schema.ParameterError, match=re.escape(message)) as refused:
        sweep(text)
    assert str(tmp_path / 'mine.yaml') in str(refused.value) and '\n' not in str(refused.value)


def test_a_flight_has_the_values_of_its_row(sweep):
    found = sweep(f'vary:\n  seed: [4, 5]\n  trajectory: hover\n  {MASS}: [0.06, 0.07]')
    flights = design.Flights(found)
    one = flights[3]
    assert found.rows[3] == (5, 'hover', 0.07)
    assert one.seed == one.optitrack_node.seed == 5
    assert one.reference_node.plan.trajectory == 'hover'
    assert one.sim_node.simulator.vehicle.mass == 0.07
    assert len(flights.bases) == 1  # the seed and the mass need no scenario of their own
    assert flights[0].sim_node.simulator.vehicle.mass == 0.06


def test_values_that_contradict_each_other_are_named_with_their_flight(sweep):
    found = sweep('vary: {reference_node.plan.start_time: [6.0, 0.1]}')
    flights = design.Flights(found)
    assert flights[0].reference_node.plan.start_time == 6.0
    with pytest.raises(schema.ParameterError, match=r'mine\.yaml:2: flight 1: .*start_time'):
        flights[1]
