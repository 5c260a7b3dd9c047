"""
Fly the simulated Mambo: start every node of the graph in one namespace; record on request.

    ros2 launch mambo_bringup flight.launch.py trajectory:=z_sine duration:=30 bag:=z_sine
    ros2 launch mambo_bringup flight.launch.py --show-args

Launch ends with the flight when any node ends; ``sim_node`` ends after ``duration``.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from mambo_bringup.launch_actions import description
from mambo_bringup.launching import choices, flight_plan

ARGUMENTS = [
    DeclareLaunchArgument(
        'trajectory', default_value='',
        description='Name of a trajectory (mambo run --help lists them) or full path to a course '
                    'file; empty: from params_file, else circle.'),
    DeclareLaunchArgument(
        'estimator', default_value='',
        description='Estimator: a name, or full path to a Python file; empty: from params_file, '
                    'else kalman.'),
    DeclareLaunchArgument(
        'controller', default_value='',
        description='Control law: a name, or full path to a Python file; empty: from params_file, '
                    'else cascaded.'),
    DeclareLaunchArgument(
        'mode', default_value='', choices=choices('mode'),
        description='How time advances: paced to the wall clock, or in lockstep as fast as the '
                    'machine allows; empty: from params_file, else realtime.'),
    DeclareLaunchArgument(
        'speed', default_value='',
        description='Flight over wall time in realtime mode; empty: from params_file, else 1.'),
    DeclareLaunchArgument(
        'duration', default_value='',
        description='Flight time in s, 0: until stopped; empty: from params_file, else 0.'),
    DeclareLaunchArgument(
        'seed', default_value='',
        description='Seed of every noise stream; empty: from params_file, else 1.'),
    DeclareLaunchArgument(
        'params_file', default_value='',
        description='Full path to a ROS 2 parameter file (a scenario.yaml) with any parameters of '
                    'any node; the other launch arguments override it.'),
    DeclareLaunchArgument(
        'namespace', default_value='mambo', description='Namespace of the drone.'),
    DeclareLaunchArgument(
        'own_clock', default_value='false', choices=('true', 'false'),
        description='Put /clock, /tf and /diagnostics into the namespace; needed for several '
                    'drones in one ROS domain.'),
    DeclareLaunchArgument(
        'bag', default_value='', description='Directory to record to; empty: do not record.'),
]


def generate_launch_description() -> LaunchDescription:
    """Return arguments and nodes."""
    return description(ARGUMENTS, flight_plan)
