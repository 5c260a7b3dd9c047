"""
Commands from streams of messages: sticks of a joystick, setpoints from outside.

A stream is thinned to a period of flight time. After a refusal, which costs the most time, it is
left alone for a moment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

from mambo_model.arithmetic.trigonometry import sin_cos
from mambo_model.frames import flip_vector
from mambo_model.motion.flatness import from_flat_output, Reference
from mambo_model.motion.flight_command import (
    FlightCommand, GO_TO, LAND, SETPOINT, STOP, TAKEOFF, VELOCITY)
from mambo_model.motion.polynomial import Array
from mambo_model.motion.quaternion import to_euler
from mambo_model.motion.vector import Vec3
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

from .command_params import CommandParams, JoystickParams
from .commander import Commander
from .maneuvers import extrapolated
from .timeline import state_of

REST = 200_000_000  # ns of flight time after a refusal
_CHANGE = 0.6  # s, that a change of velocity by up to 0.5 m/s takes; a larger one may take longer
_MARGIN = 0.005  # m before the edge of the volume, from where on a stick asks for nothing
LATE = 2  # setpoints in a row that may be old: the last of a stream and the first of the next one
Give = Callable[[FlightCommand], str]  # carries a command out; returns why it was refused


def sticks(axes: Sequence[float], p: JoystickParams) -> tuple[float, float, float, float] | None:
    """
    Return the velocity that the sticks ask for; None where an axis is missing or not a number.

    Parameters
    ----------
    axes
        As in ``sensor_msgs/Joy``, -1 to 1.
    p
        Which axis is which, and the speeds of a full stick.

    Returns
    -------
    forward, left, up : m/s, and turn to the left : rad/s

    """
    out = []
    for axis, full in ((p.forward, p.speed), (p.left, p.speed), (p.up, p.climb),
                       (p.turn, p.yaw_rate)):
        if axis >= len(axes) or not math.isfinite(axes[axis]):
            return None
        x = max(-1.0, min(1.0, float(axes[axis])))
        far = max(abs(x) - p.deadband, 0.0) / (1.0 - p.deadband)
        out.append(math.copysign(far * full, x) if far else 0.0)
    return out[0], out[1], out[2], out[3]


class Joystick:
    """
    Makes commands of the messages of a joystick.

    Parameters
    ----------
    commander
        Of the flight.
    params
        Of commands.
    give
        Carries a command out.

    """

    def __init__(self, commander: Commander, params: CommandParams, give: Give) -> None:
        self._commander, self._p, self._give = commander, params.joystick, give
        self._volume = params
        self._held = frozenset[int]()  # buttons of the message before
        self._due, self._active = 0, False  # ns; whether the vehicle follows the sticks

    def take(self, axes: Sequence[float], buttons: Sequence[int]) -> None:
        """Give the commands of one message, if any."""
        p = self._p
        held = frozenset(i for i, button in enumerate(buttons) if button)
        pressed, self._held = held - self._held, held
        if p.enable not in held:
            if self._active and self._commander.timeline.streamed:
                self._give(FlightCommand(0, STOP))
            self._active = False
            return
        if p.takeoff in pressed:
            self._give(FlightCommand(0, TAKEOFF, height=p.height))
        elif p.land in pressed:
            self._give(FlightCommand(0, LAND))
        elif (wanted := sticks(axes, p)) is not None and self._commander.next_step >= self._due:
            self._fly(wanted)

    def _slowed(self, state: Array, velocity: Vec3) -> Vec3:
        """
        Return a velocity, m/s inertial NED, that rest inside of the volume can follow.

        Parameters
        ----------
        state : (4, 5)
            Present reference.
        velocity : m/s
            As the sticks ask for it.

        """
        p, out = self._volume, []
        low, high = ((-p.x_limit, -p.y_limit, -p.ceiling), (p.x_limit, p.y_limit, -p.lowest))
        for axis, v in enumerate(velocity):
            x, before = float(state[axis, 0]), float(state[axis, 1])
            room = high[axis] - x if v > 0.0 else x - low[axis]
            room -= 0.5 * _CHANGE * max(math.copysign(before, before * v), 0.0)
            most = max(room - _MARGIN, 0.0) / (self._p.timeout + _CHANGE)
            out.append(max(-most, min(most, v)))
        return out[0], out[1], out[2]

    def _fly(self, wanted: tuple[float, float, float, float]) -> None:
        """Give a velocity; near the edge of the volume, what of it stays inside."""
        now = self._commander.next_step
        if self._active and not self._commander.timeline.streamed:
            return  # another command came in between: until the button is let go
        state, _ = state_of(self._commander.timeline, now * 1e-9)
        if not any(wanted) and (not self._active or not state[:, 1:].any()):
            return
        self._due = now + round(self._p.period * 1e9)
        yaw = float(state[3, 0])
        forward, right = wanted[0], -wanted[1]
        s, c = sin_cos(yaw)
        whole = self._slowed(state, (
            forward * c - right * s, forward * s + right * c, -wanted[2]))
        parts = [tuple(v if k != axis else 0.0 for k, v in enumerate(whole))
                 for axis in sorted(range(3), key=lambda axis: abs(whole[axis]))]
        for velocity in dict.fromkeys((whole, *parts)):
            if not self._give(FlightCommand(
                    0, VELOCITY, velocity=velocity, yaw_rate=-wanted[3],
                    duration=self._p.timeout)):
                self._active = True
                return
        self._due = now + REST


class Setpoints:
    """
    Makes commands of references from outside.

    Parameters
    ----------
    commander
        Of the flight.
    params
        Of commands.
    give
        Carries a command out.

    """

    def __init__(self, commander: Commander, params: CommandParams, give: Give) -> None:
        self._commander, self._give = commander, give
        self._period = round(params.setpoint_period * 1e9)
        self._timeout = round(params.setpoint_timeout * 1e9)
        self._due, self._last = 0, -self._timeout  # ns; of the newest message
        self._followed = False  # whether the vehicle follows, or did until another command came
        self._first = ''  # refusal of a setpoint that no other command was in the way of
        self._old, self._told = 0, 0  # old setpoints in a row, and how many of them are told
        self._old_from = 0  # ns, when the first of them came
        self._stale = ''  # refusal of an old setpoint

    def take(self, t: int, ref: Reference) -> dict[str, int]:
        """
        Give the command of a reference of the time t in ns, if one is due and it is not old.

        After another command the stream has to pause before it is followed again.

        Returns
        -------
        How many setpoints more are not followed, though the vehicle flies and no other command is
        in the way, by when and why the first one was not. Old setpoints count once they have come
        for the time after which the vehicle stops: a publisher that ends or that was late for a
        moment leaves some behind.

        """
        now = self._commander.next_step
        paused, self._last = now - self._last > self._timeout, now
        if paused:
            self._followed = False
        interrupted = self._followed and not self._commander.timeline.streamed
        if interrupted:
            return {}
        if now - t > self._timeout:
            return self._count_old(now, t) if self._commander.is_free(now) else {}
        self._old = self._told = 0
        if now < self._due:
            return {}
        wanted = np.zeros((4, 5))
        for order, vector in enumerate((ref.rho, ref.v, ref.a, ref.j, ref.s)):
            wanted[:3, order] = vector
        wanted[3, :2] = to_euler(ref.q)[2], ref.omega[2]
        there = extrapolated(wanted, (now - t) * 1e-9).tolist()
        vectors = [_vector(there, order) for order in range(5)]
        free = self._commander.is_free(now)
        reason = self._give(FlightCommand(0, SETPOINT, False, 0.0, 0.0, *vectors, there[3][0],
                                          there[3][1]))
        self._followed = self._followed or not reason
        self._due = now + (REST if reason else self._period)
        if not (reason and free):
            return {}
        self._first = self._first or (
            f'not followed, the first at t = {now * 1e-9:.3f} s: {reason}')
        return {self._first: 1}

    def _count_old(self, now: int, t: int) -> dict[str, int]:
        """Count one more old setpoint in a row; return what :meth:`take` does."""
        self._old_from, age = (self._old_from if self._old else now), (now - t) * 1e-9
        self._old += 1
        if self._old <= LATE or now - self._old_from <= self._timeout:
            return {}
        self._stale = self._stale or (
            f'not followed, the first at t = {self._old_from * 1e-9:.3f} s: stamped '
            f'{age:.3f} s before, limit {self._timeout * 1e-9:g} s: take the time of /clock')
        more, self._told = self._old - self._told, self._old
        return {self._stale: more}


def rehearse(params: CommandParams, vehicle: Vehicle) -> None:
    """Have in memory what commands of every kind call, before time starts."""
    commander = Commander(params, vehicle)

    def give(command: FlightCommand) -> str:
        """Carry a command out 10 s after the one before."""
        commander.advance(commander.t + 10_000_000_000)
        return commander.give(command)[1]
    for command in (FlightCommand(0, TAKEOFF, height=params.ceiling),
                    FlightCommand(0, GO_TO, position=(0.1, 0.0, -0.5 * params.ceiling)),
                    FlightCommand(0, VELOCITY, velocity=(0.1, 0.0, 0.0), duration=1.0)):
        give(command)
    stick = [0.0] * (params.joystick.forward + 1)
    stick[params.joystick.forward] = 0.5
    Joystick(commander, params, give).take(stick, [0] * params.joystick.enable + [1])
    v = vehicle.values()
    there = state_of(commander.timeline, commander.next_step * 1e-9)[0][:3, 0]
    zero = (0.0, 0.0, 0.0)
    Setpoints(commander, params, lambda one: commander.give(one)[1]).take(
        commander.next_step, from_flat_output(
            (float(there[0]), float(there[1]), float(there[2])), zero, zero, zero, zero, v.mass,
            v.inertia, v.gravity))
    commander.give(FlightCommand(0, STOP))
    commander.give(FlightCommand(0, LAND))


def _vector(rows: list[list[float]], order: int) -> Vec3:
    """Return a derivative of the position."""
    return rows[0][order], rows[1][order], rows[2][order]


def from_wire(goal: Vec3, yaw: float) -> tuple[Vec3, float]:
    """Return a position and yaw, z-up, as inertial NED."""
    return flip_vector(goal), -yaw
