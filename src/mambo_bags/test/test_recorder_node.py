"""Which topics the recorder takes and where it finds a stamp; tests/nodes has the node itself."""

import struct

from hypothesis import given, strategies as st
from mambo_bags.recorder_node import _selected, _stamp, _TF_STAMP
from mambo_model.schema import ParameterError
from mambo_ros import topics
import pytest

LITTLE = b'\0\1\0\0'


def test_no_names_are_every_topic_of_the_flight():
    assert tuple(_selected('')) == tuple(topics.RECORDED)
    assert tuple(_selected(' , ')) == tuple(topics.RECORDED)


def test_names_are_taken_in_their_order_without_their_blanks():
    names = [topic.name for topic in topics.RECORDED][:3]
    found = _selected(f' {names[2]},{names[0]} ,')
    assert [topic.name for topic in found] == [names[2], names[0]]


def test_an_unknown_topic_is_named_with_those_that_there_are():
    with pytest.raises(ParameterError, match=r'unknown topic sonar; known: .*sonar/range'):
        _selected('sonar/range,sonar')


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
