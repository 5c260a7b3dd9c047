"""
Fly scenarios in the ROS graph and record them.

Every node is a process of its own, or all nodes of a drone are composed in one process.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
import signal

from mambo_flight import scenario as scenarios
from mambo_flight.world import world_file
from mambo_flight.world.world_file import Hall

from ..node_group import NodeGroup
from ..processes import NodeProcess, parameter, refuse_bag
from ..stuck import closed_again, guests, is_closed, is_own, Silence, stuck
from .natnet import CLIENT, SERVER, write as write_natnet
from .nodes import (
    COMPOSED, HALL_CAPTURE, label, NAMESPACE, RECORDER, recorder_topics, REPLACEABLE,
    run_parameters, start_arguments, take_cameras, VIEW, world_process)
from .outcome import dropped, FlightEndedError, listener, Outcome, Progress, refused, used

_SHARED = {node[1] for node in (COMPOSED, HALL_CAPTURE, SERVER, CLIENT)}
"""Nodes that are processes of all drones of a hall."""
_LOADING = 60.0  # s that nodes may take to load, at least


def fly(flight: scenarios.Scenario, bag: Path, composed: bool = False,
        without: Collection[str] = (), natnet: int = 0) -> Outcome:
    """
    Fly a scenario in the graph and record it.

    Parameters
    ----------
    flight
        Scenario with a duration.
    bag
        Directory to create.
    composed
        Run all nodes in one process: the same bag, faster.
    without
        Names in :data:`REPLACEABLE` of nodes that the user starts.
    natnet
        Command port of a NatNet server that stands in for the mock Optitrack, with its client; 0:
        none.

    Raises
    ------
    FlightError
        If a node does not start, crashes, is stopped or exits early; the bag holds the flight
        until then.

    """
    return fly_several({NAMESPACE: flight}, {NAMESPACE: bag}, composed, without, natnet)[0]


def fly_several(flights: Mapping[str, scenarios.Scenario], bags: Mapping[str, Path],
                composed: bool = False, without: Collection[str] = (),
                natnet: int = 0, view: int = 0, hall: Hall | None = None) -> list[Outcome]:
    """
    Fly several drones at once, each with its own bag.

    Parameters
    ----------
    flights, bags
        Scenario and bag of each drone by namespace; see :func:`fly`.
    composed
        One process per drone, or for all drones of a hall, instead of one per node.
    without, natnet
        See :func:`fly`.
    view
        Port of a page in the browser that shows the flight; 0: none.
    hall
        The drones are in one hall and step together; None: each has its own time.

    Raises
    ------
    FlightError
        See :func:`fly`; it is a :class:`FlightEndedError` once the nodes were started.

    """
    for bag in bags.values():
        refuse_bag(bag)
    progress: dict[str, Progress] = {}
    started: dict[str, list[NodeProcess]] = {}
    silences: dict[str, Silence] = {}
    owners = len(flights) if hall is None else 1
    with ExitStack() as bars, NodeGroup(RECORDER[1], owners) as group:
        if view:
            group.start_spectator(*VIEW, ['--ros-args', *parameter('drones', ','.join(flights)),
                                          '-p', f'port:={view}'])
        last, others = [], []  # namespace, node and arguments of each process
        world = group.folder / world_file.NAME if hall is not None else None
        if world is not None:
            world.write_text(world_file.to_text(hall))
        for number, (namespace, flight) in enumerate(flights.items()):
            file = group.folder / f'scenario{number or ""}.yaml'
            left, port = _guest(without, natnet) if number and hall else (without, natnet)
            _write(file, flight, run_parameters(flight, left, bool(port)), namespace)
            if hall is None or not number:
                bar = Progress(flight.sim_node.duration, shown=not number)
                bars.callback(bar.close)
            progress[namespace] = bar
            started[namespace] = []
            *nodes, owner = start_arguments(
                file, bags[namespace], composed, namespace, left, {
                    **recorder_topics(flight), **({'world': str(world)} if world else {})},
                write_natnet(file, flight, port, namespace, hall) if port else None)
            last.append((namespace, *owner))
            others += [(namespace, *one) for one in nodes]
        _start(group, others, started, world)
        shared = None if world is None else group.start(
            *COMPOSED, world_process(world, [arguments for *_, arguments in last], composed),
            listener(bar, [node for nodes in started.values() for node in nodes]))
        for namespace, node, arguments in last:
            started[namespace].append(shared or group.start(
                *node, arguments, listener(progress[namespace], started[namespace]),
                label(namespace, node)))
            silences[namespace] = Silence(flights[namespace], started[namespace][-1])
        if without:
            print(_invitation(without, flights, group.domain), flush=True)
        patience = max(flight.sim_node.start_patience for flight in flights.values())
        group.watch(  # the nodes' patience begins when they are loaded
            lambda seconds: next((started[space][-1].label for space, bar in progress.items()
                                  if bar.waits(seconds)), ''),
            patience + max(patience, _LOADING),
            lambda: next(filter(None, (
                silences[space].kill(bar.begun, bar.ended, bar.lines)
                for space, bar in progress.items())), ''))
    for line in group.spectators_lost:
        print(f'the view ended before the flight: {line}')
    outcomes = [
        _outcome(bags[namespace], progress[namespace], started[namespace],
                 flights[namespace], group, namespace)
        for namespace in flights]
    if world:
        _divide(outcomes, progress[namespace], group, list(flights))
    if group.fault and not group.interrupts.first:
        raise FlightEndedError(outcomes)
    return outcomes


def _guest(without: Collection[str], natnet: int) -> tuple[Collection[str], int]:
    """Return what is left out of a drone, and the port, where the first one serves the hall."""
    return ((*without, 'optitrack'), 0) if natnet else (without, 0)


def _start(group: NodeGroup, nodes: list[tuple[str, tuple[str, str], list[str]]],
           started: Mapping[str, list[NodeProcess]], world: Path | None) -> None:
    """Start nodes, each with namespace and arguments; the cameras of a hall are the first's."""
    cameras = []
    if world is not None:
        nodes, cameras = take_cameras(world, nodes)
    for namespace, node, arguments in nodes:
        started[namespace].append(group.start(*node, arguments, label=label(namespace, node)))
    if cameras:
        started[next(iter(started))].append(group.start(*HALL_CAPTURE, cameras))


def _write(file: Path, flight: scenarios.Scenario, run: Mapping[str, object],
           namespace: str) -> None:
    """Write the parameters of a flight's nodes, those of the run included."""
    text = scenarios.commented_yaml(scenarios.override(flight, run), namespace)
    file.write_text(text, encoding='utf-8')


def _invitation(without: Collection[str], namespaces: Collection[str], domain: int) -> str:
    """Return instructions for the user who starts the missing nodes."""
    topics = ', '.join(f'{namespace}/{REPLACEABLE[name][1]}'
                       for namespace in namespaces for name in without)
    return (f'waiting for your {" and ".join(without)} to publish {topics}; in its shell:\n'
            f'  export ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST')


def _outcome(bag: Path, progress: Progress, nodes: list[NodeProcess],
             flight: scenarios.Scenario, group: NodeGroup, namespace: str) -> Outcome:
    """Return the result of one drone's flight, as if it had no hall in common with others."""
    asked = flight.sim_node.duration
    killed = [node.name for node in nodes if node.exit_code == -signal.SIGKILL]
    own = is_own(bag, nodes)
    closed, step, flown = own and is_closed(bag), stuck(flight, killed), progress.flown
    # a user's code may end the process of all nodes, with exit code 0 too
    silent = not (progress.ended or group.fault or group.interrupts.first)
    early = nodes[-1].early_end() if silent else ''
    if own and not closed and not group.interrupts.first and (found := closed_again(bag)):
        closed, flown = True, max(flown, 1e-9 * (found.end - found.start))
    fault = '; '.join(filter(None, (group.fault, step, early)))
    guilty = guests(flight, [node.name for node in nodes if node.early_end() in fault])
    fault = '; '.join(filter(None, (fault, guilty)))
    if fault and flown:
        least = '' if progress.ended else 'at least '  # of what it said before it was killed
        fault = f'flew {least}{flown:.2f} of {asked:g} s: {fault}'
    commands = progress.commands[namespace]
    return Outcome(
        bag, flown, progress.took, commands.missed, commands.delay,
        group.interrupts.first, used(nodes), refused(nodes), closed, fault,
        recorded=own, whole=flown >= asked, collisions=progress.collisions,
        remarks=[*commands.remarks, *progress.remarks], dropped=dropped(nodes),
        late=commands.late, paused=progress.paused)


def _divide(outcomes: list[Outcome], progress: Progress, group: NodeGroup,
            namespaces: Sequence[str]) -> None:
    """Tell what is of each drone of a hall from what is of all, which their outcomes share."""
    shared = used([node for node in group.children if node.name in _SHARED])
    for outcome, namespace in zip(outcomes, namespaces, strict=True):
        outcome.remarks = progress.commands[namespace].remarks
        outcome.used = {name: own for name, own in outcome.used.items() if name not in _SHARED}
        outcome.hall_remarks, outcome.hall_used = progress.remarks, shared
        # the cameras are processes of the first drone, and log for all
        outcome.refused = refused(group.children, namespace)
        outcome.dropped = dropped(group.children, namespace)
