"""Content of packets, made up and drawn by hypothesis."""

from hypothesis import strategies as st
from mambo_mocap.natnet import frame as frames, model as models

VERSIONS = [(2, 5), (2, 6), (2, 7), (2, 9), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]

real = st.floats(width=32)
vector = st.tuples(real, real, real)
number = st.integers(-2**31, 2**31 - 1)
short = st.integers(-2**15, 2**15 - 1)
long = st.integers(0, 2**64 - 1)
word = st.integers(0, 2**32 - 1)
name = st.text(st.characters(blacklist_characters='\0', blacklist_categories=('Cs',)), max_size=9)


def many(one, most=3):
    return st.lists(one, max_size=most).map(tuple)


body = st.builds(
    frames.RigidBody, number, vector, st.tuples(real, real, real, real), real, short,
    many(st.builds(frames.BodyMarker, vector, number, real)))
channels = st.builds(frames.Channels, number, many(many(real)))
times = st.builds(
    frames.Times, real, long, long, long, real, st.tuples(word, word),
    st.tuples(word, word))
frame = st.builds(
    frames.Frame, number, times, many(st.builds(frames.MarkerSet, name, many(vector))),
    many(vector), many(body), many(st.builds(frames.Skeleton, number, many(body))),
    st.builds(frames.Assets, st.integers(0, 5), st.binary(max_size=20)),
    many(st.builds(frames.LabelledMarker, number, vector, real, short, real)), many(channels),
    many(channels), short)
model = many(st.one_of(
    st.builds(models.MarkerSetModel, name, many(name)),
    st.builds(
        models.BodyModel, name, number,
        many(st.builds(models.MarkerModel, vector, number, name)), number, vector,
        st.tuples(real, real, real, real))))
