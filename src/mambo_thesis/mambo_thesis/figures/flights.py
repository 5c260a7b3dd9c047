"""Flights of the scenario files, flown in one process, and the quantities figures measure."""

from __future__ import annotations

import cmath
import functools
import math

from mambo_flight import closed_loop, offline_replay, scenario_file
from mambo_flight.scenario import replaced, Scenario
from mambo_signals import metrics
import numpy as np
from numpy.typing import NDArray

from . import truths

Array = NDArray[np.float64]

STEP = 0.005  # s
X, Y, Z = range(3)


class Flight:
    """
    One flight of a scenario.

    Attributes
    ----------
    scenario
        The scenario flown.
    recording
        The whole flight, see :class:`mambo_flight.closed_loop.Recording`.
    t : (n,) s

    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.recording = closed_loop.fly(scenario)
        self.t = self.recording.t * 1e-9

    @property
    def truth(self) -> Array:
        """Return the true position, (n, 3) m, inertial NED."""
        return self.recording.truth[:, :3]

    @property
    def estimate(self) -> Array:
        """Return the estimated position, (n, 3) m, inertial NED."""
        return self.recording.estimate[:, :3]

    @property
    def reference(self) -> Array:
        """Return the reference position, (n, 3) m, inertial NED."""
        return self.recording.reference[:, :3]

    @property
    def error(self) -> Array:
        """Return estimate minus truth, (n, 3) m."""
        return self.estimate - self.truth

    def after(self, begin: float, end: float = math.inf) -> NDArray[np.bool_]:
        """Return a mask of the rows with begin <= t < end, (n,)."""
        return (self.t >= begin) & (self.t < end)

    def estimated_by(self, other: Scenario) -> Array:
        """Return the position estimated from its samples with another scenario's estimator."""
        return offline_replay.estimate_again(self.recording, other.estimator_node)[:, :3]

    def integrated_flow(self) -> Array:
        """Return the integral of the raw flow, (n, 2) rad; each sample is held until the next."""
        return np.cumsum(hold_last_sample(self.recording.flow[:, :2]), axis=0) * STEP

    def flow_times_height(self, factor: float) -> Array:
        """
        Return the integral of flow times true height times a factor, (n, 2) m, body axes.

        Appendix C examines the factor this way. Flow below 0.4 m is ignored.
        """
        height = -self.truth[:, Z]
        flow = np.where(height[:, None] > 0.4, hold_last_sample(self.recording.flow[:, :2]), 0.0)
        return np.cumsum(flow * (factor * height)[:, None], axis=0) * STEP


def fly(name: str, seed: int | None = None, changes: tuple[tuple[str, float], ...] = ()) -> Flight:
    """
    Return the flight of a scenario such as ``fig_5_11`` or ``fig_6_1/simulation``; cached.

    Parameters
    ----------
    name, seed
        Name of the scenario, and seed; None: the seed in its file.
    changes
        New values of parameters of the scenario.

    """
    over = {} if seed is None else {'seed': scenario_file.Place(seed, '--seed')}
    flight = _scenario(name, tuple(over.items()))
    return _flown(name, seed, changes, truths.mutation_of(name, flight))


@functools.cache
def _scenario(name: str, over: tuple[tuple[str, scenario_file.Place], ...]) -> Scenario:
    return scenario_file.load(name, dict(over))[1]


@functools.lru_cache(maxsize=100)  # of 6 MB each
def _flown(
    name: str, seed: int | None, changes: tuple[tuple[str, float], ...], truth: str,
) -> Flight:
    over = () if seed is None else (('seed', scenario_file.Place(seed, '--seed')),)
    flight = replaced(_scenario(name, over), dict(changes))
    if truth:
        flight = truths.mutate(flight, truths.MUTATIONS[truth])
    return Flight(flight)


def seeds(name: str) -> list[Flight]:
    """Return the flights of a scenario, one for each seed of :mod:`truths`."""
    return [fly(name, seed) for seed in truths.seeds()]


def hold_last_sample(samples: Array) -> Array:
    """Replace missing (NaN) rows of samples, (n, k), by the last valid one, or 0 before any."""
    valid = np.isfinite(samples[:, 0])
    newest = np.maximum.accumulate(np.where(valid, np.arange(len(samples)), -1))
    return np.where(newest[:, None] >= 0, samples[newest], 0.0)


def first_time(t: Array, holds: NDArray[np.bool_]) -> float:
    """Return the first time, s, at which a condition holds; infinite if it never does."""
    return float(t[np.argmax(holds)]) if holds.any() else math.inf


def settling_time(t: Array, small: NDArray[np.bool_]) -> float:
    """Return the time, s, from which a condition holds until the end; infinite if it does not."""
    violated = np.flatnonzero(~small)
    if not len(violated):
        return float(t[0])
    return float(t[violated[-1] + 1]) if violated[-1] + 1 < len(t) else math.inf


def rms(x: Array) -> float:
    """Return the root mean square of all elements of an array."""
    return float(np.sqrt(np.mean(np.square(x))))


def running_rms(x: Array) -> Array:
    """Return the RMS of each column over all rows so far, as the thesis plots it."""
    rows = np.arange(len(x))
    return np.stack([metrics.running_rms(rows, column[:, None]) for column in x.T], axis=1)


def harmonic(t: Array, x: Array, rate: float = 1.0, turns: int = 2) -> complex:
    """Fit a harmonic at a rate [rad/s] plus a line to the last turns; return its amplitude."""
    last = t > t[-1] - turns * 2.0 * math.pi / rate
    t, x = t[last], x[last]
    waves = np.stack([np.cos(rate * t), -np.sin(rate * t), np.ones_like(t), t], axis=1)
    cosine, sine = np.linalg.lstsq(waves, x, rcond=None)[0][:2]
    return complex(cosine, sine)


def lag(flight: Flight, axis: int) -> float:
    """Return the phase lag of the estimate behind the reference at 1 rad/s, deg."""
    estimate, reference = (
        harmonic(flight.t, rows[:, axis]) for rows in (flight.estimate, flight.reference))
    return -math.degrees(cmath.phase(estimate / reference))


def drift(x: Array, rate: float = 1.0, turns: int = 4) -> Array:
    """Return the mean change of x, (n, ...), per turn at a rate [rad/s] over the last turns."""
    return (x[-1] - x[-1 - round(turns * 2.0 * math.pi / rate / STEP)]) / turns
