"""Parameters of the simulator's nodes: defaults fly, what is out of range is named."""

from mambo_model.schema import flatten, ParameterError
from mambo_sim.parameters import OptitrackNodeParams, SimNodeParams
import pytest


def test_the_watchdog_can_be_turned_off_and_time_has_no_end():
    found = SimNodeParams(motor_timeout=0.0, duration=0.0)
    assert (found.motor_timeout, found.duration) == (0.0, 0.0)


@pytest.mark.parametrize(('kind', 'name', 'value'), [
    (SimNodeParams, 'duration', -1.0), (SimNodeParams, 'patience', 0.0),
    (SimNodeParams, 'motor_timeout', -0.1), (SimNodeParams, 'mode', 'warp'),
    (OptitrackNodeParams, 'seed', -1), (OptitrackNodeParams, 'seed', 2**31)])
def test_a_value_out_of_its_range_is_refused_by_name(kind, name, value):
    with pytest.raises(ParameterError, match=rf'^{name} = '):
        kind(**{name: value})


def test_every_parameter_of_a_sensor_has_its_place_in_the_node():
    names = flatten(SimNodeParams())
    assert {'simulator.imu.gyro_noise', 'simulator.sonar.noise', 'simulator.vehicle.mass',
            'simulator.optical_flow.factor_slope', 'simulator.seed'} <= set(names)
