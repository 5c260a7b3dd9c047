"""Whether the battery and the motor commands of an imported bag can be those of a flight."""

from __future__ import annotations

import math

from mambo_bags.reader import Bag
from mambo_signals.height_check import LEAST_ROWS
from mambo_signals.motion import Motion
from mambo_signals.resample import runs
import numpy as np

from .plausible import Floats, LARGEST_PWM

LEAST_VOLTS = 2.5  # of a battery in flight; means of 43 flights of NanoBench are 3.2 or more
SAG = 0.5  # [-] of its median, below which no battery flies a drone
RISE = 1.5  # [-] of it, above which none is: full over empty is 1.4
SHARES = 1.0  # the largest command of a mapping to shares of the full one
UNEQUAL = 2.0  # median command of a motor over that of the others; 1.54 in 139 real recordings
STOPPED = 0.5  # [s] in all, for which no drone flies with a motor at rest
HELD = 0.5  # [s] for which no controller gives one command
MOVED = 0.1  # [m] meanwhile


def battery(bag: Bag) -> list[str]:
    """Return lines about voltages in another unit, and some that were not measured."""
    if 'battery' not in bag:
        return []
    t, volts = bag['battery'].t, np.asarray(bag['battery'].voltage, float)
    known = np.isfinite(volts)  # NaN: not measured
    t, volts = t[known], volts[known]
    if not len(volts):
        return []
    if (usual := float(np.median(volts))) < LEAST_VOLTS:
        return [f'battery: it has a median of {usual:.3g} V: check its column and unit']
    return [
        f'battery: {int(wrong.sum())} of {len(volts)} voltages are {side} their median, '
        f'{usual:.3g} V, {most}, the first at {t[wrong.argmax()]:.2f} s: were they measured?'
        for wrong, side, most in (
            (volts < SAG * usual, 'less than half of', f'down to {volts.min():.3g} V'),
            (volts > RISE * usual, f'more than {RISE:g} times', f'up to {volts.max():.3g} V'))
        if wrong.any()]


def commands(bag: Bag) -> list[str]:
    """Return lines about commands in another unit, and of motors that differ from the others."""
    if 'motor_pwm' not in bag or not len(bag['motor_pwm']):
        return []
    pwm, out = np.asarray(bag['motor_pwm'].pwm, float), []
    most, least = float(pwm.max()), float(pwm.min())
    if least < 0.0 or most > LARGEST_PWM:
        out.append(f'motor_pwm: the commands are {least:.4g} to {most:.4g}, outside of 0 to '
                   f'{LARGEST_PWM:g}: check their column and unit')
    if 0.0 < most <= SHARES:
        out.append(f'motor_pwm: the commands are up to {most:.3g}: they are shares of the '
                   'full command, not PWM')
    elif most == least:
        out.append(f'motor_pwm: the commands are {most:.4g} throughout: the motors stand, or '
                   'their commands were not recorded')
    still = np.ptp(pwm, axis=0) == 0.0
    if still.any() and not still.all():
        motor = int(np.argmax(still))
        out.append(f'motor_pwm: motor {motor + 1} has the command {pwm[0, motor]:.4g} '
                   'throughout, while others change: check its column')
    elif (two := doubled(pwm)) is not None:
        out.append(f'motor_pwm: motors {two[0] + 1} and {two[1] + 1} have the same commands '
                   'throughout, the others differ: check their columns')
    elif (one := unequal(pwm)) is not None:
        out.append(f'motor_pwm: in flight motor {one[0] + 1} has {one[1]:.2g} times the '
                   'command of the others (median): check its column and unit')
    else:
        out += stopped(bag['motor_pwm'].t, pwm)
    return out


def stopped(t: Floats, pwm: Floats) -> list[str]:
    """
    Return lines about motors without a command while the others fly the drone.

    Parameters
    ----------
    t : (n,) s
    pwm : (n, 4)

    """
    out, step = [], float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    for motor in range(pwm.shape[1]):
        others = np.delete(pwm, motor, axis=1).mean(axis=1)
        still = np.flatnonzero(
            (pwm[:, motor] == 0.0) & (others > 0.5 * others.max(initial=0.0)))
        if len(still) * step > STOPPED:
            out.append(f'motor_pwm: motor {motor + 1} has the command 0 for '
                       f'{len(still) * step:.2f} s, from {t[still[0]]:.2f} to '
                       f'{t[still[-1]]:.2f} s, while the others fly the drone: check its column')
    return out


def held(bag: Bag, moving: Motion) -> list[str]:
    """
    Return a line about commands that stand while a motion goes on and the motors run later.

    Before the first command and after the last one, a vehicle may be carried by hand.
    """
    if 'motor_pwm' not in bag or not len(bag['motor_pwm']):
        return []
    stamps, first = np.unique(bag['motor_pwm'].stamp, return_index=True)
    pwm = np.asarray(bag['motor_pwm'].pwm, float)[first]
    run = np.flatnonzero((pwm > 0.0).any(axis=1))
    if not len(run):
        return []
    same = (np.diff(pwm[run[0]:run[-1] + 1], axis=0) == 0.0).all(axis=1)
    stamps = stamps[run[0]:]
    for begin, end in [(stamps[a], stamps[b]) for a, b in runs(same).tolist()]:
        inside = (moving.stamps > begin) & (moving.stamps < end)
        if end - begin > HELD * 1e9 and inside.any() and np.ptp(
                moving.position[inside], axis=0).max() > MOVED:
            return [f'motor_pwm: the commands stand from {begin * 1e-9:.2f} to {end * 1e-9:.2f} '
                    's, while the vehicle moves: were they recorded there?']
    return []


def doubled(commands: Floats) -> tuple[int, int] | None:
    """
    Return two motors, from 0, with the same commands, (n, 4), where the others differ from all.

    None without, and where two and two are the same: those of a model that moves in a plane.
    """
    same = [(a, b) for a in range(4) for b in range(a + 1, 4)
            if np.array_equal(commands[:, a], commands[:, b])]
    return same[0] if len(same) == 1 else None


def unequal(commands: Floats) -> tuple[int, float] | None:
    """
    Return the motor, from 0, whose commands (n, 4) in flight are of another scale, and the factor.

    A vehicle that stays upright needs much the same thrust of all four; see ``UNEQUAL``.
    """
    known = np.abs(commands[np.isfinite(commands).all(axis=1)])
    mean = known.mean(axis=1)
    flying = known[mean > 0.5 * mean.max(initial=0.0)]
    if len(flying) < LEAST_ROWS:
        return None
    usual = np.median(flying, axis=0)
    others = [float(np.median(np.delete(usual, motor))) for motor in range(4)]
    ratios = [own / other if other > 0.0 else math.inf
              for own, other in zip(usual.tolist(), others, strict=True)]
    far = [max(ratio, 1.0 / ratio) if ratio > 0.0 else math.inf for ratio in ratios]
    motor = int(np.argmax(far))
    return (motor, ratios[motor]) if far[motor] > UNEQUAL else None
