"""Which claims notice which mutated truths, on claims that need no flight and on some that do."""

from mambo_thesis import reproduce
from mambo_thesis.figures import matrix, truths
from mambo_thesis.figures.claim import at_most, Claim, CLAIMS, near, Result
from mambo_thesis.figures.truths import MUTATIONS
import numpy as np
import pytest


def weighed():
    """Two numbers of the drone, one of which depends on its mass."""
    return Result([near('mass', truths.vehicle().mass, 0.068, 0.001, 'kg'),
                   at_most('gravity', truths.vehicle().gravity, 9.9)])


def heavy(broken_by=('mass +10 %',), examine=weighed):
    return Claim('9.9', 'it weighs 68 g', '', examine, 'a mass', 'whether', broken_by)


def test_a_claim_notices_what_changes_what_it_measures():
    entry, = matrix.matrix([heavy()])
    assert entry.noticed == {'mass +10 %': ['mass']} and not entry.missing
    assert entry.verdict == 'reproduced'


def test_what_a_claim_should_notice_and_does_not_is_missing():
    entry, = matrix.matrix([heavy(('mass +10 %', 'wind'))], [MUTATIONS['wind']])
    assert entry.missing == ['mass +10 %', 'wind'] and not entry.noticed


def test_a_claim_without_numbers_is_left_out():
    assert not matrix.matrix([heavy(examine=lambda: Result([]))])


def test_a_drone_that_is_nowhere_loses_everything_that_held():
    def lost():
        if truths.vehicle().mass > 0.07:
            raise np.linalg.LinAlgError
        return weighed()
    entry, = matrix.matrix([heavy(examine=lost)], [MUTATIONS['mass +10 %']])
    assert entry.noticed == {'mass +10 %': ['mass', 'gravity']}


def test_what_did_not_hold_before_is_no_loss():
    before = Result([at_most('a', 2.0, 1.0), at_most('b', 0.0, 1.0)])
    after = Result([at_most('a', 3.0, 1.0), at_most('b', 2.0, 1.0)])
    assert matrix.no_longer_holding(before, after) == ['b']
    assert not matrix.no_longer_holding(after, before)


# one mutation of each kind that a claim cannot be reproduced without; the matrix has all of them
@pytest.mark.parametrize(('number', 'mutation'), [
    ('5.10', 'factor -10 %'), ('5.11', 'slope 0'), ('5.11', 'slope reversed'),
    ('5.13', 'slope x 2'), ('C.4', 'leak -1'), ('C.7', 'slope reversed'), ('C.2', 'slope 0'),
    ('C.1', 'slope reversed'), ('6.4', 'drag x 2'), ('6.5', 'drag x 4'), ('6.6', 'drag absent'),
    ('6.1', 'motor map'), ('4.3', 'mass +10 %'), ('5.5', 'calibration'), ('6.3', 'inertia x 2'),
    ('Section 4.4.2', 'motor map')])
def test_a_mutated_drone_is_noticed(number, mutation):
    entry, = matrix.matrix([CLAIMS[number]], [MUTATIONS[mutation]])
    assert mutation in entry.noticed


def test_every_claim_that_measures_says_what_the_simulator_contains_and_what_is_left_to_test():
    for claim in reproduce.select_figures([]):
        if claim.number not in ('4.1, 4.2, 4.5, 4.7', '5.1', '5.2'):
            assert claim.contains and claim.tests, claim.title
        assert set(claim.broken_by) <= set(MUTATIONS), claim.title
