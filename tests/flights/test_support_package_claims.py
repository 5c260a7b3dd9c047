"""
What the thesis complains of in the support package's estimator and controller, flown again.

Figures 4.3, 4.4 and 5.3 to 5.7, with sensor noise. The true vehicle is the identified one,
reference and controller believe the package's 63 g and linear motor map, as in the first flights.
Chapter 4 flies the package's controller, chapter 5 the cascaded one. The thesis gives no numbers
for these figures: the numbers here are predicted by hand, from the flow's factor h Q(h) above all.
"""

from functools import cache
import math

from mambo_flight.scenario import scenario
from mambo_thesis.figures.flights import drift, Flight, harmonic, lag, rms, STEP, X, Y, Z
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.long

SEEDS = (1, 2, 3)
LATE = 12.0  # s


@cache
def flown(trajectory, seed, estimator='toolbox', controller='toolbox', believed='toolbox',
          overrides=()):
    return Flight(scenario(
        trajectory, estimator, controller, 40.0, seed, believed=believed, land=False,
        overrides=dict(overrides)))


def factor(height):
    """Return h Q(h) of the default flow sensor, m."""
    return height * (0.92 + 0.07 * height)


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_4_3_the_reference_height_is_not_reached_and_x_and_y_look_normal(seed):
    flight = flown('step', seed)
    off = (flight.estimate - flight.reference)[flight.after(LATE)]
    # command for hover 4 * 276.66 / 1530.73 = 0.7229 N; believed 0.063 * 9.81 N; gain 0.8 N/m.
    # 2 mm: the bias of the accelerometer left by the calibration moves the climb by 1 mm/s
    assert off[:, Z].mean() == pytest.approx((0.7229 - 0.6180) / 0.8, abs=0.002)
    assert rms(flight.error[flight.after(LATE), Z]) < 0.005  # it is there indeed, not an estimate
    # by the estimate, that is; the attitude is wrong by 0.1 to 0.2 degrees, over 0.24 rad/m 1 cm
    assert max(map(rms, off[:, :2].T)) < 0.02
    x = flight.estimate[:, X]
    assert 1.0 < x.max() < 1.35 and abs(x[flight.t < 5.0]).max() < 0.02


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_4_3_the_vehicle_travels_more_than_the_metre_asked_for(seed):
    flight = flown('step', seed)
    moved = flight.truth[flight.after(LATE), X].mean() - flight.truth[flight.t < 5.0, X][-1]
    assert moved > 1.25
    # the estimate's metre times h Q at 1.37 m; 7 %: it sinks while it accelerates, and wanders
    assert moved == pytest.approx(factor(1.37), rel=0.07)


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_4_4_x_and_y_lag(seed):
    flight = flown('default_circle', seed)
    cascaded = flown('default_circle', seed, controller='cascaded')
    for axis in (X, Y):
        assert lag(flight, axis) > 40.0
        assert lag(flight, axis) > lag(cascaded, axis) + 20.0  # who lags by the wrong flow too
    # height: 0.8 / (0.8 - 0.068 + 0.3 i) is 22 degrees late; linear map, filter
    assert lag(flight, Z) == pytest.approx(22.3, abs=3.0)


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_4_4_the_vehicle_drifts_away_and_the_estimate_does_not(seed):
    flight = flown('default_circle', seed)
    assert np.abs(drift(flight.estimate[:, :2])).max() < 0.02
    drifts = drift(flight.truth[:, :2])
    assert np.hypot(*drifts) > 1.0
    # The flow multiplied by h Q(h) at last, rotated with the estimated attitude. It is 50 ms late
    # (40 ms the filter, the rest the hold): 0.05 rad of 1.1 m.
    rows = flight.recording.estimate
    nu = rows[:, 3:6].copy()
    nu[:, :2] *= factor(-flight.truth[:, Z])[:, None]
    v = Rotation.from_quat(np.roll(rows[:, 6:10], -1, axis=1)).apply(nu)
    assert drifts == pytest.approx(drift(np.cumsum(v, axis=0) * STEP)[:2], abs=0.06)
    # into the net of a hall of 4 m within 20 s
    away = np.hypot(*flight.truth[:, :2].T)
    assert flight.t[np.argmax(away > 2.0)] < 20.0
    assert np.hypot(*flight.estimate[:, :2].T).max() < 1.0


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_5_3_hovering_the_height_is_good_and_x_and_y_are_not(seed):
    flight = flown('hover', seed, controller='cascaded')
    assert rms(flight.error[flight.after(LATE), Z]) < 0.004
    horizontal = np.hypot(*flight.error[flight.after(LATE), :2].T)
    assert rms(horizontal) > 4 * rms(flight.error[flight.after(LATE), Z])
    # The estimate says that it stands still. What is reproduced is centimetres: the take-off of
    # the simulation is clean (see the floor that slopes in test_toolbox_estimator).
    assert max(map(rms, flight.estimate[flight.after(LATE), :2].T)) < 0.01
    assert 0.01 < np.hypot(*flight.truth[:, :2].T).max() < 0.1


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_5_4_on_a_sine_the_height_is_good_and_the_amplitude_is_not(seed):
    flight = flown('y_sine', seed, controller='cascaded')
    assert rms(flight.error[flight.after(LATE), Z]) < 0.01
    got, true = (abs(harmonic(flight.t, rows[:, Y])) for rows in (flight.estimate, flight.truth))
    height = -flight.truth[flight.after(LATE), Z].mean()
    # 1.5 %: noise of the flow, slant, height that swings by 2 cm
    assert true / got == pytest.approx(factor(height), rel=0.015)
    assert true / got > 1.25 and true - got > 0.2


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_5_5_the_integrated_accelerometer_drifts_and_explains_nothing(seed):
    flight = flown('y_sine', seed, controller='cascaded')
    t, y = flight.t, flight.recording.imu[:, 3 + Y]
    velocity = np.cumsum(y - y[:100].mean()) * STEP  # calibrated by the first half second
    trend = np.polyfit(t, velocity, 1)
    # noise 0.0153 m/s^2 over 100 samples 1.5 mm/s^2, walk of the bias 0.36 mm/s^2/sqrt(s)
    assert 2e-4 < abs(trend[0]) < 6e-3
    true = np.gradient(flight.truth[:, Y], STEP)
    on = flight.after(LATE)
    # thrust is not felt sideways, drag is: minus 0.54 1/s times y, a quarter period off
    assert abs(np.corrcoef(velocity[on], true[on])[0, 1]) < 0.05
    position = np.cumsum(velocity - np.polyval(trend, t)) * STEP
    assert np.ptp(position[on]) > 1.0
    assert abs(np.corrcoef(position[on], flight.error[on, Y])[0, 1]) < 0.25


@pytest.mark.parametrize('seed', SEEDS)
def test_figures_5_6_and_5_7_the_estimate_is_the_integrated_flow_and_the_truth_is_larger(seed):
    flight = flown('y_sine', seed, controller='cascaded')
    flow, since = flight.integrated_flow(), flight.after(6.0)
    estimate, seen, true = (
        rows[since, Y] - rows[since, Y][0]
        for rows in (flight.estimate, np.insert(flow, 2, 0.0, axis=1), flight.truth))
    # late by the 40 ms of the filter at 0.73 m/s: 2 cm
    assert rms(estimate - seen) < 0.02
    assert rms(true - estimate) > 5 * rms(estimate - seen)
    # One factor does it, an offset of the first turn aside: what is left is a drift by noise.
    parts = np.stack([estimate, np.ones_like(estimate)], axis=1)
    (scale, offset), *_ = np.linalg.lstsq(parts, true, rcond=None)
    height = -flight.truth[since, Z].mean()
    assert scale == pytest.approx(factor(height), rel=0.02)  # as for Figure 5.4
    assert rms(true - scale * estimate - offset) < 0.25 * rms(true - estimate)


@pytest.mark.parametrize('seed', SEEDS)
def test_figure_5_6_while_it_ascends_the_estimate_is_not_the_integrated_flow(seed):
    # Below 0.4 m there is no flow and the accelerometer is integrated. In the simulation it is
    # calibrated well; let it walk by some 0.1 m/s^2 between calibration and take-off.
    walk = (('sim_node.simulator.imu.accel_walk', 0.1),)
    flight = flown('y_sine', seed, controller='cascaded', overrides=walk)
    flow = flight.integrated_flow()
    low = (-flight.truth[:, Z] < 0.4) & (flight.t < 3.0)
    assert (flow[low] == 0.0).all()
    apart, turn = flight.estimate[:, :2] - flow, round(2 * math.pi / STEP)
    first, second = apart[1200:1200 + turn].mean(axis=0), apart[1200 + turn:][:turn].mean(axis=0)
    assert np.hypot(*first) > 0.02  # until 6 s; afterwards nothing is added in a whole turn
    assert np.hypot(*(second - first)) < 0.5 * np.hypot(*first)


@pytest.mark.parametrize(('law', 'wanted'), [
    # Q of the estimator over that of the sensor, 0.92 + 0.07 * 1.5
    ('constant', 1.06 / 1.025), ('linear', 1.0), ('exponential', 0.9993 / 1.025)])
def test_flow_times_height_takes_the_error_away_up_to_the_factor_q(law, wanted):
    flight = flown('y_sine', 1, 'kalman', 'cascaded', 'identified', (
        ('estimator_node.kalman.optical_flow.factor', law),))
    got, true = (harmonic(flight.t, rows[:, Y]) for rows in (flight.estimate, flight.truth))
    assert abs(got / true) == pytest.approx(wanted, rel=0.015)  # as for Figure 5.4
