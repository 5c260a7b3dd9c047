"""
Run an estimator over a recorded flight and compare its estimate with the recording.

It runs offline, without ROS, hundreds of times faster than real time. The estimates equal those of
a live estimator in ``mambo replay``, to the last bit. The verdict at the end names absent and
refused sensors, whether and when the estimate diverged, and what contradicts it: a sensor that is
stuck or refused for long, a bias that no sensor has, the motion capture. The exit code does not
depend on it. If the joint filter diverges, no smoothed result is given.
"""

from __future__ import annotations

import argparse
from contextlib import suppress
import dataclasses
from functools import cache
from pathlib import Path
import time
from typing import NamedTuple

from mambo_bags import columns
from mambo_bags.command import guard, Parser
from mambo_bags.reader import Bag, BagError, Batch, Messages, read_bag
from mambo_bags.writer import BagWriter, refuse_name
from mambo_estimation.parameters import EstimatorNodeParams
from mambo_flight import (
    changes, offline_replay, recorded_changes, recording_to_bag, scenario)
from mambo_flight.smooth import recorded as smoothing
from mambo_model import slots
from mambo_model.errors import JobError
from mambo_model.schema import ParameterError
from mambo_model.whole_file import refuse_existing
from mambo_ros import topics
from mambo_signals import stamps
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from .compare import compare_replay
from .estimate_checks import contradictions
from .verdict import divergence, verdict

READ = (*(topic.name for topic in (
    *offline_replay.SENSORS, topics.SENSOR_TICK, topics.ESTIMATE, topics.REFERENCE,
    topics.OPTITRACK, topics.CAPTURE_TICK, topics.GROUND_TRUTH)),
    *recorded_changes.RECORD, 'onboard/odom')
"""Topics that are estimated from and compared with."""


def parameters(bag: Bag, file: Path | None = None) -> EstimatorNodeParams:
    """
    Return the parameters of the estimator, from a file, else from the bag's scenario.

    The defaults, where a bag does not tell or was flown by the ground truth. Parameters of the
    scenario that changed in flight, as the bag recorded, change at the same time.

    Raises
    ------
    mambo_model.schema.ParameterError
        If the file or the scenario in the bag is none, or asks for the ground truth (file only).

    """
    return chosen(bag, file)[0]


def _flown(bag: Bag) -> scenario.Scenario | None:
    """Return the scenario in a bag, None without; ParameterError if it is none."""
    if 'scenario.yaml' not in bag.attachments:
        return None
    return scenario.from_yaml(
        str(bag.attachments['scenario.yaml']), f'scenario.yaml in {bag.path}')


def chosen(bag: Bag, file: Path | None) -> tuple[EstimatorNodeParams, str]:
    """Return the parameters of :func:`parameters`, and in words where they come from."""
    if file is not None:
        node = scenario.load(file, 'estimator_node', bag.namespace).estimator_node
        if node.estimator == 'ground_truth':
            raise BagError(f'{file}: estimator ground_truth estimates nothing; name another')
        origin = f'{file}, all others by default'
        with suppress(ParameterError):  # the file may be given because that of the bag is wrong
            flight = _flown(bag)
            if flight is not None and flight.estimator_node.estimator != node.estimator:
                origin += f' (the bag was flown with estimator {flight.estimator_node.estimator})'
        return node, origin
    flight = _flown(bag)
    if flight is not None and flight.estimator_node.estimator != 'ground_truth':
        node = recorded_changes.estimated(flight, bag).estimator_node
        return node, 'the bag' + ', changed in flight' * bool(node.changes)
    return EstimatorNodeParams(), (
        'the simulated Mambo, as the bag holds none: --parameters FILE gives those of a vehicle')


@cache
def _types() -> Typestore:
    return columns.load_types([topics.ESTIMATE.type_name, topics.ESTIMATOR_STATE.type_name])


def messages(found: offline_replay.Estimates) -> dict[topics.Topic, NDArray[np.uint8]]:
    """Return the messages that the live estimator would publish, (n, size) bytes per topic."""
    out = {
        topics.ESTIMATE: recording_to_bag.estimate(found.t, found.state, found),
        topics.ESTIMATOR_STATE: recording_to_bag.estimator_state(
            found.t, found, tuple(found.dropped.T))}
    if found.located is not None:
        out[topics.LOCATED] = recording_to_bag.located(
            found.t, found.located, found.twist_covariance)
    return out


def answered(bag: Bag, found: offline_replay.Estimates) -> Bag:
    """Return a bag in memory with the estimates, for comparison with the recorded bag."""
    out = Bag(bag.path)
    out.namespace = bag.namespace
    for topic, table in messages(found).items():
        out.add(Messages(out.name(topic.name), topic.type_name, _types(),
                         [Batch(found.t, found.t, table)]))
    return out


def write(
    path: Path, bag: Bag, found: offline_replay.Estimates, more: smoothing.Answer | None = None,
) -> None:
    """
    Write estimates as a bag of ``estimate/odom`` and ``estimator/state``.

    With a smoothed flight ``more`` it has ``estimate/smoothed`` as well.

    Raises
    ------
    mambo_bags.writer.BagWriterError
        If the bag exists or cannot be made.

    """
    with BagWriter(path, metadata={'estimate': {'source': bag.path.name}}) as writer:
        names = {topic: f'{bag.namespace}/{topic.name}' for topic in messages(found)}
        for topic, name in names.items():
            writer.add_topic(name, topic.type_name)
        streams = {
            names[topic]: (found.t, [table]) for topic, table in messages(found).items()}
        if more is not None:
            name = f'{bag.namespace}/{smoothing.TOPIC}'
            writer.add_topic(name, topics.ESTIMATE.type_name)
            streams[name] = (more.numbers.t, [more.table])
        writer.write_all(streams)


class Answer(NamedTuple):
    """Result of an estimator run over a bag."""

    found: offline_replay.Estimates  # states and covariances as arrays
    bag: Bag  # the same as messages, in memory
    comparison: str  # differences from the recorded estimate
    verdict: str  # absent or rejected sensors, and divergence
    fault: str  # of an estimator of the user, one line with file and line; empty: none


def answer(bag: Bag, node: EstimatorNodeParams) -> Answer:
    """
    Estimate the flight of a bag, and compare with the recorded estimate.

    Raises
    ------
    BagError
        If it has nothing to estimate from, or samples with stamps below 0.
    JobError
        If an estimator of the user failed before it gave two estimates.

    """
    for line in stamps.below_zero(bag, [topic.name for topic in offline_replay.SENSORS]):
        raise BagError(f'{bag.path}: {line}')
    stamps.refuse_mixed(bag)
    slots.latest_fault()  # forget faults of earlier flights
    found = offline_replay.estimate(bag, node.filter, changes.values_later(node))
    fault = slots.latest_fault()
    if not len(found.t):
        raise offline_replay.nothing_complete(bag)
    ours = answered(bag, found)
    if fault and np.isfinite(found.state).all(axis=1).sum() < 2:
        raise JobError(f'{bag.path}: {fault}')
    said = f'verdict: the estimator failed: {fault}' if fault else verdict(bag, ours)
    return Answer(found, ours, compare_replay(bag, ours), said, fault)


def again(
    path: Path, file: Path | None = None, namespace: str | None = None,
) -> tuple[Bag, Answer, str]:
    """
    Read a bag, estimate, compare; see the command's options for the arguments.

    Returns
    -------
    The bag (topics of ``READ``), the estimates, how they differ from what it holds with a verdict.

    Raises
    ------
    BagError, mambo_model.schema.ParameterError
        If the bag cannot be read, has nothing to estimate from, or the parameters are none.

    """
    bag = read_bag(path, READ, namespace)
    node, origin = chosen(bag, file)
    ours = answer(bag, node)
    return bag, ours, (
        f'estimator: {node.estimator}, parameters of {origin}\n'
        f'{ours.comparison}\n{ours.verdict}')


def _smoothed(
    bag: Bag, node: EstimatorNodeParams, found: offline_replay.Estimates,
) -> smoothing.Answer | None:
    """
    Print and return the smoothed flight; None, in one line, if the joint filter diverges.

    The smoother linearises about the path of that filter. Of a path far from the sensors its
    covariances, and so its intervals, are those of another flight. ``found`` are the estimates of
    the node, whose filter may be another.
    """
    if node.estimator != 'joint':
        joint = dataclasses.replace(node, estimator='joint')
        found = offline_replay.estimate(bag, joint.filter, changes.values_later(joint))
    ours = answered(bag, found)
    wrong, against = divergence(ours), contradictions(bag, ours)
    if wrong:
        print('\nsmoothed: withheld, as the joint filter that it smooths failed: '
              f'{"; ".join(wrong)}')
        return None
    if node.estimator != 'joint':
        print('\nsmoothed: by the joint filter, which did not diverge')
    if against:
        print('\nnote: the intervals hold only if every sensor is right but for bias and noise. '
              f'Against it: {"; ".join(against)}')
    more = smoothing.smoothed(bag, node.joint)
    print(f'\n{more.text}')
    return more


def _work(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    refuse_name(options.output)
    began = time.perf_counter()
    bag, ours, text = again(options.bag, options.parameters, options.namespace)
    took, found = time.perf_counter() - began, ours.found
    seconds = (found.t[-1] - found.t[0]) * 1e-9
    print(f'{seconds:.2f} s of flight estimated and compared in {took:.2f} s: '
          f'{seconds / took:.0f} times real time\n{text}')
    more = None
    if options.smooth:
        more = _smoothed(bag, parameters(bag, options.parameters), found)
    if options.output:
        write(options.output, bag, found, more)
        print(f'\nbag: {options.output}')
    if ours.fault:
        raise JobError(f'{bag.path}: {ours.fault}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('estimate', __doc__)
    out.add_argument('bag', type=Path, help='rosbag2 directory or .mcap file')
    out.add_output('BAG', 'bag to create, with estimate/odom and estimator/state')
    out.add_argument('--parameters', type=Path, metavar='FILE', help=(
        'ROS 2 parameter file of the estimator, in place of all parameters of the bag (default: '
        'those)'))
    out.add_argument('--smooth', action='store_true', help=(
        'also smooth the flight with the joint filter: every state from all samples, Q, slope, '
        'drag and biases with 95 %% intervals; with -o as estimate/smoothed'))
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``estimate``."""
    options = parser().parse_args(arguments)
    return guard('estimate', lambda: _work(options))


if __name__ == '__main__':
    raise SystemExit(main())
