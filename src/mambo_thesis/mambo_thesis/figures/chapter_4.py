"""Chapter 4: the support package's estimator and controller, pendulum and motor map."""

from __future__ import annotations

import math

from mambo_analysis.identify.inertia import fit_swing, Geometry
from mambo_analysis.identify.thrust import fit_thrust
from mambo_model import palette
from mambo_model.vehicle import bifilar
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
import numpy as np

from . import truths
from .chapter_5 import estimate_and_truth, sensor_factor
from .claim import at_least, at_most, claim, near, Result
from .drawing import lines, over_time, sheet
from .flights import drift, first_time, lag, rms, seeds, X, Y, Z

WEIGHT = 0.068 * 9.81  # N
HOVER_COMMAND = 4.0 * (WEIGHT / 4.0 / 4.29e-5)**(1.0 / 1.47) / 1530.72681  # N, linear map


@claim('4.3', "with the support package's estimator and controller a step in x looks normal, but "
       'z does not reach its reference; the true x moves by more than 1 m', 'fig_4_3',
       contains='68 g and the power law of the motors, where the package assumes 63 g and the '
       'linear map; an estimator that takes the flow for the velocity',
       tests='the height error of a controller without an integral, and the distance flown',
       broken_by=('motor map', 'mass +10 %', 'factor -10 %'))
def figure_4_3() -> Result:
    """Step of 1 m."""
    flights = seeds('fig_4_3')
    height_error, wobble, peak, moved, heights = [], [], [], [], []
    for f in flights:
        late = f.after(12.0)
        error = (f.estimate - f.reference)[late]
        height_error.append(error[:, Z].mean())
        wobble.append(max(rms(error[:, X]), rms(error[:, Y])))
        peak.append(f.estimate[:, X].max())
        moved.append(float(f.truth[late, X].mean() - f.truth[f.t < 5.0, X][-1]))
        heights.append(-f.truth[f.after(5.0), Z].mean())
    # hover command minus the weight assumed by the package, over its gain of 0.8 N/m
    expected = (HOVER_COMMAND - 0.063 * 9.81) / 0.8
    return Result([
        near('steady height error below the reference', height_error, expected, 0.002, 'm',
             'accelerometer bias left by the calibration: 1 mm/s of climb'),
        at_most('estimated x and y minus reference, RMS', wobble, 0.02, 'm',
                'attitude error of 0.1 to 0.2 deg, over a gain of 0.24 rad/m: 1 cm'),
        near('largest estimated x after the step', peak, 1.2, 0.15, 'm',
             'a normal overshoot: 5 to 35 %'),
        at_least('true change of x', moved, 1.1, 'm', 'visibly more than 1 m'),
        near('that change, expected to be h Q(h)', moved,
             sensor_factor(float(np.mean(heights))), 0.1, 'm',
             '7 %: the drone sinks while it accelerates, and drifts'),
    ], estimate_and_truth(flights[0]))


@claim('4.4', 'x and y lag their references; the drone drifts until it hits the net, while the '
       'estimate shows no drift', 'fig_4_4',
       contains='the same, and a flow factor that the estimator ignores',
       tests='whether that alone causes the drift of the drone, and the lag of the controller',
       broken_by=('drag absent',))
def figure_4_4() -> Result:
    """Circle (4.1)."""
    flights = seeds('fig_4_4')
    away = [np.hypot(*f.truth[:, :2].T) for f in flights]
    visible = 'half a second of a turn of 6.3 s: visible in the figure'
    return Result([
        at_least('phase lag of x', [lag(f, X) for f in flights], 30.0, 'deg', visible),
        at_least('phase lag of y', [lag(f, Y) for f in flights], 30.0, 'deg', visible),
        at_most('drift of the estimate per turn',
                [float(np.hypot(*drift(f.estimate[:, :2]))) for f in flights], 0.05, 'm',
                'not visible beside an amplitude of 0.5 m'),
        at_least('drift of the drone per turn',
                 [float(np.hypot(*drift(f.truth[:, :2]))) for f in flights], 0.5, 'm',
                 'the amplitude of the path: clearly visible'),
        at_most('time until it is 2 m from its start, the net of a small hall',
                [first_time(f.t, a > 2.0) for f, a in zip(flights, away, strict=True)], 30.0, 's',
                'the experiment of the thesis ended early'),
    ], estimate_and_truth(flights[0]))


@claim('4.6', 'the model of the bifilar pendulum fits the gyro data; J is identified within 2 %',
       contains='the pendulum (4.2) with the measured J, and noise', given=True,
       tests='whether the fit (4.3) returns the simulated J', broken_by=('mass +10 %',))
def figure_4_6() -> Result:
    """Simulate a swing about each axis of the identified vehicle, add gyro noise and fit (4.2)."""
    rig = Geometry(mass=0.068, separation=0.1, length=0.5)  # the thesis gives neither D nor h
    vehicle = truths.vehicle()
    t, K_D, C, noise = np.arange(0.0, 20.0, 0.01), 2e-6, 6e-6, 0.02
    error, residual, shown = [], [], None
    for seed, (name, J) in enumerate(zip('xyz', vehicle.inertia, strict=True)):
        w = math.sqrt(vehicle.mass * rig.gravity * rig.separation**2 / (4.0 * J * rig.length))
        clean = bifilar.swing(t, 0.5, 0.0, bifilar.Swing(w, K_D / J, C / J, 0.2))
        gyro = clean + noise * np.random.default_rng(seed).standard_normal(len(t))
        found = fit_swing(t, gyro, rig)
        error.append(100.0 * abs(found.J.value / J - 1.0))
        residual.append(found.fit.rms / noise)
        if name == 'y':
            shown = {'gyro': (t, gyro), 'fit': (t, gyro - found.fit.residual[:, 0])}
    return Result([
        at_most('error of the identified J, three axes', error, 2.0, '%', 'spread of the thesis'),
        near('RMS residual over gyro noise', residual, 1.0, 0.1, '',
             '2000 samples: a standard deviation of 0.016'),
    ], over_time(shown, '$\\omega_y$ [rad/s]'))


@claim('4.8', 'a power law with a = 4.29e-5 and b = 1.47 fits thrust over command; the straight '
       'line of the package does not', contains='motors with a = 4.29e-5 and b = 1.47, '
       'and a scale with 2 % noise', given=True, tests='whether the fit returns the simulated law',
       broken_by=('motor map',))
def figure_4_8() -> Result:
    """Simulate a thrust bench: 0.1 to 1.2 N commanded, power-law motors, scale with 2 % noise."""
    vehicle, rng = truths.vehicle(), np.random.default_rng(1)
    vv = vehicle.values()
    commanded = np.repeat(np.arange(0.1, 1.25, 0.1), 5)
    pwm = 0.25 * commanded * vehicle.linear_gain
    true = np.array([thrust_from_pwm(float(x), vv) for x in pwm])
    reading = true * (1.0 + 0.02 * rng.standard_normal(len(true)))
    found = fit_thrust(pwm, reading, 350.0)
    fine = np.linspace(pwm.min(), pwm.max(), 200)
    figure, plots = sheet(1, 2, height=3.0)
    for axes, scale in zip(plots, ('linear', 'log'), strict=True):
        axes.plot(pwm, reading, '.', color=palette.COLOURS[palette.MEASURED], label='bench')
        lines(axes, {'package': (fine, fine / vehicle.linear_gain), 'power law': (
            fine, found.a.value * fine**found.b.value)}, 'thrust of a motor [N]')
        axes.set(xscale=scale, yscale=scale, xlabel='command')
    plots[0].legend(frameon=False)
    used = pwm <= 350.0
    line = np.abs(np.log(pwm[used] / vehicle.linear_gain / reading[used]))
    return Result([
        near('exponent b', found.b.value, 1.47, 0.02, '', 'its standard deviation is 0.005'),
        near('coefficient a', 1e5 * found.a.value, 4.29, 0.4, '1e-5 N',
             'correlated with b: 0.02 in b is 10 % in a'),
        at_most('power law, RMS error of the logarithm', found.power_rms, 0.03, '',
                '1.5 times the noise of the scale, 2 %'),
        at_least('straight line of the package, RMS error over that of the power law',
                 float(np.sqrt(np.mean(line**2))) / found.power_rms, 10.0, '',
                 'ten times the noise is clearly visible'),
    ], figure, 'Motors, commands and scale are simulated with the numbers of the thesis, because '
        'it does not publish its readings.')


@claim('Section 4.4.2', 'a command of 0.72 N hovers where 0.67 N should', 'hover_command',
       contains='68 g, and the power law of the motors, which was measured on a scale',
       tests='whether that law explains the hover command, which is another measurement',
       broken_by=('motor map', 'mass +10 %'))
def hover_command() -> Result:
    """Hover with both motor maps in the controller."""
    old, new = (
        [float(f.recording.thrust[f.after(12.0)].mean()) for f in seeds(f'hover_command/{name}')]
        for name in ('old_map', 'new_map'))
    two_digits = 'the thesis gives two digits'
    return Result([
        near('hover command, old map', old, 0.72, 0.005, 'N', two_digits),
        near('that command, expected from the two maps', old, HOVER_COMMAND, 0.005, 'N',
             'noise of the yaw rate changes each motor command by 14 %; the convex law then gives '
             '0.7 % more thrust'),
        near('hover command, new map', new, 0.67, 0.005, 'N', two_digits),
    ])


@claim('4.1, 4.2, 4.5, 4.7', 'photographs, a block diagram and set-ups')
def other_figures() -> Result:
    """Return a result without measurements."""
    return Result([], remark='they show no data')
