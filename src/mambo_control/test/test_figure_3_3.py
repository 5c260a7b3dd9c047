"""The simulation of section 3.4: every number that the audit of Fig. 3.3 gives."""

from mambo_control.cascaded import CascadedParams
from mambo_model.motion.quaternion import angle
from mambo_model.vehicle.motor_mixer import allocate, pwm_from_thrust
from mambo_model.vehicle.parameters import THRUST_MAPS
import numpy as np
import pytest
from thesis_flight import control, flight, reference, setup, start

H = 2e-3  # s; RK4 at 24 rad/s errs by 1e-7 per second, far below the tolerances


class Flown:
    """States, errors and signals over 20 s."""

    def __init__(self, case):
        self.t = H * np.arange(10001)
        self.y = flight(start(), 10000, H, case)
        self.laws = [control(t, y, case) for t, y in zip(self.t, self.y, strict=True)]
        wanted = np.array([reference(t, case).rho for t in self.t])
        self.error = wanted - self.y[:, :3]
        self.distance = np.linalg.norm(self.error, axis=1)
        self.f = np.array([law.f for law in self.laws])
        self.angle = np.array([angle(law.q_e) for law in self.laws])
        self.thrust = np.array([allocate(law.f, law.tau, case.plant) for law in self.laws])

    def pwm(self, case, thrust_map):
        vv = case.plant._replace(thrust_map=THRUST_MAPS.index(thrust_map))
        return np.array([[pwm_from_thrust(T, vv) for T in row] for row in self.thrust])

    def within_for_good(self, values, limit):
        return self.t[np.nonzero(values >= limit)[0][-1] + 1]

    def at(self, t):
        return self.distance[round(t / H)]


@pytest.fixture(scope='module')
def toolbox():
    return Flown(setup('toolbox'))


def test_tracks_after_about_six_seconds(toolbox):
    assert toolbox.within_for_good(toolbox.distance, 0.05) == pytest.approx(5.82, abs=0.01)
    assert toolbox.within_for_good(toolbox.distance, 0.02) == pytest.approx(6.54, abs=0.01)
    assert toolbox.within_for_good(toolbox.distance, 0.01) == pytest.approx(10.26, abs=0.01)


@pytest.mark.parametrize(('t', 'metres'), [
    (0, 1.803), (3, 0.665), (4, 0.447), (5, 0.151), (6, 0.039), (8, 0.0045), (10, 0.0105),
    (15, 0.0004), (20, 0.0001)])
def test_distance_over_time(toolbox, t, metres):
    assert toolbox.at(t) == pytest.approx(metres, abs=6e-4 if metres > 0.02 else 6e-5)


def test_shape_of_the_transient(toolbox):
    t, d, e = toolbox.t, toolbox.distance, toolbox.error
    first, second = np.argmin(d[t < 2.5]), np.argmax(np.where((t > 2.5) & (t < 4), d, 0))
    assert (t[first], d[first]) == pytest.approx((2.13, 0.150), abs=0.01)
    assert (t[second], d[second]) == pytest.approx((3.12, 0.672), abs=0.01)
    assert d.max() == pytest.approx(1.935, abs=1e-3)
    assert d[t >= 15].max() == pytest.approx(3.6e-4, abs=1e-5)
    # opposite to the initial error (1, 0, -1.5), integral action
    assert e[:, 0].min() == pytest.approx(-0.29, abs=0.005)
    assert e[:, 1].min() == pytest.approx(-0.21, abs=0.005)
    assert e[:, 2].max() == pytest.approx(0.57, abs=0.005)


def test_attitude_error(toolbox):
    assert toolbox.angle[0] == pytest.approx(0.0942, abs=1e-4)
    assert toolbox.within_for_good(toolbox.angle, np.radians(1)) == pytest.approx(0.34, abs=0.01)
    assert toolbox.angle[-1] < 1e-4


def test_inputs(toolbox):
    assert (toolbox.f.min(), toolbox.f.max()) == pytest.approx((0.502, 0.832), abs=5e-4)
    assert toolbox.thrust.min() == pytest.approx(0.125, abs=5e-4)
    assert toolbox.thrust.max() == pytest.approx(0.219, abs=5e-4)
    assert max(np.linalg.norm(law.U) for law in toolbox.laws) == pytest.approx(3.82, abs=5e-3)
    assert min(law.f_d[2] for law in toolbox.laws) == pytest.approx(0.986, abs=5e-4)


@pytest.mark.parametrize(('thrust_map', 'highest', 'lowest'), [
    ('linear', (334.8, 312.2, 319.0, 319.3), 192), ('power', (332.7, 317.2, 321.9, 322.1), 228)])
def test_pwm_of_the_four_motors(toolbox, thrust_map, highest, lowest):
    pwm = toolbox.pwm(setup('toolbox'), thrust_map)
    assert pwm.max(axis=0) == pytest.approx(np.array(highest), abs=0.06)
    assert pwm.min() == pytest.approx(lowest, abs=0.5)


def test_tilt_and_speed(toolbox):
    tilt = 2 * np.degrees(np.arcsin(np.hypot(toolbox.y[:, 7], toolbox.y[:, 8])))
    assert tilt.max() == pytest.approx(7.5, abs=0.05)
    assert np.linalg.norm(toolbox.y[:, 3:6], axis=1).max() == pytest.approx(1.61, abs=0.005)


def test_identified_vehicle_flies_the_same_path_with_more_thrust(toolbox):
    heavier = Flown(setup('frictionless'))
    np.testing.assert_allclose(heavier.y[:, :3], toolbox.y[:, :3], atol=1e-9)
    assert (heavier.f.min(), heavier.f.max()) == pytest.approx((0.542, 0.898), abs=5e-4)
    for thrust_map, highest in (('linear', 365.8), ('power', 353.4)):
        pwm = heavier.pwm(setup('frictionless'), thrust_map)
        assert pwm.max() == pytest.approx(highest, abs=0.06)


@pytest.mark.parametrize(('choice', 'position', 'attitude'), [
    ('analytic', 5.82, 0.34), ('no_acceleration', 5.83, 0.30), ('no_rates', 5.35, 3.8)])
def test_cheaper_derivatives(choice, position, attitude):
    flown = Flown(setup('toolbox', CascadedParams(derivatives=choice)))
    assert flown.within_for_good(flown.distance, 0.05) == pytest.approx(position, abs=0.02)
    reached = flown.within_for_good(flown.angle, np.radians(1))
    assert reached == pytest.approx(attitude, rel=0.06)
