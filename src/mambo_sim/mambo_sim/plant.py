"""
The vehicle as it moves: motors, rigid body with drag (3.3) and a flat floor, on a fixed grid.

The motor command is held over a control step; within it (3.3) is integrated with the classical
Runge-Kutta method. The floor is the plane rho_z = 0 of the inertial NED frame, so that the height
of the vehicle is h = -rho_z. It supports and stops the vehicle but never pushes it up: no spring,
no jitter.

A vehicle without options (None) is that of the thesis: motor map, (3.2), (3.13). None is a
separate type, so that code of unused options is not compiled.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model import forces
from mambo_model.aerodynamics import lumped_drag, through_air
from mambo_model.arithmetic.exponential import exp
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import (
    conjugate, exp_map, from_euler, multiply, normalise, Quat, rotate, rotate_inverse)
from mambo_model.motion.rigid_body import NORM_LIMIT, rk4_step, State
from mambo_model.motion.vector import add, hypot, norm, scale, sub, Vec3
from mambo_model.schema import choice, flag, ParameterError, quantity
from mambo_model.values import derived, Parameters, values_type
from mambo_model.vehicle.battery import supply
from mambo_model.vehicle.motor_mixer import faded, Four, limit_pwm, mix, thrust_from_pwm
from mambo_model.vehicle.parameters import OptionValues, VehicleValues

CONTROL_RATE = 200      # Hz, rate at which the motor command changes
NORMS = ('normalise', 'control', 'free')

FRICTION = 0.6          # Coulomb coefficient of the floor: plastic feet on a hall floor, assumed
CONTACT_TIME = 0.02     # s, over which feet and airframe spread the blow of a landing, assumed
RIGHTING_TIME = 0.05    # s, in which a tilted vehicle settles on its feet, assumed
TIP_OVER = 0.5          # cosine of the tilt beyond which it does not: it lies as it fell
LEVEL = 1e-4            # sine of the tilt taken for level

_ZERO: Vec3 = (0.0, 0.0, 0.0)


class PlantState(NamedTuple):
    """State of the plant."""

    body: State   # of the rigid body
    thrust: Four  # (4,) N, motors 1 to 4, as if far from the floor; rotor speeds follow from it
    jolt: Vec3    # (3,) m/s^2, body FRD, remaining contact acceleration of a touch-down
    lost: Four = (0.0, 0.0, 0.0, 0.0)  # (4,) share of thrust that each motor lost to fading
    charge: float = 0.0                # A s, drawn from the battery


@dataclass(frozen=True)
class PlantParams(Parameters):
    """Integration step of the plant, floor, and initial position and attitude."""

    physics_rate: int = quantity(
        1000, 'Hz', CONTROL_RATE, 10000, 'design choice: a multiple of the control rate of 200 Hz')
    ground: bool = flag(True, 'design choice: a floor at rho_z = 0')
    initial_position: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'm', -1000.0, 1000.0, 'inertial NED; (3.32a)')
    initial_euler: Vec3 = quantity(
        (0.0, 0.0, 0.0), 'rad', -math.pi, math.pi, 'roll, pitch, yaw (2.4); (3.32b)')
    floor_slope: tuple[float, float] = quantity(
        (0.0, 0.0), 'rad', -0.1, 0.1,
        'roll and pitch of a vehicle that stands on the floor, yaw 0: level in the thesis')
    norm: str = choice(
        'normalise', NORMS, 'length of q: set to 1 after each step, controlled (2.16), or free')
    norm_gain: float = quantity(
        250.0, '1/s', 0.0, 1e4, 'k of (2.16); a quarter of the rate of the physics')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.norm == 'control' and self.norm_gain >= NORM_LIMIT * self.physics_rate:
            raise ParameterError(
                f'norm_gain = {self.norm_gain:g} 1/s is not stable: it must be below '
                f'{NORM_LIMIT} times the physics_rate of {self.physics_rate} Hz')
        if self.physics_rate % CONTROL_RATE:
            raise ParameterError(
                f'physics_rate = {self.physics_rate} Hz must be a multiple of '
                f'{CONTROL_RATE} Hz')
        if self.ground and self.initial_position[2] > 0.0:
            raise ParameterError(
                f'initial_position = {self.initial_position} m is below the floor '
                'at rho_z = 0: make its third number 0 or negative, or switch ground off')

    @derived('', 'physics_rate')
    def substeps(self) -> int:
        """Steps of the physics in one control step."""
        return self.physics_rate // CONTROL_RATE

    @derived('1/s', 'norm', 'norm_gain')
    def length_gain(self) -> float | None:
        """Gain that controls the length of q; None: it is set to 1."""
        return {'normalise': None, 'control': float(self.norm_gain), 'free': 0.0}[self.norm]

    @derived('', 'initial_position', 'initial_euler', 'floor_slope')
    def floor(self) -> Quat | None:
        """Attitude, (4,) w x y z, of a vehicle that stands; None: level."""
        roll, pitch = map(float, self.floor_slope)
        if not self.ground or roll == pitch == 0.0:
            return None
        return from_euler(roll, pitch, 0.0)


PlantValues = values_type(PlantParams)


def initial(params: PlantParams) -> PlantState:
    """
    Return the vehicle at rest at its initial position and attitude, motors stopped (3.32).

    Where it stands on a floor that slopes, the attitude is relative to the floor.
    """
    phi, theta, psi = map(float, params.initial_euler)
    x, y, z = map(float, params.initial_position)
    q, floor = from_euler(phi, theta, psi), params.floor()
    if floor is not None and z == 0.0:
        q = multiply(floor, q)
    body = State((x, y, z), _ZERO, q, _ZERO)
    return PlantState(body, (0.0, 0.0, 0.0, 0.0), _ZERO)


@jit
def _motor_target(pwm: float, sag: float, vv: VehicleValues) -> float:
    """
    Return the thrust in N one motor tends to; 0, negative and NaN commands stop it.

    Sag is the voltage over that of the motor map.
    """
    if not pwm > 0.0:
        return 0.0
    return thrust_from_pwm(sag * limit_pwm(pwm, vv), vv)


@jit
def _targets(pwm: Four, sag: float, vv: VehicleValues) -> Four:
    """Return the thrusts in N that the motors tend to."""
    return (
        _motor_target(pwm[0], sag, vv), _motor_target(pwm[1], sag, vv),
        _motor_target(pwm[2], sag, vv), _motor_target(pwm[3], sag, vv))


@jit
def _supply(
    state: PlantState, pwm: Four, dt: float, vv: VehicleValues, options: OptionValues | None,
) -> tuple[Four, Four, float]:
    """
    Return the thrusts in N that the motors tend to, and what changes slowly at the end of dt s.

    That is the shares of thrust lost to fading and the charge in A s drawn from the battery;
    during the step they stay as they are.
    """
    if options is None:
        return _targets(pwm, 1.0, vv), state.lost, state.charge
    sag, charge, lost = 1.0, state.charge, state.lost
    if options.battery.enabled:
        voltage, current = supply(charge, state.thrust, options)
        sag = voltage / options.battery.reference_voltage
        charge += dt * current
    t = _targets(pwm, sag, vv)
    target = (
        (1.0 - lost[0]) * t[0], (1.0 - lost[1]) * t[1],
        (1.0 - lost[2]) * t[2], (1.0 - lost[3]) * t[3])
    p = options.fade
    if p.enabled:
        lost = (
            faded(lost[0], pwm[0], dt, p), faded(lost[1], pwm[1], dt, p),
            faded(lost[2], pwm[2], dt, p), faded(lost[3], pwm[3], dt, p))
    return target, lost, charge


@jit
def _blend(target: Four, start: Four, weight: float) -> Four:
    """Return target + weight (start - target), (4,)."""
    return (
        target[0] + weight * (start[0] - target[0]), target[1] + weight * (start[1] - target[1]),
        target[2] + weight * (start[2] - target[2]), target[3] + weight * (start[3] - target[3]))


@jit
def _lag(h: float, time_constant: float) -> tuple[float, float]:
    """Return the share of a deviation that a lag leaves after h s, and its mean over them."""
    if time_constant > 0.0:
        left = exp(-h / time_constant)
        return left, (1.0 - left) * time_constant / h
    return 0.0, 0.0


@jit
def _air(
    body: State, thrust: Four, vv: VehicleValues, ground: bool, options: OptionValues | None,
    wind: Vec3 | None,
) -> Vec3:
    """Return thrust and drag together, (3,) N, body FRD, at thrusts of (4,) N off the floor."""
    if options is None:
        f, _ = mix(thrust, vv)
        drag = lumped_drag(through_air(body.nu, body.q, wind), f, vv)
    else:
        rotors = forces.Rotors(thrust, 0.0, 0.0)  # their torques are no force
        f, _, drag = forces.forces(body, rotors, vv, options, ground, wind)
    return (drag[0], drag[1], drag[2] - f)


@jit
def _free_acceleration(body: State, air: Vec3, vv: VehicleValues) -> Vec3:
    """Return the acceleration without a floor, (3,) m/s^2 inertial, by a force in N (3.1b)."""
    return add((0.0, 0.0, vv.gravity), scale(1.0 / vv.mass, rotate(body.q, air)))


@jit
def _fly(
    body: State, mean: Four, before: Four, after: Four, h: float, vv: VehicleValues, ground: bool,
    options: OptionValues | None, norm_gain: float | None, wind: Vec3 | None,
) -> State:
    """Advance a vehicle in the air by h s; thrusts in N: mean, at the start and at the end."""
    if options is None:
        f, tau = mix(mean, vv)
        return rk4_step(body, f, tau, h, vv, norm_gain, wind)
    rotors = forces.rotors_in_step(mean, before, after, h, options)
    return forces.rk4_step(body, rotors, h, vv, options, ground, norm_gain, wind)


@jit
def _supported(body: State, velocity: Vec3, acceleration: Vec3) -> bool:
    """
    Return whether the floor carries the vehicle: it is on it and would go through it.

    Velocity in m/s and acceleration without a floor in m/s^2 are inertial NED. The tolerance of
    1e-9 m/s is for rounding between body and inertial axes.
    """
    return body.rho[2] >= 0.0 and velocity[2] >= -1e-9 and acceleration[2] >= 0.0


@jit
def _slow_down(velocity: Vec3, drop: float) -> Vec3:
    """Return the horizontal part of a velocity, (3,) m/s, its length less by drop, 0 at least."""
    speed = hypot(velocity[0], velocity[1])
    if speed <= drop:
        return (0.0, 0.0, 0.0)
    left = 1.0 - drop / speed
    return (left * velocity[0], left * velocity[1], 0.0)


@jit
def _settle(q: Quat, h: float) -> tuple[Quat, Vec3]:
    """
    Return attitude after h s on the floor, and the body rate, (3,) rad/s, at which it turned.

    The tilt decays with ``RIGHTING_TIME``; a vehicle beyond ``TIP_OVER`` stays as it lies.
    """
    down = rotate_inverse(q, (0.0, 0.0, 1.0))  # e3 in body axes: where b3 has to go
    if down[2] < TIP_OVER or (down[0] == 0.0 and down[1] == 0.0):
        return q, (0.0, 0.0, 0.0)
    if abs(down[0]) < LEVEL and abs(down[1]) < LEVEL:
        return normalise((q[0], 0.0, 0.0, q[3])), (0.0, 0.0, 0.0)
    omega = (-down[1] / RIGHTING_TIME, down[0] / RIGHTING_TIME, 0.0)
    return normalise(multiply(q, exp_map(scale(h, omega)))), omega


@jit
def _settle_on(q: Quat, h: float, floor: Quat | None) -> tuple[Quat, Vec3]:
    """Return what :func:`_settle` does, on a floor that slopes; None: level."""
    if floor is None:
        return _settle(q, h)
    relative, omega = _settle(multiply(conjugate(floor), q), h)
    return multiply(floor, relative), omega


@jit
def _rest(
    body: State, velocity: Vec3, acceleration: Vec3, h: float, floor: Quat | None,
) -> State:
    """Advance a vehicle that the floor carries by h s: Coulomb friction, settling on its feet."""
    pushed = add(velocity, scale(h, acceleration))
    moved = _slow_down(pushed, FRICTION * acceleration[2] * h)
    q, omega = _settle_on(body.q, h, floor)
    rho = (body.rho[0] + h * moved[0], body.rho[1] + h * moved[1], 0.0)
    return State(rho, rotate_inverse(q, moved), q, omega)


@jit
def _touch_down(body: State) -> tuple[State, Vec3]:
    """
    Return the state after an inelastic impact on the floor, and the change of velocity.

    The part of the velocity into the floor is lost, of the part along it as much as friction
    takes during the blow. Change of velocity: (3,) m/s, inertial NED.
    """
    velocity = rotate(body.q, body.nu)
    after = velocity
    if velocity[2] > 0.0:
        after = _slow_down(velocity, FRICTION * velocity[2])
    rho = (body.rho[0], body.rho[1], 0.0)
    return (
        State(rho, rotate_inverse(body.q, after), body.q, body.omega), sub(after, velocity))


@jit
def _fade(jolt: Vec3, blow: Vec3, q: Quat, dt: float) -> Vec3:
    """
    Return the contact acceleration of impacts in the next control step, (3,) m/s^2, body FRD.

    Blow: change of velocity in this step, (3,) m/s, inertial NED. Summed over time it is felt in
    full, spread over ``CONTACT_TIME``.
    """
    share = min(1.0, dt / CONTACT_TIME)
    felt = add(scale(1.0 - share, jolt), scale(share / dt, rotate_inverse(q, blow)))
    if norm(felt) < 1e-9:
        return (0.0, 0.0, 0.0)
    return felt


@jit
def advance(
    state: PlantState, pwm: Four, dt: float, substeps: int, vv: VehicleValues, ground: bool,
    options: OptionValues | None = None, norm_gain: float | None = None,
    wind: Vec3 | None = None, floor: Quat | None = None,
) -> PlantState:
    """
    Advance the plant by one control step, the motor command held.

    Thrust follows the command by a first-order lag, solved exactly; within a step of the physics
    the body feels its mean. With the floor, the vehicle rests on it, slides to a stop, settles
    on its feet and takes off when its thrust exceeds its weight.

    Parameters
    ----------
    state
        At the start of the step.
    pwm : (4,) PWM, motors 1 to 4
        Cut to the limits of the vehicle; 0, a negative number or NaN stops the motor.
    dt : s
        Length of the step, > 0.
    substeps
        Runge-Kutta steps in it, >= 1.
    vv
        The true vehicle.
    ground
        Whether there is a floor at rho_z = 0.
    options
        Of the true vehicle; without any: none.
    norm_gain : 1/s
        Of the control of the quaternion's norm (2.16); without: its norm is set to 1.
    wind : (3,) m/s, inertial NED
        Velocity of the air during the step; without: it is still.
    floor : (4,) w x y z
        Attitude of a vehicle that stands on the floor, yaw 0; without: level.

    """
    h = dt / substeps
    target, lost, charge = _supply(state, pwm, dt, vv, options)
    at_end, on_average = _lag(h, vv.motor_time_constant)
    body, thrust, blow = state.body, state.thrust, (0.0, 0.0, 0.0)
    for _ in range(substeps):
        before, mean = thrust, _blend(target, thrust, on_average)
        thrust = _blend(target, thrust, at_end)
        if ground and body.rho[2] >= 0.0:
            velocity, air = rotate(body.q, body.nu), _air(body, mean, vv, ground, options, wind)
            acceleration = _free_acceleration(body, air, vv)
            if _supported(body, velocity, acceleration):
                body = _rest(body, velocity, acceleration, h, floor)
                continue
        body = _fly(body, mean, before, thrust, h, vv, ground, options, norm_gain, wind)
        if ground and body.rho[2] > 0.0:
            body, change = _touch_down(body)
            blow = add(blow, change)
    return PlantState(body, thrust, _fade(state.jolt, blow, body.q, dt), lost, charge)


@jit
def spin(
    state: PlantState, pwm: Four, dt: float, substeps: int, vv: VehicleValues,
    options: OptionValues | None = None,
) -> PlantState:
    """Return the plant after a control step of the motors alone; arguments of :func:`advance`."""
    target, lost, charge = _supply(state, pwm, dt, vv, options)
    at_end, _ = _lag(dt / substeps, vv.motor_time_constant)
    thrust = state.thrust
    for _ in range(substeps):
        thrust = _blend(target, thrust, at_end)
    return PlantState(state.body, thrust, state.jolt, lost, charge)


@jit
def specific_force(
    state: PlantState, vv: VehicleValues, ground: bool, options: OptionValues | None = None,
    wind: Vec3 | None = None,
) -> Vec3:
    """
    Return the acceleration besides gravity, (3,) m/s^2, body FRD: what an accelerometer feels.

    ``(F_D - f e3)/m`` in the air, plus the reaction of the floor on it: (0, 0, -g) at rest and
    level, 0 in free fall.

    Parameters
    ----------
    state
        Of the plant.
    vv
        The true vehicle.
    ground
        Whether there is a floor at rho_z = 0.
    options
        Of the true vehicle; without any: none.
    wind : (3,) m/s, inertial NED
        Velocity of the air; without: it is still.

    """
    body = state.body
    air = _air(body, state.thrust, vv, ground, options, wind)
    felt = add(scale(1.0 / vv.mass, air), state.jolt)
    if not (ground and body.rho[2] >= 0.0):
        return felt
    velocity, acceleration = rotate(body.q, body.nu), _free_acceleration(body, air, vv)
    if not _supported(body, velocity, acceleration):
        return felt
    return add(felt, rotate_inverse(body.q, _reaction(velocity, acceleration)))


@jit
def _reaction(velocity: Vec3, acceleration: Vec3) -> Vec3:
    """Return what the floor adds to the free acceleration, (3,) m/s^2, inertial NED."""
    grip = FRICTION * acceleration[2]
    speed = hypot(velocity[0], velocity[1])
    if speed > 0.0:
        return (-grip * velocity[0] / speed, -grip * velocity[1] / speed, -acceleration[2])
    push = hypot(acceleration[0], acceleration[1])
    hold = 1.0 if push <= grip else grip / push
    return (-hold * acceleration[0], -hold * acceleration[1], -acceleration[2])
