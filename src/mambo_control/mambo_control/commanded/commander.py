"""
Commands of a running flight: those of its script at their times, others as they come.

A command that comes takes effect at the next control step. What was accepted, with its time, is
all that is needed to make the same reference again.
"""

from __future__ import annotations

from collections import Counter, deque

from mambo_model.motion.flight_command import FlightCommand, NAMES, TAKEOFF
from mambo_model.vehicle.parameters import Vehicle

from . import script, timeline
from .command_params import CommandParams

SHUT_DOWN = 'the controller has shut the motors down: start another flight'
FAILING = ('the failsafe of the controller flies, not the reference: the reason in motor_pwm '
           'says why')


class Commander:
    """
    The commands of one flight.

    Parameters
    ----------
    params
        Script and limits.
    vehicle
        As the controller knows it.

    Attributes
    ----------
    timeline : timeline.Timeline
        The reference, without what is over.
    t : int
        Newest control step, ns; -1: before the first.
    refused : Counter
        Commands that were refused, by kind.
    shut_down : bool
        Whether the controller has shut the motors down, which it does for good: commands that
        come are refused.
    failing : bool
        Whether its failsafe flies, which a landing of it does for good: likewise, but for a
        take-off from the floor.

    """

    def __init__(self, params: CommandParams, vehicle: Vehicle) -> None:
        self._params, self._vehicle = params, vehicle
        self._script = deque(script.parse(params.script))
        self.timeline = timeline.initial()
        self.t = -1
        self.refused: Counter[str] = Counter()
        self.shut_down = self.failing = False

    @property
    def next_step(self) -> int:
        """Return the time at which a command given now takes effect, ns."""
        return max(self.t + script.STEP_NS if self.t >= 0 else 0, self.timeline.last)

    def is_free(self, t: int) -> bool:
        """Return whether the vehicle can follow a stream at a time in ns: it flies and waits."""
        return not (self.shut_down or self.failing) and timeline.is_free(self.timeline, t * 1e-9)

    def give(self, command: FlightCommand) -> tuple[FlightCommand, str]:
        """
        Carry out a command at the next control step.

        Returns
        -------
        command
            With its time.
        reason
            Why it was refused; empty: it was not.

        """
        command = command._replace(t=self.next_step)
        if self.shut_down or self.failing and command.kind != TAKEOFF:
            self.refused[NAMES[command.kind]] += 1
            return command, SHUT_DOWN if self.shut_down else FAILING
        return self._take(command)

    def advance(self, t: int) -> list[tuple[FlightCommand, str]]:
        """Carry out what the script has up to a control step, in ns; return as :meth:`give`."""
        out = []
        while self._script and self._script[0].t <= t:
            out.append(self._take(self._script.popleft()))
        self.t = t
        return out

    def _take(self, command: FlightCommand) -> tuple[FlightCommand, str]:
        past = timeline.forgotten(self.timeline, command.t * 1e-9)
        after, reason = timeline.step(past, command, self._params, self._vehicle)
        if reason:
            self.refused[NAMES[command.kind]] += 1
        else:
            self.timeline = after
        return command, reason
