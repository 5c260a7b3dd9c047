"""The picture of the separation draws the nearest pairs, and no more than there are colours."""

from mambo_flight.world.plot_separation import draw
from mambo_flight.world.separation import Pair
from mambo_model import palette
import numpy as np
import pytest


@pytest.mark.parametrize('count', [1, 40])
def test_any_number_of_pairs_is_drawn(tmp_path, count):
    t = np.arange(3) * 1_000_000_000
    found = [Pair((f'/a{k}', '/$b'), t, np.full(3, 1.0 + k)) for k in range(count)]
    draw(tmp_path / 'picture.svg', found, 0.18)
    text = (tmp_path / 'picture.svg').read_text()
    assert palette.COLOURS['bad'] in text
    drawn = [palette.COLOURS[role] in text for role in palette.SERIES]
    assert drawn == [number < count for number in range(len(drawn))]
