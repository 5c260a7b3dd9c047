"""
Compare two bags in a script: the numbers, one of the signals behind them, and the report.

    python3 examples/compare_two_bags.py [A B] [REPORT]

Without bags, the circle of the repository is taken twice: its estimate against its truth.
"""

from __future__ import annotations

from pathlib import Path
import sys

import mambo
from mambo_analysis.compare import report, tables
from mambo_analysis.compare.compare import compare_bags
import numpy as np

HERE = Path(__file__).resolve().parents[1]


def main(first: Path, second: Path, page: Path) -> None:
    """Print the table, the largest difference in position and when it was; write the report."""
    a, b = mambo.open_bag(first), mambo.open_bag(second)
    topics = ('estimate/odom', 'ground_truth/odom') if first == second else (None, None)
    result, comparison, alignment = compare_bags(a, b, *topics)
    print(tables.table(result))

    position = comparison['position']
    apart = np.linalg.norm(position.error, axis=1)
    worst = int(np.nanargmax(apart))
    print(f'\nfarthest apart: {apart[worst]:.3f} m at {position.stamps[worst] * 1e-9:.2f} s')
    written = report.write(page, report.of_two(a, b, result, comparison, alignment))
    print(f'report: {written}')


if __name__ == '__main__':
    given = [Path(argument) for argument in sys.argv[1:]]
    circle = HERE / 'bags/circle_short'
    bags = given[:2] if len(given) > 1 else [circle, circle]
    main(*bags, given[-1] if len(given) in (1, 3) else Path('report.html'))
