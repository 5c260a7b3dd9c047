"""
Play the sensors of a bag to a live estimator, for viewers; record on request.

    ros2 launch mambo_bringup replay.launch.py bag:=bags/my_flight rate:=2.0

Launch ends with the bag.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from mambo_bringup.launch_actions import description
from mambo_bringup.launching import replay_plan

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


def generate_launch_description() -> LaunchDescription:
    """Return arguments and nodes."""
    return description(ARGUMENTS, replay_plan)
