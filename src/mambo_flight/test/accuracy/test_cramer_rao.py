"""The Cramer-Rao bound against closed forms."""

from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import (
    DRAG, POSITION, PRESSURE_OFFSET, RANGE_OFFSET, SIZE, VELOCITY)
from mambo_flight.accuracy import cramer_rao
from mambo_model import schema
import numpy as np
import pytest

DT = 0.005
HOVER = cramer_rao.TrueParameters(1.0, 0.0, 0.055, 0.0)


def hovering(seconds, flow_every, sonar_every, height=1.0):
    """Return a hover at 1 m with samples in fixed intervals."""
    n = round(seconds / DT)
    state = np.zeros((n, 13))
    state[:, 2], state[:, 6] = -height, 1.0
    force, k = np.tile([0.0, 0.0, -9.81], (n, 1)), np.arange(n)
    return cramer_rao.SampledFlight(
        state, force, k % flow_every == 0, k % sonar_every == 0, np.zeros(n, np.bool_))


def params(**changed):
    """Return the filter's parameters with others, {'motion.gyro_noise': ...}."""
    return schema.build(JointParams, {**schema.flatten(JointParams()), **changed}).values()


def run(sensed, values, P, truth=HOVER):
    out = np.empty((len(sensed.state), SIZE, SIZE))
    cramer_rao.covariances(sensed, 0, P, DT, truth, values, out)
    return out


@pytest.mark.long
def test_dead_reckoning_by_flow_alone_is_the_closed_form():
    # inertial noise so large that the flow alone tells the velocity: h sigma sqrt(interval T)
    values = params(**{
        'motion.accel_noise': 0.5, 'motion.gyro_noise': 1e-7, 'drag.min_height': 9.0,
        'optical_flow.noise': 0.0251})
    every, seconds = 3, 60.0
    P = run(hovering(seconds, every, 8), values, np.zeros((SIZE, SIZE)))[-1]
    # each sample stands for its interval; between samples the velocity wanders by itself
    sampled = 0.0251 ** 2 * every * DT * seconds
    wandered = 0.5 ** 2 * (every * DT) ** 3 / 12.0 * seconds / (every * DT)
    assert 0.9 * np.sqrt(sampled) < np.sqrt(P[0, 0]) < 1.2 * np.sqrt(sampled + wandered)


@pytest.mark.long
def test_height_is_known_as_well_as_a_random_walk_observed_by_the_sonar():
    values = params(**{'motion.accel_noise': 0.01, 'drag.min_height': 9.0, 'sonar.noise': 0.01})
    P = run(hovering(30.0, 1000000, 8), values, np.zeros((SIZE, SIZE)))[-1]
    # steady state of a double integrator with density q, observed with density r
    q, r = 0.01 ** 2, 0.01 ** 2 * 8 * DT
    expected = np.sqrt(2.0) * (q * r ** 3) ** 0.25
    assert P[2, 2] == pytest.approx(expected, rel=0.15)
    expected = np.sqrt(2.0) * (q ** 3 * r) ** 0.25
    assert P[VELOCITY + 2, VELOCITY + 2] == pytest.approx(expected, rel=0.15)


def test_without_samples_only_the_inertial_noise_counts():
    values = params(**{'motion.accel_noise': 0.02, 'motion.gyro_noise': 1e-7,
                       'motion.accel_bias_walk': 0.0, 'motion.gyro_bias_walk': 0.0,
                       'drag.min_height': 9.0})
    nothing = hovering(10.0, 10 ** 9, 10 ** 9)
    nothing.flow[:], nothing.sonar[:] = False, False
    P = run(nothing, values, np.zeros((SIZE, SIZE)))[-1]
    assert P[VELOCITY, VELOCITY] == pytest.approx(0.02 ** 2 * 10.0, rel=0.01)
    assert P[POSITION, POSITION] == pytest.approx(0.02 ** 2 * 10.0 ** 3 / 3.0, rel=0.01)


def test_an_unknown_offset_of_the_sonar_stays_in_the_height():
    values, start = params(), np.zeros((SIZE, SIZE))
    start[RANGE_OFFSET, RANGE_OFFSET] = 0.05 ** 2
    start[2, 2] = 1.0
    P = run(hovering(20.0, 6, 8), values, start)[-1]
    assert np.sqrt(P[2, 2]) == pytest.approx(0.05, rel=0.02)


def final(flight, values, start=None, truth=HOVER):
    return run(flight, values, np.zeros((SIZE, SIZE)) if start is None else start, truth)[-1]


def uncertain():
    """Return a covariance with every error of the filter unknown."""
    return np.diag(np.full(SIZE, 0.01))


def test_a_bound_is_a_covariance_at_every_step():
    bound = run(hovering(4.0, 6, 8), params(), uncertain())
    np.testing.assert_allclose(bound, bound.transpose(0, 2, 1), atol=1e-12)
    assert np.linalg.eigvalsh(bound).min() > -1e-12


@pytest.mark.parametrize(('sensor', 'improved'), [
    ('flow', VELOCITY), ('sonar', POSITION + 2), ('pressure', PRESSURE_OFFSET)])
def test_samples_of_a_sensor_never_make_the_bound_larger(sensor, improved):
    without = hovering(3.0, 10**9, 10**9)
    for name in ('flow', 'sonar', 'pressure'):
        getattr(without, name)[:] = False
    with_it = without._replace(**{sensor: np.arange(len(without.state)) % 8 == 0})
    before, after = (final(f, params(), uncertain()) for f in (without, with_it))
    assert (np.diag(after) <= np.diag(before) * (1.0 + 1e-9)).all()
    assert after[improved, improved] < 0.9 * before[improved, improved]


def test_samples_twice_as_noisy_give_a_larger_bound():
    flight = hovering(3.0, 6, 8)
    quiet, noisy = (final(flight, params(**{'optical_flow.noise': noise, 'sonar.noise': noise}))
                    for noise in (0.02, 0.04))
    for i in (POSITION, POSITION + 2, VELOCITY, VELOCITY + 2):
        assert quiet[i, i] < noisy[i, i]


def test_a_barometer_without_an_offset_in_the_filter_is_left_out():
    flight, start = hovering(2.0, 6, 8), uncertain()
    start[PRESSURE_OFFSET] = start[:, PRESSURE_OFFSET] = 0.0
    used = flight._replace(pressure=np.ones(len(flight.state), np.bool_))
    np.testing.assert_array_equal(
        final(used, params(), start.copy()), final(flight, params(), start.copy()))


def test_the_bound_starts_with_the_take_off():
    flight, start = hovering(2.0, 6, 8), uncertain()
    out = np.empty((len(flight.state), SIZE, SIZE))
    cramer_rao.covariances(flight, 100, start.copy(), DT, HOVER, params(), out)
    np.testing.assert_array_equal(out[:101], np.broadcast_to(start, (101, SIZE, SIZE)))
    assert out[101, VELOCITY, VELOCITY] != start[VELOCITY, VELOCITY]


def test_a_late_flow_counts_once_it_shows_the_motion_after_take_off():
    flight = hovering(0.5, 1, 10**9)
    none = flight._replace(flow=np.zeros(len(flight.state), np.bool_))
    truth = HOVER._replace(latency=0.1)  # 20 steps
    values = params(**{'drag.min_height': 9.0})
    with_it, without = (run(f, values, uncertain(), truth) for f in (flight, none))
    np.testing.assert_array_equal(with_it[:21], without[:21])
    assert with_it[21, VELOCITY, VELOCITY] < 0.9 * without[21, VELOCITY, VELOCITY]


def test_drag_is_observed_in_the_air_alone():
    def known(height):
        values = params(**{'drag.min_height': 0.5})
        flight = hovering(3.0, 10**9, 10**9, height)
        flight.state[:, 3] = 1.0  # m/s forward, against which drag acts
        return final(flight, values, uncertain())[DRAG, DRAG]
    assert known(0.3) == pytest.approx(0.01) and known(1.0) < 0.009
