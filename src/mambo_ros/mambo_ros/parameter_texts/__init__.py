"""
What each parameter of a flight is, in one sentence.

A declaration holds unit, range and source of a number; the words here say what the number means,
where the source does not.
They are found by the name of the parameter within its node, or by the end of that name, the
longest first: ``vehicle.mass`` also describes ``simulator.vehicle.mass``.
"""

from __future__ import annotations

from . import control, estimation, simulation

TEXTS: dict[str, str] = {**simulation.TEXTS, **estimation.TEXTS, **control.TEXTS}


def key_of(name: str) -> str:
    """Return the key of a parameter in :data:`TEXTS`; empty: it has none."""
    parts = name.split('.')
    ends = ('.'.join(parts[i:]) for i in range(len(parts)))
    return next((end for end in ends if end in TEXTS), '')


def describe(name: str) -> str:
    """Return what a parameter is, by its name within its node; empty: nothing is known."""
    return TEXTS.get(key_of(name), '')
