"""Every number that a bag holds, at common instants."""

from mambo_bags.reader import read_bag
from mambo_signals.every_signal import signals
import numpy as np
import pytest
from synthetic import make_flight, truth_position


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return read_bag(make_flight(tmp_path_factory.mktemp('bags') / 'flight', 6.0, diagnostics=[
        ('node', 2, 1.0, 'a text')]))


@pytest.mark.long
def test_signals_are_interpolated_at_the_instants(bag):
    instants = np.arange(1001, 5000, 7) * 1_000_000
    found = dict(signals(bag, instants, 500))
    np.testing.assert_allclose(found['ground_truth/odom pose.pose.position.z'],
                               truth_position(instants * 1e-9)[:, 2], atol=1e-4)
    np.testing.assert_allclose(found['motor_pwm pwm[3]'],
                               247.0 + 20.0 * np.sin(instants * 1e-9 + 3), atol=1e-2)


def test_what_never_changes_and_what_is_no_signal_is_left_out(bag):
    names = [name for name, _ in signals(bag, np.arange(5) * 10**9, 500)]
    assert len(names) == len(set(names)) and names[0].startswith('ground_truth/odom')
    for word in ('covariance', 'header', 'frame_id', 'quality', 'diagnostics'):
        assert not any(word in name for name in names)


def test_outside_of_a_topic_there_is_no_value(bag):
    for _, values in signals(bag, np.array([-10**9, 10**11]), 500):
        assert np.isnan(values).all()


def test_there_are_at_most_as_many_as_wanted(bag):
    assert len(signals(bag, np.arange(5) * 10**9, 7)) == 7
