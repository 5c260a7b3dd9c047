"""
Compare the joint filter with the lower bound of any estimator (Cramer-Rao).

Of a scenario this is the command of :mod:`mambo_flight.accuracy.bound`, over many seeds. Of a real
recording with motion capture, BAG --parameters FILE, it is the bound for that path, at the times
of its own samples, with the noise and the priors of the file; where inertial samples are lost, the
noise is that of held rates and forces. The posterior begins with what the filter knows at
take-off. Beside it stands what the filter reached on that recording: one flight, so that chance
alone makes a ratio anywhere between 0.2 and 2. Errors of the motion capture count as those of the
filter.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
import json
import math
from pathlib import Path
from typing import NamedTuple

from mambo_bags.command import guard, Parser, write_json
from mambo_bags.reader import Bag, BagError, read_bag
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.propagation import bridge
from mambo_estimation.joint.state import ATTITUDE, POSITION, SIZE, VELOCITY
from mambo_flight import offline_replay
from mambo_flight.accuracy import bound, cramer_rao, filter_run, from_bag
from mambo_model.errors import InputError
from mambo_model.frames import flip_vector
from mambo_ros import topics
from mambo_signals.resample import interpolate
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import captured
from ..compare import estimate_checks
from ..compare.estimate import chosen

Array = NDArray[np.float64]
DT = 0.005          # s, step of the bound
FAR = 10.0          # m: below this height no drag is measured, that is never
LONGEST = 600.0     # s of a flight
SPAN = 7200.0       # s between the first and the last pose
CHANCE = 5.0        # [-] of reached over bound: one flight has 2 by chance
AIDING = (topics.SONAR.name, topics.OPTICAL_FLOW.name, topics.BAROMETER.name)


class Line(NamedTuple):
    """One quantity: its bound and what was reached, root mean squares."""

    name: str
    unit: str
    bound: float
    reached: float


def _ned(vectors: Array) -> Array:
    return np.stack(flip_vector(tuple(vectors.T)), axis=1)


def true_path(truth: captured.Odometry, t: Array, markers: float) -> Array:
    """
    Return the true states at some times, (n, 13), as of ``cramer_rao.SampledFlight``.

    Parameters
    ----------
    truth
        Of the motion capture; gaps are bridged by straight lines.
    t : (n,) s
    markers : m
        Height of the markers above the range sensor, NaN: none.

    """
    known = np.isfinite(np.hstack(truth[1:])).all(axis=1)
    stamps = np.rint(t * 1e9).astype(np.int64)
    position, velocity, q = (
        interpolate(stamps, truth.stamp[known], column[known], math.inf) for column in truth[1:])
    position[:, 2] -= 0.0 if math.isnan(markers) else markers
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    turn = Rotation.from_quat(q)
    rate = np.zeros_like(position)
    rate[:-1] = (turn[:-1].inv() * turn[1:]).as_rotvec() / np.diff(t)[:, None]
    return np.hstack([_ned(position), _ned(velocity), q[:, 3:], _ned(q[:, :3]), _ned(rate)])


def sampled(
    s: offline_replay.Steps, state: Array, t: Array, p: JointParams,
) -> tuple[cramer_rao.SampledFlight, Array]:
    """
    Return a path with the samples of a recording, and the shares of lost inertial samples.

    Parameters
    ----------
    s
        Steps of the recording.
    state : (n, 13)
        True states.
    t : (n,) s
        Their times, evenly spaced.
    p
        Ranges in which the sensors are used.

    Returns
    -------
    flight
        Each sample at the nearest time.
    held : (n, 2)
        Shares of rate and force that are lost in the step that ends at each time, 0 to 1.

    """
    at = np.rint((s.t * 1e-9 - t[0]) / DT).astype(int)
    inside = (at >= 0) & (at < len(t))
    height = -state[:, 2]

    def seen(column: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
        out = np.zeros(len(t), np.bool_)
        out[at[inside & np.isfinite(column)]] = True
        return out & usable
    true = Rotation.from_quat(state[:, [7, 8, 9, 6]])
    velocity = true.apply(state[:, 3:6])
    force = true.inv().apply(np.gradient(velocity, DT, axis=0) - [0.0, 0.0, p.gravity])
    everywhere = np.ones(len(t), np.bool_)
    flight = cramer_rao.SampledFlight(
        state, force, seen(s.flow[:, 0], height >= p.optical_flow.min_height),
        seen(s.sonar, (height >= p.sonar.min_range) & (height <= p.sonar.max_range)),
        seen(s.pressure, everywhere & p.barometer.enabled))
    held = np.zeros((len(t), 2))
    for first, last, step, gyro, accel in zip(
            at[:-1], at[1:], s.dt[1:], s.gyro[1:], s.accel[1:], strict=True):
        lost = 1.0 - bridge(step, p.motion.held_time) if step > p.imu.max_interval else 0.0
        held[max(first + 1, 0):max(last + 1, 0)] = [
            lost if np.isfinite(gyro).all() else 1.0, lost if np.isfinite(accel).all() else 1.0]
    return flight, held


def _runs(held: Array) -> Iterator[slice]:
    """Return the runs of rows with equal shares, each with the row before it."""
    edges = np.flatnonzero(np.any(np.diff(held, axis=0) != 0.0, axis=1)) + 1
    edges = [1, *(int(edge) for edge in edges if edge > 1), len(held)]
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        yield slice(first - 1, last)


def covariances(
    flight: cramer_rao.SampledFlight, held: Array, known: Array, p: JointParams,
) -> Array:
    """
    Return the bound at each step, (n, SIZE, SIZE).

    Parameters
    ----------
    flight, held
        Of :func:`sampled`.
    known : (SIZE, SIZE)
        Covariance at the first step.
    p
        Noise, and true values of the parameters that the filter estimates.

    """
    f, m = p.optical_flow, p.motion
    true = cramer_rao.TrueParameters(f.scale, f.slope, p.drag.coefficient, f.latency)
    none = replace(p.drag, min_height=FAR)
    out, P = np.empty((len(held), SIZE, SIZE)), known.copy()
    for rows in _runs(held):
        gyro, accel = held[rows.start + 1]
        drag = p.drag if p.drag.enabled and gyro == 0.0 and accel == 0.0 else none
        noise = replace(p, drag=drag, motion=replace(
            m, gyro_noise=math.hypot(m.gyro_noise, math.sqrt(gyro) * m.held_gyro_noise),
            accel_noise=math.hypot(m.accel_noise, math.sqrt(accel) * m.held_accel_noise)))
        part = np.empty((rows.stop - rows.start, SIZE, SIZE))
        cramer_rao.covariances(
            cramer_rao.SampledFlight(*(column[rows] for column in flight)), 0, P, DT, true,
            noise.values(), part)
        P = part[-1].copy()
        P[VELOCITY + 2, VELOCITY + 2] += accel * m.held_thrust_noise ** 2 * DT * (len(part) - 1)
        out[rows], out[rows.stop - 1] = part, P
    return out


def _variance(P: Array, first: int, count: int) -> Array:
    """Return the summed variances of some components at each step, (n,)."""
    return np.trace(P[:, first:first + count, first:first + count], axis1=1, axis2=2)


def of_bag(bag: Bag, p: JointParams) -> tuple[float, list[Line]]:
    """
    Return the duration in the air, s, and bound and errors of a recording.

    Raises
    ------
    BagError
        If the recording has no complete step, or lasts too long.

    """
    steps, posed = offline_replay.steps(bag), bag[topics.OPTITRACK.name].stamp
    if not len(steps.t):
        raise offline_replay.nothing_complete(bag)
    if len(posed) < 2 or int(posed.max()) - int(posed.min()) > SPAN * 1e9:
        raise BagError(f'{bag.path}: {topics.OPTITRACK.name} has fewer than 2 poses, or lasts '
                       f'longer than {SPAN:g} s')
    truth = captured.mocap_truth(bag)
    markers = captured.range_offset(bag)
    start, end = captured.airborne(truth)
    start, end = max(start, steps.t[0] * 1e-9), min(end, steps.t[-1] * 1e-9)
    if not 1.0 <= end - start <= LONGEST:
        raise BagError(f'{bag.path}: sensors and motion capture share {end - start:.1f} s in the '
                       f'air; 1 to {LONGEST:g} s are needed')
    t = np.arange(start, end, DT)
    made = filter_run.run(steps, p)
    known = made.P[int(np.searchsorted(steps.t, start * 1e9, 'right')) - 1]
    flight, held = sampled(steps, true_path(truth, t, markers), t, p)
    P = covariances(flight, held, known, p)
    reached = captured.errors(captured.replayed(bag, p), truth, markers=markers)
    along = {first: math.sqrt(float(np.mean(_variance(P, first, count)))) for first, count in (
        (POSITION, 2), (POSITION + 2, 1), (VELOCITY, 2), (ATTITUDE, 2))}
    return reached.duration, [
        Line('horizontal position', 'm', along[POSITION], reached.horizontal),
        Line('drift at the end', 'm', math.sqrt(float(_variance(P[-1:], POSITION, 2)[0])),
             reached.drift),
        Line('height', 'm', along[POSITION + 2], reached.height),
        Line('horizontal velocity', 'm/s', along[VELOCITY], reached.velocity),
        Line('tilt', 'deg', math.degrees(along[ATTITUDE]), reached.tilt)]


def table(name: str, duration: float, lines: list[Line]) -> str:
    """Return the comparison as text."""
    out = [f'{name}, {duration:.1f} s in the air', f'{"":<27}{"bound":>10}{"reached":>10}'
           f'{"ratio":>8}']
    for line in lines:
        ratio = line.reached / line.bound if line.bound > 0.0 else math.nan
        out.append(f'{f"{line.name} [{line.unit}]":<27}{line.bound:>10.4g}{line.reached:>10.4g}'
                   f'{ratio:>8.2f}')
    return '\n'.join(out)


def notes(bag: Bag, origin: str, lines: list[Line]) -> list[str]:
    """Return what to know of a comparison: sensors that are not there, ratios beyond chance."""
    out = [f'parameters of {origin}']
    if missing := [name for name in AIDING if name not in bag]:
        out.append(f'no {", ".join(missing)} in the bag: bound and filter are without')
    if any(line.reached > CHANCE * line.bound for line in lines):
        out.append(f'more than {CHANCE:g} times a bound is not chance: the filter has not '
                   'converged, or these are not the noise and the priors of this recording')
    return out


def is_recording(name: str, namespace: str | None = None) -> bool:
    """Return whether a name is that of a bag with motion capture and without ground truth."""
    if not from_bag.is_bag(name):
        return False
    bag = read_bag(Path(name), namespace=namespace)
    return topics.GROUND_TRUTH.name not in bag and topics.OPTITRACK.name in bag


def _run(options: argparse.Namespace) -> None:
    if not is_recording(options.scenario, options.namespace):
        for name in ('parameters', 'namespace'):
            if getattr(options, name) is not None:
                raise InputError(f'{options.scenario}: --{name} is for a real recording with '
                                 'motion capture; a scenario has its own')
        bound.compare(options)
        return
    if given := bound.flown_already(options, 'beside'):
        raise InputError(f'{options.scenario}: a recording has been flown: leave out '
                         f'{", ".join(given)}')
    bag = read_bag(Path(options.scenario), namespace=options.namespace)
    if wrong := estimate_checks.turning(bag):
        raise BagError(f'{bag.path}: {wrong[0]}')
    node, origin = chosen(bag, options.parameters)
    duration, lines = of_bag(bag, node.joint)
    said = notes(bag, origin, lines)
    if options.json:
        write_json(options.json, json.dumps({
            'duration': duration, 'quantities': [line._asdict() for line in lines],
            'notes': said}, indent=1))
    if options.json != '-':
        print(table(options.scenario, duration, lines), *said, sep='\n')


def parser() -> Parser:
    """Return the command line."""
    out = bound.parser('bag of a simulated flight, or of a real one with motion capture')
    out.description = f'{bound.__doc__.strip()}\n\n{__doc__.strip().partition(chr(10))[2].strip()}'
    out.add_argument('--parameters', type=Path, metavar='FILE',
                     help='scenario file with noise and priors of the sensors of a recording '
                          '(default: that of the bag)')
    out.add_argument('--namespace', help='of the drone, if a recording has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``bound``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('bound', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
