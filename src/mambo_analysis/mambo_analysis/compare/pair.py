"""Two recordings of a flight, or two topics of one, quantity by quantity: A minus B."""

from __future__ import annotations

from collections.abc import Collection
import dataclasses
import math
from typing import Any, NamedTuple

from mambo_bags.reader import Bag, BagError
from mambo_signals import clock_check, metrics, motion, resample, time_offset
from mambo_signals.flight_phases import Phases
from mambo_signals.motion import Motion
from mambo_signals.poses import outliers
from mambo_signals.resample import Floats, Ints
import numpy as np

from ..importers.checks import plausible, same_flight, turned
from ..importers.common import quoted, shortened

XYZ = ('x', 'y', 'z')
GRID = 10_000_000  # [ns] sample period for the search of a delay
LEAST = 10  # samples for statistics: the RMS of so few is known to 1 / sqrt(2 n), 22 %
ROUGH_YAW = 0.1  # [rad] largest standard error of a yaw by the paths where no attitude is measured
OTHER = math.radians(10.0)  # [rad] between turns by paths and by attitudes, which is told
MOST = 4.0
"""Unexplained variance of climb rate, speed and yaw rate without a rate of the clocks over that
with it, at least, for a rate that is told [-]. It is 5.7 to 113 for two simulated flights of one
trajectory, of which one has a clock that is 1 % off, and up to 2.5 for 475 pairs of real and
simulated flights on right clocks."""
LEAST_ALIKE = 2
"""Of these signals, how many must be alike: the climb rates of take-off and landing alone, in
flights of other lengths, fit with a rate, too (8.8 of a hover against a circle)."""


WHAT = ('time', 'position', 'yaw')
"""Quantities that can be aligned before two recordings are compared."""


class Alignment(NamedTuple):
    """Alignment of A with B: clock offset [ns], rotation [rad] and translation [m]."""

    offset: int = 0
    turn: float = 0.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    text: str = 'not aligned: clocks and frames are taken as they are'

    def moved(self, a: Motion) -> Motion:
        """Return a motion of A in B's clock and frame."""
        return a.moved(self.offset, self.turn, np.array(self.shift))


def aligned(
    a: Motion, b: Motion, what: Collection[str] = WHAT, equal_at: float | None = None,
) -> Alignment:
    """
    Return the alignment of A with B.

    Parameters
    ----------
    a, b
    what
        Of ``WHAT``: ``time`` by correlation, ``yaw`` by the paths, or by the attitudes where the
        paths are too small and both attitudes are measured; ``position`` by the mean shift.
    equal_at : s
        On B's clock: the positions are made equal there and not on average (section 5.4).

    Raises
    ------
    BagError
        If the two have no time in common, do not move alike, or say nothing at ``equal_at``.

    """
    parts, offset = [], 0
    if 'time' in what:
        try:
            found, _ = time_offset.pose_offset(b, a)
            offset = round(found.offset * 1e9)
            parts.append(f'clock moved by {found.offset:+.4f} s (standard error '
                         f'{found.sigma * 1e3:.1f} ms)')
            parts += _other_rate(a, b)
            parts += same_flight.paths(a.moved(offset, 0.0, np.zeros(3)), b)
        except time_offset.NotExcited as error:
            parts.append(f'clocks taken as they are, as no motion tells their offset ({error})')
        except time_offset.AlignError as error:
            why = '; '.join([str(error), *_other_rate(a, b)])
            raise BagError(f'{why}; take time out of --align to keep the clocks as they are') \
                from None
    here = a.moved(offset, 0.0, np.zeros(3))
    there = b.at(here.stamps)
    if not np.isfinite(there.position).any():
        why = parts[0] if parts else '--align time finds the offset of the clocks'
        raise BagError(f'{_apart(here, b)}; {why}')
    turn = 0.0
    if 'yaw' in what:
        turn, how = _turn(here, there)
        parts.append(f'turned by {math.degrees(turn):+.2f} deg ({how})')
    p = here.moved(0, turn, np.zeros(3)).position
    shift = np.zeros(3)
    if equal_at is not None:
        shift = time_offset.equalised(here.t, there.position, p, equal_at).translation
        parts.append(f'moved by {_metres(shift)}, positions equal at {equal_at:.2f} s')
    elif 'position' in what:
        shift = np.nanmean(there.position - p, axis=0)
        parts.append(f'moved by {_metres(shift)}, positions equal on average')
    return Alignment(offset, turn, (float(shift[0]), float(shift[1]), float(shift[2])),
                     f'A aligned with B: {"; ".join(parts)}' if parts else Alignment().text)


def _other_rate(a: Motion, b: Motion) -> list[str]:
    """Return a line if most of the difference in time of A and B is a rate of their clocks."""
    signals = []
    for one in (b, a):
        found = time_offset.pose_signals(one)
        signals.append(found | {'height': clock_check.climb(*found['height'])})
    rate = clock_check.best_rate({name: (*signals[0][name], *signals[1][name])
                                  for name in signals[0] if name in signals[1]}, MOST, LEAST_ALIKE)
    if rate == 1.0:
        return []
    slow = rate > 1.0
    return [f'the clock of A runs {100.0 * abs(1.0 / rate - 1.0):.2g} % too '
            f'{"slow" if slow else "fast"} for B, or A flew that much '
            f'{"faster" if slow else "slower"}: correct its times, or the errors contain that']


def simulated(bag: Bag) -> bool:
    """Return whether a bag was simulated; all simulated bags share clock and frame."""
    return 'sensor_tick' in bag and 'ground_truth/odom' in bag


def begins_in_air(motion: Motion, stamp: int) -> bool:
    """
    Return whether a vehicle is in the air at a stamp [ns].

    Also where the recording does not show it standing: what hovers all the time may be high. So
    is what lands after the stamp, and takes off again.
    """
    try:
        takeoff = time_offset.flight_by_position(motion.t, motion.position).takeoff
    except time_offset.AlignError:
        return True
    if takeoff is None or stamp * 1e-9 > takeoff:
        return True
    here, ground = motion.values(
        np.array([stamp, round(takeoff * 1e9)]), motion.position[:, 2:])[:, 0]
    return bool(here - ground > time_offset.LEAST_RISE)


def own_origin(a: Motion, b: Motion, in_air: bool) -> Alignment:
    """
    Return the alignment of a motion that has its own origin, on the same clock.

    Position and yaw are made equal at the first common stamp, where an odometry has its origin.
    What begins in the air does not know how high that is, and may find its height later (a
    sonar begins to hear): then the heights are made equal in the median over the flight.

    Raises
    ------
    BagError
        If the two have no time in common.

    """
    there = b.at(a.stamps)
    common = np.flatnonzero(np.isfinite(there.position).all(axis=1))
    if not len(common):
        raise BagError(_apart(a, b))
    first = common[0]
    yaws = np.radians([motion.angles(m.quaternion[first:first + 1])[0, 2] for m in (there, a)])
    turn = float(yaws[0] - yaws[1]) if np.isfinite(yaws).all() else 0.0
    turn = math.remainder(turn, 2.0 * math.pi)
    p = a.moved(0, turn, np.zeros(3)).position
    shift = there.position[first] - p[first]
    if in_air:
        shift[2] = np.median(there.position[common, 2] - p[common, 2])
    text = (f'{a.name} has an origin of its own: {"horizontal " if in_air else ""}position and '
            f'yaw made equal to {b.name} at {a.t[first]:.3f} s (turned by '
            f'{math.degrees(turn):.2f} deg)')
    if in_air:
        text += f'; it begins in the air: height made equal in the median ({shift[2]:+.3f} m)'
    return Alignment(0, turn, (float(shift[0]), float(shift[1]), float(shift[2])), text)


def replay_alignment(bag: Bag, estimate: Motion, truth: Motion) -> Alignment | None:
    """
    Return the alignment of a replayed estimate with the truth; None: same frame.

    They are in a simulation, where the vehicle stands at the origin when the estimator begins.
    """
    start = max(estimate.stamps[0], truth.stamps[0])
    if estimate.frame == truth.frame:
        return None
    if not simulated(bag):
        return own_origin(estimate, truth, begins_in_air(truth, start))
    here = truth.values(np.array([start]), truth.position)
    low = not here[0, 2] > time_offset.LEAST_RISE
    return None if low else own_origin(estimate, truth, True)


def _metres(shift: Floats) -> str:
    return '({:+.3f}, {:+.3f}, {:+.3f}) m'.format(*shift)


def _turn(a: Motion, b: Motion) -> tuple[float, str]:
    """Return the yaw rotation [rad] from A to B at its stamps, and how it was found."""
    without = [f'{m.name} of {side}' for side, m in (('A', a), ('B', b))
               if not motion.has_attitude(m)]
    attitudes = None if without else _turn_by_attitudes(a, b)
    try:
        turn, how = _turn_by_paths(a, b, time_offset.WORST_YAW)
        if attitudes is not None and abs(
                off := math.remainder(turn - attitudes, 2.0 * math.pi)) > OTHER:
            how += (f'; {abs(math.degrees(off)):.0f} deg from the turn of the attitudes: they are '
                    'of other body axes, or a path that repeats, as a circle does, was aligned '
                    'with another part of itself: check the clock, or give --align position')
        return turn, how
    except time_offset.AlignError:
        pass
    if without:
        missing = f'{" and ".join(without)} measured no attitude'
        try:
            turn, how = _turn_by_paths(a, b, ROUGH_YAW)
        except time_offset.AlignError as error:
            raise BagError(f'no yaw found: {error}; {missing}; take yaw out of --align') from None
        return turn, f'{how}; {missing} that could tell it better'
    if attitudes is None:
        raise BagError(f'no yaw found: the paths do not determine it, and {a.name} of A and '
                       f'{b.name} of B have no attitudes at the same time; take yaw out of '
                       '--align')
    return attitudes, (
        'by the attitudes, as the paths are too small or too different to tell it; right only if '
        'both attitudes are of the same body axes')


def _turn_by_attitudes(a: Motion, b: Motion) -> float | None:
    """Return the mean yaw rotation [rad] from A to B at its stamps; None: no time in common."""
    difference = np.radians(
        motion.angles(b.quaternion)[:, 2] - motion.angles(a.quaternion)[:, 2])
    difference = difference[np.isfinite(difference)]
    return float(np.angle(np.exp(1j * difference).mean())) if len(difference) else None


def _turn_by_paths(a: Motion, b: Motion, worst: float) -> tuple[float, str]:
    found = time_offset.registration(b.position, a.position, worst)
    return found.yaw, f'by the paths, standard error {math.degrees(found.sigma_yaw):.2f} deg'


def _apart(a: Motion, b: Motion) -> str:
    spans = ', '.join(f'{m.name} from {m.t[0]:.3f} s to {m.t[-1]:.3f} s' for m in (a, b))
    return f'nothing to compare, no time in common: {spans}'


class Quantity(NamedTuple):
    """
    A quantity of both sides, at the stamps of A.

    Attributes
    ----------
    name, unit
    axes
        Names of the k components.
    stamps : (n,) ns
    a, b, error : (n, k)
        NaN where one of them says nothing. The error is ``a - b``, of an attitude the rotation
        vector from B to A in the axes of B's body, whose length is the angle between them.

    """

    name: str
    unit: str
    axes: tuple[str, ...]
    stamps: Ints
    a: Floats
    b: Floats
    error: Floats


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A comparison: its name and the quantities of both sides."""

    title: str
    labels: tuple[str, str]
    quantities: tuple[Quantity, ...]
    phases: Phases

    def __getitem__(self, name: str) -> Quantity:
        """Return a quantity by its name; KeyError if it was not compared."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def sections(self) -> list[dict[str, Any]]:
        """Return the statistics of every quantity, see :func:`section`."""
        return [section(quantity, self.title, self.phases) for quantity in self.quantities]


def positions(a: Motion, b: Motion) -> Quantity:
    """
    Compare the positions of two motions.

    Raises
    ------
    BagError
        If they have no time in common.

    """
    there = b.values(a.stamps, b.position)
    if not np.isfinite(there).any():
        raise BagError(_apart(a, b))
    return Quantity('position', 'm', XYZ, a.stamps, a.position, there, a.position - there)


def motions(a: Motion, b: Motion) -> list[Quantity]:
    """Compare two motions: position, and velocity and attitude if both have them."""
    out, other = [positions(a, b)], b.at(a.stamps)
    if a.velocity is not None and other.velocity is not None:
        out.append(Quantity('velocity', 'm/s', XYZ, a.stamps, a.velocity, other.velocity,
                            a.velocity - other.velocity))
    back = other.quaternion * np.array([-1.0, -1.0, -1.0, 1.0])
    error = np.degrees(motion.rotation_vectors(motion.product(back, a.quaternion)))
    if np.isfinite(error).any():
        ours, theirs = motion.angles(a.quaternion), motion.angles(other.quaternion)
        gap = np.nanmedian(ours - theirs, axis=0)
        theirs = theirs + 360.0 * np.round(np.where(np.isfinite(gap), gap, 0.0) / 360.0)
        out.append(Quantity(
            'attitude', 'deg', ('roll', 'pitch', 'yaw'), a.stamps, ours, theirs, error))
    return out


def _series(bag: Bag, topic: str, field: str) -> tuple[Ints, Floats] | None:
    """Return stamps and values (n, k) of a field; None if the bag has no such field."""
    if topic not in bag:
        return None
    try:
        values = np.asarray(bag[topic][field], float)
    except (BagError, KeyError, ValueError):
        return None
    stamps, first = np.unique(bag[topic].stamp, return_index=True)
    return stamps, values.reshape(len(bag[topic]), -1)[first]


def commands(a: Bag, b: Bag, offset: int) -> list[Quantity]:
    """Compare the motor commands and the commanded thrust where both bags have them."""
    out = []
    for name, unit, topic, field, axes in (
            ('PWM', '-', 'motor_pwm', 'pwm', ('motor 0', 'motor 1', 'motor 2', 'motor 3')),
            ('thrust', 'N', 'controller/state', 'thrust', ('thrust',))):
        ours, theirs = _series(a, topic, field), _series(b, topic, field)
        if ours is None or theirs is None or ours[1].shape[1] != len(axes) != theirs[1].shape[1]:
            continue
        stamps = ours[0] + offset
        there = resample.interpolate(stamps, *theirs, resample.longest_step(theirs[0]))
        if np.isfinite(there).any():
            out.append(Quantity(name, unit, axes, stamps, ours[1], there, ours[1] - there))
    return out


def _row(name: str, stamps: Ints, errors: Floats) -> dict[str, Any]:
    s, drift = metrics.statistics(errors), metrics.drift(errors)
    last = stamps[np.isfinite(errors).all(axis=1)][-1:]
    return {'part': name, 'count': s.count, 'rms': list(s.rms), 'rms_total': s.rms_total,
            'maximum': list(s.maximum), 'maximum_total': s.maximum_total,
            'drift': drift.tolist(), 'drift_total': float(np.linalg.norm(drift)),
            'drift_at': float(last[0]) * 1e-9 if len(last) else None}


def _delays(quantity: Quantity, inside: np.ndarray) -> list[float | None]:
    """Return the delay of A behind B on each axis [s]; None if it cannot be found."""
    stamps = quantity.stamps[inside]
    if len(np.unique(stamps)) < 2:
        return [None] * len(quantity.axes)
    both = np.concatenate([quantity.a[inside], quantity.b[inside]], axis=1)
    _, even = resample.resampled(stamps, both, GRID, max(resample.longest_step(stamps), GRID))
    k = len(quantity.axes)
    found = [metrics.delay(even[:, i], even[:, k + i], GRID * 1e-9) for i in range(k)]
    return [None if math.isnan(value) else value for value in found]


def section(quantity: Quantity, title: str, phases: Phases) -> dict[str, Any]:
    """
    Return the statistics of a quantity, one row for each part of the flight.

    ``quantity``, ``title``, ``unit``, ``axes`` and ``rows``, each of ``part``, ``count``,
    ``rms``, ``maximum``, ``drift`` (the last error) and ``delay`` [s] by axis, ``rms_total``,
    ``maximum_total`` and ``drift_total`` of the length, and ``drift_at`` [s], the time of the last
    error. ``ends_early``: whether the flight goes on after the last of all. ``too_few``: how many
    samples the parts have that have some, but fewer than ``LEAST``.
    """
    rows: list[dict[str, Any]] = []
    too_few = {}
    for name, begin, end in phases.parts():
        inside = np.ones(len(quantity.stamps), bool)
        if begin is not None:
            inside &= quantity.stamps >= begin
        if end is not None:
            inside &= quantity.stamps < end
        stamps, errors = quantity.stamps[inside], quantity.error[inside]
        count = int(np.isfinite(errors).all(axis=1).sum())
        if 0 < count < LEAST:
            too_few[name] = count
            stamps, errors = stamps[:0], errors[:0]
        row = _row(name, stamps, errors)
        if row['count'] or not rows:
            row['delay'] = _delays(quantity, inside)
            rows.append(row)
    last = rows[0]['drift_at']
    return {'quantity': quantity.name, 'title': title, 'unit': quantity.unit,
            'axes': list(quantity.axes), 'rows': rows, 'too_few': too_few,
            'ends_early': last is not None and phases.goes_on(round(last * 1e9))}


def left_out(motions: Collection[Motion]) -> list[str]:
    """Return a line for each motion without its impossible poses, or of more than one frame."""
    return [outliers.describe(m.name, m.impossible) for m in motions if m.impossible] + [
        f'{m.name}: its poses are in {len(m.frames)} frames, frame_id '
        f'{shortened([quoted(name) for name in m.frames])}: they are compared as if in one'
        for m in motions if m.frames]


def _contradictions(a: Motion, b: Motion) -> list[str]:
    """Return lines on a motion capture, b, that contradicts the drone's own path."""
    ours, theirs = plausible.common_path(a, b)
    flat = ours[:, :2], theirs[:, :2]
    return [said for said in (plausible.upside_down(ours, theirs), plausible.mirrored(*flat),
                              plausible.other_scale(*flat), *same_flight.paths(a, b)) if said]


def _between(
    bag: Bag, topic: str, other: str, title: str, parts: Phases, notes: list[str],
) -> Comparison | None:
    """Compare two topics of one bag; None with a note if they have no samples in common."""
    try:
        a, b = motion.read(bag, topic), motion.read(bag, other)
        notes += left_out((a, b))
        if not simulated(bag) and other in motion.TRUTH and (said := turned.describe(a, b)):
            notes.append(said)
        if not simulated(bag) and a.frame != b.frame:
            alignment = own_origin(a, b, begins_in_air(
                a if a.name in motion.TRUTH else b, max(a.stamps[0], b.stamps[0])))
            notes.append(alignment.text)
            notes += _contradictions(a, b)
            a = alignment.moved(a)
        return Comparison(
            f'{title}: {a.name} minus {b.name}', (a.name, b.name), tuple(motions(a, b)),
            parts)
    except BagError as error:
        notes.append(f'no {title}: {error}')
        return None


def within(bag: Bag, parts: Phases, notes: list[str]) -> list[Comparison]:
    """
    Return the tracking and estimation errors of a bag, if it has both sides.

    What it lacks is appended to the notes.
    """
    truth = next((name for name in motion.TRUTH if name in bag), None)
    measured = next((name for name in reversed(motion.TRUTH) if name in bag), None)
    imported = 'onboard/odom' in bag
    out = []
    if 'reference' in bag and truth is not None:
        out.append(_between(bag, truth, 'reference', 'tracking error', parts, notes))
    elif not imported or 'reference' in bag:
        notes.append('no tracking error: it needs reference and ground_truth/odom or '
                     'optitrack/pose')
    if 'estimate/odom' not in bag:
        if imported and measured is not None:
            out.append(_between(
                bag, 'onboard/odom', measured, 'error of the onboard estimate', parts, notes))
        if not imported:
            notes.append('no estimate/odom in the bag')
        elif 'imu/data_raw' in bag:
            notes.append('an imported flight without estimate/odom: let the estimator fly it with '
                         f'mambo replay {bag.path}')
        else:
            notes.append('an imported flight without estimate/odom, and without imu/data_raw for '
                         'mambo replay to make one')
    elif measured is not None:
        out.append(_between(bag, 'estimate/odom', measured, 'estimation error', parts, notes))
        if 'estimate/map' in bag and truth is not None:  # which poses of a wrong body are not
            out.append(_between(
                bag, 'estimate/map', truth, 'estimation error in map', parts, notes))
    elif not imported:
        notes.append('no estimation error: it needs optitrack/pose or ground_truth/odom')
    return [comparison for comparison in out if comparison is not None]
