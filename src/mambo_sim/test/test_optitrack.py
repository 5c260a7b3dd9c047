"""Motion capture: own frames between the ticks, latency, noise, dependence on stamps alone."""

import dataclasses

from mambo_model.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_sim.sensors import optitrack
from mambo_sim.sensors.optitrack import OptitrackParams
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

STEP = 5_000_000
ZERO = (0.0, 0.0, 0.0)
IDEAL = OptitrackParams(noise=False)


def truth(t):
    """Return position and attitude of a smooth motion at t in s."""
    p = np.array([np.sin(2 * t), np.cos(2 * t), -1.5 - 0.3 * np.sin(t)])
    return p, Rotation.from_rotvec([0.3 * np.sin(t), 0.2 * np.cos(3 * t), 3.0 * t])


def state(t):
    p, R = truth(t)
    x, y, z, w = R.as_quat().tolist()
    return State(tuple(p.tolist()), ZERO, (w, x, y, z), ZERO)


def film(params=IDEAL, first=0, n=400, seed=0):
    """Return [(now, stamp, pose)] as a listener to the truth makes them."""
    p, rng, memory, out = params.values(), np.random.default_rng(seed), optitrack.START, []
    before = None
    for tick in range(first, first + n):
        now = (tick * STEP, state(tick * 0.005))
        before = before or now
        memory, sample = optitrack.step(memory, *before, *now, rng, p)
        before = now
        if sample.new:
            out.append((now[0], sample.stamp, sample.pose))
    return out


@pytest.mark.parametrize('rate', [30.0, 99.7, 120.0, 200.0])
def test_frames_come_at_the_rate_of_the_camera(rate):
    stamps = [stamp for _, stamp, _ in film(dataclasses.replace(IDEAL, rate=rate), n=2000)]
    period = round(1e9 / rate)
    assert stamps == [k * period for k in range(len(stamps))]
    assert len(stamps) == pytest.approx(10 * rate, abs=3)


def test_pose_is_the_truth_of_its_stamp():
    for _, stamp, pose in film():
        p, R = truth(stamp * 1e-9)
        # chord under an arc: a h^2/8 = 4 * (5 ms)^2 / 8
        np.testing.assert_allclose(pose.rho, p, atol=1.3e-5)
        turned = R.inv() * Rotation.from_quat([*pose.q[1:], pose.q[0]])
        assert turned.magnitude() < 1e-5
        assert np.linalg.norm(pose.q) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_attitude_is_interpolated_along_the_shorter_way(sign):
    a, b = Rotation.from_rotvec([0.1, 0.2, 3.0]), Rotation.from_rotvec([0.1, 0.25, 3.1])
    states = []
    for R, s in ((a, 1.0), (b, sign)):
        x, y, z, w = (s * R.as_quat()).tolist()
        states.append(State(ZERO, ZERO, (w, x, y, z), ZERO))
    _, q = optitrack.interpolate(*states, 0.3)
    expected = Slerp([0, 1], Rotation.concatenate([a, b]))(0.3)
    # normalised linear against spherical: third order in the angle, 0.1 rad
    assert (expected.inv() * Rotation.from_quat([*q[1:], q[0]])).magnitude() < 1e-5


@pytest.mark.parametrize('latency', [0.0, 0.01, 0.0123, 0.05])
@pytest.mark.parametrize('rate', [120.0, 200.0])
def test_pose_arrives_at_the_first_step_after_the_latency(latency, rate):
    params = dataclasses.replace(IDEAL, latency=latency, rate=rate)
    delivered = film(params)
    late = [now - stamp - round(latency * 1e9) for now, stamp, _ in delivered]
    assert min(late) >= 0 and max(late) < STEP
    assert len(delivered) == pytest.approx((2.0 - latency) * rate, abs=2)
    assert [p.exposure for _, _, p in delivered] == [s for _, s, _ in delivered]


def test_stamp_may_tell_the_arrival_instead():
    exposed = film()
    arrived = film(dataclasses.replace(IDEAL, stamp='arrival'))
    assert [s for _, s, _ in arrived] == [s + 10_000_000 for _, s, _ in exposed]
    assert [p for _, _, p in arrived] == [p for _, _, p in exposed]


def test_poses_are_a_function_of_stamps_not_of_when_listening_begins():
    late = {stamp: pose for _, stamp, pose in film(first=100, n=300)}
    early = {stamp: pose for _, stamp, pose in film(n=400)}
    assert late and all(early[stamp] == pose for stamp, pose in late.items())
    assert min(late) == 500_000_000 // 8_333_333 * 8_333_333 + 8_333_333


def test_lost_truth_costs_frames_but_no_order():
    p, rng, memory = IDEAL.values(), np.random.default_rng(0), optitrack.START
    stamps, before = [], (0, state(0.0))
    for tick in (0, 1, 2, 10, 11, 12, 13, 14, 15):  # 35 ms missing
        now = (tick * STEP, state(tick * 0.005))
        memory, sample = optitrack.step(memory, *before, *now, rng, p)
        before = now
        if sample.new:
            stamps.append(sample.stamp)
    assert stamps == sorted(set(stamps)) and len(stamps) >= 4


def test_noise_is_that_asked_for():
    params = OptitrackParams(position_noise=0.0005, attitude_noise=0.002, rate=200.0)
    errors, turns = [], []
    for _, stamp, pose in film(params, n=5000):
        p, R = truth(stamp * 1e-9)
        errors.append(pose.rho - p)
        turns.append((R.inv() * Rotation.from_quat([*pose.q[1:], pose.q[0]])).as_rotvec())
    # standard error from 5000 poses: 1 %
    np.testing.assert_allclose(np.std(errors, axis=0), 0.0005, rtol=0.05)
    np.testing.assert_allclose(np.std(turns, axis=0), 0.002, rtol=0.05)
    assert np.abs(np.mean(errors, axis=0)).max() < 3e-5
    assert abs(np.corrcoef(np.array(errors).T)[0, 1]) < 0.06


def test_one_seed_one_film():
    assert film(OptitrackParams(), seed=5) == film(OptitrackParams(), seed=5)
    assert film(OptitrackParams(), seed=5) != film(OptitrackParams(), seed=6)


@pytest.mark.parametrize('changes', [{'rate': 240.0}, {'latency': 0.06}, {'stamp': 'never'}])
def test_more_than_a_pose_a_step_is_refused(changes):
    with pytest.raises(ParameterError, match=next(iter(changes))):
        OptitrackParams(**changes)
