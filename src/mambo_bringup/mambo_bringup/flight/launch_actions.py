"""The processes of a launch file as actions of ROS 2 launch; the only module that needs launch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
import shutil
import tempfile
from typing import Any

from launch import LaunchContext
from launch.action import Action
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, RegisterEventHandler
from launch.event_handlers import OnShutdown
from launch.events.matchers import matches_action
from launch.events.process import ProcessExited, ShutdownProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from mambo_flight.scenario import to_yaml
from mambo_ros.graph import loopback
from mambo_ros.topics import OWN

from .. import launching
from ..launching import Process
from ..processes import FlightError
from .nodes import DESCRIPTION, RECORDER

PATIENCE = '20'  # s that a node has to close its bag, after which launch ends it


def texts(context: LaunchContext, arguments: Iterable[DeclareLaunchArgument]) -> dict[str, str]:
    """Return the values of launch arguments by name."""
    return {argument.name: LaunchConfiguration(argument.name).perform(context)
            for argument in arguments}


def misspelled(
        context: LaunchContext, arguments: Iterable[DeclareLaunchArgument]) -> list[Action]:
    """Return a line for each given name that is none of the arguments, but almost is."""
    return [LogInfo(msg=f'launch argument {line}') for line in launching.almost(
        context.launch_configurations, [argument.name for argument in arguments])]


class _Together:
    """
    Nodes that end together: when one ends, the others do; if it failed, launch fails too.

    Other nodes of the launch go on, such as those of a second include.
    """

    def __init__(self) -> None:
        self._nodes: list[Node] = []

    def node(self, watches: bool = False, **options: Any) -> Node:
        """Return a node of the group; one that only watches does not end the others."""
        made = Node(output='screen', sigterm_timeout=PATIENCE,
                    on_exit=None if watches else self._end, **options)
        self._nodes.append(made)
        return made

    def _end(self, event: ProcessExited, context: LaunchContext) -> list[Action]:
        """End the other nodes; raise for a failure, which ends launch with exit code 1."""
        if context.is_shutdown:
            return []
        if event.returncode:
            raise FlightError(f'{event.process_name} ended with exit code {event.returncode}')
        return [EmitEvent(event=ShutdownProcess(process_matcher=matches_action(node)))
                for node in self._nodes if node is not event.action]


def _folder() -> tuple[Path, Action]:
    """Return a new folder, and the action that removes it when the launch ends."""
    folder = Path(tempfile.mkdtemp(prefix='mambo_'))
    return folder, RegisterEventHandler(OnShutdown(
        on_shutdown=lambda *_: shutil.rmtree(folder, ignore_errors=True)))


class FlightNodes:
    """
    The nodes of a flight, which a launch file takes one by one.

    Parameters
    ----------
    given
        Texts of the launch arguments by name.

    Attributes
    ----------
    cleanup : Action
        Removes the files of the flight at its end.
    left : list of Process
        Processes that were not taken yet.

    """

    def __init__(self, given: Mapping[str, str]) -> None:
        loopback.check()
        plan = launching.flight(given)
        self._level = given['log_level']
        folder, self.cleanup = _folder()
        self.left = launching.processes(plan, folder)
        self._together = _Together()

    def nodes(self, package: str, executable: str) -> list[Action]:
        """Return a node for each drone that has it as a process; none if it is not asked for."""
        taken = [one for one in self.left if one[:2] == (package, executable)]
        self.left = [one for one in self.left if one not in taken]
        return [self._node(one) for one in taken]

    def _node(self, one: Process) -> Node:
        """Return the action of a process; the flight ends with it unless it only watches."""
        level = ['--ros-args', '--log-level', self._level] if self._level else []
        return self._together.node(
            package=one.package, executable=one.executable, arguments=[*one.arguments, *level],
            watches=one[:2] == DESCRIPTION)


def replay_nodes(given: Mapping[str, str]) -> list[Action]:
    """Return the actions of a replay, given the texts of the launch arguments by name."""
    loopback.check()
    plan = launching.replay_plan(given)
    actions: list[Action] = []
    together = _Together()
    common: list[str] = []
    namespace = given['namespace'].strip('/')
    if plan.scenario is not None:
        folder, cleanup = _folder()
        actions.append(cleanup)
        file = folder / 'scenario.yaml'
        file.write_text(to_yaml(plan.scenario, f'/{namespace}'))
        common = [str(file)]
    for package, executable, parameters in plan.nodes:
        if (package, executable) == RECORDER and common:
            parameters = {**parameters, 'scenario': common[0]}
        own = {name: ParameterValue(value, value_type=type(value))
               for name, value in parameters.items()}
        actions.append(together.node(
            package=package, executable=executable, namespace=namespace,
            parameters=[*common, own] if own else common,
            remappings=[(f'/{topic}', topic) for topic in OWN]
            if given['own_clock'] == 'true' else None))
    return actions
