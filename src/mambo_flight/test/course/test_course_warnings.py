"""Warnings about the course of a flight, with and without the options of the command."""

from mambo_flight import flight_options
from mambo_flight.course import course_warnings
from mambo_flight.scenario import override, Scenario
from mambo_flight.scenario_file import from_settings, Place
import pytest


@pytest.fixture
def described(tmp_path):
    """Return a function: the warnings about a course, with parameters of the reference changed."""
    def describe(text, stretch=False, **changed):
        file = tmp_path / 'mine.csv'
        file.write_text('t,x,y,height\n' + text)
        flight = override(from_settings({'trajectory': Place(str(file), 'test')}), {
            f'reference_node.{name}': value for name, value in changed.items()})
        reference = flight.reference_node
        assert list(flight_options.remarks(flight)) == [f'warning: {line}' for line in (
            course_warnings.describe(reference.plan, reference.vehicle, stretch=True))]
        return list(course_warnings.describe(reference.plan, reference.vehicle, stretch))
    return describe


FAST = '0,0,0,1.5\n1.4,6,0,1.5\n2.8,0,0,1.5\n'


def test_a_flight_of_no_course_or_of_one_that_can_be_flown_has_none(described):
    reference = Scenario().reference_node
    assert not list(course_warnings.describe(reference.plan, reference.vehicle))
    assert not described('0,0,0,1.5\n6,1,0,1.5\n')


def test_a_course_that_is_too_fast_names_the_rate_that_can_be_flown(described):
    line, = described(FAST)
    option, = described(FAST, stretch=True)
    begin, _, remedy = line.rpartition('; ')
    assert begin.startswith('the vehicle cannot fly mine.csv: ')
    assert begin.endswith(' (time of the course)') and option.startswith(f'{begin}; ')
    assert remedy.endswith(' slows it') and '--stretch' not in remedy
    rate = remedy.removesuffix(' slows it')
    assert option == f'{begin}; --stretch auto slows it: {rate}'
    name, _, value = rate.partition('=')
    assert not described(FAST, **{name.removeprefix('reference_node.'): 0.99 * float(value)})


def test_a_course_that_no_rate_makes_feasible_refers_to_the_check(described):
    line, = described('0,0,0,1.5\n6,1,0,1.5\n', **{'vehicle.mass': 0.17})
    assert ': thrust 1.6' in line and line.endswith('; mambo trajectory check says more')


def test_a_way_to_a_course_that_is_too_fast_names_what_lengthens_it(described):
    far = '0,15,0,2.9\n6,15,1,2.9\n12,15,0,2.9\n'
    line, = described(far)
    assert line.startswith('the vehicle cannot fly the way to or from mine.csv: ')
    assert line.endswith('; lengthen it with reference_node.plan.blend_duration, now 3 s')
    assert not described(far, **{'plan.blend_duration': 6.0})


def test_a_course_in_a_wrong_unit_is_told(described):
    assert described('0,0,0,1.5\n90,60,0,1.5\n') == [
        'mine.csv goes 60 m from its first point: positions are in metres']
