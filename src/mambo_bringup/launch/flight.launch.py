"""
Flies the simulated Mambo: every node of the graph in one namespace, recorded if asked.

    ros2 launch mambo_bringup flight.launch.py trajectory:=z_sine duration:=30 bag:=z_sine
    ros2 launch mambo_bringup flight.launch.py --show-args

The flight is over, and launch with it, when any node ends: ``sim_node`` does after ``duration``.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from mambo_bringup.launch_actions import description
from mambo_bringup.launching import choices, flight_plan

ARGUMENTS = [
    DeclareLaunchArgument(
        'trajectory', default_value='',
        description='A trajectory by its name, as mambo run --help lists them, or full path to '
                    'the file of a course; empty: as params_file says, else circle.'),
    DeclareLaunchArgument(
        'estimator', default_value='',
        description='What answers the sensors: a name, or full path to a Python file; empty: as '
                    'params_file says, else kalman.'),
    DeclareLaunchArgument(
        'controller', default_value='',
        description='Control law: a name, or full path to a Python file; empty: as params_file '
                    'says, else cascaded.'),
    DeclareLaunchArgument(
        'mode', default_value='', choices=choices('mode'),
        description='How time advances: paced to the wall clock, or in lockstep as fast as the '
                    'machine allows; empty: as params_file says, else realtime.'),
    DeclareLaunchArgument(
        'speed', default_value='',
        description='Flight over wall time in realtime mode; empty: as params_file says, else 1.'),
    DeclareLaunchArgument(
        'duration', default_value='',
        description='Flight time in s, 0: until stopped; empty: as params_file says, else 0.'),
    DeclareLaunchArgument(
        'seed', default_value='',
        description='Seed of every noise stream; empty: as params_file says, else 1.'),
    DeclareLaunchArgument(
        'params_file', default_value='',
        description='Full path to a ROS 2 parameter file (a scenario.yaml) with any parameter of '
                    'any node; arguments that are given come after it.'),
    DeclareLaunchArgument(
        'namespace', default_value='mambo', description='Namespace of the drone.'),
    DeclareLaunchArgument(
        'own_clock', default_value='false', choices=('true', 'false'),
        description='Have /clock, /tf and /diagnostics in the namespace, as each of several '
                    'drones in one ROS domain needs them.'),
    DeclareLaunchArgument(
        'bag', default_value='', description='Directory to record to; empty: do not record.'),
]


def generate_launch_description() -> LaunchDescription:
    """Return arguments and nodes."""
    return description(ARGUMENTS, flight_plan)
