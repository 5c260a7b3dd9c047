"""
Whether tracked positions accelerate as the tracked attitude tilts: :func:`describe`.

The thrust of a multirotor is along its body z axis, so its horizontal acceleration is g times the
tilt, less a drag D v (3.6), by which it leads the tilt: by 0.2 s in a slow sway. D is not known;
positions contradict attitudes if they do so for each D up to ``DRAG``. Second differences of the
positions over ``HALF`` are a weighted mean of the acceleration; the tilts are averaged with the
same weights. In the 83 takes of NanoBench that tilt by ``LEAST`` or more both have a correlation
of 0.86 to 0.99, the accelerations are 0.80 to 1.03 times the tilts, and the best agreement is at
delays of -0.10 to 0 s. Along any horizontal direction the correlation is 0.95 or more; an attitude
whose numbers are in another order tilts rightly along one direction, and not across it.

An attitude on its side or upside down contradicts a flight by itself, as the thrust does not carry
the vehicle then. This is judged by the poses, at any rate; the rest needs 5 s of flight, of 6.6 s.
"""

from __future__ import annotations

from mambo_signals.motion import Motion
from mambo_signals.resample import Floats, interpolate
import numpy as np
from scipy.spatial.transform import Rotation

GRAVITY = 9.81  # m/s^2
HALF = 10       # steps, half of the span of a second difference
STEP = 0.02     # s
LONGEST = 600.0  # s of a flight that are compared
GAP = 0.15      # s, over which poses are connected: of 10 Hz too, if their times are uneven
LOWEST = 0.1    # m above the floor, at which the vehicle flies
FASTEST = 15.0  # m/s^2; more is a jump
STEEPEST = 0.3  # cosine of the largest tilt that counts
ON_SIDE = 0.8   # s, steeper than that; without lift a vehicle falls 3.1 m; a flip is shorter
MOSTLY = 0.5    # share of the time in the air on its side, that is told
THROUGHOUT = 0.9  # the same where no take-off is seen: a vehicle that tips over lies on the floor
HELD = 1.0      # s, that a pose counts for at most: until the next one at 1 Hz, too
LEAST = 0.4     # m/s^2, RMS of g times the tilt
LEAST_ROWS = 250  # 5 s of flight
DELAYS = range(-30, 31)  # steps
LATE = 8        # steps, beyond which a delay is told
FOLLOWS = 0.8   # correlation from which accelerations follow tilts
DOES_NOT = 0.6  # correlation below which they do not
FLAT = 0.5      # tilts over accelerations, below which it does not tilt; 0.9 of real ones
SMOOTH = 0.3    # correlation of accelerations HALF apart; of noise -0.67, of flights 0.4 to 0.9
ALONG = np.exp(1j * np.radians(np.arange(0.0, 180.0, 15.0)))  # horizontal directions
CLEARLY = 0.03  # gain of a correlation, of a delay that is told
MIRRORED = 0.1  # gain by the mirror image; up to -0.16 in real flights
TURNED = 35.0   # deg; 22 in real flights on a circle, by drag
DRAG = np.linspace(0.0, 0.7, 8)  # 1/s; 0.25 to 0.54 of the vehicles known here
RATIO = (0.65, 1.2)  # accelerations over tilts: the least of all, the largest explained by tilts


def _lowest(one: Motion) -> float:
    """Return the height from which the vehicle flies, m; -inf: all of it is in the air."""
    low, high = np.percentile(one.position[:, 2], (1.0, 95.0))
    return float(low) + LOWEST if high - low > 2.0 * LOWEST else -np.inf


def _on_side(one: Motion) -> float:
    """
    Return which share of its time in the air the attitude is on its side; 0: too short.

    The floor counts for the length alone: a cut of a slow descent looks like a landing.
    """
    known = np.isfinite(one.quaternion).all(axis=1)
    if known.sum() < 2:
        return 0.0
    steps = np.minimum(np.diff(one.t[known]), HELD)
    held = 0.5 * (np.append(0.0, steps) + np.append(steps, 0.0))
    steep = Rotation.from_quat(one.quaternion[known]).as_matrix()[:, 2, 2] <= STEEPEST
    if held[steep].sum() < ON_SIDE:
        return 0.0
    held[one.position[known, 2] < _lowest(one)] = 0.0
    return float(held[steep].sum() / max(held.sum(), STEP))


def _signals(one: Motion) -> tuple[Floats, Floats, Floats] | None:
    """
    Return acceleration, g times tilt and velocity over time.

    They are x + iy, (n,) complex m/s^2, m/s. NaN where they are not known: in gaps of
    the poses, on the floor, and the tilt at cosines below ``STEEPEST``. None if the recording is
    too short.
    """
    known = np.isfinite(one.quaternion).all(axis=1)
    grid = np.arange(one.t[0], min(one.t[-1], one.t[0] + LONGEST), STEP)
    if known.sum() < 2 or len(grid) < 2 * HALF + len(DELAYS) + LEAST_ROWS:
        return None
    up = Rotation.from_quat(one.quaternion[known]).as_matrix()[:, :, 2]
    up = interpolate(grid, one.t[known], up, GAP)
    cosine = up[:, 2]
    tilt = up[:, :2] / np.where(cosine > STEEPEST, cosine, np.nan)[:, None] @ (1.0, 1.0j)
    position = interpolate(grid, one.t, one.position, GAP)
    position[position[:, 2] < _lowest(one)] = np.nan
    path = position[:, :2] @ (1.0, 1.0j)
    force = (path[2 * HALF:] - 2.0 * path[HALF:-HALF] + path[:-2 * HALF]) / (HALF * STEP)**2
    force[~(np.abs(force) < FASTEST)] = np.nan
    velocity = (path[2 * HALF:] - path[:-2 * HALF]) / (2 * HALF * STEP)
    weights = np.convolve(np.ones(HALF), np.ones(HALF)) / HALF**2
    tilt = GRAVITY * np.convolve(tilt, weights, 'same')
    return force, tilt[HALF:-HALF], velocity


def _correlation(force: Floats, tilt: Floats) -> complex:
    """Return the complex correlation of both; its angle is that from tilt to force."""
    force, tilt = force - force.mean(), tilt - tilt.mean()
    return np.vdot(tilt, force) / (np.linalg.norm(force) * np.linalg.norm(tilt))


def _pair(force: Floats, tilt: Floats, velocity: Floats, delay: int) -> tuple[Floats, ...]:
    """Return the three where they are known, those of positions ``delay`` steps later."""
    edge = max(DELAYS)
    force, velocity = (x[edge + delay:len(x) - edge + delay] for x in (force, velocity))
    tilt = tilt[edge:-edge]
    here = np.isfinite(force) & np.isfinite(tilt)
    return force[here], tilt[here], velocity[here]


def _smooth(force: Floats) -> bool:
    """Return whether accelerations over time are those of a motion, not of noisy positions."""
    before, after = force[:-HALF], force[HALF:]
    known = np.isfinite(before) & np.isfinite(after)
    return known.sum() > HALF and _correlation(before[known], after[known]).real > SMOOTH


def _along(pairs: dict[int, tuple[Floats, ...]]) -> tuple[float, float]:
    """
    Return the least correlation along a horizontal direction, and its angle from x, deg.

    Directions along which the vehicle hardly accelerates do not count.
    """
    least, at = 1.0, 0.0
    for unit in ALONG:
        best = -1.0
        for delay in range(-LATE, LATE + 1, LATE // 2):
            force, tilt, velocity = (np.real(x * unit.conj()) for x in pairs[delay])
            if force.std() < LEAST:
                best = 1.0
            elif tilt.std() > 0.0:
                best = max(best, *(_correlation(force + drag * velocity, tilt) for drag in DRAG))
        if best < least:
            least, at = best, float(np.degrees(np.angle(unit)))
    return least, at


def describe(one: Motion) -> str:
    """
    Return in words how positions contradict attitudes; empty: they do not, or show too little.

    Parameters
    ----------
    one
        Tracked poses of a flight, z up.

    """
    if (steep := _on_side(one)) > (MOSTLY if np.isfinite(_lowest(one)) else THROUGHOUT):
        return (f'its attitude is on its side or upside down in {100.0 * steep:.0f} % of the '
                'flight: check its axes and the order of the quaternion (x y z w)')
    signals = _signals(one)
    if signals is None:
        return ''
    pairs = {delay: _pair(*signals, delay) for delay in DELAYS}
    force, tilt, velocity = pairs[0]
    if min(len(pair[0]) for pair in pairs.values()) < LEAST_ROWS:
        return ''
    if LEAST <= force.std() and tilt.std() < min(LEAST, FLAT * force.std()) and (
            _smooth(signals[0])):
        return (f'its positions accelerate by {force.std():.2g} m/s^2 horizontally (RMS), for '
                f'which a multirotor tilts by {np.degrees(force.std() / GRAVITY):.2g} deg, not '
                f'by {np.degrees(tilt.std() / GRAVITY):.2g}: check that its attitude was '
                'tracked, and the unit of its angles, unless it was carried by hand')
    if not (tilt.std() >= LEAST and force.std() > 0.0):
        return ''
    follow = {delay: _correlation(*pair[:2]) for delay, pair in pairs.items()}
    pushed = [force + drag * velocity for drag in DRAG]
    beside = [_correlation(one, tilt) for one in pushed]
    now, mirror = max(np.abs(beside)), abs(_correlation(force.conj(), tilt))
    turned = np.degrees(np.angle(beside))
    ratio, most = force.std() / tilt.std(), max(one.std() for one in pushed) / tilt.std()
    late = max(follow, key=lambda delay: abs(follow[delay]))
    said = f'the horizontal accelerations of its positions (RMS {force.std():.2g} m/s^2)'
    if mirror >= FOLLOWS and mirror > now + MIRRORED:
        return f'{said} follow the mirror image of its tilts: check the signs of its axes'
    if abs(late) > LATE and abs(follow[late]) > max(FOLLOWS, now + CLEARLY):
        return (f'{said} follow its tilts {abs(late) * STEP:.2f} s '
                f'{"late" if late > 0 else "early"}: check the times of positions and attitudes')
    if now < DOES_NOT:
        return (f'{said} do not follow its tilts (correlation {now:.2f}), as those of a flying '
                'multirotor do: check the order of the quaternion (x y z w) or of the angles, '
                'that both are of this vehicle, and not carried by hand')
    if now >= FOLLOWS and min(np.abs(turned)) > TURNED:
        return (f'{said} are turned by {turned[0]:.0f} deg about the vertical from its tilts: '
                'check its axes, or, if it flies in circles, its times')
    least, angle = _along(pairs)
    if least < DOES_NOT:
        return (f'{said} follow its tilts, but not along the direction at {angle:.0f} deg from x '
                f'(correlation {least:.2f}): check the order of the quaternion (x y z w), or of '
                'the angles')
    if most < RATIO[0] or now * ratio > RATIO[1]:  # noise of the positions is no scale
        return (f'{said} are {ratio:.2g} times those of its tilts: check the unit of the '
                'positions, or their scale')
    return ''
