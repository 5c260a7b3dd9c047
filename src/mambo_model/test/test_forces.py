"""Ground effect by its image in the floor, spinning rotors by angular momentum, idle options."""

import dataclasses
import math
import struct

from mambo_model import aerodynamics, forces
from mambo_model.forces import Rotors
from mambo_model.motion import rigid_body
from mambo_model.motion.quaternion import from_euler
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle.motor_mixer import mix, rotor_momentum
from mambo_model.vehicle.parameters import Vehicle
from mambo_model.vehicle.vehicle_options import FadeParams, GroundEffectParams, RotorParams
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

ZERO = (0.0, 0.0, 0.0)
HOVER = 0.068 * 9.81 / 4.0
MAMBO = Vehicle()
VV = MAMBO.values()
FLOOR = dataclasses.replace(MAMBO, ground_effect=GroundEffectParams(enabled=True)).options()
SPINNING = dataclasses.replace(
    MAMBO, motor_time_constant=0.05, rotor=RotorParams(torques=True)).options()
IDLE = dataclasses.replace(MAMBO, fade=FadeParams(enabled=True)).options()  # acts on motors only
J = np.array(MAMBO.inertia)


def at(height=0.0, euler=ZERO, nu=ZERO, omega=ZERO):
    return State((0.3, -0.2, -height), nu, from_euler(*euler), omega)


def rotors(*thrust, momentum=0.0, rate=0.0):
    return Rotors(thrust if len(thrust) == 4 else thrust * 4, momentum, rate)


def matrix(q):
    return Rotation.from_quat([*q[1:], q[0]]).as_matrix()


@pytest.mark.parametrize('z', [0.02, 0.033, 0.066, 0.2, 1.0])
def test_ground_effect_is_the_upwash_of_the_image_at_equal_power(z):
    # the rotor's flow A v_i as a source whose image lies 2 z below: it blows v_i A/(4 pi (2 z)^2)
    # back up, so that at equal power the thrust grows as the inflow falls
    area = math.pi * 0.033**2
    upwash = area / (4.0 * math.pi * (2.0 * z) ** 2)
    assert aerodynamics.ground_effect(z, 0.033) == pytest.approx(1.0 / (1.0 - upwash), rel=1e-14)


def test_ground_effect_matters_below_a_diameter_and_is_bounded():
    # the rule of thumb of sec. 3.2.7
    lifts = [aerodynamics.ground_effect(z, 0.033) for z in (0.3, 0.066, 0.033, 0.0165, 0.0, -1.0)]
    assert lifts[0] < 1.001
    assert lifts[1] == pytest.approx(1.0159, abs=1e-4)
    assert lifts == sorted(lifts)
    assert lifts[3] == lifts[4] == lifts[5] == pytest.approx(4.0 / 3.0)


@pytest.mark.parametrize('euler', [ZERO, (0.3, -0.2, 1.0), (-0.5, 0.4, -2.0)])
def test_each_rotor_feels_the_floor_at_its_own_height(euler):
    thrust, body = (0.1, 0.2, 0.3, 0.4), at(0.05, euler)
    l = MAMBO.arm
    places = np.array([[l, -l, -0.03], [l, l, -0.03], [-l, l, -0.03], [-l, -l, -0.03]])
    heights = 0.05 - (places @ matrix(body.q).T)[:, 2]
    expected = [
        t / (1.0 - (0.033 / (4.0 * max(z, 0.0165))) ** 2) for t, z in zip(thrust, heights)]
    np.testing.assert_allclose(
        forces.lift(thrust, body.rho, body.q, l, FLOOR), expected, rtol=1e-13)
    assert len(set(np.round(heights, 6))) == (1 if euler == ZERO else 4)


def test_floor_lifts_rights_a_low_wing_and_leaves_yaw_alone():
    free = forces.forces(at(0.05, (0.2, 0.0, 0.0)), rotors(HOVER), VV, FLOOR, False)
    f, tau, _ = forces.forces(at(0.05, (0.2, 0.0, 0.0)), rotors(HOVER), VV, FLOOR, True)
    assert free.f == 4.0 * HOVER and free.tau == ZERO
    assert f > 1.005 * free.f
    assert tau[0] < -1e-5 and abs(tau[1]) < 1e-15  # right wing down: rolls back to the left
    yawing = (0.2, 0.1, 0.2, 0.1)
    _, tau, _ = forces.forces(at(0.0), rotors(*yawing), VV, FLOOR, True)
    assert tau[2] == mix(yawing, VV)[1][2]


def test_upside_down_there_is_no_ground_effect():
    body = at(0.05, (3.0, 0.0, 0.0))
    assert forces.forces(body, rotors(HOVER), VV, FLOOR, True).f == 4.0 * HOVER


def test_momentum_of_the_rotors_counts_clockwise_as_positive_about_the_downward_axis():
    one = 1.36e-7 * math.sqrt(0.2 / 4.74e-8)
    for motor, sign in enumerate((1, -1, 1, -1)):
        thrust = tuple(0.2 if i == motor else 0.0 for i in range(4))
        assert rotor_momentum(thrust, SPINNING.rotor) == pytest.approx(sign * one, rel=1e-14)
    assert rotor_momentum((0.2,) * 4, SPINNING.rotor) == 0.0


def test_rotors_that_spin_up_turn_the_body_against_them():
    # rotor 1, clockwise from above, spins up: the body is pushed counterclockwise, yaw < 0
    step = forces.rotors_in_step(
        (0.2, 0.1, 0.1, 0.1), (0.1,) * 4, (0.3, 0.1, 0.1, 0.1), 0.001, SPINNING)
    change = 1.36e-7 * (math.sqrt(0.3 / 4.74e-8) - math.sqrt(0.1 / 4.74e-8))
    assert step.momentum_rate == pytest.approx(change / 0.001, rel=1e-13)
    turning = forces.forces(at(1.0), step, VV, SPINNING, True).tau
    steady = forces.forces(at(1.0), rotors(*step.thrust), VV, SPINNING, True).tau
    assert turning[2] - steady[2] == pytest.approx(-change / 0.001, rel=1e-12)
    assert turning[:2] == steady[:2]


def test_rotors_without_torques_leave_no_trace():
    step = forces.rotors_in_step((0.2,) * 4, (0.1,) * 4, (0.3, 0.1, 0.1, 0.1), 0.001, IDLE)
    assert step == Rotors((0.2,) * 4, 0.0, 0.0)


@pytest.mark.parametrize('rate', [0.0, 4e-4, -3e-4])
def test_body_and_rotors_together_keep_their_angular_momentum(rate):
    start, h = 5e-4, 1e-3  # N m s: faster than rotors turn, to make it plain
    body, spinning = at(1.0, (0.3, 0.2, 0.1), omega=(2.0, -3.0, 1.0)), rotors(0.0)
    before = matrix(body.q) @ (J * body.omega + [0.0, 0.0, start])
    for k in range(1000):
        middle = start + rate * (k + 0.5) * h
        spinning = rotors(0.0, momentum=middle, rate=rate)
        body = forces.rk4_step(body, spinning, h, VV, SPINNING, True)
    after = matrix(body.q) @ (J * body.omega + [0.0, 0.0, start + rate])
    # momentum held at its mean over a step of 1 ms: second order
    tolerance = 1e-5 if rate else 1e-8
    np.testing.assert_allclose(after, before, rtol=0.0, atol=tolerance * np.linalg.norm(before))
    assert np.abs(np.array(body.omega) - (2.0, -3.0, 1.0)).max() > 0.5


def test_spinning_rotors_make_a_pitching_body_roll():
    # momentum h e3, nose up at omega_2: to turn h along needs a torque omega x h on the rotors,
    # (omega_2 h, 0, 0); the body feels its opposite
    body = at(1.0, omega=(0.0, 2.0, 0.0))
    tau = forces.forces(body, rotors(HOVER, momentum=1e-4), VV, SPINNING, True).tau
    assert tau == pytest.approx((-2e-4, 0.0, 0.0), abs=1e-18)


def test_integration_with_options_equals_an_independent_one():
    options = dataclasses.replace(
        MAMBO, motor_time_constant=0.05, ground_effect=GroundEffectParams(enabled=True),
        rotor=RotorParams(torques=True)).options()
    spinning = rotors(0.16, 0.17, 0.165, 0.168, momentum=3e-4, rate=2e-5)
    start = at(0.04, (0.1, -0.2, 0.3), (0.5, -0.4, -0.3), (0.5, 0.4, -0.3))

    def rate(_, y):
        y = y.tolist()
        state = State(*(tuple(y[a:b]) for a, b in ((0, 3), (3, 6), (6, 10), (10, 13))))
        f, tau, F_D = forces.forces(state, spinning, VV, options, True)
        return np.concatenate(rigid_body.derivative(state, f, tau, F_D, ZERO, VV))

    exact = solve_ivp(rate, (0.0, 0.1), np.concatenate(start), 'DOP853', rtol=1e-12,
                      atol=1e-13).y[:, -1]
    errors = []
    for n in (10, 20, 40):
        body = start
        for _ in range(n):
            body = forces.rk4_step(body, spinning, 0.1 / n, VV, options, True)
        errors.append(np.linalg.norm(np.concatenate(body) - exact))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (np.abs(orders - 4.0) < 0.3).all(), orders  # asymptotic: 4 + O(h)


def test_options_that_do_not_act_change_no_bit():
    plain = same = at(1.0, (0.3, -0.2, 0.1), (1.0, -2.0, 0.5), (3.0, -4.0, 5.0))
    thrust = (0.15, 0.16, 0.17, 0.18)
    for _ in range(200):
        f, tau = mix(thrust, VV)
        plain = rigid_body.rk4_step(plain, f, tau, 0.0007, VV)
        same = forces.rk4_step(same, rotors(*thrust), 0.0007, VV, IDLE, True)
    numbers = [np.concatenate(state).tolist() for state in (plain, same)]
    assert struct.pack('13d', *numbers[0]) == struct.pack('13d', *numbers[1])
