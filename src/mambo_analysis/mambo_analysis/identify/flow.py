r"""
Factor of the optical flow from a motion capture: a constant (5.2), a function of height (C.2).

The model is fitted to the flow, not to the velocity derived from it, because the noise is that of
the sensor; for a body velocity :math:`\nu` over a depth :math:`Z = h/(\cos\phi \cos\theta)`

.. math:: flow = \frac{\nu_{xy}}{Z\,Q(h)} + noise.

Each axis may have an offset, and a share of the rotation :math:`(\omega_2, -\omega_1)` may be in
the flow. The velocity is the slope of a parabola through the positions around a sample, in
inertial axes, turned into body axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from mambo_bags.cli.option_types import real, TIME
from mambo_bags.command import Parser
from mambo_flight.closed_loop import Recording
from mambo_model import palette
from mambo_model.frames import body_quaternion, flip_vector
from mambo_model.yaml_nodes import dump
from mambo_signals import motion
from mambo_signals.derivative import body_rates, local_fit
from mambo_signals.poses import outliers
from mambo_signals.resample import columns_at
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import flow_doubts, regression, result
from .regression import IdentifyError, Value
from .sensors.statistics import jackknife

Floats = NDArray[np.float64]

LAWS = ('constant', 'linear', 'exponential')
WINDOW = 0.12          # s, of positions for a velocity: leaves 3e-4 of a motion of 2 rad/s
CLEAR = 1.5  # [-] share of the rotation over its half width: 3 standard errors, 0.3 % by chance
MOVES = 0.5  # [-] of a half width, by which a value is off: it then holds in 83 % instead of 95 %
LEAST = 100            # samples of the flow
LOWEST = 0.4           # m, no flow below (sec. 5.2)
SPREAD = 0.2           # m, of the heights for a slope
SLOWEST = 0.1          # m/s, rms, of a motion that shows a factor
FACTORS = (0.2, 5.0)   # of any lens and unit that are near the truth, Q being about 1
MOVED = 0.02           # m/s, of an axis that is checked: ten times the error of its velocity
TURNED = 15.0          # deg, between flow and motion: Q is 1 - cos, 3 %, too large, and no more
UNEQUAL = 1.5          # ratio of the factors of the axes: one lens serves both


class Samples(NamedTuple):
    """Measured flow and the flow expected from the motion, body FRD."""

    t: Floats         # (n,) s
    flow: Floats      # (n, 2) rad/s, the vehicle's sign, without rotation
    velocity: Floats  # (n, 2) m/s, nu_1 and nu_2
    height: Floats    # (n,) m, above the floor
    depth: Floats     # (n,) m, Z
    rotation: Floats  # (n, 2) rad/s, omega_2 and -omega_1: what a sensor without gyro adds
    impossible: int = 0  # poses that cannot be true and were left out
    notes: Sequence[str] = ()  # on the recording


class Factor(NamedTuple):
    """A model of the flow factor over height."""

    offset: Value         # 1
    slope: Value | None   # 1/m of (C.2b); 1 of (C.2a), times exp(h); None: a constant
    bias: tuple[float, float]  # rad/s, of the flow, body FRD
    leak: Value | None     # 1, share of the rotation in the flow; None: taken for 0
    fit: regression.Fit

    def at(self, height: Floats | float, law: str) -> Floats:
        """Return Q at heights in m."""
        slope = self.slope.value if self.slope else 0.0
        return self.offset.value + slope * _shape(np.asarray(height, float), law)


def _shape(height: Floats, law: str) -> Floats:
    """Return the regressor of the slope of a law."""
    if law == 'exponential':
        return np.exp(height)
    return height if law == 'linear' else np.zeros_like(height)


def fit_factor(
    samples: Samples, law: str = 'constant', leak: bool = False, slowest: float = SLOWEST,
) -> Factor:
    """
    Fit the factor of the flow.

    Parameters
    ----------
    samples
        Of a flight that moves; for a slope, at different heights.
    law
        ``constant``, ``linear`` Q = offset + slope h, or ``exponential`` offset + slope exp(h).
    leak
        Whether to fit the share of the rotation in the flow.
    slowest : m/s
        A slower motion, rms, is refused.

    Raises
    ------
    IdentifyError
        For samples that show no factor, in one line.

    """
    if law not in LAWS:
        raise IdentifyError(f'law {law!r} is not one of {", ".join(LAWS)}')
    _check(samples, slowest, leak)
    if law != 'constant' and np.ptp(samples.height) < SPREAD:
        raise IdentifyError(
            f'heights differ by {np.ptp(samples.height):.2f} m: a law of the height needs '
            f'{SPREAD:g} m')
    geometric = samples.velocity / samples.depth[:, None]
    shape = _shape(samples.height, law)
    middle = float(shape.mean())

    count = 1 if law == 'constant' else 2
    reach = 0.9 / max(float(np.abs(shape - middle).max()), 1e-9)  # keeps Q above 0 near Q = 1

    def model(theta: Floats) -> Floats:
        """Return the flow by offset, slope and share of the rotation, (n, 2) rad/s."""
        Q = theta[0] + (theta[1] * (shape - middle) if count > 1 else 0.0)
        out = geometric / np.reshape(Q, (-1, 1))
        return out + theta[-1] * samples.rotation if leak else out
    low, high = ([edge, side * reach][:count] + [side * 5.0] * leak
                 for edge, side in zip(FACTORS, (-1.0, 1.0)))
    names = ['offset', 'slope'][:count] + ['share of the rotation'] * leak
    found = regression.fit(model, samples.flow, [1.0, 0.0][:count] + [0.0] * leak, low, high,
                           names, np.ones((len(shape), 1)))
    at_end = regression.at_bound(found.theta, low, high, names)
    at_end.pop('slope', None)  # the heights may hardly show it: its interval says so
    for name, end in at_end.items():
        raise IdentifyError(
            f'the best {name} is {end:.3g}, the limit of its search: the flow does not follow '
            'the motion; check units, axes and clocks')
    bias = (samples.flow - found.residual - model(found.theta)).mean(axis=0)
    share = found.value(count, '1') if leak else None
    if count == 1:
        return Factor(found.value(0, '1'), None, tuple(bias.tolist()), share, found)
    turn = np.eye(count + leak)  # back to an offset at shape 0
    turn[0, 1] = -middle
    found = found._replace(
        theta=turn @ found.theta, covariance=turn @ found.covariance @ turn.T)
    unit = '1/m' if law == 'linear' else '1'
    return Factor(
        found.value(0, '1'), found.value(1, unit), tuple(bias.tolist()), share, found)


def _check(samples: Samples, slowest: float, leak: bool) -> None:
    """Raise IdentifyError for samples without enough motion, or in wrong units or axes."""
    regression.check_columns(
        dict(zip(('time', 'flow', 'velocity', 'height', 'depth', 'rotation'), samples)), LEAST)
    regression.check_times(samples.t)
    if not np.ptp(samples.flow) > 0.0:
        raise IdentifyError('the flow is constant: the camera sees nothing')
    if not (samples.depth > 0.0).all():
        raise IdentifyError('the height is 0 or below: is the floor where z is 0?')
    size = float(np.sqrt(np.mean(samples.velocity ** 2)))
    if size < slowest:
        raise IdentifyError(
            f'a motion of {size:.3f} m/s rms is slower than {slowest:g} m/s and hardly shows a '
            'factor: fly a circle or a sine, or admit it with --slowest')
    geometric = samples.velocity / samples.depth[:, None]
    ratio = float(np.sum(samples.flow * geometric) / np.sum(geometric ** 2))
    if not 1.0 / FACTORS[1] < ratio < 1.0 / FACTORS[0]:
        raise IdentifyError(_wrong_ratio('the flow', ratio))
    check_axes(samples, leak)


def _wrong_ratio(what: str, ratio: float) -> str:
    return (f'{what} is {ratio:.3g} times velocity over height: it must be in rad/s, with the '
            "vehicle's sign and axes and without rotation")


def check_axes(samples: Samples, leak: bool) -> None:
    """
    Check that the axes of the flow are those of the motion, in size and direction.

    Least squares of both axes of the flow by both axes of velocity over depth, with an offset and
    with ``leak`` the rotation. Only what the whole interval of a jackknife says is refused, so
    that a flight that shows too little passes.

    Raises
    ------
    IdentifyError
        Naming the axis, or the angle between flow and motion.

    """
    geometric = samples.velocity / samples.depth[:, None]
    moved = np.flatnonzero(samples.velocity.std(axis=0) >= MOVED)
    terms = np.column_stack([geometric, np.ones(len(geometric)), samples.rotation])
    terms = terms[:, [*moved, 2, *([3, 4] if leak else [])]]

    def share(keep: NDArray[np.int64]) -> Floats:
        """Return the part of the flow by the velocity, (2, 2), NaN for an axis at rest."""
        out = np.full((2, 2), np.nan)
        out[:, moved] = np.linalg.lstsq(
            terms[keep], samples.flow[keep], rcond=None)[0][:len(moved)].T
        return out
    for axis in moved:
        if not np.ptp(samples.flow[:, axis]) > 0.0:
            raise IdentifyError(
                f'the flow along {"xy"[axis]} is constant: the camera sees nothing')
        one = jackknife(lambda keep, k=axis: float(share(keep)[k, k]), len(terms))
        if one.high < 1.0 / FACTORS[1] or one.low > 1.0 / FACTORS[0]:
            raise IdentifyError(_wrong_ratio(f'the flow along {"xy"[axis]}', one.value))

    def turn(keep: NDArray[np.int64]) -> float:
        (xx, xy), (yx, yy) = share(keep)
        return float(np.degrees(np.arctan2(
            np.nansum([yx, -xy]), np.nansum([xx, yy]))))

    def unequal(keep: NDArray[np.int64]) -> float:
        return float(np.log(np.maximum(np.diag(share(keep)), 1e-3)) @ [1.0, -1.0])
    angle = jackknife(turn, len(terms)) if len(moved) else None
    if angle and (angle.low > TURNED or angle.high < -TURNED):
        raise IdentifyError(
            f'the flow is turned by {angle.value:.0f} deg against the motion: turn the nose of '
            'the tracked body (mambo import motive --nose), or align its clock (mambo join)')
    between = jackknife(unequal, len(terms)) if len(moved) == 2 else None
    if between and (between.low > np.log(UNEQUAL) or between.high < -np.log(UNEQUAL)):
        raise IdentifyError(
            f'the flow along x is {np.exp(between.value):.2g} times that along y for the same '
            'motion: one lens has one factor; check the scale of both axes')


def fit_laws(
    samples: Samples, leak: bool = False, slowest: float = SLOWEST,
) -> dict[str, Factor]:
    """
    Return the factor by every law that the range of heights can distinguish.

    Parameters and errors are those of :func:`fit_factor`.
    """
    laws = LAWS if len(samples.t) and np.ptp(samples.height) >= SPREAD else LAWS[:1]
    return {law: fit_factor(samples, law, leak, slowest) for law in laws}


def best_law(found: dict[str, Factor]) -> str:
    """Return the law that fits best of :func:`fit_laws`; the constant if the slope may be 0."""
    slope = found['linear'].slope if 'linear' in found else None
    if slope is None or slope.low <= 0.0 <= slope.high:
        return 'constant'
    return min(LAWS[1:], key=lambda law: found[law].fit.rms)


def with_rotation(
    samples: Samples, plain: dict[str, Factor], slowest: float = SLOWEST,
) -> dict[str, Factor]:
    """
    Return the laws fitted with a share of the rotation where the flow clearly holds one.

    The share counts if it is :data:`CLEAR` and moves a value of ``plain`` by more than
    :data:`MOVES` of its half width. A late flow can look like a small share: where the flight
    shows a lag, the share must be clear with that lag removed, too.

    Parameters
    ----------
    samples
        Of the flight.
    plain
        Its factors without the rotation, of :func:`fit_laws`; returned if the share does not
        count, or if the flight does not show it.
    slowest : m/s
        As of :func:`fit_factor`.

    """
    law = 'linear' if 'linear' in plain else 'constant'  # which may take a slope for a share
    geometric = samples.velocity / samples.depth[:, None]
    lag = flow_doubts.small_lag(samples.t, samples.flow, geometric)
    try:
        found = fit_laws(samples, True, slowest)
        shares = [found[law].leak]
        if lag is not None and (lag.low > 0.0 or lag.high < 0.0):
            shares.append(fit_factor(_earlier(samples, lag.value), law, True, slowest).leak)
    except IdentifyError:  # the flight turns too little to show a share
        return plain
    moved = any(abs(new.value - old.value) > MOVES * old.half for old, new in zip(
        _values(plain).values(), _values(found).values(), strict=True))
    clear = all(abs(share.value) > CLEAR * share.half for share in shares if share)
    return found if clear and moved else plain


def _earlier(samples: Samples, lag: float) -> Samples:
    """Return samples with the motion a lag in s before each; those without one are left out."""
    motions = np.column_stack(
        [samples.velocity, samples.rotation, samples.height, samples.depth])
    moved = columns_at(samples.t - lag, samples.t, motions)
    known = np.isfinite(moved).all(axis=1)
    moved = moved[known]
    return samples._replace(
        t=samples.t[known], flow=samples.flow[known], velocity=moved[:, :2],
        rotation=moved[:, 2:4], height=moved[:, 4], depth=moved[:, 5])


def _values(found: dict[str, Factor]) -> dict[str, Value]:
    """Return the values of all laws by their names in the report."""
    values = {'Q constant': found['constant'].offset}
    for law, one in found.items():
        if one.slope is not None:
            values |= {f'Q {law}, offset': one.offset, f'Q {law}, slope': one.slope}
    return values


def _formula(found: dict[str, Factor]) -> str:
    """Return the best law as a formula of the height h."""
    law = best_law(found)
    one = found[law]
    if one.slope is None:
        return f'{one.offset.value:.3g}'
    sign = '-' if one.slope.value < 0.0 else '+'
    return (f'{one.offset.value:.3g} {sign} {abs(one.slope.value):.2g} '
            f'{"exp(h)" if law == "exponential" else "h"}')


def samples(
    t_flow: Floats, flow: Floats, t_pose: Floats, position: Floats, q: Floats, floor: float = 0.0,
    start: float = -np.inf, end: float = np.inf, lowest: float = LOWEST,
) -> Samples:
    """
    Return flow samples with the motion by the motion capture around each.

    Parameters
    ----------
    t_flow : (n,) s
        In the middle of what a sample averages.
    flow : (n, 2) rad/s, body FRD
        Not finite: no value, left out.
    t_pose : (m,) s
        In the same clock.
    position : (m, 3) m, inertial NED
    q : (m, 4)
        Attitude w x y z, body to inertial.
    floor : m
        Height of the floor in the frame of the positions.
    start, end : s
        What is before and after is left out.
    lowest : m
        Lower samples are left out.

    """
    regression.check_columns({'time of the pose': t_pose, 'position': position, 'q': q}, 10)
    regression.check_times(t_pose)
    good = np.isfinite(flow).all(axis=1) & (t_flow >= start) & (t_flow <= end)
    t, sensed = t_flow[good], flow[good]
    place, velocity = local_fit(t_pose, position, t, WINDOW)
    height = -place[:, 2] - floor
    use = np.isfinite(velocity).all(axis=1) & (height >= lowest)  # where no poses are missing
    t, height = t[use], height[use]
    after = np.clip(np.searchsorted(t_pose, t), 1, len(t_pose) - 1)
    nearest = after - (t - t_pose[after - 1] < t_pose[after] - t)
    turns = Rotation.from_quat(q[nearest][:, [1, 2, 3, 0]].reshape(-1, 4))
    _, rates = body_rates(t_pose, q[:, [1, 2, 3, 0]], t, WINDOW)
    return Samples(t, sensed[use], turns.inv().apply(velocity[use])[:, :2], height,
                   height / turns.as_matrix()[:, 2, 2],
                   np.column_stack([rates[:, 1], -rates[:, 0]]))


def from_recording(
    recording: Recording, start: float = -np.inf, end: float = np.inf,
) -> Samples:
    """Return the samples of a simulated flight against its Optitrack; start and end in s."""
    sensed, seen = recording.flow[:, 2] > 0.0, np.isfinite(recording.pose).all(axis=1)
    return samples(
        recording.t[sensed] * 1e-9, recording.flow[sensed, :2], recording.pose_t[seen] * 1e-9,
        recording.pose[seen, :3], recording.pose[seen, 3:], start=start, end=end)


def _draw(data: Samples, found: dict[str, Factor]) -> Callable[[Figure], None]:
    styles = dict(zip(LAWS, palette.lines(LAWS)))
    bench = palette.COLOURS[palette.MEASURED]
    best = found[min(found, key=lambda law: found[law].fit.rms)]

    def draw(figure: Figure) -> None:
        """Draw the factor over the height with each law, and the residual."""
        above, below = figure.subplots(2, 1)
        fine = np.linspace(data.height.min(), data.height.max(), 50)
        geometric = data.velocity / data.depth[:, None]
        bias = np.array(best.bias) + (best.leak.value * data.rotation if best.leak else 0.0)
        edges = np.quantile(data.height, np.linspace(0.0, 1.0, 11))
        for low, high in zip(edges, edges[1:]):
            here = (data.height >= low) & (data.height <= high)
            x, y = geometric[here].ravel(), (data.flow - bias)[here].ravel()
            Q = (x @ x) / (x @ y)
            error = 1.96 * Q * Q * best.fit.rms / np.sqrt(x @ x)
            if error < 0.2:  # else there is hardly a motion at this height
                above.errorbar(data.height[here].mean(), Q, error, fmt='o', color=bench)
        for law, one in found.items():
            above.plot(fine, one.at(fine, law), label=law, **styles[law])
        above.set_xlabel('height [m]')
        above.set_ylabel('Q')
        above.legend()
        for j, (axis, style, marker) in enumerate(zip('xy', palette.lines('xy'), '.x')):
            below.plot(data.t, best.fit.residual[:, j], marker, ms=3, color=style['color'],
                       label=axis)
        below.set_xlabel('time [s]')
        below.set_ylabel('residual of the flow [rad/s]')
        below.legend()
    return draw


def _estimator_file(found: dict[str, Factor], best: str) -> str:
    """Return the factor as a ROS 2 parameter file of the estimator."""
    flow: dict = {'factor': best, 'constant': found['constant'].offset.value}
    if 'linear' in found:
        flow |= {'linear_offset': found['linear'].offset.value,
                 'linear_slope': found['linear'].slope.value,
                 'exponential_offset': found['exponential'].offset.value,
                 'exponential_gain': found['exponential'].slope.value}
    if found[best].leak:
        flow['rotation_leak'] = found[best].leak.value
    parameters = {'ros__parameters': {'kalman': {'optical_flow': flow}}}
    return dump({'/mambo/estimator_node': parameters})


def read(
    path: Path, floor: float, start: float, end: float, shift: float, namespace: str | None,
    lowest: float = LOWEST,
) -> Samples:
    """Return the samples of a bag with ``optical_flow`` and ``optitrack/pose``; shift in s."""
    bag = result.open_bag(
        path, ('optical_flow', 'optitrack/pose'), namespace, also=('sonar/range', 'imu/data_raw'))
    try:
        flow_doubts.refuse(bag)
    except IdentifyError as error:
        raise IdentifyError(f'{path}: {error}') from None
    flow, pose = bag['optical_flow'], motion.read(bag, 'optitrack/pose')
    seen = np.isfinite(pose.quaternion).all(axis=1)
    begin = min(pose.t[0], flow.t[0])
    position = [flip_vector(tuple(p)) for p in pose.position[seen].tolist()]
    q = [body_quaternion(*x) for x in pose.orientation[seen].tolist()]
    sensed = [flip_vector((x, y, 0.0))[:2] for x, y in zip(
        flow['rate_x'].tolist(), flow['rate_y'].tolist())]
    sensed = np.where((flow['quality'] > 0)[:, None], np.array(sensed), np.nan)
    found = samples(
        flow.t - begin, sensed, pose.t[seen] - begin + shift, np.array(position).reshape(-1, 3),
        np.array(q).reshape(-1, 4), floor, start, end, lowest)
    if len(found.t) < LEAST and pose.impossible > len(pose.t) // 2:
        raise IdentifyError(f'{path}: {outliers.describe("optitrack/pose", pose.impossible)}')
    return found._replace(impossible=pose.impossible, notes=flow_doubts.floor(bag, pose, floor))


def _report(path: Path, data: Samples, leak: bool, slowest: float) -> result.Report:
    """Return the factor by every law, with a share of the rotation if asked for or clear."""
    found = fit_laws(data, leak, slowest)
    plain, found = found, found if leak else with_rotation(data, found, slowest)
    geometric = data.velocity / data.depth[:, None]
    doubts = [*data.notes, *flow_doubts.refuse_late(data.t, data.flow, geometric),
              *flow_doubts.unequal(data.flow, geometric),
              *flow_doubts.size(found['constant'].offset.value)]
    best = best_law(found)
    values = _values(found)
    notes = ['flow is no part of a vehicle: estimator.yaml is for the estimator']
    if len(found) == 1:
        notes.append(f'heights differ by less than {SPREAD:g} m: no law of the height')
    if data.impossible:
        notes.append(outliers.describe('optitrack/pose', data.impossible))
    notes += doubts
    share = found[best].leak
    if share is not None:
        values['share of the rotation'] = share
        notes.append('the share of the rotation is that in the flow as measured; the leakage of a '
                     'simulated flow, and that of mambo identify drift, is Q times it')
    if share is not None and found is not plain:
        notes.append(
            f'the flow follows the rotation, too: a share of {share.value:.2g} of it is clear, '
            f'and all values above are fitted with it; without it Q would be {_formula(plain)}')
    facts = {
        'law of the estimator': best, 'samples': len(data.t),
        'heights [m]': f'{data.height.min():.2f} .. {data.height.max():.2f}',
        'offset of the flow x, y, body FLU [rad/s]': '{:.4f}, {:.4f}'.format(
            *flip_vector((*found[best].bias, 0.0))[:2])}
    facts |= {f'rms residual, {law} [rad/s]': one.fit.rms for law, one in found.items()}
    return result.Report(
        f'flow factor of {path.name}', values, facts, notes, {}, _draw(data, found),
        {'estimator.yaml': _estimator_file(found, best)})


def parser() -> Parser:
    """Return the command line."""
    out = result.parser(
        'identify_flow', 'Factor of the optical flow from Optitrack, (5.2) and (C.2).')
    out.add_argument('bag', type=Path, help='with optical_flow and optitrack/pose')
    out.add_argument('--floor', type=real(-100.0, 100.0, 'm'), default=0.0,
                     help='m, its height for Optitrack')
    out.add_argument('--shift', type=real(-100.0, 100.0, 's'), default=0.0,
                     help='s, added to the stamps of Optitrack: another clock, or a late flow')
    out.add_argument('--leak', action='store_true',
                     help='fit the share of the rotation in the flow also where it is not clear')
    out.add_argument('--lowest', type=real(0.0, 100.0, 'm'), default=LOWEST,
                     help='m, leave out what is lower (default: %(default)g)')
    out.add_argument('--slowest', type=real(0.0, 100.0, 'm/s'), default=SLOWEST,
                     help='m/s, refuse a slower motion, rms (default: %(default)g)')
    out.add_argument('--start', type=TIME, default=-np.inf, help='s, leave out what is before')
    out.add_argument('--end', type=TIME, default=np.inf, help='s, leave out what is after')
    out.add_argument('--namespace', help='of the drone, if the bag has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_flow``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> result.Report:
        data = read(options.bag, options.floor, options.start, options.end, options.shift,
                    options.namespace, options.lowest)
        return _report(options.bag, data, options.leak, options.slowest)
    return result.run('identify_flow', options, work)


if __name__ == '__main__':
    raise SystemExit(main())
