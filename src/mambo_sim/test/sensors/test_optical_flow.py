"""Flow: projective model against moving points, signs by hand, switches, noise, rate, quality."""

import dataclasses
import math

from mambo_model.motion.quaternion import from_euler
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_sim.sensors import optical_flow, sampling
from mambo_sim.sensors.optical_flow import image_flow, OpticalFlowParams, project
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ZERO = (0.0, 0.0, 0.0)
EXACT = OpticalFlowParams(rate=200.0, factor_offset=1.0, factor_slope=0.0)


def moving(height=1.5, nu=ZERO, omega=ZERO, euler=ZERO):
    return State((0.0, 0.0, -height), nu, from_euler(*euler), omega)


def read(body, params=EXACT, noise=False, tick=0, seed=0):
    return optical_flow.step(
        optical_flow.START, tick, body, np.random.default_rng(seed), noise, params.values())[1]


def random_camera(rng):
    R = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
    p = np.array([*rng.uniform(-1, 1, 2), -rng.uniform(0.5, 2.5)])
    return R, p, rng.normal(size=3), rng.normal(size=3)  # R, p inertial; V, omega camera axes


@pytest.mark.parametrize('seed', range(20))
def test_image_flow_is_the_motion_of_a_projected_point(seed):
    rng = np.random.default_rng(seed)
    R, p, V, omega = random_camera(rng)
    f1, ground = rng.uniform(0.5, 2.0), np.array([*rng.uniform(-0.5, 0.5, 2), 0.0])

    def seen(t):  # point at rest on the ground; camera with constant body rate and velocity V(0)
        now = R * Rotation.from_rotvec(omega * t)
        point = now.inv().apply(ground - (p + R.apply(V) * t))
        return np.array(project(tuple(point.tolist()), f1))

    point = R.inv().apply(ground - p)
    flow = image_flow(tuple(point.tolist()), tuple(V), tuple(omega), f1)
    dt = 1e-5  # central difference: error dt^2 + eps/dt = 1e-10
    np.testing.assert_allclose(flow, (seen(dt) - seen(-dt)) / (2 * dt), atol=1e-7)


def derotated(raw, omega, f1):
    """Return the flow at the image centre with the vehicle's sign and without rotation, rad/s."""
    return np.array([-raw[0] / f1 - omega[1], -raw[1] / f1 + omega[0]])


@pytest.mark.parametrize('seed', range(20))
def test_derotated_flow_times_depth_is_the_body_velocity(seed):
    R, p, V, omega = random_camera(np.random.default_rng(seed))
    f1 = 1.3
    Z = -p[2] / R.as_matrix()[2, 2]  # h / (cos phi cos theta)
    raw = image_flow((0.0, 0.0, float(Z)), tuple(V), tuple(omega), f1)
    flow = derotated(raw, omega, f1)
    np.testing.assert_allclose(Z * np.array(flow), V[:2], atol=1e-12)
    phi, theta = R.as_euler('ZYX')[2], R.as_euler('ZYX')[1]
    assert Z == pytest.approx(-p[2] / (np.cos(phi) * np.cos(theta)), rel=1e-12)


@pytest.mark.parametrize('seed', range(10))
def test_sensor_delivers_the_derotated_flow_of_the_projective_model(seed):
    R, p, V, omega = random_camera(np.random.default_rng(seed))
    x, y, z, w = R.as_quat().tolist()
    body = State(tuple(p.tolist()), tuple(V.tolist()), (w, x, y, z), tuple(omega.tolist()))
    Z = float(-p[2] / R.as_matrix()[2, 2])
    raw = image_flow((0.0, 0.0, Z), tuple(V), tuple(omega), 1.0)
    np.testing.assert_allclose(read(body).rate, derotated(raw, omega, 1.0), atol=1e-12)
    leaky = dataclasses.replace(EXACT, leakage=1.0)  # D1: all of the rotation left in
    np.testing.assert_allclose(read(body, leaky).rate, np.negative(raw), atol=1e-12)


def test_signs_by_hand():
    forward, right = moving(2.0, (1.0, 0.0, 0.0)), moving(2.0, (0.0, 1.0, 0.0))
    assert read(forward).rate == pytest.approx((0.5, 0.0))  # 1 m/s at 2 m
    assert read(right).rate == pytest.approx((0.0, 0.5))
    raw = image_flow((0.0, 0.0, 2.0), (1.0, 0.0, 0.0), ZERO, 1.0)
    assert raw == pytest.approx((-0.5, 0.0))  # the image moves against the vehicle
    turning = moving(2.0, omega=(0.3, 0.4, 0.5))
    assert read(turning).rate == pytest.approx((0.0, 0.0))
    assert read(turning, dataclasses.replace(EXACT, leakage=1.0)).rate == pytest.approx(
        (0.4, -0.3))  # nose-up rate looks like forward motion, right roll like motion to the left
    climbing = dataclasses.replace(EXACT, vertical_coupling=(0.05, -0.1))
    assert read(moving(2.0, (0.0, 0.0, -1.0)), climbing).rate == pytest.approx((0.025, -0.05))


def test_vertical_coupling_is_that_of_a_point_off_the_axis():
    raw = image_flow((0.1, -0.2, 2.0), (0.4, 0.3, 0.7), ZERO, 1.0)  # x/f1 = 0.05, y/f1 = -0.1
    body = moving(2.0, (0.4, 0.3, 0.7))
    coupled = dataclasses.replace(EXACT, vertical_coupling=(0.05, -0.1))
    np.testing.assert_allclose(read(body, coupled).rate, np.negative(raw), atol=1e-15)


@pytest.mark.parametrize('height, factor', [
    (0.45, 0.955), (0.5, 0.955), (1.5, 1.025), (2.5, 1.095), (4.0, 1.095)])
def test_default_factor_rises_with_height_and_is_clipped(height, factor):
    rate = read(moving(height, (1.0, -2.0, 0.0)), OpticalFlowParams()).rate
    assert rate == pytest.approx((1 / (height * factor), -2 / (height * factor)))


def test_exponential_factor():
    params = OpticalFlowParams(factor_law='exponential', factor_offset=0.95, factor_slope=0.011)
    rate = read(moving(2.0, (1.0, 0.0, 0.0)), params).rate
    assert rate[0] == pytest.approx(1 / (2.0 * (0.95 + 0.011 * math.exp(2.0))))


def test_nonlinearity_acts_on_each_axis_before_the_factor():
    params = OpticalFlowParams(nonlinearity=0.1)
    rate = read(moving(1.5, (1.5, -3.0, 0.0)), params).rate
    assert rate == pytest.approx((1.1 / 1.025, -2.0 * 1.4 / 1.025))


def test_height_offset_scales_the_rate():
    rate = read(moving(1.5, (1.5, 0.0, 0.0)), dataclasses.replace(EXACT, height_offset=0.3)).rate
    assert rate[0] == pytest.approx(1.2)


@pytest.mark.parametrize('delay', [0.0, 0.02, 0.0375, 0.1])
def test_height_delay_is_a_pure_delay(delay):
    p = dataclasses.replace(EXACT, height_delay=delay).values()
    memory, rng = optical_flow.START, np.random.default_rng(0)

    def height(t):
        return 1.5 + 0.2 * t

    for tick in range(60):
        t = tick * 0.005
        h = height(t)
        memory, sample = optical_flow.step(
            memory, tick, moving(h, (h, 0.0, 0.0)), rng, False, p)
        if t > 0.1:
            assert sample.rate[0] == pytest.approx(height(t - delay) / h, rel=1e-12)
        if tick == 0:
            assert sample.rate[0] == pytest.approx(1.0)


@pytest.mark.parametrize('body', [
    moving(0.39, (1.0, 0.0, 0.0)), moving(0.0), moving(-1.0), moving(1.5, euler=(1.1, 0.0, 0.0)),
    moving(1.5, euler=(3.1, 0.0, 0.0))])
def test_sees_nothing_near_the_floor_or_tilted(body):
    sample = read(body)
    assert sample.new and sample.quality == 0 and np.isnan(sample.rate).all()


def test_quality_follows_texture_and_noise_grows_without_it():
    assert read(moving()).quality == 255
    for texture in (1.0, 0.5):
        params = dataclasses.replace(EXACT, noise=0.02, texture=texture)
        assert read(moving(), params).quality == round(255 * texture)
        rng, p = np.random.default_rng(0), params.values()
        rates = np.array([optical_flow.step(
            optical_flow.START, 0, moving(), rng, True, p)[1].rate for _ in range(10000)])
        np.testing.assert_allclose(rates.std(axis=0), 0.02 / texture, rtol=0.035)  # 0.7 % error
        assert np.abs(rates.mean(axis=0)).max() < 1.5e-3
        assert abs(np.corrcoef(rates.T)[0, 1]) < 0.05


def test_only_new_values_are_delivered_at_32_hertz():
    p, rng, memory = OpticalFlowParams().values(), np.random.default_rng(0), optical_flow.START
    ticks = []
    for tick in range(2000):
        memory, sample = optical_flow.step(memory, tick, moving(), rng, True, p)
        if sample.new:
            ticks.append(tick)
        else:
            assert sample.quality == 0 and np.isnan(sample.rate).all()
    assert len(ticks) == 320 and set(np.diff(ticks)) == {6, 7}


def run(params, ticks, body=moving, noise=False):
    p, rng, memory, out = params.values(), np.random.default_rng(0), optical_flow.START, []
    for tick in range(ticks):
        memory, sample = optical_flow.step(memory, tick, body(tick), rng, noise, p)
        out.append(sample)
    return out


def test_pauses_come_after_each_burst():
    samples = run(OpticalFlowParams(rate=40.0, burst=4, pause=0.1), 400, lambda k: moving())
    ticks = [k for k, s in enumerate(samples) if s.new]
    assert ticks[:9] == [0, 5, 10, 15, 35, 40, 45, 50, 70]
    assert set(np.diff(ticks)) == {5, 20}


@pytest.mark.parametrize('rate', [200.0, 32.0, 70.0])
@pytest.mark.parametrize('burst', [1, 7, 15])
def test_without_a_pause_bursts_are_no_bursts(rate, burst):
    period = sampling.period_ns(rate)
    for tick in range(3000):
        assert sampling.due_in_bursts(tick, period, burst, period) == sampling.due(tick, period)


@pytest.mark.parametrize('latency', [0.005, 0.05, 0.12, 0.15])
def test_latency_is_a_pure_delay_of_what_was_seen(latency):
    def body(tick):
        return moving(1.5, (1.5 * tick, -3.0 * tick, 0.0))

    late = round(latency / 0.005)
    samples = run(dataclasses.replace(EXACT, latency=latency), 60, body)
    for tick, sample in enumerate(samples):
        assert sample.new
        if tick < late:
            assert sample.quality == 0 and np.isnan(sample.rate).all()
        else:
            assert sample.rate == pytest.approx((tick - late, -2.0 * (tick - late)))


def test_latency_keeps_what_the_camera_did_not_see():
    samples = run(dataclasses.replace(EXACT, latency=0.05), 60,
                  lambda k: moving(0.1 if k < 20 else 1.5, (1.5, 0.0, 0.0)))
    assert [s.quality for s in samples] == [0] * 30 + [255] * 30


def test_measurements_fail_as_often_as_the_texture_says():
    for texture, share in ((1.0, 0.1), (0.5, 0.35)):
        params = dataclasses.replace(EXACT, dropout=0.1, texture_dropout=0.5, texture=texture)
        samples = run(params, 10000, lambda k: moving(), noise=True)
        failed = [s for s in samples if s.quality == 0]
        assert len(failed) / 10000 == pytest.approx(share, rel=0.12)  # 4 standard errors
        assert all(s.new and np.isnan(s.rate).all() for s in failed)
        assert not any(s.quality == 0 for s in run(params, 100, lambda k: moving()))


def test_draws_do_not_depend_on_where_the_vehicle_is():
    p = EXACT.values()
    first, second = np.random.default_rng(1), np.random.default_rng(1)
    optical_flow.step(optical_flow.START, 0, moving(0.1), first, True, p)
    optical_flow.step(optical_flow.START, 0, moving(1.5), second, True, p)
    assert first.standard_normal() == second.standard_normal()


@pytest.mark.parametrize('changes, message', [
    ({'factor_slope': -0.5}, 'factor_slope'), ({'factor_low': 3.0}, 'factor_low'),
    ({'factor_law': 'cubic'}, 'factor_law'), ({'rate': 201.0}, 'rate'),
    ({'height_delay': 0.2}, 'height_delay'), ({'latency': 0.2}, 'latency')])
def test_bad_parameters_name_themselves(changes, message):
    with pytest.raises(ParameterError, match=message):
        OpticalFlowParams(**changes)
