"""The plots of a sweep are drawn whatever came of its flights."""

from mambo_flight.sweep import plot
import numpy as np


def test_flights_without_numbers_are_drawn_without_a_warning(tmp_path, recwarn):
    data = {name: [np.nan] * 3 for name in plot.METRICS}
    data |= {'vehicle': ['a', 'b', 'a'], 'vehicle.mass': [0.06, 0.07, 0.08]}
    plot.draw(tmp_path / 'sweep.png', data, ['vehicle', 'vehicle.mass'], 'None of them flew')
    assert (tmp_path / 'sweep.png').stat().st_size > 1000 and not recwarn.list
