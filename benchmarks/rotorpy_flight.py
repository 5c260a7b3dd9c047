"""
Fly a circle of 1 m in RotorPy and print how fast, as JSON: run by the Python of its environment.

The vehicle is a Mambo as far as RotorPy's parameters say it: mass, inertia, arm, hover thrust and
rotor drag. The settings are named in the table that this makes.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.environments import Environment
from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor

CONTROL = 0.005  # s
HEIGHT = 1.5  # m


def vehicle(values: dict, integrator: dict) -> Multirotor:
    """Return RotorPy's vehicle with the numbers of the Mambo."""
    arm = values['arm']
    places = ((arm, arm), (arm, -arm), (-arm, -arm), (-arm, arm))
    hover = values['mass'] * 9.81 / 4.0
    speed = np.sqrt(hover / quad_params['k_eta'])
    params = {
        **quad_params, 'mass': values['mass'], 'Ixx': values['inertia'][0],
        'Iyy': values['inertia'][1], 'Izz': values['inertia'][2],
        'rotor_pos': {f'r{i + 1}': np.array([x, y, 0.0]) for i, (x, y) in enumerate(places)},
        'k_m': values['yaw_ratio'] * quad_params['k_eta'], 'tau_m': 0.02, 'k_z': 0.0,
        'k_d': values['drag_coefficient'] * hover / speed / 4.0, 'rotor_speed_max': 2.0 * speed}
    start = {'x': np.array([1.0, 0.0, HEIGHT]), 'v': np.array([0.0, 1.0, 0.0]),
             'q': np.array([0.0, 0.0, 0.0, 1.0]), 'w': np.zeros(3), 'wind': np.zeros(3),
             'rotor_speeds': np.full(4, speed)}
    craft = Multirotor(params, initial_state=start, integrator_kwargs=integrator)
    craft.params = params
    return craft


def circle() -> ThreeDCircularTraj:
    """Return the reference: 1 m at 1 rad/s."""
    return ThreeDCircularTraj(np.array([0.0, 0.0, HEIGHT]), np.array([1.0, 1.0, 0.0]),
                              np.full(3, 0.5 / np.pi))


def bare(craft: Multirotor, seconds: float) -> np.ndarray:
    """Fly without sensors, world and record; return the positions (n, 3) in m."""
    controller, reference, state = SE3Control(craft.params), circle(), craft.initial_state
    path = []
    for k in range(round(seconds / CONTROL)):
        path.append(state['x'])
        answer = controller.update(k * CONTROL, state, reference.update(k * CONTROL))
        state = craft.step(state, answer, CONTROL)
    return np.array(path)


def environment(craft: Multirotor, seconds: float) -> np.ndarray:
    """Fly in RotorPy's own loop, with its IMU and motion capture; return the positions (n, 3)."""
    world = Environment(craft, SE3Control(craft.params), circle(), sim_rate=round(1.0 / CONTROL))
    return world.run(t_final=seconds, terminate=False)['state']['x']


def main() -> None:
    """Fly as the JSON argument says."""
    asked = json.loads(sys.argv[1])
    craft = vehicle(asked['vehicle'], {'method': asked['method'], **asked['step']})
    fly = environment if asked['environment'] else bare
    fly(craft, 0.1)  # what it loads late
    wall, cpu = time.perf_counter(), time.process_time()
    path = fly(craft, asked['seconds'])
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    late = path[len(path) // 2:]
    print(json.dumps({
        'factor': asked['seconds'] / wall, 'cpu_factor': asked['seconds'] / cpu,
        'radius': float(np.hypot(late[:, 0], late[:, 1]).mean())}))


if __name__ == '__main__':
    main()
