r"""
What in a recorded flight contradicts itself: units, axes and clocks of its signals.

The model of a flight absorbs much: a bias takes a wrong unit of the accelerometer, a tilt takes
wrong axes, and the drag that is left has a narrow interval around a wrong value. The motion of the
flight itself tells: turned into the world, the specific force less gravity is the acceleration of
the tracked position, whatever acts on the vehicle. On seven flights of a Crazyflie under Vicon
(NanoBench) and on simulated ones, means over 0.5 s of the two differ by 0.02 to 0.15 m/s^2, with a
gain of 0.73 to 1.12.
"""

from __future__ import annotations

from pathlib import Path

from mambo_signals import gyro_check
from mambo_signals.resample import constant_runs
import numpy as np
from numpy.typing import NDArray

from ..identify.regression import IdentifyError
from ..importers.checks import powertrain

Floats = NDArray[np.float64]

AXES = 'xyz'
STUCK = 1.0       # s with one and the same number: a sensor's noise changes each sample
LARGEST_BIAS = 2.0   # m/s^2: 0.4 rms along z in 11 Parrot flights; MPU-6000: 0.8 at most
STEEPEST = 0.3    # rad between sensor and markers: beyond, they have other axes
MOVING = 0.3      # m/s^2, standard deviation: twice the largest difference that was seen
FACTOR = 1.5      # [-] of the gain; cm, g, feet and halves are further off
LEAST = 0.5       # correlation, of 0.94 to 0.999
ERRORS = 2.5      # standard errors of a gain
SCALE = ((0.93, 1.07), (0.93, 1.07), (0.85, 1.15))
"""Gain along x, y, z of the world that is told outside. None of 85 flights of NanoBench is, with
its errors: they end below 0.94 or begin above 1.02 along x and y, 0.88 and 1.12 along z."""
SWAPPED = 0.58    # [-] drag across over drag along the velocity: 30 deg about z; 0.1 was seen
LEAST_DRAG = 0.1  # 1/s that acts across, to be one
PARTS = 8         # of a flight, each left out once


def silent(force: Floats, gyro: Floats, step: float) -> bool:
    """
    Return whether an IMU in the air, (n, 3) each, has no noise: it is simulated.

    Its axes rest where the vehicle moves in a plane: three or more ever repeat together for
    ``STUCK``, of both sensors, while another axis changes. No dead sensor does that, nor one that
    freezes.
    """
    long = int(STUCK / step) + 2
    if len(force) < long:
        return False
    changes = np.concatenate(
        [np.zeros((1, 6), int), np.cumsum(np.diff(np.hstack([force, gyro]), axis=0) != 0, axis=0)])
    still = changes[long - 1:] == changes[:1 - long]
    both = still[:, :3].any(axis=1) & still[:, 3:].any(axis=1)
    return bool((both & (still.sum(axis=1) >= 3) & ~still.all(axis=1)).any())


def refuse_stuck(path: Path, name: str, unit: str, values: Floats, step: float) -> None:
    """
    Refuse a sensor that repeats one number in the air.

    Parameters
    ----------
    values : (n, 3)
        Without gaps, every ``step`` s.

    Raises
    ------
    IdentifyError
        Naming sensor, axis and number.

    """
    for axis, x in zip(AXES, values.T):
        first, end = max(constant_runs(x[:, None]).tolist(), key=lambda run: run[1] - run[0])
        if (end - first) * step > STUCK:
            raise IdentifyError(
                f'{path}: the {name} repeats {x[first]:.4g} {unit} along {axis} for '
                f'{(end - first) * step:.1f} s in the air: that axis is dead, or not in the '
                'recording')


def refuse_still_motor(path: Path, command: Floats) -> None:
    """Refuse commands (n, 4) of which one is constant in the air while others are not."""
    still = np.ptp(command, axis=0) == 0.0
    if still.any() and not still.all():
        k = int(still.argmax())
        raise IdentifyError(
            f'{path}: motor {k + 1} of motor_pwm has the command {command[0, k]:.6g} throughout '
            'the flight, the others change: it is not in the recording')


def refuse_doubled_motor(path: Path, command: Floats) -> None:
    """Refuse commands (n, 4) of which two columns are the same and the others are not."""
    if (two := powertrain.doubled(command)) is not None:
        raise IdentifyError(
            f'{path}: motors {two[0] + 1} and {two[1] + 1} of motor_pwm have the same commands '
            'throughout the flight, the others differ: import each from its own column')


def refuse_upward(path: Path, upward: float, gravity: float) -> None:
    """Refuse an accelerometer whose mean along the vertical, m/s^2, is not that of gravity."""
    if abs(upward - gravity) <= LARGEST_BIAS:
        return
    hint = 'check its unit (m/s^2) and axes (FLU), and the order of the quaternion (x y z w)'
    if abs(upward - 1.0) < 0.2:
        hint = 'is it in g? import it with its unit'
    elif abs(upward / gravity ** 2 - 1.0) < 0.2:
        hint = 'was it in m/s^2 and imported as g? import it with its unit'
    elif abs(upward + gravity) < LARGEST_BIAS:
        hint = 'are its axes those of FRD? import it with its axes'
    raise IdentifyError(
        f'{path}: in flight the accelerometer shows {upward:.3g} m/s^2 upwards in the mean, not '
        f'{gravity:.3g}: {hint}')


def refuse_steep(path: Path, mounting: Floats) -> None:
    """Refuse an angle between accelerometer and markers, (3,) rad, that no mounting has."""
    angle = float(np.linalg.norm(mounting))
    if angle > STEEPEST:
        raise IdentifyError(
            f'{path}: accelerometer and markers are turned by {np.degrees(angle):.0f} deg in roll '
            'and pitch: check the axes of both (FLU) and the order of the quaternion (x y z w)')


def refuse_other_motion(path: Path, force: Floats, change: Floats) -> None:
    """
    Refuse an accelerometer that does not show the acceleration of the tracked position.

    Parameters
    ----------
    force : (k, 3) m/s^2
        Means of the specific force, turned into the world.
    change : (k, 3) m/s^2
        Change of the tracked velocity over the same times.

    Raises
    ------
    IdentifyError
        Naming the axis of the world.

    """
    for axis, f, a in zip(AXES, (force - force.mean(axis=0)).T, (change - change.mean(axis=0)).T):
        of, size = float(f.std()), float(a.std())
        if max(of, size) < MOVING:
            continue
        r = float(f @ a) / max(len(f) * of * size, 1e-12)
        text = (f'{path}: along {axis} of the world the position accelerates by {size:.3g} m/s^2, '
                f'accelerometer and attitude say {of:.3g} (standard deviations), with a '
                f'correlation of {r:.2f}')
        if r < LEAST:
            raise IdentifyError(f'{text}: check axes and signs of position, quaternion (x y z w) '
                                'and accelerometer (FLU)')
        if gyro_check.differs(r, size / of, FACTOR):
            raise IdentifyError(f'{text}: check the units of position (m) and accelerometer '
                                '(m/s^2)')


def gains(force: Floats, change: Floats) -> Floats:
    """
    Return how many times the tracked position accelerates as much as it is pushed, by axis.

    Parameters as of :func:`refuse_other_motion`.

    Returns
    -------
    lowest and highest : (3, 2)
        Along x, y, z of the world, with 99 % of the noise on either side alone; 0 and inf without
        motion.

    """
    out = np.tile([0.0, np.inf], (3, 1))
    for axis, (f, a) in enumerate(zip((force - force.mean(axis=0)).T,
                                      (change - change.mean(axis=0)).T)):
        of, size = float(np.linalg.norm(f)), float(np.linalg.norm(a))
        r = min(float(f @ a) / max(of * size, 1e-12), 1.0)
        if r >= LEAST:
            half = ERRORS * size / of * float(np.sqrt((1.0 - r ** 2) / len(force)))
            out[axis] = r * size / of - half, size / of / r + half
    return out


def refuse_swapped(names: str, force: Floats, velocity: Floats) -> None:
    """
    Refuse an accelerometer that shows the drag across the velocity.

    Parameters
    ----------
    names
        Of the flights, for the error.
    force, velocity : (n, 2) m/s^2, m/s
        Along x and y of the body.

    """
    whole = np.arange(len(force))
    for rows in np.array_split(whole, PARTS):
        kept = np.delete(whole, rows)
        columns = np.column_stack([-velocity[kept], np.ones(len(kept))])
        drag = np.linalg.lstsq(columns, force[kept])[0][:2]
        across = float(np.abs([drag[0, 1], drag[1, 0]]).max())
        if across < LEAST_DRAG or across < SWAPPED * max(0.5 * float(np.trace(drag)), 0.0):
            return
    raise IdentifyError(
        f'{names}: the accelerometer shows a drag of {across:.2g} 1/s across the velocity: its x '
        'and y are not those of the tracked body: check the axes of both (FLU)')
