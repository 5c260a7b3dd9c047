"""Controllers and estimators from files in the closed loop: the same numbers, and their faults."""

from contextlib import nullcontext
import dataclasses
import math
from pathlib import Path
import pickle
import re
import signal

from mambo_bags.reader import read_bag
from mambo_control.failsafe import REASONS
from mambo_control.safety import REASON_CONTROLLER
from mambo_estimation import filters
from mambo_estimation.estimate import of_state
from mambo_flight import closed_loop, fly, scenario as scenarios, scenario_file
from mambo_flight.sweep import design, monte_carlo
from mambo_model import components, schema, slots
from mambo_model.components import Component
from mambo_model.motion import rigid_body
import numpy as np
import pytest

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[3] / 'examples'
PD, HEIGHT = EXAMPLES / 'pd_controller.py', EXAMPLES / 'alpha_beta_filter.py'


@pytest.fixture
def plain(tmp_path):
    """Return the PD controller as plain Python, with changes."""
    def write(old='', new='', name='plain.py'):
        text = PD.read_text().replace('@jit\n', '').replace(
            'from mambo_model.compiled import jit\n', '')
        assert old in text
        path = tmp_path / name
        path.write_text(text.replace(old, new, 1))
        return str(path)
    return write


def flight(controller, duration=9.0, **more):
    return scenarios.scenario(
        estimator='ground_truth', controller=str(controller), duration=duration, land=False,
        **more)


def flown(controller, **more):
    slots.latest_fault()
    return closed_loop.fly(flight(controller, **more), inner=True)  # as the command flies


@pytest.mark.long
def test_a_compiled_and_a_plain_one_fly_the_same_numbers(plain):
    one, two = flown(PD), flown(plain())
    assert not slots.latest_fault()
    for name in ('truth', 'pwm', 'thrust', 'phase', 'reason'):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    late = one.t > 5_000_000_000
    error = np.linalg.norm(one.truth[late, :3] - one.reference[late, :3], axis=1)
    assert error.max() < 0.5  # m, of 1 m of radius: it flies
    assert not one.stopped.any()


@pytest.mark.long
def test_two_compiled_ones_with_classes_of_equal_names_are_told_apart(tmp_path, faulty):
    text = PD.read_text().replace(STEP, f'thrust *= 0.9\n    {STEP}')
    (tmp_path / 'other.py').write_text(text)
    one, two = flown(PD), flown(tmp_path / 'other.py')
    # a field of its memory has another name
    three = flown(faulty, overrides={'controller_node.faulty.thrust_share': 0.9})
    assert not slots.latest_fault()
    assert not np.array_equal(one.thrust, two.thrust)
    np.testing.assert_array_equal(two.thrust, three.thrust)


@pytest.mark.long
def test_a_file_that_is_looked_at_again_flies_what_is_compiled_later():
    given = closed_loop.fly(flight(PD))
    components.look_again()  # as a session does before each flight
    again = closed_loop.fly(flight(PD), inner=True)  # compiled with other columns
    np.testing.assert_array_equal(given.truth, again.truth)


def test_its_parameters_are_those_of_the_scenario(plain):
    mine = plain()
    changed = scenarios.override(flight(mine), {'controller_node.plain.position_gain': 6.0})
    assert changed.controller_node.plain.position_gain == 6.0
    text = scenarios.commented_yaml(changed)
    assert 'position_gain: 6.0' in text and f'controller: {mine}' in text
    assert scenarios.from_yaml(text) == changed == pickle.loads(pickle.dumps(changed))
    assert 'plain 1.0, sha256 ' in text
    with pytest.raises(schema.ParameterError, match='position_gane.*did you mean.*position_gain'):
        scenarios.override(flight(mine), {'controller_node.plain.position_gane': 6.0})
    back = scenarios.override(changed, {'controller_node.controller': 'toolbox'})
    assert not hasattr(back.controller_node, 'plain')


@pytest.mark.parametrize('name', ['controller', 'law', 'period', 'failsafe', 'patience'])
def test_a_file_with_a_name_of_the_node_is_refused(plain, name):
    mine = plain(name=f'{name}.py')
    with pytest.raises(schema.ParameterError, match=(
            f'controller_node.controller: .*{name}.py: {name} is a name of the node itself: ')):
        flight(mine)
    again = flight(plain())
    assert scenarios.override(again, {'sim_node.duration': 5.0}).controller_node.controller


def test_a_scenario_file_names_a_file_beside_it(plain, tmp_path):
    mine = plain()
    file = tmp_path / 'mine.yaml'
    file.write_text('title: mine\ncontroller: plain.py\nduration: 5\nparameters:\n'
                    '  controller_node: {plain: {rate_gain: 21.0}}\n')
    _, found = scenario_file.load(str(file))
    assert found.controller_node.controller == mine
    assert found.controller_node.plain.rate_gain == 21.0
    file.write_text('title: mine\ncontroller: none.py\n')
    with pytest.raises(schema.ParameterError, match=r'mine.yaml:2: .*none.py: No such file'):
        scenario_file.load(str(file))


def test_a_sweep_varies_a_component_and_its_parameters(plain, tmp_path):
    mine, file = plain(), tmp_path / 'sweep.yaml'
    file.write_text('title: t\nvary:\n  controller: [cascaded, plain.py]\n  duration: 5\n'
                    '  controller_node.plain.rate_gain: [20.0, 25.0]\n')
    flights = design.Flights(design.read(file))
    chosen = [flights[i].controller_node for i in range(4)]
    assert [c.controller for c in chosen] == ['cascaded', 'cascaded', mine, mine]
    assert [c.plain.rate_gain for c in chosen[2:]] == [20.0, 25.0]


STEP = 'return Memory(memory.steps + 1), thrust'


@pytest.mark.long
@pytest.mark.parametrize(('old', 'new', 'output'), [
    (STEP, f"if memory.steps > 1000:\n        raise RuntimeError('lost my way')\n    {STEP}",
     r'plain.py:\d+: RuntimeError: lost my way'),
    (STEP, f"if memory.steps > 1000:\n        thrust = float('nan')\n    {STEP}",
     r'plain.py:\d+: step answers thrust = nan'),
    (STEP, f'while memory.steps > 1000:\n        pass\n    {STEP}',
     r'plain.py:\d+: takes too long'),
    (STEP, 'while memory.steps > 1000:\n        try:\n            __import__("time").sleep(9)\n'
           f'        except Exception:\n            pass\n    {STEP}',
     r'plain.py:\d+: takes too long'),
    (STEP, f'if memory.steps > 1000:\n        raise SystemExit(3)\n    {STEP}',
     r'plain.py:\d+: SystemExit: 3'),
    (STEP, f'if memory.steps > 1000:\n        raise GeneratorExit\n    {STEP}',
     r'plain.py:\d+: GeneratorExit: no message'),
    (STEP, 'if memory.steps > 1000:\n'
           f'        thrust_and_torque(10**400, torque, state, reference, vehicle)\n    {STEP}',
     r'plain.py:\d+: calls a compiled function with a value of a wrong type'),
    (STEP, f'if memory.steps > 1000:\n        return None\n    {STEP}',
     r'plain.py:\d+: step must answer two things: .* it answers NoneType None')])
def test_one_that_fails_in_flight_is_landed_and_its_line_told(plain, old, new, output):
    out = flown(plain(old, new), duration=12.0)
    fault = slots.latest_fault()
    assert re.search(output, fault), fault
    assert '\n' not in fault
    bad = int(np.flatnonzero(out.reason == REASON_CONTROLLER)[0])
    assert 5.9 < out.t[bad] * 1e-9 < 6.2  # s: in the air for 1000 steps of 5 ms, from 1 s on
    assert abs(out.truth[-1, 2]) < 0.05 and not out.pwm[-1].any()  # it has landed
    assert np.abs(np.diff(out.truth[bad:, 2])).max() < 0.01  # m in 5 ms: it did not fall
    assert REASONS[REASON_CONTROLLER] == 'controller failed'


@pytest.mark.parametrize(('arguments', 'handler', 'ends'), [
    ('()', lambda number, frame: None, False), ('(2)', lambda number, frame: None, True),
    ('()', signal.default_int_handler, True)])
def test_an_interrupt_that_no_signal_raised_is_a_fault_of_the_code(
        plain, arguments, handler, ends):
    slot = slots.open_slot(Component('plain', object, lambda _: None, lambda *_: exec(
        f'raise KeyboardInterrupt{arguments}'), False, path=Path(plain())), None)
    before = signal.signal(signal.SIGINT, handler)
    try:
        with pytest.raises(KeyboardInterrupt) if ends else nullcontext():
            assert slots.call(slot, slot, (), lambda answer: answer) is None
    finally:
        signal.signal(signal.SIGINT, before)
    assert ('KeyboardInterrupt' in slots.latest_fault()) is not ends


@pytest.mark.long
def test_a_compiled_one_that_fails_is_landed_and_its_line_told(faulty):
    out = flown(faulty, duration=12.0, overrides={'controller_node.faulty.raises': 1000})
    lines = faulty.read_text().splitlines()
    line = next(i for i, text in enumerate(lines, 1) if 'raise ' in text)
    assert slots.latest_fault() == f'{faulty}:{line}: ValueError: lost my way'
    assert (out.reason == REASON_CONTROLLER).any() and abs(out.truth[-1, 2]) < 0.05


@pytest.mark.parametrize(('old', 'new', 'output'), [
    ('return Memory(memory.steps + 1), thrust', 'return thrust',
     r'step must answer two things: .* it answers Command'),
    ('thrust_and_torque(thrust, torque, state, reference, vehicle)', '(thrust, torque)',
     r'step answers tuple where a Command belongs'),
    ('thrust_and_torque(thrust, torque,', 'thrust_and_torque(thrust, torque[:2],',
     r'controller_node.controller: .*plain.py:\d+: does not compile: tuple index out of range'),
    ('    v = rotate(state.q, state.nu)\n', '    v = rotate(state.q, state.velocity)\n',
     r'plain.py:\d+: AttributeError: .*velocity.*in a trial at hover')])
def test_a_wrong_one_is_refused_before_anything_flies(plain, old, new, output):
    with pytest.raises(schema.ParameterError, match=output) as error:
        flight(plain(old, new))
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('answer', 'said'), [
    ('estimate._replace(state=estimate.state._replace(q=(2.0, 0.0, 0.0, 0.0)))',
     'attitude = .* a quaternion of length 2 instead of 1'),
    ('estimate._replace(state=estimate.state._replace(q=(1.001, 0.0, 0.0, 0.0)))',
     r'attitude = .* a quaternion of length 1\.001 instead of 1'),
    ("estimate._replace(state=estimate.state._replace(rho=('1', '2', '3')))",
     r"step answers state\.rho\[0\] = '1': wanted a number"),
    ('estimate._replace(state=estimate.state._replace(rho=(1.0, 2.0)))',
     r'step answers state\.rho = \(1\.0, 2\.0\): wanted 3 numbers'),
    ('estimate._replace(state=(1.0, 2.0))',
     r'step answers state = \(1\.0, 2\.0\): wanted rho, nu, q, omega'),
    ('estimate._replace(height=1j)', 'step answers height = 1j: wanted a number'),
    ('estimate._replace(pose_covariance=(0.0,) * 35)',
     r'step answers pose_covariance = \(0.0, .*: wanted 36 numbers'),
    ('estimate._replace(sonar_refused=1.5)',
     'step answers sonar_refused = 1.5: wanted a whole number'),
    ('estimate._replace(status=99)', 'step answers status = 99: wanted 0 to 2')])
def test_an_estimate_that_is_none_is_refused(answer, said):
    zero = (0.0,) * 3
    estimate = of_state(rigid_body.State(zero, zero, (1.0, 0.0, 0.0, 0.0), zero), 2, zero, zero)
    assert str(filters.read(estimate)) == str(estimate)  # some of it is NaN
    with pytest.raises(slots.UnusableError, match=said):
        filters.read(eval(answer, {'estimate': estimate}))


@pytest.mark.long
def test_an_estimator_of_a_file_flies_and_is_lost_when_it_fails(tmp_path):
    base = scenarios.scenario(duration=14.0, land=False, estimator=str(HEIGHT))
    slots.latest_fault()
    out = closed_loop.fly(base)
    assert not slots.latest_fault()
    late = out.t > 6_000_000_000
    assert np.abs(out.estimate[late, 2] - out.truth[late, 2]).max() < 0.2  # m
    kalman = closed_loop.fly(scenarios.scenario(duration=14.0, land=False))
    assert not np.array_equal(out.estimate[late, 2], kalman.estimate[late, 2])
    broken = tmp_path / 'broken.py'
    broken.write_text(HEIGHT.read_text().replace(
        'rest, height, climb, since = memory',
        'rest, height, climb, since = memory\n    if height > 1.3:\n        height / 0', 1))
    out = closed_loop.fly(dataclasses.replace(base, estimator_node=scenarios.scenario(
        estimator=str(broken)).estimator_node))
    assert f'{broken}:' in (fault := slots.latest_fault()) and 'ZeroDivisionError' in fault
    assert np.isnan(out.estimate[-1]).all()
    assert abs(out.truth[-1, 2]) < 0.1 and not out.pwm[-1].any()


@pytest.mark.parametrize('name', [
    'circle', 'flatness_drag', pytest.param('yours', marks=pytest.mark.long)])  # long: compiles
def test_the_estimator_of_the_examples_flies_from_take_off_to_landing(name):
    if name == 'yours':
        _, chosen = scenario_file.load(str(EXAMPLES / 'yours.yaml'))
    else:
        chosen = scenarios.scenario(
            duration=20.0, estimator=str(HEIGHT),
            controller='cascaded' if name == 'circle' else name)
    slots.latest_fault()
    out = closed_loop.fly(chosen, inner=True)
    assert not slots.latest_fault()
    assert not fly.failure(chosen, out, monte_carlo.measure(chosen, out))
    height, climb = -out.truth[:, 2], np.gradient(-out.truth[:, 2], out.t * 1e-9)
    assert height.max() > 1.0 and abs(height[-1]) < 0.05 and not out.pwm[-1].any()
    # ten seeds: 0.02 m, below the sonar's noise of 0.03 m; the landing touches at 0.7 m/s
    assert np.abs(-out.estimate[:, 2] - height)[height > 0.05].max() < 0.06  # m
    assert climb[height < 0.1].min() > -1.0  # m/s


def test_a_range_at_the_first_step_of_the_estimator_of_the_examples_is_used():
    component = filters.REGISTRY.find(str(HEIGHT))
    values = component.params().values()
    none = (math.nan, math.nan)
    _, estimate = component.step(
        component.initial(values), 0.0, (0.0,) * 3, (0.0, 0.0, -9.81), 1.5, none, 0, math.nan,
        values)
    assert estimate.height == pytest.approx(0.3 * 1.5) and estimate.vertical_velocity == 0.0


@pytest.mark.long
def test_the_command_closes_the_bag_and_tells_of_the_fault(plain, tmp_path, capsys):
    mine = plain(STEP, f"if memory.steps > 300:\n        raise RuntimeError('lost')\n    {STEP}")
    bag, file = tmp_path / 'bag', tmp_path / 'short.yaml'
    file.write_text('title: short\nestimator: ground_truth\nduration: 5\nlanding: false\n')
    assert fly.main([str(file), '--controller', mine, '-o', str(bag)]) == 1
    output = capsys.readouterr()
    assert 'plain is plain Python: it flies slower' in output.out
    assert output.err.startswith('fly: short: ') and 'RuntimeError: lost' in output.err
    text = str(read_bag(bag, ()).attachments['scenario.yaml'])
    assert f'controller: {mine}' in text and 'plain 1.0, sha256' in text
    assert fly.main(['--controller', 'none.py', '-o', str(tmp_path / 'other')]) == 2
    assert 'none.py: No such file or directory' in capsys.readouterr().err
