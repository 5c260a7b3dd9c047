"""
Rotor drag by fitting simulated flights to a recorded flight (section 6.3, chapter 7).

The whole loop is flown, the estimator included, without noise, and only the drag of the true
vehicle changes; positions are those of Optitrack. An offset and a steady drift of every axis are
attributed to the estimator, a turn about z and lateness to the motion capture
(:mod:`.placement`). A wrong unit, a mirrored frame or another flight is no drag either: the
coefficient must explain what it is fitted to (:func:`_refuse_unexplained`).

What is left is the path of a vehicle that follows its estimate, hence no noise that one record
could describe. The interval is therefore that of simulated flights with noise, of other seeds,
each fitted like the real one (a parametric bootstrap); where the flight leaves more than any of
them the interval is wider by as much.

For a bag that holds no scenario the drag is that of the accelerometer (:mod:`.from_flight`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
import math
from pathlib import Path
from typing import NamedTuple

from mambo_bags.cli.option_types import real, TIME
from mambo_bags.command import Parser
from mambo_flight import closed_loop
from mambo_flight.scenario import load, override, Scenario
from mambo_model import palette
from mambo_model.frames import flip_vector
from mambo_signals import resample
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from . import from_flight, regression, result
from .base import based, choose, flown
from .placement import effects, LATEST, place, Placement, seen, without
from .regression import IdentifyError, LEVEL, Value

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP = 10              # control steps of 5 ms between two compared positions: 20 Hz
GAP = 50_000_000       # ns, over which poses are connected
LEAST = 100            # positions
VEHICLE = 'sim_node.simulator.vehicle'
GUESSES = (0.0, 0.1, 0.3, 1.0)  # s/m, of which the best begins the search
FLIGHTS = 20           # with noise
STEEP = 0.03           # s/m, for a slope: gates of the filters roughen smaller changes
LARGEST = 2.0          # s/m: a vehicle that loses its speed in 0.2 s does not fly a circle
AT_BOUND = 1e-3        # s/m, of it: the search ended there
SCALE = 0.05           # [-]: captures are calibrated to 0.5 %, units differ by 2 or more


METHOD = ('interval of 95 %: spread of fits to 20 simulated flights with noise (parametric '
          'bootstrap), wider where the flight leaves more than any of them, Student t')


class Part(NamedTuple):
    """A drag coefficient and the axes that it is identified from."""

    name: str               # in Vehicle
    symbol: str
    axes: tuple[int, ...]   # of the inertial frame
    cure: str               # if a flight does not show it


PARTS = {
    'horizontal': Part(
        'drag_coefficient', 'k_c', (0, 1), 'fly a circle or a sine, at 1 m/s or more'),
    'vertical': Part(
        'vertical_drag_coefficient', 'k_z', (2,), 'fly up and down, z_sine say')}


class Track(NamedTuple):
    """Positions of a motion capture in the clock of the flight."""

    t: Ints           # (n,) ns, rising, from the start of the flight
    position: Floats  # (n, 3) m, inertial NED


class Drag(NamedTuple):
    """A coefficient, and the flights with and without it."""

    coefficient: Value      # s/m
    t: Floats               # (m,) s
    measured: Floats        # (m, k) m, of the axes of the part
    simulated: Floats       # (m, k) m, as fitted, with offset and drift
    without: float          # m, rms of what is left with a coefficient of 0
    fit: regression.Fit
    place: Placement        # of the motion capture


def from_recording(recording: closed_loop.Recording) -> Track:
    """Return the track of a simulated flight, from its Optitrack."""
    seen = np.isfinite(recording.pose[:, 0])
    return Track(recording.pose_t[seen], recording.pose[seen, :3])


def window(flight: Scenario) -> tuple[float, float]:
    """Return begin and end of the time in the air, s: after take-off, before landing."""
    plan = flight.reference_node.plan
    end = plan.landing_time if plan.landing_time > 0.0 else flight.sim_node.duration
    return plan.takeoff_time + 0.5, end


def _silent(flight: Scenario) -> Scenario:
    """
    Return a flight whose sensors have no noise.

    Such sensors repeat a number to the bit while the vehicle holds its height; the estimator must
    not take them for dead ones, or some coefficients end in a failsafe landing.
    """
    sensors = 'imu', 'sonar', 'optical_flow', 'barometer'
    return override(flight, {
        'sim_node.simulator.noise': False, 'optitrack_node.optitrack.noise': False,
        **{f'estimator_node.{one}.{sensor}.stuck_samples': 0
           for one in ('kalman', 'joint') for sensor in sensors}})


def fit_drag(
    track: Track, flight: Scenario, part: str = 'horizontal', start: float | None = None,
    end: float | None = None,
) -> Drag:
    """
    Fit a coefficient of the lumped drag to a flight.

    Parameters
    ----------
    track
        Where the vehicle was.
    flight
        What it flew, and with which vehicle otherwise; its own coefficient does not matter.
    part
        ``horizontal``, k_c of (3.13), or ``vertical``, k_z.
    start, end : s
        What of the flight to compare; default: :func:`window`.

    Raises
    ------
    IdentifyError
        For a track that is no flight, too short, or shows no drag.

    """
    what, silent = PARTS[part], _silent(flight)
    default = window(flight)
    rows = _rows(track, flight, default[0] if start is None else start,
                 default[1] if end is None else end)
    at = rows * closed_loop.STEP_NS
    measured = resample.interpolate(at, track.t, track.position[:, list(what.axes)], GAP)
    known = np.isfinite(measured).all(axis=1)
    if known.sum() < LEAST:
        raise IdentifyError(
            f'{int(known.sum())} positions to compare, at least {LEAST} are needed: '
            f'{len(rows)} steps of 50 ms, {len(track.t)} poses')
    rows, measured, t = rows[known], measured[known], at[known] * 1e-9
    axes = list(what.axes)
    terms = np.stack([np.ones(len(t)), (t - t.mean()) / np.ptp(t)], axis=1)

    @cache  # both searches begin with the same flights
    def path(k: float) -> Floats:
        """Return the path of a vehicle with this drag, (n, k) m."""
        return closed_loop.fly(override(silent, {f'{VEHICLE}.{what.name}': k})).truth[:, axes]

    def model(theta: Floats, scaled: bool = False) -> Floats:
        """Return what the capture sees of 1 + k, (m, k) m: relative steps are those of k at 0."""
        flown = path(float(theta[0]) - 1.0)
        return seen(flown, rows, place(flown, rows, measured, terms, scaled))[0]

    def search(scaled: bool) -> tuple[regression.Fit, list[float]]:
        """Return the fit, and the rms of what is left at each of GUESSES."""
        rest = [_rms(without(terms, measured - model(np.array([1.0 + guess]), scaled)))
                for guess in GUESSES]
        return regression.fit(
            lambda theta: model(theta, scaled), measured,
            [1.0 + max(GUESSES[int(np.argmin(rest))], STEEP)], [1.0], [1.0 + LARGEST],
            [what.symbol], terms, step=STEEP, colour=False, tolerance=1e-5), rest
    found, rest = search(False)
    k = float(found.theta[0]) - 1.0
    placed = place(path(k), rows, measured, terms)
    value = _interval(found, flight, what, rows, terms, path, placed)
    free = search(True)[0]
    scale = place(path(float(free.theta[0]) - 1.0), rows, measured, terms, True).scale
    _refuse_unexplained(what, value, found, rest[0], placed, (free.rms, scale))
    return Drag(value, t, measured, measured - found.residual, rest[0], found, placed)


def _refuse_unexplained(
    part: Part, value: Value, found: regression.Fit, least: float, placed: Placement,
    free: tuple[float, float],
) -> None:
    """
    Refuse a coefficient that does not explain the flight.

    Parameters
    ----------
    value, found
        Of the coefficient.
    least : m
        rms of what is left with a coefficient of 0.
    free
        rms of what is left with a free scale, m, and the scale.

    """
    check = 'check unit (m), axes (z up) and clock of the motion capture, and the scenario'
    rms, scale = free
    # of two fits that noise alone tells apart neither leaves half of what the other does
    if abs(scale - 1.0) > SCALE and rms < 0.5 * found.rms:
        raise IdentifyError(
            f'the flight is {scale:.3g} times as large as that of the scenario, which no '
            f'{part.symbol} explains: {check}')
    if abs(placed.late) >= LATEST:
        raise IdentifyError(
            f'the flight is not that of the scenario, up to {LATEST:g} s late or early: {check}; '
            'a clock that is further off needs --shift')
    if value.value > LARGEST - AT_BOUND:
        raise IdentifyError(
            f'{part.symbol} is at the end of its range, {LARGEST:g} s/m: {check}')
    if value.half > 0.5 * LARGEST:
        raise IdentifyError(f'this flight does not show {part.symbol}: {part.cure}')
    if value.low > 0.0 and not _falls(found.residual, least):
        raise IdentifyError(
            f'{part.symbol} hardly explains the flight: {found.rms:.3g} m rms are left with it, '
            f'{least:.3g} m without: {check}')


def _falls(residual: Floats, least: float) -> bool:
    """
    Return whether what is left, (m, k) m, is less than without the coefficient, ``least`` m rms.

    F test of one parameter. A residual that is correlated in time counts as fewer samples
    (Bayley and Hammersley 1946).
    """
    count, together = len(residual), 0.0
    for column in (residual - residual.mean(axis=0)).T:
        r = np.correlate(column, column, 'full')[count - 1:] / max(float(column @ column), 1e-30)
        end = int(np.argmax(r <= 0.0)) or count
        together += count / (1.0 + 2.0 * float(np.sum(r[1:end])))
    freedom = max(together - 3.0 * residual.shape[1], 1.0)
    ratio = (least ** 2 / max(_rms(residual) ** 2, 1e-30) - 1.0) * freedom
    return bool(ratio > stats.f.ppf(LEVEL, 1, freedom))


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x ** 2)))


def _interval(
    found: regression.Fit, flight: Scenario, part: Part, rows: Ints, terms: Floats,
    path: Callable[[float], Floats], placed: Placement,
) -> Value:
    """Return the coefficient with its interval, from flights with noise and other seeds."""
    k, axes = float(found.theta[0]) - 1.0, list(part.axes)
    flown = path(k)
    clean, velocity = seen(flown, rows, placed)
    moved = np.stack([without(terms, x).ravel() for x in effects(clean, velocity)], axis=1)

    def rest(x: Floats) -> Floats:
        """Return x (m, k) without what offset, drift and placement explain."""
        return without(moved, without(terms, x).reshape(-1, 1)).reshape(x.shape)
    slope = rest((seen(path(k + STEEP), rows, placed)[0] - clean) / STEEP)
    clean = flown[rows]
    errors, left = [], []
    for number in range(FLIGHTS):
        seed = (flight.seed + 1_000_003 * (number + 1)) % 2 ** 31
        noisy = closed_loop.fly(override(flight, {
            f'{VEHICLE}.{part.name}': k, 'sim_node.simulator.seed': seed,
            'optitrack_node.seed': seed}))
        track = from_recording(noisy)
        there = resample.interpolate(
            rows * closed_loop.STEP_NS, track.t, track.position[:, axes], GAP)
        there = np.where(np.isfinite(there), there, noisy.truth[rows][:, axes])
        error = rest(there - clean)
        errors.append(float(np.sum(slope * error) / np.sum(slope ** 2)))
        left.append(_rms(error - errors[-1] * slope))
    wider = max(1.0, found.rms / max(*left, 1e-12))
    quantile = float(stats.t.ppf(0.5 + 0.5 * LEVEL, FLIGHTS - 1))
    half = max(found.half(0), quantile * wider * float(np.sqrt(np.mean(np.square(errors)))))
    return Value(k, max(0.0, k - half), k + half, 's/m')


def _rows(track: Track, flight: Scenario, start: float, end: float) -> Ints:
    """Return the control steps to compare, (m,)."""
    if not flight.sim_node.duration > 0.0:
        raise IdentifyError('the scenario has no duration: set sim_node.duration in seconds')
    if flight.reference_node.plan.trajectory == 'hover':
        raise IdentifyError('a hover shows no drag: fly a circle, or up and down')
    regression.check_columns({'time': track.t, 'position': track.position}, 2)
    regression.check_times(track.t * 1e-9)
    if not np.ptp(track.position, axis=0).max() > 0.05:
        raise IdentifyError('the vehicle stays where it is: this is no flight')
    first, last = (round(x * 1e9 / closed_loop.STEP_NS) for x in (
        start, min(end, flight.sim_node.duration)))
    if last <= first:
        raise IdentifyError(f'nothing to compare between {start:g} and {end:g} s')
    return np.arange(max(first, 0), last + 1, STEP, dtype=np.int64)


def _draw(found: Drag, part: Part) -> Callable[[Figure], None]:
    names = [('x', 'y', 'z')[axis] for axis in part.axes]

    def draw(figure: Figure) -> None:
        """Draw measured and fitted position on each axis, and the residual."""
        rows = figure.subplots(2, len(names), sharex=True, squeeze=False)
        flown, model = palette.lines(['Optitrack', 'simulation'])
        for j, name in enumerate(names):
            above, below = rows[:, j]
            above.plot(found.t, found.measured[:, j], label='Optitrack', **flown)
            above.plot(found.t, found.simulated[:, j], label='simulation', **model)
            above.set_title(f'{name}{" down" * (name == "z")} [m], NED')
            below.plot(found.t, 100.0 * found.fit.residual[:, j], color=palette.INK, lw=0.8)
            below.set_title('residual [cm]')
            below.set_xlabel('time [s]')
        rows[0, 0].legend()
    return draw


def read(
    path: Path, file: Path | None, shift: float, namespace: str | None,
) -> tuple[Track, Scenario | None]:
    """
    Return track, its stamps shifted by some s, and scenario of a bag; None if it holds none.

    Raises
    ------
    IdentifyError, mambo_bags.reader.BagError, mambo_model.schema.ParameterError
        In one line, for what is missing.

    """
    bag = result.open_bag(path, ('optitrack/pose',), namespace)
    if file is None:
        flight = flown(bag)
    else:
        flight = load(file)
    pose = bag['optitrack/pose']
    seen = np.isfinite(pose.position).all(axis=1)
    position = np.array([flip_vector(tuple(p)) for p in pose.position[seen].tolist()])
    return Track(pose.stamp[seen] + round(shift * 1e9), position.reshape(-1, 3)), flight


def parser() -> Parser:
    """Return the command line."""
    out = result.parser(
        'identify_drag', 'Lumped drag by fitting the closed-loop simulation to a flight.')
    out.add_argument('bag', type=Path, help='with optitrack/pose; without a scenario also '
                                            'imu/data_raw and motor_pwm')
    out.add_argument('--part', choices=tuple(PARTS), default='horizontal', help='k_c or k_z')
    out.add_argument('--scenario', type=Path, metavar='FILE',
                     help='what was flown; default: that in the bag')
    out.add_argument('--shift', type=real(-100.0, 100.0, 's'), default=0.0,
                     help='s, added to the stamps of Optitrack if its clock is another')
    out.add_argument('--start', type=TIME, help='s, compare from here; default: in the air')
    out.add_argument('--end', type=TIME, help='s, compare to here; default: landing')
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    from_flight.add_options(out)
    return out


def _unknown_flight(options: argparse.Namespace) -> result.Report:
    """Return the result for a bag that holds no scenario."""
    if options.shift or options.start is not None or options.end is not None:
        raise IdentifyError(
            f'{options.bag}: no scenario in the bag, and --shift, --start and --end need one: '
            'say what was flown with --scenario FILE, or leave them out')
    return from_flight.drag_report(from_flight.read(
        options.bag, options.base, options.mass, options.namespace), options.part)


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_drag``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> result.Report:
        """Read the bag and return the result."""
        track, flight = read(
            options.bag, options.scenario, options.shift, options.namespace)
        if flight is None:
            return _unknown_flight(options)
        base = choose(options.base, flight)
        if options.mass is not None:
            raise IdentifyError('--mass: the scenario of the flight says the mass')
        found = fit_drag(track, flight, options.part, options.start, options.end)
        part, value = PARTS[options.part], found.coefficient
        source = (f'identify_drag, {options.bag.name}, 95 %: {value.low:.4g} to {value.high:.4g}; '
                  f'reading {flight.sim_node.simulator.vehicle.drag_reading}')
        reading = flight.sim_node.simulator.vehicle.drag_reading
        return based(result.Report(
            f'{options.part} drag of {options.bag.name}', {part.symbol: value},
            {'rms residual [m]': found.fit.rms, 'rms without it [m]': found.without,
             'motion capture turned about z of map, up [deg]': math.degrees(
                 flip_vector((0.0, 0.0, found.place.turn))[2]),
             'motion capture late by [s]': found.place.late,
             'positions': len(found.t),
             'drag reading': reading},
            ['all else is as the scenario says: a wrong flow factor moves the circle too; '
             'identify it first',
             'a scale error of the motion capture looks like drag: about 0.01 s/m for 1 %',
             'on a circle a turned and a late motion capture look alike: only both together are '
             'known'],
            {'drag_reading': (reading, 'as the scenario of the flight'),
             part.name: (value.value, source)},
            _draw(found, part), method=METHOD), base)
    return result.run('identify_drag', options, work)


if __name__ == '__main__':
    raise SystemExit(main())
