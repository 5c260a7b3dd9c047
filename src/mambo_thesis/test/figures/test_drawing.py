"""Figures in the layout of the thesis: positions below each other, gaps left open."""

from mambo_model import palette
from mambo_thesis.figures.drawing import (
    lines, over_time, POSITION, positions, positions_and_rms, sheet)
import numpy as np
import pytest

T = np.linspace(0.0, 10.0, 101)


def curve(scale):
    return T, scale * np.stack([T, T**2, -T], axis=1)


def test_a_sheet_has_its_plots_row_by_row():
    figure, plots = sheet(2, 3, height=2.0)
    assert len(plots) == 6 and figure.get_size_inches() == pytest.approx((7.0, 4.5))
    assert [axes.get_subplotspec().rowspan.start for axes in plots] == [0, 0, 0, 1, 1, 1]
    assert not plots[0].spines['top'].get_visible()


def test_lines_are_drawn_by_label_and_what_is_unknown_is_not():
    _, (axes,) = sheet(1)
    curves = {'reference': (T, T), 'lost': (T, np.full(101, np.nan)), 'IMU': (T, 2.0 * T)}
    lines(axes, curves, 'x [m]')
    assert [line.get_label() for line in axes.lines] == ['reference', 'IMU']
    assert axes.get_ylabel() == 'x [m]'
    styles = palette.lines(curves)
    assert [line.get_color() for line in axes.lines] == [styles[0]['color'], styles[2]['color']]


def test_positions_are_drawn_axis_below_axis_down_positive():
    figure = positions({'reference': curve(1.0), 'IMU': curve(2.0)})
    plots = figure.axes
    assert [axes.get_ylabel() for axes in plots] == list(POSITION)
    for k, axes in enumerate(plots):
        np.testing.assert_array_equal(axes.lines[1].get_ydata(), curve(2.0)[1][:, k])
    assert [axes.get_xlabel() for axes in plots] == ['', '', 'time [s]']
    legend, = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ['reference', 'IMU']


def test_a_curve_that_is_not_in_the_first_plot_is_named_too():
    t, height = curve(1.0)
    alone = height.copy()
    alone[:, :2] = np.nan  # measures the height alone
    legend, = positions({'IMU': (t, height), 'sonar': (t, alone)}).legends
    assert [text.get_text() for text in legend.get_texts()] == ['IMU', 'sonar']


def test_only_the_axes_that_are_asked_for_are_shown():
    figure = positions({'IMU': curve(1.0)}, (0, 2))
    assert [axes.get_ylabel() for axes in figure.axes] == [POSITION[0], POSITION[2]]
    np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), -T)


def test_the_rms_stands_beside_its_axis():
    rms = np.abs(curve(0.1)[1])
    figure = positions_and_rms({'IMU': curve(1.0)}, T, rms, (1, 2))
    left, right, below, last = figure.axes
    assert (left.get_ylabel(), below.get_ylabel()) == (POSITION[1], POSITION[2])
    assert (right.get_ylabel(), last.get_ylabel()) == ('RMS $y$ [m]', 'RMS $z$ [m]')
    np.testing.assert_array_equal(right.lines[0].get_ydata(), rms[:, 1])
    np.testing.assert_array_equal(last.lines[0].get_ydata(), rms[:, 2])
    assert right.get_ylim()[0] == 0.0 and below.get_xlabel() == last.get_xlabel() == 'time [s]'


def test_one_quantity_over_time_has_a_curve_for_each_label():
    figure = over_time({'gyro': (T, T**2), 'fit': (T, T)}, 'rate [rad/s]')
    axes, = figure.axes
    assert [line.get_label() for line in axes.lines] == ['gyro', 'fit']
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), T**2)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ('time [s]', 'rate [rad/s]')
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ['gyro', 'fit']
