"""The compiled reference of commands is that of the timeline, and of a plan that of the plan."""

from mambo_control.commanded import evaluation, script, timeline as tl
from mambo_control.commanded.command_params import CommandParams
from mambo_model.motion import trajectory
from mambo_model.motion.flatness import from_flat_output_yaw
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

P, V = CommandParams(script="""
- {time: 1.0, takeoff: {height: 1.0}}
- {time: 4.0, go_to: {goal: [1.0, 0.5, 1.2], yaw: 0.5}}
- {time: 9.0, land: {}}
"""), Vehicle()


def test_commands_are_evaluated_as_the_timeline_says():
    line, vv = script.flown(P, V), V.values()
    compiled = evaluation.values(line)
    phases = set()
    for t in np.arange(0.0, 15.0, 0.05).tolist():
        state, phase = tl.state_of(line, t)
        ref, its_phase = evaluation.reference_step(t, compiled, vv.mass, vv.inertia, vv.gravity)
        x = [tuple(column) for column in state[:3].T.tolist()]
        assert ref == from_flat_output_yaw(
            *x, *state[3, :3].tolist(), vv.mass, vv.inertia, vv.gravity)
        assert phase == its_phase
        phases.add(phase)
    assert phases == set(range(5))


def test_a_plan_is_evaluated_as_without_commands():
    plan, vv = trajectory.FlightPlanParams().values(), V.values()
    for t in (0.0, 2.5, 6.0, 20.0):
        assert evaluation.reference_step(t, plan, vv.mass, vv.inertia, vv.gravity) == (
            trajectory.reference_step(t, plan, vv.mass, vv.inertia, vv.gravity))
