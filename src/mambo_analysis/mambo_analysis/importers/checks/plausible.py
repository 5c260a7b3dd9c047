"""Whether numbers can be those of a small drone in these units: checks that importers share."""

from __future__ import annotations

from collections.abc import Sequence

from mambo_bags.mcap_reader import BagError
from mambo_signals.gyro_check import differs
from mambo_signals.height_check import LEAST_CHANGE, LEAST_ROWS
from mambo_signals.motion import Motion
from mambo_signals.poses import frozen, outliers
from mambo_signals.poses.outliers import FASTEST_TURN
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import assignments

Floats = NDArray[np.float64]
LONGEST_STEP = 1.5  # [s] median step of a motion: 1 Hz passes, milliseconds read as s do not
FASTEST_RATE = 4e4  # [Hz] on average; inertial sensors are read at 32 kHz at most
WINDOW = 4.0  # [s] over which the integral of a gyro is taken
TILTS = (0.25, 1.0)  # [rad] RMS that rad/s stays below and deg/s above
IN_G = (0.8, 1.2)  # median of an acceleration in g
MOST = 20.0  # [m/s^2] median of the acceleration along z of a flight, upright or not; 9.8 is usual
NEVER = 5.0  # an acceleration in g stays below it; one in m/s^2 is above it in any upright drone
QUARTER = 0.5 * np.pi + 0.01  # [rad] largest middle Euler angle, with rounding
HALF = np.pi + 0.01  # [rad] largest outer one
FARTHEST = 1e4  # [m] from the origin of a motion capture: a hall, or a field with cameras
MOST_CENTIMETRES = 800.0  # of a range finder that is read in cm
FARTHEST_RANGE = 40.0  # [m]; a range in mm that fits in 16 bits is below 32.8 m
PRESSURES = (3e4, 1.2e5)  # [Pa] from above all mountains to below the sea
MOST_VOLTS = 100.0  # of a battery; one in mV has thousands
LARGEST_PWM = 65535.0  # of 16 bits
LEAST_ALIKE = 0.5  # [-] share of a path; of 100 recordings 0.8, but for diverged estimates
LEAST_WAY = 0.2  # [m] RMS from its middle, of a path that can be compared
COARSE = 0.003  # [m] between positions; of motion capture 1 mm at most
FEW = 0.01  # [-] share of values that may be damaged
MINIDRONE = {
    'accel': (7.0, 13.0, 'm/s^2'), 'sonar': (0.2, 4.0, 'm'), 'pressure': (*PRESSURES, 'Pa'),
    'battery': (2.5, 5.0, 'V'), 'percent': (0.0, 100.0, '%'), 'motors': (10.0, 1000.0, 'PWM'),
    'flow': (0.0, 12.0, 'rad/s')}
"""Least and largest usual value of the sensors of a minidrone, and their unit. In twelve flights:
accelerometer 9.3 to 10.2, sonar 0.44 to 1.2, battery of one cell 3.5 to 4.2, commands of 265 to
454 (median) and flow up to 4.5 (99 %)."""
NOISY = ('sonar', 'pressure')  # which never rest
SAME_RATE = (0.6, 3.0)  # correlation of gyro and onboard rate, and their factor
OTHER_AXIS = (0.7, 0.3)  # least correlation with another axis, largest with the own one
UPSIDE_DOWN = -0.8  # correlation of the heights
MIRRORED = (0.8, 0.3)  # explained shares of a path, by its mirror image and by itself
LEAST_TIME = 5.0  # [s] after which a flight has moved
LEAST_SPAN = 0.02  # [m] between 5 and 95 % of the positions of a flight; a hover has 0.05
TURNED = 0.01  # [rad] standard deviation of the tilt of a drone in the air, at least
SAME_SCALE = (0.8, 1.25, 0.8)  # factor of two paths, and the explained share from which it counts


def refuse_pace(where: str, times: Floats) -> None:
    """
    Refuse times, (n,) s, ascending, between which no motion can be seen, or that nothing measures.

    Raises
    ------
    BagError
        If half of them are more than ``LONGEST_STEP`` apart, or their mean rate is above
        ``FASTEST_RATE``.

    """
    if len(times) < 3:
        return
    usual, mean = float(np.median(np.diff(times))), float(np.ptp(times)) / (len(times) - 1)
    if usual > LONGEST_STEP:
        raise BagError(f'{where}: its samples are {usual:.3g} s apart, too far for a motion (at '
                       f'most {LONGEST_STEP:g} s): give its times in the right unit')
    if mean * FASTEST_RATE < 1.0:
        raise BagError(f'{where}: its samples are {mean:.3g} s apart, too near for any sensor '
                       f'(at most {FASTEST_RATE:g} Hz): give its times in the right unit')


def doubtful_poses(
    where: str, name: str, times: Floats, position: Floats, attitude: Floats,
    beside: Sequence[assignments.Turning] = (),
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], list[str]]:
    """
    Return which poses of a motion capture are frozen, and which others are impossible, (n,) each.

    Also lines on those that are turned against the others, or are left out for long.

    Parameters
    ----------
    where
        File and name, for the error.
    name
        Of the poses, for the lines.
    times : (n,) s, ascending
    position : (n, 3) m
    attitude : (n, 4)
        x y z w.
    beside
        Sensors that turn with the body, on the same clock.

    Raises
    ------
    BagError
        If most poses are impossible, or one that is left is beyond ``FARTHEST``.

    """
    still = frozen.frozen(times, position, attitude)
    wrong = np.zeros(len(times), bool)
    moving = times[~still], position[~still], attitude[~still]
    found = assignments.sort_poses(*moving, beside)
    wrong[~still] = outliers.refuse_most(where, *moving, found)
    refuse_far(where, position[~(still | wrong)])
    return still, wrong, assignments.describe(name, times[~still], found)


def refuse_far(where: str, position: Floats) -> None:
    """Refuse positions of a motion capture, (n, 3) m, of which one is beyond ``FARTHEST``."""
    largest = float(np.abs(position).max(initial=0.0))
    if largest > FARTHEST:
        raise BagError(f'{where}: a position is {largest:.3g} m from the origin, more than '
                       f'{FARTHEST:g} m: check its unit and its cells')


def beyond_quarter(middle: Floats) -> int | None:
    """Return the index of the first middle Euler angle, (n,) rad, that cannot be; None without."""
    wrong = np.flatnonzero(np.abs(middle) > QUARTER)
    return int(wrong[0]) if len(wrong) else None


def refuse_degrees(
    where: str, times: Floats, rates: Floats, remedy: str = 'give it in rad/s',
) -> None:
    """
    Refuse a gyro, (n, 3), in deg/s instead of rad/s.

    Two things must hold. Its fastest rate is above the full scale of the gyros of small drones;
    a crash or a damaged value can do that alone. And the tilt that follows from its integral
    (:func:`tilt_of`) is larger than in any flight without flips; of five real flights it is 0.03
    to 0.05 rad.

    Raises
    ------
    BagError
        In one line that ends with the remedy.

    """
    if len(times) < 3:
        return
    fastest, tilt = float(np.abs(rates).max()), tilt_of(times, rates[:, :2])
    if fastest > FASTEST_TURN and tilt > TILTS[1]:
        raise BagError(f'{where}: the gyro turns by up to {fastest:.4g} rad/s, and its integral '
                       f'is a tilt of {tilt:.3g} rad RMS: is it in deg/s? {remedy}')


def refuse_g(where: str, upward: Floats, remedy: str = 'give it in m/s^2') -> None:
    """
    Refuse an acceleration along z, (n,), that is in g, or in a smaller unit than m/s^2.

    Raises
    ------
    BagError
        In one line that ends with the remedy.

    """
    if not len(upward):
        return
    usual, most = np.percentile(upward, [50.0, 99.0])
    if IN_G[0] < usual < IN_G[1] and most < NEVER:
        raise BagError(f'{where}: the accelerometer has a median of z of {usual:.3g}, not 9.8 '
                       f'm/s^2: is it in g? {remedy}')
    if abs(usual) > MOST:
        raise BagError(f'{where}: the accelerometer has a median of z of {usual:.4g}, not 9.8 '
                       f'm/s^2: {remedy}')


def refuse_ranges(where: str, ranges: Floats) -> None:
    """
    Refuse ranges, (n,) m, that no range finder measures.

    A few may be, and a few negative ones are placeholders of missing echoes.

    Raises
    ------
    BagError
        If more than ``FEW`` are beyond ``FARTHEST_RANGE``, or most are negative.

    """
    far, below = ranges > FARTHEST_RANGE, ranges < 0.0
    if far.sum() > FEW * len(ranges):
        unit = 'mm' if np.median(ranges[far]) > MOST_CENTIMETRES else 'mm or cm'
        raise BagError(f'{where}: {int(far.sum())} of {len(ranges)} ranges are beyond '
                       f'{FARTHEST_RANGE:g} m, up to {ranges.max():.4g} m: are they in {unit}? '
                       'give them in m')
    if below.sum() > 0.5 * len(ranges):
        raise BagError(f'{where}: {int(below.sum())} of {len(ranges)} ranges are negative, down '
                       f'to {ranges.min():.4g} m: turn their sign')


def refuse_pressure(where: str, pressure: Floats) -> None:
    """Refuse pressures of the air, (n,) Pa, whose median is not within ``PRESSURES``."""
    if not len(pressure):
        return
    usual, (least, most) = float(np.median(pressure)), PRESSURES
    if not least <= usual <= most:
        raise BagError(f'{where}: the pressure has a median of {usual:.4g}, not of {least:g} to '
                       f'{most:g} Pa: is it in hPa? give it in Pa')


def refuse_voltage(where: str, voltage: Floats) -> None:
    """Refuse voltages of a battery, (n,) V, whose median is negative or above ``MOST_VOLTS``."""
    usual = float(np.median(voltage)) if len(voltage) else 0.0
    if not 0.0 <= usual <= MOST_VOLTS:
        raise BagError(f'{where}: the battery has a median of {usual:.4g} V, not of 0 to '
                       f'{MOST_VOLTS:g}: is it in mV? give it in V')


def refuse_commands(where: str, pwm: Floats) -> NDArray[np.bool_]:
    """Refuse commands, (n, k), of which more than ``FEW`` are no 16 bits; return rows with one."""
    wrong = (pwm < 0.0) | (pwm > LARGEST_PWM)
    if wrong.sum() > FEW * pwm.size:
        raise BagError(f'{where}: {int(wrong.sum())} of {pwm.size} motor commands are outside of '
                       f'0 to {LARGEST_PWM:g}, such as {pwm[wrong][0]:.4g}: give commands of '
                       'motors that push')
    return wrong.any(axis=1)


def refuse_steep(
    where: str, times: Floats, angle: Floats, most: float = QUARTER,
) -> NDArray[np.bool_]:
    """
    Return which of the pitches, or rolls, are impossible, and damaged therefore.

    Parameters
    ----------
    where
        File and name, for the error.
    times, angle : (n,) s, rad
    most
        ``QUARTER`` of pitches, ``HALF`` of rolls.

    Raises
    ------
    BagError
        If more than ``FEW`` of them are. In degrees it would be 1.8 % or more of the pitches of
        five real flights.

    """
    wrong = np.abs(angle) > most
    if wrong.sum() > FEW * len(angle):
        first = np.flatnonzero(wrong)[0]
        turn = 'a quarter turn' if most == QUARTER else 'half a turn'
        raise BagError(f'{where} is {angle[first]:.4g} at {times[first]:.3f} s, and '
                       f'{int(wrong.sum())} of {len(angle)} values are beyond {turn}: is '
                       'it in deg, or another angle? give yaw, pitch and roll in rad, in this '
                       'order')
    return wrong


def tilt_of(times: Floats, rates: Floats) -> float:
    """
    Return the integrated gyro about x and y, minus a line through each 4 s.

    Parameters
    ----------
    times : (n,) s
    rates : (n, 2)
        In any unit.

    Returns
    -------
    The largest RMS of a window, in the unit times s.

    """
    angle = np.cumsum(rates * np.gradient(times)[:, None], axis=0)
    largest, begin = 0.0, float(times[0])
    while begin < times[-1]:
        first, end = np.searchsorted(times, (begin, begin + WINDOW))
        if first == end:  # a gap
            begin += 0.5 * WINDOW * float((times[first] - begin) // (0.5 * WINDOW))
            continue
        part = slice(first, end)
        if end - first > 2:
            line = np.column_stack([times[part] - begin, np.ones(end - first)])
            left = angle[part] - line @ np.linalg.lstsq(line, angle[part], rcond=None)[0]
            largest = max(largest, float(np.sqrt(np.mean(left**2))))
        begin += 0.5 * WINDOW
    return largest


def common_path(own: Motion, tracked: Motion) -> tuple[Floats, Floats]:
    """Return the paths, (n, 3) m, of a drone and of its capture where both are."""
    there = tracked.values(own.stamps, tracked.position)
    both = np.isfinite(there).all(axis=1) & np.isfinite(own.position).all(axis=1)
    return own.position[both], there[both]


def spread(values: Floats) -> float:
    """Return how far values, (n,), are apart, without the outermost tenth."""
    low, high = np.percentile(values, [5.0, 95.0])
    return float(high - low)


def still(t: Floats, position: Floats, attitude: Floats) -> tuple[float, bool] | None:
    """
    Return within how many m the positions of a flight stay, and whether the attitude changes.

    None where they move, in less than ``LEAST_TIME``, or without attitudes.

    Parameters
    ----------
    t : (n,) s, ascending
    position : (n, 3) m
    attitude : (n, 4)
        x y z w; NaN where it is not known.

    """
    known = np.isfinite(attitude).all(axis=1)
    if len(t) < 2 or float(np.ptp(t)) < LEAST_TIME or not known.any():
        return None
    span = max(spread(axis) for axis in position.T)
    if span >= LEAST_SPAN:
        return None
    tilts = Rotation.from_quat(attitude[known]).as_matrix()[:, :2, 2]
    return span, bool(np.hypot(*tilts.std(axis=0)) >= TURNED)


def upside_down(path: Floats, position: Floats) -> str | None:
    """Return in words that a capture, (n, 3) m, falls where the drone's path, (n, 3) m, rises."""
    if len(path) < LEAST_ROWS:
        return None
    ours, theirs = path[:, 2], position[:, 2]
    if min(ours.std(), theirs.std()) < LEAST_CHANGE:
        return None
    r = float(np.corrcoef(ours, theirs)[0, 1])
    return None if r > UPSIDE_DOWN else (
        f'the motion capture falls where the drone rises (correlation of the heights {r:.2f})')


def rounded(position: Floats) -> float:
    """Return the step of positions, (n, 3) m, that are multiples of more than ``COARSE``; or 0."""
    steps = []
    for axis in position[np.isfinite(position).all(axis=1)].T:
        values = np.unique(np.round(axis, 9))
        gaps = np.diff(values)
        if len(values) > 2 and gaps.min() > COARSE and len(values) < len(axis) / 4.0 and (
                np.allclose(gaps / gaps.min(), np.round(gaps / gaps.min()), atol=1e-3)):
            steps.append(float(gaps.min()))
    return max(steps, default=0.0)


def alike(path: Floats, position: Floats) -> float:
    """
    Return which share of a path another one explains, turned and scaled as it fits best.

    Parameters
    ----------
    path, position : (n, 2) m
        At the same times.

    Returns
    -------
    share
        0 to 1; also 1 if one of them hardly moves, which then says nothing.

    """
    if len(path) < LEAST_ROWS:
        return 1.0
    a, b = ((x[:, 0] + 1j * x[:, 1]) - (x[:, 0] + 1j * x[:, 1]).mean() for x in (path, position))
    sizes = [float(np.mean(np.abs(x) ** 2)) for x in (a, b)]
    if min(sizes) < LEAST_WAY ** 2:
        return 1.0
    return float(np.abs(np.mean(a.conj() * b)) ** 2 / (sizes[0] * sizes[1]))


def mirrored(path: Floats, position: Floats) -> str | None:
    """
    Return in words that a motion capture shows the mirror image of the drone's own path.

    Two axes are swapped then, or one has the wrong sign. A path that drifts, or a straight one,
    says nothing.

    Parameters
    ----------
    path : (n, 2) m
        Horizontal, x and y, as the drone estimates it.
    position : (n, 2) m
        That of the motion capture at the same times.

    """
    if (paths := _moving(path, position)) is None:
        return None
    ours, theirs = paths
    image, itself = (_explained(theirs, _unit(np.vdot(x, theirs)) * x)
                     for x in (ours.conj(), ours))
    if image < MIRRORED[0] or itself > MIRRORED[1]:
        return None
    return ('the motion capture shows the mirror image of the path that the drone estimates: two '
            'of its axes are swapped, or one has the wrong sign')


def other_scale(path: Floats, position: Floats) -> str | None:
    """
    Return in words that a motion capture shows the drone's own path larger or smaller.

    Parameters as of :func:`mirrored`.
    """
    if (paths := _moving(path, position)) is None:
        return None
    ours, theirs = paths
    factor = np.vdot(ours, theirs) / np.vdot(ours, ours)
    low, high, least = SAME_SCALE
    if low <= abs(factor) <= high or _explained(theirs, factor * ours) < least:
        return None
    return (f'the path in the motion capture is {abs(factor):.3g} times as large as the one that '
            'the drone estimates: its unit, or the scale of the optical flow, is wrong')


def _moving(path: Floats, position: Floats) -> tuple[Floats, Floats] | None:
    """Return two horizontal paths about their means as complex numbers; None: too little."""
    if len(path) < LEAST_ROWS:
        return None
    ours, theirs = ((x - x.mean(axis=0)) @ [1.0, 1.0j] for x in (path, position))
    if np.abs(ours).std() < 1e-9 or np.sqrt(np.mean(np.abs(theirs) ** 2)) < LEAST_CHANGE:
        return None
    return ours, theirs


def _explained(path: Floats, model: Floats) -> float:
    """Return the share of a complex path's variance that a model explains."""
    return 1.0 - float(np.sum(np.abs(path - model) ** 2) / np.sum(np.abs(path) ** 2))


def _unit(number: complex) -> complex:
    """Return a complex number of the same direction and the length 1; 1 for 0."""
    return number / abs(number) if number else 1.0


def unusual(name: str, kind: str, values: Floats) -> list[str]:
    """
    Return a line about a sensor of a minidrone that gives one value, or those of another scale.

    Parameters
    ----------
    name
        Of the signal in the log.
    kind
        Of ``MINIDRONE``.
    values : (n,)
        In its unit. The median of those that are not 0 counts, of a flow the 99th percentile.

    """
    least, most, unit = MINIDRONE[kind]
    if not len(values):
        return []
    if not values.any() or kind in NOISY and np.ptp(values) == 0.0:
        return [constant(name, float(values[0]))]
    usual = float(np.percentile(np.abs(values[values != 0.0]), 99.0 if kind == 'flow' else 50.0))
    if least <= usual <= most:
        return []
    what = 'is up to' if kind == 'flow' else 'has a median of'
    return [f'{name} {what} {usual:.4g} {unit}, usual are {least:g} to {most:g}: check its unit '
            'and scale before you use it']


def constant(name: str, value: float) -> str:
    """Return a line about a signal of one value."""
    return (f'{name} is {value:.4g} throughout: it was not measured, or not logged: do not use '
            'it, or log it again')


def unusual_gyro(names: Sequence[str], rates: Floats, onboard: Floats) -> list[str]:
    """
    Return a line about each axis of a gyro that contradicts the rate that the drone estimates.

    It is many times as large, or turns as another axis, or the other way. Of twelve real flights
    each axis has a correlation of 0.67 or more with its own rate, and of 0.37 at most with others.

    Parameters
    ----------
    names
        Of the three signals.
    rates, onboard : (n, 3) rad/s
        Gyro and the drone's own estimate at the same times; NaN where that is unknown.

    """
    known = np.isfinite(onboard).all(axis=1)
    if known.sum() < LEAST_ROWS:
        return []
    out, alike = [], correlations(rates[known], onboard[known])
    for k, name in enumerate(names):
        r, ratio = float(alike[k, k]), float(rates[known, k].std() / max(
            onboard[known, k].std(), 1e-12))
        if r > SAME_RATE[0] and differs(r, ratio, SAME_RATE[1]):
            out.append(f'{name} is {ratio:.3g} times the rate that the drone estimates: check its '
                       'unit and scale before you use it')
        elif axis := other_axis(alike[k], k, ('roll', 'pitch', 'yaw')):
            out.append(f'{name} turns as the {axis} rate that the drone estimates: check order '
                       'and signs of both before you use it')
    return out


def correlations(values: Floats, other: Floats) -> Floats:
    """Return the correlation of each column of values, (n, k), with each of another, (n, m)."""
    x, y = ((a - a.mean(axis=0)) / np.maximum(a.std(axis=0), 1e-12) for a in (values, other))
    return x.T @ y / len(x)


def other_axis(alike: Floats, own: int, names: Sequence[str]) -> str:
    """
    Return which axis a signal shows, with its sign, if not its own; else an empty text.

    Parameters
    ----------
    alike : (k,)
        Its correlation with each axis.
    own
        Index of the axis that it should show.
    names
        Of the axes.

    """
    most = int(np.argmax(np.abs(alike)))
    if abs(alike[most]) < OTHER_AXIS[0] or alike[own] > OTHER_AXIS[1]:
        return ''
    return f'{"-" * bool(alike[most] < 0.0)}{names[most]}'
