"""
Identify the motor map from a bench and fly with it, in one process.

    python3 examples/identify_and_fly.py [BENCH.csv]

A bench is a table with the columns pwm and thrust (N, of one motor). Without one it is made here:
the Mambo's map with readings that scatter by 2 %. The vehicle that flies is the thesis's; its
controller believes once the map of Parrot's toolbox and once the one found.
"""

from __future__ import annotations

from pathlib import Path
import sys

from mambo_analysis.identify import thrust
from mambo_flight.closed_loop import fly
from mambo_flight.scenario import scenario
from mambo_model.vehicle.parameters import preset
import numpy as np


def make_bench(path: Path) -> None:
    """Write readings of the Mambo's motor map."""
    mambo, rng = preset('identified'), np.random.default_rng(1)
    pwm = np.repeat(np.arange(50.0, 351.0, 25.0), 5)
    force = mambo.power_a * pwm ** mambo.power_b * (1.0 + 0.02 * rng.standard_normal(len(pwm)))
    np.savetxt(path, np.column_stack([pwm, force]), delimiter=',', header='pwm,thrust',
               comments='')


def sag(believed: str) -> float:
    """Return how far below its reference the vehicle is on average from 8 s on, m."""
    flight = fly(scenario('hover', duration=15.0, vehicle='identified', believed=believed,
                          land=False, estimator='ground_truth'))
    late = flight.t > 8_000_000_000
    return float(np.mean(flight.truth[late, 2] - flight.reference[late, 2]))


def main(bench: Path) -> int:
    """Print the map, then what it changes in flight."""
    status = thrust.main([str(bench), '--output', '.'])
    if status == 0:
        for believed in ('toolbox', 'identify_thrust.yaml'):
            print(f'hover, controller believes {believed}: {sag(believed):+.4f} m below')
    return status


if __name__ == '__main__':
    if len(sys.argv) < 2:
        make_bench(Path('bench.csv'))
    raise SystemExit(main(Path(sys.argv[1] if len(sys.argv) > 1 else 'bench.csv')))
