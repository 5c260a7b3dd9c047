"""
Fly a scenario in one process, without ROS running, and write its bag: the topics of the graph.

The messages are those that the graph in lockstep records, byte for byte.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import math
from pathlib import Path
import sys
import time
from typing import Any

from mambo_bags.command import guard, interrupted, Parser
from mambo_bags.writer import refuse_name
from mambo_model import limits
from mambo_model.errors import InputError, JobError
from mambo_model.motion.height_check import flight_fault, over_in_the_air
from mambo_model.whole_file import refuse_existing
from numba.core import event
import numpy as np

from . import (
    capture_columns, closed_loop, commanded, flight_options, recording_to_bag, scenario_file,
    supervised)
from .scenario import commented_yaml, Scenario
from .sweep import monte_carlo
from .world import formation, separation, world_file
from .world.formation import Drones

LEAST_TOLD = 1.0  # s of compiling that a flight tells of


def _scenario(options: argparse.Namespace) -> tuple[str, Scenario]:
    """Return the name and the scenario of the flight that the command line selects."""
    given = flight_options.given(options)
    if options.again:
        if options.scenario or given:
            raise InputError('--again flies the recorded scenario: leave out SCENARIO and the '
                             'options that choose another; --set changes it')
        name, flight = options.again.stem, commanded.scenario_of(options.again)
    elif options.scenario:
        name, flight = scenario_file.load(options.scenario, flight_options.over(options))
    elif given or options.print_scenario:
        name = Path(options.trajectory or 'flight').stem
        flight = scenario_file.from_settings(given)
    else:
        raise InputError('give a SCENARIO or one of --trajectory, --controller, --estimator')
    return name, flight_options.applied(flight, options)


class _Announced(event.Listener):
    """Says on a terminal that a flight waits for the compiler."""

    def __init__(self) -> None:
        self._said = not sys.stderr.isatty()

    def on_start(self, event: event.Event) -> None:
        """Say so, once."""
        if not self._said:
            self._said = True
            print('compiling, about a minute; once for these components and options',
                  file=sys.stderr, flush=True)

    def on_end(self, event: event.Event) -> None:
        """Say nothing."""


@contextmanager
def _compiling() -> Iterator[list[float]]:
    """Say that a flight waits for the compiler, and how long; yield the times that it took, s."""
    taken: list[float] = []
    with event.install_timer('numba:compile', taken.append), event.install_listener(
            'numba:compile', _Announced()):
        yield taken
    if sum(taken) > LEAST_TOLD:
        print(f'compiled in {sum(taken):.1f} s, once for these components and options')


def _errors(flight: Scenario, metrics: Mapping[str, Any]) -> str:
    """Return the errors of a flight in a few words."""
    ending = f'; motors stopped ({metrics["shutdown_reason"]})' if metrics['shutdown'] else ''
    if monte_carlo.never_took_off(metrics):
        return f'no errors in flight, as it never took off{ending}'
    tracking = 'carried by hand' if flight.sim_node.simulator.hand.enabled else (
        f'tracking error in flight {metrics["tracking_rms"]:.3g} m RMS, '
        f'{metrics["tracking_max"]:.3g} m at most')
    estimation = 'no estimation error, as the estimate was not finite' if math.isnan(
        metrics['estimation_rms']) else f'estimation error {metrics["estimation_rms"]:.3g} m RMS'
    return (f'{tracking}; {estimation}'
            f'{" (estimate/map)" if flight.controller_node.estimate == "map" else ""}{ending}')


def failure(flight: Scenario, r: closed_loop.Recording, metrics: Mapping[str, Any]) -> str:
    """
    Return why a flight was not flown as asked, or an empty string; by hand nothing is flown.

    Parameters
    ----------
    flight, r
        Scenario and what was recorded.
    metrics
        Of :func:`mambo_flight.sweep.monte_carlo.measure`.

    """
    if flight.sim_node.simulator.hand.enabled:
        return ''
    ended, up = '', (1.0, 1.0, -1.0)  # NED to z up
    if metrics['shutdown']:
        ended = (f'motors stopped at {metrics["shutdown_time"]:.3f} s: '
                 f'{metrics["shutdown_reason"]}')
    elif metrics['failsafe']:
        ended = f'the failsafe held or landed the vehicle at the end: {metrics["failsafe"]}'
    found = flight_fault(
        r.t * 1e-9, r.truth[:, :3] * up, r.reference[:, :3] * up, r.phase,
        (r.pwm > 0.0).any(axis=1), flight.sim_node.simulator.plant.ground, bool(ended))
    return '; '.join(filter(None, (ended, found)))


def _remarks(flight: Scenario, r: closed_loop.Recording) -> list[str]:
    """Return lines about a landing in the air, poses not used, and commands that were cut."""
    reference, lines = flight.reference_node, []
    if reference.commands.enabled or reference.plan.landing_time:
        lines.append(over_in_the_air(float(-r.truth[-1, 2]), bool((r.pwm[-1] > 0.0).any())))
    if r.located is not None:
        lines.append(capture_columns.unused(
            r.t * 1e-9, r.located, flight.estimator_node.joint.pose.max_age))
    limit = flight.sim_node.simulator.vehicle.pwm_max
    if share := (r.pwm > limit).any(axis=1).mean():
        lines.append(f'{100.0 * share:.1f} % of the steps had a motor command above pwm_max of '
                     f'the vehicle: limited to {limit:g}')
    return [line for line in lines if line]


def _run(options: argparse.Namespace) -> None:
    timed = flight_options.timed(options)
    if flight_options.only_prints(options):
        flight, world = _scenario(options)[1], flight_options.world(options)
        print(commented_yaml(flight) if world.drones == 1 else world_file.to_text(
            formation.hall(flight, world, timed).hall), end='')
        return
    if options.output is None:
        raise InputError('-o/--output is missing')
    refuse_existing(options.output)
    refuse_name(options.output)
    name, flight = _scenario(options)
    if not flight.sim_node.duration > 0.0:
        raise InputError(f'{name}: sim_node.duration must be more than 0 s')
    recording_to_bag.check(flight)
    for line in flight_options.remarks(flight, options.stretch, options.trajectory):
        print(line)
    if options.again:
        for line in (*commanded.alone(options.again), *commanded.beyond(options.again, flight)):
            print(line)
    world = flight_options.world(options)
    if world.drones > 1:
        drones = formation.hall(flight, world, timed)
        for line in formation.remarks(drones):
            print(line)
        _check_memory(name, drones.flights)
        _run_together(name, drones, options.output)
        return
    _check_memory(name, [flight])
    write_flight(name, flight, options.output)


def _check_memory(name: str, flights: Sequence[Scenario]) -> None:
    """Raise InputError for flights whose recordings, kept until the end, take too much memory."""
    need = sum(closed_loop.recorded_bytes(flight, inner=True) for flight in flights) / 1e6
    if need > limits.FLIGHT_MB.value():
        raise InputError(
            f'{name}: {need:.0f} MB of memory for the flight of {len(flights)} drone'
            f'{"s" * (len(flights) > 1)} over {flights[0].sim_node.duration:g} s: fly less, or '
            f'with ./run, which writes as it flies; {limits.raised_by(limits.FLIGHT_MB)}')


def write_flight(name: str, flight: Scenario, output: Path) -> None:
    """
    Fly a scenario, write its bag, and print its errors and how long it took.

    Parameters
    ----------
    name
        Of the flight, for what is printed.
    flight
        Scenario with a duration, for which :func:`recording_to_bag.check` has nothing to say.
    output
        Bag to write.

    Raises
    ------
    mambo_model.errors.JobError
        If a component failed in flight, the failsafe ended it, or the vehicle was far from
        the height of its reference; the bag is written.

    """
    began = time.monotonic()
    with _compiling() as compiled:
        recording, fault = supervised.fly(flight, inner=True)
    flown = time.monotonic()
    recording_to_bag.write(output, flight, recording)
    end = time.monotonic()
    began += sum(compiled)
    seconds = recording.t[-1] * 1e-9
    metrics = monte_carlo.measure(flight, recording)
    print(f'{name}: {_errors(flight, metrics)}')
    print(f'{name}: {seconds:.2f} s flown in {flown - began:.2f} s, bag written in '
          f'{end - flown:.2f} s: {seconds / (end - began):.3g} times real time\n'
          f'bag: {output}')
    for said in _remarks(flight, recording):
        print(f'{name}: {said}')
    if reason := '; '.join(filter(None, (fault, failure(flight, recording, metrics)))):
        raise JobError(f'{name}: {reason}')


def _run_together(name: str, drones: Drones, output: Path) -> None:
    """Fly several drones in one hall and write a bag of each into a folder."""
    world, lines = drones.hall.params, []
    began = time.monotonic()
    with _compiling() as compiled:
        result, fault = supervised.fly_together(
            drones.flights, world, list(drones.hall.places.values()))
    flown = time.monotonic()
    began += sum(compiled)
    text, tracks = world_file.to_text(drones.hall), {}
    for written, ((space, place), own, recording) in enumerate(zip(
            drones.hall.places.items(), drones.flights, result.recordings, strict=True)):
        try:
            recording_to_bag.write(output / space.strip('/'), own, recording, space, text)
        except KeyboardInterrupt as end:
            raise interrupted(
                end, f'{written} of {world.drones} bags are written to {output}') from None
        metrics = monte_carlo.measure(own, recording)
        print(f'{space}: {_errors(own, metrics)}')
        for said in _remarks(own, recording):
            print(f'{space}: {said}')
        if reason := failure(own, recording, metrics):
            lines.append(f'{space}: {reason}')
        tracks[space] = separation.Track(recording.t, recording.truth[:, :3] + np.array(place))
    end = time.monotonic()
    print(separation.table(separation.pairs(tracks), world.collision_distance))
    seconds = result.recordings[0].t[-1] * 1e-9
    print(f'{name}: {world.drones} drones, {seconds:.2f} s flown in {flown - began:.2f} s, bags '
          f'written in {end - flown:.2f} s: {seconds / (end - began):.3g} times real time\n'
          f'bags: {output}')
    collided = [one.describe(list(tracks)) for one in result.collisions]
    if collided:
        print(*collided, sep='\n')
    if reasons := [*([fault] if fault else []), *collided, *lines]:
        for line in lines:
            if line != reasons[0]:
                print(f'{name}: {line}', file=sys.stderr)
        raise JobError(f'{name}: {reasons[0]}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('fly', __doc__)
    out.add_argument(
        'scenario', metavar='SCENARIO', nargs='?',
        help='an experiment, experiment/flight, or a file')
    out.add_argument(
        '--again', type=Path, metavar='BAG',
        help='a recorded commanded flight, with the commands that it recorded; of a hall, the '
             'bag of one drone, which flies alone')
    out.add_output('BAG', 'directory of the bag to create, of several drones: that of their bags')
    flight_options.add(out)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``fly``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('fly', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
