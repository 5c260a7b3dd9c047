"""
Battery sag: a cell whose voltage falls with the charge used and with the current drawn.

The motor command is a share of the supply voltage. A motor with command X at voltage V therefore
behaves as with command X V/V_ref at the voltage V_ref at which its map was measured. The thesis
does not model this.
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
    Return the open-circuit voltage in V, linear between full and empty.

    A drained cell gives 0 V, because its protection circuit opens.

    Parameters
    ----------
    charge : A s
        Charge drawn since the cell was full.
    p
        The battery.

    """
    used = charge / (3600.0 * p.capacity)
    if used >= 1.0:
        return 0.0
    return p.full_voltage + used * (p.empty_voltage - p.full_voltage)


@jit
def electric_power(thrust: Four, options: OptionValues) -> float:
    """Return the electric power for four thrusts, (4,) N: ideal power T v_i over efficiency, W."""
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

    They solve V = V_0 - I r, where V I is the power of the rotors. The power is limited to
    V_0^2/(4 r), the most that the battery can deliver.

    Parameters
    ----------
    charge : A s
        Charge drawn since the cell was full.
    thrust : (4,) N
        Thrusts of the motors.
    options
        Options of the vehicle.

    """
    r, open_v = options.battery.resistance, open_voltage(charge, options.battery)
    if open_v == 0.0:
        return 0.0, 0.0
    power = electric_power(thrust, options)
    if r > 0.0:
        power = min(power, 0.25 * open_v * open_v / r)
    voltage = 0.5 * (open_v + math.sqrt(max(open_v * open_v - 4.0 * r * power, 0.0)))
    return voltage, power / voltage
