"""
Rates, noise, limits, outliers and delay of every sensor.

Reads bags, Parrot minidrone logs (``RSdata*.mat``) and ``noisedata.mat``. Each value comes with a
95 % interval:

* proportions and medians by the binomial distribution (Clopper-Pearson, order statistics);
* standard deviations and Allan deviations by chi2 with their equivalent degrees of freedom;
* angle and velocity random walk by the Allan variance at 0.1 s without what the bias walks;
* random walk of the bias by likelihood;
* everything else by a jackknife over ten stretches of the recording.

At rest means that over half a second no axis of the gyro varies by more than 0.01 rad/s and none
of the accelerometer by more than 0.2 m/s^2 (standard deviation): ten times the noise at rest of
the recordings known, a fifth of what propellers do; and that the accelerometer shows gravity.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from mambo_bags.command import guard, Parser, write_json
from mambo_bags.mcap_reader import BagError
import numpy as np

from . import barometer, imu, optical_flow, repeats, sonar
from ..allan import LEVEL
from ..recording import read_sensors, Recording
from .drawing import draw
from .table import Measured, summary, table


SLOWEST = {'imu': 0.5, 'sonar': 2.0, 'flow': 2.0, 'barometer': 2.0}
"""Longest usual interval of a sensor [s]: a vehicle cannot be steered by slower ones."""
FASTEST = 1e-5
"""Shortest usual interval of a sensor [s]: a tenth of that of the fastest gyros."""


def _check_intervals(recording: Recording) -> None:
    """Raise BagError for stamps that cannot be in seconds; held values have no interval."""
    streams = {'imu': recording.gyro, 'sonar': recording.sonar, 'flow': recording.flow,
               'barometer': recording.barometer}
    for name, stream in streams.items():
        if recording.held or stream is None or len(stream.t) < 2:
            continue
        usual = float(np.median(np.diff(stream.t)))
        if not FASTEST <= usual <= SLOWEST[name]:
            raise BagError(
                f'{recording.name}: {name}: {usual:.3g} s from sample to sample, possible are '
                f'{FASTEST:g} to {SLOWEST[name]:g} s: import it with the right unit of time')


def measure(recording: Recording) -> tuple[list[Measured], dict[str, Any]]:
    """
    Return all sensor properties that a recording determines.

    Returns
    -------
    lines
        The table.
    curves
        What the figure shows: ``allan`` by signal, ``latency`` as (lags in ms, misfit) or None.

    Raises
    ------
    BagError
        If the recording is too short to tell anything, or a unit or a sensor cannot be right.

    """
    _check_intervals(recording)
    repeats.check(recording)
    inertial, curves = imu.measure(recording)
    optical, latency = optical_flow.measure(recording)
    lines = inertial + sonar.measure(recording) + optical + barometer.measure(recording)
    if not lines:
        raise BagError(f'{recording.name}: too few samples to tell anything of a sensor')
    return lines, {'allan': curves, 'latency': latency}


def _print_tables(recordings: list[Recording], measured: list[list[Measured]]) -> None:
    """Print a table of each recording, and of all together if there are several."""
    for recording, lines in zip(recordings, measured):
        print(f'{recording.name}\n{table(lines)}')
        for line in imu.not_measured(recording):
            print(f'not measured: {line}')
        print()
    if len(recordings) > 1:
        heading = 'median over recordings, from the lowest to the highest; samples: recordings'
        text = table(summary(measured))
        print(f"{heading}\n{text.replace('95 % interval', 'lowest to highest', 1)}\n")


def _report(files: list[Path], options: argparse.Namespace) -> None:
    """Measure all files; print, draw and write the results."""
    recordings = [read_sensors(file, options.namespace) for file in files]
    measured = [measure(recording) for recording in recordings]
    if options.json != '-':
        _print_tables(recordings, [lines for lines, _ in measured])
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
        for number, (recording, (_, curves)) in enumerate(zip(recordings, measured), 1):
            target = options.output / f'{number:02d}_{Path(recording.name).stem}_sensors.png'
            if draw(recording, curves, target) and options.json != '-':
                print(f'figure: {target}')
    if options.json is not None:
        content = {'level': LEVEL, 'recordings': [
            {'file': str(file), 'measured': [
                {key: None if value != value else value for key, value in line._asdict().items()}
                for line in lines]}
            for file, (lines, _) in zip(files, measured)]}
        if path := write_json(options.json, json.dumps(content, indent=1)):
            print(f'json: {path}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('identify_sensors', __doc__.split('\n\n')[0])
    out.add_argument('files', type=Path, nargs='+', metavar='FILE',
                     help='bag, minidrone log (rt_yout) or noisedata.mat')
    out.add_output('DIR', 'write a figure of each file here; older files are replaced')
    out.add_json()
    out.add_argument('--namespace', help='of the drone, if a bag holds several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_sensors``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('identify_sensors', lambda: _report(options.files, options))


if __name__ == '__main__':
    raise SystemExit(main())
