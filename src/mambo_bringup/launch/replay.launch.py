"""
Play the sensors of a bag to a live estimator, for viewers; record on request.

    ros2 launch mambo_bringup replay.launch.py bag:=bags/my_flight rate:=2.0

Launch ends with the bag.
"""

from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from mambo_bringup.flight.launch_actions import misspelled, replay_nodes, texts

ARGUMENTS = [
    DeclareLaunchArgument('bag', description='Rosbag2 directory or .mcap file.'),
    DeclareLaunchArgument(
        'rate', default_value='1.0',
        description='Ratio of recorded time to wall time; 0: as fast as the estimator answers.'),
    DeclareLaunchArgument(
        'params_file', default_value='',
        description='Full path to a ROS 2 parameter file of the estimator; empty: that of '
                    'the bag, if any.'),
    DeclareLaunchArgument(
        'namespace', default_value='mambo', description='Namespace of the replayed drone.'),
    DeclareLaunchArgument(
        'own_clock', default_value='false', choices=('true', 'false'),
        description='Put /clock, /tf and /diagnostics into the namespace; needed for several '
                    'drones in one ROS domain.'),
    DeclareLaunchArgument(
        'source_namespace', default_value='/mambo',
        description='Namespace of the topics in the bag.'),
    DeclareLaunchArgument(
        'output', default_value='', description='Directory to record to; empty: do not record.'),
]


def nodes(context: LaunchContext) -> list[Action]:
    """Return recorder_node (with output:=), estimator_node and replay_node."""
    return [*misspelled(context, ARGUMENTS), *replay_nodes(texts(context, ARGUMENTS))]


def generate_launch_description() -> LaunchDescription:
    """Return arguments and nodes."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
