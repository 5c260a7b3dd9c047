"""Whether a drone and a motion capture on its clock are of one flight."""

import dataclasses
from types import SimpleNamespace

from mambo_analysis.importers.checks import same_flight
from mambo_signals.motion import Motion
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

STEP = 0.01


def flown(seed, name='optitrack/pose'):
    """Return a random flight of 20 s as a motion capture shows it, and its gyro, rad/s."""
    rng = np.random.default_rng(seed)
    n = round(20.0 / STEP)

    def smooth(sizes, width):
        x = gaussian_filter1d(rng.standard_normal((n, len(sizes))), width / STEP, axis=0)
        return x / x.std(axis=0) * sizes
    turn = Rotation.from_euler('ZYX', smooth((0.2, 0.05, 0.05), 0.3))
    gyro = (turn[:-1].inv() * turn[1:]).as_rotvec() / STEP
    stamps = (np.arange(n) * round(STEP * 1e9)).astype(np.int64)
    return Motion(name, stamps, smooth((0.5, 0.5, 0.3), 0.5), turn.as_quat()), (
        (np.arange(n - 1) + 0.5) * STEP, gyro)


def heights(one):
    return one.t[::4], one.position[::4, 2] + 1.0


def test_one_flight_is_not_contradicted():
    seen, gyro = flown(1)
    own = seen.moved(0, 1.0, np.array([3.0, 2.0, 1.0]))
    assert same_flight.check(seen, gyro, heights(seen), [own]) == same_flight.Verdict()
    assert same_flight.check(seen, None, None) == same_flight.Verdict()


def test_another_turning_refutes_a_capture():
    seen, _ = flown(1)
    found = same_flight.check(seen, flown(2)[1], heights(seen))
    assert found.refuted.startswith('gyro and tracked attitude do not turn alike (correlation of')
    assert found.lines == [found.refuted]


def test_a_range_refutes_a_capture_unless_the_gyro_turns_alike():
    seen, gyro = flown(1)
    other = flown(2)[0]
    alone = same_flight.check(seen, None, heights(other))
    assert alone.refuted.startswith('the range does not follow the height of optitrack/pose')
    beside = same_flight.check(seen, gyro, heights(other))
    assert not beside.refuted
    assert beside.lines == [f'{alone.refuted}, though the gyro turns alike']


def test_an_own_estimate_is_a_doubt():
    seen, gyro = flown(1)
    found = same_flight.check(seen, gyro, heights(seen), [flown(2, 'onboard/odom')[0]])
    assert not found.refuted and len(found.doubts) == 2
    assert found.doubts[0].startswith('the height of onboard/odom does not follow the height of')
    assert found.doubts[1].startswith('the path of onboard/odom is not that of optitrack/pose')


@pytest.mark.parametrize('until', [20.0, 15.0])
def test_a_vehicle_that_is_carried_away_is_not_held_against_the_capture(until):
    seen, (t, gyro) = flown(1)
    other = flown(2)[1][1]
    bag = {'imu/data_raw': SimpleNamespace(t=t, angular_velocity=np.where(
        t[:, None] < 5.0, gyro, other))}
    assert same_flight.of_bag(bag, seen).refuted
    times = np.arange(0.0, until, 0.1)
    bag['motor_pwm'] = SimpleNamespace(t=times, pwm=np.where(
        times[:, None] < 5.0, 100.0, np.zeros(4)))
    assert same_flight.of_bag(bag, seen) == same_flight.Verdict()
    assert same_flight.motors_run(bag) == (0.0, pytest.approx(4.9))
    low = dataclasses.replace(seen, position=0.0 * seen.position)
    assert same_flight.of_bag(bag, low) == same_flight.Verdict()
