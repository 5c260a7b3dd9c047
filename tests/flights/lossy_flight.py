"""The closed loop step by step, with something between estimator, flight plan and controller."""

from typing import NamedTuple

from mambo_control import failsafe
from mambo_estimation import filters
from mambo_flight import closed_loop
from mambo_model.motion.quaternion import rotate
from mambo_model.motion.trajectory import reference_step
from mambo_sim import simulator
import numpy as np

STEP = 0.005


class Flight(NamedTuple):
    """Rows of one flight; floor contact is where the true height is 0."""

    t: np.ndarray  # s
    rho: np.ndarray  # (n, 3) m, NED, truth
    v: np.ndarray  # (n, 3) m/s, NED, truth
    tilt: np.ndarray  # rad, truth
    pwm: np.ndarray  # (n, 4)
    stage: np.ndarray
    reason: np.ndarray  # of the command
    shutdown: np.ndarray
    spread: np.ndarray  # (n, 3), of the estimate

    @property
    def height(self):
        return -self.rho[:, 2]

    def touch_down(self, since):
        """Return speed m/s and tilt rad at the first contact with the floor after a time."""
        air = np.flatnonzero((self.t >= since) & (self.height > 0.0))
        if not len(air):
            return 0.0, 0.0
        landed = np.flatnonzero((self.t > self.t[air[0]]) & (self.height <= 0.0))
        before = slice(max(landed[0] - 10, 0), landed[0])  # 50 ms
        return self.v[before, 2].max(), self.tilt[before].max()


def fly(flight, spoil=lambda t, phase, *inputs: inputs):
    """
    Fly a scenario; ``spoil(t, phase, state, spread, ref)`` returns the last three as they arrive.

    Ends early when the vehicle is at rest after a shutdown.
    """
    sim, believed = flight.sim_node.simulator, flight.controller_node
    values, rngs, p = sim.values(), simulator.generators(sim.seed), closed_loop.settings(flight)
    state, memory = simulator.initial_state(sim), filters.initial(p.estimator)
    control, plan = failsafe.initial(believed.law), flight.reference_node.plan.values()
    vv, rows = flight.reference_node.vehicle.values(), []
    settings = STEP, believed.law.values(), believed.failsafe.values(), believed.vehicle.values()
    for k in range(round(flight.sim_node.duration / STEP) + 1):
        t = k * 5_000_000 * 1e-9
        state, s = simulator.sense(state, k, rngs, values)
        estimated, spread = state.plant.body, failsafe.EXACT
        if p.estimator is not None:
            h = closed_loop.delivered_readings(s, p)
            memory, e = filters.step(
                memory, 5_000_000 * 1e-9 if k else 0.0, s.gyro, s.accel, h.sonar, h.flow,
                h.flow_quality, h.pressure, p.estimator)
            estimated = e.state
            spread = failsafe.spread_of(e.pose_covariance, e.twist_covariance)
        ref, phase = reference_step(t, plan, vv.mass, vv.inertia, vv.gravity)
        control, command = failsafe.step(
            control, *spoil(t, phase, estimated, spread, ref), phase, *settings)
        body = state.plant.body
        down = rotate(body.q, (0.0, 0.0, 1.0))[2]
        rows.append((
            t, body.rho, rotate(body.q, body.nu), np.arccos(min(down, 1.0)), command.pwm,
            control.stage, command.reason, command.shutdown, spread))
        if command.shutdown and body.rho[2] >= 0.0 and body.nu == (0.0, 0.0, 0.0):
            break
        state = simulator.advance(state, command.pwm, command.shutdown, values)
    return Flight(*(np.array(column) for column in zip(*rows, strict=True)))
