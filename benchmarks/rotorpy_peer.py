"""RotorPy in an environment of its own, and its flights of the circle."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
import subprocess
import sys

from mambo_model.vehicle.parameters import Vehicle

from .measure import Contender, Gap

REQUIREMENTS = Path(__file__).with_name('peers.txt')
FLIGHT = Path(__file__).with_name('rotorpy_flight.py')
RADIUS = (0.7, 1.1)  # m, of the circle that it flies: else it did not follow
# one thread: arrays of three numbers gain nothing from more; the paths of ROS do not belong there
LEFT_OUT = ('PYTHONPATH', 'PYTHONHOME', 'LD_LIBRARY_PATH', 'VIRTUAL_ENV')
THREADS = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')


def environment() -> dict[str, str]:
    """Return the environment variables of a process of the peer."""
    kept = {name: value for name, value in os.environ.items() if name not in LEFT_OUT}
    return {**kept, **THREADS}


def install(folder: Path, requirements: Path = REQUIREMENTS, what: str = 'RotorPy') -> Path:
    """
    Make the environment of peers unless it is there; return its Python.

    Raises
    ------
    Gap
        If it cannot be made.

    """
    python, done = folder / 'bin/python3', folder / 'installed.txt'
    if done.is_file() and done.read_text() == requirements.read_text():
        return python
    try:
        for command in (
                [sys.executable, '-m', 'venv', '--clear', str(folder)],
                [str(python), '-m', 'pip', 'install', '-q', '--disable-pip-version-check',
                 '-r', str(requirements)]):
            subprocess.run(command, check=True, text=True, capture_output=True, timeout=900,
                           env=environment())
    except subprocess.CalledProcessError as error:
        lines = [line for line in error.stderr.splitlines() if line.startswith('ERROR')]
        raise Gap(f'{what} cannot be installed ({(lines or ["no reason given"])[0]}): '
                  'is there a network?') from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Gap(f'{what} cannot be installed: {error}') from None
    done.write_text(requirements.read_text())
    return python


def fly(python: Path, asked: dict) -> dict[str, float]:
    """
    Fly once in a process of its own.

    Raises
    ------
    Gap
        If it fails or does not follow the circle.

    """
    done = subprocess.run([str(python), str(FLIGHT), json.dumps(asked)], text=True,
                          capture_output=True, env=environment())
    if done.returncode:
        output = done.stderr.strip().splitlines() or ['it says nothing']
        raise Gap(f'RotorPy ended with exit code {done.returncode}: {output[-1]}')
    out = json.loads(done.stdout.splitlines()[-1])
    if not RADIUS[0] < out['radius'] < RADIUS[1]:
        raise Gap(f'RotorPy flies a circle of {out["radius"]:.2f} m instead of 1 m')
    return out


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return RotorPy at the rates of the others, at its fastest, and with its own sensors."""
    values, at = dataclasses.asdict(Vehicle()), folder / 'rotorpy'
    asked = {'seconds': 4.0 if quick else 20.0, 'vehicle': {
        name: values[name] for name in ('mass', 'inertia', 'arm', 'yaw_ratio',
                                        'drag_coefficient')}}

    def contender(name: str, title: str, detail: str, method: str, step: float,
                  with_sensors: bool = False) -> Contender:
        steps = {'first_step': step, 'max_step': step}
        setting = {**asked, 'method': method, 'step': steps, 'environment': with_sensors}
        return Contender(
            'rotorpy', name, title, lambda: fly(install(at), setting), prepare, detail)

    def prepare() -> None:
        install(at)
    return [
        contender('rotorpy_same_rates', 'RotorPy, same rates',
                  'no sensors; SE3 controller at 200 Hz, steps of RK45 at 1 kHz, a call of its '
                  'integrator for each step of the controller', 'RK45', 0.001),
        contender('rotorpy_fastest', 'RotorPy, fastest',
                  'no sensors; one step of RK23 for each of the controller at 200 Hz',
                  'RK23', 0.005),
        contender('rotorpy_sensors', 'RotorPy with sensors',
                  'its own loop at 200 Hz, with IMU and motion capture with noise, no estimator; '
                  'one step of RK23 each', 'RK23', 0.005, True)]
