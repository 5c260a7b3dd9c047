"""
Innovation gate with a way out of being wrong for ever.

A measurement is refused where its squared innovation exceeds the squared gate times its variance.
If no sample of one sensor is used for ``recovery_time``, it may be the filter that is wrong. The
unused samples vote, as in the majority vote of Boyer and Moore: one whose innovation (of the
sonar: height) is near the centre of those before votes for it, another against it. A clear
majority gives the verdict RECOVER: the caller widens the doubts of the filter, and the next sample
is accepted. A real sensor wins the vote in spite of scatter and single outliers, a sensor that
reads anything does not. A sensor that repeats a refused value to the bit is stuck: it is refused
until the value changes, even if the filter has meanwhile become unsure enough to believe it. A
sensor most of whose samples are refused is not believed where one happens to fit, until several do
that agree with each other, or the vote is won.

Holds no equation of the thesis, whose filters have no gate.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit

from .blocks import Vec2

ACCEPT, REFUSE, RECOVER = range(3)
DISTRUST = 4     # refused samples more than fitting ones, from which on a fitting one is refused
MOST_DOUBT = 8   # of them that are remembered
MAJORITY = 0.6   # votes for the centre less those against it, over all, that make the filter wrong
FADE = 0.1       # weight of one more sample in the scatter
FOLLOW = 0.5     # share of the way to a new sample that agrees, by which the centre moves


class Gate(NamedTuple):
    """What the gate of one sensor remembers."""

    refused: int      # [-] samples refused by gate or validity since start
    streak: int       # [-] unused samples that voted for their centre, less those against it
    age: float        # s, since the first of them
    first: Vec2       # unit of the sensor, the first of them
    innovation: Vec2  # unit of the innovation, their centre
    varied: bool      # true: one of them differed from the first
    doubt: int        # [-] samples refused more than fitted lately, 0 ... MOST_DOUBT
    voted: int        # [-] unused samples since the first one that voted for this centre
    scatter: float    # unit of the innovation squared, of those that voted; fades with used ones


OPEN = Gate(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0), False, 0, 0, 0.0)


class Trial(NamedTuple):
    """One sample before its gate; a scalar stands in both places of a pair."""

    value: Vec2          # unit of the sensor, as it came
    innovation: Vec2     # unit of the innovation; or else what is to agree with the sample before
    variance: float      # the same squared, of the difference of two that agree, summed
    ratio: float         # -, squared innovation over variance times squared gate


@jit
def advance(gate: Gate, dt: float) -> Gate:
    """Return the gate dt seconds later."""
    age = gate.age + dt if gate.streak > 0 else 0.0
    return Gate(
        gate.refused, gate.streak, age, gate.first, gate.innovation, gate.varied, gate.doubt,
        gate.voted, gate.scatter)


@jit
def refuse_invalid(gate: Gate) -> Gate:
    """Return the gate after a sample outside the validity of its model, which it only counts."""
    return Gate(
        gate.refused + 1, gate.streak, gate.age, gate.first, gate.innovation, gate.varied,
        min(MOST_DOUBT, gate.doubt + 1), gate.voted, gate.scatter)


@jit
def accept(gate: Gate) -> Gate:
    """Return the gate after a sample that was used."""
    doubt = max(0, gate.doubt - 1)
    return Gate(
        gate.refused, 0, 0.0, gate.first, gate.innovation, False, doubt, 0,
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
        How long no sample must have been used until the filter is believed wrong.

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
    doubt = min(MOST_DOUBT, gate.doubt + 1)
    if trial.ratio <= 1.0 and (gate.streak == 0 or varied):
        if gate.doubt < DISTRUST:
            return accept(gate), ACCEPT
        doubt = gate.doubt - 1 if agrees else gate.doubt
    if gate.streak == 0 or gate.streak == 1 and not agrees:
        return Gate(
            gate.refused + 1, 1, 0.0, value, innovation, False, doubt, 1, gate.scatter), REFUSE
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
        gate.refused + 1, streak, gate.age, gate.first, centre, varied, doubt, voted,
        scatter), REFUSE
