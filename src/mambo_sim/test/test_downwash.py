"""The jet below a vehicle: its limits, its momentum, and the thrust that it costs."""

import math

from mambo_model.vehicle.parameters import Vehicle
from mambo_sim import downwash
from mambo_sim.downwash import DownwashParams, induced_velocity, speed, thrust_losses, vehicle_row
import numpy as np
import pytest

VALUES = DownwashParams().values()
LENGTH, AREA, DENSITY = ROW = vehicle_row(Vehicle())
WEIGHT = Vehicle().mass * Vehicle().gravity
HOVER = induced_velocity(WEIGHT, AREA, DENSITY)


def losses(*places, thrust=WEIGHT, down=(0.0, 0.0, 1.0)):
    n = len(places)
    return thrust_losses(
        np.array(places, dtype=float), np.tile(down, (n, 1)), np.full(n, float(thrust)),
        np.tile(ROW, (n, 1)), VALUES)


def test_the_induced_velocity_is_that_of_momentum_theory():
    # actuator discs: T = 2 rho A U^2
    assert 2.0 * DENSITY * AREA * HOVER**2 == pytest.approx(WEIGHT, rel=1e-12)
    assert induced_velocity(-1.0, AREA, DENSITY) == 0.0


@pytest.mark.parametrize('distance', [2.5, 5.0, 10.0])
def test_the_centre_line_has_the_published_velocity(distance):
    # arXiv 2403.13321: U_c / U_H = 10.11 / (s/l + 5.817)
    found = speed(distance * LENGTH, 0.0, HOVER, LENGTH, VALUES)
    assert found / HOVER == pytest.approx(10.11 / (distance + 5.817), rel=1e-12)


@pytest.mark.parametrize('distance', [2.5, 8.0])
def test_at_the_half_width_the_velocity_is_half(distance):
    half = LENGTH * 0.07668 * (distance + 5.817)
    on, off = (speed(distance * LENGTH, r, HOVER, LENGTH, VALUES) for r in (0.0, half))
    assert off / on == pytest.approx(0.5, rel=1e-12)


def test_the_jet_keeps_its_momentum_and_has_most_of_the_thrust():
    def momentum(s):
        r = np.linspace(0.0, 20.0, 200_001)
        u = np.array([speed(s, x, HOVER, LENGTH, VALUES) for x in r.tolist()])
        return DENSITY * np.trapezoid(2.0 * math.pi * r * u * u, r)
    near, far = momentum(2.5 * LENGTH), momentum(12.0 * LENGTH)
    assert near == pytest.approx(far, rel=1e-4)  # a free jet: constant along s
    # the fit is of six other drones: for the Mambo it holds 0.87 of the thrust
    assert near / WEIGHT == pytest.approx(0.865, abs=0.005)


def test_nothing_is_felt_above_or_far_away():
    assert speed(-1e-9, 0.0, HOVER, LENGTH, VALUES) == speed(0.0, 0.0, HOVER, LENGTH, VALUES) == 0
    assert speed(0.5, 10.0, HOVER, LENGTH, VALUES) < 1e-5 * HOVER
    assert speed(1e4, 0.0, HOVER, LENGTH, VALUES) < 1e-3 * HOVER


def test_the_lower_vehicle_loses_thrust_and_the_upper_one_none():
    upper, lower = losses((0.0, 0.0, -2.0), (0.0, 0.0, -1.5))
    flow = speed(0.5, 0.0, HOVER, LENGTH, VALUES)
    assert upper == 0.0
    assert lower == pytest.approx(0.07 * flow * WEIGHT, rel=1e-12)
    assert 0.1 * WEIGHT < lower < 0.5 * WEIGHT


def test_jets_add_up_and_stopped_or_turned_rotors_blow_elsewhere():
    one = losses((0.1, 0.0, -2.0), (0.0, 0.0, -1.5))[1]
    both = losses((0.1, 0.0, -2.0), (0.0, 0.0, -1.5), (-0.1, 0.0, -2.0))[1]
    assert both == pytest.approx(2.0 * one, rel=1e-12)
    assert not losses((0.0, 0.0, -2.0), (0.0, 0.0, -1.5), thrust=0.0).any()
    level = losses((0.0, 0.0, -2.0), (0.0, 0.0, -1.5), down=(1.0, 0.0, 0.0))
    assert not level.any()  # both lie on their sides: the jet is horizontal


def test_no_vehicle_loses_more_than_its_thrust():
    strong = DownwashParams(thrust_loss=1.0).values()
    found = thrust_losses(
        np.array([[0.0, 0.0, -2.0], [0.0, 0.0, -1.9]]), np.tile((0.0, 0.0, 1.0), (2, 1)),
        np.full(2, WEIGHT), np.tile(ROW, (2, 1)), strong)
    assert found.tolist() == [0.0, WEIGHT]


def test_it_is_off_by_default():
    assert not downwash.DownwashParams().enabled
