"""Chapter 4: the support package's own estimator and controller, pendulum and motor map."""

from __future__ import annotations

import math

from mambo_analysis.identify.inertia import fit_swing, Geometry
from mambo_analysis.identify.thrust import fit_thrust
from mambo_model import palette
from mambo_model.vehicle import bifilar
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
import numpy as np

from . import truths
from .chapter_5 import sensor_factor
from .claim import at_least, at_most, claim, near, Result
from .drawing import lines, positions, sheet
from .flights import drift, lag, rms, seeds, X, Y, Z

WEIGHT = 0.068 * 9.81  # N
HOVER_COMMAND = 4.0 * (WEIGHT / 4.0 / 4.29e-5)**(1.0 / 1.47) / 1530.72681  # N, linear map


@claim('4.3', "with the support package's estimator and controller a step in x looks normal, z "
       'does not reach its reference; the true x travels more than the metre', 'fig_4_3',
       contains='68 g and the power law of the motors; 63 g and the linear map are believed; '
       'an estimator that takes the flow for the velocity',
       tests='what a controller without an integral makes of it, and how far the drone goes',
       broken_by=('motor map', 'mass +10 %', 'factor -10 %'))
def figure_4_3() -> Result:
    """Step of 1 m."""
    flights = seeds('fig_4_3')
    short, wobble, peak, moved, heights = [], [], [], [], []
    for f in flights:
        late = f.after(12.0)
        off = (f.estimate - f.reference)[late]
        short.append(off[:, Z].mean())
        wobble.append(max(rms(off[:, X]), rms(off[:, Y])))
        peak.append(f.estimate[:, X].max())
        moved.append(float(f.truth[late, X].mean() - f.truth[f.t < 5.0, X][-1]))
        heights.append(-f.truth[f.after(5.0), Z].mean())
    first = flights[0]
    # command that hovers, less what the package believes to weigh, over its gain of 0.8 N/m
    expected = (HOVER_COMMAND - 0.063 * 9.81) / 0.8
    return Result([
        near('height short of the reference', short, expected, 0.002, 'm',
             'bias of the accelerometer that the calibration leaves: 1 mm/s of climb'),
        at_most('estimated x and y about the reference, RMS', wobble, 0.02, 'm',
                'attitude wrong by 0.1 to 0.2 deg, over 0.24 rad/m: 1 cm'),
        near('largest estimated x after the step', peak, 1.2, 0.15, 'm',
             'an overshoot that looks normal: 5 to 35 %'),
        at_least('true x travelled', moved, 1.1, 'm', 'more than 1 m by what a figure shows'),
        near('the same, h Q(h) expected', moved, sensor_factor(float(np.mean(heights))), 0.1, 'm',
             '7 %: it sinks while it accelerates, and wanders'),
    ], positions({'reference': (first.t, first.reference), 'IMU': (first.t, first.estimate),
                  'Optitrack': (first.t, first.truth)}))


@claim('4.4', 'x and y lag; the drone drifts away until it flies into the net, while the estimate '
       'shows no drift', 'fig_4_4',
       contains='the same, and a factor of the flow that the estimator does not know',
       tests='whether that alone drives the drone away, and how late the controller is',
       broken_by=('drag absent',))
def figure_4_4() -> Result:
    """Circle (4.1)."""
    flights = seeds('fig_4_4')
    away = [np.hypot(*f.truth[:, :2].T) for f in flights]
    first = flights[0]
    visible = 'half a second of the turn of 6.3 s: visible in the figure'
    return Result([
        at_least('lag of x', [lag(f, X) for f in flights], 30.0, 'deg', visible),
        at_least('lag of y', [lag(f, Y) for f in flights], 30.0, 'deg', visible),
        at_most('drift of the estimate a turn',
                [float(np.hypot(*drift(f.estimate[:, :2]))) for f in flights], 0.05, 'm',
                'not visible beside an amplitude of 0.5 m'),
        at_least('drift of the drone a turn',
                 [float(np.hypot(*drift(f.truth[:, :2]))) for f in flights], 0.5, 'm',
                 'the amplitude of the path: nobody can miss it'),
        at_most('2 m away from its start, the net of a small hall, after',
                [f.t[np.argmax(a > 2.0)] if (a > 2.0).any() else math.inf
                 for f, a in zip(flights, away, strict=True)], 30.0, 's',
                'the experiment of the thesis ended early'),
    ], positions({
        'reference': (first.t, first.reference), 'IMU': (first.t, first.estimate),
        'Optitrack': (first.t, first.truth)}))


@claim('4.6', 'the model of the bifilar pendulum fits the gyro; J is found within 2 %',
       contains='the pendulum (4.2) with the measured J, and noise', given=True,
       tests='whether the fit (4.3) gives back what was put in', broken_by=('mass +10 %',))
def figure_4_6() -> Result:
    """Simulate a swing about each axis of the identified vehicle, add gyro noise and fit (4.2)."""
    rig = Geometry(mass=0.068, separation=0.1, length=0.5)  # the thesis gives neither D nor h
    vehicle = truths.vehicle()
    t, K_D, C, noise = np.arange(0.0, 20.0, 0.01), 2e-6, 6e-6, 0.02
    off, left, shown = [], [], None
    for seed, (name, J) in enumerate(zip('xyz', vehicle.inertia, strict=True)):
        w = math.sqrt(vehicle.mass * rig.gravity * rig.separation**2 / (4.0 * J * rig.length))
        clean = bifilar.swing(t, 0.5, 0.0, bifilar.Swing(w, K_D / J, C / J, 0.2))
        gyro = clean + noise * np.random.default_rng(seed).standard_normal(len(t))
        found = fit_swing(t, gyro, rig)
        off.append(100.0 * abs(found.J.value / J - 1.0))
        left.append(found.fit.rms / noise)
        if name == 'y':
            shown = {'gyro': (t, gyro), 'fit': (t, gyro - found.fit.residual[:, 0])}
    figure, (axes,) = sheet(1, height=3.0)
    lines(axes, shown, '$\\omega_y$ [rad/s]')
    axes.set_xlabel('time [s]')
    axes.legend(frameon=False)
    return Result([
        at_most('J found, off by, three axes', off, 2.0, '%', 'spread of the thesis'),
        near('residual over noise of the gyro', left, 1.0, 0.1, '',
             '2000 samples: 0.016 a standard deviation'),
    ], figure)


@claim('4.8', 'a power law fits thrust over command, the straight line of the package does not; '
       'a = 4.29e-5, b = 1.47', contains='motors with a = 4.29e-5 and b = 1.47, a scale with '
       '2 % noise', given=True, tests='whether the fit gives back what was put in',
       broken_by=('motor map',))
def figure_4_8() -> Result:
    """Simulate a thrust bench: 0.1 to 1.2 N commanded, power-law motors, scale with 2 % noise."""
    vehicle, rng = truths.vehicle(), np.random.default_rng(1)
    vv = vehicle.values()
    asked = np.repeat(np.arange(0.1, 1.25, 0.1), 5)
    pwm = 0.25 * asked * vehicle.linear_gain
    true = np.array([thrust_from_pwm(float(x), vv) for x in pwm])
    read = true * (1.0 + 0.02 * rng.standard_normal(len(true)))
    found = fit_thrust(pwm, read, 350.0)
    fine = np.linspace(pwm.min(), pwm.max(), 200)
    figure, plots = sheet(1, 2, height=3.0)
    for axes, scale in zip(plots, ('linear', 'log'), strict=True):
        axes.plot(pwm, read, '.', color=palette.COLOURS[palette.MEASURED], label='bench')
        lines(axes, {'package': (fine, fine / vehicle.linear_gain), 'power law': (
            fine, found.a.value * fine**found.b.value)}, 'thrust of a motor [N]')
        axes.set(xscale=scale, yscale=scale, xlabel='command')
    plots[0].legend(frameon=False)
    used = pwm <= 350.0
    line = np.abs(np.log(pwm[used] / vehicle.linear_gain / read[used]))
    return Result([
        near('exponent b', found.b.value, 1.47, 0.02, '', 'its standard deviation is 0.005'),
        near('a', 1e5 * found.a.value, 4.29, 0.4, '1e-5 N', 'goes with b: 0.02 of it is 10 %'),
        at_most('power law off, RMS of the logarithm', found.power_rms, 0.03, '',
                'noise of the scale, 2 %, and a half'),
        at_least('line of the package off, the same over that',
                 float(np.sqrt(np.mean(line**2))) / found.power_rms, 10.0, '',
                 'ten times the noise is seen at once'),
    ], figure, 'Motors, commands and scale are simulated with the numbers of the thesis; its '
        'readings are not published.')


@claim('Section 4.4.2', 'a command of 0.72 N hovers where 0.67 N should', 'hover_command',
       contains='68 g, and the power law of the motors, which was measured on a scale',
       tests='whether that law explains the command seen in flight, another measurement',
       broken_by=('motor map', 'mass +10 %'))
def hover_command() -> Result:
    """Hover with both motor maps in the controller."""
    old, new = (
        [float(f.recording.thrust[f.after(12.0)].mean()) for f in seeds(f'hover_command/{name}')]
        for name in ('old_map', 'new_map'))
    two_digits = 'the thesis gives two digits'
    return Result([
        near('command that hovers, old map', old, 0.72, 0.005, 'N', two_digits),
        near('the same, by the two maps', old, HOVER_COMMAND, 0.005, 'N',
             'noise of the yaw rate moves each motor by 14 %; a convex law then lifts 0.7 % more'),
        near('command that hovers, new map', new, 0.67, 0.005, 'N', two_digits),
    ])


@claim('4.1, 4.2, 4.5, 4.7', 'photographs, block diagram and set-ups')
def other_figures() -> Result:
    """Return a result without measurements."""
    return Result([], why_not='they show no data')
