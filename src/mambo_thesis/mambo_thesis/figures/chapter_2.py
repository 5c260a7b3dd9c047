"""Chapter 2 and sections 3.1 to 3.3: camera flow, motor signs, drag over speed."""

from __future__ import annotations

import dataclasses

from mambo_model import aerodynamics as air, palette
from mambo_model.forces import drag
from mambo_model.vehicle.motor_mixer import mix
from mambo_model.vehicle.vehicle_options import DragParams
from mambo_sim.sensors.optical_flow import image_flow, project
import numpy as np

from . import truths
from .claim import at_least, at_most, claim, Result
from .drawing import lines, sheet

SIGNS = ((1, 1, -1), (-1, 1, 1), (-1, -1, -1), (1, -1, 1))  # roll, pitch, yaw of motors 1 to 4


@claim('2.1', 'the flow of an image point follows from the velocity and angular rate of the '
       'camera',
       contains='(2.18)-(2.20) as printed', tests='whether they are the derivative of (2.17): '
       'mathematics, which does not depend on the drone')
def figure_2_1() -> Result:
    """Compare (2.18)-(2.20) with the motion of a projected point (2.17)."""
    rng, h, worst = np.random.default_rng(1), 1e-5, 0.0
    for _ in range(200):
        point, V, omega = rng.normal(size=3) + (0.0, 0.0, 5.0), *rng.normal(size=(2, 3))
        rate = -V - np.cross(omega, point)  # of a fixed point, in camera axes
        before, after = (
            project(tuple((point + t * rate).tolist()), 1.0) for t in (-h, h))
        flow = image_flow(tuple(point.tolist()), tuple(V.tolist()), tuple(omega.tolist()), 1.0)
        moved = np.subtract(after, before) / (2.0 * h)
        worst = max(worst, float(np.abs(moved - flow).max()))
    return Result([at_most(
        'difference to a projected point', worst, 1e-7, '1/s',
        'central differences of 1e-5 s: rounding 1e-11, third order 1e-9')])


@claim('3.1', 'each motor rolls, pitches and yaws the drone in the direction drawn',
       contains='the mixer (3.2)', tests='its twelve signs against the drawing')
def figure_3_1() -> Result:
    """Evaluate (3.2) for the torque of each motor alone."""
    vv = truths.vehicle().values()
    wrong = 0
    for motor, signs in enumerate(SIGNS):
        thrust = [0.0] * 4
        thrust[motor] = 1.0
        _, tau = mix(tuple(thrust), vv)
        wrong += sum(int(np.sign(t)) != s for t, s in zip(tau, signs, strict=True))
    return Result([at_most('wrong signs out of twelve', wrong, 0,
                           reason='a sign is right or wrong')])


@claim('3.2', 'the total drag of the rotors is linear in speed below w, and the drag of the frame '
       'is small there', contains='(3.4)-(3.10), with coefficients of the right size', given=True,
       tests='how their sum depends on speed', broken_by=('drag quadratic',))
def figure_3_2() -> Result:
    """Draw the components of the drag over the horizontal speed at hover thrust."""
    vehicle = truths.vehicle()
    frame = (vehicle.drag if vehicle.drag.parasitic else DragParams()).parasitic_coefficient
    vehicle = dataclasses.replace(vehicle, drag_reading='none', drag=DragParams(
        blade_flapping=True, induced=True, translational=True, profile='linear',
        parasitic=True, parasitic_coefficient=frame))
    vv, options = vehicle.values(), vehicle.options()
    p, T = options.drag, 0.25 * vehicle.mass * vehicle.gravity
    speeds = np.linspace(0.0, 1.6 * p.slow_limit, 161)
    omega, speed = (0.0, 0.0, 0.0), (T / options.rotor.speed_coefficient)**0.5
    parts: dict[str, list[float]] = {}
    for v in speeds.tolist():
        nu = (v, 0.0, 0.0)
        for name, force in (
                ('blade flapping', 4.0 * air.blade_flapping(T, nu, omega, speed, p)[0]),
                ('induced', 4.0 * air.induced_drag(T, nu, p.induced_coefficient)[0]),
                ('translational', 4.0 * air.translational_drag(T, nu, options)[0]),
                ('profile', 4.0 * air.profile_drag_linear(T, nu, p.profile_coefficient)[0]),
                ('parasitic', air.parasitic_drag(nu, p.parasitic_coefficient)[0]),
                ('sum', drag(nu, omega, (T,) * 4, (T,) * 4, vv, options)[0])):
            parts.setdefault(name, []).append(-force)
    arrays = {name: np.array(values) for name, values in parts.items()}
    below = speeds <= p.slow_limit
    rotors = arrays['sum'] - arrays['parasitic']
    line = rotors[below][-1] / speeds[below][-1] * speeds
    figure, (axes,) = sheet(1, height=3.0)
    lines(axes, {name: (speeds, force) for name, force in arrays.items()}, 'drag [N]')
    axes.axvline(p.slow_limit, color=palette.COLOURS['soft'], linestyle=':')
    axes.annotate('w', (p.slow_limit, 0.0), xytext=(4, 4), textcoords='offset points')
    axes.set_xlabel('horizontal speed [m/s]')
    axes.legend(frameon=False)
    bend = np.abs(rotors - line)[below].max() / rotors[below].max()
    beyond = 1.0 - rotors[-1] / line[-1]
    slow = speeds <= 2.0  # fastest flight of the thesis
    return Result([
        at_most('rotor drag below w, relative deviation from a straight line', bend, 1e-12,
                reason='rounding'),
        at_least('rotor drag at 1.6 w, relative shortfall from that line', beyond, 0.05,
                 reason='the width of a line in the figure'),
        at_most('share of the frame in the drag up to 2 m/s',
                (arrays['parasitic'] / np.maximum(arrays['sum'], 1e-12))[slow].max(), 0.1,
                reason='a tenth is small; the fastest flight of the thesis has 2 m/s'),
    ], figure)
