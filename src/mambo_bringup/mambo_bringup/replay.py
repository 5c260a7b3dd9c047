"""
Replay a bag's sensors through a live estimator node, record its estimate and compare it.

The command is ``mambo replay BAG``. For a simulated flight the new estimate must equal the
recorded one, bit for bit; for an imported flight of a real drone it is compared with the drone's
onboard estimate. ``mambo estimate BAG`` gives the same result without ROS, hundreds of times
faster than real time.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from mambo_analysis.compare.compare import compare_replay
from mambo_analysis.compare.verdict import verdict
from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser, program
from mambo_bags.reader import Bag, BagError, read_bag
from mambo_flight import offline_replay, recorded_changes, scenario as scenarios
from mambo_ros import topics
from mambo_signals import stamps

from .flight.nodes import RECORDER
from .flight.outcome import print_refused, refused
from .node_group import NodeGroup
from .processes import (
    FlightError, FlightInputError, load, parameter, refuse_bag, refuse_not_utf8)
from .stopping import stoppable

ESTIMATOR = ('mambo_estimation', 'estimator_node')
PLAYER = ('mambo_bags', 'replay_node')
RECORDED = (
    '/clock,imu/data_raw,sonar/range,optical_flow,barometer/pressure,sensor_tick,estimate/odom,'
    'estimator/state,/tf,/diagnostics')
SLOWEST = 0.01  # of the recorded speed: a minute takes 100

_SENSORS = tuple(topic.name for topic in offline_replay.SENSORS)
_STEPS = (topics.SENSOR_TICK.name, topics.IMU.name)  # the first that is there must be answered


def replay(bag: Path, output: Path, rate: float = 0.0,
           estimator_file: Path | None = None, namespace: str | None = None) -> dict[str, str]:
    """
    Play the sensors of a bag to a live estimator and record its estimate.

    Parameters
    ----------
    bag
        Source.
    output
        Bag to create.
    rate
        Ratio of recorded time to wall time; 0: as fast as the estimator answers.
    estimator_file
        ROS 2 parameter file of the estimator; default: the one inside the bag, if any.
    namespace
        Of the drone, if the bag has several.

    Returns
    -------
    refused
        Messages that nodes refused, in words, by node.

    Raises
    ------
    FlightError
        If a node does not start, crashes or cannot read the bag.
    mambo_bags.reader.BagError
        If the bag is foreign, damaged or was never closed.
    KeyboardInterrupt
        If the user ended it; carries the signal. The output is closed.

    """
    refuse_bag(output)
    for path in filter(None, (bag, estimator_file)):
        refuse_not_utf8(path.absolute())
    recording = read_bag(  # refused here if damaged
        bag, (*recorded_changes.RECORD, *_STEPS, *_SENSORS), namespace)
    for line in stamps.below_zero(recording, _SENSORS):
        raise BagError(f'{bag}: {line}')
    for name in [name for name in _STEPS if name in recording][:1]:
        stamps.refuse_mostly_wrong(recording, name)
    stamps.refuse_mixed(recording)
    if estimator_file is not None and not estimator_file.is_file():
        raise FlightInputError(f'{estimator_file}: there is no such parameter file')
    if estimator_file is not None:
        scenarios.load(estimator_file, 'estimator_node', recording.namespace)
    with NodeGroup(RECORDER[1]) as group:
        file = estimator_file or _recorded_parameters(recording, group.folder)
        parameters = ['--params-file', str(file)] if file else []
        scenario = parameter('scenario', file) if file else []
        aided = file is not None and scenarios.load(file).estimator_node.aided
        recorded = f'{RECORDED},{topics.LOCATED.name}' if aided else RECORDED
        group.start(*RECORDER, [
            '--ros-args', *parameter('bag', output), *parameter('topics', recorded), *scenario,
            '-p', 'whole:=false'])
        group.start(*ESTIMATOR, ['--ros-args', *parameters])
        group.start(*PLAYER, [
            '--ros-args', *parameter('bag', bag), '-p', f'rate:={float(rate)}',
            *parameter('source_namespace', recording.namespace or topics.NAMESPACE),
            '-p', f'capture:={str(aided).lower()}',
            '-p', 'wait_for:=estimator_node,recorder_node'])
        group.watch()
    if group.interrupts.first:
        raise KeyboardInterrupt(group.interrupts.first)
    if group.fault:
        doubts = [*stamps.going_back(recording, _SENSORS),
                  *stamps.other_clock(recording, _SENSORS)]
        raise FlightError('; '.join([group.fault, *doubts]))
    return refused(group.children)


def _recorded_parameters(bag: Bag, folder: Path) -> Path | None:
    """Write the estimator's recorded parameters to a file; None if the bag has none."""
    text = bag.attachments.get('scenario.yaml')
    if text is None:
        return None
    flight = scenarios.from_yaml(text, f'scenario.yaml in {bag.path}')
    if flight.estimator_node.estimator == 'ground_truth':
        return None
    flight = recorded_changes.estimated(flight, bag)
    file = folder / 'estimator.yaml'
    file.write_text(scenarios.to_yaml(flight))
    return file


def _rate(text: str) -> float:
    """Return the value of ``--rate``; ArgumentTypeError if it is not valid."""
    value = real(0.0, 1000.0)(text)
    if 0.0 < value < SLOWEST:
        raise argparse.ArgumentTypeError(
            f'{text} must be within {SLOWEST:g} to 1000, or 0: as fast as possible')
    return value


def parser() -> Parser:
    """Return the command line."""
    out = Parser('replay', __doc__.split('\n\n')[0])
    out.add_argument('bag', type=Path, help='rosbag2 directory or .mcap file')
    out.add_output('NEW_BAG', 'bag to create (default: BAG_replay)')
    out.add_argument('--rate', type=_rate, default=0.0, metavar='X',
                     help=f'ratio of recorded time to wall time, at least {SLOWEST:g}; 0: as fast '
                          'as possible (default)')
    out.add_argument('--parameters', type=Path, metavar='FILE',
                     help='ROS 2 parameter file of the estimator (default: that of the bag)')
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``replay``; return the exit code."""
    options = parser().parse_args(arguments)
    output = options.output or options.bag.with_name(f'{options.bag.name}_replay')

    def work() -> None:
        """Replay, compare, and print both."""
        load('.'.join(node) for node in (RECORDER, ESTIMATOR, PLAYER))
        print_refused(replay(
            options.bag.absolute(), output.absolute(), options.rate, options.parameters,
            options.namespace))
        print(f'bag: {output}')
        recorded, ours = read_bag(options.bag, namespace=options.namespace), read_bag(output)
        print(compare_replay(recorded, ours))
        print(verdict(recorded, ours))
    return stoppable(program('replay'), lambda: guard('replay', work))


if __name__ == '__main__':
    raise SystemExit(main())
