"""
Innovation gate with a way out of being wrong for ever.

A measurement is refused where its squared innovation exceeds the squared gate times its variance.
If refusals of one sensor go on for ``recovery_time``, it may be the filter that is wrong: where
the refused samples agree with each other, one innovation (of the sonar: one height) being within
a gate of the one before, the verdict is RECOVER: the caller widens the doubts of the filter, and
the next sample is accepted. Outliers do not agree with each other. A sensor that repeats a refused
value to the bit is stuck: it is refused until the value changes, even if the filter has meanwhile
become unsure enough to believe it. A sensor most of whose samples are refused is not believed
where one happens to fit, until several do that agree with each other.

Holds no equation of the thesis, whose filters have no gate.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit

from .blocks import Vec2

ACCEPT, REFUSE, RECOVER = range(3)
DISTRUST = 4     # refused samples more than fitting ones, from which on a fitting one is refused
MOST_DOUBT = 8   # of them that are remembered


class Gate(NamedTuple):
    """What the gate of one sensor remembers."""

    refused: int      # [-] samples refused by gate or validity since start
    streak: int       # [-] samples in a row that were refused and agree with each other
    age: float        # s, since the first of them
    first: Vec2       # unit of the sensor, the first of them
    innovation: Vec2  # unit of the innovation, that of the last of them
    varied: bool      # true: one of them differed from the first
    doubt: int        # [-] samples refused more than fitted lately, 0 ... MOST_DOUBT


OPEN = Gate(0, 0, 0.0, (0.0, 0.0), (0.0, 0.0), False, 0)


class Trial(NamedTuple):
    """One sample before its gate; a scalar stands in both places of a pair."""

    value: Vec2          # unit of the sensor, as it came
    innovation: Vec2     # unit of the innovation; or else what is to agree with the sample before
    variance: float      # the same squared, of what successive ones may differ by, summed
    ratio: float         # -, squared innovation over variance times squared gate


@jit
def advance(gate: Gate, dt: float) -> Gate:
    """Return the gate dt seconds later."""
    age = gate.age + dt if gate.streak > 0 else 0.0
    return Gate(
        gate.refused, gate.streak, age, gate.first, gate.innovation, gate.varied, gate.doubt)


@jit
def refuse_invalid(gate: Gate) -> Gate:
    """Return the gate after a sample outside the validity of its model, which it only counts."""
    return Gate(
        gate.refused + 1, gate.streak, gate.age, gate.first, gate.innovation, gate.varied,
        min(MOST_DOUBT, gate.doubt + 1))


@jit
def accept(gate: Gate) -> Gate:
    """Return the gate after a sample that was used."""
    doubt = max(0, gate.doubt - 1)
    return Gate(gate.refused, 0, 0.0, gate.first, gate.innovation, False, doubt)


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
        How long refusals must go on until the filter is believed wrong.

    Returns
    -------
    gate
        To be passed to the next call.
    verdict
        ACCEPT, REFUSE or RECOVER.

    """
    value, innovation = trial.value, trial.innovation
    changed = value[0] != gate.first[0] or value[1] != gate.first[1]
    varied = gate.varied or changed
    x, y = innovation[0] - gate.innovation[0], innovation[1] - gate.innovation[1]
    agrees = x * x + y * y <= width * width * trial.variance
    if trial.ratio <= 1.0 and (gate.streak == 0 or varied):
        if gate.doubt < DISTRUST:
            return accept(gate), ACCEPT
        doubt = gate.doubt - 1 if agrees else gate.doubt
        return Gate(gate.refused + 1, 0, 0.0, value, innovation, False, doubt), REFUSE
    doubt = min(MOST_DOUBT, gate.doubt + 1)
    if gate.streak == 0 or not agrees:
        return Gate(gate.refused + 1, 1, 0.0, value, innovation, False, doubt), REFUSE
    if varied and gate.age >= recovery_time:
        return Gate(gate.refused, 0, 0.0, gate.first, innovation, False, 0), RECOVER
    return Gate(
        gate.refused + 1, gate.streak + 1, gate.age, gate.first, innovation, varied,
        doubt), REFUSE
