"""
Verdict on an estimate: absent and refused sensors, divergence, and what contradicts it.

Read from ``estimator/state`` and ``estimate/odom``, live or offline. A divergence is a finding
about the flight, not a failure of the command that found it: exit codes do not depend on it.
"""

from __future__ import annotations

from mambo_bags import playback
from mambo_bags.reader import Bag
from mambo_estimation import health
from mambo_flight.offline_replay import missing, SENSORS
from mambo_ros import topics
from mambo_signals import resample
import numpy as np
from numpy.typing import NDArray

from .estimate_checks import ALIGNING, contradictions

FAR = 0.5  # m, difference between the height and every range, used or refused ...
FAR_TIME = 1.0  # s, ... for this long means divergence
LEAST_UNUSED = 5e-4  # [-] of the steps that is told, with one decimal of a percent
FASTEST = 10.0  # m/s, faster than these vehicles fly
AIDING = ((topics.SONAR, 'sonar_refused'), (topics.OPTICAL_FLOW, 'flow_refused'),
           (topics.BAROMETER, 'barometer_refused'))


def first_long_run(t: NDArray[np.float64], far: NDArray[np.bool_], least: float) -> float:
    """
    Return the begin of the first run of a minimum duration; NaN if there is none.

    Parameters
    ----------
    t : (n,) s
        Ascending.
    far : (n,)
        Which samples belong to a run.
    least : s
        From the first to the last sample of the run.

    """
    for begin, end in resample.runs(far).tolist():
        if t[end - 1] - t[begin] >= least:
            return float(t[begin])
    return float('nan')


def _too_low(bag: Bag, state: Bag) -> NDArray[np.bool_]:
    """
    Return in which steps the floor is nearer than the shortest range of the sonar, (n,).

    By the estimated height and tilt, as a filter tells where a sensor cannot measure. The filters
    use what the sonar reads there, as a bound of the height, so that its health is good.
    """
    inner = state[topics.ESTIMATOR_STATE.name]
    if topics.SONAR.name not in bag or not len(bag[topics.SONAR.name]):
        return np.zeros(len(inner.stamp), bool)
    least = float(np.min(bag[topics.SONAR.name].min_range))
    stamps, first = np.unique(state[topics.ESTIMATE.name].stamp, return_index=True)
    x, y = state[topics.ESTIMATE.name].orientation[first, :2].T
    at = np.searchsorted(stamps, inner.stamp)
    known = np.isin(inner.stamp, stamps)
    low = np.zeros(len(known), bool)
    cosine = 1.0 - 2.0 * (x * x + y * y)[at[known]]
    low[known] = inner['height'][known] < least * cosine
    return low


def _sensors(bag: Bag, state: Bag) -> list[str]:
    """Return one line for each sensor."""
    inner = state[topics.ESTIMATOR_STATE.name]
    unhealthy = (inner['health'] > health.OUT_OF_REACH).mean(axis=0)
    away, good = inner['health'] == health.OUT_OF_REACH, inner['health'] == health.GOOD
    away[:, health.SONAR] |= good[:, health.SONAR] & _too_low(bag, state)
    reach = away.mean(axis=0)
    unused = (inner['age'][inner['status'] != ALIGNING] > 0.0).sum(axis=0) / len(inner.stamp)
    lines = [f'  {name}: unhealthy for {unhealthy[k]:.1%} of the time' + (
        f', without a usable sample in {unused[k]:.1%} of the steps'
        if unused[k] > LEAST_UNUSED else '') for k, name in enumerate(health.NAMES[:health.SONAR])]
    for k, (topic, refused) in enumerate(AIDING, health.SONAR):
        all_ = count = 0
        if topic.name in bag:
            values = SENSORS[topic][1](bag[topic.name])[0]
            all_ = len(values)
            count = int(np.isfinite(values.reshape(all_, -1)).all(axis=1).sum())
        if not count:
            lines.append(f'  {health.NAMES[k]}: ' + (
                f'none of {all_} samples is valid and within its limits: check its unit, '
                'and whether the vehicle flew'
                if all_ else 'absent'))
            continue
        share = min(1.0, int(inner[refused][-1]) / count)
        lines.append(
            f'  {health.NAMES[k]}: {count} samples, {share:.1%} refused; unhealthy for '
            f'{unhealthy[k]:.1%} of the time, out of reach for {reach[k]:.1%}')
    return lines


def _losses(bag: Bag, state: Bag) -> list[str]:
    """Return a line for each topic with too few or too many samples, and one if that ends it."""
    lost = missing(bag)
    lines = [f'  {topic.name}: {len(places)} samples that only repeat the one before, and that no '
             'watermark counts, were left out'
             for topic, places in playback.uncounted(bag, '').items() if places]
    lines += [f'  {name}: {few} of {all_} samples that were published are not in the bag'
             for name, (few, all_) in lost.items()]
    if lost:
        early = bag[topics.SENSOR_TICK.name].stamp[-1] - state[topics.ESTIMATE.name].stamp[-1]
        if early > 0:
            lines.append(f'  the estimate ends {early * 1e-9:.2f} s before the recording, where '
                         'it waits for them')
    return lines


def divergence(state: Bag) -> list[str]:
    """Return the faults of the estimate itself, one line each."""
    inner, odometry = state[topics.ESTIMATOR_STATE.name], state[topics.ESTIMATE.name]
    t = (inner.stamp - inner.stamp[0]) * 1e-9
    innovation = inner['sonar_innovation']
    seen = np.isfinite(innovation)
    far = first_long_run(t[seen], np.abs(innovation[seen]) > FAR, FAR_TIME)
    out = []
    if (inner['status'] == ALIGNING).all():
        out.append('never aligned: the vehicle did not rest, or the inertial samples are unusable')
    if np.isfinite(far):
        out.append(f'height diverged at {far:.2f} s: more than {FAR:g} m from the sonar for '
                   f'{FAR_TIME:g} s or longer')
    speed = np.linalg.norm(odometry['twist.twist.linear'], axis=1)
    fast = np.flatnonzero(~(speed <= FASTEST))
    if len(fast):
        begin = (odometry.stamp[fast[0]] - inner.stamp[0]) * 1e-9
        out.append(f'velocity diverged at {begin:.2f} s: faster than {FASTEST:g} m/s')
    return out


def verdict(bag: Bag, state: Bag) -> str:
    """
    Return the sensors that an estimator could not use, its divergence, and what contradicts it.

    Parameters as of :func:`.estimate_checks.contradictions`.

    Returns
    -------
    text
        Lines; one that says that there is no verdict where ``estimator/state`` is missing.

    """
    if topics.ESTIMATOR_STATE.name not in state or not len(state[topics.ESTIMATOR_STATE.name]):
        return 'verdict: none, as there is no estimator/state'
    wrong, against = divergence(state), contradictions(bag, state)
    head = '; '.join(wrong) if wrong else 'the estimate did not diverge'
    if against:
        head += f'{";" if wrong else ", but is"} contradicted: {"; ".join(against)}'
    head = f'verdict: {head}'
    return '\n'.join((head, *_sensors(bag, state), *_losses(bag, state)))
