"""
Innovation gate that can recover when the filter itself is wrong.

A measurement is refused where its squared innovation exceeds the squared gate times its variance.
If no sample of a sensor is used for ``recovery_time``, the filter may be wrong. The unused samples
then vote, as in the majority vote of Boyer and Moore: a sample whose innovation (for the sonar:
height) is near the centre of the previous ones votes for it, any other against it. A clear
majority returns RECOVER: the caller inflates the covariance of the filter, and the next sample is
accepted. A working sensor wins the vote in spite of scatter and outliers, a sensor with random
readings does not. A sensor that repeats a refused value exactly is stuck: it is refused until the
value changes, even if the covariance has meanwhile grown enough to accept it. If most samples of a
sensor are refused, a single one that fits is not accepted until several agree with each other or
the vote is won.

Holds no equation of the thesis, whose filters have no gate.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit

from .blocks import Vec2

ACCEPT, REFUSE, RECOVER = range(3)
DISTRUST = 4     # refused samples more than fitting ones, from which on a fitting one is refused
MAX_NET_REFUSALS = 8   # limit of their count
MAJORITY = 0.6   # net share of votes for the centre at which the filter counts as wrong
FADE = 0.1       # weight of one more sample in the scatter
FOLLOW = 0.5     # share of the way to a new sample that agrees, by which the centre moves


class Gate(NamedTuple):
    """Memory of the gate of one sensor."""

    refused: int      # [-] samples refused by gate or validity since start
    streak: int       # [-] unused samples that voted for their centre, less those against it
    age: float        # s, since the first of them
    first: Vec2       # unit of the sensor, the first of them
    innovation: Vec2  # unit of the innovation, their centre
    varied: bool      # true: one of them differed from the first
    net_refusals: int        # [-] samples refused more than fitted lately, 0 ... MOST_DOUBT
    voted: int        # [-] unused samples since the first one that voted for this centre
    scatter: float    # unit of the innovation squared, of those that voted; fades with used ones


OPEN = Gate(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0), False, 0, 0, 0.0)


class Trial(NamedTuple):
    """One sample before its gate; a scalar stands in both places of a pair."""

    value: Vec2          # unit of the sensor, raw sample
    innovation: Vec2     # unit of the innovation; the value compared with the previous sample
    variance: float      # the same squared, of the difference of two that agree, summed
    ratio: float         # -, squared innovation over variance times squared gate


@jit
def advance(gate: Gate, dt: float) -> Gate:
    """Return the gate dt seconds later."""
    age = gate.age + dt if gate.streak > 0 else 0.0
    return Gate(
        gate.refused, gate.streak, age, gate.first, gate.innovation, gate.varied,
        gate.net_refusals, gate.voted, gate.scatter)


@jit
def refuse_invalid(gate: Gate) -> Gate:
    """Return the gate after a sample outside the validity of its model, which is only counted."""
    return Gate(
        gate.refused + 1, gate.streak, gate.age, gate.first, gate.innovation, gate.varied,
        min(MAX_NET_REFUSALS, gate.net_refusals + 1), gate.voted, gate.scatter)


@jit
def accept(gate: Gate) -> Gate:
    """Return the gate after a sample that was used."""
    net_refusals = max(0, gate.net_refusals - 1)
    return Gate(
        gate.refused, 0, 0.0, gate.first, gate.innovation, False, net_refusals, 0,
        (1.0 - FADE) * gate.scatter)


@jit
def judge(gate: Gate, trial: Trial, width: float, recovery_time: float) -> tuple[Gate, int]:
    """
    Judge one sample.

    Parameters
    ----------
    gate
        Result of the previous call, advanced to now.
    trial
        The sample.
    width : sigma
        Of the gate.
    recovery_time : s
        Time without a used sample after which the filter may be wrong.

    Returns
    -------
    gate
        To be passed to the next call.
    verdict
        ACCEPT, REFUSE or RECOVER.

    """
    value, innovation, centre = trial.value, trial.innovation, gate.innovation
    varied = gate.varied or value[0] != gate.first[0] or value[1] != gate.first[1]
    x, y = innovation[0] - centre[0], innovation[1] - centre[1]
    agrees = x * x + y * y <= width * width * trial.variance
    net_refusals = min(MAX_NET_REFUSALS, gate.net_refusals + 1)
    if trial.ratio <= 1.0 and (gate.streak == 0 or varied):
        if gate.net_refusals < DISTRUST:
            return accept(gate), ACCEPT
        net_refusals = gate.net_refusals - 1 if agrees else gate.net_refusals
    if gate.streak == 0 or gate.streak == 1 and not agrees:
        return Gate(
            gate.refused + 1, 1, 0.0, value, innovation, False, net_refusals, 1,
            gate.scatter), REFUSE
    streak, voted, scatter = gate.streak - 1, gate.voted + 1, gate.scatter
    if agrees:
        streak = gate.streak + 1
        scatter += FADE * (0.5 * (x * x + y * y) - scatter)
        centre = (centre[0] + FOLLOW * x, centre[1] + FOLLOW * y)
    if varied and gate.age >= recovery_time and streak >= MAJORITY * voted:
        return Gate(
            gate.refused, streak, gate.age, gate.first, centre, varied, 0, voted,
            scatter), RECOVER
    return Gate(
        gate.refused + 1, streak, gate.age, gate.first, centre, varied, net_refusals, voted,
        scatter), REFUSE
