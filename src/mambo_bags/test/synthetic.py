"""A flight made of formulas, as a bag: known errors, known losses, every topic of the graph."""

from __future__ import annotations

from pathlib import Path

from mambo_bags import columns
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
import numpy as np
from scipy.spatial.transform import Rotation

STEP = 5_000_000  # ns
FRAME = 8_333_333  # ns of Optitrack
TYPES = {
    'imu/data_raw': 'sensor_msgs/msg/Imu', 'sonar/range': 'sensor_msgs/msg/Range',
    'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
    'barometer/pressure': 'sensor_msgs/msg/FluidPressure',
    'sensor_tick': 'mambo_interfaces/msg/SensorTick', 'ground_truth/odom': 'nav_msgs/msg/Odometry',
    'optitrack/pose': 'geometry_msgs/msg/PoseStamped', 'estimate/odom': 'nav_msgs/msg/Odometry',
    'estimator/state': 'mambo_interfaces/msg/EstimatorState',
    'reference': 'mambo_interfaces/msg/Reference', 'motor_pwm': 'mambo_interfaces/msg/MotorPwm',
    'onboard/odom': 'nav_msgs/msg/Odometry'}
CAPTURE = {'optitrack/tick': 'mambo_interfaces/msg/CaptureTick'}
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
SIMULATED = tuple(name for name in TYPES if not name.startswith('onboard'))
START, BLEND, LANDING = 5.0, 3.0, 16.0  # s
SCENARIO = ('/mambo/reference_node:\n  ros__parameters:\n    plan:\n'
            f'      start_time: {START}\n      blend_duration: {BLEND}\n')
TRACKING = (0.01, -0.02, 0.03)  # m, truth minus reference after take-off, twice that before
ESTIMATION = (0.003, 0.004, -0.012)  # m, estimate minus truth
VARIANCE = (1e-4, 4e-4, 9e-4, 0.0, 0.0, 0.0)  # m^2, rad^2, as the estimate claims
E_TOTAL = 0.013  # m, its length


def truth_position(t):
    """Return (n, 3) m: up to 1.5 m, then a circle of 1 m."""
    t = np.asarray(t, float)
    rise = np.clip((t - 1.0) / 3.0, 0.0, 1.0)
    height = 1.5 * rise * rise * (3.0 - 2.0 * rise)
    join = np.clip((t - START) / BLEND, 0.0, 1.0)
    join = join * join * (3.0 - 2.0 * join)
    height = height * np.clip((20.0 - t) / 4.0, 0.0, 1.0)
    return np.stack([join * np.cos(t - START), join * np.sin(t - START), height], axis=-1)


def phase(t):
    """Return GROUND, TAKEOFF, TRACK or LANDING at t in s."""
    return 0 if t < 1.0 else 1 if t < START else 2 if t < LANDING else 3


class Maker:
    """Writes stamped messages of one bag."""

    def __init__(self, path, topics, **options):
        self.store = columns.load_types([*TYPES.values(), *CAPTURE.values(), DIAGNOSTICS])
        self.writer = BagWriter(path, **options)
        for topic in topics:
            self.writer.add_topic(f'/mambo/{topic}', {**TYPES, **CAPTURE}[topic])

    def __getattr__(self, name):
        return lambda *values: self.store.types[f'geometry_msgs/msg/{name}'](*map(float, values))

    def message(self, topic, ns, frame='odom', **fields):
        stamp = self.store.types['builtin_interfaces/msg/Time'](*map(int, divmod(ns, 10**9)))
        header = self.store.types['std_msgs/msg/Header'](stamp, frame)
        name = {**TYPES, **CAPTURE}.get(topic, topic)
        message = columns.zero(self.store, name, header=header, **fields)
        return bytes(self.store.serialize_cdr(message, name))

    def write(self, topic, ns, **fields):
        self.writer.write(f'/mambo/{topic}', self.message(topic, ns, **fields), ns)

    def pose(self, position, quaternion=(0.0, 0.0, 0.0, 1.0)):
        types = self.store.types
        return types['geometry_msgs/msg/Pose'](
            types['geometry_msgs/msg/Point'](*map(float, position)), self.Quaternion(*quaternion))

    def odometry(self, topic, ns, position, quaternion=(0.0, 0.0, 0.0, 1.0),
                 velocity=(0.0, 0.0, 0.0), variance=0.0):
        types, covariance = self.store.types, np.diag(np.broadcast_to(variance, 6)).reshape(-1)
        self.write(
            topic, ns, child_frame_id='base_link',
            pose=types['geometry_msgs/msg/PoseWithCovariance'](
                self.pose(position, quaternion), covariance),
            twist=types['geometry_msgs/msg/TwistWithCovariance'](
                types['geometry_msgs/msg/Twist'](self.Vector3(*velocity), self.Vector3(0, 0, 0)),
                np.zeros(36)))


class Flight(Maker):
    """A simulated flight, step by step; see :func:`make_flight`."""

    def __init__(self, path, leave_out, drop, noise, options):
        self.topics = [topic for topic in SIMULATED if topic not in leave_out]
        super().__init__(path, self.topics, **options)
        self.drop, self.noise, self.rng = drop, noise, np.random.default_rng(1)
        self.counts, self.frame = dict.fromkeys(TYPES, 0), 0

    def there(self, topic):
        self.counts[topic] += 1
        return topic in self.topics and self.counts[topic] - 1 not in self.drop.get(topic, ())

    def sensors(self, step, p):
        ns, t, noise, normal = step * STEP, step * 0.005, self.noise, self.rng.standard_normal
        if self.there('imu/data_raw'):
            self.write('imu/data_raw', ns, linear_acceleration=self.Vector3(0.0, 0.0, 9.81))
        if step % 9 == 0 and self.there('sonar/range'):
            self.write('sonar/range', ns, min_range=0.3, max_range=4.0,
                       range=p[2] + 3 * noise * normal())
        if step % 5 == 0 and self.there('optical_flow'):
            self.write('optical_flow', ns, rate_x=-np.sin(t), rate_y=np.cos(t), quality=200)
        if step % 3 == 0 and self.there('barometer/pressure'):
            self.write('barometer/pressure', ns,
                       fluid_pressure=101325.0 - 11.8 * p[2] + 100 * noise * normal())
        if self.there('sensor_tick'):
            names = ('imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure')
            imu, sonar, flow, barometer = (self.counts[name] for name in names)
            self.write('sensor_tick', ns, imu=imu, sonar=sonar, optical_flow=flow,
                       barometer=barometer)

    def estimator(self, step, p):
        ns, rng, nothing = step * STEP, self.rng, float('nan')
        e = np.array(ESTIMATION) + self.noise * rng.standard_normal(3)
        if self.there('estimate/odom'):
            self.odometry('estimate/odom', ns, p + e, variance=VARIANCE)
        if self.there('estimator/state'):
            sonar, flow = step % 9 == 0, step % 5 == 0
            self.write(
                'estimator/state', ns, status=2, height=p[2],
                sonar_innovation=0.02 * rng.normal() if sonar else nothing,
                sonar_test_ratio=rng.uniform(0, 1.05) if sonar else nothing,
                flow_innovation=0.1 * rng.normal(size=2) if flow else np.full(2, nothing),
                flow_test_ratio=0.2 if flow else nothing,
                barometer_innovation=nothing, barometer_test_ratio=nothing)

    def diagnose(self, node, level, t, message, ns):
        types = self.store.types
        status = types['diagnostic_msgs/msg/DiagnosticStatus'](level, node, message, '', [])
        data = self.message(DIAGNOSTICS, round(t * 1e9), '', status=[status])
        self.writer.write('/diagnostics', data, ns)

    def step(self, step):
        ns, t = step * STEP, step * 0.005
        p, factor = truth_position(t), 1.0 if t >= START + BLEND else 2.0
        self.sensors(step, p)
        if self.there('ground_truth/odom'):
            self.odometry('ground_truth/odom', ns, p)
        self.estimator(step, p)
        if self.there('reference'):
            self.write('reference', ns, position=self.Vector3(*(p - factor * np.array(TRACKING))),
                       attitude=self.Quaternion(0, 0, 0, 1), phase=phase(t))
        if self.there('motor_pwm'):
            self.write('motor_pwm', ns, pwm=(1 <= phase(t) <= 3) * (
                247.0 + 20.0 * np.sin(t + np.arange(4))))
        while self.frame * FRAME <= ns:
            exposure = self.frame * FRAME
            if self.there('optitrack/pose'):
                self.write('optitrack/pose', exposure,
                           pose=self.pose(truth_position(exposure * 1e-9)))
            self.frame += 1


def make_flight(path: Path, duration=18.0, leave_out=(), drop=None, noise=0.0, diagnostics=(),
                **options) -> Path:
    """
    Write a simulated flight.

    ``leave_out`` topics are not in the bag; of ``drop`` {topic: numbers} those messages are lost.
    ``diagnostics`` are (node, level, s, message), published in the order given.
    """
    options.setdefault('attachments', {'scenario.yaml': SCENARIO})
    flight = Flight(path, leave_out, drop or {}, noise, options)
    if diagnostics:
        flight.writer.add_topic('/diagnostics', DIAGNOSTICS)
    for step in range(round(duration * 200)):
        flight.step(step)
    for row in diagnostics:
        flight.diagnose(*row, round(duration * 200) * STEP)
    assert flight.writer.late == 0
    flight.writer.close({'real_time_factor': '4.25'})
    return Path(path)


def loop(t):
    """Return position (n, 3) m and velocity (n, 3) m/s of a loop that starts on the floor."""
    rise = np.clip((t - 2.0) / 2.0, 0.0, 1.0)
    position = np.column_stack([np.sin(2.0 * t), np.cos(t), rise])
    return position, np.column_stack([2.0 * np.cos(2.0 * t), -np.sin(t), 0.5 * (
        (t > 2.0) & (t < 4.0))])


def rocking(t):
    """Return a tilt that rocks, and a yaw that turns."""
    return Rotation.from_euler('ZYX', np.column_stack([
        0.3 * t, 0.1 * np.sin(2.0 * t), 0.1 * np.cos(3.0 * t)]))


FLIP = Rotation.from_euler('x', 180.0, degrees=True)


def make_capture(target, flipped=(), lost=None, floor_flow=False):
    """Write 15 s of a motion capture of a loop, some poses upside down, and return the bag."""
    topics = ('optitrack/pose', 'optical_flow') if floor_flow else ('optitrack/pose',)
    maker = Maker(target, topics)
    t = np.arange(0.0, 15.0, 0.01)
    position, turns = loop(t)[0], rocking(t)
    for k in range(len(t)):
        ns = round(t[k] * 1e9)
        if not (lost and lost[0] < t[k] < lost[1]):
            q = (turns[k] * FLIP if k in flipped else turns[k]).as_quat()
            maker.write('optitrack/pose', ns, pose=maker.pose(position[k], q))
        if floor_flow and k % 3 == 0:
            maker.write('optical_flow', ns, rate_x=0.1, rate_y=0.2, quality=200)
    maker.writer.close()
    return read_bag(target)
