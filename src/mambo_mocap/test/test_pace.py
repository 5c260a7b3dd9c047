"""The clock of a flight followed."""

from mambo_mocap.pace import Pace, SPAN
import pytest

STEP = 5_000_000


def follow(pace, begin, steps, late, delays=(3, 1, 2)):
    """Add messages; return the offset after each."""
    out = []
    for k in range(begin, begin + steps):
        pace.add(k * STEP, k * STEP + late + delays[k % len(delays)] * 1_000_000)
        out.append(pace.offset)
    return out


def test_the_offset_is_that_of_the_least_delayed_message():
    assert set(follow(Pace(), 0, 2000, 10**18)[2:]) == {10**18 + 1_000_000}


@pytest.mark.parametrize('late', [7_000_000_000, 20_000_000])
def test_a_flight_that_fell_behind_is_followed_within_two_spans(late):
    pace = Pace()
    follow(pace, 0, 1000, 0)
    offsets = follow(pace, 1000, 1000, late)
    assert offsets[0] == 1_000_000
    assert offsets[2 * SPAN // STEP] == late + 1_000_000
