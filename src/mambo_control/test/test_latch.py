"""A shutdown stays until somebody starts the controller again."""

import math

from mambo_control import cascaded, latch
from mambo_control.gains import CascadedParams
from mambo_control.safety import REASON_ESTIMATE, REASON_NONE
from mambo_model.flatness import from_flat_output
from mambo_model.rigid_body import State
from mambo_model.trajectory import TRACK
from mambo_model.vehicle import Vehicle

ZERO = (0.0, 0.0, 0.0)
VEHICLE = Vehicle()
GOOD = State((0.0, 0.0, -1.0), ZERO, (1.0, 0.0, 0.0, 0.0), ZERO)
BAD = GOOD._replace(rho=(math.nan, 0.0, -1.0))
REFERENCE = from_flat_output(
    (0.0, 0.0, -1.0), ZERO, ZERO, ZERO, ZERO, VEHICLE.mass, VEHICLE.inertia, VEHICLE.gravity)


def answer(memory, reason, state):
    return latch.step(memory, reason, state, REFERENCE, TRACK, 0.005, CascadedParams().values(),
                      VEHICLE.values())


def test_a_good_estimate_is_answered_as_by_the_controller_alone():
    memory, reason, command = answer(cascaded.initial(), REASON_NONE, GOOD)
    want_memory, want = cascaded.step(
        cascaded.initial(), GOOD, REFERENCE, TRACK, 0.005, CascadedParams().values(),
        VEHICLE.values())
    assert (memory, reason, command.pwm) == (want_memory, REASON_NONE, want.pwm)
    assert min(command.pwm) > 100.0


def test_after_a_shutdown_a_good_estimate_does_not_start_the_motors():
    memory, reason, command = answer(cascaded.initial(), REASON_NONE, BAD)
    assert command.shutdown and reason == REASON_ESTIMATE
    for _ in range(3):
        memory, reason, command = answer(memory, reason, GOOD)
        assert command.shutdown and command.reason == REASON_ESTIMATE
        assert command.pwm == (0.0, 0.0, 0.0, 0.0)
