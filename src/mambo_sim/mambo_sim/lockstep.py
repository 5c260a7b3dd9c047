"""
Lockstep protocol and real-time pacing of a simulated flight.

In lockstep, each step publishes the sensors with a watermark, waits for the motor command with the
stamp of the step, and then advances the vehicle. In real time each step waits for the wall clock.
``sim`` is the simulator's node, or those of a hall as one, ``sim.drones`` its nodes, one for each
drone, and ``loop`` serves their messages (``once(timeout)``, ``stopping``).
"""

from __future__ import annotations

import time
from typing import Any

from .delays import Delays
from .parameters import STEP_NS

_ASK_AGAIN = 5.0  # s of wall time between log lines that name the missing motor command
MOST_STEPS = 1_000_000  # of one request, while paused
SILENT = 200  # steps without any motor command, after which none is waited for
BEHIND = 0.01  # s of wall time by which a step may end late to get its motor command (judgement)
LONGEST = 1.0  # s between looks at the wall clock of a process that runs (judgement)
NOT_RUN = 0.1  # s between looks at the wall clock that only a stopped process takes (judgement)
LATE = 0.05  # [-] of the wall time that a flight in real time takes longer than asked for


class Pause:
    """
    Whether a simulation goes on, and how many steps a paused one is still to make.

    Parameters
    ----------
    paused
        At the beginning.
    duration : s
        Of the flight; 0: until stopped.

    """

    def __init__(self, paused: bool, duration: float = 0.0) -> None:
        self.paused, self._steps = paused, 0
        self._end = round(duration * 1e9)  # ns; 0: none

    def set(self, paused: bool) -> str:
        """Pause or go on; return what it is now."""
        self.paused, self._steps = paused, 0
        return 'paused' if paused else 'going on'

    def step(self, steps: int, t: int) -> tuple[bool, str]:
        """
        Ask for steps of a paused simulation.

        Parameters
        ----------
        steps
            How many more; 0: one.
        t : ns
            Of the next one.

        Returns
        -------
        success
            Whether they will be made.
        message
            Until when, or why not.

        """
        if not self.paused:
            return False, 'the simulation is not paused'
        if self._steps + steps > MOST_STEPS:
            return False, f'{self._steps + steps} steps to be made, limit {MOST_STEPS}'
        self._steps += max(steps, 1)
        until = t + (self._steps - 1) * STEP_NS
        if 0 < self._end <= until:
            return True, f'to t = {self._end * 1e-9:.3f} s, the end of the flight'
        return True, f'to t = {until * 1e-9:.3f} s'

    def due(self) -> bool:
        """Return whether the next step is to be made, which then counts."""
        if not self.paused:
            return True
        self._steps -= bool(going := self._steps > 0)
        return going


class Limit:
    """
    Logs the first motor command that is above the limit of the vehicle.

    Parameters
    ----------
    sim
        Node of the simulator.

    """

    def __init__(self, sim: Any) -> None:
        self._sim, self._told = sim, False

    def look(self, t: int, pwm: tuple) -> None:
        """Look at a motor command, (4,) PWM, with the stamp t in ns."""
        limit = self._sim.params.simulator.vehicle.pwm_max
        if max(pwm) > limit and not self._told:
            self._told = True
            self._sim.get_logger().warning(
                f'motor_pwm of t = {t * 1e-9:.3f} s is {max(pwm):g}, above pwm_max of the '
                f'vehicle: it and later ones are limited to {limit:g}')


def status(missed: int, starved: int, limit: float) -> tuple[int, str]:
    """
    Return level (0 OK, 1 warning, 2 error) and text of the simulator's diagnostic status.

    Parameters
    ----------
    missed
        Steps without their motor command.
    starved : ns
        Time at which the motors were stopped because no command came; -1: not stopped.
    limit : s
        Wall time for which a motor command may be missing.

    """
    if starved >= 0:
        return 2, f'motors stopped at t = {starved * 1e-9:.3f} s: no motor command for {limit:g} s'
    if missed:
        return 1, f'{missed} steps without their motor command'
    return 0, 'flying'


def numbers(mode: str, steps: int, missed: int, delays: Delays) -> dict[str, Any]:
    """Return the values of that status; wall times, which never repeat, only in real time."""
    out = {'mode': mode, 'steps': steps, 'missed': missed}
    if mode == 'realtime':
        out |= {f'IMU to motor command, {name} [ms]': value
                for name, value in delays.values().items()}
    return out


def answers(missed: int, late: int) -> str:
    """Return in words how many steps were without their motor command, or waited for it."""
    waited = f', {late} waited for a late one' if late else ''
    return f'{missed} steps without their motor command{waited}'


def wait_for_answer(sim: Any, loop: Any) -> bool:
    """
    Serve the graph until the step's motor command has arrived (lockstep).

    Of a time in which this process did not run, as it was suspended, ``LONGEST`` is a wait.
    """
    looked, waited, logged = time.monotonic(), 0.0, 0.0
    while not sim.answered:
        loop.once(0.02)
        now = time.monotonic()  # checked after every message: refused messages may never end
        waited, looked = waited + min(now - looked, LONGEST), now
        if loop.stopping:
            return False
        if waited > sim.params.patience and not sim.answered:
            sim.give_up()
            return False
        if waited - logged > _ASK_AGAIN:
            logged = waited
            for one in _unanswered(sim):
                one.get_logger().warning(f'waiting for motor_pwm of t = {sim.t * 1e-9:.3f} s')
    return True


def _unanswered(sim: Any) -> list[Any]:
    """Return the simulators whose motor command of this step has not arrived."""
    return [one for one in sim.drones if not one.answered]


def wait_for_deadline(sim: Any, loop: Any, deadline: float, looked: float) -> float:
    """
    Serve the graph until the wall clock reaches the next step (real time).

    Returns the wall time in s in which this process did not run since the step before, which ended
    at ``looked``, as it or the machine was suspended. It does not count as time without a command,
    and nothing makes up for it: thousands of steps in a row would fill the queues of other nodes.

    A motor command that is late is awaited until the flight is ``BEHIND`` the wall clock: machines
    stop one or all of their processors for milliseconds. The delay is made up for by the next
    steps, each as soon as it is answered. A controller that always takes longer than a step
    therefore uses that time up, and its steps go on without their commands. A step that began
    late gets its full period in any case. All drones of a hall wait for that of one; the step
    counts as missed, or as one that waited, for that one.

    None is awaited where no controller has answered for the first ``SILENT`` steps, or where the
    motors were stopped for lack of commands.
    """
    away = _away(sim, looked)
    deadline += away
    overdue, due = deadline, max(deadline, sim.sensed + STEP_NS * 1e-9 / sim.params.speed)
    if sim.starved < 0 and any(one.delays.count or one.missed < SILENT for one in sim.drones):
        overdue = max(deadline + BEHIND, due)
    while not loop.stopping:
        left = (deadline if sim.answered else overdue) - time.monotonic()
        if left <= 0.0:
            break
        awaited = _unanswered(sim)
        loop.once(left)
        if awaited and time.monotonic() > due:
            for one in awaited:
                one.late += one.answered
    if not sim.answered:
        loop.once(0.0)
    away += _away(sim, max(overdue, due))
    for one in _unanswered(sim):
        one.missed += 1
        one.watch(time.monotonic(), sim.params.speed)
    return away


def _away(sim: Any, since: float) -> float:
    """Return the s since then if no running process takes them, else 0; the motors wait."""
    away = time.monotonic() - since
    if away <= NOT_RUN:
        return 0.0
    sim.start(away)
    sim.get_logger().warning(f'did not run for {away:.1f} s before t = {sim.t * 1e-9:.3f} s: '
                             'the flight goes on from there')
    return away


def wait_while_paused(sim: Any, loop: Any) -> float:
    """Serve the graph until the next step is due; return how long that took, s of wall time."""
    began = logged = time.monotonic()
    if sim.pause.due():
        return 0.0
    while not loop.stopping and not sim.pause.due():
        loop.once(0.02)
        if time.monotonic() - logged > 1.0:  # who watches the flight sees that it lives
            logged = time.monotonic()
            sim.get_logger().info(f'paused before t = {sim.t * 1e-9:.3f} s')
    sim.start()
    return time.monotonic() - began


def _log_commands(sim: Any, lockstep: bool, took: float) -> None:
    """Log how the motor commands of one drone came in a flight that took so many s."""
    log, delays = sim.get_logger(), sim.delays
    if not lockstep and not delays.count:
        log.warning('no motor command came: is a controller running in this domain and namespace?')
    log.info(f'flew {sim.t * 1e-9:.3f} s in {took:.3f} s of wall time, '
             f'{answers(sim.missed, sim.late)}')
    if delays.count:
        delay = ', '.join(f'{name} {value} ms' for name, value in delays.values().items())
        log.info(f'IMU sample to motor command: {delay} of {delays.count} steps')


def run(sim: Any, loop: Any) -> int:
    """Step the simulation to its end or until stopped; return the exit code."""
    p, log = sim.params, sim.get_logger()
    log.info(f'flying in {p.mode} mode')  # the first line takes ten times as long as a step
    end = round(p.duration * 1e9) if p.duration else None
    began = logged = now = time.monotonic()
    zero = began  # when the flight would have begun at the present speed, for the pace
    sim.start()
    stopped = 0.0  # s of wall time in which this process did not run
    lockstep, speed = p.mode == 'lockstep', p.speed
    while not loop.stopping:
        rested = wait_while_paused(sim, loop)
        began, zero = began + rested, zero + rested
        if loop.stopping:
            break
        sim.sense()
        if sim.params.speed != speed:  # changed in flight: what is flown stays where it was
            zero += sim.t * 1e-9 * (1.0 / speed - 1.0 / sim.params.speed)
            speed = sim.params.speed
        if lockstep:
            if not wait_for_answer(sim, loop):
                break
        else:
            away = wait_for_deadline(
                sim, loop, zero + (sim.t + STEP_NS) * 1e-9 / speed, now + rested)
            began, zero, stopped = began + away, zero + away, stopped + away
        now = time.monotonic()
        if now - logged > 1.0:
            logged = now
            log.info(f't = {sim.t * 1e-9:.2f} s')
        if end is not None and (sim.t >= end or not lockstep and sim.is_deserted(now)):
            if sim.t < end:
                sim.give_up()
            break
        sim.advance()
    now = time.monotonic()
    took, late = now - began, now - zero - (sim.t + STEP_NS) * 1e-9 / speed
    if not lockstep and late > LATE * took:
        log.warning(f'fell {late:.2f} s behind the wall clock: the controller or the machine is '
                    f'too slow for speed {speed:g}')
    if stopped:
        log.warning(f'did not run for {stopped:.1f} s in all: it went on from where it was')
    for one in sim.drones:
        _log_commands(one, lockstep, took)
    return 0 if loop.stopping or end is None or sim.t >= end else 1
