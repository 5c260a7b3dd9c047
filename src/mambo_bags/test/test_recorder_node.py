"""Where the recorder finds a stamp; tests/nodes has the node itself."""

import struct

from hypothesis import given, strategies as st
from mambo_bags.recorder_node import _stamp, _TF_STAMP

LITTLE = b'\0\1\0\0'


@given(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1))
def test_a_stamp_is_seconds_and_nanoseconds_behind_the_encapsulation(seconds, nanoseconds):
    data = LITTLE + struct.pack('<iI', seconds, nanoseconds)
    assert _stamp(data, 0) == seconds * 10**9 + nanoseconds
    one = LITTLE + struct.pack('<IiI', 1, seconds, nanoseconds)  # of a sequence
    assert _stamp(one, _TF_STAMP) == seconds * 10**9 + nanoseconds


def test_a_message_too_short_for_a_stamp_and_an_empty_sequence_have_none():
    whole = LITTLE + struct.pack('<iI', 3, 4)
    assert all(_stamp(whole[:size], 0) is None for size in range(len(whole)))
    none = LITTLE + struct.pack('<IiI', 0, 3, 4)
    assert _stamp(none, _TF_STAMP) is None
    assert _stamp(none[:8], _TF_STAMP) is None
