"""A vehicle that lies on the floor while its reference flies has not flown to the end."""

from mambo_model.motion.fallen import ABOVE, fallen
from mambo_model.motion.trajectory import GROUND, LANDED, LANDING, TAKEOFF, TRACK
import numpy as np
import pytest

T = np.arange(6.0)
FLIGHT = (GROUND, TAKEOFF, TRACK, TRACK, TRACK, TRACK)
UP = (0.0, 0.5, 1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize(('height', 'wanted', 'phase', 'said'), [
    (UP, UP, FLIGHT, ''),
    ((0.0,) * 6, UP, FLIGHT,
     'the vehicle never took off: on the floor at 5.00 s, 1.00 m below its reference'),
    ((0.0, 0.5, 1.0, 0.4, 0.009, -0.001), UP, FLIGHT,
     'the vehicle came down at 4.00 s: on the floor at 5.00 s, 1.00 m below its reference'),
    ((0.0, 0.5, 0.0, 0.5, 1.0, 1.0), UP, FLIGHT, ''),  # it has touched the floor and flies again
    ((0.0, 0.5, 1.0, 0.0, 0.0, 0.0), (0.0, 0.5, 1.0, 1.0, 0.5, 0.0),
     (GROUND, TAKEOFF, TRACK, TRACK, LANDING, LANDED),
     'the vehicle came down at 3.00 s: on the floor at 3.00 s, 1.00 m below its reference'),
    ((0.0, 0.5, 1.0, 0.5, 0.0, 0.0), (0.0, 0.5, 1.0, 0.5, 0.0, 0.0),
     (GROUND, TAKEOFF, TRACK, LANDING, LANDED, LANDED), ''),
    ((0.0,) * 6, (ABOVE,) * 6, FLIGHT, ''),  # too low to tell
    ((0.0,) * 6, (0.0,) * 6, (GROUND,) * 6, ''),  # nobody asked it to fly
    ((0.0, 0.5, 1.0, 1.0, 1.0, np.nan), UP, FLIGHT, '')])
def test_who_lies_below_a_flying_reference_is_named(height, wanted, phase, said):
    assert fallen(T, *map(np.array, (height, wanted, phase))) == said
