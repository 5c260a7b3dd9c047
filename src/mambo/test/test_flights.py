"""Flights from a script."""

import dataclasses
import math
from pathlib import Path
import pickle
import re

import mambo
from mambo import flights
from mambo_control.command import thrust_and_torque
from mambo_flight import closed_loop, fly as command
from mambo_flight.scenario import to_yaml
from mambo_model.schema import quantity
from mambo_model.values import Parameters
import numpy as np
import pytest


@pytest.fixture(scope='module')
def flight():
    return mambo.fly(trajectory='hover', duration=2.0, seed=3, landing=False)


def test_a_flight_is_that_of_the_closed_loop(flight):
    again = closed_loop.fly(flight.scenario, inner=True)
    np.testing.assert_array_equal(flight.recording.truth, again.truth)
    assert flight.scenario.seed == 3 and flight.t[-1] == 2.0


def test_the_table_holds_the_columns_of_the_recording(flight):
    table = flight.to_pandas()
    assert table.index.name == 't' and len(table) == 401
    np.testing.assert_array_equal(table['truth']['z'], flight.recording.truth[:, 2])
    np.testing.assert_array_equal(
        table['estimate'][list('pqr')], flight.recording.estimate[:, 10:])
    np.testing.assert_array_equal(table['pwm']['4'], flight.recording.pwm[:, 3])
    assert table['command']['phase'].max() == 1


def test_metrics_are_those_of_the_arrays(flight):
    r = flight.recording
    wrong = np.linalg.norm(r.estimate[:, :3] - r.truth[:, :3], axis=1)
    assert flight.metrics['estimation_final'] == pytest.approx(wrong[-1], rel=1e-12)
    assert repr(flight).startswith('<Flight hover_joint: 2 s, tracking RMS 0.')


@pytest.mark.long
def test_a_flight_that_never_took_off_says_so():
    grounded = mambo.fly(trajectory='hover', estimator='ground_truth', duration=1.0)
    assert repr(grounded) == '<Flight hover_ground_truth: 1 s, never took off>'


def test_a_vehicle_that_a_hand_carries_has_no_tracking_error_and_takes_no_energy():
    carried = mambo.fly(trajectory='hand_loop', duration=2.0, landing=False, parameters={
        'sim_node.simulator.hand.enabled': True,
        'sim_node.simulator.hand.plan.trajectory': 'hand_loop'})
    assert math.isnan(carried.metrics['tracking_rms']) and carried.metrics['energy'] == 0.0
    error = carried.metrics['estimation_rms']
    assert repr(carried).endswith(f' 2 s, carried by hand, estimation RMS {error:.4g} m>')


def test_a_flight_that_was_not_flown_as_asked_says_why(flight):
    assert not flight.failure
    light = mambo.fly(trajectory='hover', duration=15.0, believed='identified',
                      controller='cascaded',
                      parameters={'sim_node.simulator.vehicle.mass': 0.05})
    assert 'above its reference, from' in light.failure and light.failure in repr(light)
    assert light.metrics['strayed'] and not light.metrics['fallen']


def test_a_saved_bag_is_that_of_the_command(tmp_path, capsys):
    file = tmp_path / 'flight.yaml'
    flight = mambo.fly('fig_5_11', parameters={'sim_node.duration': 2.0})
    file.write_text(to_yaml(flight.scenario))
    flight.save(tmp_path / 'ours')
    assert command.main([str(file), '--output', str(tmp_path / 'theirs')]) == 0, capsys
    ours, theirs = (next((tmp_path / name).glob('*.mcap')).read_bytes()
                    for name in ('ours', 'theirs'))
    assert ours == theirs


def test_a_flight_of_a_file_whose_name_is_not_utf_8_has_a_bag(tmp_path):
    file = tmp_path / 'fl\udcfcg.yaml'
    file.write_text('title: Hover\ntrajectory: hover\nduration: 2\nlanding: false\n')
    assert mambo.fly(file).bag.path.name == r'fl\xfcg'


def test_a_course_that_cannot_be_flown_is_one_warning_at_the_line_of_the_call(monkeypatch):
    def quick(t):
        return 2.0 * math.sin(5.0 * t) - 10.0 * t * math.exp(-t), 0.0, -1.5
    quick.duration = 3.0
    monkeypatch.setattr(flights.supervised, 'fly', lambda *_, **__: (None, ''))
    with pytest.warns(UserWarning, match='the vehicle cannot fly .*quick.*: tilt') as found:
        mambo.fly(trajectory=quick)
    assert len(found) == 1 and found[0].filename == __file__
    assert str(found[0].message).endswith(' slows it')


def test_a_vehicle_too_heavy_and_a_fault_after_the_end_are_one_warning(monkeypatch):
    monkeypatch.setattr(flights.supervised, 'fly', lambda *_, **__: (None, ''))
    late = {'kind': 'stuck', 'start': 9.0, 'duration': 1.0}
    with pytest.warns(UserWarning) as found:
        mambo.fly(trajectory='hover', duration=3.0, landing=False, parameters={
            'sim_node.simulator.vehicle.mass': 0.2, **{
                f'sim_node.simulator.faults.sonar.{name}': value for name, value in late.items()}})
    faults, heavy = str(found[0].message).split('\n')
    assert 'sonar never happens: it begins at 9 s, and the flight ends at 3 s' in faults
    assert heavy.startswith('the vehicle cannot lift its weight')


def test_parameters_are_applied_last(flight):
    other = mambo.fly(flight.scenario, parameters={'sim_node.simulator.vehicle.mass': 0.07})
    assert other.scenario.sim_node.simulator.vehicle.mass == 0.07
    assert not np.array_equal(other.recording.truth, flight.recording.truth)


@pytest.mark.parametrize('arguments, what', [
    ({'trajectory': 'circel'}, "'circel'"), ({'scenario': 'fig_9_99'}, 'fig_9_99'),
    ({'duration': -1.0}, 'duration'), ({'duration': float('nan')}, 'duration'),
    ({'parameters': {'sim_node.mass': 1.0}}, 'sim_node.mass'), ({'seed': -1}, 'seed'),
    ({'parameters': {'estimator_node.kalman.gravity': 9.8}}, 'has no effect'),
    ({'scenario': mambo.Scenario(), 'seed': 3}, 'seed')])
def test_wrong_input_is_one_line(arguments, what):
    with pytest.raises(mambo.InputError) as error:
        mambo.fly(**arguments)
    assert what in str(error.value) and '\n' not in str(error.value)


@pytest.mark.parametrize('arguments, what', [
    ({'trajectory': lambda t: (0.0, 0.0, -1.0), 'duration': 8.0},
     'duration: lambda: the flight leaves no time for it'),
    ({'vehicle': 'nothing'}, "vehicle: vehicle 'nothing' is unknown"),
    ({'believed': 'none.yaml'}, 'believed: ')])
def test_an_argument_is_named_once(arguments, what):
    with pytest.raises(mambo.InputError) as error:
        mambo.fly(**arguments)
    assert str(error.value).startswith(what) and str(error.value).count(f'{what.split()[0]} ') == 1


@pytest.mark.parametrize('function, what', [
    (lambda t: 1.0 / t, 'ZeroDivisionError'), (lambda t: 'far', 'is text, not numbers'),
    (lambda t: (0.0, t), 'returns an array of shape (2,)')])
def test_the_fault_of_a_function_is_told_before_the_time_that_it_lacks(function, what):
    with pytest.raises(mambo.InputError) as error:
        mambo.fly(trajectory=function, duration=8.0)
    assert what in str(error.value) and 'leaves no time' not in str(error.value)


def test_what_commands_leave_without_effect_is_refused(tmp_path):
    file = tmp_path / 'up.yaml'
    file.write_text('title: up\ncommands: [{time: 1, takeoff: {height: 1.0}}]\n')
    for given in ({'landing': False}, {'parameters': {'reference_node.plan.scale_rate': 0.5}}):
        with pytest.raises(mambo.InputError, match='has no effect, as the flight is made by'):
            mambo.fly(file, **given)


def test_a_bag_that_exists_is_not_overwritten(flight, tmp_path):
    flight.save(tmp_path / 'bag')
    with pytest.raises(mambo.InputError, match='exists'):
        flight.save(tmp_path / 'bag')


@pytest.mark.long
def test_the_figure_shows_the_flight(flight, tmp_path):
    flight.plot().savefig(tmp_path / 'flight.png')
    assert (tmp_path / 'flight.png').stat().st_size > 20_000


@pytest.mark.long
def test_a_controller_that_fails_in_flight_is_told_with_its_line(flight, tmp_path):
    pd = Path(__file__).parents[3] / 'examples/pd_controller.py'
    text = pd.read_text().replace('@jit\n', '').replace(
        'from mambo_model.compiled import jit\n', '')
    end = 'return Memory(memory.steps + 1)'
    assert end in text
    mine = tmp_path / 'mine.py'
    mine.write_text(text.replace(end, (
        f"if memory.steps > 400:\n        raise RuntimeError('lost')\n    {end}")))
    failed = mambo.fly(controller=str(mine), estimator='ground_truth', duration=6.0)
    assert 'mine.py:' in failed.fault and failed.fault.endswith('RuntimeError: lost')
    assert failed.fault in repr(failed) and not flight.fault


@pytest.mark.long
def test_a_file_that_is_edited_in_a_session_flies_as_it_is_now(tmp_path):
    mine, helper = tmp_path / 'mine.py', tmp_path / 'helper.py'
    found = []
    for share, helps in ((2.5, 1.0), (0.0, 1.0), (2.5, 0.0)):
        helper.write_text(f'HELPS = {helps}\n')
        mine.write_text(WEIGHT.format(share=share))
        found.append(mambo.fly(
            controller=mine, estimator='ground_truth', duration=3.0).recording.thrust.max())
    assert found[0] > 0.5 and found[1] == found[2] < 0.1


WEIGHT = """
from dataclasses import dataclass

from helper import HELPS
from mambo_control.command import thrust_and_torque
from mambo_model.values import Parameters


@dataclass(frozen=True)
class Params(Parameters):
    pass


def initial(values):
    return ()


def step(memory, state, reference, dt, gains, vehicle):
    thrust = HELPS * {share} * vehicle.mass * vehicle.gravity
    return memory, thrust_and_torque(thrust, (0.0, 0.0, 0.0), state, reference, vehicle)
"""


def spiral(t):
    """Return a spiral, with its velocity."""
    return [(0.1 * t * math.cos(t), 0.1 * t * math.sin(t), -1.0 - 0.05 * t),
            (0.1 * (math.cos(t) - t * math.sin(t)), 0.1 * (math.sin(t) + t * math.cos(t)), -0.05)]


spiral.duration = 5.0


class Keep:
    """A controller in a cell: it answers with the weight, and keeps how often it was asked."""

    @dataclasses.dataclass(frozen=True)
    class Params(Parameters):
        """Its parameters."""

        share: float = quantity(1.0, '-', 0.0, 2.0, 'a test')

    def initial(values):
        return 0

    def step(memory, state, reference, dt, gains, vehicle):
        thrust = gains.share * vehicle.mass * vehicle.gravity
        return memory + 1, thrust_and_torque(thrust, (0.0,) * 3, state, reference, vehicle)


def weight(state, reference, dt, vehicle):
    """Do the same without memory and parameters."""
    return thrust_and_torque(
        vehicle.mass * vehicle.gravity, (0.0,) * 3, state, reference, vehicle)


@pytest.mark.long
def test_a_function_is_flown_as_a_trajectory():
    flight = mambo.fly(trajectory=spiral, controller='flatness_drag', estimator='ground_truth')
    plan = flight.scenario.reference_node.plan
    assert re.match(r'# spiral of a script, sha256 [0-9a-f]{64}\n', plan.course)
    assert flight.t[-1] == 23.0  # s: 8 before it, 5, 1 of rest, 9 of landing
    on = np.searchsorted(flight.t, 8.0 + 3.0)
    assert flight.recording.reference[on, :3] == pytest.approx(spiral(3.0)[0], abs=1e-6)
    assert flight.metrics['tracking_rms'] < 0.02
    short = mambo.fly(trajectory=lambda t: (0.0, 0.0, -1.0), duration=20.0)
    assert short.t[-1] == 20.0 and repr(short).startswith('<Flight lambda_joint: 20 s')


def test_a_controller_of_a_cell_is_flown_with_its_parameters():
    common = {'trajectory': 'hover', 'estimator': 'ground_truth', 'duration': 3.0,
              'landing': False}
    one = mambo.fly(controller=Keep, **common)
    two = mambo.fly(controller=weight, **common)
    assert not one.fault + two.fault
    np.testing.assert_array_equal(one.recording.truth, two.recording.truth)
    less = mambo.fly(one.scenario, parameters={'controller_node.Keep.share': 0.5})
    assert less.recording.thrust.max() == pytest.approx(0.5 * one.recording.thrust.max())
    assert 'Keep, sha256' in str(one.bag.attachments['scenario.yaml'])


def test_a_flight_can_be_pickled_after_its_bag_was_asked_for(flight):
    assert 'bag' in vars(flight) or flight.bag
    found = pickle.loads(pickle.dumps(flight))
    assert repr(found) == repr(flight)
    np.testing.assert_array_equal(
        found.bag['estimate/odom'].position, flight.bag['estimate/odom'].position)


def test_flights_are_equal_to_themselves_alone(flight):
    other = dataclasses.replace(flight)
    assert flight == flight != other and len({flight, other, flight}) == 2


@pytest.mark.parametrize('arguments, what', [
    ({'trajectory': lambda t: (0.0, t)}, 'lambda: returns an array of shape (2,) at t = 0 s'),
    ({'controller': lambda state: None},
     'lambda(state) must take 4 arguments: state, reference, dt, vehicle'),
    ({'estimator': Keep}, 'step(memory, state, reference, dt, gains, vehicle) must take 9'),
    ({'controller': dataclasses}, 'has no Params, initial, step'),
    ({'controller': dict}, "<class 'dict'> is not written in Python"),
    ({'controller': print}, 'print> is not written in Python'),
    ({'trajectory': max}, 'max> is not written in Python'),
    ({'trajectory': np.sin}, "<ufunc 'sin'> is not written in Python"),
    ({'scenario': ''}, 'scenario: is empty'),
    ({'parameters': {'sim_node.duration': 3.0}},
     'parameters: sim_node.duration = 3.0 contradicts duration = 20.0: leave one out'),
    ({'controller': 'indi', 'parameters': {'controller_node.controller': 'geometric'}},
     "parameters: controller_node.controller = 'geometric' contradicts controller = 'indi'")])
def test_what_is_no_component_is_refused_in_one_line(arguments, what):
    with pytest.raises(mambo.InputError) as error:
        mambo.fly(**{'duration': 20.0} | arguments)
    assert what in str(error.value) and '\n' not in str(error.value)


def test_commands_of_a_file_are_judged_by_the_limits_that_are_given(tmp_path):
    file = tmp_path / 'high.yaml'
    file.write_text('title: high\ncommands: [{time: 1.0, takeoff: {height: 4.0}}]\n')
    with pytest.raises(mambo.InputError, match=r'height = 4 m is outside \[0\.5, 3\.2\] m'):
        mambo.fly(file, parameters={'reference_node.commands.ceiling': 3.2})
