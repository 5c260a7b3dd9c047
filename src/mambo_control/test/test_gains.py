"""What follows from the gains of the cascaded controller."""

import math

from mambo_control.gains import CascadedParams
from mambo_model.schema import ParameterError
import pytest


def test_the_gains_about_the_axes_are_a_vector_of_numbers():
    values = CascadedParams(k1=1, k2=2.5, k3=3).values()
    assert values.k == (1.0, 2.5, 3.0) and type(values.k[0]) is float


@pytest.mark.parametrize('degrees', [0.0, 30.0, 60.0, 180.0])
def test_the_tilt_limit_is_compared_by_the_vector_part_of_a_quaternion(degrees):
    limit = math.radians(degrees)
    found = CascadedParams(tilt_limit=limit).values().tilt_sine_squared
    assert found == pytest.approx(0.5 * (1.0 - math.cos(limit)))


@pytest.mark.parametrize(('name', 'value'), [
    ('k_p', 0.0), ('K_P', -0.1), ('tilt_limit', 4.0), ('height_min', 1.0), ('height_max', 0.0),
    ('derivatives', 'exact'), ('k_R', math.nan)])
def test_a_gain_out_of_its_range_is_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=rf'^{name} = '):
        CascadedParams(**{name: value})
