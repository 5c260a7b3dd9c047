"""The supply against its own circuit, energy, and the flight times that makers advertise."""

import dataclasses

from mambo_model.aerodynamics import induced_velocity
from mambo_model.schema import ParameterError
from mambo_model.vehicle import battery
from mambo_model.vehicle.parameters import preset
from mambo_model.vehicle.vehicle_options import BatteryParams
import pytest
from scipy.optimize import brentq

HOVER = 0.068 * 9.81 / 4.0


def options(name='identified', **changes):
    vehicle = preset(name)
    return dataclasses.replace(vehicle, battery=dataclasses.replace(
        vehicle.battery, enabled=True, **changes)).options()


def test_open_voltage_falls_from_full_to_empty_and_then_is_gone():
    p = options().battery
    half, whole = 0.5 * 0.66 * 3600.0, 0.66 * 3600.0
    assert battery.open_voltage(0.0, p) == 4.2
    assert battery.open_voltage(half, p) == pytest.approx(3.8)
    assert battery.open_voltage(whole * (1.0 - 1e-9), p) == pytest.approx(3.4)
    assert battery.open_voltage(whole, p) == battery.open_voltage(2.0 * whole, p) == 0.0


def test_power_is_that_of_the_air_over_the_efficiency():
    thrust = (0.1, 0.15, 0.2, 0.0)
    of_air = sum(t * induced_velocity(t, 0.0, 0.0, 0.033, 1.184) for t in thrust)
    assert battery.electric_power(thrust, options()) == pytest.approx(of_air / 0.2, rel=1e-12)


@pytest.mark.parametrize('charge', [0.0, 1000.0, 2300.0])
@pytest.mark.parametrize('thrust', [0.0, HOVER, 0.3])
def test_voltage_and_current_close_the_circuit(charge, thrust):
    o = options()
    power = battery.electric_power((thrust,) * 4, o)
    open_v = battery.open_voltage(charge, o.battery)
    voltage, current = battery.supply(charge, (thrust,) * 4, o)
    exact = brentq(lambda v: v * (open_v - v) / 0.075 - power, 0.5 * open_v, 5.0, xtol=1e-14)
    assert voltage == pytest.approx(exact, rel=1e-12)
    assert voltage * current == pytest.approx(power, rel=1e-12, abs=1e-15)


def test_drop_in_hover_is_as_seen_in_rolling_spider_flights():
    voltage, current = battery.supply(0.0, (HOVER,) * 4, options('rolling_spider'))
    assert 0.25 < 4.2 - voltage < 0.38
    assert current == pytest.approx(4.0, rel=0.1)


def test_battery_gives_no_more_than_its_best():
    voltage, current = battery.supply(0.0, (5.0,) * 4, options())
    assert voltage == 2.1  # half, where V (V_0 - V)/r is largest
    assert current == pytest.approx(2.1 / 0.075, rel=1e-12)


def test_battery_without_resistance_does_not_sag():
    o = options(resistance=0.0)
    voltage, current = battery.supply(0.0, (HOVER,) * 4, o)
    assert voltage == 4.2
    assert current == pytest.approx(battery.electric_power((HOVER,) * 4, o) / 4.2, rel=1e-14)


def test_drained_battery_gives_nothing():
    assert battery.supply(0.66 * 3600.0, (HOVER,) * 4, options()) == (0.0, 0.0)


@pytest.mark.parametrize('name, minutes', [
    ('rolling_spider', 8.0), ('crazyflie', 7.0)])
def test_hovers_as_long_as_advertised(name, minutes):
    o, vehicle, charge, seconds = options(name), preset(name), 0.0, 0
    thrust = (0.25 * vehicle.mass * vehicle.gravity,) * 4
    while battery.open_voltage(charge, o.battery) > 0.0:
        charge += battery.supply(charge, thrust, o)[1]
        seconds += 1
    assert seconds / 60.0 == pytest.approx(minutes, rel=0.06)  # advertised in whole minutes


def test_empty_must_be_below_full():
    with pytest.raises(ParameterError, match=r'empty_voltage = 4.2 V must be below full_voltage'):
        BatteryParams(empty_voltage=4.2)
