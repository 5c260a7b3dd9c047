"""The heat map of a sweep: which cell has which flights, and what is drawn."""

from mambo_flight.sweep import heat_map, plot
import numpy as np
import pytest

NAMES = ['controller_node.gain', 'mass', 'seed']


def crossed(gains=(1.0, 2.0, 4.0), masses=(0.06, 0.07), seeds=(1, 2, 3)):
    rows = [(g, m, s) for g in gains for m in masses for s in seeds]
    data = dict(zip(NAMES, map(list, zip(*rows, strict=True)), strict=True))
    error = [g * m + 0.001 * s for g, m, s in rows]
    return data | dict.fromkeys(plot.METRICS, error)


def test_flights_are_in_the_cell_of_their_two_numbers():
    found = heat_map.grid(crossed(), NAMES)
    assert found.names == ('controller_node.gain', 'mass')
    assert found.values == ([1.0, 2.0, 4.0], [0.06, 0.07])
    assert found.cells[0, 0] == [0, 1, 2] and found.cells[2, 1] == [15, 16, 17]
    assert len(found.cells) == 6


@pytest.mark.parametrize('data', [
    crossed(masses=(0.06,)), crossed(gains=tuple(range(61))),
    {**crossed(), 'mass': list(np.linspace(0.05, 0.07, 18)),
     'controller_node.gain': list(np.linspace(1.0, 2.0, 18))},
    {**crossed(), 'mass': ['a', 'b', 'c'] * 6}], ids=['one', 'many', 'drawn', 'words'])
def test_what_is_no_grid_of_two_numbers_has_no_map(data, tmp_path):
    assert heat_map.grid(data, NAMES) is None
    old = tmp_path / 'map.png'
    old.write_bytes(b'of an earlier result')
    heat_map.draw(old, data, NAMES, 'none')
    assert not old.exists()


def test_three_numbers_that_vary_have_no_map():
    assert heat_map.grid(crossed() | {'wind': list(range(18))}, [*NAMES, 'wind']) is None


def test_the_typical_flight_is_at_or_just_below_the_median_of_the_finite_values():
    values = np.array([3.0, np.nan, 1.0, 2.0, 4.0, np.inf])
    assert heat_map.typical(values, range(6)) == (2.5, 3)
    assert heat_map.typical(values, [0, 1, 2, 4]) == (3.0, 0)
    assert heat_map.typical(values, [0, 2]) == (2.0, 2)
    value, number = heat_map.typical(values, [1, 5])
    assert np.isnan(value) and number == 1


def test_each_cell_has_its_median_and_the_number_of_its_flight(tmp_path, figures_of):
    figures = figures_of(heat_map)
    heat_map.draw(tmp_path / 'map.png', crossed(), NAMES, 'Gain and mass', {'mass': 'kg'})
    axes = [one for one in figures[0].axes if one.images]
    assert len(axes) == len(plot.METRICS)
    shown = np.asarray(axes[0].images[0].get_array())
    np.testing.assert_allclose(shown, np.outer((0.06, 0.07), (1.0, 2.0, 4.0)) + 0.002)
    texts = {tuple(map(int, text.get_position())): text.get_text() for text in axes[0].texts}
    assert texts == {(c, r): str(6 * c + 3 * r + 1) for c in range(3) for r in range(2)}
    assert axes[0].get_xlabel() == 'controller_node.gain' and axes[0].get_ylabel() == 'mass [kg]'
    assert (tmp_path / 'map.png').stat().st_size > 10_000


def test_many_cells_carry_no_numbers(tmp_path, figures_of):
    figures = figures_of(heat_map)
    heat_map.draw(tmp_path / 'map.png', crossed(tuple(np.arange(30.0)), seeds=(1,)), NAMES, 'Many')
    assert not any(axes.texts for axes in figures[0].axes)


def test_flights_without_numbers_are_drawn_without_a_warning(tmp_path, recwarn):
    data = crossed() | {name: [np.nan] * 18 for name in plot.METRICS}
    heat_map.draw(tmp_path / 'map.png', data, NAMES, 'None of them flew')
    assert not (tmp_path / 'map.png').exists() and not recwarn.list
    one = crossed()
    one['tracking_rms'] = [0.1, *[np.nan] * 17]
    heat_map.draw(tmp_path / 'map.png', one, NAMES, 'One of them flew')
    assert (tmp_path / 'map.png').exists() and not recwarn.list


def test_a_map_says_of_how_many_flights_it_is(tmp_path, figures_of):
    figures, data = figures_of(heat_map), crossed()
    data['tracking_rms'] = [np.nan] * 5 + data['tracking_rms'][5:]
    heat_map.draw(tmp_path / 'map.png', data, NAMES, 'Some never took off')
    labels = [axes.get_ylabel() for axes in figures[0].axes[4:]]  # of the colour bars
    first, *others = plot.METRICS.values()
    assert labels == [f'{first}\n13 of 18 flights have a value', *others]


@pytest.mark.parametrize('value', [np.inf, np.nan])
def test_an_error_without_a_finite_value_has_no_map_of_its_own(value, tmp_path):
    data, (first, *_) = crossed(), plot.METRICS
    data[first] = [value] * len(data['seed'])
    assert first not in plot.measured(data) and len(plot.measured(data)) == len(plot.METRICS) - 1
    heat_map.draw(tmp_path / 'map.png', data, NAMES, 'with $one & without')
    assert (tmp_path / 'map.png').stat().st_size > 1000
