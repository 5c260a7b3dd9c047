"""
Whether a vehicle lay on the floor below its reference, was far from it, fell, or turned its motors
in vain: while none were asked for, or on the floor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import jit
from ..script import python
from .rigid_body import LIFTED
from .trajectory import in_flight

ABOVE = 0.2  # m, height of a reference that a vehicle on the floor does not follow (judgement)
LOW = 0.05  # m, the same of a vehicle that never rose in its flight
LONG = 0.3  # s, so long a vehicle follows no reference that leaps up; sound flights: 0.1 s at most
FAR = 5.0  # m, distance at which a vehicle does not follow its reference: horizontally, and in
#            height, or the height flown so far if that is less, at least HIGH (judgement)
HIGH = 1.0  # m, the same above a reference on the floor, which may slope
DROP = 0.15  # m above the floor, from which a vehicle falls with 1.7 m/s (judgement)
HARD = 2.0  # m/s, vertical speed at which a vehicle hits the floor, a fall of 0.2 m (judgement)
IDLE = 0.5  # s, for which a motor command holds at most, by the watchdog: so long motors may turn
#             on in a phase that asks for none, as a phase may be late in real time
STAND = 1.0  # s, so long motors turn on the floor with a reference at rest there (judgement)
AWAY = 2.0  # s, so long it needs for a leap of 10 m with an acceleration of 1 g (judgement)


@jit
def lies_below(height: float, wanted: float) -> bool:
    """
    Return whether a vehicle lies on the floor below a reference in the air, at one instant.

    The phase is of no concern: one in which the motors stand still belongs on the floor.

    Parameters
    ----------
    height, wanted : m
        True height above the point of take-off, and that of the reference.

    """
    return (wanted > ABOVE) & (height <= LIFTED)


@jit
def hits_floor(height: float, before: float, earlier: float, dt: float) -> bool:
    """
    Return whether a vehicle hits the floor in a step.

    Parameters
    ----------
    height, before, earlier : m
        True heights above the point of take-off: after the step, and one and two steps before.
    dt : s
        Of a step.

    """
    return height <= LIFTED and before > LIFTED and earlier - before > HARD * dt


@jit
def too_far(height: float, wanted: float, top: float, flown: bool) -> bool:
    """
    Return whether a vehicle is far from the height of its reference, at one instant.

    Parameters
    ----------
    height, wanted : m
        As of :func:`lies_below`.
    top : m
        Largest height of the reference in flight so far.
    flown
        Whether the reference flies; on the floor no vehicle is far below it.

    """
    off = height - wanted
    return (off > HIGH) if not flown else abs(off) > min(max(top, HIGH), FAR)


def height_fault(
    t: NDArray[np.float64], height: NDArray[np.float64], wanted: NDArray[np.float64],
    phase: NDArray[np.int64], floor: bool = True,
) -> str:
    """
    Return why a flight was not flown as asked, or an empty string.

    The reason is that the vehicle fell to the floor, rose late or never, or was far from the
    height of its reference; or that a reference in the air had a phase without motors.

    Parameters
    ----------
    t : (n,) s
        Flight time.
    height : (n,) m
        True height above the point of take-off.
    wanted : (n,) m
        Height of the reference at the same times.
    phase : (n,)
        Of the reference, GROUND ... LANDED of :mod:`mambo_model.motion.trajectory`.
    floor
        Whether there is a floor.

    """
    flown = python(in_flight)(phase)
    if floor:
        asked = np.flatnonzero(flown & (wanted > LOW))
        if len(asked) and t[asked[-1]] - t[asked[0]] >= LONG and (height <= LIFTED).all():
            return (f'the vehicle never took off: on the floor from {t[asked[0]]:.2f} to '
                    f'{t[asked[-1]]:.2f} s, up to {wanted[asked].max():.2f} m below its reference')
        if found := _longest(t, python(lies_below)(height, wanted), LONG):
            begin, end, part = found
            if not flown[part].any():
                return (f'the reference was up to {wanted[part].max():.2f} m above the vehicle on '
                        f'the floor, from {begin:.2f} to {end:.2f} s, in phase GROUND or LANDED, '
                        'in which the motors stand still: to fly, its phase must be TAKEOFF, '
                        'TRACK or LANDING')
            return (f'the vehicle was on the floor from {begin:.2f} to {end:.2f} s, up to '
                    f'{wanted[part].max():.2f} m below its reference')
    off = height - wanted
    top = np.fmax.accumulate(np.where(flown, wanted, 0.0)) if len(t) else wanted
    far = np.where(flown, np.abs(off) > np.clip(top, HIGH, FAR), off > HIGH)
    if found := _longest(t, far, AWAY):
        begin, end, part = found
        most = off[part][np.abs(off[part]).argmax()]
        return (f'the vehicle was up to {abs(most):.2f} m {"above" if most > 0.0 else "below"} '
                f'its reference, from {begin:.2f} to {end:.2f} s')
    return ''


def distance_fault(
    t: NDArray[np.float64], beside: NDArray[np.float64], phase: NDArray[np.int64],
) -> str:
    """
    Return where a vehicle was far from its reference horizontally, in flight, or ''.

    Parameters
    ----------
    t, phase
        As of :func:`height_fault`.
    beside : (n,) m
        True horizontal distance from the reference.

    """
    if found := _longest(t, python(in_flight)(phase) & (beside > FAR), AWAY):
        begin, end, part = found
        return (f'the vehicle was up to {beside[part].max():.2f} m beside its reference, from '
                f'{begin:.2f} to {end:.2f} s')
    return ''


def landing_fault(
    t: NDArray[np.float64], height: NDArray[np.float64], phase: NDArray[np.int64],
    turning: NDArray[np.bool_],
) -> str:
    """
    Return how a vehicle hit the floor hardest, or from where it fell after its landing, or ''.

    Parameters
    ----------
    t, height, phase
        As of :func:`height_fault`, with a floor.
    turning : (n,)
        Whether motors turn.

    """
    fallen, dt = height[:-2] - height[1:-1], t[1:-1] - t[:-2]  # in the step before each contact
    contact = (height[2:] <= LIFTED) & (height[1:-1] > LIFTED) & (fallen > HARD * dt) & (dt > 0.0)
    if contact.any():
        hits = np.flatnonzero(contact)
        k = int(hits[np.argmax(fallen[hits] / dt[hits])])
        return f'the vehicle hit the floor at {t[k + 2]:.2f} s with {fallen[k] / dt[k]:.1f} m/s'
    still = ~(python(in_flight)(phase) | turning)
    stops = np.flatnonzero(still[1:] & ~still[:-1]) + 1
    high = stops[height[stops] > DROP]
    if not len(high):
        return ''
    k = int(high[np.argmax(height[high])])
    return (f'the motors stopped at {t[k]:.2f} s, as the reference had landed, with the vehicle '
            f'{height[k]:.2f} m above the floor: it fell from there')


def stand_fault(
    t: NDArray[np.float64], height: NDArray[np.float64], wanted: NDArray[np.float64],
    phase: NDArray[np.int64], turning: NDArray[np.bool_],
) -> str:
    """
    Return when motors turned on the floor with the reference at rest there, but in flight, or ''.

    Parameters
    ----------
    t, height, wanted, phase, turning
        As of :func:`height_fault` and :func:`landing_fault`.

    """
    stands = (np.diff(wanted, prepend=wanted[:1]) == 0.0) & (wanted <= LIFTED)
    which = stands & (height <= LIFTED) & turning & python(in_flight)(phase)
    if (found := _longest(t, which, STAND)) is None:
        return ''
    begin, end, part = found
    return (f'the motors turned on the floor from {begin:.2f} to {end:.2f} s, as the reference '
            f'stood {wanted[part][0]:.2f} m high in a phase of flight: there its phase must be '
            'GROUND, or LANDED after a landing')


def idle_fault(
    t: NDArray[np.float64], phase: NDArray[np.int64], turning: NDArray[np.bool_],
) -> str:
    """
    Return for how long motors turned in the phases GROUND and LANDED, which ask for none, or ''.

    Parameters
    ----------
    t : (n,) s
        Times of the motor commands.
    phase : (n,)
        Of the reference at these times, GROUND ... LANDED.
    turning : (n,)
        Whether motors turn because the controller follows its reference; a failsafe does not.

    """
    idle = turning & ~python(in_flight)(phase)
    if (found := _longest(t, idle, IDLE)) is None:
        return ''
    begin, end, _ = found
    total = float(np.diff(t)[idle[:-1] & idle[1:]].sum())
    return (f'the motors turned for {total:.2f} s while the phase of the reference was GROUND or '
            f'LANDED, in which they must stand still, longest from {begin:.2f} to {end:.2f} s: '
            'the controller must answer these phases with PWM 0')


def flight_fault(
    t: NDArray[np.float64], truth: NDArray[np.float64], wanted: NDArray[np.float64],
    phase: NDArray[np.int64], turning: NDArray[np.bool_], floor: bool = True,
    ended: bool = False,
) -> str:
    """
    Return why a flight was not flown as asked: height, distance and landing; or an empty string.

    Parameters
    ----------
    t, phase, turning, floor
        As of :func:`height_fault` and :func:`landing_fault`.
    truth, wanted : (n, 3) m
        True position and that of the reference, z up.
    ended
        Whether the failsafe ended the flight: that it is not at the height of its reference is
        no reason then.

    """
    height = truth[:, 2]
    off = truth - wanted
    beside = np.sqrt(off[:, 0] * off[:, 0] + off[:, 1] * off[:, 1])
    return '; '.join(filter(None, (
        '' if ended else height_fault(t, height, wanted[:, 2], phase, floor),
        distance_fault(t, beside, phase),
        landing_fault(t, height, phase, turning) if floor else '',
        stand_fault(t, height, wanted[:, 2], phase, turning) if floor and not ended else '')))


def over_in_the_air(height: float, turning: bool) -> str:
    """
    Return in words that a flight was over before its landing, or an empty string.

    Parameters
    ----------
    height : m
        True height above the point of take-off at the end.
    turning
        Whether motors turn at the end.

    """
    if not (turning and height > LIFTED):
        return ''
    return (f'the flight was over in the air, {height:.2f} m high: no landing ended within its '
            'duration')


def _longest(
    t: NDArray[np.float64], which: NDArray[np.bool_], least: float,
) -> tuple[float, float, slice] | None:
    """Return begin, end and samples of the longest time of what is true; None: below least."""
    edges = np.flatnonzero(np.diff(which, prepend=False, append=False)).reshape(-1, 2)
    begin, end = t[edges[:, 0]], t[edges[:, 1] - 1]
    if not (end - begin >= least).any():
        return None
    k = int(np.argmax(end - begin))
    return float(begin[k]), float(end[k]), slice(*edges[k])
