"""
Parameters of effects beyond (3.1): rotors, drag by parts, ground effect, thrust fade, battery.

All of them are off by default: thrust then follows the motor map, and (3.13) is the only drag. The
thesis gives none of these numbers. A value whose source says assumed is a guess of the right
order of magnitude. The others come from the support package and motor bench of the Rolling Spider
(EduDroneToolbox, Parrot-Developers/RollingSpiderEdu), whose rotors have the same arm, yaw ratio
and thrust as those of the Mambo.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..motion.vector import Vec3
from ..schema import choice, flag, ParameterError, quantity
from ..values import Parameters, values_type

PROFILES = ('none', 'linear', 'blade_element')
PROFILE_NONE, PROFILE_LINEAR, PROFILE_BLADE_ELEMENT = range(len(PROFILES))


@dataclass(frozen=True)
class RotorParams(Parameters):
    """One of the four equal rotors with two blades."""

    radius: float = quantity(0.033, 'm', 0.005, 0.5, 'R of (3.8): toolbox of the Rolling Spider')
    chord: float = quantity(0.008, 'm', 0.001, 0.1, 'c of (3.8): toolbox of the Rolling Spider')
    pitch: float = quantity(
        0.1527, 'rad', 0.0, 0.8,
        'blade angle at 3/4 of the radius: toolbox of the Rolling Spider, 14.6 to 6.8 deg')
    speed_coefficient: float = quantity(
        4.74e-8, 'N s^2', 1e-10, 1e-3, 'k of T = k Omega^2: bench of the Rolling Spider')
    inertia: float = quantity(
        1.36e-7, 'kg m^2', 0.0, 1e-3,
        'about its axis: slender rod of 66 mm and 0.375 g, a quarter of the 1.5 g of blades that '
        'the toolbox of the Rolling Spider has')
    torques: bool = flag(
        False,
        'reaction of rotors that change speed, gyroscopic torque; the thesis has none. Needs a '
        'lag of the motors, as a rotor that jumps to its speed kicks the vehicle')


RotorValues = values_type(RotorParams)


@dataclass(frozen=True)
class DragParams(Parameters):
    """
    Parts of the drag (3.12), which add to each other and to (3.13), and their coefficients.

    Up to ``slow_limit`` the sum of the first four equals (3.13) with the k_c of (3.11), which is
    0.22 s/m with the defaults. To use the parts in place of (3.13), set ``drag_reading`` to
    ``none``.
    """

    blade_flapping: bool = flag(False, 'design choice: (3.4)')
    flapping_velocity: float = quantity(
        0.0066, 's/m', 0.0, 1.0,
        'A_1c of (3.4): hinged blades with the blade angles of the Rolling Spider in hover')
    flapping_rate: float = quantity(
        26.4, '1', 0.0, 100.0,
        'B_flap of (3.4): hinged blades, 16 over the Lock number of the Rolling Spider')
    induced: bool = flag(False, 'design choice: (3.5)')
    induced_coefficient: float = quantity(
        0.0223, 's/m', 0.0, 1.0, 'k_I of (3.5), assumed: half of what is left of k_c = 0.22')
    translational: bool = flag(False, 'design choice: (3.6) up to slow_limit, (3.7) beyond')
    translational_coefficient: float = quantity(
        0.0223, 's/m', 0.0, 1.0, 'k_T1 of (3.6), assumed: half of what is left of k_c = 0.22')
    translational_fast: float = quantity(
        0.0, 's^5/m^5', 0.0, 10.0, 'k_T2 of (3.7); 0: what joins (3.6) at slow_limit')
    slow_limit: float = quantity(
        4.5, 'm/s', 0.1, 50.0, 'w of (3.7), assumed: the induced velocity in hover')
    profile: str = choice('none', PROFILES, 'design choice: (3.9) or (3.8)')
    profile_coefficient: float = quantity(
        0.0038, 's/m', 0.0, 1.0, 'k_p of (3.9): (3.8) in hover with the values below')
    profile_zero: float = quantity(
        0.04, '1', 0.0, 1.0, 'c_d0 of (3.8), assumed: thin blade at a Reynolds number of 30000')
    profile_slope: float = quantity(
        0.3, '1/rad', 0.0, 10.0, 'c_d_alpha of (3.8), assumed: 0.05 at an incidence of 10 deg')
    parasitic: bool = flag(False, 'design choice: (3.10)')
    parasitic_coefficient: Vec3 = quantity(
        (0.0014, 0.0014, 0.004), 'kg/m', 0.0, 1.0,
        'K_par of (3.10), assumed: drag coefficient 1 of 24 cm^2, from above 1.1 of 62 cm^2')


DragValues = values_type(DragParams)


@dataclass(frozen=True)
class GroundEffectParams(Parameters):
    """Thrust that rotors gain near the floor."""

    enabled: bool = flag(False, 'thesis sec. 3.2.7 neglects it')
    rotor_height: float = quantity(
        0.03, 'm', 0.005, 1.0, 'of the rotors above the floor, vehicle on its feet; assumed')


GroundEffectValues = values_type(GroundEffectParams)


@dataclass(frozen=True)
class FadeParams(Parameters):
    """Thrust that a motor slowly loses while its command is high, and regains afterwards."""

    enabled: bool = flag(False, 'design choice: seen on the bench, thesis sec. 4.4.2')
    pwm: float = quantity(350.0, 'PWM', 0.0, 65535.0, 'above it thrust fades, thesis sec. 4.4.2')
    loss: float = quantity(
        0.07, '1', 0.0, 0.9, 'share of thrust lost in the end, assumed: the thesis gives none')
    time_constant: float = quantity(
        2.0, 's', 0.01, 600.0, 'assumed: the thesis says rapidly, with readings of a scale')


FadeValues = values_type(FadeParams)


@dataclass(frozen=True)
class BatteryParams(Parameters):
    """A lithium-polymer cell: open-circuit voltage that falls with use, and a resistance."""

    enabled: bool = flag(False, 'design choice: false means a supply that does not sag')
    capacity: float = quantity(0.66, 'A h', 0.01, 100.0, "maker's figure, not checked")
    full_voltage: float = quantity(4.2, 'V', 1.0, 100.0, 'lithium-polymer cell')
    empty_voltage: float = quantity(
        3.4, 'V', 1.0, 100.0, 'lithium-polymer cell, at rest and drained; assumed')
    resistance: float = quantity(
        0.075, 'ohm', 0.0, 10.0,
        'drop of 0.25 to 0.38 V at take-off in Rolling Spider flights, at 4 A')
    reference_voltage: float = quantity(
        3.7, 'V', 1.0, 100.0, 'under load, at which the motor map holds; assumed: nominal voltage')
    efficiency: float = quantity(
        0.2, '1', 0.01, 1.0,
        'ideal power of the rotors over electric power: the Rolling Spider is advertised with 8 '
        'minutes of flight and has 0.55 A h')

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.empty_voltage < self.full_voltage:
            raise ParameterError(
                f'empty_voltage = {self.empty_voltage:g} V must be below '
                f'full_voltage = {self.full_voltage:g} V')


BatteryValues = values_type(BatteryParams)
