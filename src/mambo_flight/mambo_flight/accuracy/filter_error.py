"""Error of the joint filter in flights whose sensor errors are drawn at random."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple

from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_model.compiled import jit
from mambo_model.vehicle.parameters import DRAG_ACCELERATION, DRAG_PER_ROTOR
from mambo_sim import simulator
from mambo_sim.parameters import STEP_NS
from mambo_sim.sensors import imu
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import cramer_rao, filter_run
from .. import closed_loop, offline_replay
from ..scenario import override, Scenario

Array = NDArray[np.float64]
DT = STEP_NS * 1e-9
SLOPES = (-0.1, 0.15)       # 1/m, range of the true slope of Q
SCALES = (0.92, 1.08)       # range of the true Q over the one of the filter
LATENCIES = (0.0, 0.1)      # s, range of the latency of the flow
SETTLED = 10.0              # s after take-off, after which velocity and tilt are compared
_FLOW = 'sim_node.simulator.optical_flow'


class FilterError(NamedTuple):
    """One flight: errors of the filter, its covariance and the bound, row k at step k."""

    start: int      # step of take-off
    error: Array    # (n, SIZE) true minus estimated, in the order of joint.state
    nu: Array       # (n, 3) m/s, body FRD, true minus published
    made: filter_run.Filtered
    limit: Array | None  # (n, SIZE, SIZE) posterior Cramer-Rao bound; None: not computed


def with_unknowns(flight: Scenario, seed: int, vary: bool, slope: float | None = None) -> Scenario:
    """
    Return a flight of another seed, with sensor errors that the filter does not know.

    The offset of the sonar is always drawn, from the filter's prior.

    Parameters
    ----------
    flight
        Scenario.
    seed
        Seed of every noise stream and of the drawn errors.
    vary
        Whether to draw slope, scale and latency from their ranges.
    slope : 1/m
        True slope of Q instead of the drawn one.

    """
    changed = {'sim_node.simulator.seed': seed, 'optitrack_node.seed': seed}
    believed = flight.estimator_node.joint.optical_flow
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(*SLOPES), rng.uniform(*SCALES), rng.uniform(*LATENCIES)
    changed['sim_node.simulator.sonar.offset'] = float(
        rng.normal(0.0, flight.estimator_node.joint.sonar.offset_std))
    if vary or slope is not None:
        rate = float(drawn[0] if slope is None else slope)
        changed[f'{_FLOW}.factor_law'] = 'linear'
        changed[f'{_FLOW}.factor_slope'] = rate
        share = drawn[1] if vary else 1.0
        changed[f'{_FLOW}.factor_offset'] = float(
            believed.scale * share - rate * believed.reference_height)
    if vary:
        changed[f'{_FLOW}.latency'] = round(drawn[2] / DT) * DT
    return override(flight, changed)


def true_noise(flight: Scenario) -> JointParams:
    """Return the filter's parameters with the true noise of the simulated sensors."""
    sim, p = flight.sim_node.simulator, flight.estimator_node.joint
    inertial, air = sim.imu, sim.barometer
    root = math.sqrt(DT)

    def density(noise: tuple[float, ...], resolution: float) -> float:
        return root * math.hypot(float(np.mean(noise)), resolution / math.sqrt(12.0))
    metre = (288.15 * 287.05 / 9.80665) / air.ground_pressure  # ISO 2533 at the floor
    return replace(
        p, motion=replace(
            p.motion, gyro_noise=density(inertial.gyro_noise, inertial.gyro_resolution),
            accel_noise=density(inertial.accel_noise, inertial.accel_resolution),
            gyro_bias_walk=inertial.gyro_walk,
            accel_bias_walk=inertial.accel_walk),
        sonar=replace(p.sonar, noise=max(1e-4, math.hypot(
            sim.sonar.noise, sim.sonar.resolution / math.sqrt(12.0)))),
        optical_flow=replace(
            p.optical_flow, noise=max(1e-4, sim.optical_flow.noise), scale_walk=0.0),
        barometer=replace(
            p.barometer, noise=max(1e-3, air.noise * metre), offset_walk=air.walk * metre))


def _truth(flight: Scenario) -> cramer_rao.TrueParameters:
    """Return the true parameters of flow and drag."""
    sim = flight.sim_node.simulator
    flow, vehicle = sim.optical_flow, sim.vehicle.values()
    height = flight.estimator_node.joint.optical_flow.reference_height
    share = {DRAG_PER_ROTOR: 0.25, DRAG_ACCELERATION: 1.0 / vehicle.gravity}
    return cramer_rao.TrueParameters(
        flow.factor_offset + flow.factor_slope * height, flow.factor_slope,
        vehicle.drag_coefficient * share.get(vehicle.drag_reading, 1.0),
        round(flow.latency / DT) * DT)


@jit
def _simulate_biases(values, rng, out):
    """Store the biases of each step, simulated by a sensor at rest."""
    memory, none = imu.START, (0.0, 0.0, 0.0)
    for k in range(len(out)):
        memory, _ = imu.step(memory, none, none, 0.0, rng, True, values)
        for i in range(3):
            out[k, i], out[k, 3 + i] = memory.gyro_bias[i], memory.accel_bias[i]


def _biases(flight: Scenario, steps: int) -> Array:
    """Return the true biases of gyro and accelerometer, (n, 6), by the seed of the flight."""
    sim, out = flight.sim_node.simulator, np.zeros((steps, 6))
    if sim.noise:
        _simulate_biases(sim.imu.values(), simulator.generators(sim.seed)[simulator.IMU], out)
    return out


def _error(
    r: closed_loop.Recording, made: filter_run.Filtered, t: cramer_rao.TrueParameters,
    biases: Array, offset: float,
) -> Array:
    """Return the true error state of each step, (n, SIZE)."""
    x, out = made.x, np.zeros((len(r.t), SIZE))
    true, own = (Rotation.from_quat(q[:, [1, 2, 3, 0]]) for q in (r.truth[:, 6:10], x[:, 6:10]))
    turn = true * own.inv()
    v = true.apply(r.truth[:, 3:6])
    out[:, :3] = r.truth[:, :3] - x[:, :3]
    out[:, 3:6] = v - turn.apply(x[:, 3:6])
    out[:, 6:9] = turn.as_rotvec()
    out[:, 9:15] = biases - x[:, 10:16]
    out[:, 15] = t.scale - x[:, 16]
    out[:, 16] = t.slope - x[:, 17]
    out[:, 17:19] = t.drag - x[:, 18:20]
    out[:, 19] = t.latency - x[:, 20]
    out[:, 20], out[:, 21] = -x[:, 21], offset - x[:, 22]
    return out


def evaluate(flight: Scenario, bounded: bool = True) -> FilterError:
    """Fly a scenario; return the error of the joint filter, and the bound if ``bounded``."""
    return evaluate_recording(flight, closed_loop.fly(flight), bounded)


def evaluate_recording(
    flight: Scenario, r: closed_loop.Recording, bounded: bool = True,
) -> FilterError:
    """Return the same for a scenario that has been flown."""
    made = filter_run.run(offline_replay.steps_of(r), flight.estimator_node.joint)
    t, start = _truth(flight), int(np.flatnonzero(made.resting)[-1])
    error = _error(
        r, made, t, _biases(flight, len(r.t)), flight.sim_node.simulator.sonar.offset)
    limit = _limit(flight, r, start, made.P[start], t) if bounded else None
    return FilterError(start, error, r.truth[:, 3:6] - made.nu, made, limit)


def _limit(
    flight: Scenario, r: closed_loop.Recording, start: int, known: Array,
    t: cramer_rao.TrueParameters,
) -> Array:
    """Return the bound at each step, from the covariance ``known`` at take-off."""
    true = Rotation.from_quat(r.truth[:, [7, 8, 9, 6]])
    v = true.apply(r.truth[:, 3:6])
    force = true.inv().apply(np.gradient(v, DT, axis=0) - [0.0, 0.0, 9.81])
    sensed = cramer_rao.SampledFlight(
        r.truth, force, np.isfinite(r.flow[:, 0]),
        np.isfinite(r.sonar) & (r.sonar > flight.estimator_node.joint.sonar.min_range),
        np.isfinite(r.pressure))
    limit = np.empty((len(r.t), SIZE, SIZE))
    cramer_rao.covariances(sensed, start, known.copy(), DT, t, true_noise(flight).values(), limit)
    return limit
