"""The plots of a sweep are drawn whatever came of its flights."""

from hypothesis import given, strategies as st
from mambo_flight.sweep import plot
import numpy as np
import pytest


def test_flights_without_numbers_are_drawn_without_a_warning(tmp_path, recwarn):
    data = {name: [np.nan] * 3 for name in plot.METRICS}
    data |= {'vehicle': ['a', 'b', 'a'], 'vehicle.mass': [0.06, 0.07, 0.08]}
    plot.draw(tmp_path / 'sweep.png', data, ['vehicle', 'vehicle.mass'], 'None of them flew')
    assert (tmp_path / 'sweep.png').stat().st_size > 1000 and not recwarn.list


def test_percentiles_are_those_of_the_finite_values_in_the_middle_of_each():
    percent, values = plot.percentiles(np.array([3.0, np.nan, 1.0, np.inf, 2.0, 4.0]))
    np.testing.assert_allclose(percent, [12.5, 37.5, 62.5, 87.5])
    np.testing.assert_array_equal(values, [1.0, 2.0, 3.0, 4.0])
    assert len(plot.percentiles(np.array([np.nan]))[0]) == 0


def test_few_values_are_groups_and_one_or_many_are_not():
    found = plot.groups(['b', 'a', 'b'])
    assert [(value, rows.tolist()) for value, rows in found] == [
        ('a', [False, True, False]), ('b', [True, False, True])]
    for column in (['a', 'a'], list(range(7))):
        (value, rows), = plot.groups(column)
        assert value == '' and rows.all()
    assert len(plot.groups([True, 1.5, 'x'])) == 3  # of several types


def test_bins_hold_alike_many_flights_in_the_order_of_the_parameter():
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 1.0, 1200)
    found = plot.bins(x, 2.0 * x)
    assert [len(values) for _, values in found] == [100] * plot.MOST_BINS
    middles = [middle for middle, _ in found]
    assert middles == sorted(middles)
    for middle, values in found:
        assert np.median(values) == pytest.approx(2.0 * middle, abs=1e-9)
    few = plot.bins(np.array([1.0, 2.0, 1.0]), np.array([5.0, 6.0, 7.0]))
    assert [(middle, values.tolist()) for middle, values in few] == [
        (1.0, [5.0, 7.0]), (2.0, [6.0])]


@pytest.fixture
def figure(figures_of):
    """Return the figures made."""
    return figures_of(plot)


def swept(n=60):
    mass = np.linspace(0.06, 0.08, n)
    data = {name: list(mass * k) for k, name in enumerate(plot.METRICS, 1)}
    return data | {'vehicle': ['a', 'b'] * (n // 2), 'sim_node.simulator.vehicle.mass': list(mass),
                   'seed': list(range(n))}


def test_every_metric_is_a_column_and_every_number_that_varies_a_row(tmp_path, figure):
    plot.draw(tmp_path / 'a.png', swept(), ['vehicle', 'sim_node.simulator.vehicle.mass', 'seed'],
              'Two vehicles')
    assert figure[0].get_suptitle() == 'Two vehicles'
    assert len(figure[0].axes) == 2 * len(plot.METRICS)  # percentiles, and one over the mass
    labels = [axes.get_ylabel() for axes in figure[0].axes]
    assert labels == [*plot.METRICS.values()] * 2
    assert {axes.get_xlabel() for axes in figure[0].axes[4:]} == {'simulator.vehicle.mass'}
    assert all(axes.get_ylim()[0] == 0.0 for axes in figure[0].axes[::4])


def test_vehicles_are_curves_of_the_percentiles(tmp_path, figure):
    data = swept()
    plot.draw(tmp_path / 'a.png', data, ['vehicle'], '')
    first = figure[0].axes[0]
    assert [line.get_label() for line in first.lines] == ['a', 'b']
    np.testing.assert_allclose(first.lines[1].get_ydata(), data['tracking_rms'][1::2])
    assert first.get_legend().get_title().get_text() == 'vehicle'


def test_a_picture_without_a_value_says_so(tmp_path, figure):
    data = swept() | {name: [np.nan] * 60 for name in plot.METRICS}
    plot.draw(tmp_path / 'a.png', data, ['vehicle'], 'None of them flew')
    assert figure[0].get_suptitle() == 'None of them flew: none of 60 flights has a value'


def test_percentiles_say_of_how_many_flights_they_are(tmp_path, figure):
    data = swept()
    data['tracking_rms'][::4] = [np.nan] * 15  # all of vehicle a
    plot.draw(tmp_path / 'a.png', data, ['vehicle'], '')
    partly, whole = figure[0].axes[:2]
    assert partly.get_xlabel() == 'percentile\n45 of 60 flights have a value'
    assert [line.get_label() for line in partly.lines] == ['a (15 of 30)', 'b']
    assert whole.get_xlabel() == 'percentile'
    assert [line.get_label() for line in whole.lines] == ['a', 'b']


def test_the_axis_of_a_parameter_spans_what_was_flown_and_marks_flights_without_a_value(
        tmp_path, figure):
    data, name = swept(), 'sim_node.simulator.vehicle.mass'
    mass = data[name]
    data['tracking_rms'][40:] = [np.nan] * 20
    plot.draw(tmp_path / 'a.png', data, [name], '', {name: 'kg'})
    partly, whole = figure[0].axes[4:6]
    for axes in (partly, whole):
        low, high = axes.get_xlim()
        assert low < 0.06 < 0.08 < high and high - low < 1.1 * 0.02
    marks = partly.lines[-1]
    assert marks.get_marker() == '|' and marks.get_xdata().tolist() == mass[40:]
    assert partly.get_xlabel() == (
        'simulator.vehicle.mass [kg]\n| 20 of 60 flights have no value')
    assert whole.get_xlabel() == 'simulator.vehicle.mass [kg]'
    assert all(line.get_marker() != '|' for line in whole.lines)


def test_a_metric_that_is_nothing_has_no_column(tmp_path, figure):
    data = swept() | {'estimation_rms': [0.0] * 60, 'estimation_final': [np.nan] * 60}
    plot.draw(tmp_path / 'a.png', data, ['vehicle'], '')
    assert [axes.get_ylabel() for axes in figure[0].axes] == [
        plot.METRICS['tracking_rms'], plot.METRICS['tracking_max']]


def test_a_band_is_of_percentiles_about_the_median(tmp_path, figure):
    data = swept(60)
    data['vehicle.load'] = [0.0] * 30 + [1.0] * 30
    data['tracking_rms'] = [*np.linspace(0.0, 1.0, 30), *np.linspace(2.0, 3.0, 30)]
    plot.draw(tmp_path / 'a.png', data, ['vehicle.load'], '')
    band = figure[0].axes[4]
    np.testing.assert_allclose(band.lines[0].get_xydata(), [[0.0, 0.5], [1.0, 2.5]])
    outer = band.collections[0].get_paths()[0].vertices[:, 1]
    assert (outer.min(), outer.max()) == pytest.approx((0.05, 2.95))


def test_few_flights_are_single_dots_with_a_median_only_where_values_repeat(tmp_path, figure):
    def drawn(x):
        data = {name: list(np.linspace(1.0, 2.0, len(x))) for name in plot.METRICS} | {'wind': x}
        plot.draw(tmp_path / 'a.png', data, ['wind'], '', {'wind': 'm/s'})
        axes = figure[-1].axes[4]
        assert axes.get_xlabel() == 'wind [m/s]'
        legend = [text.get_text() for text in axes.get_legend().get_texts()]
        return legend, [line.get_xydata().tolist() for line in axes.lines]

    assert drawn([1.0, 3.0, 2.0]) == (
        ['one flight each'], [[[1.0, 1.0], [3.0, 1.5], [2.0, 2.0]]])
    assert drawn([1.0, 1.0, 2.0]) == (['one flight each', 'median'], [
        [[1.0, 1.0], [1.0, 1.5], [2.0, 2.0]], [[1.0, 1.25], [2.0, 2.0]]])
    assert drawn(list(np.linspace(0.0, 1.0, 59)))[0] == ['one flight each']  # 4 in a bin
    assert drawn(list(np.linspace(0.0, 1.0, 60)))[0] == ['5 to 95 %', '25 to 75 %', 'median']


@given(values=st.lists(st.one_of(st.floats(-1e3, 1e3), st.just(np.nan)), max_size=40))
def test_percentiles_rise_and_hold_every_finite_value(values):
    percent, found = plot.percentiles(np.array(values))
    assert sorted(x for x in values if np.isfinite(x)) == found.tolist()
    assert (np.diff(percent) > 0.0).all() and ((percent > 0.0) & (percent < 100.0)).all()
    np.testing.assert_allclose(percent + percent[::-1], 100.0)


@given(x=st.lists(st.floats(0.0, 10.0), min_size=1, max_size=80))
def test_every_flight_is_in_one_bin(x):
    x = np.array(x)
    found = plot.bins(x, np.arange(len(x)))
    assert sorted(np.concatenate([rows for _, rows in found]).tolist()) == list(range(len(x)))
    assert len(found) <= plot.MOST_BINS
    middles = [middle for middle, _ in found]
    assert middles == sorted(middles) and x.min() <= middles[0] <= middles[-1] <= x.max()


@given(column=st.lists(st.one_of(st.integers(0, 9), st.sampled_from(['a', 'b'])), min_size=1))
def test_every_flight_is_in_one_group(column):
    found = plot.groups(column)
    np.testing.assert_array_equal(np.sum([rows for _, rows in found], axis=0), 1)
    assert len(found) <= plot.MOST_GROUPS
