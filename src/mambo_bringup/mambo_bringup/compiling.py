"""
Compile the nodes of a flight before it, each in a process of its own, where that was never done.

numba compiles one function after the other. A flight whose nodes share a process would wait for
all of them; compiled at once, on every core, they wait in the cache for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import hashlib
import multiprocessing
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

from mambo_bags.cli.parent_end import end_with
from mambo_control.controller_node import ControllerNode
from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_control.reference_node import ReferenceNode
from mambo_estimation.estimator_node import EstimatorNode
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_flight.scenario import Scenario
from mambo_ros.graph.ending_signals import SIGNALS
from mambo_sim.optitrack_node import OptitrackNode
from mambo_sim.sim_node import SimNode

_LONGEST = 600.0  # s; what takes longer is compiled by the flight
_LOOK = 0.02  # s
_FORK = multiprocessing.get_context('fork')
Task = tuple[Callable[[Any], None], Any]  # compiles the steps of a node; its parameters


def compile_ahead(flight: Scenario) -> bool:
    """
    Compile the steps of a flight's nodes on all cores, unless that has been done before.

    To be called by a process that has no threads yet, of the middleware or others. A component of
    the user is left to the flight, which says what is wrong with it.

    Parameters
    ----------
    flight
        Scenario that will be flown.

    Returns
    -------
    compiled
        Whether everything is in the cache now.

    """
    tasks = list(_tasks(flight))
    kinds = ' '.join(f'{compile_.__qualname__} {_kind(p)}' for compile_, p in tasks)
    done = Path(os.environ['NUMBA_CACHE_DIR']) / (
        f'nodes-{hashlib.sha256(kinds.encode()).hexdigest()[:16]}')
    if done.exists():
        return True
    if len(os.sched_getaffinity(0)) < 2:
        return False
    if sys.stderr.isatty():
        print('compiling, once for each estimator and controller', file=sys.stderr, flush=True)
    if ended_well := _run(tasks):
        done.touch()
    return ended_well


def _tasks(flight: Scenario) -> Iterator[Task]:
    """Yield what compiles the nodes, that which takes longest first."""
    estimator = ESTIMATORS.find(flight.estimator_node.estimator)  # None: the ground truth
    if estimator is not None and not estimator.own:
        yield EstimatorNode.compile, flight.estimator_node
    if not CONTROLLERS.find(flight.controller_node.controller).own:
        yield ControllerNode.compile, flight.controller_node
    yield SimNode.compile, flight.sim_node
    yield OptitrackNode.compile, flight.optitrack_node
    if not flight.reference_node.commands.enabled:
        yield ReferenceNode.compile, flight.reference_node


def _kind(values: Any) -> str:
    """Return the types of compiled parameters, which decide what is compiled."""
    if hasattr(values, 'compiled'):
        values = values.compiled()
    elif hasattr(values, 'optitrack'):
        values = values.optitrack.values()
    elif hasattr(values, 'flown'):
        values = values.flown()
    inside = ','.join(map(_kind, values)) if isinstance(values, tuple) else ''
    return f'{type(values).__name__}({inside})' if inside else type(values).__name__


def _run(tasks: list[Task]) -> bool:
    """Run tasks in copies of this process, one for each core at a time; return whether all did."""
    waiting, running, codes = list(tasks), [], []
    limit = time.monotonic() + _LONGEST
    try:
        while waiting or running:
            while waiting and len(running) < len(os.sched_getaffinity(0)):
                running.append(_FORK.Process(
                    target=_work, args=(*waiting.pop(0), os.getpid()), daemon=True))
                running[-1].start()
            time.sleep(_LOOK)
            codes += [each.exitcode for each in running if each.exitcode is not None]
            running = [each for each in running if each.exitcode is None]
            if time.monotonic() > limit:
                return False
    finally:
        for each in running:
            each.kill()
            each.join(1.0)
    return not any(codes)


def _work(compile_: Callable[[Any], None], params: Any, parent: int) -> None:
    """Compile in this copy; say nothing, as the flight will."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)
    end_with(parent, signal.SIGKILL)
    silent = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(silent, number)
    sys.stdout = sys.stderr = open(os.devnull, 'w')
    compile_(params)
