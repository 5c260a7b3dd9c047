"""Signals of a Crazyflie log by their names, without the group ``ae483log``; SI."""

import math

import numpy as np

# In the order of (3.2): front left, front right, rear right, rear left.
MOTORS = ('m_4', 'm_1', 'm_2', 'm_3')
RATES = ('w_x', 'w_y', 'w_z')
GYRO = ('gyro.x', 'gyro.y', 'gyro.z')  # deg/s
SAME_TURNING = (
    ((RATES, math.degrees(1.0)), (('psi', 'theta', 'phi'), (1.0, 1.0, 1.0))),
    ((GYRO, 1.0), (('stateEstimate.yaw', 'stateEstimate.pitch', 'stateEstimate.roll'),
                   np.radians([1.0, -1.0, 1.0]))))
"""A gyro and its unit [deg/s], the attitude that goes with it and its factors [rad]: the pitch of
the firmware is positive with the nose up (``estimator_kalman``, legacy coordinates)."""
USED = (*RATES, 'a_z', 'r', 'n_x', 'n_y', *MOTORS, 'p_x', 'p_y', 'p_z', 'psi',
        'theta', 'phi', 'v_x', 'v_y', 'v_z', 'p_x_des', 'p_y_des', 'p_z_des')
ODOMETRY = ('p_x', 'p_y', 'p_z', 'psi', 'theta', 'phi', 'v_x', 'v_y', 'v_z', *RATES)
GOAL = ('p_x_des', 'p_y_des', 'p_z_des')
MOCAP = ('x', 'y', 'z', 'yaw', 'pitch', 'roll')
FORMER = {f'o_{axis}{end}': f'p_{axis}{end}' for axis in 'xyz' for end in ('', '_des')}
"""Present name of each signal that the course has renamed."""
