"""Time of one control step, the failsafe guard included."""

from __future__ import annotations

import time

from mambo_control import controllers
from mambo_model.compiled import jit
from mambo_model.motion.flatness import body_velocity
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import reference_step, TRACK

from ..scenario import Scenario

_STEPS, _REPETITIONS = 20_000, 5


@jit
def _repeat(memory, state, ref, dt, gains, vv, count):
    """Run the controller ``count`` times on one estimate; return a sum of all commands."""
    total = 0.0
    for _ in range(count):
        memory, command = controllers.answer(memory, state, ref, TRACK, dt, gains, vv)
        total += command.pwm[0]
    return total


def step_time(flight: Scenario) -> float:
    """Return the time of one control step of a scenario in us, the minimum of five runs."""
    node = flight.controller_node
    plan, vv, gains = flight.reference_node.plan.values(), node.vehicle.values(), node.law.values()
    ref, _ = reference_step(12.0, plan, vv.mass, vv.inertia, vv.gravity)
    state = State(ref.rho, body_velocity(ref), ref.q, ref.omega)
    took = []
    for count in (1, *[_STEPS] * _REPETITIONS):  # the first one compiles
        began = time.process_time()
        _repeat(controllers.initial(gains), state, ref, node.period, gains, vv, count)
        took.append((time.process_time() - began) / count)
    return 1e6 * min(took[1:])
