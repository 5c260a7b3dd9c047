"""The command estimate with --smooth."""

from mambo_analysis.compare import estimate
from mambo_bags.reader import read_bag
from mambo_flight import closed_loop, recording_to_bag
from mambo_flight.scenario import scenario
from mambo_flight.smooth import recorded
import numpy as np
import pytest


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a short flight, flown on the truth: any bag with sensors can be smoothed."""
    path = tmp_path_factory.mktemp('smoothed') / 'bag'
    flight = scenario(estimator='joint', duration=6.0, land=False)
    recording_to_bag.write(path, flight, closed_loop.fly(flight, inner=True))
    return path


def test_it_prints_intervals_and_writes_the_path(bag, tmp_path, capsys):
    out = tmp_path / 'out'
    assert estimate.main([str(bag), '--smooth', '-o', str(out)]) == 0
    text = capsys.readouterr().out
    assert '95 % interval' in text and 'slope dQ/dh [1/m]' in text
    assert 'horizontal path error [m]' in text
    made, source = read_bag(out), read_bag(bag)
    path, true = made[recorded.TOPIC], source['ground_truth/odom']
    np.testing.assert_array_equal(path.stamp, true.stamp)
    assert np.abs(path.position - true.position)[-1].max() < 0.05
    assert len(made['estimate/odom'].stamp) == len(true.stamp)


def test_a_vehicle_that_never_moves_is_refused_in_one_line(tmp_path, capsys):
    flight = scenario(estimator='joint', duration=0.5, land=False)
    recording_to_bag.write(tmp_path / 'bag', flight, closed_loop.fly(flight, inner=True))
    assert estimate.main([str(tmp_path / 'bag'), '--smooth']) == 2
    assert capsys.readouterr().err.endswith('the vehicle never moves, nothing to smooth\n')
