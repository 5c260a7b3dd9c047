"""
Many flights, each reduced to a few metrics while it is flown; nothing is recorded.

:func:`fly_many` flies without sensors: the controller gets the true state. It uses the compiled
steps of :mod:`closed_loop`, and its flights equal those with the estimator ``ground_truth`` there,
to the last bit (tested).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import math
import time
from typing import Any, NamedTuple

from mambo_control import controllers, failsafe
from mambo_control.commanded.evaluation import CommandedValues, reference_step
from mambo_control.safety import REASON_ESTIMATE, REASON_GROUNDED
from mambo_model.compiled import jit
from mambo_model.motion.height_check import (
    AWAY, DROP, FAR, hits_floor, lies_below, LONG, LOW, too_far)
from mambo_model.motion.rigid_body import LIFTED
from mambo_model.motion.trajectory import in_flight, LANDED, PlanValues
from mambo_model.motion.vector import add, dot, mul, sub, Vec3
from mambo_model.vehicle.motor_mixer import Four
from mambo_model.vehicle.parameters import OptionValues, Vehicle, VehicleValues
from mambo_sim import plant, simulator, wind
from mambo_sim.parameters import STEP_NS
import numpy as np

from .. import closed_loop
from ..capture_columns import COLUMNS
from ..scenario import Scenario

STEP = STEP_NS * 1e-9  # s
_STILL: Four = (0.0, 0.0, 0.0, 0.0)


class Tally(NamedTuple):
    """Sums over the control steps so far; the errors count in flight only, but for the last."""

    steps: int
    tracking: Vec3  # m^2, squares of truth minus reference, inertial NED
    tracking_max: float  # m
    tracking_last: float  # m
    estimation: Vec3  # m^2, squares of estimate minus truth
    estimation_max: float  # m
    estimation_last: float  # m
    running: int  # steps with turning motors
    saturated: int  # of these, steps with a motor at a PWM limit
    pwm_max: float
    effort: float  # N^1.5, thrust of each rotor to the power 1.5
    stopped_at: float  # s, time of the shutdown; NaN: none before LANDED
    reason: int  # of the shutdown, safety.REASON_*
    top: float  # m, largest true height
    down_since: float  # s, from when it lies on the floor below its reference; NaN: it does not
    fallen: bool  # whether it lay there for LONG, its motors stopped above DROP, or it hit HARD
    still: bool  # whether it does not fly and its motors do not turn
    before: float  # m, true height at this step
    earlier: float  # m, and one step before
    asked_top: float  # m, largest height of the reference in flight
    off_since: float  # s, from when it is far from the height of its reference; NaN: it is not
    beside_since: float  # s, likewise horizontally
    strayed: bool  # whether it was far from its reference for AWAY or more
    asked_from: float  # s, from when to when the reference in flight was above LOW; NaN: never
    asked_until: float  # s
    failsafe: int  # reason of the newest command before LANDED, safety.REASON_*; none: it follows
    #                the reference


START = Tally(
    0, (0.0, 0.0, 0.0), 0.0, 0.0, (0.0, 0.0, 0.0), 0.0, 0.0, 0, 0, 0.0, 0.0, math.nan, 0,
    -math.inf, math.nan, False, True, math.nan, math.nan, 0.0, math.nan, math.nan, False,
    math.nan, math.nan, 0)


@jit
def _limits(believed: VehicleValues, vehicle: VehicleValues) -> tuple[float, float]:
    """Return the PWM at which a motor is saturated: the controller's limit, or the vehicle's."""
    return (max(believed.pwm_min, vehicle.pwm_min), min(believed.pwm_max, vehicle.pwm_max))


@jit
def count(
    a: Tally, t: float, truth: Vec3, estimate: Vec3, reference: Vec3, phase: int,
    pwm: Four, stopped: bool, reason: int, limits: tuple[float, float], thrust: Four,
) -> Tally:
    """
    Return the tally after one more control step.

    Parameters
    ----------
    a
        Tally so far, at first :data:`START`.
    t : s
    truth, estimate, reference : (3,) m, inertial NED
    phase
        Of the flight plan.
    pwm : (4,) PWM
        Motor commands.
    stopped, reason
        Whether the motors are shut down, and why. ``REASON_GROUNDED`` above the floor counts as
        ``REASON_ESTIMATE``.
    limits : (2,) PWM
        Within which the motors are not saturated, of :func:`_limits`.
    thrust : (4,) N
        Of the rotors of the true vehicle at the end of the step.

    """
    off, wrong = sub(truth, reference), sub(estimate, truth)
    track, drift = math.sqrt(dot(off, off)), math.sqrt(dot(wrong, wrong))
    highest = max(max(pwm[0], pwm[1]), max(pwm[2], pwm[3]))
    lowest = min(min(pwm[0], pwm[1]), min(pwm[2], pwm[3]))
    effort = a.effort
    for x in thrust:
        effort += x * math.sqrt(x)
    if reason == REASON_GROUNDED and (-truth[2] > LIFTED or a.reason == REASON_ESTIMATE):
        reason = REASON_ESTIMATE  # by the truth it was not on the floor when it stopped
    at = a.stopped_at
    if stopped and math.isnan(at) and phase != LANDED:
        at = t
    runs = int(highest > 0.0)
    cut = int(highest > 0.0 and (highest >= limits[1] or lowest <= limits[0]))
    flown, top, since = in_flight(phase), max(a.top, -truth[2]), math.nan
    if lies_below(-truth[2], -reference[2]):
        since = t if math.isnan(a.down_since) else a.down_since
    still = not flown and not runs
    fell = a.fallen or t - since >= LONG or (  # the former is false for NaN
        still and not a.still and -truth[2] > DROP) or (
            hits_floor(-truth[2], a.before, a.earlier, STEP))
    asked_top = max(a.asked_top, -reference[2]) if flown else a.asked_top
    far = too_far(-truth[2], -reference[2], asked_top, flown)
    strayed, off_since, beside_since = a.strayed, math.nan, math.nan
    if far:
        off_since = t if math.isnan(a.off_since) else a.off_since
        strayed = strayed or t - off_since >= AWAY
    if flown and track > FAR and off[0] * off[0] + off[1] * off[1] > FAR * FAR:
        beside_since = t if math.isnan(a.beside_since) else a.beside_since
        strayed = strayed or t - beside_since >= AWAY
    begun, ended = a.asked_from, a.asked_until
    if flown and -reference[2] > LOW:
        begun, ended = t if math.isnan(begun) else begun, t
    if not flown:
        return Tally(
            a.steps, a.tracking, a.tracking_max, track, a.estimation, a.estimation_max, drift,
            a.running + runs, a.saturated + cut, max(a.pwm_max, highest), effort, at,
            reason if stopped else a.reason, top, since, fell, still, -truth[2], a.before,
            asked_top, off_since, beside_since, strayed, begun, ended,
            a.failsafe if phase == LANDED else reason)
    return Tally(
        a.steps + 1, add(a.tracking, mul(off, off)), max(a.tracking_max, track), track,
        add(a.estimation, mul(wrong, wrong)), max(a.estimation_max, drift), drift,
        a.running + runs, a.saturated + cut, max(a.pwm_max, highest), effort, at,
        reason if stopped else a.reason, top, since, fell, still, -truth[2], a.before,
        asked_top, off_since, beside_since, strayed, begun, ended, reason)


def _standing(flight: Scenario) -> bool:
    """Return whether the vehicle of a flight begins on the floor."""
    p = flight.sim_node.simulator.plant
    return p.ground and p.initial_position[2] == 0.0


def metrics(
    a: Tally, vehicle: Vehicle, standing: bool = False, floor: bool = True,
    carried: bool = False,
) -> dict[str, Any]:
    """
    Return the metrics of a flight by name.

    Parameters
    ----------
    a
        Tally of the flight.
    vehicle
        The true one.
    standing
        Whether the vehicle begins on the floor: unless it rises above LIFTED, it has not flown.
    floor
        Whether there is one.
    carried
        Whether a hand carried the vehicle: its motors were stopped, and it tracked nothing.

    Returns
    -------
    metrics

        ``tracking`` is truth minus reference, ``estimation`` estimate minus truth, in m: ``rms``
        over the steps in flight, total and along x, y, z (NED), ``max`` the largest length in
        flight, ``final`` the length at the end. ``energy`` in J is the ideal power of the rotors
        of the true vehicle over the efficiency of the drive, integrated. NaN in place of
        ``rms`` and ``max`` if nothing was flown, and of these and ``final`` if the vehicle never
        took off. Of one that was carried, ``tracking`` and ``saturated_share`` are NaN, and
        ``pwm_max`` and ``energy`` 0: what the controller commanded moved nothing. ``failsafe`` is
        why the failsafe held or landed the vehicle at the end, empty if it did not. ``fallen``
        tells whether it lay on the floor below its reference, or its motors stopped above the
        floor after its landing, or it hit the floor; ``strayed`` whether it was far from its
        reference for 2 s, see :mod:`mambo_model.motion.height_check`.

    """
    grounded = standing and not a.top > LIFTED
    if carried:
        a = a._replace(running=0, pwm_max=0.0, effort=0.0)
    out: dict[str, Any] = {}
    for name in ('tracking', 'estimation'):
        unknown = grounded or (carried and name == 'tracking')
        steps = 0 if unknown else a.steps
        squares = np.array(getattr(a, name)) / steps if steps else np.full(3, np.nan)
        out[f'{name}_rms'] = math.sqrt(squares.sum())
        for axis, square in zip('xyz', squares.tolist()):
            out[f'{name}_rms_{axis}'] = math.sqrt(square)
        out[f'{name}_max'] = getattr(a, f'{name}_max') if steps else math.nan
        out[f'{name}_final'] = math.nan if unknown else getattr(a, f'{name}_last')
    out['saturated_share'] = a.saturated / a.running if a.running else math.nan
    out['pwm_max'] = a.pwm_max
    ideal = a.effort / (vehicle.rotor.radius * math.sqrt(2.0 * math.pi * vehicle.air_density))
    out['energy'] = STEP * ideal / vehicle.battery.efficiency
    out['shutdown'], out['shutdown_time'] = not math.isnan(a.stopped_at), a.stopped_at
    out['shutdown_reason'] = failsafe.REASONS[a.reason]
    out['failsafe'] = failsafe.REASONS[a.failsafe]
    never_rose = grounded and a.asked_until - a.asked_from >= LONG
    out['fallen'] = floor and (a.fallen or never_rose)
    out['strayed'] = a.strayed
    return out


def never_took_off(found: Mapping[str, Any]) -> bool:
    """Return whether metrics are those of a vehicle that has not flown."""
    return math.isnan(found['tracking_rms']) and math.isnan(found['estimation_rms'])


@jit
def _count_all(
    t, truth, estimate, reference, phase, pwm, stopped, reason, vv, motors, vehicle, substeps,
    options,
):
    """Return the tally of a recorded flight, whose motors begin with the plant ``motors``."""
    out, limits = START, _limits(vv, vehicle)
    for k in range(len(t)):
        x, y, z, p = truth[k], estimate[k], reference[k], pwm[k]
        command, thrust = (p[0], p[1], p[2], p[3]), _STILL
        if k < len(t) - 1:
            motors = plant.spin(
                motors, _STILL if stopped[k] else command, STEP, substeps, vehicle, options)
            thrust = motors.thrust
        out = count(
            out, t[k] * 1e-9, (x[0], x[1], x[2]), (y[0], y[1], y[2]), (z[0], z[1], z[2]),
            phase[k], command, stopped[k], reason[k], limits, thrust)
    return out


def fly_with_sensors(flight: Scenario) -> dict[str, Any]:
    """Return the :func:`metrics` of a flight of :func:`closed_loop.fly`."""
    return measure(flight, closed_loop.fly(flight))


def measure(flight: Scenario, r: closed_loop.Recording) -> dict[str, Any]:
    """Return the :func:`metrics` of a flight that was flown, with the estimate it was flown on."""
    p, estimate = flight.sim_node.simulator, r.estimate
    if flight.controller_node.estimate == 'map' and r.located is not None:
        estimate = r.located[:, :COLUMNS.covariance]
    return metrics(_count_all(
        r.t, r.truth, estimate, r.reference, r.phase, r.pwm, r.stopped, r.reason,
        flight.controller_node.vehicle.values(), plant.initial(p.plant), p.vehicle.values(),
        p.plant.substeps(), p.vehicle.options()), p.vehicle, _standing(flight), p.plant.ground,
        p.hand.enabled)


class _Ideal(NamedTuple):
    """Constants that the compiled loop without sensors reads."""

    vehicle: VehicleValues
    plant: plant.PlantValues
    options: OptionValues | None
    wind: wind.WindValues | None
    noise: bool
    plan: PlanValues | CommandedValues
    gains: controllers.Gains
    failsafe: failsafe.FailsafeValues
    reference_vehicle: VehicleValues
    controller_vehicle: VehicleValues
    period: float


@jit
def _fly_ideal(state, air, rng, control, steps, p):
    """Return the tally of a flight on the true state; :func:`fly_many` fills the arguments."""
    tally, vehicle, vv = START, p.reference_vehicle, p.controller_vehicle
    limits = _limits(vv, p.vehicle)
    for k in range(steps):
        t = k * STEP_NS * 1e-9
        air = wind.step(air, k, rng, p.noise, p.wind)
        body = state.body
        ref, phase = reference_step(t, p.plan, vehicle.mass, vehicle.inertia, vehicle.gravity)
        control, c = failsafe.step(
            control, body, failsafe.EXACT, ref, phase, p.period, p.gains, p.failsafe, vv)
        thrust = _STILL
        if k < steps - 1:
            state = plant.advance(
                state, c.pwm, STEP, p.plant.substeps, p.vehicle, p.plant.ground, p.options,
                p.plant.length_gain, wind.air_velocity(air), p.plant.floor)
            thrust = state.thrust
        tally = count(
            tally, t, body.rho, body.rho, ref.rho, phase, c.pwm, c.shutdown, c.reason, limits,
            thrust)
    return tally


def fly_many(flights: Iterable[Scenario]) -> Iterator[dict[str, Any]]:
    """
    Yield the :func:`metrics` of flights without sensors, on the true state.

    Parameters
    ----------
    flights
        Their estimators, sensors, motion capture and ``carried`` have no effect.

    Raises
    ------
    ValueError
        If a scenario has no duration.

    """
    for flight in flights:
        sim, controller = flight.sim_node.simulator, flight.controller_node
        p = _Ideal(
            sim.vehicle.values(), sim.plant.values(), sim.vehicle.options(), sim.wind.values(),
            sim.noise, flight.reference_node.flown(), controller.law.values(),
            controller.failsafe.values(), flight.reference_node.vehicle.values(),
            controller.vehicle.values(), controller.period)
        yield metrics(_fly_ideal(
            plant.initial(sim.plant), wind.initial(sim.wind),
            simulator.generators(sim.seed)[simulator.WIND], failsafe.begin(p.gains),
            closed_loop.step_count(flight), p), sim.vehicle, _standing(flight), sim.plant.ground)


class Speed(NamedTuple):
    """Speed of one core, median of repetitions."""

    real_time_factor: float
    drone_steps: float  # integration steps per second, control included


def speed(flight: Scenario, ideal: bool, repetitions: int = 5) -> Speed:
    """
    Measure how fast this process flies a scenario, with or without sensors, in CPU time.

    A first flight, which compiles, is not counted.
    """
    work = (lambda: list(fly_many([flight]))) if ideal else lambda: fly_with_sensors(flight)
    took = []
    for _ in range(repetitions + 1):
        began = time.process_time()
        work()
        took.append(time.process_time() - began)
    seconds = float(np.median(took[1:]))
    factor = flight.sim_node.duration / seconds
    return Speed(factor, factor * flight.sim_node.simulator.plant.physics_rate)
