"""Samples of several drones that arrive one by one, put together by their stamps."""

from __future__ import annotations

from mambo_model.motion.rigid_body import State

MOST = 2000  # steps that wait: 10 s of flight
Step = tuple[int, list[State | None]]


class Gathering:
    """
    True states of all drones of a hall, step by step.

    Parameters
    ----------
    drones : int
        How many there are.

    """

    def __init__(self, drones: int) -> None:
        self._drones = drones
        self._waiting: dict[int, list[State | None]] = {}
        self._done = -1  # ns, of the newest step that was given out

    def put(self, number: int, t: int, state: State) -> list[Step]:
        """
        Take a sample; return the steps that are to be looked at now, in order.

        A step is given out when the samples of all drones are there, and before it the older ones
        in which some are missing: the samples of each drone come in order. Of too many that wait
        the oldest is given out. A sample of a step that was given out is left out.

        Parameters
        ----------
        number : int
            Of the drone, from 0.
        t : ns
            Stamp.
        state
            True state.

        Returns
        -------
        steps
            Stamp in ns and the state of each drone, None where it is missing.

        """
        if t <= self._done:
            return []
        states = self._waiting.setdefault(t, [None] * self._drones)
        states[number] = state
        if all(one is not None for one in states):
            self._done = t
        elif len(self._waiting) > MOST:
            self._done = min(self._waiting)
        return [(at, self._waiting.pop(at)) for at in sorted(self._waiting) if at <= self._done]
