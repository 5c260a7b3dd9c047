"""
Estimate a recorded flight again with other parameters, and see which would have done best.

    python3 examples/tune_the_estimator.py [BAG] [PARAMETER VALUE...]

Without arguments the factor of the optical flow is tried on the circle of the repository: the
constant that it was flown with and the two functions of the height (C.2).
"""

from __future__ import annotations

from pathlib import Path
import sys

import mambo
from mambo_flight.scenario import read_value
from mambo_signals import metrics, motion

HERE = Path(__file__).resolve().parents[1]
FACTOR = 'kalman.optical_flow.factor'


def error(bag: mambo.Bag, **values: object) -> float:
    """Return the RMS of the estimated position against Optitrack in m, with these parameters."""
    again = mambo.estimate(bag, parameters=values).bag['estimate/odom']
    return metrics.statistics(motion.position_errors(again, bag['optitrack/pose'])[1]).rms_total


def main(flight: Path, name: str = FACTOR, *values: str) -> None:
    """Print the error with the recorded parameters and with each value of one."""
    bag = mambo.open_bag(flight)
    print(f'as it was flown: {error(bag):.4f} m')
    for value in values or ('constant', 'linear', 'exponential'):
        print(f'{name} = {value}: {error(bag, **{name: read_value(value)}):.4f} m')


if __name__ == '__main__':
    given = sys.argv[1:]
    main(Path(given[0]) if given else HERE / 'bags/circle_short', *given[1:])
