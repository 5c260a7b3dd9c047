"""
Fly a sweep in a script and look at its table: what wind and weight do to the tracking error.

    python3 examples/sweep_and_look.py [FLIGHTS]
"""

from __future__ import annotations

from pathlib import Path
import sys

from mambo_flight.sweep.command import summary, sweep
import pandas as pd

SWEEP = """\
title: Weight and wind
design: random
samples: {flights}
vary:
  seed: {{range: [1, 1000000]}}
  sim_node.simulator.vehicle.mass: {{normal: [0.068, 0.002]}}
  sim_node.simulator.wind.velocity: [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
"""
MASS, WIND = 'sim_node.simulator.vehicle.mass', 'sim_node.simulator.wind.velocity.0'


def main(flights: int) -> None:
    """Fly, print percentiles of all and the error by wind and weight."""
    Path('sweep.yaml').write_text(SWEEP.format(flights=flights), encoding='utf-8')
    table = Path('flights.parquet')
    table.unlink(missing_ok=True)  # a sweep never overwrites a result
    print(summary(sweep(Path('sweep.yaml'), table)))

    frame = pd.read_parquet(table)
    heavy = frame[MASS] > 0.068
    print('\ntracking error RMS [m], median by wind [m/s] and weight')
    print(frame.groupby([WIND, heavy.rename('over 68 g')])['tracking_rms'].median().unstack())
    print(f'\npicture: {table.with_suffix(".png")}')


if __name__ == '__main__':
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
