"""
The matrix: every claim against every mutated truth, and what noticed it.

A claim notices a mutation if something that holds of it for the drone as it is does not hold for
the mutated one. Two seeds of the noise are enough for that, and only the claims are examined
whose flights a mutation changes.
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
    """A claim: what holds of it for the drone as it is, and which mutations it noticed."""

    claim: Claim
    verdict: str
    noticed: dict[str, list[str]]  # {mutation: what no longer holds}

    @property
    def missing(self) -> list[str]:
        """Return the mutations of ``broken_by`` that it did not notice."""
        return [name for name in self.claim.broken_by if name not in self.noticed]


def lost(before: Result, after: Result) -> list[str]:
    """Return what holds in a result and not in another one of the same claim."""
    return [a.what for a, b in zip(before.measured, after.measured, strict=True)
            if a.holds and not b.holds]


def examined(
    claim: Claim, mutation: Mutation | None, seeds: tuple[int, ...] = SEEDS,
) -> Result | None:
    """Return what is measured with a mutated truth; None if nothing can be measured any more."""
    with truths.mutated(mutation, seeds):
        try:
            return claim.examine()
        except np.linalg.LinAlgError:  # a drone that is nowhere
            return None


def matrix(
    claims: Sequence[Claim], mutations: Iterable[Mutation] | None = None,
) -> list[Entry]:
    """Return an entry for each claim that measures something; None: all mutations."""
    mutations = list(MUTATIONS.values() if mutations is None else mutations)
    before = {c.number: examined(c, None) for c in claims}
    asked = [c for c in claims if before[c.number].measured]
    noticed: dict[str, dict[str, list[str]]] = {c.number: {} for c in asked}
    for mutation in tqdm(mutations, desc='mutated truths', disable=None, leave=False):
        for claim in asked:
            whole, after = before[claim.number], examined(claim, mutation)
            gone = lost(whole, after) if after else [m.what for m in whole.measured if m.holds]
            if gone:
                noticed[claim.number][mutation.name] = gone
    return [Entry(c, c.verdict(examined(c, None, truths.SEEDS)), noticed[c.number])
            for c in asked]
