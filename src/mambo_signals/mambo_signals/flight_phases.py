"""Phases of a flight: end of the take-off and start of the landing, recorded or detected."""

from __future__ import annotations

from typing import Any, NamedTuple

from mambo_bags.reader import Bag
from mambo_model.motion.rigid_body import LIFTED
import numpy as np

from . import time_offset
from .derivative import local_fit
from .motion import Motion
from .resample import runs

BLEND = 3.0  # [s] assumed duration of the blend to the trajectory, if the bag does not hold it
LEVEL = 0.1  # [m/s] largest vertical speed of a vehicle that keeps its height
SETTLED = 0.5  # [s] time for which it must keep its height
EVEN = 0.05  # [s] step of the time grid
UNSEEN = 100_000_000  # [ns] between two references, above which a change has no time
MOST = 4  # landings that are listed
LATE = 500_000_000
"""
Time [ns] by which a topic may begin after a flight, or end before it.

Loggers and nodes that an operator stops one by one end some tenths of a second apart. In the air
the steady topics of the public recordings end within 0.01 s of each other.
"""


class Phases(NamedTuple):
    """Stamps [ns] of the phases of a flight; None if unknown."""

    takeoff_end: int | None
    landing_start: int | None
    how: str  # how the end of the take-off was determined, '{}' in place of each stamp below
    liftoff: int | None = None
    told: tuple[int, ...] = ()  # stamps in this text
    end: int | None = None  # of the flight or its recording

    @property
    def text(self) -> str:
        """Return how the end of the take-off was determined."""
        return self.how.format(*(f'{stamp * 1e-9:.2f}' for stamp in self.told))

    def parts(self) -> list[tuple[str, int | None, int | None]]:
        """Return the parts as (name, begin, end) with begin <= stamp < end; None: no limit."""
        out: list[tuple[str, int | None, int | None]] = [('whole flight', None, None)]
        if self.takeoff_end is not None:
            out.append(('take-off', None, self.takeoff_end))
            out.append(('after take-off', self.takeoff_end, self.landing_start))
            if self.landing_start is not None:
                out.append(('landing', self.landing_start, None))
        return out

    def moved(self, offset: int) -> Phases:
        """Return the same parts on a clock that is ahead by an offset [ns]."""
        takeoff_end, landing_start, liftoff, end = (
            None if stamp is None else stamp + offset
            for stamp in (self.takeoff_end, self.landing_start, self.liftoff, self.end))
        return Phases(takeoff_end, landing_start, self.how, liftoff,
                      tuple(stamp + offset for stamp in self.told), end)

    def goes_on(self, stamp: int) -> bool:
        """Return whether the flight is known to last longer than to a stamp [ns], by LATE."""
        return self.end is not None and stamp < self.end - LATE


def _literal(text: str) -> str:
    """Return a text in which braces stand for themselves."""
    return text.replace('{', '{{').replace('}', '}}')


def _plan(content: Any) -> dict[str, float]:
    """Return the mapping inside a scenario that holds ``blend_duration``, or an empty one."""
    if isinstance(content, dict):
        if isinstance(content.get('blend_duration'), (int, float)):
            return content
        for inner in content.values():
            if found := _plan(inner):
                return found
    return {}


def _stood(bag: Bag) -> bool:
    """Return whether the true position in a bag stays on the floor, rho_z = 0."""
    if 'ground_truth/odom' not in bag:
        return False
    return bool((np.abs(bag['ground_truth/odom'].position[:, 2]) <= LIFTED).all())


def phases(bag: Bag) -> Phases:
    """
    Return end of the take-off and start of the landing from the phases of the reference.

    The take-off ends with its blend, or earlier with a landing. The landing is the last one: a
    vehicle may go on after one that is cancelled, or take off again.
    """
    if 'reference' not in bag:
        return Phases(None, None, '')
    reference = bag['reference']
    phase, stamps = reference.phase, reference.stamp
    track = phase == reference.constant('PHASE_TRACK')
    climbing = phase == reference.constant('PHASE_TAKEOFF')
    landing = np.isin(
        phase, (reference.constant('PHASE_LANDING'), reference.constant('PHASE_LANDED')))
    begins = runs(landing)[:, 0]
    flying = np.flatnonzero(track | climbing)
    last = begins[begins > flying[-1]] if len(flying) else begins
    landing_start = int(stamps[last[0]]) if len(last) else None
    liftoff = int(stamps[climbing][0]) if climbing.any() else None
    if liftoff is not None and _stood(bag):
        return Phases(None, None, 'the vehicle never took off: it stayed on the floor')
    if not track.any():
        return Phases(None, landing_start, 'the trajectory is never reached', liftoff)
    first = int(track.argmax())
    begin = int(stamps[first])
    between = stamps[begins[(begins > first) & (begins < flying[-1])]]
    listed = tuple(between[:MOST].tolist())
    again = '' if not len(between) else (
        f'; it flies on after a landing begun at {", ".join("{}" for _ in listed)}'
        f'{", ..." if len(between) > MOST else ""} s')
    if not first:
        return Phases(begin, landing_start,
                      f'no take-off: on the trajectory from the start{again}', told=listed)
    if begin - int(stamps[first - 1]) > max(UNSEEN, 3.0 * np.median(np.diff(stamps))):
        return Phases(
            None, landing_start, 'no end of the take-off found: phase TRACK begins between '
            '{} and {} s, which was not recorded', liftoff, (int(stamps[first - 1]), begin))
    blend = _plan(bag.scenario).get('blend_duration')
    seconds = BLEND if blend is None else float(blend)
    ends = [begin + round(seconds * 1e9), *between.tolist(), *filter(None, [landing_start])]
    return Phases(
        min(ends), landing_start,
        f'phase TRACK from {{}} s and {seconds:g} s of blend'
        f'{", cut short by a landing" if min(ends) < ends[0] else ""}'
        f'{" (assumed: the bag does not hold it)" if blend is None else ""}{again}', liftoff,
        (begin, *listed))


def detect_phases(motion: Motion) -> Phases:
    """
    Detect take-off and landing in the height of a flight.

    The take-off begins and the landing ends on the ground
    (:func:`mambo_signals.time_offset.flight_by_position`). The take-off ends when the vertical
    speed first stays below ``LEVEL`` for ``SETTLED``. The landing begins with the last descent. A
    recording that begins in the air has no take-off.
    """
    t = motion.stamps * 1e-9
    try:
        takeoff, touchdown, _ = time_offset.flight_by_position(t, motion.position)
    except time_offset.AlignError as error:
        return Phases(None, None, 'no take-off found: ' + _literal(str(error)))
    if takeoff is None:
        return Phases(None, None, 'no take-off found: the recording begins in the air')
    even = np.arange(takeoff, t[-1] if touchdown is None else touchdown, EVEN)
    z, speed = (x[:, 0] for x in local_fit(t, motion.position[:, 2:], even, 2.0 * EVEN))
    window = round(SETTLED / EVEN)
    fast = np.cumsum(~(np.abs(speed) <= LEVEL))  # unknown in a gap
    level = np.flatnonzero(fast[window:] == fast[:-window]) if len(fast) > window else fast[:0]
    high = z > 0.5 * (np.nanmin(z) + np.nanmax(z)) if np.isfinite(z).any() else z > 0.0
    level = level[high[level]]
    liftoff = round(takeoff * 1e9)
    if not len(level):
        return Phases(None, None, 'no end of the take-off found: no height is kept', liftoff)
    landing = None
    if touchdown is not None:
        steady = np.flatnonzero((speed > -0.5 * LEVEL) & high)
        landing = round(even[max(steady[-1], level[0])] * 1e9)
    return Phases(round(even[level[0]] * 1e9), landing,
                  f'detected in the height of {_literal(motion.name)}, which is first constant '
                  'then',
                  liftoff)
