"""Each part of the drag against blade elements, momentum theory or a hand case; their sum."""

import dataclasses
import itertools
import math

from mambo_model import aerodynamics as air, forces
from mambo_model.vehicle.motor_mixer import rotor_speed
from mambo_model.vehicle.parameters import preset, PRESETS, Vehicle
from mambo_model.vehicle.vehicle_options import DragParams, PROFILES
import numpy as np
import pytest
from scipy.optimize import brentq

ZERO = (0.0, 0.0, 0.0)
HOVER = 0.068 * 9.81 / 4.0  # N, of one rotor
MAMBO = Vehicle()
PARTS = MAMBO.drag.values()
ROTOR, DENSITY = MAMBO.rotor.values(), MAMBO.air_density
SPEED = math.sqrt(HOVER / 4.74e-8)  # rad/s: 1876

ALL = {'blade_flapping': True, 'induced': True, 'translational': True, 'profile': 'linear'}


def with_parts(**switches):
    """Return the values and the options of a Mambo with parts of the drag, without (3.13)."""
    vehicle = dataclasses.replace(
        MAMBO, drag_reading='none', drag=DragParams(**switches))
    return vehicle.values(), vehicle.options()


def total(nu, vehicle, thrust=(HOVER,) * 4, omega=ZERO):
    """Return the drag of a vehicle, (3,) N."""
    vv, options = vehicle
    return np.array(forces.drag(nu, omega, thrust, thrust, vv, options))


def linear_parts(nu):
    """Return {name: (coefficient, force on a rotor in hover)} of the parts linear in velocity."""
    return {
        'flapping': (0.0066, air.blade_flapping(HOVER, nu, ZERO, SPEED, PARTS)),
        'induced': (0.0223, air.induced_drag(HOVER, nu, 0.0223)),
        'translational': (0.0223, air.translational_drag_low(HOVER, nu, 0.0223)),
        'profile': (0.0038, air.profile_drag_linear(HOVER, nu, 0.0038))}


@pytest.mark.parametrize('part', linear_parts(ZERO))
def test_linear_parts_pull_back_in_the_plane_of_the_rotors(part):
    k, force = linear_parts((1.5, -0.5, 3.0))[part]
    assert force == pytest.approx((-HOVER * k * 1.5, HOVER * k * 0.5, 0.0), rel=1e-14)


def test_flapping_of_a_turning_hub_leaves_the_disc_behind():
    # hub turns nose up at 2 rad/s: the disc, late by 16/gamma/Omega * 2 rad, still leans forward;
    # hub turns right wing down: it still leans left
    late = 26.4 * 2.0 / SPEED
    nose_up = air.blade_flapping(HOVER, ZERO, (0.0, 2.0, 0.0), SPEED, PARTS)
    right_down = air.blade_flapping(HOVER, ZERO, (2.0, 0.0, 0.0), SPEED, PARTS)
    assert nose_up == pytest.approx((HOVER * late, 0.0, 0.0), rel=1e-14)
    assert right_down == pytest.approx((0.0, -HOVER * late, 0.0), rel=1e-14)
    assert air.blade_flapping(HOVER, ZERO, (0.0, 0.0, 5.0), SPEED, PARTS) == ZERO
    assert air.blade_flapping(0.0, (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), 0.0, PARTS) == ZERO


def test_flapping_coefficients_are_those_of_hinged_blades_of_the_rolling_spider():
    # angles of the toolbox: 14.6 deg at the root, 6.8 deg at the tip; blade of 0.375 g
    root, twist = math.radians(14.6), math.radians(6.8 - 14.6)
    per_speed = (8.0 / 3.0 * root + 2.0 * twist) / (SPEED * 0.033)
    assert per_speed == pytest.approx(MAMBO.drag.flapping_velocity, rel=0.01)  # two digits
    lock = 1.184 * 5.5 * 0.008 * 0.033**4 / (0.375e-3 * 0.033**2 / 4.0)
    assert 16.0 / lock == pytest.approx(MAMBO.drag.flapping_rate, rel=0.002)  # three digits


@pytest.mark.parametrize('horizontal', [0.0, 0.3, 2.0, 4.5, 12.0, 40.0])
@pytest.mark.parametrize('stream', [-4.0, -2.0, 0.0, 1.0, 5.0, 30.0])
@pytest.mark.parametrize('thrust', [1e-4, HOVER, 0.4])
def test_induced_velocity_solves_the_momentum_equation(horizontal, stream, thrust):
    # T = mass flow * velocity far downstream, 2 v_i; the descent is cut at the hover velocity
    area = math.pi * 0.033**2
    hover = math.sqrt(thrust / (2.0 * DENSITY * area))
    s = max(stream, -hover)

    def surplus(v):
        return DENSITY * area * math.hypot(horizontal, s + v) * 2.0 * v - thrust

    # on the branch above the edge of the cut-off descent
    exact = brentq(surplus, max(0.0, -s) * (horizontal < hover), 3.0 * hover, xtol=1e-15)
    assert air.induced_velocity(thrust, horizontal, stream, 0.033, DENSITY) == pytest.approx(
        exact, rel=1e-11)


def test_induced_velocity_of_hover_and_of_no_thrust():
    assert air.induced_velocity(HOVER, 0.0, 0.0, 0.033, DENSITY) == pytest.approx(4.54, abs=5e-3)
    for thrust in (0.0, -0.1):
        assert air.induced_velocity(thrust, 1.0, 0.0, 0.033, DENSITY) == 0.0


@pytest.mark.parametrize('nu', [(2.0, 0.0, 0.0), (-1.0, 3.0, 0.5), (0.0, 1.0, -4.0)])
def test_profile_drag_is_the_mean_of_blade_elements_over_a_revolution(nu):
    inflow = 4.54 - nu[2]
    nodes, weights = np.polynomial.legendre.leggauss(4)  # exact for these polynomials in r
    r = 0.5 * 0.033 * (nodes + 1.0)
    psi = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
    # a blade at psi moves along t; the air meets it at Omega r + V.t in the plane, inflow across
    t = np.stack([-np.sin(psi), np.cos(psi)])
    along = SPEED * r + nu[0] * t[0] + nu[1] * t[1]
    c_d = 0.04 + 0.3 * (0.1527 - inflow / along)
    per_length = 0.5 * DENSITY * 0.008 * along**2 * c_d
    force = [-2.0 * (per_length * t[i] * weights * 0.5 * 0.033).sum(axis=1).mean()
             for i in (0, 1)]  # two blades
    got = air.profile_drag(nu, SPEED, inflow, ROTOR, PARTS, DENSITY)
    np.testing.assert_allclose(got, [*force, 0.0], rtol=1e-12, atol=1e-16)
    assert np.dot(force, nu[:2]) < 0.0


def test_both_forms_of_profile_drag_agree_in_hover():
    full = air.profile_drag((1.0, 0.0, 0.0), SPEED, 4.54, ROTOR, PARTS, DENSITY)
    linear = air.profile_drag_linear(HOVER, (1.0, 0.0, 0.0), MAMBO.drag.profile_coefficient)
    assert full[0] == pytest.approx(linear[0], rel=0.03)  # k_p has two digits


def test_profile_drag_does_not_push_in_a_fast_climb():
    assert air.profile_drag((1.0, 1.0, -30.0), SPEED, 31.0, ROTOR, PARTS, DENSITY) == ZERO


@pytest.mark.parametrize('climb', [-1.0, 0.0, 2.0])
@pytest.mark.parametrize('thrust', [0.05, HOVER, 0.35])
def test_translational_drag_has_no_step_at_w(thrust, climb):
    _, options = with_parts(translational=True)
    w = 4.5
    below, above = (
        air.translational_drag(thrust, (v, 0.0, -climb), options)[0]
        for v in (w, w * (1.0 + 1e-9)))
    assert below == pytest.approx(-thrust * 0.0223 * w, rel=1e-14)
    assert above == pytest.approx(below, rel=1e-7)


@pytest.mark.parametrize('thrust', [0.05, HOVER, 0.35])
def test_translational_drag_falls_beyond_w(thrust):
    _, options = with_parts(translational=True)
    fast = [-air.translational_drag(thrust, (v, 0.0, 0.0), options)[0] for v in (4.5, 9.0, 30.0)]
    assert fast[0] > fast[1] > fast[2] > 0.0


def test_translational_drag_beyond_w_follows_the_fourth_power_of_the_inflow():
    vehicle = with_parts(translational=True, translational_fast=1e-4)
    got = air.translational_drag(HOVER, (6.0, -8.0, -1.0), vehicle[1])
    area = math.pi * 0.033**2
    v_i = brentq(lambda v: 2.0 * DENSITY * area * v * math.hypot(10.0, 1.0 + v) - HOVER, 0.0, 9.0)
    k = HOVER * 1e-4 * (1.0 + v_i) ** 4
    assert got == pytest.approx((-6.0 * k, 8.0 * k, 0.0), rel=1e-10)


def test_translational_drag_ends_where_no_air_goes_down_through_the_rotor():
    _, options = with_parts(translational=True)
    for sink in np.linspace(0.0, 10.0, 200):
        force = air.translational_drag(HOVER, (6.0, 0.0, float(sink)), options)
        assert -HOVER * 0.0223 * 6.0 <= force[0] <= 0.0
    assert force == ZERO


def test_parasitic_drag_is_that_of_a_body_of_known_drag_area():
    # along each axis alone: half rho C_d A v^2
    K = tuple(0.5 * DENSITY * area for area in (24e-4, 24e-4, 1.1 * 62e-4))
    for axis, expected in enumerate(K):
        nu = tuple(-7.0 if i == axis else 0.0 for i in range(3))
        assert air.parasitic_drag(nu, K)[axis] == pytest.approx(expected * 49.0, rel=1e-14)
    np.testing.assert_allclose(K, MAMBO.drag.parasitic_coefficient, rtol=0.02)  # two digits
    assert air.parasitic_drag((3.0, 0.0, 4.0), (1.0, 1.0, 1.0)) == (-15.0, 0.0, -20.0)
    assert air.parasitic_drag(ZERO, K) == ZERO


@pytest.mark.parametrize('name', PRESETS)
def test_parts_of_every_vehicle_add_up_to_its_lumped_coefficient(name):
    p = preset(name).drag
    k_c = 4.0 * (p.induced_coefficient + p.translational_coefficient + p.profile_coefficient
                 + p.flapping_velocity)  # (3.11)
    assert k_c == pytest.approx(preset(name).drag_coefficient, rel=1e-12)


@pytest.mark.parametrize('nu', [(0.3, 0.0, 0.0), (-1.0, 2.0, 0.5), (2.0, -4.0, -3.0)])
def test_sum_of_the_parts_is_the_lumped_drag_below_w(nu):
    thrust = (0.10, 0.15, 0.20, 0.25)
    lumped = air.lumped_drag(nu, sum(thrust), MAMBO.values())
    np.testing.assert_allclose(
        total(nu, with_parts(**ALL), thrust), lumped, rtol=1e-12, atol=1e-17)


def test_parts_and_lumped_drag_add():
    nu, (_, options) = (1.0, -2.0, 0.5), with_parts(induced=True, parasitic=True)
    both = total(nu, (MAMBO.values(), options))
    parts = total(nu, (dataclasses.replace(MAMBO, drag_reading='none').values(), options))
    lumped = air.lumped_drag(nu, 4.0 * HOVER, MAMBO.values())
    np.testing.assert_allclose(both, np.add(parts, lumped), rtol=1e-14)


def test_every_part_is_switched_by_itself():
    nu, omega = (1.0, -2.0, 0.5), (0.3, -0.4, 0.5)
    switches = [{'blade_flapping': True}, {'induced': True}, {'translational': True},
                {'profile': 'linear'}, {'profile': 'blade_element'}, {'parasitic': True}]
    alone = [total(nu, with_parts(**s), omega=omega) for s in switches]
    assert all(np.linalg.norm(force) > 1e-5 for force in alone)
    together = total(nu, with_parts(**ALL, parasitic=True), omega=omega)
    np.testing.assert_allclose(together, sum(alone) - alone[4], rtol=1e-12, atol=1e-17)
    everything = with_parts(**{**ALL, 'profile': 'blade_element'}, parasitic=True)
    np.testing.assert_allclose(
        total(nu, everything, omega=omega), sum(alone) - alone[3], rtol=1e-12, atol=1e-17)


@pytest.mark.parametrize('profile', ['linear', 'blade_element'])
def test_total_of_the_rotors_is_linear_below_w_and_not_above(profile):
    vehicle = with_parts(**{**ALL, 'profile': profile})
    speeds = np.array([0.1, 1.0, 2.0, 3.0, 4.0, 4.5, 7.0, 10.0])
    per_speed = np.array([-total((v, 0.0, 0.0), vehicle)[0] / v for v in speeds.tolist()])
    # profile drag by blade elements has the inflow in it, which falls a little
    np.testing.assert_allclose(per_speed[:6], per_speed[0], rtol=1e-12 if profile == 'linear'
                               else 0.02)
    assert (per_speed[6:] < 0.9 * per_speed[0]).all()


def test_drag_of_the_frame_is_small_below_5_metres_per_second_and_grows_with_the_square():
    def share(v):
        frame = -total((v, 0.0, 0.0), with_parts(parasitic=True))[0]
        return frame / -total((v, 0.0, 0.0), with_parts(**ALL, parasitic=True))[0]

    assert share(1.0) < 0.05 < share(4.0) < share(5.0) < 0.25 < share(12.0)
    one, two = (total((v, 0.0, 0.0), with_parts(parasitic=True))[0] for v in (1.0, 2.0))
    assert two == pytest.approx(4.0 * one, rel=1e-14)


@pytest.mark.parametrize('switches', [
    {'blade_flapping': True}, {'induced': True}, {'translational': True},
    {'translational': True, 'translational_fast': 1e-4}, {'profile': 'linear'},
    {'profile': 'blade_element'}, {'parasitic': True},
    {**ALL, 'profile': 'blade_element', 'parasitic': True}], ids=str)
def test_drag_takes_energy_at_any_velocity_and_thrust(switches):
    vehicle, rng = with_parts(**switches), np.random.default_rng(3)
    for scale, _ in itertools.product((0.1, 3.0, 20.0), range(200)):
        nu = tuple((scale * rng.standard_normal(3)).tolist())
        thrust = tuple(rng.uniform(0.0, 0.4, 4).tolist())
        assert np.dot(total(nu, vehicle, thrust), nu) <= 0.0


def test_rotors_turn_with_the_root_of_their_thrust():
    # rows of the Rolling Spider's bench: revolutions per second, N of one rotor
    for hertz, newton in ((169.643, 0.0542), (272.321, 0.13857), (352.679, 0.23544)):
        assert rotor_speed(newton, ROTOR) == pytest.approx(2.0 * math.pi * hertz, rel=0.01)
    assert rotor_speed(0.0, ROTOR) == rotor_speed(-1e-9, ROTOR) == 0.0


def test_names_of_the_profiles_are_their_indices():
    for i, name in enumerate(PROFILES):
        assert DragParams(profile=name).values().profile == i
