"""
Open a bag and plot it: position by truth, Optitrack and estimate, and the error of the estimate.

    python3 examples/plot_a_bag.py [BAG] [PICTURE]
"""

from __future__ import annotations

from pathlib import Path
import sys

import mambo
from mambo_model import palette
from matplotlib.figure import Figure

HERE = Path(__file__).resolve().parents[1]


def main(path: Path, picture: Path) -> None:
    """Print the estimate as a table, and draw it."""
    bag = mambo.open_bag(path)
    estimate = bag['estimate/odom']
    print(estimate.to_pandas()[[f'pose.pose.position.{axis}' for axis in 'xyz']].describe())

    figure = Figure(figsize=(7.0, 6.0), layout='constrained')
    for axis, ax in enumerate(figure.subplots(3, 1, sharex=True)):
        for topic in ('ground_truth/odom', 'optitrack/pose', 'estimate/odom'):
            if topic in bag:
                ax.plot(bag[topic].t, bag[topic].position[:, axis], label=topic,
                        **palette.line(palette.LABELS[topic]))
        ax.set_ylabel(f'{"xyz"[axis]} [m]')
    ax.set_xlabel('time [s]')
    ax.legend(frameon=False)
    figure.savefig(picture, dpi=120)
    print(f'picture: {picture}')


if __name__ == '__main__':
    arguments = [Path(argument) for argument in sys.argv[1:]]
    main(*arguments, *(HERE / 'bags/circle_short', Path('circle_short.png'))[len(arguments):])
