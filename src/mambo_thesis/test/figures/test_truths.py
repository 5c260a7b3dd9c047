"""Mutated truths: the experiment is another drone, the model beside it stays."""

from hypothesis import given, strategies as st
from mambo_flight import scenario_file
from mambo_flight.scenario import LEAVES
from mambo_model.schema import flatten
from mambo_thesis.figures import truths
from mambo_thesis.figures.truths import Mutation, MUTATIONS, Scaled
import pytest

DRAG = 'sim_node.simulator.vehicle.drag_coefficient'


def scenario(name):
    return scenario_file.load(name)[1]


@pytest.mark.parametrize('name', MUTATIONS)
def test_every_mutation_changes_parameters_that_there_are_and_nothing_else(name):
    flight = scenario('fig_5_10')
    before, after = (flatten(f) for f in (
        flight, truths.mutate(flight, MUTATIONS[name])))
    different = {key for key in before if before[key] != after[key]}
    assert different and different <= set(MUTATIONS[name].changes) <= set(LEAVES)


def test_a_change_may_multiply_a_number_or_several():
    assert Scaled(2.0).applied_to(0.22) == 0.44
    assert Scaled(2.0).applied_to((1.0, 3.0)) == (2.0, 6.0)


@pytest.mark.parametrize(('name', 'mutation', 'concerned'), [
    ('fig_6_4/experiment', 'drag x 2', True), ('fig_6_4/simulation_with_drag', 'drag x 2', False),
    ('fig_6_3/new_inertia', 'inertia x 2', True), ('fig_6_3/new_inertia', 'leak +1', False),
    ('fig_3_3', 'wind', False), ('fig_5_10', 'wind', True)])
def test_the_model_and_what_has_no_sensors_stay(name, mutation, concerned):
    with truths.mutated(MUTATIONS[mutation]):
        assert truths.mutation_of(name, scenario(name)) == (mutation if concerned else '')
    assert truths.mutation_of(name, scenario(name)) == ''


def test_a_block_has_its_own_seeds_and_leaves_none_behind():
    with truths.mutated(None, (7,)):
        assert truths.seeds() == (7,)
    assert truths.seeds() == truths.SEEDS
    with pytest.raises(RuntimeError), truths.mutated(MUTATIONS['wind'], (7,)):
        raise RuntimeError
    assert truths.seeds() == truths.SEEDS


def test_a_vehicle_that_is_not_flown_is_mutated_too():
    with truths.mutated(MUTATIONS['mass +10 %']):
        assert truths.vehicle().mass == pytest.approx(1.1 * 0.068)
    with truths.mutated(MUTATIONS['leak +1']):
        assert truths.vehicle() == truths.vehicle('identified')
    assert truths.vehicle().mass == 0.068


def test_drag_laws_are_the_same_in_hover_at_1_m_s():
    """-(f/4) k_c V, per mass and m/s, of the shipped vehicle."""
    assert truths.HOVER_RATE == pytest.approx(0.54, abs=0.001)
    changes = MUTATIONS['drag quadratic'].changes
    assert changes['sim_node.simulator.vehicle.drag.parasitic_coefficient'][0] / 0.068 == (
        pytest.approx(truths.HOVER_RATE))


def test_an_unknown_parameter_does_not_pass_silently():
    with pytest.raises(KeyError):
        truths.mutate(scenario('fig_5_10'), Mutation('x', '', {DRAG + 's': Scaled(2.0)}))


@given(factor=st.floats(-5.0, 5.0), values=st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=4))
def test_a_scaled_value_is_multiplied_each_alone(factor, values):
    assert Scaled(factor).applied_to(tuple(values)) == tuple(factor * x for x in values)
    assert Scaled(factor).applied_to(values[0]) == factor * values[0]


def test_mutations_do_not_add_up():
    """A block within another one has its own mutation and its own seeds."""
    with truths.mutated(MUTATIONS['mass +10 %'], (1,)):
        with truths.mutated(MUTATIONS['inertia x 2'], (2, 3)):
            assert truths.vehicle().mass == 0.068 and truths.seeds() == (2, 3)
        assert truths.vehicle().mass == pytest.approx(1.1 * 0.068) and truths.seeds() == (1,)


@pytest.mark.parametrize(('name', 'quantity'), [
    ('slope 0', 1.025), ('slope reversed', 1.025), ('slope x 2', 1.025), ('factor -10 %', 0.9225)])
def test_mutated_factors_are_equal_at_the_reference_height(name, quantity):
    """All slopes leave Q(1.5 m) = 1.025; the lower factor is 0.9 of it."""
    changes = MUTATIONS[name].changes
    offset, slope = (changes[f'{truths.FLOW}factor_{part}'] for part in ('offset', 'slope'))
    assert offset + 1.5 * slope == pytest.approx(quantity)
