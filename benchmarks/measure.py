"""Contenders, repetitions in turn, medians."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
import os
import time

import numpy as np


class Gap(RuntimeError):
    """Something cannot be measured here; the text says why in one line."""


@dataclass(frozen=True)
class Contender:
    """
    One row of a table.

    Attributes
    ----------
    group
        What the command line calls it, with others.
    name
        Unique, in the JSON file.
    title
        Of the row.
    run
        Measures once: {quantity: value}.
    prepare
        Loads and compiles, before the first measurement; returns what else is worth a note.
    detail
        Of the row, below its table.
    at_least, at_most
        {quantity: bound} that is wanted of the median.
    once
        Whether one repetition is enough, as it is long.

    """

    group: str
    name: str
    title: str
    run: Callable[[], dict[str, float]]
    prepare: Callable[[], str | None] = lambda: None
    detail: str = ''
    at_least: dict[str, float] = field(default_factory=dict)
    at_most: dict[str, float] = field(default_factory=dict)
    once: bool = False


@dataclass
class Result:
    """What the repetitions of a contender gave."""

    contender: Contender
    samples: list[dict[str, float]] = field(default_factory=list)
    preparation: float = float('nan')  # s of wall time
    note: str = ''
    gap: str = ''  # why there are no samples

    def values(self, quantity: str) -> np.ndarray:
        """Return the samples of a quantity, (n,); empty where it was not measured."""
        return np.array([sample[quantity] for sample in self.samples if quantity in sample])

    def median(self, quantity: str) -> float:
        """Return the median of a quantity, NaN where it was not measured."""
        values = self.values(quantity)
        return float(np.median(values)) if len(values) else float('nan')

    def wanted(self) -> list[tuple[str, str, bool]]:
        """Return quantity, bound and whether the median keeps it, of each bound."""
        c = self.contender
        return [
            *((name, f'>= {bound:g}', self.median(name) >= bound)
              for name, bound in c.at_least.items()),
            *((name, f'<= {bound:g}', self.median(name) <= bound)
              for name, bound in c.at_most.items())]


def timed(simulated: float, work: Callable[[], object]) -> dict[str, float]:
    """
    Do some work in this process and measure it.

    Parameters
    ----------
    simulated : s
        Flight time that the work simulates.
    work
        Of one thread.

    Returns
    -------
    ``factor`` and ``cpu_factor``: simulated time over wall time and over CPU time.

    """
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return {'factor': simulated / wall, 'cpu_factor': simulated / cpu}


def measure(
    contenders: Iterable[Contender], repetitions: int, say: Callable[[str], None],
) -> list[Result]:
    """
    Prepare all, then run all in turn, so often; a gap ends its contender only.

    In turn, so that a change of the machine's load hits all alike and ratios hold.
    """
    results = [Result(contender) for contender in contenders]
    for result in results:
        say(f'preparing {result.contender.name}')
        began = time.perf_counter()
        try:
            result.note = result.contender.prepare() or ''
        except Gap as gap:
            result.gap = str(gap)
        result.preparation = time.perf_counter() - began
    for number in range(repetitions):
        for result in results:
            if result.gap or (number and result.contender.once):
                continue
            say(f'repetition {number + 1} of {repetitions}: {result.contender.name}')
            try:
                result.samples.append(result.contender.run())
            except Gap as gap:
                result.gap = str(gap)
    for result in results:
        if result.gap:
            say(f'not measured: {result.contender.name}: {result.gap}')
    return results


def load() -> float:
    """Return how many processes ran or waited, mean of the last minute."""
    return os.getloadavg()[0]
