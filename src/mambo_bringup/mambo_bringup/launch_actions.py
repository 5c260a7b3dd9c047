"""A plan of nodes as actions of ROS 2 launch; the only module that needs launch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
import shutil
import tempfile

from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnShutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from mambo_flight.scenario import to_yaml
from mambo_ros.graph import loopback

from .flight.nodes import OWN, RECORDER
from .launching import Plan


def description(
    arguments: Iterable[DeclareLaunchArgument], plan: Callable[[Mapping[str, str]], Plan],
) -> LaunchDescription:
    """
    Return the launch description of a launch file.

    Parameters
    ----------
    arguments
        Arguments of the launch file, including ``namespace`` and ``own_clock``.
    plan
        Returns the nodes, given the texts of the arguments by name.

    """
    arguments = list(arguments)

    def nodes(context: LaunchContext) -> list[Action]:
        texts = {argument.name: LaunchConfiguration(argument.name).perform(context)
                 for argument in arguments}
        loopback.check()
        return _start(plan(texts), texts['namespace'].strip('/'), texts['own_clock'] == 'true')
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def _start(plan: Plan, namespace: str, own_clock: bool) -> list[Action]:
    """Return the nodes, with their parameters in a file that exists until the launch ends."""
    actions: list[Action] = []
    common: list[str] = []
    if plan.scenario is not None:
        folder = Path(tempfile.mkdtemp(prefix='mambo_'))
        file = folder / 'scenario.yaml'
        file.write_text(to_yaml(plan.scenario, f'/{namespace}'))
        common = [str(file)]
        actions.append(RegisterEventHandler(OnShutdown(
            on_shutdown=lambda *_: shutil.rmtree(folder, ignore_errors=True))))
    for package, executable, given in plan.nodes:
        if (package, executable) == RECORDER and common:
            given = {**given, 'scenario': common[0]}
        own = {name: ParameterValue(value, value_type=type(value))
               for name, value in given.items()}
        actions.append(Node(
            package=package, executable=executable, namespace=namespace,
            parameters=[*common, own] if own else common, output='screen',
            remappings=[(f'/{topic}', topic) for topic in OWN] if own_clock else None,
            sigterm_timeout='20', on_exit=Shutdown()))
    return actions
