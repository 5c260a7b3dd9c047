"""
The matrix of claims and mutated drones: which claims notice which mutations.

A claim notices a mutation if one of its measurements holds for the original drone but not for the
mutated one. Two seeds of the noise are enough for that.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from . import truths
from .claim import Claim, Result
from .truths import Mutation, MUTATIONS

SEEDS = (1, 2)


class Entry(NamedTuple):
    """A claim, its verdict for the original drone, and the mutations that it noticed."""

    claim: Claim
    verdict: str
    noticed: dict[str, list[str]]  # {mutation: measurements that no longer hold}

    @property
    def missing(self) -> list[str]:
        """Return the mutations of ``broken_by`` that it did not notice."""
        return [name for name in self.claim.broken_by if name not in self.noticed]


def no_longer_holding(before: Result, after: Result) -> list[str]:
    """Return the measurements that hold before a mutation but not after it."""
    return [a.what for a, b in zip(before.measured, after.measured, strict=True)
            if a.holds and not b.holds]


def examined(
    claim: Claim, mutation: Mutation | None, seeds: tuple[int, ...] = SEEDS,
) -> Result | None:
    """Examine a claim with a mutated drone; None if nothing can be measured any more."""
    with truths.mutated(mutation, seeds):
        try:
            return claim.examine()
        except np.linalg.LinAlgError:  # the drone has flown off
            return None


def matrix(
    claims: Sequence[Claim], mutations: Iterable[Mutation] | None = None,
) -> list[Entry]:
    """Return an entry for each claim with measurements; ``mutations`` None: all of them."""
    mutations = list(MUTATIONS.values() if mutations is None else mutations)
    before = {c.number: examined(c, None) for c in claims}
    measured = [c for c in claims if before[c.number].measured]
    noticed: dict[str, dict[str, list[str]]] = {c.number: {} for c in measured}
    for mutation in tqdm(mutations, desc='mutated drones', disable=None, leave=False):
        for claim in measured:
            original, after = before[claim.number], examined(claim, mutation)
            broken = no_longer_holding(original, after) if after else [
                m.what for m in original.measured if m.holds]
            if broken:
                noticed[claim.number][mutation.name] = broken
    return [Entry(c, c.verdict(examined(c, None, truths.SEEDS)), noticed[c.number])
            for c in measured]
