"""
Fly the simulated Mambo, or several: start every node of the graph; record on request.

    ros2 launch mambo_bringup flight.launch.py trajectory:=z_sine duration:=30 bag:=z_sine
    ros2 launch mambo_bringup flight.launch.py drones:=4 mode:=lockstep duration:=30 bag:=four
    ros2 launch mambo_bringup flight.launch.py --show-args

The flight ends when any of its nodes ends; ``sim_node`` ends after ``duration``. If a node fails,
launch ends with exit code 1.
"""

from launch import LaunchContext, LaunchDescription
from launch.action import Action
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from mambo_bringup.flight.launch_actions import FlightNodes, misspelled, texts
from mambo_bringup.launching import choices

ARGUMENTS = [
    DeclareLaunchArgument(
        'scenario', default_value='',
        description='Experiment: a name from ./run --list-scenarios, NAME/FLIGHT, or full path to '
                    'a file; the other launch arguments override it.'),
    DeclareLaunchArgument(
        'vehicle', default_value='',
        description='True vehicle: a name, or full path to a vehicle file; empty: from the '
                    'scenario, else identified.'),
    DeclareLaunchArgument(
        'drones', default_value='',
        description='Number of drones in one hall, in the namespaces /mambo1 to /mamboN; empty: '
                    'from the scenario, else 1.'),
    DeclareLaunchArgument(
        'composed', default_value='false', choices=('true', 'false'),
        description='All nodes in one process; needs bag.'),
    DeclareLaunchArgument(
        'description', default_value='true', choices=('true', 'false'),
        description='Publish robot_description, /tf_static, paths and markers for RViz and other '
                    'viewers; the bag is the same with and without.'),
    DeclareLaunchArgument(
        'start_date', default_value='',
        description='Date at flight time 0, ISO 8601 such as 2026-05-01T12:00:00Z; empty: stamps '
                    'begin at 0.'),
    DeclareLaunchArgument(
        'sensor_frames', default_value='false', choices=('true', 'false'),
        description='Frames of IMU and sonar are imu_link and sonar_link, not base_link.'),
    DeclareLaunchArgument(
        'prefixed', default_value='false', choices=('true', 'false'),
        description='Names of frames begin with that of their drone, as in mambo1/base_link.'),
    DeclareLaunchArgument(
        'hardware_ids', default_value='false', choices=('true', 'false'),
        description='Diagnostics have the drone as hardware id and in their names.'),
    DeclareLaunchArgument(
        'log_level', default_value='', choices=('', 'debug', 'info', 'warn', 'error', 'fatal'),
        description='Least severity that the nodes log; empty: info.'),
    DeclareLaunchArgument(
        'trajectory', default_value='',
        description='Name of a trajectory (mambo run --help lists them) or full path to a course '
                    'file; empty: from params_file, else circle.'),
    DeclareLaunchArgument(
        'estimator', default_value='',
        description='Estimator: a name, or full path to a Python file; empty: from params_file, '
                    'else joint.'),
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


def nodes(context: LaunchContext) -> list[Action]:
    """Return every node of the flight: one for each drone, unless it says otherwise."""
    flight = FlightNodes(texts(context, ARGUMENTS))
    return [
        *misspelled(context, ARGUMENTS),
        flight.cleanup,
        *flight.nodes('mambo_bags', 'recorder_node'),            # with bag:=
        *flight.nodes('mambo_sim', 'optitrack_node'),            # of one drone
        *flight.nodes('mambo_bringup', 'hall_capture_node'),     # of several drones
        *flight.nodes('mambo_estimation', 'estimator_node'),
        *flight.nodes('mambo_control', 'reference_node'),
        *flight.nodes('mambo_control', 'controller_node'),
        *flight.nodes('mambo_sim', 'sim_node'),                  # of one drone: owns time
        *flight.nodes('mambo_bringup', 'composed_node'),         # all with composed:=true, or the
        #                                                          simulators of several drones
        *flight.nodes('mambo_description', 'description_node')]  # for viewers, of all drones


def generate_launch_description() -> LaunchDescription:
    """Return arguments and nodes."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=nodes)])
