"""The command that plans a course: a file that is flown as it was asked for."""


from course_commands import EIGHT, lines
from mambo_flight.course import feasibility, plan_course
from mambo_model.motion.polynomial import state_at
from mambo_model.motion.uav_trajectories import load
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest


def test_a_plan_is_a_file_that_is_flown_as_planned(fast, tmp_path, capsys):
    plan = tmp_path / 'new/plan.csv'
    assert plan_course.main([fast, '--stretch', 'auto', '--height', '2', '--scale', '0.9',
                             '-o', str(plan)]) == 0
    out, err = lines(capsys)
    course = load(plan)
    assert out == [f'{plan}: {course.total:.3f} s, 2 polynomials, stretched '
                   f'{course.total / 2.8:.4f} times'] and not err
    assert feasibility.check(course, Vehicle()) is None
    middle = state_at(course, 0.5 * course.total)
    assert middle[:3, 0] == pytest.approx([5.4, 0.0, -2.0], abs=1e-9)
    assert plan_course.main([fast, '-o', str(plan)]) == 2
    assert lines(capsys)[1] == [
        f'trajectory plan: {plan} exists: give another --output or remove it']


def test_a_plan_that_the_disk_does_not_take_is_named_and_leaves_no_file(
        fast, tmp_path, capsys, small_disk):
    small_disk(100)
    assert plan_course.main([fast, '-o', str(tmp_path / 'plan.csv')]) == 1
    assert lines(capsys)[1] == [
        f'trajectory plan: {tmp_path}/plan.csv: cannot be written (File too large)']
    assert not (tmp_path / 'plan.csv').exists()


def test_a_plan_that_cannot_be_flown_is_written_with_a_warning(fast, tmp_path, capsys):
    assert plan_course.main([fast, '-o', str(tmp_path / 'plan.csv')]) == 0
    out, _ = lines(capsys)
    assert out[1].startswith('warning: identified cannot fly it: ')
    assert out[1].endswith('--stretch auto slows it')


def test_a_plan_far_larger_than_a_hall_is_written_with_a_warning(tmp_path, capsys):
    file = tmp_path / 'cm.csv'
    file.write_text('t,x,y,height\n0,0,0,1\n60,-40,0,1\n')
    assert plan_course.main([str(file), '-o', str(tmp_path / 'plan.csv')]) == 0
    out, err = lines(capsys)
    assert not err and out[-1].startswith('warning: the course goes 40 m from its first point')


def test_a_function_is_planned(tmp_path, capsys):
    mine = tmp_path / 'mine.py'
    mine.write_text('from math import sin\n\ndef wave(t):\n    return sin(t), 0.0, -1.5\n')
    plan = tmp_path / 'wave.csv'
    assert plan_course.main([f'{mine}:wave', '--duration', '6', '-o', str(plan)]) == 0
    assert load(plan).total == pytest.approx(6.0)


def test_options_of_the_planner_are_settings(tmp_path):
    plan = tmp_path / 'slow.csv'
    waypoints = tmp_path / 'w.csv'
    waypoints.write_text('x,y,height\n0,0,1\n2,0,1\n')
    assert plan_course.main([str(waypoints), '--speed', '0.5', '--minimise', 'jerk',
                             '-o', str(plan)]) == 0
    course = load(plan)
    assert course.total == 4.0 and not course.coefficients[:, :, 6:].any()


def test_a_plan_is_planned_as_itself(tmp_path):
    first, again = tmp_path / 'plan.csv', tmp_path / 'again.csv'
    assert plan_course.main([EIGHT, '-o', str(first)]) == 0
    assert plan_course.main([str(first), '-o', str(again)]) == 0
    before, after = load(first), load(again)
    np.testing.assert_allclose(after.duration, before.duration, rtol=1e-9)
    for t in np.linspace(0.0, before.total, 7):
        np.testing.assert_allclose(state_at(after, t), state_at(before, t), atol=1e-6)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['none.csv'], 'none.csv: No such file or directory'),
    ([EIGHT, '--stretch', 'much'], '--stretch much: write a number, or auto'),
    ([EIGHT, '--height', '1e9'], '--height: 1e9 must be within -1000 to 1000 m')])
def test_a_course_that_cannot_be_read_is_one_line_and_no_file(
        tmp_path, capsys, arguments, message):
    plan = tmp_path / 'plan.csv'
    with pytest.raises(SystemExit) as end:
        raise SystemExit(plan_course.main([*arguments, '-o', str(plan)]))
    (line,) = lines(capsys)[1]
    assert end.value.code == 2 and line.startswith('trajectory plan: ') and message in line
    assert not plan.exists()
