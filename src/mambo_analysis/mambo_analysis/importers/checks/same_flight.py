"""
Whether a drone and a motion capture on its clock show the same flight: :func:`check`.

One signal of two flights is alike at some offset of the clocks. So all that both recorded are
compared there: the rates of all three axes together, the range with the tracked height, and the
drone's own height and path, up to their frame and drift.

A contradicting gyro, or a range that nothing but one axis of the gyro outweighs, refutes the
capture. A range that contradicts a gyro which agrees in all axes may itself be wrong, and an own
estimate may have diverged: these are doubts.
"""

from __future__ import annotations

from collections.abc import Collection
import math
from typing import NamedTuple

from mambo_bags.reader import Bag
from mambo_signals import gyro_check, height_check, motion
from mambo_signals.motion import Motion
from mambo_signals.resample import Floats
from mambo_signals.time_offset import unclipped_ranges

from . import turned

Signal = tuple[Floats, Floats]  # times [s] and values, (n,) m or (n, 3) rad/s


class Verdict(NamedTuple):
    """What contradicts a motion capture, in words; both empty: nothing does."""

    refuted: str = ''
    doubts: tuple[str, ...] = ()

    @property
    def lines(self) -> list[str]:
        """Return all of it."""
        return [self.refuted] * bool(self.refuted) + list(self.doubts)


def check(
    tracked: Motion, gyro: Signal | None, ranges: Signal | None, own: Collection[Motion] = (),
) -> Verdict:
    """
    Return what of a drone contradicts its motion capture.

    Parameters
    ----------
    tracked
        The motion capture, on the clock of the drone, z up, body FLU.
    gyro : s, (n, 3) rad/s
        In body axes FLU, while the motors run; None: there is none.
    ranges : s, (n,) m
        To the floor; NaN where there is none.
    own
        As the drone estimates it, in frames of its own.

    """
    turning = gyro and gyro_check.together(*gyro, tracked.t, tracked.quaternion)
    doubts = [line for one in own for line in paths(one, tracked)]
    if turning and turning.differ:
        return Verdict(
            'gyro and tracked attitude do not turn alike (correlation of all three axes together '
            f'{turning.correlation:.2f}, with their noise {turning.possible:.2f} is possible)',
            tuple(doubts))
    height = tracked.t, tracked.position[:, 2]
    said = ranges and height_check.not_followed(
        ranges[0], height_check.unclamped(*ranges, *height), *height, ('the range', tracked.name))
    if said and turning and turning.confirmed:
        return Verdict('', (f'{said}, though the gyro turns alike', *doubts))
    return Verdict(said or '', tuple(doubts))


def of_bag(bag: Bag, tracked: Motion, own: Collection[str] = ()) -> Verdict:
    """
    Return what of a bag contradicts a motion capture on its clock.

    Parameters
    ----------
    bag
        Of a flight, with any of ``imu/data_raw``, ``sonar/range`` and ``motor_pwm``.
    tracked
        The motion capture.
    own
        Topics with the motion that the drone estimates; those that it lacks do not count.

    """
    return check(tracked, gyro_of(bag), unclipped_ranges(bag) if 'sonar/range' in bag else None,
                 [motion.read(bag, topic) for topic in own if topic in bag])


def gyro_of(bag: Bag) -> Signal | None:
    """Return the gyro of a bag while the motors run, (n,) s and (n, 3) rad/s; None without one."""
    if 'imu/data_raw' not in bag:
        return None
    imu, (begin, end) = bag['imu/data_raw'], motors_run(bag)
    there = (imu.t >= begin) & (imu.t <= end)
    return imu.t[there], imu.angular_velocity[there]


def motors_run(bag: Bag) -> tuple[float, float]:
    """
    Return from when to when the motors run, s; without end where no command says so.

    A vehicle that is carried away after its landing is no longer tracked, or not well.
    """
    if 'motor_pwm' in bag:
        commands = bag['motor_pwm']
        on = commands.t[(commands.pwm > 0.0).any(axis=1)]
        if len(on):
            return float(on.min()), float(on.max())
    return -math.inf, math.inf


def paths(own: Motion, tracked: Motion) -> list[str]:
    """Return lines on the height and the path of a motion that are not those of another one."""
    return [said for said in (
        height_check.not_followed(own.t, own.position[:, 2], tracked.t, tracked.position[:, 2],
                                  (f'the height of {own.name}', tracked.name)),
        turned.other_path(own, tracked)) if said]
