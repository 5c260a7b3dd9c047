"""The Crazyflie's drag is the one that seven of its flights under motion capture show."""

from pathlib import Path

from mambo_model.vehicle import parameters
import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

FLIGHTS = Path(__file__).parents[5] / 'shared/data/nanobench'
G = 9.81
MEAN = 31  # samples of 10 ms


def slopes(path):
    """Return d acceleration / d velocity along body x and y, (2,) 1/s, of a flight in the air."""
    log = np.genfromtxt(path, delimiter=',', names=True)
    quaternion = np.stack([log[f'q{axis}'] for axis in 'xyzw'], axis=1)
    velocity = np.stack([log[f'v{axis}'] for axis in 'xyz'], axis=1)
    nu = uniform_filter1d(Rotation.from_quat(quaternion).inv().apply(velocity), MEAN, axis=0)
    force = uniform_filter1d(
        np.stack([log[f'imu_acc_{axis}'] for axis in 'xy'], axis=1) * G, MEAN, axis=0)
    air = log['pz'] > 0.5
    return [np.polyfit(nu[air, k], force[air, k], 1)[0] for k in range(2)]


@pytest.mark.skipif(not FLIGHTS.is_dir(), reason='nanobench is not beside the checkout')
def test_the_drag_in_the_vehicle_file_is_that_of_the_flights():
    found = -np.mean([slopes(path) for path in sorted(FLIGHTS.glob('*.csv'))], axis=0)
    v = parameters.preset('crazyflie').values()
    # In hover all rotors together lift the weight: (3.13) brakes by k_c g / 4 per velocity.
    believed = v.drag_coefficient * v.gravity / 4.0
    # 85 of 93 flights lie within 20 % of their mean; the mean of seven is nearer.
    np.testing.assert_allclose(found, believed, rtol=0.1)
