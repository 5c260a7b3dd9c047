"""
Trajectories of the thesis as data, and flight plans with take-off, approach, exit and landing.

The trajectories are (3.31), (4.1), (5.1), (5.3)-(5.6) and the paths of the other experiments. On
each axis a trajectory is an offset, a slope and one sine of path time. A flight plan blends it
with the hover point above the origin and with the ground, so that the position is four times
continuously differentiable, as (3.14) requires. All derivatives are analytic. A course of
polynomials is flown as described in :mod:`course_flight`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
import math

from ..arithmetic.trigonometry import sin_cos
from ..compiled import jit, jit_inside
from ..schema import choice, ParameterError, quantity, text
from ..values import derived, Parameters, values_type
from ..vehicle.parameters import Vehicle
from .course_flight import assemble, MAX_DOWNWARD, Timing
from .flatness import from_flat_output, from_flat_output_yaw, Reference
from .polynomial import Course, evaluate, Jet, NO_PIECES, Pieces, raised, resized, stretched
from .uav_trajectories import parse
from .vector import add, scale, Vec3

GROUND, TAKEOFF, TRACK, LANDING, LANDED = range(5)  # PHASE_* of mambo_interfaces/Reference


@jit
def in_flight(phase: int) -> bool:
    """Return whether the motors turn in a phase of the flight plan."""
    return (phase > GROUND) & (phase < LANDED)


_ONE: Jet = (1.0, 0.0, 0.0, 0.0, 0.0)
_ZERO: Jet = (0.0, 0.0, 0.0, 0.0, 0.0)
_ORIGIN: Vec3 = (0.0, 0.0, 0.0)

BLEND_SPEED = 630.0 / 4.0**4            # largest first derivative of the blend
BLEND_ACCELERATION = 2520.0 * 27.0 / 2744.0 / math.sqrt(7.0)  # largest second one
_BLEND_HALF = 63.0 / 1024.0              # integral of the blend over its first half


@dataclass(frozen=True)
class Trajectory:
    """
    Position over path time p: offset + slope p + amplitude sin(rate p + phase) on each axis.

    With ``loops`` the path reverses after that many turns and returns over the same points. The
    step is added to the position from the step time on.
    """

    source: str
    offset: Vec3                 # (3,) m, inertial NED; also the point where it is joined
    amplitude: Vec3 = _ORIGIN    # (3,) m
    rate: float = 1.0            # rad/s
    phase: Vec3 = _ORIGIN        # (3,) rad
    slope: Vec3 = _ORIGIN        # (3,) m/s
    step: Vec3 = _ORIGIN         # (3,) m
    loops: float = 0.0           # turns before the path turns round; 0: never


_COSINE = 0.5 * math.pi
_UP = math.pi  # sin(p + pi) = -sin p: NED altitude rises first
TURN_DURATION = 2.0  # s of path time in which a path with loops turns round

TRAJECTORIES: dict[str, Trajectory] = {
    'hover': Trajectory('Fig. 5.3', (0.0, 0.0, -1.5)),
    'step': Trajectory('Fig. 4.3, 6.5', (0.0, 0.0, -1.5), step=(1.0, 0.0, 0.0)),
    'circle': Trajectory(
        '(5.3)', (0.0, 0.0, -1.5), (1.0, 1.0, 0.0), phase=(_COSINE, 0.0, 0.0)),
    'circle_fast': Trajectory(
        '(5.3) at twice the speed, Fig. 6.6', (0.0, 0.0, -1.5), (1.0, 1.0, 0.0), 2.0,
        (_COSINE, 0.0, 0.0)),
    'figure_3_3': Trajectory(
        '(3.31)', (0.0, 0.0, -1.5), (1.0, 1.0, 1.0), phase=(_COSINE, 0.0, _UP)),
    'circle_bobbing': Trajectory(
        'flow deck of a Crazyflie: circle of 1 m, height 1 m +- 0.3 m', (0.0, 0.0, -1.0),
        (1.0, 1.0, 0.3), phase=(_COSINE, 0.0, _UP)),
    'default_circle': Trajectory(
        '(4.1)', (0.0, 0.0, -1.5), (0.5, 0.5, 0.5), phase=(0.0, _COSINE, _UP)),
    'y_sine': Trajectory('Fig. 5.4-5.8', (0.0, 0.0, -1.5), (0.0, 1.0, 0.0)),
    'y_sine_high': Trajectory('(5.1)', (0.0, 0.0, -2.5), (0.0, 0.5, 0.0)),
    'circle_rising': Trajectory(
        '(5.4)', (0.0, 0.0, -1.5), (1.0, 1.0, 1.0), phase=(0.0, _COSINE, _UP)),
    'incline': Trajectory(
        '(5.5)', (0.0, 0.0, -1.5), (0.5, 0.0, 0.5), phase=(0.0, 0.0, _UP)),
    'vertical_circle': Trajectory(
        '(5.6)', (0.0, 0.0, -1.5), (0.5, 0.0, 0.5), phase=(_COSINE, 0.0, _UP)),
    'z_sine': Trajectory(
        'Fig. 6.2', (0.0, 0.0, -2.0), (0.0, 0.0, 1.0), 2.0, (0.0, 0.0, _UP)),
    'hand_loop': Trajectory(
        'Fig. C.1, size and speed of Fig. C.4', (0.0, 0.0, -1.5), (1.0, 0.0, 1.0),
        phase=(_COSINE, 0.0, _UP), loops=2.0),
    'ramp': Trajectory(
        'Fig. C.2', (0.0, 0.0, -1.5), (0.0, 0.0, 1.0), 0.5, (0.0, 0.0, _UP),
        slope=(0.1, 0.0, 0.0)),
    'vertical_circle_large': Trajectory(
        'Fig. C.4-C.6', (0.0, 0.0, -1.5), (1.0, 0.0, 1.0), phase=(_COSINE, 0.0, _UP)),
}

COURSE = 'course'  # name of what is in FlightPlanParams.course
_NO_PATH = Trajectory('', _ORIGIN)
TAKEOFFS = ('smooth', 'step', 'none')
SMOOTH, STEP, NONE = range(len(TAKEOFFS))


@dataclass(frozen=True)
class FlightPlanParams(Parameters):
    """
    Which trajectory is flown, and how it is reached and left.

    ``takeoff`` smooth: on the ground until ``takeoff_time``, a climb above the origin, then the
    trajectory from its own time 0 at ``start_time``, blended in. ``takeoff`` step: as the drone of
    the thesis flew, without climb and blend; the reference jumps to the hover point at
    ``takeoff_time`` and to the trajectory at ``start_time``. ``takeoff`` none: the reference
    is the trajectory from t = 0, as in the thesis's simulations. A landing blends the trajectory
    out and then descends, with the same two durations. A step happens at ``start_time``.

    The trajectory ``course`` is what ``course`` holds; :func:`course_flight.assemble` says how it
    is reached and left. Its own time 0 is ``start_time + blend_duration`` after a smooth take-off.
    """

    trajectory: str = choice(
        'circle', (*TRAJECTORIES, COURSE), 'thesis chapters 3 to 6, appendix C; course: see there')
    takeoff: str = choice('smooth', TAKEOFFS, 'none: thesis sec. 3.4; step: sec. 4.3, 5.2')
    takeoff_time: float = quantity(1.0, 's', 0.0, 600.0, 'design choice: motors start')
    climb_duration: float = quantity(3.0, 's', 0.5, 60.0, 'design choice')
    start_time: float = quantity(5.0, 's', 0.0, 600.0, 'thesis sec. 4.3, 5.2')
    blend_duration: float = quantity(3.0, 's', 0.5, 60.0, 'design choice')
    landing_time: float = quantity(0.0, 's', 0.0, 36000.0, 'design choice; 0: no landing')
    scale_amplitude: float = quantity(
        1.0, '1', 0.0, 5.0, 'design choice: size of the motion about the hover point')
    scale_rate: float = quantity(1.0, '1', 0.05, 5.0, 'design choice: speed along the path')
    height: float = quantity(
        0.0, 'm', 0.0, 100.0, 'of the hover point, thesis sec. 5.4; 0: that of the trajectory')
    course: str = text('', 'pieces that trajectory course flies, CSV as uav_trajectories writes')

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_order(self)
        if self.trajectory == COURSE:
            _pieces(self)
        else:
            _check_vertical(self)

    def flown_course(self) -> Course:
        """
        Return the trajectory ``course`` with the size, height and speed of this plan.

        Raises
        ------
        ParameterError
            If ``course`` is empty or wrong.

        """
        if not self.course:
            raise ParameterError('course is empty: trajectory course needs one')
        out = resized(parse(self.course, 'course'), self.scale_amplitude)
        if self.height > 0.0:
            out = raised(out, self.height)
        return stretched(out, 1.0 / self.scale_rate)

    @property
    def timing(self) -> Timing:
        """Return the schedule of this plan for a course."""
        return Timing(self.takeoff, *map(float, (
            self.takeoff_time, self.climb_duration, self.start_time, self.blend_duration)),
            self.leaving_time())

    @derived('m', 'height')
    def hover(self) -> Vec3:
        """Hover point before and after the trajectory, (3,) inertial NED."""
        if self.trajectory == COURSE:
            return (0.0, 0.0, float(self.flown_course().coefficients[0, 2, 0]))
        x, y, z = self._path.offset
        return (x, y, -float(self.height) if self.height > 0.0 else z)

    @derived('m')
    def amplitude(self) -> Vec3:
        """Amplitude of the periodic motion, (3,) inertial NED."""
        return scale(float(self.scale_amplitude), self._path.amplitude)

    @derived('rad/s')
    def rate(self) -> float:
        """Angular rate of the motion per second of path time."""
        return self._path.rate

    @derived('rad')
    def phase(self) -> Vec3:
        """Phase of the motion, (3,)."""
        return self._path.phase

    @derived('m/s')
    def slope(self) -> Vec3:
        """Mean velocity per second of path time, (3,) inertial NED."""
        return scale(float(self.scale_amplitude), self._path.slope)

    @derived('m', 'trajectory', 'scale_amplitude')
    def step(self) -> Vec3:
        """Step at ``start_time``, (3,) inertial NED."""
        return scale(float(self.scale_amplitude), self._path.step)

    @derived('s')
    def turn_time(self) -> float:
        """Path time at the middle of the reversal; infinite: never."""
        path = self._path
        if not path.loops:
            return math.inf
        return 2.0 * math.pi * path.loops / path.rate + 2.0 * TURN_DURATION * _BLEND_HALF

    @derived('s', 'landing_time')
    def leaving_time(self) -> float:
        """Flight time at which the landing begins; infinite: never."""
        return float(self.landing_time) if self.landing_time > 0.0 else math.inf

    @derived('')
    def pieces(self) -> Pieces:
        """Pieces of the whole flight; empty if the other fields define it."""
        return _pieces(self) if self.trajectory == COURSE else NO_PIECES

    @property
    def _path(self) -> Trajectory:
        """Return the built-in trajectory; for a course, one without motion."""
        return TRAJECTORIES.get(self.trajectory, _NO_PATH)


PlanValues = values_type(FlightPlanParams)


@lru_cache(maxsize=8)
def _pieces(plan: FlightPlanParams) -> Pieces:
    """Return the flight along ``course``; raise ParameterError if it cannot be flown."""
    return assemble(plan.flown_course(), plan.timing)


def _check_order(plan: FlightPlanParams) -> None:
    """Raise ParameterError if a manoeuvre begins before the previous one has ended."""
    climbed, until = plan.takeoff_time, 'takeoff_time'
    if plan.takeoff == 'smooth':
        climbed, until = climbed + plan.climb_duration, 'takeoff_time + climb_duration'
    if plan.takeoff != 'none' and plan.start_time < climbed:
        raise ParameterError(
            f'start_time = {plan.start_time:g} s is before the climb ends, '
            f'{until} = {climbed:g} s')
    joined, what = 0.0, ''
    if plan.takeoff == 'smooth':
        joined = plan.start_time + plan.blend_duration
        what = 'the trajectory is reached, start_time + blend_duration'
    elif plan.takeoff == 'step' or (
            plan.trajectory != COURSE and any(TRAJECTORIES[plan.trajectory].step)):
        joined, what = plan.start_time, 'the step, start_time'
    if 0.0 < plan.landing_time < joined:
        raise ParameterError(
            f'landing_time = {plan.landing_time:g} s is before {what} = '
            f'{joined:g} s')


def _check_vertical(plan: FlightPlanParams) -> None:
    """Raise ParameterError if the plan hits the ground or falls faster than MAX_DOWNWARD."""
    path = TRAJECTORIES[plan.trajectory]
    height, depth = -plan.hover()[2], plan.scale_amplitude * path.amplitude[2]
    if depth >= height:
        raise ParameterError(
            f'scale_amplitude = {plan.scale_amplitude:g} takes {plan.trajectory} '
            f'to the ground: {depth:g} m of motion about {height:g} m')
    blends = plan.takeoff == 'smooth' or plan.landing_time > 0.0
    rate, T = path.rate * plan.scale_rate, plan.blend_duration
    extra = 2.0 * BLEND_SPEED * rate * plan.scale_rate / TURN_DURATION if path.loops else 0.0
    if blends:
        extra = max(extra, 2.0 * BLEND_SPEED * rate / T + BLEND_ACCELERATION / (T * T))
    track = depth * (rate * rate + extra)
    climb = (
        height * BLEND_ACCELERATION / (plan.climb_duration * plan.climb_duration)
        if blends else 0.0)
    for name, value, remedy in (
            ('scale_rate', track, 'lower it or scale_amplitude, or lengthen blend_duration'),
            ('climb_duration', climb, 'lengthen it')):
        if value > MAX_DOWNWARD:
            raise ParameterError(
                f'{name} = {getattr(plan, name):g} lets {plan.trajectory} ask '
                f'for up to {value:.3g} m/s^2 downward, limit {MAX_DOWNWARD:g} m/s^2: {remedy}')


@jit
def blend(x: float) -> Jet:
    """
    Return a weight that rises from 0 at x = 0 to 1 at x = 1, with four derivatives.

    It is a polynomial of degree 9 whose derivatives 1 to 4 vanish at both ends; outside [0, 1] it
    is constant.
    """
    if x <= 0.0:
        return _ZERO
    if x >= 1.0:
        return _ONE
    z = min(x, 1.0 - x)  # the value from the nearer end, for its accuracy
    w = z * z
    low = w * w * z * (126.0 + z * (-420.0 + z * (540.0 + z * (-315.0 + z * 70.0))))
    y, d = x * (1.0 - x), 1.0 - 2.0 * x
    square = y * y
    return (
        low if x <= 0.5 else 1.0 - low,
        630.0 * square * square,
        2520.0 * square * y * d,
        2520.0 * square * (3.0 * d * d - 2.0 * y),
        2520.0 * y * d * (6.0 * d * d - 18.0 * y))


@jit
def blend_integral(x: float) -> float:
    """Return the integral of the blend from 0 to x."""
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return x - 0.5
    cube = x * x * x
    return cube * cube * (21.0 + x * (-60.0 + x * (67.5 + x * (-35.0 + x * 7.0))))


@jit
def _rise(t: float, begin: float, duration: float) -> Jet:
    """Return the blend as a function of time t, with time derivatives; all arguments in s."""
    b = blend((t - begin) / duration)
    h = 1.0 / duration
    return (b[0], b[1] * h, b[2] * h * h, b[3] * h * h * h, b[4] * h * h * h * h)


@jit
def _product(a: Jet, b: Jet) -> Jet:
    """Return a times b with four derivatives, by the general Leibniz rule."""
    return (
        a[0] * b[0],
        a[1] * b[0] + a[0] * b[1],
        a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2],
        a[3] * b[0] + 3.0 * a[2] * b[1] + 3.0 * a[1] * b[2] + a[0] * b[3],
        a[4] * b[0] + 4.0 * a[3] * b[1] + 6.0 * a[2] * b[2] + 4.0 * a[1] * b[3] + a[0] * b[4])


@jit
def _fall(t: float, begin: float, duration: float) -> Jet:
    """Return one minus :func:`_rise`."""
    r = _rise(t, begin, duration)
    return (1.0 - r[0], -r[1], -r[2], -r[3], -r[4])


@jit
def _path_time(t: float, plan: PlanValues) -> Jet:
    """Return path time in s at trajectory time t in s; it decreases after ``turn_time``."""
    k = plan.scale_rate
    p = k * t
    if plan.turn_time == math.inf:
        return (p, k, 0.0, 0.0, 0.0)
    x = (p - plan.turn_time) / TURN_DURATION + 0.5
    b = blend(x)
    h = k / TURN_DURATION
    return (
        p - 2.0 * TURN_DURATION * blend_integral(x),
        k * (1.0 - 2.0 * b[0]),
        -2.0 * k * h * b[1],
        -2.0 * k * h * h * b[2],
        -2.0 * k * h * h * h * b[3])


@jit
def _axis(p: Jet, slope: float, amplitude: float, rate: float, phase: float) -> Jet:
    """Return slope p + amplitude sin(rate p + phase) with four derivatives, by the chain rule."""
    x = rate * p[0] + phase
    sine, cosine = sin_cos(x)
    s, c = amplitude * sine, amplitude * cosine
    d1, d2, d3, d4 = rate * p[1], rate * p[2], rate * p[3], rate * p[4]
    return (
        slope * p[0] + s,
        slope * p[1] + c * d1,
        slope * p[2] + c * d2 - s * d1 * d1,
        slope * p[3] + c * (d3 - d1 * d1 * d1) - 3.0 * s * d1 * d2,
        slope * p[4] + c * (d4 - 6.0 * d1 * d1 * d2)
        + s * (d1 * d1 * d1 * d1 - 4.0 * d1 * d3 - 3.0 * d2 * d2))


@jit
def _phase(t: float, plan: PlanValues) -> int:
    """Return the phase of the flight at t in s, one of GROUND ... LANDED."""
    leave = plan.leaving_time + plan.blend_duration
    if plan.takeoff != NONE and t < plan.takeoff_time:
        return GROUND
    if plan.takeoff != NONE and t < plan.start_time:
        return TAKEOFF
    if t < leave:
        return TRACK
    if t < leave + plan.climb_duration:
        return LANDING
    return LANDED


@jit_inside
def _weights(t: float, plan: PlanValues) -> tuple[Jet, Jet, Jet]:
    """Return the weights of hover point, periodic motion and step at t in s."""
    climb, join = _ONE, _ONE
    if plan.takeoff == SMOOTH:
        climb = _rise(t, plan.takeoff_time, plan.climb_duration)
        join = _rise(t, plan.start_time, plan.blend_duration)
    elif plan.takeoff == STEP:
        climb = _ONE if t >= plan.takeoff_time else _ZERO
        join = _ONE if t >= plan.start_time else _ZERO
    step = _ONE if t >= plan.start_time else _ZERO
    if t >= plan.leaving_time:
        leave = _fall(t, plan.leaving_time, plan.blend_duration)
        join, step = _product(join, leave), _product(step, leave)
        climb = _product(climb, _fall(
            t, plan.leaving_time + plan.blend_duration, plan.climb_duration))
    return climb, join, step


@jit
def _course_output(
    t: float, pieces: Pieces,
) -> tuple[Vec3, Vec3, Vec3, Vec3, Vec3, Vec3]:
    """Return position to snap of a course, (3,) each, and yaw with two derivatives."""
    x, y, z, psi = evaluate(t, pieces)
    return ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]), (x[3], y[3], z[3]),
            (x[4], y[4], z[4]), (psi[0], psi[1], psi[2]))


@jit_inside
def flat_output(
    t: float, plan: PlanValues,
) -> tuple[Vec3, Vec3, Vec3, Vec3, Vec3, int]:
    """
    Return position and its first four derivatives, and the phase of the flight.

    For a course the pieces are evaluated. Otherwise the position is
    ``u hover + w (path - hover) + step`` with the blending weights u and w. A step is a jump with
    zero derivatives on both sides.

    Parameters
    ----------
    t : s
        Flight time.
    plan
        From :meth:`FlightPlanParams.values`.

    Returns
    -------
    rho, v, a, j, s : (3,) m ... m/s^4, inertial NED
        In the phases GROUND and LANDED at rest on the ground: at the origin, where every weight
        is zero, or at the landing point of a course.
    phase
        One of GROUND ... LANDED.

    """
    if len(plan.pieces.begin) > 0:
        rho, v, a, j, s, _ = _course_output(t, plan.pieces)
        return rho, v, a, j, s, _phase(t, plan)
    u, w, g = _weights(t, plan)
    p = _path_time(t - plan.start_time if plan.takeoff != NONE else t, plan)
    A, F = plan.amplitude, plan.phase
    x = _product(w, _axis(p, plan.slope[0], A[0], plan.rate, F[0]))
    y = _product(w, _axis(p, plan.slope[1], A[1], plan.rate, F[1]))
    z = _product(w, _axis(p, plan.slope[2], A[2], plan.rate, F[2]))
    H, S = plan.hover, plan.step
    return (
        add(add(scale(u[0], H), scale(g[0], S)), (x[0], y[0], z[0])),
        add(add(scale(u[1], H), scale(g[1], S)), (x[1], y[1], z[1])),
        add(add(scale(u[2], H), scale(g[2], S)), (x[2], y[2], z[2])),
        add(add(scale(u[3], H), scale(g[3], S)), (x[3], y[3], z[3])),
        add(add(scale(u[4], H), scale(g[4], S)), (x[4], y[4], z[4])),
        _phase(t, plan))


@jit_inside
def reference_step(
    t: float, plan: PlanValues, mass: float, inertia: Vec3, gravity: float,
) -> tuple[Reference, int]:
    """
    Return the feasible reference (3.14) of the plan at t in s, and the phase.

    Yaw is that of a course, or else follows from the least rotation. Mass in kg, inertia in
    kg m^2 and gravity in m/s^2 are the values that the controller assumes. In the phases GROUND
    and LANDED the reference is at rest with hover thrust, at the origin or at the landing point of
    a course.
    """
    if len(plan.pieces.begin) > 0:
        rho, v, a, j, s, psi = _course_output(t, plan.pieces)
        return from_flat_output_yaw(
            rho, v, a, j, s, psi[0], psi[1], psi[2], mass, inertia, gravity), _phase(t, plan)
    rho, v, a, j, s, phase = flat_output(t, plan)
    return from_flat_output(rho, v, a, j, s, mass, inertia, gravity), phase


def reference_at(t: float, plan: FlightPlanParams, vehicle: Vehicle) -> tuple[Reference, int]:
    """
    Return the feasible reference (3.14) at a time, and the phase of the flight.

    Parameters
    ----------
    t : s
        Flight time, finite.
    plan
        The flight plan.
    vehicle
        Vehicle as assumed by the controller: mass, inertia, gravity.

    Raises
    ------
    ValueError
        If t is not finite.

    """
    if not math.isfinite(t):
        raise ValueError(f'flight time t = {t} s must be finite')
    vv = vehicle.values()
    return reference_step(float(t), plan.values(), vv.mass, vv.inertia, vv.gravity)
