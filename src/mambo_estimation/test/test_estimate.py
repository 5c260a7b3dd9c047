"""Each field of a user's estimate is checked, in compiled code and in Python alike."""

import math

from mambo_estimation import estimate, filters
from mambo_estimation.estimate import of_state
from mambo_model.motion.rigid_body import State
from mambo_model.script import python
from mambo_model.slots import UnusableError
import pytest

ZERO = (0.0, 0.0, 0.0)
GOOD = of_state(State(ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO), 2, ZERO, ZERO)


def covariance(k, x):
    """Return a covariance of which one of the 36 numbers is given."""
    return (0.0,) * k + (x,) + (0.0,) * (35 - k)


WRONG = {
    'position': GOOD._replace(state=GOOD.state._replace(rho=(0.0, math.inf, 0.0))),
    'velocity': GOOD._replace(state=GOOD.state._replace(nu=(math.nan, 0.0, 0.0))),
    'attitude': GOOD._replace(state=GOOD.state._replace(q=(1.0, 0.5, 0.0, 0.0))),
    'body rate': GOOD._replace(state=GOOD.state._replace(omega=(0.0, 0.0, -math.inf))),
    'height': GOOD._replace(height=math.nan),
    'vertical_velocity': GOOD._replace(vertical_velocity=math.inf),
    'gyro_bias': GOOD._replace(gyro_bias=(0.0, math.nan, 0.0)),
    'accel_bias': GOOD._replace(accel_bias=(0.0, 0.0, math.inf)),
    'pose_covariance[3]': GOOD._replace(pose_covariance=covariance(3, math.nan)),
    'pose_covariance[21]': GOOD._replace(pose_covariance=covariance(21, -1e-9)),
    'twist_covariance[35]': GOOD._replace(twist_covariance=covariance(35, -1.0)),
    'twist_covariance[0]': GOOD._replace(twist_covariance=covariance(0, math.inf)),
    'barometer_offset': GOOD._replace(barometer_offset=math.inf),
    'sonar_innovation': GOOD._replace(sonar_innovation=-math.inf),
    'flow_innovation': GOOD._replace(flow_innovation=(0.0, math.inf)),
    'barometer_innovation': GOOD._replace(barometer_innovation=math.inf),
    'sonar_test_ratio': GOOD._replace(sonar_test_ratio=-7.0),
    'flow_test_ratio': GOOD._replace(flow_test_ratio=-1e-3),
    'barometer_test_ratio': GOOD._replace(barometer_test_ratio=-1.0),
    'status': GOOD._replace(status=3),
    'health.health': GOOD._replace(health=GOOD.health._replace(health=(0, 0, 6, 0, 0))),
    'health.age': GOOD._replace(health=GOOD.health._replace(age=(0.0, math.nan, 0.0, 0.0, 0.0))),
    'health.not_finite': GOOD._replace(health=GOOD.health._replace(not_finite=(0, 0, 0, 0, -1))),
    'sonar_refused': GOOD._replace(sonar_refused=-5),
    'flow_refused': GOOD._replace(flow_refused=10**12),
    'barometer_refused': GOOD._replace(barometer_refused=-1),
    'invalid_samples': GOOD._replace(invalid_samples=2**32)}
HARMLESS = {
    'no sample': GOOD._replace(sonar_innovation=math.nan, flow_test_ratio=math.nan),
    'negative covariance beside the diagonal': GOOD._replace(
        pose_covariance=covariance(1, -0.1)),
    'infinite test ratio': GOOD._replace(sonar_test_ratio=math.inf),
    'largest counts': GOOD._replace(sonar_refused=2**32 - 1, status=0)}


@pytest.mark.parametrize('name', WRONG)
def test_a_field_that_cannot_be_used_is_named(name):
    assert estimate.complaint(WRONG[name]).startswith(f'{name} = ')
    with pytest.raises(UnusableError, match='^step answers '):
        filters.read(WRONG[name])


@pytest.mark.parametrize('name', HARMLESS)
def test_what_is_harmless_is_not(name):
    assert not estimate.complaint(HARMLESS[name])
    assert str(filters.read(HARMLESS[name])) == str(HARMLESS[name])  # NaN is not equal to itself


def test_compiled_code_refuses_the_same():
    for is_sound in (estimate.is_sound, python(estimate.is_sound)):
        assert is_sound(GOOD)
        for name, one in WRONG.items():
            assert not is_sound(one), name
        for name, one in HARMLESS.items():
            assert is_sound(one), name


@pytest.mark.parametrize('field', GOOD._fields)
def test_every_field_is_checked(field):
    """One that comes in addition needs a line here and in the module."""
    assert field in {'state'} or any(name.startswith(field) for name in WRONG)
