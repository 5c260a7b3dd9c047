"""
Check a node of yours against the contract of the graph, rule by rule.

The rest of the graph is started around it and drives it: in lockstep, with a backlog, with inputs
held back and left out, then in real time. A line for each rule says kept, broken (what was seen,
what is wanted) or not observed. docs/how-to/your-node.md explains the rules.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser, program, write_json
from mambo_flight import scenario as scenarios
from mambo_model.errors import JobError

from ..flight.nodes import FLIGHT_NODES, NAMESPACE, REPLACEABLE
from ..node_group import NodeGroup
from ..processes import NodeProcess
from ..stopping import stoppable
from .stand import TIMES as PLAN
from .transcript import BROKEN, Finding, FOUND, KEPT, READY, TIMES, UNSEEN

NODE = ('mambo_bringup', 'check_node')
LEAVE = 5.0  # s of wall time that a node may take to end after SIGINT


def parser() -> Parser:
    """Return the command line."""
    out = Parser(
        'check-node', __doc__, epilog='examples:\n'
        '  mambo check-node controller -- python3 mine.py     starts it, and checks its end too\n'
        '  mambo check-node estimator                         waits for one that you start\n'
        '  mambo check-node controller estimator -- ./both    one process that is both\n')
    out.add_argument('nodes', metavar='NODE', nargs='+', choices=tuple(REPLACEABLE),
                     help=f"what your node stands for: {', '.join(REPLACEABLE)}")
    out.add_argument('--wait', type=real(1.0, 3600.0, 's'), default=60.0, metavar='S',
                     help='for your node to appear (default: 60)')
    out.add_argument('--patience', type=real(0.01, 60.0, 's'), default=2.0, metavar='S',
                     help='of wall time for one answer (default: 2)')
    out.add_json()
    out.usage = f'{out.prog} [-h] [--wait S] [--patience S] [--json [FILE]] NODE ... [-- COMMAND]'
    return out


class _Listener:
    """Takes the lines of ``check_node``."""

    def __init__(self) -> None:
        self.findings: list[Finding] = []
        self.times: list[dict[str, Any]] = []
        self.ready = False

    def __call__(self, line: str) -> None:
        """Take one line."""
        if line.startswith(FOUND):
            self.findings.append(Finding(**json.loads(line.removeprefix(FOUND))))
        elif line.startswith(TIMES):
            self.times.append(json.loads(line.removeprefix(TIMES)))
        elif line == READY:
            self.ready = True


def _scenario(nodes: list[str], wait: float) -> scenarios.Scenario:
    """Return the flight of a check: hover, with the other nodes composed in one process."""
    others = [name for node, (_, name) in zip(
        ('optitrack', 'estimator', 'reference', 'controller'), FLIGHT_NODES) if node not in nodes]
    return scenarios.scenario('hover', controller='flatness_drag', duration=60.0, overrides={
        **{f'reference_node.plan.{name}': value for name, value in PLAN.items()},
        'sim_node.mode': 'lockstep', 'sim_node.start_patience': wait,
        'sim_node.wait_for': ','.join(others),
        'sim_node.wait_for_publishers': ','.join(REPLACEABLE[node][1] for node in nodes)})


def check(nodes: list[str], command: list[str], wait: float = 60.0, patience: float = 2.0,
          ) -> tuple[list[Finding], list[dict[str, Any]]]:
    """
    Check nodes.

    Parameters
    ----------
    nodes
        Names in ``REPLACEABLE``.
    command
        Starts them; empty: the user does.
    wait, patience : s
        Wall time for them to appear, and for one answer.

    Returns
    -------
    findings
        One for each node and rule.
    times
        Wall time from question to answer, by node and mode.

    Raises
    ------
    mambo_bringup.processes.FlightError
        If the rest of the graph does not start or dies, or there is no such command.

    """
    listener = _Listener()
    with NodeGroup('', 1) as group:
        file = group.folder / 'scenario.yaml'
        file.write_text(scenarios.commented_yaml(_scenario(nodes, wait), NAMESPACE))
        mine = group.start('', command[0], [], command=command) if command else None
        graph = group.start(
            *NODE, [','.join(nodes), str(patience), '--ros-args', '--params-file', str(file)],
            listener)
        if mine is None:
            print(f'waiting for your {" and ".join(nodes)}; in its shell:\n'
                  f'  export ROS_DOMAIN_ID={group.domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST',
                  file=sys.stderr, flush=True)
        while not listener.ready and graph.exit_code is None and not group.interrupts.count:
            if mine is not None and mine.exit_code is not None:
                raise JobError(f'{" ".join(command)} ended with exit code {mine.exit_code} before '
                               f'the check was over: {mine.last_error()}')
            time.sleep(0.02)
        if group.interrupts.count:
            raise KeyboardInterrupt(group.interrupts.first)
        if not listener.ready:
            raise JobError(graph.trouble() or 'the rest of the graph left')
        findings = [*listener.findings, *(_ending(node, mine) for node in nodes)]
    return findings, listener.times


def _ending(node: str, mine: NodeProcess | None) -> Finding:
    """Interrupt the process of the user; return how it ended."""
    rule = 'SIGINT'
    if mine is None:
        return Finding(node, rule, UNSEEN, 'give the command that starts it behind --')
    began = time.monotonic()
    mine.interrupt()
    code = mine.wait(LEAVE)
    took = time.monotonic() - began
    if code is None:
        return Finding(node, rule, BROKEN, f'still there after {LEAVE:g} s, wanted an end')
    if code in (0, -2, 130):
        return Finding(node, rule, KEPT, f'ended after {took:.1f} s')
    return Finding(node, rule, BROKEN, f'ended with exit code {code}, wanted 0: '
                   f'{mine.last_error()}')


def table(findings: list[Finding], times: list[dict[str, Any]], several: bool) -> str:
    """Return a line for each rule, and the latencies."""
    lines = []
    for one in findings:
        name = f'{one.node}: {one.rule}' if several else one.rule
        lines.append(f'{name:<{26 if several else 14}} {one.verdict:<13} {one.seen}'.rstrip())
    for one in times:
        lines.append(f'{one["node"]}, {one["mode"]}: {one["answers"]} answers, median '
                     f'{one["median_ms"]:g} ms, largest {one["largest_ms"]:g} ms')
    return '\n'.join(lines)


def _run(options: argparse.Namespace, command: list[str]) -> None:
    nodes = list(dict.fromkeys(options.nodes))
    findings, times = check(nodes, command, options.wait, options.patience)
    broken = [one for one in findings if one.verdict == BROKEN]
    if options.json != '-':
        print(table(findings, times, len(nodes) > 1))
    if options.json:
        write_json(options.json, json.dumps({
            'kept': not broken, 'rules': [one._asdict() for one in findings], 'times': times},
            indent=1))
    if broken:
        raise JobError(f'{len(broken)} of {len(findings)} rules broken: '
                       f'{", ".join(f"{one.node} {one.rule}" for one in broken)}')


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo check-node``; return the exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    at = words.index('--') if '--' in words else len(words)
    options = parser().parse_args(words[:at])
    return stoppable(program('check-node'), lambda: guard(
        'check-node', lambda: _run(options, words[at + 1:])))
