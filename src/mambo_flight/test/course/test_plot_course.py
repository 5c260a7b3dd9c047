"""The picture of a course: its path from above, its seams, and the limits it comes near to."""

import math

from mambo_flight.course import plot_course
from mambo_flight.course.feasibility import Limit, QUANTITIES
from mambo_flight.course.plot_course import draw
from mambo_model import palette
from mambo_model.motion.polynomial import Course
import numpy as np
import pytest

T = np.linspace(0.0, 3.0, 301)


@pytest.fixture
def figure(figures_of):
    """Return the figures made."""
    return figures_of(plot_course)


def course():
    """Return two pieces: 2 m north in 1 s, then 1 m east in 2 s, at a height of 1.5 m."""
    coefficients = np.zeros((2, 4, 8))
    coefficients[:, 2, 0] = -1.5
    coefficients[0, 0, 1] = 2.0
    coefficients[1, 0, 0], coefficients[1, 1, 1] = 2.0, 0.5
    return Course(np.array([1.0, 2.0]), coefficients)


def demand():
    """Return a column for each quantity, each a constant of its own but for the speed."""
    columns = np.tile(np.arange(len(QUANTITIES), dtype=float) * 10.0, (len(T), 1))
    columns[:, list(QUANTITIES).index('speed')] = T
    return columns


def panel(figure, name):
    return next(ax for ax in figure.axes if ax.get_ylabel().startswith(f'{name} ['))


def test_the_path_is_seen_from_above_north_up_with_its_seams(tmp_path, figure):
    draw(tmp_path / 'a.png', course(), T, demand(), {}, 'two pieces')
    assert (tmp_path / 'a.png').read_bytes()[:4] == b'\x89PNG'
    assert figure[0].get_suptitle() == 'two pieces'
    above = figure[0].axes[0]
    assert (above.get_xlabel(), above.get_ylabel()) == ('y, east [m]', 'x, north [m]')
    assert above.get_aspect() == 1.0
    path, seams = (line.get_xydata() for line in above.lines)
    np.testing.assert_allclose(path[[0, -1]], [[0.0, 0.0], [1.0, 2.0]], atol=0.02)
    np.testing.assert_allclose(seams, [[0.0, 0.0], [0.0, 2.0], [1.0, 2.0]], atol=1e-9)


def test_each_quantity_is_its_column_over_time_in_its_unit(tmp_path, figure):
    draw(tmp_path / 'a.svg', course(), T, demand(), {}, '')
    line, = panel(figure[0], 'speed').lines
    np.testing.assert_array_equal(line.get_xydata(), np.c_[T, T])
    for name in ('height', 'thrust', 'tilt', 'body rate'):
        line, = panel(figure[0], name).lines
        assert line.get_ydata()[0] == 10.0 * list(QUANTITIES).index(name)
        assert panel(figure[0], name).get_ylabel() == f'{name} [{QUANTITIES[name]}]'


def test_the_command_of_every_motor_is_a_line_of_one_panel(tmp_path, figure):
    draw(tmp_path / 'a.svg', course(), T, demand(), {}, '')
    lines = panel(figure[0], 'PWM').lines
    assert [line.get_label() for line in lines] == [f'PWM of motor {k}' for k in range(1, 5)]
    first = list(QUANTITIES).index('PWM of motor 1')
    assert [line.get_ydata()[0] for line in lines] == [10.0 * (first + k) for k in range(4)]
    assert len({line.get_color() for line in lines}) == 4


@pytest.mark.parametrize(('limit', 'drawn'), [
    (Limit(0.0, 3.5), [0.0, 3.5]), (Limit(-math.inf, 3.5), [3.5]), (Limit(-50.0, 50.0), [])])
def test_a_limit_is_drawn_where_the_course_comes_near(tmp_path, figure, limit, drawn):
    draw(tmp_path / 'a.svg', course(), T, demand(), {'speed': limit}, '')
    dashed = [line for line in panel(figure[0], 'speed').lines if line.get_linestyle() == '--']
    assert [line.get_ydata()[0] for line in dashed] == drawn
    assert all(line.get_color() == palette.COLOURS['bad'] for line in dashed)
