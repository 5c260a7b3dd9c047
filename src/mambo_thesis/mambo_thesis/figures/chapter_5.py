"""Chapter 5: the default estimator against Optitrack, and the factor of the optical flow."""

from __future__ import annotations

import math

from matplotlib.figure import Figure
import numpy as np

from . import truths
from .claim import at_least, at_most, claim, Measured, near, Result
from .drawing import lines, over_time, positions, positions_and_rms, sheet
from .flights import (
    drift, Flight, fly, harmonic, rms, running_rms, seeds, STEP, X, Y, Z)

LATE = 12.0    # s, take-off and blend are over
ALIGN_TIME = 6.0  # s, positions are made equal then, thesis sec. 5.4
CALIBRATION = 100  # samples at rest


def sensor_factor(height: float) -> float:
    """Return h Q(h) of the simulated sensor, m: the velocity over the measured flow, (C.2b)."""
    return height * (0.92 + 0.07 * min(max(height, 0.5), 2.5))


def aligned(flight: Flight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t, estimate and truth from ALIGN_TIME on, equal at that time."""
    on = flight.after(ALIGN_TIME)
    estimate, truth = flight.estimate[on], flight.truth[on]
    return flight.t[on], estimate - estimate[0] + truth[0], truth


def estimate_and_truth(flight: Flight) -> Figure:
    """Draw the reference, the estimate and the truth of a flight."""
    return positions({
        'reference': (flight.t, flight.reference), 'IMU': (flight.t, flight.estimate),
        'Optitrack': (flight.t, flight.truth)})


def against_optitrack(flight: Flight, shown: tuple[int, ...] = (0, 1, 2)) -> Figure:
    """Draw positions aligned after take-off, and the running RMS of the estimate's error."""
    t, estimate, truth = aligned(flight)
    reference = flight.reference[flight.after(ALIGN_TIME)]
    return positions_and_rms(
        {'reference': (t, reference), 'IMU': (t, estimate), 'Optitrack': (t, truth)},
        t, running_rms(estimate - truth), shown)


@claim('5.1', 'attitude, altitude, velocity and position are estimated in this order')
def figure_5_1() -> Result:
    """Return a result without measurements."""
    return Result(
        [], remark='a block diagram; `mambo_estimation.support_package` and `kalman` contain it')


@claim('5.2', 'positions of the five Optitrack markers')
def figure_5_2() -> Result:
    """Return a result without measurements."""
    return Result([], remark='a photograph; `presets/identified_markers` has assumed positions')


@claim('5.3', 'in hover the height is estimated well, x and y are not', 'fig_5_3',
       contains="the package's estimator as in its generated code, a level floor, a calibration "
       'at rest', tests='which axes it estimates well, and the size of the error in x and y',
       broken_by=('calibration',))
def figure_5_3() -> Result:
    """Hover with the default estimator."""
    flights = seeds('fig_5_3')
    late = [f.error[f.after(LATE)] for f in flights]
    height = [rms(e[:, Z]) for e in late]
    horizontal = [rms(np.hypot(e[:, X], e[:, Y])) for e in late]
    return Result([
        at_most('height error, RMS', height, 0.01, 'm', 'not visible in the figure'),
        at_least('horizontal error over height error',
                 [b / a for a, b in zip(height, horizontal, strict=True)], 3.0, '',
                 'several times as large: visible'),
        at_least('horizontal error, RMS', horizontal, 0.1, 'm', 'decimetres in the thesis'),
    ], estimate_and_truth(flights[0]),
        'The horizontal error is a few centimetres; in the thesis it is decimetres. The simulated '
        'floor is level and the calibration is good. A floor that slopes by 0.01 rad makes it '
        'decimetres.')


@claim('5.4', 'on a sine in y the height is good, but the horizontal amplitude is wrong',
       'fig_5_4', contains='flow divided by h Q(h), an estimator that takes it for the velocity',
       given=True,
       tests='that nothing else (filter, tilt, noise) changes the amplitude',
       broken_by=('factor -10 %', 'leak +1', 'leak -1'))
def figure_5_4() -> Result:
    """Sine in y with the default estimator."""
    flights = seeds('fig_5_4')
    ratio = [abs(harmonic(f.t, f.truth[:, Y]) / harmonic(f.t, f.estimate[:, Y]))
             for f in flights]
    height = float(np.mean([-f.truth[f.after(LATE), Z].mean() for f in flights]))
    return Result([
        at_most('height error, RMS',
                [rms(f.error[f.after(LATE), Z]) for f in flights], 0.01, 'm',
                'not visible in the figure'),
        at_least('true over estimated amplitude', ratio, 1.2, '', 'visible: a fifth'),
        near('that ratio, expected to be h Q(h)', ratio, sensor_factor(height), 0.03, '',
             '2 %: flow noise, tilt, and a height that varies by 2 cm'),
    ], estimate_and_truth(flights[0]))


@claim('5.5', 'the integrated accelerometer drifts in velocity; its double integral does not '
       'explain the position error', 'fig_5_5',
       contains='an accelerometer with noise and a bias that is calibrated by 0.5 s at rest',
       given=True, tests='that this calibration explains the velocity drift, but not the '
       'position error', broken_by=('calibration',))
def figure_5_5() -> Result:
    """Integrate the raw accelerometer."""
    noise_free = (('sim_node.simulator.imu.accel_noise', (0.0, 0.0, 0.0)),)
    flights = seeds('fig_5_5')
    slopes, quiet = (np.array([[
        np.polyfit(f.t, _velocity(f, axis), 1)[0] for axis in (X, Y)] for f in made])
        for made in (flights, [fly('fig_5_5', seed, noise_free) for seed in truths.seeds()]))
    noise = flights[0].scenario.sim_node.simulator.imu.accel_noise
    left = rms(np.array(noise[:2])) / math.sqrt(CALIBRATION)
    correlations = []
    for f in flights:
        late = f.after(LATE)
        correlations.append(abs(float(
            np.corrcoef(_detrended_position(f)[late], f.error[late, Y])[0, 1])))
    first = flights[0]
    figure, plots = sheet(3)
    lines(plots[0], {'accelerometer': (first.t, first.recording.imu[:, 4])}, '$y$ [m/s$^2$]')
    lines(plots[1], {'its integral': (first.t, _velocity(first, Y))}, '$y$ [m/s]')
    lines(plots[2], {
        'its second integral, without drift': (first.t, _detrended_position(first)),
        'IMU': (first.t, first.estimate[:, Y]), 'Optitrack': (first.t, first.truth[:, Y])},
        '$y$ [m]')
    plots[2].set_xlabel('time [s]')
    plots[2].legend(frameon=False)
    return Result([
        near('drift of the integrated velocity, x and y, RMS over the seeds, over that expected '
             'from the noise of the calibration', rms(slopes) / left, 1.0, 0.7, '',
             'ten values: a standard deviation of 0.22; the walk of the bias adds 0.25'),
        at_most('that drift without noise over that with noise', rms(quiet) / rms(slopes), 0.7, '',
                'the walk of the bias alone gives half'),
        at_most('correlation of double integral and position error, mean over the seeds',
                float(np.mean(correlations)), 0.3, '', 'explains a tenth of the variance at most'),
    ], figure)


def _velocity(flight: Flight, axis: int) -> np.ndarray:
    """Return the integral of the accelerometer, calibrated by its first half second, m/s."""
    a = flight.recording.imu[:, 3 + axis]
    return np.cumsum(a - a[:CALIBRATION].mean()) * STEP


def _detrended_position(flight: Flight) -> np.ndarray:
    """Return the integral of that velocity in y, its constant drift taken out, m."""
    velocity = _velocity(flight, Y)
    return np.cumsum(velocity - np.polyval(np.polyfit(flight.t, velocity, 1), flight.t)) * STEP


@claim('5.6', 'the estimate follows the integrated flow except during the ascent', 'fig_5_6',
       contains='flow above 0.4 m, and the integrated accelerometer below',
       tests='whether only the ascent causes a difference')
def figure_5_6() -> Result:
    """Compare estimate and integrated flow, with the accelerometer calibrated well and badly."""
    flights = {name: seeds(f'fig_5_6/{name}') for name in ('well_calibrated', 'badly_calibrated')}

    def gaps(f: Flight) -> tuple[float, float]:
        """Return the mean distance over the turn after 6 s, and its change in the next turn."""
        difference = f.estimate[:, :2] - f.integrated_flow()
        turn, begin = round(2.0 * math.pi / STEP), round(ALIGN_TIME / STEP)
        first, second = (difference[k:k + turn].mean(axis=0) for k in (begin, begin + turn))
        return float(np.hypot(*first)), float(np.hypot(*(second - first)))
    bad = [gaps(f) for f in flights['badly_calibrated']]
    first = flights['badly_calibrated'][0]
    flow = np.insert(first.integrated_flow(), 2, np.nan, axis=1)  # flow has no height
    visible = 'visible beside an amplitude of 1 m'
    return Result([
        at_least('distance after the ascent, badly calibrated', [a for a, _ in bad], 0.02, 'm',
                 visible),
        at_most('change in a later turn over that distance, mean over the seeds',
                sum(b for _, b in bad) / sum(a for a, _ in bad), 0.5, '',
                'less than half: the ascent causes most of it'),
        at_least('distance after the ascent, well calibrated',
                 [gaps(f)[0] for f in flights['well_calibrated']], 0.02, 'm', visible),
    ], positions({
        'reference': (first.t, first.reference), 'IMU': (first.t, first.estimate),
        'Optitrack': (first.t, first.truth), 'optical flow': (first.t, flow)}, (X, Y)),
        'With a level floor and a good calibration the ascent adds no error. An accelerometer '
        'bias that changes between calibration and take-off does.')


def _y_since_alignment(flight: Flight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return estimated, flow-integrated and true y relative to their values at ALIGN_TIME."""
    on = flight.after(ALIGN_TIME)
    return tuple(y[on] - y[on][0] for y in (
        flight.estimate[:, Y], flight.integrated_flow()[:, Y], flight.truth[:, Y]))


def best_factor(measured: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Fit true = factor * measured + offset; return the factor and the RMS residual."""
    regressors = np.stack([measured, np.ones_like(measured)], axis=1)
    solution = np.linalg.lstsq(regressors, true, rcond=None)[0]
    return float(solution[0]), rms(true - regressors @ solution)


@claim('5.7', 'aligned at 6 s, estimate and integrated flow agree; the truth differs from them by '
       'a factor', 'fig_5_7', contains='flow divided by h Q(h)', given=True,
       tests='that the estimate follows the flow alone, and that one factor is enough',
       broken_by=('factor -10 %', 'leak +1', 'leak -1'))
def figure_5_7() -> Result:
    """Compare estimate, integrated flow and truth from 6 s on."""
    flights = seeds('fig_5_7')
    difference, factors, remaining = [], [], []
    for f in flights:
        estimate, flow, true = _y_since_alignment(f)
        difference.append(rms(estimate - flow))
        factor, residual = best_factor(estimate, true)
        factors.append(factor)
        remaining.append(residual / rms(true - estimate))
    first = flights[0]
    height = -first.truth[first.after(ALIGN_TIME), Z].mean()
    on, (estimate, flow, true) = first.after(ALIGN_TIME), _y_since_alignment(first)
    figure = over_time({
        'IMU': (first.t[on], estimate), 'optical flow': (first.t[on], flow),
        'Optitrack': (first.t[on], true)}, '$y$ [m]')
    return Result([
        at_most('estimate minus integrated flow, RMS', difference, 0.03, 'm',
                'the filter lags by 40 ms at 0.7 m/s: 2 cm'),
        near('factor from estimate to truth, expected to be h Q(h)', factors,
             sensor_factor(height), 0.05, '',
             '4 %: the drift caused by noise, which is fitted with the sine'),
        at_most('share of the error that remains with that factor', remaining, 0.3, '',
                'the drift caused by noise: 5 cm of 0.2 m'),
    ], figure)


def _flow_sine(name: str, height: float) -> Result:
    """Compare the truth with the integrated flow times the best constant."""
    flights, factors, residuals = seeds(name), [], []
    for f in flights:
        _, flow, true = _y_since_alignment(f)
        factor, residual = best_factor(flow, true)
        factors.append(factor)
        residuals.append(residual)
    first = flights[0]
    on, (_, flow, true) = first.after(ALIGN_TIME), _y_since_alignment(first)
    figure = over_time({
        'optical flow': (first.t[on], flow),
        'times a constant': (first.t[on], flow * factors[0]),
        'Optitrack': (first.t[on], true)}, '$y$ [m]')
    return Result([
        near('best constant, expected to be h Q(h)', factors, sensor_factor(height), 0.05, 'm',
             '2 to 3 %: the drift caused by noise, which is fitted with the sine'),
        near('that constant over the height, Q', [x / height for x in factors], 1.06, 0.06, '',
             'mean of the two heights, whose factors differ by as much'),
        at_most('residual, RMS', residuals, 0.05, 'm', 'the drift caused by noise: 1 cm per turn'),
    ], figure)


@claim('5.8', 'the integrated flow times a constant (h Q = 1.59 at 1.5 m) matches the truth',
       'fig_5_8', contains='flow divided by h Q(h), Q = 0.92 + 0.07 h', given=True,
       tests='that one constant is enough in flight, and its value',
       broken_by=('factor -10 %', 'leak +1', 'leak -1'))
def figure_5_8() -> Result:
    """Sine in y at 1.5 m."""
    return _flow_sine('fig_5_8', 1.5)


@claim('5.9', 'at 2.5 m the constant must be larger (h Q = 2.65)', 'fig_5_9',
       contains='flow divided by h Q(h), Q = 0.92 + 0.07 h', given=True,
       tests='that one constant is enough in flight, and its value',
       broken_by=('factor -10 %', 'leak +1', 'leak -1'))
def figure_5_9() -> Result:
    """Sine in y at 2.5 m."""
    return _flow_sine('fig_5_9', 2.5)


def drifts(flights: list[Flight], axis: int) -> list[float]:
    """Return the drift of the estimate's error per turn on one axis, m, with its sign."""
    return [float(drift(f.error)[axis]) for f in flights]


# One rule for every figure: an axis drifts if its error changes by more than this per turn, with
# the expected sign, and it does not drift if the error changes by less. Flow noise of 0.015 rad/s
# at 32 Hz and 1.5 m makes the position walk by 1 cm (standard deviation) in a turn of 6.3 s, and
# by 0.5 cm per turn on average over four turns. The limit is four times that.
DRIFT = 0.02  # m per turn
NOISE = 'four standard deviations of the drift caused by noise, over four turns'


def still(what: str, flights: list[Flight], axis: int) -> Measured:
    """Return the drift on an axis that must not drift."""
    return near(f'{what}drift in {"xyz"[axis]} per turn', drifts(flights, axis), 0.0, DRIFT, 'm',
                NOISE)


def moving(what: str, flights: list[Flight], axis: int) -> list[Measured]:
    """Return the drift on an axis that must drift: its sign, and its size along the path."""
    found = drifts(flights, axis)
    return [
        at_least(f'{what}drift in {"xyz"[axis]} per turn', found, DRIFT, 'm', NOISE),
        near(f'{what}that drift minus the one predicted from Q(h)', [
            a - predicted(f, axis) for a, f in zip(found, flights, strict=True)], 0.0, DRIFT, 'm',
            NOISE)]


def error_predicted(flight: Flight, axis: int) -> np.ndarray:
    """Return the integral of (Q0/Q(h) - 1) dx along the path flown, (n,) m."""
    x, height = flight.truth[:, axis], -flight.truth[:, Z]
    return np.cumsum(np.insert(
        (1.06 / (0.92 + 0.07 * height[1:]) - 1.0) * np.diff(x), 0, 0.0))


def predicted(flight: Flight, axis: int) -> float:
    """Return the drift of :func:`error_predicted` per turn, m."""
    return float(drift(error_predicted(flight, axis)))


CONTAINS = 'flow divided by h Q(h), Q = 0.92 + 0.07 h from Figure C.3; the estimator uses 1.06'
SLOPES = ('slope 0', 'slope reversed', 'slope x 2')
LEAKS = ('leak +1', 'leak -1')


@claim('5.10', 'on a level circle the estimate with Q = 1.06 is adequate: its RMS error is small',
       'fig_5_10', contains=CONTAINS,
       tests='that an average factor is enough at one height, with tilt and noise',
       broken_by=('factor -10 %', 'leak +1'))
def figure_5_10() -> Result:
    """Circle (5.3)."""
    flights = seeds('fig_5_10')
    errors = []
    for f in flights:
        _, estimate, truth = aligned(f)
        errors.append(max(rms((estimate - truth)[:, i]) for i in range(3)))
    return Result([
        at_most('largest RMS error of an axis', errors, 0.05, 'm',
                '1.06 is 3.4 % above Q(1.5 m): 2.5 cm, and as much from noise'),
        still('', flights, X), still('', flights, Y),
    ], against_optitrack(flights[0]))


@claim('5.11', 'on a circle that rises and falls y drifts, x and z do not; with x and y exchanged '
       'x drifts', 'fig_5_11', contains=CONTAINS,
       tests='whether that slope causes a drift, on which axis, and its sign and size',
       broken_by=(*SLOPES, *LEAKS))
def figure_5_11() -> Result:
    """Circle (5.4), as printed and with x and y exchanged."""
    flights, other = seeds('fig_5_11/printed'), seeds('fig_5_11/x_and_y_exchanged')
    growth = []
    for f in flights:
        _, estimate, truth = aligned(f)
        running = running_rms(estimate - truth)[:, Y]
        growth.append(float(running[-1] / running[len(running) // 2]))
    small = [predicted(f, X) for f in flights]
    return Result([
        *moving('', flights, Y), still('', flights, X), still('', flights, Z),
        at_least('growth factor of the RMS in y over the second half', growth, 1.3, '',
                 'a steady drift doubles the RMS; noise multiplies it by 1.4 at most'),
        *moving('x and y exchanged: ', other, X), still('x and y exchanged: ', other, Y),
    ], against_optitrack(flights[0]),
        f'x drifts too, by {min(small):.3f} to {max(small):.3f} m per turn as predicted from Q(h) '
        'along the path flown: the vehicle lags, more in height than in x, so the line in x and '
        'height becomes a narrow loop. The thesis reports no drift in x.')


@claim('5.12', 'on an inclined straight line nothing drifts', 'fig_5_12', contains=CONTAINS,
       tests='that a line in x and height, flown with lag and noise, does not drift',
       broken_by=('slope x 2', 'leak -1'))
def figure_5_12() -> Result:
    """Straight line (5.5)."""
    flights = seeds('fig_5_12')
    return Result([still('', flights, X)], against_optitrack(flights[0], (X, Z)))


@claim('5.13', 'on a vertical circle x drifts, as y does in Figure 5.11', 'fig_5_13',
       contains=CONTAINS,
       tests='whether half the radius gives a quarter of the drift, with the same sign',
       broken_by=(*SLOPES, *LEAKS))
def figure_5_13() -> Result:
    """Vertical circle (5.6): half the radius of Figure 5.11, so a quarter of the drift."""
    flights = seeds('fig_5_13')
    return Result(moving('', flights, X), against_optitrack(flights[0], (X, Z)))
