"""
Flights as arrays: ``bag = mambo_analysis.open_bag('bags/circle_short')``.

``bag['estimate/odom'].position`` is (n, 3) in metres; ``.to_pandas()`` gives a topic as a table.
Comparisons are in :mod:`mambo_analysis.compare.compare`, alignment in
:mod:`mambo_signals.time_offset`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mambo_bags.reader import Bag


def open_bag(path: Path | str, namespace: str | None = None) -> Bag:
    """
    Open a bag as tidy arrays; see :func:`mambo_bags.reader.read_bag`.

    Parameters
    ----------
    path
        Directory of a rosbag2 bag, or an MCAP file.
    namespace
        Of the drone; default: the only one in the bag.

    Raises
    ------
    mambo_bags.reader.BagError
        In one line, if there is no bag or it cannot be read.

    """
    from mambo_bags.reader import read_bag  # here, as what wants no bag shall not wait for it
    return read_bag(path, namespace=namespace)
