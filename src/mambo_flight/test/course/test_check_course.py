"""The command that checks courses, as it is typed."""

import json
from pathlib import Path

from course_commands import EIGHT, lines
from mambo_flight.course import check_course, course_file, feasibility
from mambo_model.vehicle.parameters import Vehicle
import pytest


def test_a_course_that_can_be_flown_is_a_table_and_a_picture(tmp_path, capsys):
    picture = tmp_path / 'eight.png'
    assert check_course.main([EIGHT, '-o', str(picture)]) == 0
    out, err = lines(capsys)
    assert out[0] == f'{EIGHT}: 8.062 s, 8 polynomials' and not err
    assert [line.split(' [')[0] for line in out[2:-1]] == list(feasibility.QUANTITIES)[:-1]
    assert out[-1] == f'picture: {picture}'
    assert picture.read_bytes().startswith(b'\x89PNG') and picture.stat().st_size > 20000


def test_one_that_cannot_is_exit_code_1_with_time_and_quantity(fast, capsys):
    assert check_course.main([fast]) == 1
    out, (line,) = lines(capsys)
    failure = feasibility.check(course_file.read(Path(fast)), Vehicle())
    assert line == (f'trajectory check: {fast}: cannot be flown: {failure}; '
                    '--stretch auto slows it')
    assert 'thrust [N]' in out[5]
    assert check_course.main([fast, '--stretch', 'auto']) == 0
    out, err = lines(capsys)
    assert ', stretched 1.' in out[0] and not err
    assert check_course.main([fast, '--stretch', '2']) == 0


def test_heights_are_not_to_be_mended_by_time(tmp_path, capsys):
    file = tmp_path / 'low.csv'
    file.write_text('t,x,y,height\n0,0,0,-0.5\n5,1,0,1\n10,0,0,1\n')
    assert check_course.main([str(file)]) == 1
    _, (line,) = lines(capsys)
    assert 'height -0.5 m at t = 0.000 s, below the limit of 0 m; no --stretch changes' in line
    assert 'move it with --height' in line and 'slows it' not in line
    assert check_course.main([str(file), '--height', '1']) == 0


def test_a_vehicle_that_cannot_even_hover_is_not_to_be_slowed(tmp_path, capsys):
    file, heavy = tmp_path / 'line.csv', tmp_path / 'heavy.yaml'
    file.write_text('t,x,y,height\n0,0,0,1\n5,1,0,1\n10,0,0,1\n')
    heavy.write_text(
        'description: heavy\nbase: identified\nmass: {value: 1.0, unit: kg, source: scale}\n')
    assert check_course.main([str(file), '--vehicle', str(heavy)]) == 1
    assert 'no slower course is feasible either' in lines(capsys)[1][0]


def test_one_that_is_far_larger_than_a_hall_gets_a_warning(tmp_path, capsys):
    for size, warned in ((29.0, False), (31.0, True)):
        file = tmp_path / f'{size:g}.csv'
        file.write_text(f't,x,y,height\n0,0,0,1\n50,{size},0,1\n100,0,0,1\n')
        assert check_course.main([str(file)]) == 0
        out, err = lines(capsys)
        assert not err and warned == (
            out[-1] == 'warning: the course goes 31 m from its first point: positions are in '
            'metres')


@pytest.mark.parametrize('factor, told', [(1.0, False), (250.0, False), (1000.0, True)])
def test_times_in_milliseconds_are_told(tmp_path, capsys, factor, told):
    path = tmp_path / 'ms.csv'
    path.write_text(f'x,y,height,t\n0,0,1.2,0\n0.8,0.5,1.4,{2 * factor}\n0,0,1.2,{4 * factor}\n')
    assert check_course.main([str(path)]) == 0
    assert ('warning: the course takes 4000 s to go 0.964 m: times are in seconds'
            in capsys.readouterr().out) is told


def test_numbers_as_json_are_those_of_the_table(fast, capsys):
    assert check_course.main([fast, '--json']) == 1
    out, _ = capsys.readouterr()
    printed = json.loads(out)
    failure = feasibility.check(course_file.read(Path(fast)), Vehicle())
    assert printed['feasible'] is False and printed['failure'] == failure._asdict()
    assert printed['duration'] == 2.8 and set(printed['quantities']) == set(feasibility.QUANTITIES)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['no.csv'], 'no.csv: No such file or directory'),
    ([EIGHT, '--stretch', 'much'], '--stretch much: write a number, or auto'),
    ([EIGHT, '--stretch', '0'], '--stretch 0 must be within 0.01 to 100'),
    ([EIGHT, '--scale', 'nan'], '--scale: nan must be within 0.01 to 100'),
    ([EIGHT, '--height', 'nan'], '--height: nan must be within -1000 to 1000 m'),
    ([EIGHT, '--duration', '3'], '--duration is for a function of time; for a file use --stretch'),
    ([EIGHT, '--vehicle', 'eagle'], "vehicle 'eagle' is unknown"),
    ([EIGHT, '--tube', '-1'], '--tube: -1 must be within 0 to 100 m'),
    ([EIGHT, '--speed', '0'], '--speed: 0 must be more than 0 and at most 30 m/s'),
    ([EIGHT, '--speed', '3'], '--speed is for legs without a time: each leg of '),
    ([EIGHT, '--pieces', '1.5'], "--pieces: '1.5' is not a whole number"),
    ([EIGHT, '-o', 'x.doc'], 'x.doc: the name of a picture must end in .png, .svg, .pdf'),
    (['mine.py:f', '--duration', '3'], 'mine.py: No such file or directory')])
def test_what_is_wrong_is_one_line_and_exit_code_2(capsys, arguments, message):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(check_course.main(arguments))
    out, (line,) = lines(capsys)
    assert end.value.code == 2 and not out
    assert line.startswith('trajectory check: ') and message in line


def test_a_function_is_as_long_as_its_file_says_or_the_option(capsys, tmp_path):
    path = tmp_path / 'mine.py'
    path.write_text('def line(t):\n    return 0.1 * t, 0.0, -1.0\n')
    assert check_course.main([str(path)]) == 2
    assert lines(capsys)[1] == [
        f'trajectory check: {path}:line: no duration: give --duration, or state '
        'duration = 12.0 (s) in the file']
    path.write_text(f'duration = 6.0\n{path.read_text()}')
    assert check_course.main([str(path), '--json']) == 0
    assert '"duration": 6.0' in capsys.readouterr().out
    assert check_course.main([str(path), '--duration', '3', '--json']) == 0
    assert '"duration": 3.0' in capsys.readouterr().out
    assert check_course.main([str(path), '--tube', '1']) == 2
    assert 'leave out the options for waypoints, tube' in lines(capsys)[1][0]


@pytest.mark.parametrize('words, said', [
    ((), []), (('--stretch', '2'), []),
    (('--stretch', '0.5'), ['speed is 1 m/s at most, above limits.speed = 0.6 m/s of ']),
    (('--scale', '2'), ['speed is 1 m/s at most, above limits.speed = 0.6 m/s of ']),
    (('--scale', '2', '--max-speed', '2'), [])])
def test_limits_that_a_stretched_course_leaves_are_told(tmp_path, capsys, words, said):
    file = tmp_path / 'slow.yaml'
    file.write_text('limits: {speed: 0.6}\nwaypoints:\n- {t: 0, x: 0, y: 0, height: 1}\n'
                    '- {t: 4, x: 1, y: 0, height: 1}\n')
    assert check_course.main([str(file), *words]) == 0
    told = [line for line in lines(capsys)[0] if line.startswith('warning: ')]
    assert len(told) == len(said) and all(
        line.endswith(f'{file}: --stretch and --scale do not keep it') for line in told)
