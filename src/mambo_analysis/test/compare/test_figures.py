"""Figures of a flight: each draws the numbers of the bag, with the right sign and axis."""

from mambo_analysis.compare import figures
from mambo_bags.reader import read_bag
from mambo_model import palette
from mambo_model.palette import COLOURS
from mambo_signals.flight_phases import Phases, phases
from matplotlib.figure import Figure
import numpy as np
import pytest
from synthetic import E_TOTAL, ESTIMATION, make_flight, Maker, STEP, truth_position, VARIANCE


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return read_bag(make_flight(tmp_path_factory.mktemp('bags') / 'flight', 9.0))


def drawn(draw, bag, count):
    """Return the axes that a function of figures.py has drawn into."""
    axes = list(Figure().subplots(count, 1, squeeze=False)[:, 0])
    draw(axes, bag, phases(bag))
    return axes


def curve(ax, label):
    line, = (line for line in ax.lines if line.get_label() == label)
    return line.get_xdata(), line.get_ydata()


def bag_of(path, rows, topics=None, **options):
    """Write a bag of {topic: [fields of each message]}, 5 ms apart, and read it."""
    maker = Maker(path, topics or rows, **options)
    for k in range(max(map(len, rows.values()))):
        for topic, values in rows.items():
            if k < len(values):
                maker.write(topic, k * STEP, **values[k])
    maker.writer.close()
    return read_bag(path)


def test_names_are_listed_as_in_a_sentence():
    assert figures.listed(['a']) == 'a'
    assert figures.listed(['a', 'b']) == 'a and b'
    assert figures.listed(['a', 'b', 'c']) == 'a, b and c'


@pytest.mark.parametrize(('takeoff', 'landing', 'text'), [
    (None, None, ''), (1, None, ' Take-off is shaded.'), (None, 2, ' Landing is shaded.'),
    (1, 2, ' Take-off and landing are shaded.')])
def test_what_is_shaded_is_said(takeoff, landing, text):
    assert figures.shaded(Phases(takeoff, landing, '')) == text


def test_thin_columns_keep_their_rows_together():
    x = np.arange(3500.0)
    a, b = figures._thin(x, -x)
    assert len(a) <= figures.POINTS and (a == -b).all() and a[0] == 0.0
    np.testing.assert_array_equal(np.diff(a), 4.0)
    assert len(figures._thin(np.arange(1000.0))[0]) == 1000


def test_tracks_come_in_one_order_and_only_with_a_known_position(flight, tmp_path):
    assert [topic for topic, _, _ in figures.tracks(flight)] == [
        'reference', 'ground_truth/odom', 'optitrack/pose', 'estimate/odom']
    maker = Maker(tmp_path / 'bag', ('estimate/odom', 'ground_truth/odom'))
    for k in range(3):
        maker.odometry('estimate/odom', k * STEP, (np.nan,) * 3)
        maker.odometry('ground_truth/odom', k * STEP, (0, 0, 1) if k == 1 else (0, np.nan, 1))
    maker.writer.close()
    assert figures.tracks(read_bag(tmp_path / 'bag')) == [
        ('ground_truth/odom', 'truth', 'ground truth')]


def test_the_position_of_each_axis_is_drawn_over_time_z_up(flight):
    axes = drawn(figures.draw_position, flight, 3)
    assert [ax.get_ylabel() for ax in axes] == ['x [m]', 'y [m]', 'z up [m]']
    for axis, ax in enumerate(axes):
        t, p = curve(ax, 'ground truth')
        np.testing.assert_allclose(p, truth_position(t)[:, axis], atol=1e-6)
    assert axes[-1].get_xlabel() == 'time [s]'
    assert axes[0].get_xlim() == pytest.approx((0.0, 9.0), abs=0.01)


def test_the_error_is_the_length_of_the_difference(flight):
    ax, = drawn(figures.draw_errors, flight, 1)
    t, error = curve(ax, 'estimation: estimate minus Optitrack')
    np.testing.assert_allclose(error[t > 1.0], E_TOTAL, atol=2e-4)
    t, error = curve(ax, 'tracking: ground truth minus reference')
    length = np.linalg.norm([0.01, 0.02, 0.03])
    assert np.median(error[t < 7.5]) == pytest.approx(2.0 * length, rel=1e-3)
    assert np.median(error[t > 8.5]) == pytest.approx(length, rel=1e-3)


def test_the_path_is_seen_from_above_and_from_the_side_to_scale(flight):
    axes = list(Figure().subplots(1, 2))
    figures.draw_path(axes, flight, phases(flight))
    above, side = axes
    assert (above.get_ylabel(), side.get_ylabel()) == ('y [m]', 'z up [m]')
    assert above.get_aspect() == side.get_aspect() == 1.0
    end = truth_position(8.9)
    for ax, columns in ((above, (0, 1)), (side, (0, 2))):
        truth = ax.lines[1].get_xydata()
        assert np.linalg.norm(truth - end[list(columns)], axis=1).min() < 0.01


def test_motors_are_laid_out_as_seen_from_above(tmp_path):
    pwm = np.array([100.0, 200.0, 300.0, 400.0])
    bag = bag_of(tmp_path / 'bag', {'motor_pwm': [{'pwm': pwm}, {'pwm': pwm},
                                                  {'pwm': np.full(4, np.nan)}]})
    axes = drawn(figures.draw_motors, bag, 4)
    places = {ax.get_title(): np.nanmax(ax.lines[0].get_ydata()) for ax in axes}
    assert places == {'0 front left': 100.0, '1 front right': 200.0, '3 rear left': 400.0,
                      '2 rear right': 300.0}
    assert list(places) == ['0 front left', '1 front right', '3 rear left', '2 rear right']
    assert {ax.get_ylim() for ax in axes} == {(85.0, 415.0)}  # one scale, a margin of 5 %


def test_a_height_by_pressure_rises_as_the_pressure_falls(tmp_path):
    """By 1.2 kg/m^3 * 9.81 m/s^2 = 11.772 Pa a metre, from the mean of the first half second."""
    pressures = [101325.0] * 101 + [101325.0 - 11.772] * 50
    ranges = [0.2, 1.5, 5.0] + [2.0] * 30
    bag = bag_of(tmp_path / 'bag', {
        'barometer/pressure': [{'fluid_pressure': p} for p in pressures],
        'sonar/range': [{'range': r, 'min_range': 0.3, 'max_range': 4.0} for r in ranges]})
    ax, = drawn(figures.draw_height, bag, 1)
    _, height = curve(ax, 'barometer')
    np.testing.assert_allclose(height[[0, 50, -1]], [0.0, 0.0, 1.0], atol=1e-9)
    _, sonar = curve(ax, 'sonar, slant')
    assert sonar[0] == 1.5 and len(sonar) == 31  # what is outside of the limits is left out
    plot, = (plot for plot in figures.plots(bag) if plot.name == 'height')
    assert plot.text == ('Height over time by sonar and barometer. 2 of 33 sonar samples are '
                         'outside of its limits and left out.')


def test_flow_forward_and_left_stand_in_this_order(tmp_path):
    bag = bag_of(tmp_path / 'bag', {'optical_flow': [{'rate_x': 1.0, 'rate_y': -2.0}] * 3})
    forward, left = drawn(figures.draw_flow, bag, 2)
    assert (forward.get_ylabel(), left.get_ylabel()) == ('forward [rad/s]', 'left [rad/s]')
    assert forward.lines[0].get_ydata()[0] == 1.0 and left.lines[0].get_ydata()[0] == -2.0


def inner(innovation, ratio):
    nothing = float('nan')
    return {'status': 2, 'sonar_innovation': innovation, 'sonar_test_ratio': ratio,
            'flow_innovation': np.full(2, nothing), 'flow_test_ratio': nothing,
            'barometer_innovation': nothing, 'barometer_test_ratio': nothing}


def test_refused_samples_are_crosses_and_counted(tmp_path):
    states = [inner(0.1, 0.5), inner(0.2, 1.0), inner(-3.0, 1.01), inner(float('nan'), 2.0)]
    bag = bag_of(tmp_path / 'bag', {
        'estimator/state': states, 'motor_pwm': [{'pwm': np.ones(4)}]})
    ax, = drawn(figures.draw_innovations, bag, 1)
    taken, crosses = ax.lines[:2]
    np.testing.assert_allclose(taken.get_ydata(), [0.1, 0.2])
    np.testing.assert_allclose(crosses.get_ydata(), [-3.0])
    assert crosses.get_marker() == 'x' and ax.get_title('right') == '1 of 3 refused'
    plot, = (plot for plot in figures.plots(bag) if plot.name == 'innovations')
    assert plot.text.endswith('of sonar over time. Refused samples are crosses.')
    assert plot.shape == (1, 1)  # a row for each sensor that was used


def test_the_band_is_three_standard_deviations_of_the_filter(flight):
    axes = drawn(figures.draw_covariance, flight, 3)
    for axis, ax in enumerate(axes):
        band = ax.collections[0].get_paths()[0].vertices[:, 1]
        assert band.max() == pytest.approx(3.0 * np.sqrt(VARIANCE[axis]))
        assert band.min() == pytest.approx(-3.0 * np.sqrt(VARIANCE[axis]))
        error = ax.lines[0].get_ydata()
        assert np.median(error) == pytest.approx(ESTIMATION[axis], abs=1e-5)


def test_a_bag_has_the_figures_that_it_has_data_for(flight, tmp_path):
    assert [plot.name for plot in figures.plots(flight)] == [
        'position', 'errors', 'path', 'motors', 'height', 'flow', 'innovations', 'covariance']
    bag = bag_of(tmp_path / 'bag', {'motor_pwm': [{'pwm': np.ones(4)}] * 3})
    assert [plot.name for plot in figures.plots(bag)] == ['motors']
    without = read_bag(make_flight(tmp_path / 'blind', 6.0, (
        'ground_truth/odom', 'optitrack/pose', 'estimator/state')))
    assert [plot.name for plot in figures.plots(without)] == [
        'position', 'path', 'motors', 'height', 'flow']


def test_captions_name_what_is_drawn(flight):
    text = {plot.name: plot.text for plot in figures.plots(flight)}
    assert 'reference, ground truth, Optitrack and estimate over time' in text['position']
    assert text['position'].endswith(figures.shaded(phases(flight)))
    assert text['innovations'].startswith(
        'Measurement minus prediction of sonar and optical flow over time')


def test_a_signal_has_the_colour_of_its_role(flight):
    axes = drawn(figures.draw_position, flight, 3)
    for _, role, label in figures.tracks(flight):
        line, = (line for line in axes[0].lines if line.get_label() == label)
        assert line.get_color() == COLOURS[role] == palette.line(role)['color']


def test_take_off_and_landing_are_shaded_where_they_are(flight):
    parts, ax = phases(flight), Figure().subplots()
    ax.set_xlim(0.0, 9.0)
    figures._mark([ax], parts)
    spans = [patch.get_extents().transformed(ax.transData.inverted()) for patch in ax.patches]
    assert [round(span.x0, 2) for span in spans] == [0.0]
    assert spans[0].x1 == pytest.approx(parts.takeoff_end * 1e-9)
    assert ax.get_xlim() == (0.0, 9.0)


def test_a_figure_has_its_curves_named_below_and_the_sheet_has_them_all(flight, tmp_path):
    plot = figures.plots(flight)[0]
    figure = figures.figure_of(plot, flight, width=5.0)
    assert figure.get_size_inches() == pytest.approx((5.0, plot.height))
    legend, = (ax.get_legend() for ax in figure.axes if ax.get_legend())
    assert [text.get_text() for text in legend.get_texts()] == [
        'reference', 'ground truth', 'Optitrack', 'estimate']
    sheet = figures.overview(flight, 'a flight')
    assert sheet.get_suptitle() == 'a flight'
    assert len(sheet.axes) > sum(p.shape[0] * p.shape[1] for p in figures.plots(flight))
