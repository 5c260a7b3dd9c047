"""The page of a twin: flights beside their simulation, one after the other on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mambo_signals.flight_phases import Phases
from mambo_signals.motion import Motion
import numpy as np

from ..compare import pair, report
from ..compare.report import Table
from .loop import Flown
from .recorded import Recorded

PAUSE = 2.0  # s between two flights on the page
WHOLE = Phases(None, None, 'whole flight')


class Beside(NamedTuple):
    """A flight in the air, and its simulation; None without a reference in the recording."""

    flight: Recorded
    flown: Flown | None


def _motions(pairs: Sequence[Beside]) -> tuple[list[Motion], list[Motion], list[Motion]]:
    """Return what was flown, simulated and wanted, one flight after the other."""
    flown, simulated, wanted, zero = [], [], [], 0.0
    for one, model in pairs:
        air = one.air
        t = one.t[air] - one.t[air][0] + zero
        zero = t[-1] + PAUSE
        stamps = np.rint(t * 1e9).astype(np.int64)
        flown.append(Motion(
            'flown', stamps, one.position[air], one.attitude[air], one.velocity[air]))
        if model is not None and one.onboard is not None:
            simulated.append(Motion('simulated', stamps, *(
                model.position, model.attitude, model.velocity)))
            upright = np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1))
            wanted.append(Motion('reference', stamps, one.onboard.reference[air], upright))
    return flown, simulated, wanted


def _one(motions: Sequence[Motion]) -> Motion:
    """Return motions that follow each other as one."""
    return Motion(motions[0].name, *(np.concatenate([getattr(m, name) for m in motions])
                                     for name in ('stamps', 'position', 'quaternion')),
                  np.concatenate([m.velocity for m in motions if m.velocity is not None])
                  if motions[0].velocity is not None else None)


def page(pairs: Sequence[Beside], tables: Sequence[Table], notes: Sequence[str]) -> report.Report:
    """Return the content of the page; sections are the errors of each flight."""
    flown, simulated, wanted = _motions(pairs)
    vehicles = [('flown', 'truth', _one(flown))]
    tracks = [*vehicles]
    sections, drawn = [], []
    if simulated:
        model, plan = _one(simulated), _one(wanted)
        vehicles.append(('simulated', 'estimate', model))
        tracks = [('reference', 'reference', plan), *vehicles]
        labels = ('simulated', 'flown')
        drawn = report.comparison_figures(
            pair.Comparison('', labels, tuple(pair.motions(model, vehicles[0][2])), WHOLE),
            '', {'position': [plan]}, ('estimate', 'truth'))
        names = [one.flight.name for one in pairs if one.flown is not None]
        here = [m for m, one in zip(flown, pairs) if one.flown is not None]
        sections = [pair.section(
            quantity, f'{name}: {quantity.name}, simulated minus flown', WHOLE)
                    for name, ours, theirs in zip(names, simulated, here)
                    for quantity in pair.motions(ours, theirs)]
    cards = [(one.flight.name, f'{100.0 * one.flown.rms(one.flight)[2]:.1f} cm',
              'RMS between simulated and flown path')
             for one in pairs if one.flown is not None]
    count = f'{len(pairs)} flights of one vehicle'
    return report.Report(
        f'{count} beside their simulation', f'{", ".join(one.flight.name for one in pairs)}. Each '
        'is left out once, and predicted by a model of the others.', [], cards, list(notes),
        sections, [], report.replay_of(tracks, vehicles), drawn, WHOLE, tables)


def write(path: Path, pairs: Sequence[Beside], tables: Sequence[Table],
          notes: Sequence[str]) -> Path:
    """
    Write the page.

    Raises
    ------
    InputError, JobError
        If the file cannot be written.

    """
    return report.write(path, page(pairs, tables, notes))
