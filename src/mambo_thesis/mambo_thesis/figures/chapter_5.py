"""Chapter 5: the default estimator against Optitrack, and the factor of the optical flow."""

from __future__ import annotations

import math

import numpy as np

from .claim import at_least, at_most, claim, near, Result
from .drawing import lines, positions, positions_and_rms, sheet
from .flights import (
    drift, Flight, harmonic, rms, running_rms, seeds, STEP, X, Y, Z)

LATE = 12.0    # s, take-off and blend are over
EQUAL = 6.0    # s, positions are made equal, thesis sec. 5.4


def sensor_factor(height: float) -> float:
    """Return h Q(h) of the simulated sensor in m, (C.2b) with C5: what the flow must be times."""
    return height * (0.92 + 0.07 * min(max(height, 0.5), 2.5))


def equalised(flight: Flight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return t, estimate and truth, from EQUAL on, the estimate moved to the truth then."""
    on = flight.after(EQUAL)
    estimate, truth = flight.estimate[on], flight.truth[on]
    return flight.t[on], estimate - estimate[0] + truth[0], truth


def against_optitrack(flight: Flight, shown: tuple[int, ...] = (0, 1, 2)):
    """Draw positions equalised after take-off, and the running RMS of the estimate's error."""
    t, estimate, truth = equalised(flight)
    reference = flight.reference[flight.after(EQUAL)]
    return positions_and_rms(
        {'reference': (t, reference), 'IMU': (t, estimate), 'Optitrack': (t, truth)},
        t, running_rms(estimate - truth), shown)


@claim('5.1', 'attitude, altitude, velocity and position are estimated one after the other')
def figure_5_1() -> Result:
    """Nothing to measure."""
    return Result(
        [], why_not='a block diagram; `mambo_estimation.support_package` and `kalman` have it')


@claim('5.2', 'where the five Optitrack markers are')
def figure_5_2() -> Result:
    """Nothing to measure."""
    return Result([], why_not='a photograph; positions assumed in `vehicles/identified_markers`')


@claim('5.3', 'hovering, the height is estimated well, x and y are not', 'fig_5_3')
def figure_5_3() -> Result:
    """Hover with the default estimator."""
    flights = seeds('fig_5_3')
    late = [f.error[f.after(LATE)] for f in flights]
    height = [rms(e[:, Z]) for e in late]
    horizontal = [rms(np.hypot(e[:, X], e[:, Y])) for e in late]
    first = flights[0]
    return Result([
        at_most('error of the height, RMS', height, 0.01, 'm'),
        at_least('horizontal error over that of the height',
                 [b / a for a, b in zip(height, horizontal, strict=True)], 3.0),
    ], positions({
        'reference': (first.t, first.reference), 'IMU': (first.t, first.estimate),
        'Optitrack': (first.t, first.truth)}),
        'The horizontal error is centimetres, in the thesis decimetres: the simulated floor is '
        'level and the calibration good.')


@claim('5.4', 'on a sine in y the height is good, the horizontal amplitude wrong', 'fig_5_4')
def figure_5_4() -> Result:
    """Sine in y with the default estimator."""
    flights = seeds('fig_5_4')
    ratio = [abs(harmonic(f.t, f.truth[:, Y]) / harmonic(f.t, f.estimate[:, Y]))
             for f in flights]
    height = float(np.mean([-f.truth[f.after(LATE), Z].mean() for f in flights]))
    first = flights[0]
    return Result([
        at_most('error of the height, RMS',
                [rms(f.error[f.after(LATE), Z]) for f in flights], 0.01, 'm'),
        at_least('true over estimated amplitude', ratio, 1.2),
        near('the same, h Q(h) being expected', ratio, sensor_factor(height), 0.03),
    ], positions({
        'reference': (first.t, first.reference), 'IMU': (first.t, first.estimate),
        'Optitrack': (first.t, first.truth)}))


@claim('5.5', 'the integrated accelerometer drifts in velocity; its double integral does not '
       'explain the error of the position', 'fig_5_5')
def figure_5_5() -> Result:
    """Integrate the raw accelerometer."""
    flights, slopes, correlations = seeds('fig_5_5'), [], []
    for f in flights:
        velocity = _velocity(f)
        trend = np.polyfit(f.t, velocity, 1)
        slopes.append(abs(float(trend[0])))
        position = np.cumsum(velocity - np.polyval(trend, f.t)) * STEP
        late = f.after(LATE)
        correlations.append(abs(float(np.corrcoef(position[late], f.error[late, Y])[0, 1])))
    first = flights[0]
    velocity = _velocity(first)
    figure, plots = sheet(3)
    lines(plots[0], {'accelerometer': (first.t, first.recording.imu[:, 4])}, '$y$ [m/s$^2$]')
    lines(plots[1], {'its integral': (first.t, velocity)}, '$y$ [m/s]')
    lines(plots[2], {
        'its second integral': (first.t, np.cumsum(velocity) * STEP),
        'IMU': (first.t, first.estimate[:, Y]), 'Optitrack': (first.t, first.truth[:, Y])},
        '$y$ [m]')
    plots[2].set_xlabel('time [s]')
    plots[2].legend(frameon=False)
    return Result([
        # calibrated by 0.5 s of noise of 0.0153 m/s^2: 1.5 mm/s^2 a standard deviation
        at_least('drift of the integrated velocity, the largest of the seeds', max(slopes), 1e-3,
                 'm/s^2'),
        at_most('correlation of double integral and error, mean over the seeds',
                float(np.mean(correlations)), 0.3),
    ], figure)


def _velocity(flight: Flight) -> np.ndarray:
    """Return the integral of the accelerometer's y, calibrated by its first half second."""
    y = flight.recording.imu[:, 4]
    return np.cumsum(y - y[:100].mean()) * STEP


@claim('5.6', 'with the integrated flow beside it, the estimate follows the flow except while it '
       'ascends', 'fig_5_6')
def figure_5_6() -> Result:
    """Look at the integrated flow from the start, accelerometer calibrated well and badly."""
    flights = {name: seeds(f'fig_5_6/{name}') for name in ('well_calibrated', 'badly_calibrated')}

    def gaps(f: Flight) -> tuple[float, float]:
        """Return how far apart they are after 6 s, and what the next turn adds to it."""
        apart = f.estimate[:, :2] - f.integrated_flow()
        turn, begin = round(2.0 * math.pi / STEP), round(EQUAL / STEP)
        first, second = (apart[k:k + turn].mean(axis=0) for k in (begin, begin + turn))
        return float(np.hypot(*first)), float(np.hypot(*(second - first)))
    bad = [gaps(f) for f in flights['badly_calibrated']]
    first = flights['badly_calibrated'][0]
    flow = np.insert(first.integrated_flow(), 2, np.nan, axis=1)  # measures no height
    return Result([
        at_least('apart after the ascent, badly calibrated', [a for a, _ in bad], 0.02, 'm'),
        at_most('what a later turn adds, over that, mean of the seeds',
                sum(b for _, b in bad) / sum(a for a, _ in bad), 0.5),
        at_least('apart after the ascent, well calibrated',
                 [gaps(f)[0] for f in flights['well_calibrated']], 0.02, 'm'),
    ], positions({
        'reference': (first.t, first.reference), 'IMU': (first.t, first.estimate),
        'Optitrack': (first.t, first.truth), 'optical flow': (first.t, flow)}, (X, Y)),
        'With a level floor and a good calibration the ascent leaves nothing; a bias that walks '
        'between calibration and take-off does it.')


def _since(flight: Flight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return estimated, flow-integrated and true y since EQUAL, zero then."""
    on = flight.after(EQUAL)
    return tuple(y[on] - y[on][0] for y in (
        flight.estimate[:, Y], flight.integrated_flow()[:, Y], flight.truth[:, Y]))


def _best_factor(seen: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Return the factor that makes one curve the other, an offset aside, and what is left, RMS."""
    parts = np.stack([seen, np.ones_like(seen)], axis=1)
    solution = np.linalg.lstsq(parts, true, rcond=None)[0]
    return float(solution[0]), rms(true - parts @ solution)


@claim('5.7', 'made equal at 6 s, estimate and integrated flow are the same; the truth differs by '
       'a factor', 'fig_5_7')
def figure_5_7() -> Result:
    """Estimate, integrated flow and truth since 6 s."""
    flights = seeds('fig_5_7')
    apart, factors, left = [], [], []
    for f in flights:
        estimate, flow, true = _since(f)
        apart.append(rms(estimate - flow))
        factor, rest = _best_factor(estimate, true)
        factors.append(factor)
        left.append(rest / rms(true - estimate))
    first = flights[0]
    height = -first.truth[first.after(EQUAL), Z].mean()
    on, (estimate, flow, true) = first.after(EQUAL), _since(first)
    figure, (axes,) = sheet(1, height=3.0)
    lines(axes, {'IMU': (first.t[on], estimate), 'optical flow': (first.t[on], flow),
                 'Optitrack': (first.t[on], true)}, '$y$ [m]')
    axes.set_xlabel('time [s]')
    axes.legend(frameon=False)
    return Result([
        at_most('estimate and integrated flow apart, RMS', apart, 0.03, 'm'),
        near('factor between estimate and truth, h Q(h) expected', factors,
             sensor_factor(height), 0.05),
        at_most('error that is left with it', left, 0.3),
    ], figure)


def _flow_sine(name: str, height: float) -> Result:
    """Compare the integrated flow, times the best constant, with the truth."""
    flights, factors, left = seeds(name), [], []
    for f in flights:
        _, flow, true = _since(f)
        factor, rest = _best_factor(flow, true)
        factors.append(factor)
        left.append(rest)
    first = flights[0]
    on, (_, flow, true) = first.after(EQUAL), _since(first)
    figure, (axes,) = sheet(1, height=3.0)
    scaled = flow * factors[0]
    lines(axes, {
        'optical flow': (first.t[on], flow), 'times a constant': (first.t[on], scaled),
        'Optitrack': (first.t[on], true)}, '$y$ [m]')
    axes.set_xlabel('time [s]')
    axes.legend(frameon=False)
    return Result([
        near('best constant, h Q(h) expected', factors, sensor_factor(height), 0.05, 'm'),
        near('the same over the height, Q', [x / height for x in factors], 1.06, 0.06),
        at_most('error that is left, RMS', left, 0.05, 'm'),
    ], figure)


@claim('5.8', 'times a constant (h Q = 1.59 at 1.5 m) the integrated flow is the truth', 'fig_5_8')
def figure_5_8() -> Result:
    """Sine in y at 1.5 m."""
    return _flow_sine('fig_5_8', 1.5)


@claim('5.9', 'at 2.5 m a larger constant is needed (h Q = 2.65)', 'fig_5_9')
def figure_5_9() -> Result:
    """Sine in y at 2.5 m."""
    return _flow_sine('fig_5_9', 2.5)


def _drifts(flights: list[Flight], axis: int) -> list[float]:
    """Return how far the estimate's error moves a turn on one axis, m, without its sign."""
    return [abs(float(drift(f.error)[axis])) for f in flights]


# Noise of the flow, 0.015 rad/s at 32 Hz and 1.5 m, walks 1 cm in a turn of 6.3 s; four turns on
# average, 0.5 cm a standard deviation.
NO_DRIFT = 0.02  # m a turn
# The filter of the velocity is some 15 ms later than that of the height, which drifts in phase
# with the height by as much as a range that lags: a tenth of the 0.24 m a turn of 0.1 s.
SMALL = 1.0 / 3.0


def _ratios(flights: list[Flight], less: int, more: int) -> list[float]:
    """Return the drift on one axis over that on another."""
    pairs = zip(_drifts(flights, less), _drifts(flights, more), strict=True)
    return [a / b for a, b in pairs]


@claim('5.10', 'on a level circle the estimate with Q = 1.06 is adequate, its RMS small',
       'fig_5_10')
def figure_5_10() -> Result:
    """Circle (5.3)."""
    flights = seeds('fig_5_10')
    errors = []
    for f in flights:
        _, estimate, truth = equalised(f)
        errors.append(max(rms((estimate - truth)[:, i]) for i in range(3)))
    return Result([
        at_most('largest RMS of an axis', errors, 0.1, 'm'),
        at_most('drift in x a turn', _drifts(flights, X), NO_DRIFT, 'm'),
        at_most('drift in y a turn', _drifts(flights, Y), NO_DRIFT, 'm'),
    ], against_optitrack(flights[0]))


@claim('5.11', 'on a circle that rises and falls y drifts, x and z do not; exchanged, x drifts',
       'fig_5_11')
def figure_5_11() -> Result:
    """Circle (5.4), and with x and y exchanged."""
    flights, other = seeds('fig_5_11/printed'), seeds('fig_5_11/x_and_y_exchanged')
    growth = []
    for f in flights:
        _, estimate, truth = equalised(f)
        running = running_rms(estimate - truth)[:, Y]
        growth.append(float(running[-1] / running[len(running) // 2]))
    return Result([
        at_least('drift in y a turn', _drifts(flights, Y), 0.1, 'm'),
        at_most('drift in x over drift in y', _ratios(flights, X, Y), SMALL),
        at_most('drift in z a turn', _drifts(flights, Z), NO_DRIFT, 'm'),
        at_least('growth of the RMS in y over the second half', growth, 1.3),
        at_least('x and y exchanged: drift in x a turn', _drifts(other, X), 0.1, 'm'),
        at_most('x and y exchanged: drift in y over drift in x', _ratios(other, Y, X), SMALL),
    ], against_optitrack(flights[0]))


@claim('5.12', 'on an inclined straight line nothing drifts', 'fig_5_12')
def figure_5_12() -> Result:
    """Straight line (5.5)."""
    flights = seeds('fig_5_12')
    return Result(
        [at_most('drift in x a turn', _drifts(flights, X), NO_DRIFT, 'm')],
        against_optitrack(flights[0], (X, Z)))


@claim('5.13', 'on a vertical circle x drifts as in Figure 5.11', 'fig_5_13')
def figure_5_13() -> Result:
    """Vertical circle (5.6): half the axes, a quarter of the drift."""
    flights = seeds('fig_5_13')
    moved = [float(drift(f.error)[X]) for f in flights]
    return Result([
        at_least('drift in x a turn', [abs(m) for m in moved], NO_DRIFT, 'm'),
        # pi A B Q'/Q of the circle flown, with Q = 1.06 of the estimator over Q(h)^2
        near("the same, pi A B Q0 Q'/Q^2 expected", moved,
             float(np.mean([_predicted(f) for f in flights])), 0.02, 'm'),
    ], against_optitrack(flights[0], (X, Z)))


def _predicted(flight: Flight) -> float:
    """Return the closed integral of (Q0/Q(h) - 1) dx over the path flown, in m a turn."""
    x, height = flight.truth[:, X], -flight.truth[:, Z]
    error = np.cumsum(np.insert(
        (1.06 / (0.92 + 0.07 * height[1:]) - 1.0) * np.diff(x), 0, 0.0))
    return float(drift(error))
