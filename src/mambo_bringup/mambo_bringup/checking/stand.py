"""
The course of a check: the rest of the graph is driven step by step around the node.

``sim`` is the node that owns time and ``loop`` serves it; the nodes that are not checked are in
the same loop. What goes to the checked node alone can be held back.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import contextmanager
import time
from typing import Any

from . import ends
from .transcript import STEP, Transcript

BACKLOG = 100        # steps at once; for all but the controller
BACKLOG_PATIENT = 15  # the in-loop controller takes an input for missing after 20
_GROUND = 40         # steps before that
TIMES = {'takeoff_time': 0.8, 'climb_duration': 1.0, 'start_time': 1.8, 'blend_duration': 0.5,
         'landing_time': 3.5, 'height': 0.8}
"""
Of the flight plan, s and m: take-off after the backlog, hover after the steps in lockstep, landing
after those in real time, which end at 3.4 s at the latest.
"""
_FLIGHT = 260        # steps in lockstep, until the vehicle hovers
_PACED = 200         # steps in real time
_LANDED = TIMES['landing_time'] + TIMES['blend_duration'] + TIMES['climb_duration'] + 0.1
"""Time at which the reference has landed and rested for some steps, s."""
_HOLD = 0.15         # s of wall time for which an input is held back
_PAUSE = 0.4         # s of wall time for which nothing happens
_AFTER = 20          # steps after what was tried
_GIVE_UP = 3         # steps without an answer after which none is waited for
_WRONG = 2.0         # s of wall time for a node that is there, but publishes something else


class Stand:
    """
    The rest of the graph and what it hears.

    Parameters
    ----------
    sim, loop
        Of the module.
    transcripts
        Of the checked nodes.
    patience : s
        Wall time for one answer.

    """

    def __init__(self, sim: Any, loop: Any, transcripts: Sequence[Transcript], patience: float,
                 ) -> None:
        self.sim, self.loop, self.transcripts = sim, loop, transcripts
        self._patience, self._silent = patience, 0

    def run(self) -> None:
        """Try every rule that the graph can show."""
        for one in self.transcripts:
            early = len(one.heard)
            one.note('start', not early, 'nothing before the flight begins' if not early else (
                f'{early} messages before the flight begins, wanted none'))
            one.heard.clear()
        self.steps(_GROUND)
        if self.dead:
            return  # nothing else can be told of it
        self._backlog()
        self.steps(_FLIGHT)
        if self.dead:
            return
        for one in self.transcripts:
            self._ready(one)
        self.steps(_AFTER)
        self._pause()
        for one in self.transcripts:
            self._miss(one)
        self._pace()
        if self.sim.idle is not None:
            self.steps(round((_LANDED - self.sim.t * 1e-9) / STEP))

    @property
    def dead(self) -> bool:
        """Return whether the node answers no more."""
        return self._silent >= _GIVE_UP

    def sense(self, optional: bool = False, paced: bool = False) -> int:
        """Publish the inputs of a step; return its stamp in ns."""
        t = self.sim.t
        self.sim.sense()
        for one in self.transcripts:
            one.asked[t] = time.monotonic()
            if optional:
                one.optional.add(t)
            if paced:
                one.paced.add(t)
        return t

    def wait(self, t: int, seconds: float | None = None) -> bool:
        """Serve the graph until a stamp is answered by all; return whether it was."""
        patience = self._patience if not self.dead else STEP
        limit = time.monotonic() + (patience if seconds is None else seconds)
        while not (all(one.answered(t) for one in self.transcripts) and self.sim.answered):
            if time.monotonic() > limit or self.loop.stopping:
                return False
            self.loop.once(0.005)
        return True

    def steps(self, count: int) -> None:
        """Fly steps in lockstep."""
        for _ in range(count):
            answered = self.wait(self.sense())
            self._silent = 0 if answered else self._silent + 1
            self.sim.advance()
            if self.loop.stopping:
                return

    def _backlog(self) -> None:
        """Publish many steps at once, at rest on the ground; all must be answered."""
        alone = [one.contract.node for one in self.transcripts] == ['controller']
        count = BACKLOG if alone else BACKLOG_PATIENT
        stamps = []
        for _ in range(count):
            stamps.append(self.sense())
            self.loop.once(0.0)
            self.sim.advance()
        self.wait(stamps[-1])
        self.settle(_HOLD)
        for one in self.transcripts:
            missing = sum(not one.answered(t) for t in stamps)
            one.note('backlog', not missing, f'{count} steps at once are answered' if (
                not missing) else f'{missing} of {count} steps at once have no answer: keep at '
                'least 2000 messages of each input')

    def settle(self, seconds: float) -> None:
        """Serve the graph for a while."""
        limit = time.monotonic() + seconds
        while time.monotonic() < limit and not self.loop.stopping:
            self.loop.once(0.005)

    @contextmanager
    def held(self, topic: str) -> Any:
        """Keep a topic from other processes; yield what publishes what was kept."""
        output = self.loop.output(topic)
        kept: list[bytes] = []
        publish = output.divert(kept.append)

        def release() -> None:
            """Publish it."""
            output.divert(publish)
            for data in kept:
                publish(data)
        try:
            yield release
        finally:
            output.divert(publish)

    def _name(self, topic: Any) -> str:
        return self.sim.resolve_topic_name(topic.name)

    def _ready(self, one: Transcript) -> None:
        """Hold each input back for a while: nothing must be answered before it is there."""
        if one.contract.own_rate:
            return
        for topic in one.contract.inputs:
            name = self._name(topic)
            with self.held(name) as release:
                t = self.sense()
                self.settle(_HOLD)
                early = one.answered(t)
                release()
                for other in self.transcripts:
                    other.asked[t] = time.monotonic()
            answered = self.wait(t)
            if early:
                one.note('ready', False, f'answered {t * 1e-9:.3f} s before {name} of it was '
                         'published')
            else:
                one.note('ready', answered, 'waits for the last input of a step' if answered else (
                    f'{t * 1e-9:.3f} s is not answered where {name} is the last to come'))
            self.sim.advance()

    def _pause(self) -> None:
        """Let the time of the flight stand still."""
        self.settle(_HOLD)  # who has a rate of its own may be behind
        before = [len(one.heard) for one in self.transcripts]
        self.settle(_PAUSE)
        for one, count in zip(self.transcripts, before, strict=True):
            more = len(one.heard) - count
            one.note('no timers', not more, 'nothing while time stands still' if not more else (
                f'{more} messages in {_PAUSE:g} s in which time stood still, wanted none'))

    def _miss(self, one: Transcript) -> None:
        """Leave one input of a step out for good; the next steps must be answered."""
        for topic in one.contract.inputs:
            name, count = self._name(topic), len(one.heard)
            with self.held(name):
                t = self.sense(optional=True)
                self.wait(t, _HOLD)
            self.sim.advance()
            stamps, gone = [], 0
            for _ in range(_AFTER):
                stamps.append(self.sim.t)
                self.steps(1)
            self._silent = 0
            if one.contract.own_rate:
                gone = int(len(one.heard) == count)
            else:
                gone = sum(not one.answered(stamp) for stamp in stamps)
            one.note('missing input', not gone, 'goes on after an input that never came' if (
                not gone) else f'{gone} of the next {_AFTER} steps have no answer after {name} of '
                f'{t * 1e-9:.3f} s never came')

    def _pace(self) -> None:
        """Fly by the wall clock, whatever is answered."""
        began = time.monotonic()
        for k in range(_PACED):
            self.sense(paced=True)
            while (left := began + (k + 1) * STEP - time.monotonic()) > 0.0:
                self.loop.once(left)
            if self.loop.stopping:
                return
            self.sim.advance()
        self.settle(_HOLD)


def wait_for_nodes(sim: Any, loop: Any, transcripts: Sequence[Transcript], patience: float,
                   ) -> bool:
    """Serve the graph until the checked nodes are there; note who never came."""
    limit = time.monotonic() + patience
    graph = [node.get_name() for node in loop.nodes]
    while sim.links.look():
        loop.once(0.01)
        loop.turn()
        for one in transcripts:
            answer = one.contract.answer
            found = ends.publishers(sim, answer)
            if found and found[0].topic_type != answer.type_name or (
                    not found and ends.same_type(sim, answer, graph)):
                limit = min(limit, time.monotonic() + _WRONG)
        if loop.stopping or time.monotonic() > limit:
            break
    sim.links.close()
    present = True
    for one in transcripts:
        if ends.publishers(sim, one.contract.answer):
            present &= ends.check(sim, one)
        else:
            ends.check_absent(sim, one)
            present = False
    return present and not loop.stopping


def refusals(nodes: Sequence[Any], topic: str) -> dict[str, int]:
    """Return what the nodes of the graph refused of a topic, by reason."""
    out: dict[str, int] = {}
    for node in nodes:
        for guard in node.input_guards:
            if guard.topic == topic:
                for reason, count in guard.refused.items():
                    out[reason] = max(out.get(reason, 0), count)
    return out


def note_refusals(nodes: Sequence[Any], one: Transcript, topic: str) -> None:
    """Judge a node by what the others refused."""
    refused = refusals(nodes, topic)
    said = ', '.join(f'{count} {reason}' for reason, count in sorted(refused.items()))
    one.note('accepted', not refused, f'the graph refused: {said}' if refused else (
        'the graph refused no message'))

