"""Section 3.4: the simulated closed loop (Figure 3.3)."""

from __future__ import annotations

from mambo_model import palette
from mambo_model.motion.quaternion import angle, conjugate, multiply
import numpy as np

from .claim import at_most, claim, near, Result
from .drawing import lines, POSITION, sheet
from .flights import fly, settling_time


@claim('3.3', 'starting from rest the drone tracks (3.31) after about 6 s', 'fig_3_3',
       contains='the model (3.1) and the controller (3.15)-(3.30), corrected',
       tests='whether they converge as fast as in the thesis and in an independent implementation',
       broken_by=('mass +10 %', 'motors late', 'inertia x 2'))
def figure_3_3() -> Result:
    """Fly (3.31) with perfect state and without drag."""
    flight = fly('fig_3_3')
    r, t = flight.recording, flight.t
    distance = np.linalg.norm(flight.reference - flight.truth, axis=1)
    attitude = np.array([
        angle(multiply(conjugate(tuple(a)), tuple(b)))
        for a, b in zip(r.reference[:, 6:10].tolist(), r.truth[:, 6:10].tolist(), strict=True)])
    velocity = np.linalg.norm(r.reference[:, 3:6] - r.truth[:, 3:6], axis=1)
    figure, plots = sheet(3, 2)
    for i in range(3):
        lines(plots[2 * i], {
            'reference': (t, flight.reference[:, i]), 'simulation': (t, flight.truth[:, i])},
            POSITION[i])
    for axes, values, label in zip(
            plots[1::2], (distance, velocity, attitude),
            (r'$|\rho_e|$ [m]', r'$|\nu_e|$ [m/s]', 'angle to $q_r$ [rad]'), strict=True):
        axes.plot(t, values, color=palette.INK, linewidth=1.2)
        axes.set_ylabel(label)
    for axes in plots[-2:]:
        axes.set_xlabel('time [s]')
    plots[0].legend(frameon=False)
    return Result([
        near('time from which the error stays below 5 cm', settling_time(t, distance < 0.05),
             5.82, 0.05, 's', 'audit; ten steps of 5 ms'),
        near('error at 6 s', 1000.0 * distance[t >= 6.0][0], 39.0, 1.0, 'mm',
             'audit, which has no hold of 5 ms: 1.3 mm'),
        at_most('largest error after 15 s', 1000.0 * distance[t >= 15.0].max(), 5.0, 'mm',
                'not visible in the figure'),
        near('largest motor command, linear map', r.pwm.max(), 334.8, 0.5, 'PWM',
             'audit, four digits'),
    ], figure)
