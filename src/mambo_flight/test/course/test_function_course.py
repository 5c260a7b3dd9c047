"""Functions of time as courses: against their own derivatives; faults name file and line."""

import math
import re
import sys

from hypothesis import given, settings, strategies as st
from mambo_flight.course import function_course
from mambo_model.errors import InputError
from mambo_model.motion.polynomial import state_at
from mambo_model.motion.uav_trajectories import parse, to_text
import numpy as np
import pytest


def circle(t):
    """Return a circle of 1 m at 1 rad/s that rises, with its yaw."""
    return math.cos(t), math.sin(t), -1.5 - 0.1 * math.sin(2.0 * t), 0.3 * math.sin(t)


def test_a_function_is_followed_with_its_derivatives():
    course = function_course.fit(circle, 2.0 * math.pi)
    assert course.total == pytest.approx(2.0 * math.pi, rel=1e-14)
    for t in np.linspace(0.0, course.total, 400).tolist():
        at = state_at(course, t)
        assert at[:, 0] == pytest.approx(circle(t), abs=1e-6)
        assert at[0, 1:] == pytest.approx(
            [-math.sin(t), -math.cos(t), math.sin(t), math.cos(t)], abs=0.02)
    again = parse(to_text(course))
    assert again.coefficients.tobytes() == course.coefficients.tobytes()


def test_three_numbers_have_no_yaw():
    course = function_course.fit(lambda t: np.array([t, 0.0, -1.0]), 2.0)
    assert not course.coefficients[:, 3].any()


@pytest.mark.parametrize(('function', 'message'), [
    (lambda t: ('1', 0.0, -1.0), r'is text, not numbers, at t = 0 s'),
    (lambda t: (t * (1 + 5j), 0.0, -1.0), r'is complex, at t = 0 s'),
    (lambda t: sys.exit(0) if t > 1 else (t, 0.0, -1.0), 'SystemExit: 0, at t = 1'),
    (lambda t: (t, 0.0), r'the function: returns an array of shape \(2,\) at t = 0 s; it must be'),
    (lambda t: (t, math.nan, -1.0), r'the function: returns \[0.0, nan, -1.0'),
    (lambda t: (abs(t - 0.9), 0.0, -1.0), 'is not smooth enough: with 512 polynomials'),
])
def test_functions_that_are_no_path_are_refused(function, message):
    with pytest.raises(InputError, match=message):
        function_course.fit(function, 2.0)


@pytest.mark.parametrize('duration', [0.0, -1.0, math.nan, 4000.0])
def test_durations_that_are_none_are_refused(duration):
    with pytest.raises(InputError, match='must be above 0 and at most 3600 s'):
        function_course.fit(circle, duration)


def test_faults_of_a_file_name_its_line(tmp_path, monkeypatch):
    path = tmp_path / 'mine.py'
    path.write_text('def bad(t):\n    return 1 / (t - 1), 0, 0\n\n\nNUMBER = 3\n')
    with pytest.raises(InputError, match=r'mine.py:2: ZeroDivisionError: .*, at t = 1 s'):
        function_course.fit(function_course.load(f'{path}:bad'), 22.0)
    for name, message in ((f'{path}:none', 'mine.py:none: there is no such function'),
                          (f'{path}:NUMBER', 'mine.py:NUMBER: there is no such function'),
                          (f'{tmp_path}/no.py:x', 'no.py: No such file or directory'),
                          ('mine.csv', 'write FILE.py or FILE.py:FUNCTION')):
        with pytest.raises(InputError, match=message):
            function_course.load(name)
    path.write_text('x = 1\ndef f(:\n')
    with pytest.raises(InputError, match=r'mine.py:2: invalid syntax'):
        function_course.load(f'{path}:f')
    path.write_text('class Path:\n    def __call__(self, t):\n        return t, 0, 0\n'
                    '    def __getattr__(self, name):\n        return 1 / 0\n')
    with pytest.raises(InputError, match=r'mine.py:5: ZeroDivisionError: division by zero'):
        function_course.load(f'{path}:Path')
    path.write_text('def f(t):\n    while True:\n        pass\n')
    monkeypatch.setenv('MAMBO_MAX_READING_S', '1')
    with pytest.raises(InputError, match=r'mine.py:[23]: takes more than 1 s; MAMBO_MAX_READING'):
        function_course.fit(function_course.load(f'{path}:f'), 22.0)
    path.write_text('\nimport nothing_like_that\n')
    with pytest.raises(InputError, match=r'mine.py:2: ModuleNotFoundError: No module'):
        function_course.load(f'{path}:f')


def with_rates(t):
    """Return a line with its velocity and acceleration."""
    return [[t * t, 0.0, -1.0, 0.1 * t], [2.0 * t, 0.0, 0.0, 0.1], [2.0, 0.0, 0.0, 0.0]]


def test_derivatives_that_are_those_of_the_position_are_taken():
    course = function_course.fit(with_rates, 3.0)
    assert state_at(course, 2.0)[:, 0] == pytest.approx([4.0, 0, -1, 0.2])
    with pytest.raises(InputError, match='returns a velocity along x of 1 at t = .* is 2'):
        function_course.fit(lambda t: [(2.0 * t, 0.0, -1.0), (1.0, 0.0, 0.0)], 3.0)
    with pytest.raises(InputError, match='arrays of different shapes'):
        function_course.fit(lambda t: [(0, 0, -1)] * (2 if t > 1.0 else 1), 3.0)


def test_a_file_with_several_functions_has_a_usual_one(tmp_path):
    path = tmp_path / 'several.py'
    path.write_text('from math import sin\n\n__version__ = "2"\nduration = 3\n\n\n'
                    'def a(t):\n    return t, 0, -1\n\n\ndef b(t):\n    return 0, t, -1\n')
    with pytest.raises(InputError, match='has the functions a, b: write several.py:NAME'):
        function_course.load(str(path))
    source = function_course.load(f'{path.name}:b', tmp_path)
    assert source.function(1.0) == (0, 1.0, -1) and source.duration == 3.0
    assert source.about.startswith('several.py:b 2, sha256 ')
    path.write_text(
        'def a(t):\n    return t, 0, -1\n\n\ndef trajectory(t):\n    return 0, t, -1\n')
    found = function_course.load(str(path))
    assert found.name.endswith('several.py:trajectory') and found.duration is None
    for stated in ("'long'", "'12'", 'True', '[3]'):
        path.write_text(f'duration = {stated}\n\n\ndef f(t):\n    return 0, t, -1\n')
        with pytest.raises(InputError, match=re.escape(
                f'duration = {stated} is not a number of seconds')):
            function_course.load(str(path))


def test_an_installed_function_is_found_by_its_entry_point(monkeypatch):
    class Entry:
        name, value, dist = 'ring', 'package:circle', None

        def load(self):
            return circle
    monkeypatch.setattr(function_course.importlib.metadata, 'entry_points',
                        lambda group: [Entry()] if group == 'mambo.trajectories' else [])
    source = function_course.load('ring')
    assert source.function is circle and source.about.startswith('ring, sha256 ')


@pytest.mark.parametrize(('name', 'expected'), [
    ('mine.py', True), ('mine.py:loop', True), ('folder/mine.py', True), ('circle', False),
    ('mine.csv', False), ('', False)])
def test_a_function_is_known_by_its_file(name, expected):
    assert function_course.is_function(name) is expected


def test_a_function_of_a_script_is_flown_under_its_name_and_hash():
    def loop(t):
        return t, 0.0, -1.0
    loop.duration = 4
    key = function_course.offer(loop)
    assert key.startswith('loop of a script, sha256 ')
    assert function_course.is_function(key) and function_course.offer(loop) == key
    source = function_course.load(key)
    assert source.function is loop and source.duration == 4.0 and source.about == key


@pytest.mark.parametrize('order', [1, 2, 3, 4])
def test_a_stated_derivative_that_is_wrong_is_named_by_its_order_and_axis(order):
    names = ('velocity', 'acceleration', 'jerk', 'snap')

    def rows(t):  # y = sin t
        derivatives = [math.sin(t + 0.5 * k * math.pi) for k in range(order + 1)]
        derivatives[order] *= 1.5
        return [[0.0, y, -1.0 if k == 0 else 0.0] for k, y in enumerate(derivatives)]
    with pytest.raises(InputError, match=f'returns a {names[order - 1]} along y of'):
        function_course.fit(rows, 3.0)


@given(speed=st.floats(0.1, 3.0), size=st.floats(0.1, 3.0), phase=st.floats(0.0, 6.0))
@settings(max_examples=8, deadline=None)
def test_any_smooth_path_is_followed_to_a_micrometre(speed, size, phase):
    def path(t):
        return size * math.sin(speed * t + phase), 0.2 * t, -2.0
    course = function_course.fit(path, 3.0)
    for t in np.linspace(0.0, 3.0, 97).tolist():
        assert state_at(course, t)[:3, 0] == pytest.approx(path(t), abs=1.1e-6)


@pytest.mark.parametrize('value', [None, 'far', (1.0, 'north', 0.0), [[[0.0, 0.0, 0.0]]], ()])
def test_values_that_are_no_position_are_one_line(value):
    source = function_course.Source(lambda t: value, 'the function', None, '', None)
    for examine in (lambda: function_course.fit(source, 2.0),
                    lambda: function_course.check(source)):
        with pytest.raises(InputError, match='the function: ') as refused:
            examine()
        assert '\n' not in str(refused.value)
