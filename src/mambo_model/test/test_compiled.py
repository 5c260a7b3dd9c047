"""One function, one result, called alone or inside a compiled loop; a cache that follows."""

import importlib.metadata
import os
from pathlib import Path
import re
import shutil
import struct
import subprocess
import sys
from typing import NamedTuple

from mambo_model import compiled
from mambo_model.compiled import (
    by_type, hold, hold_again, jit, lengthen, memory_of, row_of, set_values)
from mambo_model.motion import rigid_body, trajectory
from mambo_model.motion.quaternion import to_euler
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle import motor_mixer as motors
from mambo_model.vehicle.parameters import Vehicle
import numba
from numba.core.errors import TypingError
import numpy as np
import pytest

START = State((0.0, 0.0, 0.0), (0.1, -0.2, 0.0), (1.0, 0.0, 0.0, 0.0), (0.3, -0.2, 0.1))


@jit
def one_step(state, t, plan, vv):
    """Fly the reference's thrust and torque for one step: the whole package in one function."""
    ref, phase = trajectory.reference_step(t, plan, vv.mass, vv.inertia, vv.gravity)
    phi, theta, psi = to_euler(state.q)
    tau = (ref.tau[0] - 1e-4 * phi, ref.tau[1] - 1e-4 * theta, ref.tau[2] - 1e-4 * psi)
    T1, T2, T3, T4 = motors.allocate(ref.f, tau, vv)
    thrust = (
        motors.thrust_from_pwm(motors.limit_pwm(motors.pwm_from_thrust(T1, vv), vv), vv),
        motors.thrust_from_pwm(motors.limit_pwm(motors.pwm_from_thrust(T2, vv), vv), vv),
        motors.thrust_from_pwm(motors.limit_pwm(motors.pwm_from_thrust(T3, vv), vv), vv),
        motors.thrust_from_pwm(motors.limit_pwm(motors.pwm_from_thrust(T4, vv), vv), vv))
    f, torque = motors.mix(thrust, vv)
    return rigid_body.rk4_step(state, f, torque, 0.005, vv)


@jit
def digits(row):
    out = 0.0
    for held in row:
        out = held.values * out + held.memory
    return out


@jit
def whole_flight(state, steps, plan, vv):
    for k in range(steps):
        state = one_step(state, 0.005 * k, plan, vv)
    return state


def flight_call_by_call(state, steps, plan, vv):
    for k in range(steps):
        t = 0.005 * k
        ref, _ = trajectory.reference_step(t, plan, vv.mass, vv.inertia, vv.gravity)
        euler = to_euler(state.q)
        tau = tuple(ref.tau[i] - 1e-4 * euler[i] for i in range(3))
        pwm = [
            motors.limit_pwm(motors.pwm_from_thrust(T, vv), vv)
            for T in motors.allocate(ref.f, tau, vv)]
        f, torque = motors.mix(tuple(motors.thrust_from_pwm(x, vv) for x in pwm), vv)
        state = rigid_body.rk4_step(state, f, torque, 0.005, vv)
    return state


@jit
def held_step(held, t):
    plan, vv = held.values
    held.memory = one_step(held.memory, t, plan, vv)


@jit
def draw(held):
    return held.rng.standard_normal()


def bits(state):
    numbers = [x for vector in state for x in vector]
    return struct.pack(f'{len(numbers)}d', *numbers)


@pytest.mark.parametrize('name', ['figure_3_3', 'circle_fast', 'hand_loop', 'ramp'])
def test_a_compiled_flight_has_the_bits_of_one_flown_call_by_call(name):
    plan = trajectory.FlightPlanParams(trajectory=name, landing_time=10.0).values()
    vv = Vehicle().values()
    alone, inside = flight_call_by_call(START, 3400, plan, vv), whole_flight(START, 3400, plan, vv)
    assert bits(inside) == bits(alone)
    assert bits(inside) != bits(START)


def calls_of(function):
    """Return the names of what the machine code of a caller of a flight plan's function calls."""
    caller = numba.njit(lambda t, plan: function(t, plan))
    caller(2.0, trajectory.FlightPlanParams().values())
    code, = caller.inspect_llvm().values()
    return ' '.join(re.findall(r'call .*@(\S+?)\(', code))


def test_what_is_compiled_inside_leaves_no_call_in_its_caller():
    inside = trajectory.flat_output
    assert 'flat_output' in calls_of(numba.njit(inside.py_func))
    assert 'flat_output' not in calls_of(inside)


@jit
def half(x):
    return 0.5 * x


def entry_for_python(function):
    """Return the address of a compiled function's code for calls from Python, 0 for none."""
    one, = function.overloads.values()
    return one.library.get_pointer_to_function(one.fndesc.llvm_cpython_wrapper_name)


def test_only_what_python_calls_is_compiled_for_calls_from_python():
    assert numba.njit(lambda x: half(x))(3.0) == 1.5
    assert entry_for_python(half) == 0 and not half.for_python.signatures
    assert half(3.0) == half(x=3.0) == 1.5
    assert entry_for_python(half.for_python) != 0


def test_what_is_held_moves_with_the_same_bits_and_apart_from_others():
    plan = trajectory.FlightPlanParams(trajectory='circle', takeoff='none').values()
    vv = Vehicle().values()
    flown, still = (hold(START, None, (plan, vv)) for _ in range(2))
    for k in range(200):
        held_step(flown, 0.005 * k)
    assert bits(memory_of(flown)) == bits(flight_call_by_call(START, 200, plan, vv))
    assert memory_of(still) == START


def test_generators_that_are_held_are_those_of_the_caller():
    rng, same = (np.random.Generator(np.random.PCG64(7)) for _ in range(2))
    held = hold(0.0, rng, None)
    drawn = [draw(held) for _ in range(5)]
    assert drawn == [same.standard_normal() for _ in range(5)]
    assert rng.standard_normal() == same.standard_normal()


def test_a_list_of_holders_has_all_of_them_in_their_order():
    holders = [hold(digit, None, 10.0) for digit in (1.0, 2.0, 3.0)]
    row = row_of(holders[0])
    for held in holders[1:]:
        lengthen(row, held)
    assert digits(row) == 123.0
    hold_again(holders[1], 7.0, None, 10.0)
    assert memory_of(holders[1]) == 7.0 and digits(row) == 173.0


def test_whole_numbers_as_parameters_compile_nothing_anew():
    trajectory.reference_at(1.0, trajectory.FlightPlanParams(), Vehicle())
    known = len(trajectory.reference_step.for_python.signatures)
    trajectory.reference_at(
        1, trajectory.FlightPlanParams(start_time=6, scale_rate=1, landing_time=20),
        Vehicle(drag_coefficient=0))
    assert len(trajectory.reference_step.for_python.signatures) == known


def cache_folder(packages, cache, before=''):
    """Return where a new process, after some other code, keeps its compiled code."""
    env = {k: v for k, v in os.environ.items() if k != 'NUMBA_CACHE_DIR'}
    env.update(MAMBO_CACHE_DIR=str(cache), PYTHONPATH=os.pathsep.join(
        [str(packages), *filter(None, [env.get('PYTHONPATH')])]))
    code = f'{before}import mambo_model.compiled as c; print(c.numba.config.CACHE_DIR)'
    return subprocess.run(
        [sys.executable, '-c', code], env=env, check=True, capture_output=True,
        text=True).stdout.strip()


@pytest.mark.long
def test_compiled_code_is_kept_where_asked_and_a_changed_source_starts_afresh(tmp_path):
    source = Path(compiled.__file__).parent
    for copy in ('same', 'again', 'changed'):
        shutil.copytree(source, tmp_path / copy / 'mambo_model')
    with (tmp_path / 'changed' / 'mambo_model' / 'vector.py').open('a') as file:
        file.write('# one line more\n')
    same, again, changed = (
        cache_folder(tmp_path / copy, tmp_path) for copy in ('same', 'again', 'changed'))
    assert same == again != changed
    assert same.startswith(f'{tmp_path}{os.sep}numba-')
    # a script may use numba of its own before
    assert cache_folder(tmp_path / 'same', tmp_path, 'import numba; ') == same


class Apple(NamedTuple):
    weight: float


class Pear(NamedTuple):
    weight: float
    rows: int


@jit
def of_apple(scale, fruit):
    return scale * fruit.weight


@jit
def of_pear(scale, fruit):
    return -scale * fruit.weight


of_fruit = by_type(1, {Apple: of_apple, Pear: of_pear})


@jit
def twice(fruit):
    return of_fruit(2.0, fruit)


def test_the_type_of_an_argument_chooses_the_function_compiled_or_not():
    for fruit, wanted in ((Apple(3.0), 6.0), (Pear(4.0, 1), -8.0)):
        assert of_fruit(2.0, fruit) == twice(fruit) == wanted
    compiled_for = {*of_pear.signatures, *of_pear.for_python.signatures}
    assert len(compiled_for) == 1  # what is not chosen is not compiled


def test_a_type_without_a_function_is_said_by_name():
    with pytest.raises(TypeError, match='argument 1 is int; known: Apple, Pear'):
        of_fruit(2.0, 3)
    with pytest.raises(TypingError):
        twice(State((0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3))


@pytest.mark.long
@pytest.mark.parametrize('variable', ['NUMBA_CACHE_DIR', 'MAMBO_CACHE_DIR'])
def test_a_folder_that_cannot_be_written_is_said_and_another_one_is_used(variable, tmp_path):
    """Without it, numba writes beside the sources and crashes, see ``compiled._make_cache``."""
    environment = {**os.environ, variable: '/proc/none', 'TMPDIR': str(tmp_path)}
    if variable == 'MAMBO_CACHE_DIR':
        environment.pop('NUMBA_CACHE_DIR', None)
    done = subprocess.run(
        [sys.executable, '-c', 'from mambo_model.arithmetic.trigonometry import sin\n'
         'print(sin(0.0))\nprint(__import__("os").environ["NUMBA_CACHE_DIR"])'],
        env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and done.stderr.count('\n') == 1
    assert done.stderr.startswith('mambo: /proc/none') and (
        'compiled code cannot be written there' in done.stderr)
    value, folder = done.stdout.splitlines()
    assert value == '0.0' and Path(folder).parent == tmp_path
    assert list(tmp_path.iterdir()) == []  # it goes with its process


@pytest.mark.long
def test_variables_that_change_how_flights_are_compiled_are_ignored_in_one_line(tmp_path):
    environment = {name: value for name, value in os.environ.items()
                   if not name.startswith('NUMBA_')}
    environment |= {'MAMBO_CACHE_DIR': str(tmp_path), 'NUMBA_OPT': 'x', 'NUMBA_DEBUGINFO': '1',
                    'NUMBA_NUM_THREADS': '1'}
    code = 'import os, mambo_model.compiled as c\n' \
        'print(c.numba.config.DEBUGINFO_DEFAULT, int(c.numba.config.OPT), *sorted(' \
        'n for n in os.environ if n.startswith("NUMBA_")))'
    done = subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True,
                          text=True, timeout=120)
    assert done.stdout.split() == [
        '0', '3', 'NUMBA_CACHE_DIR', 'NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING',
        'NUMBA_NUM_THREADS']
    assert done.stderr == 'mambo: ignored from the environment: NUMBA_DEBUGINFO, NUMBA_OPT ' \
        '(every flight is compiled alike)\n'


@jit
def product(held):
    """Return the memory times the parameter."""
    return held.memory * held.values[0]


def test_other_parameters_leave_the_memory_as_it_is():
    held = hold(3.0, None, (2.0,))
    assert product(held) == 6.0
    set_values(held, (0.1,))
    assert product(held) == 3.0 * 0.1 and memory_of(held) == 3.0


@pytest.mark.parametrize(('value', 'counts'), [
    ('lab_package.control:Mine', True), ('lab_single', True), ('no_such_package:Mine', False),
    ('', False), ('.:x', False), ('not a module', False)])
def test_the_source_of_an_installed_component_counts(tmp_path, monkeypatch, value, counts):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / 'lab_package').mkdir()
    files = [tmp_path / name for name in ('lab_package/__init__.py', 'lab_package/control.py',
                                          'lab_single.py')]
    entry = importlib.metadata.EntryPoint('mine', value, 'mambo.controllers')
    monkeypatch.setattr(importlib.metadata, 'entry_points', lambda group: [entry])
    found = set()
    for gain in (1, 2):
        for file in files:
            file.write_text(f'GAIN = {gain}\n')
        found.add(compiled.source_digest())
    assert len(found) == 1 + counts


def test_components_of_the_product_count_once_whether_installed_or_not(monkeypatch):
    found = set()
    for entries in ([], [importlib.metadata.EntryPoint(
            'predictive', 'mambo_control.literature.predictive', 'mambo.controllers')]):
        monkeypatch.setattr(importlib.metadata, 'entry_points', lambda group, e=entries: e)
        found.add(compiled.source_digest())
    assert len(found) == 1
