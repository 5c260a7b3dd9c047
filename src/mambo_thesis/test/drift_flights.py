"""Flights of known mechanisms, on paths of formulas: what drift tests have in common."""

from mambo_analysis.importers.common import Publisher
from mambo_bags.writer import BagWriter
from mambo_thesis.drift.flight import Flight
from mambo_thesis.drift.mechanisms import flow, MECHANISMS
from mambo_thesis.drift.paths import DRAG_RATE, EXPERIMENTS, LEVEL, PATHS, perfect
import numpy as np
from scipy.spatial.transform import Rotation

NOISE = 0.015  # rad/s of a sample, that of the simulated sensor
TRUE = {  # a value of each mechanism as the table of mechanisms has it
    'A': {'slope': 0.07}, 'A3': {'gain': 0.011}, 'H': {'height_offset': 0.14},
    'B': {'height_lag': 0.1}, 'C1': {'tilt_ignored': 1.0}, 'C2': {'frame': 1.0},
    'D': {'leakage': -1.0}, 'E': {'coupling_x': 0.05, 'coupling_y': 0.05}, 'F': {'cubic': 0.1},
    'G': {'coriolis': 1.0}}
ALONE = [(), *((letter,) for letter in MECHANISMS)]


def flown(path, values, seed, speed=1.0, size=1.0, drag=DRAG_RATE, duration=25.2, noise=NOISE):
    """Return a flight on a path, its flow by the equation and white noise; 32 Hz."""
    t, fine = np.arange(0.0, duration, 1 / 32), np.arange(-1.0, duration, 0.01)
    args = speed, size, path == LEVEL, drag
    height = perfect(PATHS[path], fine, *args).height
    f = Flight(path, perfect(PATHS[path], t, *args), np.zeros((len(t), 2)),
               np.column_stack([fine, height]), 0.0)
    exact = flow(f.track, f.height_before(values.get('height_lag', 0.0)), values)
    return f._replace(flow=exact + noise * np.random.default_rng(seed).normal(size=exact.shape))


def experiments_of(values, seed=0):
    return [flown(path, values, 10 * seed + k, speed, size)
            for k, (speed, size, path) in enumerate(EXPERIMENTS.values())]


def thesis_of(values, drag, seed=0):
    return [flown(path, values, 10 * seed + k, drag=drag)
            for k, path in enumerate(('(5.3)', '(5.4)', '(5.5)', '(5.6)', 'C.4'))]


TOPICS = {'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
          'optitrack/pose': 'geometry_msgs/msg/PoseStamped', 'imu/data_raw': 'sensor_msgs/msg/Imu'}


def write(path, values, topics=TOPICS, lag=0.03, flipped=()):
    """Write a bag of the vertical circle, Optitrack at 120 Hz with 0.2 mm of noise."""
    rng = np.random.default_rng(0)

    def motion(t):
        return perfect(PATHS['C.4'], t, drag_rate=DRAG_RATE)

    with BagWriter(path) as writer:
        out = Publisher(writer, topics)
        t = np.arange(0.0, 25.0, 1 / 32)
        seen = flow(motion(t), motion(t).height, values) + NOISE * rng.normal(size=(len(t), 2))
        for time, (x, y) in zip(t, seen.tolist(), strict=True):
            if 'optical_flow' in topics:
                out.publish('optical_flow', round((time + lag) * 1e9), 'base_link', rate_x=x,
                            rate_y=-y, quality=200)
        t = np.arange(0.0, 25.0, 1 / 120)
        track = motion(t)
        for k, (x, y, z, w) in enumerate(Rotation.from_matrix(track.R).as_quat().tolist()):
            a, b, c = (track.position[k] + 2e-4 * rng.normal(size=3)).tolist()
            stamp, omega = round(t[k] * 1e9), track.omega[k].tolist()
            if k in flipped:  # upside down
                x, y, z, w = w, z, -y, -x
            out.publish('optitrack/pose', stamp, 'map', pose=out.pose((a, -b, -c), (x, -y, -z, w)))
            out.publish('imu/data_raw', stamp, 'base_link', **out.imu(
                (omega[0], -omega[1], -omega[2]), (0.0, 0.0, 9.81)))
    return path
