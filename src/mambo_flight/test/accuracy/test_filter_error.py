"""Truth of a judged flight: what is drawn, what the sensors do, and the error of each state."""

from dataclasses import replace
import math
from types import SimpleNamespace

from mambo_estimation.joint.state import SIZE
from mambo_flight import offline_replay
from mambo_flight.accuracy import cramer_rao, filter_error
from mambo_flight.accuracy.filter_error import LATENCIES, SCALES, SLOPES, true_noise, with_unknowns
from mambo_flight.scenario import override, Scenario
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

FLIGHT = Scenario()
DT = 0.005


def simulated(**sensors):
    """Return the flight with other parameters of the simulated sensors."""
    sim = FLIGHT.sim_node.simulator
    changed = {name: replace(getattr(sim, name), **values) for name, values in sensors.items()}
    return replace(FLIGHT, sim_node=replace(
        FLIGHT.sim_node, simulator=replace(sim, **changed)))


def test_ranges_are_spanned_and_a_latency_is_whole_steps():
    drawn = [with_unknowns(FLIGHT, seed, True).sim_node.simulator.optical_flow
             for seed in range(40)]
    for values, (low, high) in (
            ([f.factor_slope for f in drawn], SLOPES), ([f.latency for f in drawn], LATENCIES)):
        assert low <= min(values) < low + 0.2 * (high - low)  # 40 draws: but 1 time in 7000
        assert high - 0.2 * (high - low) < max(values) <= high
    steps = np.array([f.latency / DT for f in drawn])
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    believed = FLIGHT.estimator_node.joint.optical_flow
    shares = [(f.factor_offset + f.factor_slope * believed.reference_height) / believed.scale
              for f in drawn]
    assert SCALES[0] <= min(shares) and max(shares) <= SCALES[1]
    assert max(shares) - min(shares) > 0.6 * (SCALES[1] - SCALES[0])


def test_a_slope_leaves_the_factor_at_the_reference_height():
    believed = FLIGHT.estimator_node.joint.optical_flow
    for slope in (-0.1, 0.0, 0.15):
        flow = with_unknowns(FLIGHT, 1, False, slope).sim_node.simulator.optical_flow
        assert flow.factor_law == 'linear' and flow.factor_slope == slope
        at_reference = flow.factor_offset + slope * believed.reference_height
        assert at_reference == pytest.approx(believed.scale)


def test_the_seed_is_that_of_every_noise():
    flight = with_unknowns(FLIGHT, 41, False)
    assert flight.sim_node.simulator.seed == flight.optitrack_node.seed == 41
    assert replace(flight, sim_node=FLIGHT.sim_node, optitrack_node=FLIGHT.optitrack_node) == (
        FLIGHT)


def test_a_density_is_white_noise_and_rounding_over_the_root_of_the_rate():
    flight = simulated(imu={'gyro_noise': (0.003, 0.003, 0.003), 'gyro_resolution': 0.004 * 3**0.5,
                            'accel_noise': (0.03, 0.02, 0.01), 'accel_resolution': 0.0,
                            'gyro_walk': 0.00123, 'accel_walk': 0.0045})
    motion = true_noise(flight).motion
    # rounding to r is noise of r / sqrt(12): 0.002
    assert motion.gyro_noise == pytest.approx(math.hypot(0.003, 0.002) * math.sqrt(DT))
    assert motion.accel_noise == pytest.approx(0.02 * math.sqrt(DT))
    assert (motion.gyro_bias_walk, motion.accel_bias_walk) == (0.00123, 0.0045)


def test_pressure_is_height_by_the_standard_atmosphere_at_the_floor():
    """ISO 2533: dp/dh = -p g / (R T), 12.01 Pa a metre at 101325 Pa and 288.15 K."""
    flight = simulated(barometer={'ground_pressure': 101325.0, 'noise': 12.01, 'walk': 1.201})
    found = true_noise(flight).barometer
    assert found.noise == pytest.approx(1.0, rel=1e-3)
    assert found.offset_walk == pytest.approx(0.1, rel=1e-3)


def test_noise_of_sonar_and_flow_is_theirs_and_never_zero():
    flight = simulated(sonar={'noise': 0.003, 'resolution': 0.004 * 12**0.5},
                       optical_flow={'noise': 0.02})
    found = true_noise(flight)
    assert found.sonar.noise == pytest.approx(0.005)
    assert (found.optical_flow.noise, found.optical_flow.scale_walk) == (0.02, 0.0)
    exact = true_noise(simulated(sonar={'noise': 0.0, 'resolution': 0.0},
                                 optical_flow={'noise': 0.0}, barometer={'noise': 0.0}))
    assert exact.sonar.noise == exact.optical_flow.noise == 1e-4
    assert exact.barometer.noise == 1e-3


@pytest.mark.parametrize(('reading', 'share'), [
    ('per_rotor_thrust', 0.25), ('acceleration', 1.0 / 9.81)])
def test_truth_of_the_flow_is_at_the_reference_height_and_the_drag_that_of_the_reading(
        reading, share):
    flight = override(with_unknowns(FLIGHT, 3, True), {
        'sim_node.simulator.vehicle.drag_reading': reading})
    flow = flight.sim_node.simulator.optical_flow
    found = filter_error._truth(flight)
    height = flight.estimator_node.joint.optical_flow.reference_height
    assert found.scale == pytest.approx(flow.factor_offset + height * flow.factor_slope)
    assert (found.slope, found.latency) == (flow.factor_slope, pytest.approx(flow.latency))
    vehicle = flight.sim_node.simulator.vehicle
    assert found.drag == pytest.approx(vehicle.drag_coefficient * share)


def exact_flight(n=5):
    """Return a recording, an answer of the filter that is right, its truth and biases."""
    rng = np.random.default_rng(0)
    q = Rotation.random(n, rng).as_quat()[:, [3, 0, 1, 2]]
    truth = np.hstack([rng.normal(size=(n, 6)), q, np.zeros((n, 3))])
    body = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    biases = rng.normal(size=(n, 6))
    x = np.hstack([truth[:, :3], truth[:, 3:6], q, biases, np.tile(
        [1.02, 0.07, 0.2, 0.2, 0.03, 0.0, 0.0, 0.0], (n, 1))])
    return (SimpleNamespace(t=np.arange(n), truth=truth), SimpleNamespace(x=x),
            cramer_rao.TrueParameters(1.02, 0.07, 0.2, 0.03), biases, body)


def test_a_filter_that_is_right_has_no_error():
    recording, made, truth, biases, _ = exact_flight()
    # the filter's velocity is that of its state, inertial as the truth turned by its attitude
    made.x[:, 3:6] = Rotation.from_quat(recording.truth[:, [7, 8, 9, 6]]).apply(
        recording.truth[:, 3:6])
    error = filter_error._error(recording, made, truth, biases, 0.0)
    assert error.shape == (5, SIZE)
    np.testing.assert_allclose(error, 0.0, atol=1e-9)


@pytest.mark.parametrize(('column', 'state'), [
    (0, 0), (1, 1), (2, 2), (10, 9), (12, 11), (13, 12), (15, 14), (16, 15), (17, 16), (18, 17),
    (19, 18), (20, 19), (21, 20), (22, 21)])
def test_an_error_is_truth_less_belief_in_its_own_state(column, state):
    recording, made, truth, biases, _ = exact_flight()
    made.x[:, 3:6] = Rotation.from_quat(recording.truth[:, [7, 8, 9, 6]]).apply(
        recording.truth[:, 3:6])
    made.x[:, column] += 0.25
    error = filter_error._error(recording, made, truth, biases, 0.0)
    np.testing.assert_allclose(error[:, state], -0.25, atol=1e-9)
    rest = np.delete(error, state, axis=1)
    np.testing.assert_allclose(rest, 0.0, atol=1e-9)


def test_an_error_of_attitude_is_the_turn_from_belief_to_truth_in_inertial_axes():
    recording, made, truth, biases, body = exact_flight()
    turn = Rotation.from_rotvec([0.01, -0.02, 0.03])
    believed = (turn.inv() * body).as_quat()[:, [3, 0, 1, 2]]
    made.x[:, 6:10] = believed
    # a velocity that is right in the believed body is turned along
    made.x[:, 3:6] = turn.inv().apply(body.apply(recording.truth[:, 3:6]))
    error = filter_error._error(recording, made, truth, biases, 0.0)
    np.testing.assert_allclose(error[:, 6:9], np.tile([0.01, -0.02, 0.03], (5, 1)), atol=1e-9)
    np.testing.assert_allclose(error[:, 3:6], 0.0, atol=1e-9)


def test_steps_of_a_flight_hold_its_samples_and_say_no_sample_of_quality_0():
    n = 4
    recording = SimpleNamespace(
        t=np.arange(n) * 5_000_000, imu=np.arange(24.0).reshape(n, 6), sonar=np.full(n, np.nan),
        flow=np.array([[0.1, 0.2, 200.0], [np.nan] * 3, [0.3, 0.4, 100.0], [np.nan] * 3]),
        pressure=np.full(n, 1e5))
    steps = offline_replay.steps_of(recording)
    np.testing.assert_allclose(steps.dt, [0.0, DT, DT, DT])
    np.testing.assert_array_equal(steps.gyro, recording.imu[:, :3])
    np.testing.assert_array_equal(steps.accel, recording.imu[:, 3:])
    assert steps.flow_quality.tolist() == [200, 0, 100, 0]
    np.testing.assert_array_equal(steps.flow[[0, 2]], [[0.1, 0.2], [0.3, 0.4]])
    assert steps.gyro.flags['C_CONTIGUOUS'] and steps.flow.flags['C_CONTIGUOUS']
