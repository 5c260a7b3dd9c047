"""Stamps of a recording that cannot be right, in words."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from mambo_bags.reader import Bag, BagError, FieldError, Messages
import numpy as np
from numpy.typing import NDArray

AHEAD = 0.15  # s before the inertial samples around them: a sample can only be late
LATE = 1.0    # s; later than any sensor of a small drone
LONGEST_GAP = 1.0  # s without an inertial sample, of which an estimator loses its state


def below_zero(bag: Bag, topics: Collection[str] | None = None) -> list[str]:
    """
    Return the topics with stamps below 0, which every node refuses, one line each.

    Parameters
    ----------
    bag
        Recording.
    topics
        Topics to look at; default: all.

    """
    out = []
    for messages in _chosen(bag, topics):
        stamps = _of(messages)
        low = np.flatnonzero(stamps < 0)
        if len(low):
            out.append(f'{messages.topic}: {len(low)} of {len(stamps)} stamps are below 0, the '
                       f'first is {stamps[low[0]] * 1e-9:.3f} s: no node takes them')
    return out


def going_back(bag: Bag, topics: Collection[str] | None = None) -> list[str]:
    """
    Return the topics whose stamps go back from one message to the next, one line each.

    What is computed from them leaves samples out or takes them at a wrong time. Parameters as
    of :func:`below_zero`.

    """
    out = []
    for messages in _chosen(bag, topics):
        stamps = _of(messages)
        back = np.flatnonzero(np.diff(stamps) < 0)
        if len(back):
            k = back[0]
            older = int((stamps < np.maximum.accumulate(stamps)).sum())
            out.append(f'{messages.topic}: stamps go back, first from {stamps[k] * 1e-9:.3f} to '
                       f'{stamps[k + 1] * 1e-9:.3f} s: {older} of {len(stamps)} samples are not '
                       'newer than all before, and numbers that need them may be wrong')
    return out


def other_clock(bag: Bag, topics: Collection[str]) -> list[str]:
    """
    Return the topics whose stamps are of another clock than the inertial samples, one line each.

    Half of the messages, at least, are stamped ``AHEAD`` of the inertial sample that was recorded
    last before them, or ``LATE`` behind it. Parameters as of :func:`below_zero`.

    """
    if 'imu/data_raw' not in bag or not len(_of(bag['imu/data_raw'])):
        return []
    imu, out = bag['imu/data_raw'], []
    order = np.argsort(imu.log_time, kind='stable')
    logged, newest = imu.log_time[order], np.maximum.accumulate(_of(imu)[order])
    for messages in _chosen(bag, topics):
        stamps = _of(messages)
        before = np.searchsorted(logged, messages.log_time, 'right') - 1
        if not len(stamps) or not (before >= 0).any():
            continue
        known = before >= 0
        apart = float(np.median(stamps[known] - newest[before[known]])) * 1e-9
        if apart > AHEAD or apart < -LATE:
            out.append(f'{messages.topic}: stamped {abs(apart):.3g} s '
                       f'{"ahead of" if apart > 0.0 else "behind"} the inertial samples that were '
                       'recorded with it: it has another clock')
    return out


def repeated(bag: Bag, topics: Collection[str] | None = None) -> list[str]:
    """
    Return the topics with messages that have the stamp of another, one line each.

    Of a motion only the first of them is used (:func:`mambo_signals.motion.read`). Parameters as
    of :func:`below_zero`.

    """
    out = []
    for messages in _chosen(bag, topics):
        stamps = _of(messages)
        again = len(stamps) - len(np.unique(stamps))
        if again:
            out.append(f'{messages.topic}: {again} of {len(stamps)} messages repeat the stamp of '
                       'another: the first of each is used')
    return out


def refuse_mixed(bag: Bag) -> None:
    """
    Refuse a bag most of whose inertial samples have the stamp of another with other numbers.

    They are of two flights, or of two publishers. What was recorded twice has the same numbers.

    Raises
    ------
    mambo_bags.reader.BagError
        In one line.

    """
    if 'imu/data_raw' not in bag:
        return
    messages = bag['imu/data_raw']
    stamps = _of(messages)
    order = np.argsort(stamps, kind='stable')
    again = np.flatnonzero(np.diff(stamps[order]) == 0)
    if 4 * len(again) < len(stamps) or not len(again):
        return
    gyro = messages['angular_velocity'][order]
    other = int((gyro[again] != gyro[again + 1]).any(axis=1).sum())
    if 4 * other >= len(stamps):
        raise BagError(
            f'{bag.path}: {other} of the {len(stamps)} samples of {messages.topic} have the stamp '
            'of another and other numbers: two flights, or two publishers, in one recording')


def wrong(bag: Bag, topics: Collection[str] | None = None) -> list[str]:
    """Return the lines of :func:`below_zero` and of :func:`going_back`."""
    return [*below_zero(bag, topics), *going_back(bag, topics)]


def refuse_mostly_wrong(bag: Bag, topic: str) -> None:
    """
    Refuse a bag for a topic with a stamp below zero, or half of whose stamps are not newer.

    For what leaves out the others. Errors as of :func:`refuse_wrong`.
    """
    stamps = _of(bag[topic])
    older = (stamps < np.maximum.accumulate(stamps)).sum() if len(stamps) else 0
    for line in (wrong if 2 * older >= len(stamps) else below_zero)(bag, [topic]):
        raise BagError(f'{bag.path}: {line}')


def refuse_wrong(bag: Bag, topics: Collection[str] | None = None) -> None:
    """
    Refuse a bag with :func:`wrong` stamps of ``topics``.

    Raises
    ------
    mambo_bags.reader.BagError
        In one line that names the bag, the topic and the place.

    """
    for line in wrong(bag, topics):
        raise BagError(f'{bag.path}: {line}')


def doubtful(bag: Bag) -> list[str]:
    """Return the topics with :func:`wrong` stamps, and the longest gap of inertial samples."""
    return [*wrong(bag), *_gaps(bag)]


def _chosen(bag: Bag, topics: Collection[str] | None) -> Iterable[Messages]:
    return bag if topics is None else [bag[name] for name in topics if name in bag]


def _of(messages: Messages) -> NDArray[np.int64]:
    """Return the stamps in ns, none of a topic that cannot be decoded: its reader says so."""
    try:
        return messages.stamp
    except (BagError, FieldError):
        return np.empty(0, np.int64)


def _gaps(bag: Bag) -> list[str]:
    if 'imu/data_raw' not in bag:
        return []
    messages = bag['imu/data_raw']
    stamps = _of(messages)
    if len(stamps) < 2:
        return []
    apart = np.diff(stamps) * 1e-9
    k = int(apart.argmax())
    if apart[k] <= LONGEST_GAP:
        return []
    return [f'{messages.topic}: no sample for {apart[k]:.1f} s after {stamps[k] * 1e-9:.3f} s']
