"""Files of waypoints: what they mean, and every fault by file and line."""

import math
from pathlib import Path

from mambo_flight.course import course_file, waypoints as wp
from mambo_model.motion import uav_trajectories as uav
from mambo_model.motion.polynomial import state_at
from mambo_model.schema import ParameterError
import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[4] / 'examples'
HEAD = 't,x,y,z,yaw_deg\n'
GOOD = HEAD + '0,0,0,-1,0\n2,1,0.5,-1.5,\n# a comment\n\n4,0,1,-1,90\n'


@pytest.fixture
def file(tmp_path):
    def write(text, name='w.csv'):
        path = tmp_path / name
        path.write_text(text)
        return path
    return write


def test_a_csv_file_is_flown_through_its_points_at_its_times(file):
    course = wp.read(file(GOOD))
    for t, point, yaw in ((0.0, (0.0, 0.0, -1.0), 0.0), (2.0, (1.0, 0.5, -1.5), None),
                          (4.0, (0.0, 1.0, -1.0), 0.5 * math.pi)):
        at = state_at(course, t)
        np.testing.assert_allclose(at[:3, 0], point, rtol=0.0, atol=1e-12)
        assert yaw is None or at[3, 0] == pytest.approx(yaw, abs=1e-12)
    assert 0.1 < state_at(course, 2.0)[3, 0] < 1.5


def test_yaml_says_the_same_as_csv(file):
    text = ('waypoints:\n- {t: 0, x: 0, y: 0, height: 1, yaw: 0}\n'
            '- {t: 2, x: 1, y: 0.5, height: 1.5}\n'
            f'- {{t: 4, x: 0, y: 1, z: -1, yaw: {0.5 * math.pi!r}}}\n')
    first, second = wp.read(file(GOOD)), wp.read(file(text, 'w.yaml'))
    assert first.coefficients.tobytes() == second.coefficients.tobytes()


def test_speeds_are_means_from_the_waypoint_before(file):
    course = wp.read(file('x,y,height,speed\n0,0,1,\n3,4,1,2\n3,4,2,0.5\n'))
    assert course.duration.tolist() == [2.5, 2.0]
    same = wp.read(file('x,y,height\n0,0,1\n3,4,1\n'), {'speed': 2.0})
    assert same.duration.tolist() == [2.5]


@pytest.mark.parametrize('first', ['', '0', '2', '0.5'])
def test_a_table_may_have_a_speed_in_its_first_row(file, first):
    course = wp.read(file(f'x,y,height,speed\n0,0,1,{first}\n3,4,1,2\n3,4,2,0.5\n'))
    assert course.duration.tolist() == [2.5, 2.0]


def test_time_begins_at_the_first_waypoint(file):
    assert wp.read(file('t,x,y,z\n10,0,0,-1\n12,1,0,-1\n')).duration.tolist() == [2.0]


def test_yaw_turns_the_shorter_way(file):
    course = wp.read(file(HEAD + '0,0,0,-1,170\n2,1,0,-1,-170\n4,2,0,-1,-10\n'))
    assert np.degrees([state_at(course, t)[3, 0] for t in (0.0, 2.0, 4.0)]) == pytest.approx(
        [170.0, 190.0, 350.0])


def test_velocities_and_free_coordinates_are_taken(file):
    course = wp.read(file('t,x,y,z,vx\n0,0,0,-1,\n2,1,,-1,0.3\n4,2,1,-1,\n'))
    at = state_at(course, 2.0)
    assert (at[0, 0], at[0, 1]) == pytest.approx((1.0, 0.3)) and 0.2 < at[1, 0] < 0.8


def test_settings_of_a_file_are_replaced_by_those_given(file):
    text = ('minimise: jerk\nspeed: 1\n'
            'waypoints: [{x: 0, y: 0, height: 1}, {x: 2, y: 0, height: 1}]\n')
    assert wp.read(file(text, 'w.yaml')).coefficients.shape == (1, 4, 6)
    other = wp.read(file(text, 'w.yaml'), {'minimise': 'snap', 'speed': 0.5})
    assert other.coefficients.shape == (1, 4, 8) and other.total == 4.0


@pytest.mark.parametrize('name', ['figure_eight.csv', 'gate.yaml'])
def test_the_examples_are_planned(name):
    if name.endswith('.yaml'):
        pytest.importorskip('clarabel', reason='Clarabel is not installed')
    course = course_file.read(EXAMPLES / name)
    assert len(uav.parse(uav.to_text(course)).duration) == {'f': 8, 'g': 12}[name[0]]


def test_the_example_flies_through_its_gate():
    pytest.importorskip('clarabel', reason='Clarabel is not installed')
    course = course_file.read(EXAMPLES / 'gate.yaml')
    at = np.array([state_at(course, t) for t in np.linspace(2.5, 3.2, 141)])
    assert at[0, 0, 0] == pytest.approx(1.2, abs=1e-6) and (np.diff(at[:, 0, 0]) > 0.0).all()
    assert (np.abs(at[:, 1, 0] - 0.4) <= 0.2).all() and (np.abs(at[:, 2, 0] + 1.4) <= 0.2).all()


def test_files_are_told_by_their_first_column(file):
    polynomials = file(uav.to_text(wp.read(file(GOOD))), 'p.csv')
    assert course_file.is_polynomial(polynomials)
    assert not course_file.is_polynomial(file(GOOD))
    with pytest.raises(ParameterError, match='p.csv: holds polynomials, .*, speed'):
        course_file.read(polynomials, {'speed': 1.0})


@pytest.mark.parametrize(('text', 'message'), [
    ('', 'w.csv: the file is empty'), ('# nothing\n', 'w.csv: 0 waypoints; a course has at least'),
    (HEAD + '0,0,0,-1,0\n', 'w.csv: 1 waypoint; a course has at least 2'),
    ('0,0,0,-1\n1,1,1,-1\n', "w.csv:1: '0' is not a column: the first row must name columns"),
    ('t,x,x,z\n0,0,0,-1\n', 'w.csv:1: duplicate column x'),
    (HEAD + '0,0,0,-1,0\n2,1,0,-1,0,7\n', 'w.csv:3: 6 cells; the header has 5 columns'),
    (HEAD + '0,0,0,-1,0\n2,1,nan,-1,0\n', 'w.csv:3: y: nan is not a finite number'),
    (HEAD + '0,0,0,-1,0\n2,1,a,-1,0\n', "w.csv:3: y: 'a' is not a number"),
    (HEAD + '0,0,0,-1,0\n2,1,0,-1,0\n2,2,0,-1,0\n', 'w.csv:4: t = 2 s is not after 2 s of the'),
    (HEAD + '0,0,0,-1,0\n2,,0,-1,0\n', 'w.csv:3: x is missing: the first and the last waypoint'),
    (HEAD + '0,0,0,1.2,0\n2,1,0,1.2,0\n', 'w.csv:2: z = 1.2 m is below the ground, as z points '
     'down: write -1.2, or call the column height'),
    ('t,x,y,z,height\n0,0,0,-1,1\n1,1,1,-1,1\n', 'w.csv:2: z and height: give one of them'),
    ('x,y,z\n0,0,-1\n1,1,-1\n', 'w.csv:3: t or speed is missing'),
    ('x,y,z,speed\n0,0,-1,\n1,1,-1,0\n', 'w.csv:3: speed = 0 m/s must be above 0'),
    ('x,y,z,speed\n0,0,-1,\n0,0,-1,1\n', 'w.csv:3: a speed needs a distance: give t if'),
    ('t,speed,x,y,z\n0,,0,0,-1\n1,1,1,1,-1\n', 'w.csv:3: t and speed: give one of them'),
    ('t,x,y,height\n0,0,0,1\n2,1,0,101\n', 'w.csv:3: a height of 101 m is above 100 m: .*metres'),
    ('x,y,height,speed\n0,0,1,\n1,0,1,31\n', r'w.csv:3: 1 m in 0.0323 s are 31 m/s, above 30 m/s'),
    ('t,x,y,height\n0,0,0,1\n0.002,1,0,1\n', 'w.csv:3: 1 m in 0.002 s are .* times in sec'),
    ('t,x,y,height\n0,0,0,1\n5000,1,0,1\n', 'w.csv:3: 1 m in 5e.03 s: the most is .* secon'),
    ('t,x,y,height\n0,0,0,1200\n2,1000,0,1200\n', r'w.csv:2: z = -1200 m is outside .* metres'),
    ('t,x,y,z,yaw,yaw_deg\n0,0,0,-1,1,1\n1,1,1,-1,0,0\n', 'w.csv:2: yaw and yaw_deg: give one'),
    ('t,x,y,z,tube\n0,0,0,-1,\n1,1,1,-1,-0.1\n', 'w.csv:3: tube = -0.1 m must be above 0'),
    ('t,x,y,z,tube\n0,0,0,-1,\n1,1,,-1,0.1\n2,2,2,-1,\n', 'w.csv:3: a tube needs x, y and z of'),
    ('x,y,height,speed\n0,0,1.2,-7\n0.8,0.5,1.4,0.8\n', 'w.csv:2: speed = -7 m/s must be above'),
    ('t,x,y,z,tube\n0,0,0,-1,-2\n1,1,1,-1,0.1\n', 'w.csv:2: tube = -2 m must be above 0'),
    ('t,speed,x,y,z\n0,1,0,0,-1\n1,,1,1,-1\n', 'w.csv:2: t and speed: give one of them'),
    (HEAD + ''.join(f'{i},0,0,-1,0\n' for i in range(1001)), 'w.csv: 1001 waypoints; a course ha'),
    (HEAD + '0,0,0,-1,0\n' * 1000000, r'w.csv: longer than \d+ characters; a course has at most'),
], ids=lambda value: value[:30] if value else 'empty')
def test_what_is_wrong_in_a_csv_file_is_named_by_file_and_row(file, text, message):
    with pytest.raises(ParameterError, match=message) as error:
        wp.read(file(text))
    assert '\n' not in str(error.value)


LEG = 'waypoints:\n- {t: 0, x: 0, y: 0, height: 1}\n- {t: 2, x: 1, y: 0, height: 1'


@pytest.mark.parametrize(('text', 'message'), [
    ('speed: 1\n', 'w.yaml: waypoints: missing'), ('waypoints: 3\n', 'w.yaml:1: waypoints: must '),
    ('- a\n', 'w.yaml: must hold names and values'),
    (LEG + '}\nminimize: snap\n', 'w.yaml:4: minimize: unknown parameter; did you mean minimise?'),
    (LEG + '}\nminimise: drag\n', "w.yaml:4: course.minimise = 'drag' is not one of snap, jerk"),
    (LEG + '}\nlimits: {speed: -1}\n', r'w.yaml:4: course.limits.speed = -1.0 m/s is outside'),
    (LEG + '}\nlimits: {thrust: 1}\n', 'w.yaml:4: limits.thrust: unknown parameter'),
    (LEG + ', tub: 1}\n', 'w.yaml:3: tub: unknown parameter; did you mean tube'),
    (LEG + ', yaw: .nan}\n', "w.yaml:3: yaw: '.nan' is not a number"),
    (LEG + ', box: {x: [0.5, 2]}}\n', 'w.yaml:3: the box excludes the waypoint of line 2'),
    (LEG + ', box: {height: [1.2, 2]}}\n', 'w.yaml:3: the box excludes the waypoint of line 2'),
    (LEG + ', box: {x: [2, -1]}}\n', r'w.yaml:3: x: \[2, -1\] must be the lowest and the highest'),
    (LEG + ', box: {width: [0, 1]}}\n', 'w.yaml:3: width: a box has x, y and z or height'),
    (LEG.replace('1}', '1, box: {x: [5, 6]}}') + '}\n', 'w.yaml:2: box: is of the leg to a way'),
    (LEG.replace('1}', '1, tube: 0.1}') + '}\n', 'w.yaml:2: tube: is of the leg to a waypoint'),
    (LEG.replace('1}', '1, speed: -1}') + '}\n', 'w.yaml:2: t and speed: give one of them'),
    (LEG.replace('t: 0', 'speed: -1') + '}\n', 'w.yaml:2: speed = -1 m/s must be above 0'),
    ('tube: 0.05\n' + LEG.replace(', height: 1', '', 2).replace('y: 0}', 'y: 0, height: 1}') +
     '}\n- {t: 4, x: 2, y: 0, height: 1}\n', 'w.yaml:4: a tube needs x, y and z of both ends of '
     'its leg, and the setting tube is for every leg'),
    (LEG + '}\nlimits: {speed: 0.4}\n', 'w.yaml:3: the leg takes 0.5 m/s on average, more than '
     'the limit speed = 0.4 m/s: give it more time'),
    (LEG + ', vx: 3}\nlimits: {speed: 2}\n', 'w.yaml:3: the velocity of 3 m/s is above the limit'),
    (LEG + '}\npieces: 0\n', r'w.yaml:4: course.pieces = 0 is outside \[1, 20\]'),
])
def test_what_is_wrong_in_a_yaml_file_is_named_by_file_and_line(file, text, message):
    with pytest.raises(ParameterError, match=message) as error:
        wp.read(file(text, 'w.yaml'))
    assert '\n' not in str(error.value)


def test_a_turn_that_is_too_fast_on_average_is_named(file):
    text = LEG.replace('height: 1}', 'height: 1, yaw_deg: 0}') + (
        ', yaw_deg: 180}\nlimits: {yaw_rate: 1}\n')
    with pytest.raises(ParameterError, match='w.yaml:3: the leg takes 1.57 rad/s on average, .*'
                       'yaw_rate = 1 rad/s'):
        wp.read(file(text, 'w.yaml'))
