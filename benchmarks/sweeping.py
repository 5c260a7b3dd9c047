"""Sweeps over seeds on one core and on all, with and without sensors."""

from __future__ import annotations

import os
from pathlib import Path
import time

from mambo_flight.sweep import design
from mambo_flight.sweep.run import run
from mambo_flight.sweep.table import Journal

from .measure import Contender

SWEEP = """
title: seeds and wind
vary:
  seed: {{range: [1, {flights}]}}
  sim_node.simulator.wind.velocity: [[0.5, 0.0, 0.0]]
"""
RATE = 1000.0  # Hz, of the physics: drone-steps


def _took(folder: Path, flights: int, ideal: bool, workers: int) -> tuple[float, float]:
    """Fly a sweep of so many flights; return wall time and time in the air, in s."""
    path = folder / 'sweep.yaml'
    path.write_text(SWEEP.format(flights=flights))
    swept = design.Flights(design.read(path))
    journal = Journal(folder / 'sweep.rows', 'bench')
    began = time.perf_counter()
    try:
        run(swept, journal, ideal, workers)
    finally:
        journal.remove()
    wall = time.perf_counter() - began
    return wall, flights * swept[0].sim_node.duration


def _measure(folder: Path, few: int, many: int, ideal: bool, workers: int) -> dict[str, float]:
    """Fly few and many flights: the difference is what flights cost, without the start."""
    (short, less), (long, more) = (
        _took(folder, flights, ideal, workers) for flights in (few, many))
    factor = (more - less) / (long - short)
    return {'factor': factor, 'steps': factor * RATE * 1e-6, 'all': more / long, 'start': short}


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return sweeps on one core and on all of them."""
    cores = len(os.sched_getaffinity(0))

    def sweep(ideal: bool, workers: int) -> Contender:
        few, many = (64, 320) if ideal else (16, 96)
        many = few + (many - few) * (1 if quick else 5) * workers
        wanted = {'steps': 2.0 * workers} if ideal else {}
        return Contender(
            'sweep', f'sweep_{"ideal" if ideal else "sensors"}_{workers}',
            f'{"without" if ideal else "with all"} sensors, {workers} '
            f'process{"" if workers == 1 else "es"}',
            lambda: _measure(folder, few, many, ideal, workers),
            lambda: _took(folder, 2 * workers, ideal, workers) and None, at_least=wanted)
    return [sweep(ideal, workers) for ideal in (True, False)
            for workers in sorted({1, cores})]
