"""
Perfect tracking of the paths of the thesis: positions, velocities, attitudes and body rates.

The prediction of a mechanism needs only kinematics, without controller or noise. The thrust axis
is that of (3.14), with or without the tilt that balances the lumped rotor drag (3.12). On a path
carried by hand the drone stays level. Inertial axes are NED, body axes FRD.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.motion.trajectory import TRAJECTORIES, Trajectory
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

GRAVITY = 9.81     # m/s^2
DRAG_RATE = 0.54   # 1/s, deceleration by rotor drag over horizontal velocity
SWAPPED = Trajectory(
    '(5.4) with x and y exchanged, sec. 5.5', (0.0, 0.0, -1.5), (1.0, 1.0, 1.0),
    phase=(0.5 * math.pi, 0.0, math.pi))
LEVEL = 'hand loop'

PATHS = {
    '(5.3)': TRAJECTORIES['circle'],
    '(5.4)': TRAJECTORIES['circle_rising'],
    'swapped': SWAPPED,
    '(5.5)': TRAJECTORIES['incline'],
    '(5.6)': TRAJECTORIES['vertical_circle'],
    'C.4': TRAJECTORIES['vertical_circle_large'],
    '(4.1)': TRAJECTORIES['default_circle'],
    LEVEL: TRAJECTORIES['vertical_circle_large'],
}
"""The columns of the table of mechanisms; on the last one the drone is level."""
EXPERIMENTS = {  # {scenario: (speed factor, size factor, path of the table)}
    'drift_w_half': (0.5, 1.0, 'C.4'),
    'drift_w_1': (1.0, 1.0, 'C.4'),
    'drift_w_2': (2.0, 1.0, 'C.4'),
    'drift_half_amplitude': (1.0, 0.5, 'C.4'),
    'drift_hand_loop': (1.0, 1.0, LEVEL),
}


class Track(NamedTuple):
    """
    A motion at n instants.

    Attributes
    ----------
    t : (n,) s
    position, velocity : (n, 3) m, m/s, inertial NED
    R : (n, 3, 3)
        Body to inertial.
    omega : (n, 3) rad/s, body FRD

    """

    t: Array
    position: Array
    velocity: Array
    R: Array
    omega: Array

    @property
    def nu(self) -> Array:
        """Return the velocity in body axes, (n, 3) m/s."""
        return np.einsum('nji,nj->ni', self.R, self.velocity)

    @property
    def height(self) -> Array:
        """Return the height, (n,) m."""
        return -self.position[:, 2]

    @property
    def depth(self) -> Array:
        """Return Z = h / (cos phi cos theta) along b3, (n,) m."""
        return self.height / self.R[:, 2, 2]

    def part(self, rows: NDArray) -> Track:
        """Return the instants selected by a mask or an index."""
        return Track(*(column[rows] for column in self))


def perfect(
    path: Trajectory, t: Array, speed: float = 1.0, size: float = 1.0, level: bool = False,
    drag_rate: float = 0.0,
) -> Track:
    """
    Return the motion of a vehicle that is on a path, its thrust along g - a.

    Parameters
    ----------
    path
        Sines and slopes, without turning round.
    t : (n,) s
    speed, size
        Factors on rate and amplitude.
    level
        Carried by hand: no tilt, no rotation.
    drag_rate : 1/s
        The thrust axis makes up for a horizontal drag of this times the velocity.

    """
    W = path.rate * speed
    angle = W * np.asarray(t, float)[:, None] + np.array(path.phase)
    A = size * np.array(path.amplitude)
    slope = speed * size * np.array(path.slope)
    position = A * np.sin(angle) + np.array(path.offset) + np.asarray(t, float)[:, None] * slope
    velocity = A * W * np.cos(angle) + slope
    a, jerk = -A * W**2 * np.sin(angle), -A * W**3 * np.cos(angle)
    if level:
        n = len(angle)
        return Track(t, position, velocity, np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)))
    drag = drag_rate * np.array([1.0, 1.0, 0.0])
    thrust = np.array([0.0, 0.0, GRAVITY]) - a - drag * velocity  # along b3
    length = np.linalg.norm(thrust, axis=1)
    axis = thrust / length[:, None]
    # the least rotation of e3 onto the axis; heading is no flow
    q = np.column_stack([-axis[:, 1], axis[:, 0], np.zeros(len(axis)), 1.0 + axis[:, 2]])
    R = Rotation.from_quat(q).as_matrix()
    turning = np.einsum('nji,nj->ni', R, -jerk - drag * a) / length[:, None]
    omega = np.column_stack([-turning[:, 1], turning[:, 0], np.zeros(len(axis))])
    return Track(np.asarray(t, float), position, velocity, R, omega)


def one_turn(
    name: str, speed: float = 1.0, size: float = 1.0, drag_rate: float = 0.0, steps: int = 1256,
) -> Track:
    """Return one turn of a path of ``PATHS`` in equal steps, without its last instant."""
    return turn_of(PATHS[name], speed, size, drag_rate, steps, name == LEVEL)


def turn_of(
    path: Trajectory, speed: float = 1.0, size: float = 1.0, drag_rate: float = 0.0,
    steps: int = 1256, level: bool = False,
) -> Track:
    """Return one turn of any path, as :func:`perfect`, in equal steps, without its end."""
    T = 2.0 * math.pi / (path.rate * speed)
    return perfect(path, np.arange(steps) * T / steps, speed, size, level, drag_rate)
