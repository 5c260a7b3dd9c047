"""Table of every topic of the graph: relative name, message type, rate, quality of service."""

from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from mambo_interfaces.msg import (
    CaptureTick, Command, ControllerState, EstimatorState, MotorPwm, NodeLinks, OpticalFlow,
    Reference, SensorTick)
from mambo_model.schema import ParameterError
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu, Joy, Range
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

QUEUE = 2000
"""Depth of every queue, 10 s of a 200 Hz topic: a slow reader lags but loses nothing."""


@dataclass(frozen=True)
class Topic:
    """
    One topic.

    Attributes
    ----------
    name : str
        Relative to the node's namespace, or absolute.
    msg_type : type
        Message class.
    rate : float
        Nominal rate in Hz, 0 if event-driven; the default where a parameter sets it.
    transient_local : bool
        Whether late joiners get the last message.
    shared : bool
        Whether several nodes publish it.

    """

    name: str
    msg_type: type
    rate: float
    transient_local: bool = False
    shared: bool = False

    @property
    def type_name(self) -> str:
        """Return the type as ``package/msg/Name``."""
        package = self.msg_type.__module__.split('.')[0]
        return f'{package}/msg/{self.msg_type.__name__}'


CLOCK = Topic('/clock', Clock, 200.0)
IMU = Topic('imu/data_raw', Imu, 200.0)
SONAR = Topic('sonar/range', Range, 22.0)
OPTICAL_FLOW = Topic('optical_flow', OpticalFlow, 40.0)
BAROMETER = Topic('barometer/pressure', FluidPressure, 70.0)
SENSOR_TICK = Topic('sensor_tick', SensorTick, 200.0)
GROUND_TRUTH = Topic('ground_truth/odom', Odometry, 200.0)
OPTITRACK = Topic('optitrack/pose', PoseStamped, 120.0)
CAPTURE_TICK = Topic('optitrack/tick', CaptureTick, 200.0)
ESTIMATE = Topic('estimate/odom', Odometry, 200.0)
LOCATED = Topic('estimate/map', Odometry, 200.0)
ESTIMATOR_STATE = Topic('estimator/state', EstimatorState, 200.0)
REFERENCE = Topic('reference', Reference, 200.0)
COMMAND = Topic('command', Command, 0.0)
SETPOINT = Topic('setpoint', Reference, 0.0)
JOY = Topic('joy', Joy, 0.0)
CONTROLLER_STATE = Topic('controller/state', ControllerState, 200.0)
MOTOR_PWM = Topic('motor_pwm', MotorPwm, 200.0)
LINKS = Topic('graph/links', NodeLinks, 0.0, transient_local=True, shared=True)
TF = Topic('/tf', TFMessage, 50.0, shared=True)
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, 1.0, shared=True)
TF_STATIC = Topic('/tf_static', TFMessage, 0.0, transient_local=True, shared=True)
ROBOT_DESCRIPTION = Topic('robot_description', String, 0.0, transient_local=True)
TRUE_PATH = Topic('path/true', Path, 0.0)
ESTIMATED_PATH = Topic('path/estimated', Path, 0.0)
MEASURED_PATH = Topic('path/measured', Path, 0.0)
REFERENCE_PATH = Topic('path/reference', Path, 0.0)
MARKERS = Topic('markers', MarkerArray, 10.0)
BEAM = Topic('sonar/beam', Range, 22.0)

NAMESPACE = '/mambo'
"""Of a drone that flies alone."""
OWN = ('clock', 'tf', 'tf_static', 'diagnostics')
"""Absolute topics that each of several drones has in its namespace."""


def full_name(topic: Topic, namespace: str) -> str:
    """Return the absolute name of a topic of the drone in a namespace."""
    own = not topic.name.startswith('/') or (
        namespace != NAMESPACE and topic.name[1:] in OWN)
    return f'{namespace}/{topic.name.lstrip("/")}' if own else topic.name


RECORDED = (
    CLOCK, IMU, SONAR, OPTICAL_FLOW, BAROMETER, SENSOR_TICK, GROUND_TRUTH, OPTITRACK, ESTIMATE,
    ESTIMATOR_STATE, REFERENCE, CONTROLLER_STATE, MOTOR_PWM, TF, DIAGNOSTICS)
"""Topics recorded by default: all that depend on the simulated flight alone."""

COUNTED = (IMU, SONAR, OPTICAL_FLOW, BAROMETER)
"""Topics whose samples ``sensor_tick`` counts, in its order."""

STEADY = (IMU, SENSOR_TICK, GROUND_TRUTH)
"""Topics with a message at every step of a flight, from the node of ``/clock``."""

AIDED = (CAPTURE_TICK, LOCATED)
"""What the recorder takes besides where the estimator uses the motion capture."""

COMMANDED = (COMMAND,)
"""What the recorder takes besides in a commanded flight."""

RECORDABLE = (*RECORDED, *AIDED, *COMMANDED)

DESCRIBED = (ROBOT_DESCRIPTION, TF_STATIC, TRUE_PATH, ESTIMATED_PATH, MEASURED_PATH,
             REFERENCE_PATH, MARKERS, BEAM)
"""What viewers get from description_node; never recorded."""


def selected(names: str) -> list[Topic]:
    """
    Return the topics to record.

    Parameters
    ----------
    names
        Names separated by commas; without any, all that are recorded by default.

    Raises
    ------
    mambo_model.schema.ParameterError
        For an unknown name.

    """
    known = {topic.name: topic for topic in RECORDABLE}
    wanted = [name.strip() for name in names.split(',') if name.strip()] or [
        topic.name for topic in RECORDED]
    for name in wanted:
        if name not in known:
            raise ParameterError(
                f"RecorderNodeParams.topics: unknown topic {name}; known: {', '.join(known)}")
    return [known[name] for name in wanted]
