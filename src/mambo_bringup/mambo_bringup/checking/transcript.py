"""What was heard of a node that is checked, and which rules of its contract that keeps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
import time
from typing import NamedTuple

import numpy as np

from .contract import Contract

KEPT, BROKEN, UNSEEN = 'kept', 'broken', 'not observed'
FOUND = 'found: '       # begins the line of check_node with a finding, JSON
TIMES = 'times: '       # that with the latencies of a node
READY = 'checked'       # the line after the last one
STEP = 0.005           # s, period of the graph
LATE = 0.5             # s of wall time: the motors' watchdog
RULES = (
    'publishes', 'type', 'qos', 'one publisher', 'subscribes', 'start', 'answers', 'stamps',
    'order', 'values', 'frames', 'ready', 'backlog', 'no timers', 'missing input', 'use_sim_time',
    'accepted', 'motors off', 'real time')
_OF_STEPS = ('ready', 'backlog', 'real time')  # not of who has a rate of its own
_OF_MOTORS = ('motors off',)  # of who commands them alone
_DAY = 86_400_000_000_000  # ns


class Finding(NamedTuple):
    """The verdict on one rule."""

    node: str
    rule: str
    verdict: str
    seen: str  # one line: what was seen, and what is wanted if it is not that


class Heard(NamedTuple):
    """One message of a node."""

    wall: float   # s, time.monotonic
    stamp: int    # ns
    wrong: str    # what is wrong with its numbers


class Transcript:
    """
    Everything that was heard of one node, and what was asked of it.

    Attributes
    ----------
    asked : dict[int, float]
        Wall time at which what it answers was complete, s, by stamp in ns.
    optional : set[int]
        Stamps that it may leave unanswered, as something was held back for good.
    heard : list[Heard]
        In the order of arrival.
    notes : dict[str, tuple[str, str]]
        Verdict and text of the rules that were tried one at a time, by rule.
    paced : set[int]
        Stamps of the part in real time.

    """

    def __init__(self, contract: Contract) -> None:
        self.contract = contract
        self.asked: dict[int, float] = {}
        self.optional: set[int] = set()
        self.paced: set[int] = set()
        self.heard: list[Heard] = []
        self.notes: dict[str, tuple[str, str]] = {}
        self._answered: set[int] = set()

    def hear(self, data: bytes) -> None:
        """Take one message."""
        try:
            stamp, wrong = self.contract.read(data)
        except Exception as error:  # of a message that is damaged
            stamp, wrong = -1, f'a message that cannot be read: {error}'
        self._answered.add(stamp)
        self.heard.append(Heard(time.monotonic(), stamp, wrong))

    def answered(self, stamp: int) -> bool:
        """Return whether a stamp has been answered."""
        return stamp in self._answered or self.contract.own_rate

    def note(self, rule: str, kept: bool, seen: str) -> None:
        """Keep the verdict on a rule that was tried; one that was broken once stays so."""
        if self.notes.get(rule, ('',))[0] != BROKEN:
            self.notes[rule] = (KEPT if kept else BROKEN, seen)

    def latencies(self, paced: bool) -> np.ndarray:
        """Return the wall time from question to answer, s, in lockstep or in real time."""
        if self.contract.own_rate:
            return np.array([])
        return np.array([
            one.wall - self.asked[one.stamp] for one in self.heard
            if one.stamp in self.asked and one.stamp not in self.optional
            and (one.stamp in self.paced) == paced])

    def findings(self) -> Iterator[Finding]:
        """Yield the verdict on each rule, in the order of the page."""
        found = dict.fromkeys(RULES, (UNSEEN, '')) | self.notes
        if self.asked:
            found |= dict(self._of_messages())
        for rule in RULES:
            if not (self.contract.own_rate and rule in _OF_STEPS) and not (
                    rule in _OF_MOTORS and self.contract.node != 'controller'):
                yield Finding(self.contract.node, rule, *found[rule])

    def _of_messages(self) -> Iterator[tuple[str, tuple[str, str]]]:
        """Yield what the messages by themselves say."""
        yield 'stamps', (stamps := self._stamps())
        yield 'answers', self._answers(stamps[0] == BROKEN)
        stamps_in_order = [one.stamp for one in self.heard if one.stamp >= 0]
        back = [(a, b) for a, b in zip(stamps_in_order, stamps_in_order[1:]) if b <= a]
        yield 'order', (BROKEN, f'{len(back)} stamps are not after the one before, first '
                        f'{back[0][1] * 1e-9:.3f} s after {back[0][0] * 1e-9:.3f} s'
                        ) if back else (KEPT, 'every stamp is after the one before')
        wrong = [one for one in self.heard if one.wrong]
        yield 'values', (BROKEN, f'{len(wrong)} messages, the first at '
                         f'{wrong[0].stamp * 1e-9:.3f} s: {wrong[0].wrong}') if wrong else (
            KEPT, f'{len(self.heard)} messages, all finite and within limits')
        yield 'real time', self._real_time()

    def _stamps(self) -> tuple[str, str]:
        known = {*self.asked, *self.optional}
        if self.contract.own_rate:
            last = max(known, default=0)
            odd = [one for one in self.heard if not 0 <= one.stamp <= last]
            wanted = 'times of the flight'
        else:
            odd = [one for one in self.heard if one.stamp not in known]
            wanted = 'those of its inputs'
        if not odd:
            return KEPT, f'all are {wanted}'
        stamp = odd[0].stamp
        what = f'{stamp * 1e-9:.3f} s'
        if abs(stamp - time.time_ns()) < _DAY:
            what += ', the wall clock'
        return BROKEN, f'{len(odd)} of {len(self.heard)} are not {wanted}, the first is {what}'

    def _answers(self, by_count: bool) -> tuple[str, str]:
        asked = [stamp for stamp in self.asked if stamp not in self.optional]
        if self.contract.own_rate:
            seconds = (max(asked) - min(asked)) * 1e-9 if asked else 0.0
            rate = len(self.heard) / seconds if seconds else 0.0
            return (KEPT if self.heard else BROKEN), f'{rate:.1f} messages a second of flight'
        if by_count:  # which answers which cannot be told
            wrong = len(self.heard) < len(asked)
            return (BROKEN if wrong else KEPT), (
                f'{len(self.heard)} messages for {len(asked)} steps')
        counts = Counter(one.stamp for one in self.heard)
        missing = [stamp for stamp in asked if not counts[stamp]]
        twice = [stamp for stamp, count in counts.items() if count > 1]
        if not missing and not twice:
            return KEPT, f'one for each of {len(asked)} steps'
        said = [f'{len(stamps)} of {len(asked)} steps {what}, the first {min(stamps) * 1e-9:.3f} s'
                for stamps, what in ((missing, 'have none'), (twice, 'have several')) if stamps]
        return BROKEN, f'{"; ".join(said)}; wanted one for each'

    def _real_time(self) -> tuple[str, str]:
        took = self.latencies(paced=True)
        if not len(took):
            return UNSEEN, ''
        late = int((took > STEP).sum())
        text = (f'median {np.median(took) * 1e3:.1f} ms, 99 % {np.quantile(took, 0.99) * 1e3:.1f} '
                f'ms, largest {took.max() * 1e3:.1f} ms; {late} of {len(took)} later than '
                f'{STEP * 1e3:.0f} ms')
        if took.max() > LATE:
            return BROKEN, f'{text}; after {LATE:g} s without a command the motors are stopped'
        if 2 * late >= len(took):
            return BROKEN, f'{text}; wanted most in time'
        return KEPT, text
