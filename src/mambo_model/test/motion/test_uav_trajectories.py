"""The CSV format of uav_trajectories: every bit there and back, every fault by file and row."""

from mambo_model.motion import polynomial as poly, uav_trajectories as uav
from mambo_model.schema import ParameterError
import numpy as np
import pytest

HEADER = ','.join(uav.HEADER)
ROW = ','.join(['1.0', *['0.5', *['0.0'] * 7] * 4])


def text(*rows):
    return '\n'.join((HEADER, *rows)) + '\n'


def turned(angle):
    """Return that piece with another yaw."""
    return f'{ROW[:ROW.rindex("0.5")]}{0.5 + angle!r}{",0.0" * 7}'


def test_a_yaw_may_go_on_a_whole_turn_away():
    assert uav.parse(text(ROW, turned(2.0 * np.pi), turned(-4.0 * np.pi))).total == 3.0


def test_a_course_comes_back_to_the_bit():
    rng = np.random.default_rng(1)
    duration, c = rng.uniform(0.3, 2.0, 5), rng.normal(size=(5, 4, 8))
    for i in range(1, 5):  # begin where the piece before ended
        c[i, :, :2] = [poly.jet(axis, duration[i - 1])[:2] for axis in c[i - 1]]
    course = poly.Course(duration, c)
    again = uav.parse(uav.to_text(course))
    assert again.duration.tobytes() == duration.tobytes()
    assert again.coefficients.tobytes() == c.tobytes()
    assert uav.to_text(again) == uav.to_text(course)


def test_axes_of_a_file_are_z_up():
    row = ['2', *'1 0 0 0 0 0 0 0 2 0 0 0 0 0 0 0 3 0 0 0 0 0 0 0'.split(), '0.5', *['0'] * 7]
    course = uav.parse(text(','.join(row)))
    assert poly.state_at(course, 1.0)[:, 0].tolist() == [1.0, -2.0, -3.0, -0.5]
    assert uav.to_text(course).splitlines()[1].split(',')[:2] == ['2.0', '1.0']


def test_a_file_as_the_crazyswarm_writes_it_is_read(tmp_path):
    """A comma ends every line, one is empty, one a comment, there are spaces."""
    path = tmp_path / 'figure.csv'
    path.write_bytes(f'\ufeff{HEADER},\r\n\r\n# wait\r\n{ROW.replace(",", ", ")},\r\n'.encode())
    course = uav.load(path)
    assert course.total == 1.0 and course.coefficients.shape == (1, 4, 8)


@pytest.mark.parametrize(('content', 'message'), [
    ('', 'c.csv: the file is empty'), ('\n \n', 'c.csv: the file is empty'),
    ('# only a comment\n', 'c.csv: holds no header and no pieces'),
    (text(), 'c.csv: holds no pieces below its header'),
    (ROW, r'c.csv:1: the header must be duration,x\^0,...,yaw\^7 \(33 columns\)'),
    (text(ROW, ROW[:-4]), r'c.csv:3: 32 columns; a piece has 33: its duration and 8 coeff'),
    (text(ROW + ',1'), 'c.csv:2: 34 columns'),
    (text(ROW.replace('0.5', 'nan', 1)), r'c.csv:2: x\^0: nan is not a finite number'),
    (text(ROW.replace('0.5', 'inf', 1)), r'c.csv:2: x\^0: inf is not a finite number'),
    (text(ROW, ROW[:-3] + 'one'), r"c.csv:3: yaw\^7: 'one' is not a number"),
    (text(ROW.replace('1.0', '0', 1)), 'c.csv:2: duration = 0 s must be above 0'),
    (text(ROW.replace('1.0', '-1', 1)), 'c.csv:2: duration = -1 s must be above 0'),
    (text(ROW.replace('1.0', '5000', 1)), 'c.csv:2: duration = 5000 s .* at most 3600 s'),
    (text(ROW.replace('0.5', '1500', 1)),
     'c.csv:2: the piece is 1.5e.03 m away .* positions are in metres, times in seconds'),
    (text(ROW, ROW.replace('0.5', '0.6', 1)), 'c.csv:3: position jumps by 0.1 m from the end'),
    (text(ROW, ROW.replace('0.5,0.0', '0.5,0.2', 1)), 'c.csv:3: velocity jumps by 0.2 m/s'),
    (text(ROW, turned(0.4)), 'c.csv:3: yaw jumps by 0.4 rad from the end of the piece before'),
    (text(ROW, turned(-3.0)), 'c.csv:3: yaw jumps by 3 rad from the end of'),
    (text(*[ROW] * 1001), 'c.csv: 1001 pieces; a course has at most 1000'),
])
def test_what_is_wrong_is_named_by_file_and_row(tmp_path, content, message):
    path = tmp_path / 'c.csv'
    path.write_text(content)
    with pytest.raises(ParameterError, match=message) as error:
        uav.load(path)
    assert '\n' not in str(error.value)


def test_a_file_that_is_none_is_named(tmp_path):
    binary, huge = tmp_path / 'b.csv', tmp_path / 'h.csv'
    binary.write_bytes(bytes(range(128, 256)))
    huge.write_text(text(*[ROW] * 20000))
    for path, message in ((binary, 'not a text file'), (tmp_path, 'Is a directory'),
                          (tmp_path / 'no.csv', 'no.csv: No such file or directory'),
                          (huge, r'h.csv: longer than \d+ characters; a course has at most 1000')):
        with pytest.raises(ParameterError, match=message):
            uav.load(path)


def test_a_degree_that_the_format_cannot_hold_is_refused():
    with pytest.raises(ParameterError, match='degree 9: the format holds degree 7'):
        uav.to_text(poly.Course(np.ones(1), np.ones((1, 4, 10))))
