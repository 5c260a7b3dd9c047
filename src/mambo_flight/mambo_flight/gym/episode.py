"""
Control steps of a flight that an agent commands: the compiled steps of the closed loop.

At each control step the sensors are read, the estimator and the reference are updated, the agent
or a controller commands the motors, and the vehicle moves. Order and numbers are those of
:mod:`mambo_flight.closed_loop`, to the last bit (tested).
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_control import failsafe
from mambo_control.attitude_law import attitude_error, torque
from mambo_control.command import motors
from mambo_control.gains import GainValues
from mambo_estimation import filters
from mambo_estimation.capture.frames import wrapped
from mambo_model.compiled import jit, jit_beside_python
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import from_euler, IDENTITY, Quat, rotate, to_euler
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import reference_step
from mambo_model.motion.vector import add, norm, sub
from mambo_model.vehicle.motor_mixer import Four
from mambo_model.vehicle.parameters import VehicleValues
from mambo_sim import simulator, wind
from mambo_sim.parameters import STEP_NS
import numpy as np
from numpy.typing import NDArray

from .. import closed_loop
from .task import ATTITUDE_THRUST, OBSERVED, PLAN, PWM, SETPOINT, TaskValues

STEP = STEP_NS * 1e-9  # s
ALOFT = 0.1  # m, once the drone has been this high, touching the floor ends an episode
REASONS = (
    '', 'too far from the reference', 'tilted too far', 'touched the floor',
    'motors shut down by the failsafe')
NOTHING, FAR, TILTED, FLOOR, SHUTDOWN = range(len(REASONS))
WAITING = -1  # tick of a flight whose sensors have not been read


class Drone(NamedTuple):
    """State of a flight between two actions."""

    simulator: simulator.SimulatorState  # after its sensors were read at this tick
    filter: filters.Memory | None        # None: the true state is used
    control: failsafe.Memory
    estimated: State                     # what is observed, inertial NED and body FRD
    spread: failsafe.Spread              # its variances
    reference: Reference                 # at this tick
    phase: int                           # of the flight plan
    tick: int                            # number of the control step; WAITING: before the first
    pwm: Four                            # (4,) in force up to this tick
    aloft: bool                          # has been above ALOFT


class Episode(NamedTuple):
    """Constants of an episode."""

    flight: closed_loop.Settings
    attitude: GainValues    # of the inner loop
    rules: TaskValues
    hover: bool             # the agent's reference is the target, not the flight plan
    target: Reference       # where to hover
    handover: int           # tick from which on the agent flies


class Outcome(NamedTuple):
    """Result of the last steps of N drones, row i for drone i."""

    observation: NDArray[np.float64]  # (N, 22), see task.OBSERVED
    truth: NDArray[np.float64]        # (N, 13) state, see task.STATE
    reward: NDArray[np.float64]       # (N,)
    reason: NDArray[np.int64]         # (N,) why the episode ended, index of REASONS
    tick: NDArray[np.int64]           # (N,) number of the control step
    stage: NDArray[np.int64]          # (N,) of the failsafe


def outcome(count: int) -> Outcome:
    """Return an outcome of zeros for a number of drones."""
    return Outcome(
        np.zeros((count, len(OBSERVED))), np.zeros((count, 13)), np.zeros(count),
        *(np.zeros(count, dtype=np.int64) for _ in range(3)))


@jit
def _advance_wind(state, tick, rngs, p):
    """Return the simulator with the wind of this tick; its sensors are not read."""
    air = wind.step(state.wind, tick, rngs[simulator.WIND], p.noise, p.wind)
    return simulator.SimulatorState(
        state.plant, state.imu, state.optical_flow, state.barometer, state.faults, air)


@jit
def attitude_pwm(
    state: State, q: Quat, thrust: float, gains: GainValues, vv: VehicleValues,
) -> Four:
    """
    Return the PWM, (4,), of the inner loop (3.25)-(3.29) for a constant attitude.

    Parameters
    ----------
    state
        Estimate, inertial NED and body FRD.
    q : (4,) w x y z
        Desired attitude, body to inertial, unit quaternion.
    thrust : N
        Desired thrust, along -z of the body.
    gains
        Of the cascaded controller.
    vv
        Vehicle model of the controller.

    """
    zero = (0.0, 0.0, 0.0)
    ref = Reference(zero, zero, zero, zero, zero, q, zero, zero, thrust, zero)
    q_e = attitude_error(state.q, q, IDENTITY)
    tau = torque(state, ref, IDENTITY, zero, zero, q_e, state.omega, gains, vv)
    return motors(thrust, tau, vv)[1]


@jit
def _shifted(ref, kind, action):
    """Return the reference of the scenario's controller, shifted by a ``SETPOINT`` action."""
    if kind != SETPOINT:
        return ref
    rho = add(ref.rho, (action[0], action[1], action[2]))
    return Reference(
        rho, ref.v, ref.a, ref.j, ref.s, ref.q, ref.omega, ref.omega_dot, ref.f, ref.tau)


@jit
def _reward(body, ref, before, pwm, shutdown, aloft, rules, vv):
    """Return the reward of the last control step, and the reason if the episode ends."""
    distance = norm(sub(ref.rho, body.rho))
    speed = norm(sub(ref.v, rotate(body.q, body.nu)))
    turned = abs(wrapped(to_euler(body.q)[2] - to_euler(ref.q)[2]))
    change = 0.0
    for i in range(4):
        change += (pwm[i] - before[i]) ** 2
    change /= 4.0 * vv.pwm_max ** 2
    reward = STEP * (
        rules.alive - rules.position * distance - rules.velocity * speed - rules.yaw * turned
        - rules.rate * norm(body.omega) - rules.change * change)
    reason = NOTHING
    if shutdown:
        reason = SHUTDOWN
    elif aloft and body.rho[2] >= 0.0:
        reason = FLOOR
    elif rotate(body.q, (0.0, 0.0, 1.0))[2] < rules.tilt_cosine:
        reason = TILTED
    elif distance > rules.position_limit:
        reason = FAR
    if reason != NOTHING:
        reward -= rules.crash
    return reward, reason


@jit
def _store(row, s, ref):
    """Store the observation of a state and a reference."""
    closed_loop.store_state(row, s)
    v = rotate(s.q, s.nu)
    for k in range(3):
        row[13 + k] = ref.rho[k] - s.rho[k]
        row[16 + k] = ref.v[k] - v[k]
        row[19 + k] = ref.a[k]


@jit_beside_python
def fly(drones, rows, actions, kind, repeat, out, estimating):
    """
    Fly some drones for a number of control steps, or to the end of their episode.

    All steps are in one function, as in the closed loop: passing a whole :class:`Drone` to a
    function would take longer than the flight.

    Parameters
    ----------
    drones
        List of holders: memory :class:`Drone`, generators, values :class:`Episode`.
    rows : (n,)
        Which of them.
    actions : (N, 4)
        Row i for drone i, in the units of :func:`task.commanded`; not read for ``PLAN``.
    kind
        PWM, ATTITUDE_THRUST, SETPOINT or PLAN, of :mod:`task`. ``PLAN`` has no reward and never
        ends the episode.
    repeat
        Control steps for which the action is held. The first step of a ``WAITING`` flight only
        reads its sensors.
    out
        Its rows are filled: see :class:`Outcome`.
    estimating
        Result of ``closed_loop.estimates``; None: no sensor is read and no estimator compiled.

    """
    for i in rows:
        held = drones[i]
        d, e, rngs, action = held.memory, held.values, held.rng, actions[i]
        state, memory, control, s, spread, ref, phase, tick, pwm, aloft = d
        p, believed = e.flight, e.flight.controller_vehicle
        total, reason = 0.0, NOTHING
        for _ in range(repeat):
            before, shutdown = pwm, False
            if tick != WAITING:
                if kind == PWM:
                    pwm = (action[0], action[1], action[2], action[3])
                elif kind == ATTITUDE_THRUST:
                    q = from_euler(action[0], action[1], action[2])
                    pwm = attitude_pwm(s, q, action[3], e.attitude, believed)
                else:
                    control, command = failsafe.step(
                        control, s, spread, _shifted(ref, kind, action), phase, p.period,
                        p.gains, p.failsafe, believed)
                    pwm, shutdown = command.pwm, command.shutdown
                state = simulator.advance(state, pwm, shutdown, p.simulator)
            tick += 1
            if estimating is None:
                state = _advance_wind(state, tick, rngs, p.simulator)
                s = state.plant.body
            else:
                state, samples = simulator.sense(state, tick, rngs, p.simulator)
                h = closed_loop.delivered_readings(samples, p)
                t = tick * STEP_NS
                t_before = t - STEP_NS if tick else t
                memory, estimate = filters.step(
                    memory, (t - t_before) * 1e-9, h.gyro, h.accel, h.sonar, h.flow,
                    h.flow_quality, h.pressure, p.estimator)
                s, spread = estimate.state, failsafe.spread_of(
                    estimate.pose_covariance, estimate.twist_covariance)
            v = p.reference_vehicle
            ref, phase = reference_step(
                tick * STEP_NS * 1e-9, p.plan, v.mass, v.inertia, v.gravity)
            if e.hover and tick >= e.handover:
                ref = e.target
            body = state.plant.body
            aloft = aloft or -body.rho[2] > ALOFT
            if kind != PLAN:
                reward, reason = _reward(
                    body, ref, before, pwm, shutdown, aloft, e.rules, believed)
                total += reward
                if reason != NOTHING:
                    break
        held.memory = Drone(state, memory, control, s, spread, ref, phase, tick, pwm, aloft)
        out.reward[i], out.reason[i], out.tick[i] = total, reason, tick
        out.stage[i] = control.stage
        _store(out.observation[i], s, ref)
        closed_loop.store_state(out.truth[i], state.plant.body)
