"""Figures of a flight: each draws the numbers of the bag, with the right sign and axis."""

from mambo_analysis.compare import figures
from mambo_analysis.compare.figures import Line
from mambo_bags.reader import read_bag
from mambo_model.palette import COLOURS
from mambo_signals.flight_phases import Phases, phases
from matplotlib.image import imread
import numpy as np
import pytest
from scipy.stats import chi2
from synthetic import E_TOTAL, ESTIMATION, make_flight, Maker, STEP, truth_position, VARIANCE


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return read_bag(make_flight(tmp_path_factory.mktemp('bags') / 'flight', 9.0))


def named(bag, name):
    """Return the plot of a name."""
    plot, = (plot for plot in figures.plots(bag) if plot.name == name)
    return plot


def curve(panel, label):
    line, = (line for line in panel.lines if line.name == label)
    return line.x, line.y


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


def test_a_thinned_curve_keeps_its_peaks_and_dots_their_rows():
    t, values = np.arange(100_000) * 0.005, np.zeros(100_000)
    values[[12_345, 54_321]] = [7.0, -9.0]
    values[20_000:30_000] = np.nan
    thin = Line('', t, values, 'ink').thinned()
    assert len(thin.x) <= figures.POINTS + 200 and np.isnan(thin.y).any()
    assert (np.nanmax(thin.y), np.nanmin(thin.y)) == (7.0, -9.0)
    band = Line('', t, values, 'ink', 'band', -values).thinned()
    assert len(band.x) <= figures.POINTS and (band.low == -band.y).all()
    assert np.isfinite(band.y).all()
    assert len(Line('', t[:9], t[:9], 'ink', 'dots').thinned().x) == 9


@pytest.mark.long
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
    panels = named(flight, 'position').panels
    assert [panel.label for panel in panels] == ['x [m]', 'y [m]', 'z up [m]']
    for axis, panel in enumerate(panels):
        t, p = curve(panel, 'ground truth')
        np.testing.assert_allclose(p, truth_position(t)[:, axis], atol=1e-6)


def test_the_error_is_the_length_of_the_difference(flight):
    panel, = named(flight, 'errors').panels
    t, error = curve(panel, 'estimation: estimate minus Optitrack')
    np.testing.assert_allclose(error[(t > 1.0) & (t < 8.98)], E_TOTAL, atol=2e-4)
    t, error = curve(panel, 'tracking: ground truth minus reference')
    length = np.linalg.norm([0.01, 0.02, 0.03])
    assert np.median(error[t < 7.5]) == pytest.approx(2.0 * length, rel=1e-3)
    assert np.median(error[t > 8.5]) == pytest.approx(length, rel=1e-3)


def test_the_path_is_seen_from_above_and_from_the_side(flight):
    plot, end = named(flight, 'path'), truth_position(8.9)
    assert [panel.label for panel in plot.panels] == ['y [m]', 'z up [m]']
    for panel, columns in zip(plot.panels, ([0, 1], [0, 2])):
        truth = np.stack(curve(panel, 'ground truth'), axis=1)
        assert np.linalg.norm(truth - end[columns], axis=1).min() < 0.01


def test_motors_are_laid_out_as_seen_from_above(tmp_path):
    pwm = np.array([100.0, 200.0, 300.0, 400.0])
    bag = bag_of(tmp_path / 'bag', {'motor_pwm': [{'pwm': pwm}, {'pwm': pwm},
                                                  {'pwm': np.full(4, np.nan)}]})
    plot = named(bag, 'motors')
    places = [(panel.title, np.nanmax(panel.lines[0].y)) for panel in plot.panels]
    assert plot.columns == 2 and places == [
        ('0 front left', 100.0), ('1 front right', 200.0), ('3 rear left', 400.0),
        ('2 rear right', 300.0)]
    assert {panel.limits for panel in plot.panels} == {(85.0, 415.0)}  # one scale, 5 % margin


@pytest.mark.parametrize('value', [np.inf, -np.inf, np.nan])
def test_motor_commands_that_are_not_finite_are_gaps(tmp_path, value):
    bag = bag_of(tmp_path / 'bag', {'motor_pwm': [{'pwm': np.full(4, value)}] * 3})
    panel = named(bag, 'motors').panels[0]
    assert panel.limits == (-1.0, 2.0) and np.isnan(panel.lines[0].y).all()


def test_a_height_by_pressure_rises_as_the_pressure_falls(tmp_path):
    """By 1.2 kg/m^3 * 9.81 m/s^2 = 11.772 Pa a metre, from the mean of the first half second."""
    pressures = [101325.0] * 101 + [101325.0 - 11.772] * 50
    ranges = [0.2, 1.5, 5.0] + [2.0] * 30
    bag = bag_of(tmp_path / 'bag', {
        'barometer/pressure': [{'fluid_pressure': p} for p in pressures],
        'sonar/range': [{'range': r, 'min_range': 0.3, 'max_range': 4.0} for r in ranges]})
    plot = named(bag, 'height')
    _, height = curve(plot.panels[0], 'barometer')
    np.testing.assert_allclose(height[[0, 50, -1]], [0.0, 0.0, 1.0], atol=1e-9)
    _, sonar = curve(plot.panels[0], 'sonar, slant')
    assert sonar[0] == 1.5 and len(sonar) == 31  # what is outside of the limits is left out
    assert plot.text == ('Height over time by sonar and barometer. 2 of 33 sonar samples are '
                         'outside of its limits and left out.')


def test_flow_forward_and_left_stand_in_this_order(tmp_path):
    bag = bag_of(tmp_path / 'bag', {'optical_flow': [{'rate_x': 1.0, 'rate_y': -2.0}] * 3})
    forward, left = named(bag, 'flow').panels
    assert (forward.label, left.label) == ('forward [rad/s]', 'left [rad/s]')
    assert forward.lines[0].y[0] == 1.0 and left.lines[0].y[0] == -2.0


def inner(innovation, ratio):
    nothing = float('nan')
    return {'status': 2, 'sonar_innovation': innovation, 'sonar_test_ratio': ratio,
            'flow_innovation': np.full(2, nothing), 'flow_test_ratio': nothing,
            'barometer_innovation': nothing, 'barometer_test_ratio': nothing}


def test_refused_samples_are_crosses_and_counted(tmp_path):
    states = [inner(0.1, 0.5), inner(0.2, 1.0), inner(-3.0, 1.01), inner(float('nan'), 2.0)]
    bag = bag_of(tmp_path / 'bag', {
        'estimator/state': states, 'motor_pwm': [{'pwm': np.ones(4)}]})
    plot = named(bag, 'innovations')
    panel, = plot.panels  # one for each sensor that was used
    np.testing.assert_allclose(curve(panel, 'innovation')[1], [0.1, 0.2])
    np.testing.assert_allclose(curve(panel, 'refused')[1], [-3.0])
    assert [line.kind for line in panel.lines] == ['dots', 'crosses']  # the gate is not known
    assert panel.title == '1 of 3 refused'
    assert plot.text.endswith('of sonar over time. Refused samples are crosses.')


STILL = {'motor_pwm': [{'pwm': np.ones(4)}]}  # tells the namespace


def gated(**gates):
    return '/mambo/estimator_node:\n  ros__parameters:\n    estimator: kalman\n    kalman:\n' + \
        ''.join(f'      {name}: {{gate: {gate}}}\n' for name, gate in gates.items())


def test_three_sigma_and_nis_follow_from_ratio_and_gate(tmp_path):
    """Ratio = innovation^2 / (gate^2 variance): with gate 5, sigma 0.02 m and 0.1 m/s."""
    states = [{**inner(0.04, 4.0 / 25.0), 'flow_innovation': np.array([0.3, -0.4]),
               'flow_test_ratio': 25.0 / 16.0}] * 3
    bag = bag_of(tmp_path / 'bag', {**STILL, 'estimator/state': states}, attachments={
        'scenario.yaml': gated(sonar=5.0, optical_flow=4.0)})
    sonar, _, _ = named(bag, 'innovations').panels
    np.testing.assert_allclose(curve(sonar, '3 standard deviations')[1], 0.06)
    np.testing.assert_allclose(sonar.lines[0].low, -0.06)
    nis = named(bag, 'nis')
    np.testing.assert_allclose(curve(nis.panels[0], 'NIS')[1], 4.0)
    np.testing.assert_allclose(curve(nis.panels[1], 'NIS')[1], 25.0)
    assert [panel.lines[0].y[0] for panel in nis.panels] == [3.841, 5.991]
    assert nis.panels[0].title == '0.0 % below, mean 4.00 of 1' and nis.log == 'y'
    sigma, = {round(float(row.sigma[0]), 9) for row in figures._innovations(bag)[1:]}
    assert sigma == pytest.approx(0.1)  # |(0.3, -0.4)| / 5


@pytest.mark.parametrize('gate', ['.nan', 'much', '[]', 'true'])
def test_a_gate_that_is_no_number_is_unknown(tmp_path, gate):
    bag = bag_of(tmp_path / 'bag', {**STILL, 'estimator/state': [inner(0.1, 0.5)]}, attachments={
        'scenario.yaml': gated(sonar=gate)})
    assert [plot.name for plot in figures.plots(bag)] == ['motors', 'innovations']


def test_the_95_percent_bounds_are_those_of_chi_square():
    for degrees, bound in figures.CHI_SQUARE.items():
        assert bound == pytest.approx(chi2.ppf(0.95, degrees), abs=1e-3)


def test_the_band_is_three_standard_deviations_of_the_filter(flight):
    for axis, panel in enumerate(named(flight, 'covariance').panels):
        band, error = panel.lines
        np.testing.assert_allclose(band.y, 3.0 * np.sqrt(VARIANCE[axis]))
        np.testing.assert_allclose(band.low, -3.0 * np.sqrt(VARIANCE[axis]))
        assert np.nanmedian(error.y) == pytest.approx(ESTIMATION[axis], abs=1e-5)


def test_the_spectra_have_the_tone_of_the_motors(tmp_path):
    t = np.arange(1200) * 0.005
    tone = np.sin(2.0 * np.pi * 25.0 * t)
    bag = bag_of(tmp_path / 'bag', {'motor_pwm': [
        {'pwm': np.array([200.0 + 10.0 * x, 200.0, 200.0, 200.0])} for x in tone]})
    lines = named(bag, 'motor-spectrum').panels[0].lines
    assert lines[0].name == '0 front left' and [line.name[0] for line in lines] == list('0123')
    assert lines[0].x[np.nanargmax(lines[0].y)] == pytest.approx(25.0, abs=0.4)


def test_a_bag_has_the_figures_that_it_has_data_for(flight, tmp_path):
    assert [plot.name for plot in figures.plots(flight)] == [
        'position', 'errors', 'path', 'motors', 'height', 'flow', 'innovations', 'covariance',
        'imu-spectrum', 'motor-spectrum']
    bag = bag_of(tmp_path / 'bag', {'motor_pwm': [{'pwm': np.ones(4)}] * 3})
    assert [plot.name for plot in figures.plots(bag)] == ['motors']
    without = read_bag(make_flight(tmp_path / 'blind', 6.0, (
        'ground_truth/odom', 'optitrack/pose', 'estimator/state', 'imu/data_raw')))
    assert [plot.name for plot in figures.plots(without)] == [
        'position', 'path', 'motors', 'height', 'flow', 'motor-spectrum']


def test_a_plot_of_a_named_bag_is_on_the_clock_of_the_page(flight):
    plot, moved = named(flight, 'position'), named(flight, 'position').of('B', 1.5)
    assert (moved.name, moved.title, moved.bag) == ('B-position', 'B: Position', 'B')
    np.testing.assert_allclose(moved.panels[0].lines[0].x, plot.panels[0].lines[0].x + 1.5)
    assert moved.shade == [(a + 1.5, b + 1.5) for a, b in plot.shade] and plot.shade
    spectrum = named(flight, 'motor-spectrum')
    np.testing.assert_array_equal(
        spectrum.of('B', 1.5).panels[0].lines[0].x, spectrum.panels[0].lines[0].x)


def test_captions_name_what_is_drawn(flight):
    text = {plot.name: plot.text for plot in figures.plots(flight)}
    assert 'reference, ground truth, Optitrack and estimate over time' in text['position']
    assert text['position'].endswith(figures.shaded(phases(flight)))
    assert text['innovations'].startswith(
        'Measurement minus prediction of sonar and optical flow over time')


def test_every_axis_has_its_unit_and_every_text_says_something(flight):
    for plot in figures.plots(flight):
        assert plot.across.endswith(']') and len(plot.text) > 30
        assert all(panel.label.endswith(']') for panel in plot.panels)


def test_a_signal_has_the_colour_of_its_role(flight):
    for panel in named(flight, 'position').panels:
        assert {line.name: line.role for line in panel.lines} == {
            label: role for _, role, label in figures.tracks(flight)}


def test_take_off_and_landing_are_shaded_where_they_are():
    parts = Phases(2_000_000_000, 7_000_000_000, '')
    assert figures.shade(parts, 500_000_000, 9_000_000_000) == [(0.5, 2.0), (7.0, 9.0)]
    assert figures.shade(Phases(None, None, ''), 0, 1) == []


@pytest.mark.long
def test_the_sheet_has_every_figure_with_its_curves(flight, tmp_path):
    sheet = figures.overview(flight, 'a flight')
    assert sheet.get_suptitle() == 'a flight'
    axes = [ax for ax in sheet.axes if ax.axison]
    assert len(axes) == sum(len(plot.panels) for plot in figures.plots(flight))
    position = next(ax for ax in axes if ax.get_ylabel() == 'x [m]')
    for line, (_, role, label) in zip(position.lines, figures.tracks(flight), strict=True):
        assert (line.get_label(), line.get_color()) == (label, COLOURS[role])
    legends = [[text.get_text() for text in ax.get_legend().get_texts()]
               for ax in sheet.axes if ax.get_legend()]
    assert ['reference', 'ground truth', 'Optitrack', 'estimate'] in legends
    assert position.get_xlim() == pytest.approx((0.0, 9.0), abs=0.01)
    above = next(ax for ax in axes if ax.get_title('right') == 'from above')
    assert above.get_aspect() == 1.0
    figures.write_overview(flight, tmp_path / 'flight.png', 'a flight')
    image = imread(tmp_path / 'flight.png')
    assert image.shape[1] > 1000 and image[..., :3].std() > 0.05


def test_an_empty_flight_has_a_sheet(tmp_path):
    bag = bag_of(tmp_path / 'bag', {'sensor_tick': [{}] * 3})
    assert figures.plots(bag) == [] and not figures.overview(bag, '$x').axes
