"""Rows of real recordings: a Crazyflie against motion capture, Rolling Spiders against sonar."""

from __future__ import annotations

from functools import cache, partial
import math
from pathlib import Path

from mambo_analysis.capture import captured, recorded_bound
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import read_bag
from mambo_estimation.kalman import EstimatorParams
import numpy as np

from ..recordings import validate, validate_flights
from .case import Case
from .paired_rows import Array, Row

BLOCK = 2.0   # s, about: errors that do not accumulate count as independent from block to block


def blocks(t: Array, error: Array) -> Array:
    """
    Return the mean square of an error in each of m equally long blocks of a flight, (m,).

    Parameters
    ----------
    t : (n,) s
    error : (n,) or (n, k)
        Squares of several columns are summed.

    """
    squares = error.reshape(len(t), -1)
    length = t[-1] - t[0]
    count = max(round(length / BLOCK), 1)
    number = np.minimum(((t - t[0]) / length * count).astype(int), count - 1)
    return np.array([np.mean(np.sum(squares[number == i] ** 2, axis=1))
                     for i in np.unique(number)])


def _row(
    case: str, quantity: str, kalman: Array, joint: Array, others: list[str],
    bound: float = math.nan,
) -> Row:
    return Row(case, quantity, bound, kalman, joint, dict.fromkeys(others, math.nan))


def _squares(e: captured.ErrorSeries) -> dict[str, Array]:
    """Return the squared errors of each quantity: one of a path, of all else one a block."""
    off = np.sum(e.horizontal ** 2, axis=1)
    return {
        'horizontal position [m]': np.array([off.mean()]), 'drift at the end [m]': off[-1:],
        'height [m]': blocks(e.t, e.height), 'horizontal velocity [m/s]': blocks(e.t, e.velocity),
        'tilt [deg]': blocks(e.t, np.degrees(e.tilt))}


@cache
def _identified(log: Path, folder: Path) -> EstimatorParams:
    """Return the parameters of the three filters, identified on one flight."""
    bag, = validate_flights.import_crazyflies([log], folder / 'identified', 'zero').values()
    return validate_flights.variants(validate_flights.identify(bag))['identified Q']


def _crazyflie(
    log: Path, identified_on: Path, folder: Path, _: range, others: list[str],
) -> list[Row]:
    """Return the errors against motion capture, each filter with its own parameters."""
    found = []
    for params, counts in (
            (_identified(identified_on, folder), validate_flights.COUNTS_PER_RADIAN),
            (validate_flights.joint_params('crazyflie'), validate_flights.JOINT_COUNTS)):
        path, = validate_flights.import_crazyflies([log], folder, 'zero', counts).values()
        bag = read_bag(path)
        found.append(_squares(captured.error_series(
            captured.replayed(bag, params), captured.mocap_truth(bag),
            markers=captured.range_offset(bag))))
    name = validate_flights.recording_name(log)
    _, lines = recorded_bound.of_bag(bag, validate_flights.joint_params('crazyflie'))
    bounds = {f'{line.name} [{line.unit}]': line.bound for line in lines}
    return [_row(name, quantity, kalman, found[1][quantity], others, bounds[quantity])
            for quantity, kalman in found[0].items()]


def _rolling_spider(log: Path, folder: Path, _: range, others: list[str]) -> list[Row]:
    """Return the error of the height against the sonar."""
    kalman, joint = (blocks(one.t, one.error)
                     for one in validate_flights.height_errors(log, folder))
    return [_row(
        validate_flights.recording_name(log), 'height - sonar [m]', kalman, joint, others)]


def cases(data: Path, folder: Path) -> list[Case]:
    """
    Return every recorded case.

    Parameters
    ----------
    data
        Folder of ``mambo recordings``.
    folder
        For the imported bags.

    Raises
    ------
    BagError
        If recordings are missing.

    """
    if not data.is_dir():
        raise BagError(f'{data}: not a folder; docs/evidence/real_recordings.md says where to get '
                       'the recordings')
    logs = {validate_flights.recording_name(path): path
            for path in validate.find(data / 'crazyflie_optitrack', '*.json')
            if 'lab03' not in path.name}
    if validate.IDENTIFIED_ON not in logs:
        raise BagError(f'{data}: no flight {validate.IDENTIFIED_ON}, which the sensors are '
                       'identified on; download it')
    on = logs[validate.IDENTIFIED_ON]
    return [
        *(Case('crazyflie', name, partial(_crazyflie, log, on, folder))
          for name, log in logs.items()),
        *(Case('rolling_spider', validate_flights.recording_name(log),
               partial(_rolling_spider, log, folder))
          for log in validate.find(data / 'rolling_spider_flights', '*.mat'))]
