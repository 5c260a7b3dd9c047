"""
Sag of the supply: a cell whose voltage falls with its charge and with the current drawn.

The motor command is a share of the supply, so a motor at the command X and the voltage V does what
it did at X V/V_ref when its map was measured at V_ref. Not in the thesis.
"""

from __future__ import annotations

import math

from ..compiled import jit
from .motor_mixer import Four
from .parameters import OptionValues
from .vehicle_options import BatteryValues


@jit
def open_voltage(charge: float, p: BatteryValues) -> float:
    """
    Return the voltage without load in V, linear between full and empty.

    A drained cell gives nothing: its protection circuit opens.

    Parameters
    ----------
    charge : A s
        Drawn since it was full.
    p
        The battery.

    """
    used = charge / (3600.0 * p.capacity)
    if used >= 1.0:
        return 0.0
    return p.full_voltage + used * (p.empty_voltage - p.full_voltage)


@jit
def electric_power(thrust: Four, options: OptionValues) -> float:
    """Return the power in W that four thrusts, (4,) N, take: ideal power T v_i over efficiency."""
    total = 0.0
    for j in range(4):
        t = max(thrust[j], 0.0)
        total += t * math.sqrt(t)
    ideal = total / (options.rotor.radius * math.sqrt(2.0 * math.pi * options.air_density))
    return ideal / options.battery.efficiency


@jit
def supply(charge: float, thrust: Four, options: OptionValues) -> tuple[float, float]:
    """
    Return voltage in V and current in A of the battery under load.

    They solve V = V_0 - I r with V I the power of the rotors; of more power than V_0^2/(4 r) the
    battery gives that.

    Parameters
    ----------
    charge : A s
        Drawn since it was full.
    thrust : (4,) N
        Which the power is for.
    options
        Of the vehicle.

    """
    r, open_v = options.battery.resistance, open_voltage(charge, options.battery)
    if open_v == 0.0:
        return 0.0, 0.0
    power = electric_power(thrust, options)
    if r > 0.0:
        power = min(power, 0.25 * open_v * open_v / r)
    voltage = 0.5 * (open_v + math.sqrt(max(open_v * open_v - 4.0 * r * power, 0.0)))
    return voltage, power / voltage
