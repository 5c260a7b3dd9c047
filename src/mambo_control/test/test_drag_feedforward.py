"""Drag feed-forward: sign by hand, rates of the reference's drag, f_d' of a flight with drag."""

from mambo_control.cascaded import CascadedParams, law, Memory
from mambo_control.drag_feedforward import drag_acceleration, reference_drag_rates
from mambo_model.motion.quaternion import rotate
from mambo_model.motion.rigid_body import State
from mambo_model.vehicle.parameters import DRAG_READINGS, Vehicle
import numpy as np
import pytest
from test_thrust_direction import slopes
from thesis_flight import control, flight, reference, setup, Setup, start

ZERO = (0.0, 0.0, 0.0)
WITH = CascadedParams(drag_feedforward=True).values()


def vehicle(reading):
    return Vehicle(drag_reading=reading).values()


def test_flying_forward_leans_forward():
    vv, case = vehicle('per_rotor_thrust'), setup('identified', size=0.0)
    ref = reference(0.0, case)._replace(v=(1.0, 0.0, 0.0))
    state = State(ref.rho, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), ZERO)
    out = law(state, ref, Memory(ZERO, ZERO), WITH, vv)
    # g k_c/4 = 0.540 m/s^2 backward at 1 m/s: thrust along -b3 has to push forward
    assert out.f_d == pytest.approx(np.array([-0.53955, 0, 9.81]) / np.hypot(0.53955, 9.81))
    assert out.f == pytest.approx(0.068 * np.hypot(0.53955, 9.81))
    assert out.U == ZERO


def test_off_by_default_and_without_effect_then():
    case = setup('identified')
    with_drag = control(0.0, start(), case)
    none = control(0.0, start(), case._replace(believed=vehicle('none')))
    assert not CascadedParams().drag_feedforward and with_drag == none


@pytest.mark.parametrize('reading', DRAG_READINGS)
@pytest.mark.parametrize('t', [0.0, 0.9, 2.3])
def test_rates_of_the_reference_drag_match_central_differences(reading, t):
    vv = vehicle(reading)
    case = setup('identified', yaw_amplitude=1.0)._replace(believed=vv)

    def drag(at):
        ref = reference(at, case)
        nu = np.array(rotate((ref.q[0], *(-x for x in ref.q[1:])), ref.v))
        return np.array(drag_acceleration(State(ref.rho, tuple(nu), ref.q, ref.omega), ref.f, vv))

    h = 1e-3  # truncation h^2/12 times a fourth derivative of order 10, rounding 1e-16/h^2
    first, second = reference_drag_rates(reference(t, case), vv)
    np.testing.assert_allclose(first, (drag(t + h) - drag(t - h)) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(
        second, (drag(t + h) - 2 * drag(t) + drag(t - h)) / h**2, atol=1e-5)


def test_the_mass_of_the_reference_does_not_matter():
    vv, case = vehicle('per_rotor_thrust'), setup('identified')
    light = case._replace(believed=case.believed._replace(mass=0.05))
    one = reference_drag_rates(reference(1.0, case), vv)
    assert one == reference_drag_rates(reference(1.0, light), vv)


def test_rates_of_f_d_in_a_flight_with_known_drag():
    vv = vehicle('per_rotor_thrust')
    case = Setup(WITH, vv, vv)
    y, t = flight(start(), 15000, 1e-3, case)[-1], 15.0
    out = control(t, y, case)
    f_1, f_2 = slopes(t, y, case, 'f_d', 'f_d_dot')
    # The drag turns f_d at 0.055 1/s, once with the vehicle and once through the feedback of its
    # deceleration. Taking that of the reference misses a tenth of it.
    np.testing.assert_allclose(out.f_d_dot, f_1, atol=0.005)
    np.testing.assert_allclose(out.f_d_ddot, f_2, atol=0.01)
    without = control(t, y, case._replace(gains=CascadedParams().values()))
    assert np.abs(np.array(without.f_d_dot) - f_1).max() > 0.1
