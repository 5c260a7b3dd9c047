"""The command estimate with --smooth."""

from mambo_analysis.compare import estimate
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_flight import closed_loop, offline_replay, recording_to_bag
from mambo_flight.scenario import scenario
from mambo_flight.smooth import recorded
from mambo_ros import messages, topics
import numpy as np
import pytest

pytestmark = pytest.mark.long


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


def test_a_flight_that_diverges_gets_no_intervals_and_no_path(bag, tmp_path, capsys):
    source, spoilt, out = read_bag(bag), tmp_path / 'spoilt', tmp_path / 'out'
    with BagWriter(spoilt, source.attachments) as writer:
        sensors = [source.messages(topic.name) for topic in (
            *offline_replay.SENSORS, topics.SENSOR_TICK)]
        for one in sensors:
            writer.add_topic(one.topic, one.type_name)
        for stamp, topic, data in sorted(
                (stamp, one.topic, bytes(data)) for one in sensors
                for stamp, data in zip(one.stamp.tolist(), one.raw)):
            if topic.endswith(topics.IMU.name) and stamp > 3e9:  # the gyro fails: 1 rad/s more
                _, (p, q, r), force = messages.decode_imu(data)
                data = messages.imu(stamp, (p + 1.0, q, r), force, (1e-4,) * 3, (1e-2,) * 3)
            writer.write(topic, data, stamp)
    assert estimate.main([str(spoilt), '--smooth', '-o', str(out)]) == 0
    text = capsys.readouterr().out
    assert 'velocity diverged' in text and '95 % interval' not in text
    (line,) = [one for one in text.splitlines() if one.startswith('smoothed: ')]
    assert line.startswith('smoothed: withheld, as the joint filter that it smooths failed: ')
    assert recorded.TOPIC not in read_bag(out) and 'estimate/odom' in read_bag(out)


def test_a_vehicle_that_never_moves_is_refused_in_one_line(tmp_path, capsys):
    flight = scenario(estimator='joint', duration=0.5, land=False)
    recording_to_bag.write(tmp_path / 'bag', flight, closed_loop.fly(flight, inner=True))
    assert estimate.main([str(tmp_path / 'bag'), '--smooth']) == 2
    assert capsys.readouterr().err.endswith('the vehicle never moves, nothing to smooth\n')
