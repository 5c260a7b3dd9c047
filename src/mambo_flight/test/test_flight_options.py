"""Options that say what is flown: which count, and what is said before the flight."""

from mambo_bags.command import Parser
from mambo_flight import flight_options, fly
from mambo_flight.course import feasibility
from mambo_flight.scenario import override, Scenario
from mambo_flight.scenario_file import from_settings, Place
from mambo_model.motion import uav_trajectories
from mambo_model.motion.polynomial import stretched
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
import pytest
import yaml


def given(*arguments):
    out = Parser('fly', 'Flies.')
    flight_options.add(out)
    options = out.parse_args(list(arguments))
    given = flight_options.given(options)
    return {name: (place.value, place.where) for name, place in given.items()}


def test_only_what_is_typed_is_a_choice_and_its_place_is_its_option():
    assert given() == {}
    assert given('--controller', 'indi', '--seed', '0', '--no-landing') == {
        'controller': ('indi', '--controller'), 'seed': (0, '--seed'),
        'landing': (False, '--no-landing')}
    assert given('--no-noise')['noise'] == (False, '--no-noise')
    assert given('--duration', '12.5')['duration'] == (12.5, '--duration')


def test_parameters_are_set_by_name_with_values_of_their_type():
    found = flight_options.overrides([
        'sim_node.simulator.vehicle.mass=0.07', ' a.b =[1, 2]', 'c.d=true', 'e.f=text=1'])
    assert found == {'sim_node.simulator.vehicle.mass': 0.07, 'a.b': [1, 2], 'c.d': True,
                     'e.f': 'text=1'}


@pytest.mark.parametrize(('text', 'wanted'), [
    ('mass', '--set mass: write node.parameter=value'),
    ('a.b=[1', r'--set a.b=\[1: cannot read the value')])
def test_a_wrong_assignment_is_named(text, wanted):
    with pytest.raises(ParameterError, match=f'^{wanted}$'):
        flight_options.overrides([text])


def test_a_parameter_that_is_set_twice_is_refused():
    with pytest.raises(ParameterError, match='^--set a.b=2: a.b is set twice: leave one out$'):
        flight_options.overrides(['a.b=1', 'c.d=1', 'a.b=2'])


@pytest.mark.parametrize(('words', 'line'), [
    (['--duration', '1', '--set', 'sim_node.duration=3'],
     '--set sim_node.duration=3 contradicts --duration 1:'),
    (['--duration', '1.25', '--set', 'sim_node.duration=3'], 'contradicts --duration 1.25:'),
    (['--seed', '2', '--set', 'sim_node.simulator.seed=3'], 'contradicts --seed 2:'),
    (['--estimator', 'kalman', '--set', 'estimator_node.estimator=joint'],
     'contradicts --estimator kalman:'),
    (['--controller', 'indi', '--set', 'controller_node.controller=cascaded'],
     '--set controller_node.controller=cascaded contradicts --controller indi:'),
    (['--no-noise', '--set', 'sim_node.simulator.noise=true'],
     '--set sim_node.simulator.noise=true contradicts --no-noise:'),
    (['--no-landing', '--set', 'reference_node.plan.landing_time=20'],
     'contradicts --no-landing:'),
    (['--drones', '2', '--set', 'world.drones=3'], 'contradicts --drones 2:')])
def test_an_option_and_a_parameter_that_contradict_are_refused(capsys, words, line):
    assert fly.main(['--trajectory', 'circle', *words, '--print-scenario']) == 2
    out, err = capsys.readouterr()
    assert not out and line in err and err.endswith(': leave one out\n')


@pytest.mark.parametrize('words', [
    ['--duration', '3', '--set', 'sim_node.duration=3'],
    ['--seed', '3', '--set', 'optitrack_node.seed=4'],
    ['--vehicle', 'toolbox', '--set', 'sim_node.simulator.vehicle.mass=0.07']])
def test_a_parameter_that_agrees_with_an_option_or_says_more_is_taken(capsys, words):
    assert fly.main(['--trajectory', 'circle', *words, '--print-scenario']) == 0


def test_a_flight_of_what_is_built_in_has_nothing_to_say():
    assert list(flight_options.remarks(Scenario())) == []


def test_a_course_far_larger_than_a_hall_is_told(tmp_path):
    file = tmp_path / 'cm.csv'
    file.write_text('t,x,y,height\n0,0,0,1.5\n90,60,0,1.5\n')
    assert list(flight_options.remarks(from_settings({
        'trajectory': Place(str(file), '--trajectory')}))) == [
        'warning: cm.csv goes 60 m from its first point: positions are in metres']


def test_a_course_that_is_too_fast_is_told_with_what_slows_it(tmp_path):
    file = tmp_path / 'fast.csv'
    file.write_text('t,x,y,height\n0,0,0,1.5\n1.4,6,0,1.5\n2.8,0,0,1.5\n')
    flight = from_settings({'trajectory': Place(str(file), '--trajectory')})
    line, = flight_options.remarks(flight)
    assert line.startswith('warning: the vehicle cannot fly ') and 'fast.csv' in line
    rate = float(line.rpartition('scale_rate=')[2].partition(' ')[0])
    assert 0.1 < rate < 1.0
    slower = override(flight, {'reference_node.plan.scale_rate': 0.99 * rate})
    assert list(flight_options.remarks(slower)) == []


@pytest.mark.parametrize(('x', 'plan', 'part', 'at'), [
    (15.0, {}, 'blend_duration, now 3 s', (5.0, 8.0)),
    (15.0, {'plan.blend_duration': 6.0}, '', None), (4.0, {}, '', None),
    (4.0, {'plan.climb_duration': 2.0, 'vehicle.mass': 0.12}, 'climb_duration, now 2 s',
     (1.0, 3.0))])
def test_a_way_to_the_course_that_is_too_fast_is_told(tmp_path, x, plan, part, at):
    file = tmp_path / 'far.csv'
    file.write_text(f't,x,y,height\n0,{x},0,2.9\n6,{x},1,2.9\n12,{x},0,2.9\n')
    flight = from_settings({'trajectory': Place(str(file), '--trajectory')})
    flight = override(flight, {f'reference_node.{name}': value for name, value in plan.items()})
    lines = [line for line in flight_options.remarks(flight) if 'time of the flight' in line]
    assert len(lines) == bool(part)
    for line in lines:
        assert line.startswith('warning: the vehicle cannot fly the way to or from far.csv: ')
        assert line.endswith(f'; lengthen it with reference_node.plan.{part}')
        assert at[0] <= float(line.partition(' at t = ')[2].partition(' ')[0]) <= at[1]


def test_the_command_prints_what_it_would_fly(tmp_path, capsys):
    path = tmp_path / 'slow.py'
    path.write_text('duration = 4.0\n\n\ndef line(t):\n    return 0.1 * t, 0.0, -1.5\n')
    assert fly.main([
        '--trajectory', str(path), '--vehicle', 'toolbox', '--duration', '30', '--set',
        'reference_node.plan.scale_rate=0.5', '--print-scenario']) == 0
    printed = yaml.safe_load(capsys.readouterr().out)
    plan = printed['/mambo/reference_node']['ros__parameters']['plan']
    assert plan['scale_rate'] == 0.5 and plan['course'].startswith('# slow.py:line, sha256 ')
    sim = printed['/mambo/sim_node']['ros__parameters']
    assert sim['duration'] == 30.0 and sim['simulator']['vehicle']['mass'] == 0.063
    assert fly.main(['--trajectory', 'circle', '--print-scenario', '-o', 'bag']) == 2
    assert capsys.readouterr() == (
        '', 'fly: --print-scenario prints and flies nothing: leave out -o/--output\n')
    assert fly.main(['--trajectory', 'circle']) == 2
    assert capsys.readouterr().err == 'fly: -o/--output is missing\n'


FAST = 't,x,y,height\n0,0,0,1.5\n1.4,6,0,1.5\n2.8,0,0,1.5\n'


def printed(capsys, *arguments):
    """Return parameters of the flight that a command line asks for: plan, and duration."""
    assert fly.main([*arguments, '--print-scenario']) == 0
    nodes = yaml.safe_load(capsys.readouterr().out)
    return (nodes['/mambo/reference_node']['ros__parameters']['plan'],
            nodes['/mambo/sim_node']['ros__parameters']['duration'])


def test_without_any_choice_the_scenario_of_no_choice_is_printed(capsys):
    plan, duration = printed(capsys)
    flight = from_settings({})
    assert plan['trajectory'] == flight.reference_node.plan.trajectory
    assert duration == flight.sim_node.duration > 0.0


def test_a_course_is_stretched_until_it_can_be_flown_and_its_flight_with_it(tmp_path, capsys):
    file = tmp_path / 'fast.csv'
    file.write_text(FAST)
    plan, duration = printed(capsys, '--trajectory', str(file))
    slow, longer = printed(capsys, '--trajectory', str(file), '--stretch', 'auto')
    course = uav_trajectories.parse(slow['course'], 'course')
    assert feasibility.check(stretched(course, 1.0 / slow['scale_rate']), Vehicle()) is None
    assert feasibility.check(stretched(course, 0.99 / slow['scale_rate']), Vehicle()) is not None
    # 2.8 s become 2.8 s over the rate; both flights end in whole seconds
    assert longer - duration == pytest.approx(2.8 / slow['scale_rate'] - 2.8, abs=1.0)
    assert slow['landing_time'] - plan['landing_time'] == longer - duration
    _, asked = printed(capsys, '--trajectory', str(file), '--stretch', '2', '--duration', '50')
    assert asked == 50.0


def test_a_factor_slows_any_trajectory(capsys):
    plan, duration = printed(capsys, '--trajectory', 'circle', '--stretch', '2')
    assert (plan['scale_rate'], duration) == (0.5, 40.0)


@pytest.mark.parametrize(('text', 'wanted'), [
    ('auto', 'fly: --stretch auto is for courses: give a number for circle\n'),
    ('slow', 'fly: --stretch slow: write a number, or auto\n'),
    ('0', 'fly: --stretch 0 must be within 0.01 to 100\n')])
def test_what_cannot_be_stretched_is_refused(capsys, text, wanted):
    assert fly.main(['--trajectory', 'circle', '--stretch', text, '-o', 'bag']) == 2
    assert capsys.readouterr().err == wanted


def test_what_was_stretched_is_said():
    line, = flight_options.remarks(Scenario(), 'auto')
    assert line.startswith('stretched: flown at 1.0000 of its speed')


def test_a_vehicle_that_cannot_lift_its_weight_is_told_before_the_flight():
    mass, battery = 'sim_node.simulator.vehicle.mass', 'sim_node.simulator.vehicle.battery'
    line, = flight_options.remarks(override(Scenario(), {mass: 0.2}))
    # 4 * 4.29e-5 * 500 ** 1.47 = 1.59 and 0.2 * 9.81 = 1.96
    assert line == ('warning: the vehicle cannot lift its weight: its most thrust is 1.59 N, its '
                    'weight 1.96 N')
    assert not list(flight_options.remarks(override(Scenario(), {mass: 0.16})))
    assert list(flight_options.remarks(override(Scenario(), {mass: 0.165})))
    full = {f'{battery}.enabled': True, f'{battery}.full_voltage': 4.2,
            f'{battery}.reference_voltage': 3.7}  # a full battery gives more thrust
    assert not list(flight_options.remarks(override(Scenario(), {mass: 0.165, **full})))
    carried = {mass: 0.2, 'sim_node.simulator.hand.enabled': True}
    assert not list(flight_options.remarks(override(Scenario(), carried)))
