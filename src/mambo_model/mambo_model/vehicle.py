"""
Parameters of the vehicle: one declaration for the true one and for the believed one.

Holds the numbers of (3.1)-(3.3), (3.13), (4.4), (4.5) and (4.7), with unit, range and source.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from .schema import check, choice, ParameterError, quantity, values
from .vector import Vec3

THRUST_MAPS = ('linear', 'power')
THRUST_LINEAR, THRUST_POWER = range(len(THRUST_MAPS))

DRAG_READINGS = ('none', 'per_rotor_thrust', 'total_thrust', 'force', 'acceleration')
DRAG_NONE, DRAG_PER_ROTOR, DRAG_TOTAL, DRAG_FORCE, DRAG_ACCELERATION = range(len(DRAG_READINGS))


class VehicleValues(NamedTuple):
    """A :class:`Vehicle` as compiled code reads it; the two names are indices."""

    mass: float
    inertia: Vec3
    gravity: float
    arm: float
    yaw_ratio: float
    thrust_map: int
    linear_gain: float
    power_a: float
    power_b: float
    pwm_min: float
    pwm_max: float
    motor_time_constant: float
    drag_reading: int
    drag_coefficient: float


@dataclass(frozen=True)
class Vehicle:
    """
    Parrot Mambo as identified: weighed mass, pendulum inertia, measured motor map, rotor drag.

    The measured inertia is kept as published although its largest value exceeds the sum of the
    other two by 2 %, the spread of the measurement.
    """

    mass: float = quantity(0.068, 'kg', 0.01, 1.0, 'weighed, thesis sec. 4.4')
    inertia: Vec3 = quantity(
        (0.69e-4, 0.775e-4, 1.5e-4), 'kg m^2', 1e-6, 1e-2,
        'bifilar pendulum, thesis table 4.2; principal axes along body axes')
    gravity: float = quantity(9.81, 'm/s^2', 9.7, 9.9, 'standard value; the thesis gives none')
    arm: float = quantity(
        0.0441234, 'm', 0.005, 0.5,
        'rotor to body x and y axes, (3.2): 1/(4 * 5.66592) of the support package, (4.4)')
    yaw_ratio: float = quantity(
        0.00241374, 'm', 1e-4, 0.1,
        'yaw torque per thrust, d of (3.2): 1/(4 * 103.573624) of the support package, (4.4)')
    thrust_map: str = choice('power', THRUST_MAPS, 'PWM to thrust: (4.5) or 1/linear_gain')
    linear_gain: float = quantity(
        1530.72681, 'PWM/N', 100.0, 10000.0, 'support package, thesis sec. 4.4.2')
    power_a: float = quantity(4.29e-5, 'N', 1e-7, 1e-2, 'a of (4.5), thesis sec. 4.4.2')
    power_b: float = quantity(1.47, '1', 0.5, 3.0, 'b of (4.5), thesis sec. 4.4.2')
    pwm_min: float = quantity(10.0, 'PWM', 0.0, 500.0, 'limit in the support package')
    pwm_max: float = quantity(500.0, 'PWM', 1.0, 1000.0, 'limit in the support package')
    motor_time_constant: float = quantity(
        0.0, 's', 0.0, 1.0, 'none identified; 0 makes thrust follow at once')
    drag_reading: str = choice(
        'per_rotor_thrust', DRAG_READINGS,
        'meaning of T in (3.13); only the thrust of one rotor agrees with (3.11) and (3.12)')
    drag_coefficient: float = quantity(
        0.22, 's/m', 0.0, 10.0,
        'k_c, thesis sec. 6.3; kg/s under the reading force, 1/s under acceleration')

    def __post_init__(self) -> None:
        check(self)
        if not self.pwm_min < self.pwm_max:
            raise ParameterError(
                f'Vehicle.pwm_min = {self.pwm_min:g} PWM must be below '
                f'pwm_max = {self.pwm_max:g} PWM')

    def values(self) -> VehicleValues:
        """Return what compiled code reads: names as indices, numbers as they are."""
        return VehicleValues(*values(self, VehicleValues._fields))


PRESETS: dict[str, Vehicle] = {
    'identified': Vehicle(),
    'toolbox': Vehicle(
        mass=0.063, inertia=(0.5829e-4, 0.7169e-4, 1.0e-4), thrust_map='linear',
        drag_reading='none'),
    'frictionless': Vehicle(drag_reading='none'),
}


def preset(name: str) -> Vehicle:
    """
    Return a vehicle by name: ``identified``, ``toolbox`` (support package), ``frictionless``.

    Raises
    ------
    ParameterError
        Naming the known vehicles.

    """
    if name not in PRESETS:
        raise ParameterError(f'vehicle {name!r} is unknown; known: {", ".join(PRESETS)}')
    return PRESETS[name]
