"""
How often the intervals of ``identify flight`` hold: flights of a known vehicle, over seeds.

Each seed flies a Crazyflie of known parameters in closed loop, with the noise, bias and motion
capture of the simulator, and its bag is identified like any other. An interval of 95 % should
hold the true value in 95 of 100 flights. Gravity is the standard one. With ``--output`` each
flight is kept in a file, and a command that was ended goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import json
from pathlib import Path
import tempfile
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import real
from mambo_bags.command import counted, guard, Parser
from mambo_flight import closed_loop, recording_to_bag
from mambo_flight.accuracy.bound import add_seeds, seeds_of
from mambo_flight.scenario import Scenario, scenario
from mambo_model.errors import InputError
from mambo_model.motion.trajectory import TRAJECTORIES
from mambo_model.vehicle.parameters import preset, Vehicle
from mambo_model.whole_file import write_text
import numpy as np

from ..identify.regression import IdentifyError
from .force import fit_force, Found
from .identify_flight import hover_command
from .moments import fit_moments
from .recorded import GRAVITY, read_flight

BASE = 'crazyflie'
DRAG = (0.4, 0.2)        # 1/s, horizontal and vertical
VIBRATION = {'gyro_vibration': (0.01, 0.01, 0.01), 'accel_vibration': (0.3, 0.3, 0.3)}
"""rad/s and m/s^2: about what the recordings of a Crazyflie show."""
PATH, SECONDS = 'circle_bobbing', 40.0
LARGEST = 10_000_000     # bytes of a file with results


class Trial(NamedTuple):
    """One flight: by parameter the value, the limits of its interval, and the truth."""

    seed: int
    values: dict[str, tuple[float, float, float, float]]


def flight_of(seed: int, path: str = PATH, seconds: float = SECONDS) -> Scenario:
    """Return the flight of a seed along a trajectory, for some s."""
    vehicle, imu = 'sim_node.simulator.vehicle', 'sim_node.simulator.imu'
    changed = {f'{vehicle}.drag_reading': 'acceleration', f'{vehicle}.drag_coefficient': DRAG[0],
               f'{vehicle}.vertical_drag_coefficient': DRAG[1],
               f'{vehicle}.gravity': GRAVITY}
    return scenario(
        path, duration=seconds, seed=seed, land=False, vehicle=BASE,
        overrides=changed | {f'{imu}.{name}': value for name, value in VIBRATION.items()})


def truth_of(vehicle: Vehicle, found: Found) -> dict[str, float]:
    """Return the true parameters; the thrust at the mean command that was found."""
    a, b = vehicle.power_a, vehicle.power_b
    out = {'drag x': DRAG[0], 'drag y': DRAG[0], 'drag z': DRAG[1], 'exponent': b,
           'thrust': a * found.model.command ** b / vehicle.mass,
           'motor lag': vehicle.motor_time_constant,
           'hover command': (vehicle.mass * GRAVITY / 4.0 / a) ** (1.0 / b)}
    return out | {f'inertia {axis}': x for axis, x in zip('xyz', vehicle.inertia)}


def trial(seed: int, path: str = PATH, seconds: float = SECONDS) -> Trial:
    """
    Fly a seed, identify its bag, and return what it shows.

    Raises
    ------
    IdentifyError
        If the flight shows nothing.

    """
    flight, vehicle = flight_of(seed, path, seconds), preset(BASE)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / f'seed_{seed}'
        recording_to_bag.write(bag, flight, closed_loop.fly(flight, inner=True))
        recorded = read_flight(bag)
    found = fit_force(recorded)
    values = {**found.shown, 'hover command': hover_command(found)}
    values |= {f'inertia {axis}': one.value for axis, one in fit_moments(
        recorded, found, vehicle, vehicle.motor_time_constant).items() if one.value}
    return Trial(seed, {name: (values[name].value, values[name].low, values[name].high, true)
                        for name, true in truth_of(vehicle, found).items() if name in values})


def table(trials: Iterable[Trial]) -> str:
    """Return how often each interval holds, and its width over the scatter of the values."""
    trials = list(trials)
    names = list(dict.fromkeys(name for one in trials for name in one.values))
    width = max(map(len, names), default=9)
    lines = [f'{"parameter":<{width}}  {"held":>11}  {"%":>5}  {"mean error":>10}  '
             f'{"rms error":>10}  {"half width":>10}']
    held, shown = 0, 0
    for name in names:
        x = np.array([one.values[name] for one in trials if name in one.values])
        inside = int(np.sum((x[:, 1] <= x[:, 3]) & (x[:, 3] <= x[:, 2])))
        held, shown = held + inside, shown + len(x)
        error, half = x[:, 0] - x[:, 3], 0.5 * (x[:, 2] - x[:, 1])
        lines.append(
            f'{name:<{width}}  {f"{inside} of {len(x)}":>11}  {100.0 * inside / len(x):>5.1f}  '
            f'{error.mean():>10.3g}  {np.sqrt(np.mean(error ** 2)):>10.3g}  '
            f'{np.median(half):>10.3g}')
    if shown:
        lines.append(f'{"all":<{width}}  {f"{held} of {shown}":>11}  '
                     f'{100.0 * held / shown:>5.1f}')
    return '\n'.join(lines)


def stored(file: Path | None, what: dict[str, Any]) -> list[Trial]:
    """
    Return the flights that a file holds; none if there is no file.

    Raises
    ------
    InputError
        If it is none of this command, or of other flights.

    """
    if file is None or not file.exists():
        return []
    try:
        if file.stat().st_size > LARGEST:
            raise ValueError('too large')
        content = json.loads(file.read_text())
        trials = [Trial(int(one['seed']), {
            str(name): tuple(float(x) for x in row) for name, row in one['values'].items()})
            for one in content['trials']]
        if not all(len(row) == 4 for one in trials for row in one.values.values()):
            raise ValueError('rows of four numbers are wanted')
        flown = content['flights']
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f'{file}: is no file of mambo identify coverage: move it away') from None
    if flown != what:
        raise InputError(f'{file}: holds other flights ({flown}, not {what}): give another file')
    return trials


def _work(options: argparse.Namespace) -> None:
    what = {'trajectory': options.trajectory, 'seconds': options.duration}
    done = stored(options.output, what)
    wanted, left_out = seeds_of(options), []
    flown = {one.seed for one in done} & set(wanted)
    kept = 'and the same command goes on' if options.output else 'none is kept'
    with counted(flown, len(wanted), kept=kept):
        for seed in [seed for seed in wanted if seed not in flown]:
            try:
                done.append(trial(seed, options.trajectory, options.duration))
            except IdentifyError as error:
                left_out.append(f'seed {seed}: {error}')
            if options.output:
                write_text(options.output, json.dumps(
                    {'flights': what, 'trials': [one._asdict() for one in done]}) + '\n')
            flown.add(seed)
    print(f'{BASE}, {options.trajectory}, {options.duration:g} s, seeds {wanted[0]} to '
          f'{wanted[-1]}\n' + table(one for one in done if one.seed in wanted))
    print('\n'.join(left_out), end='\n' if left_out else '')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('identify_coverage', __doc__)
    out.add_argument('--trajectory', choices=tuple(TRAJECTORIES), default=PATH, metavar='NAME',
                     help=f'one of {", ".join(TRAJECTORIES)} (default: %(default)s)')
    out.add_argument('--duration', type=real(10.0, 600.0, 's'), default=SECONDS, metavar='S',
                     help='of a flight (default: %(default)g)')
    out.add_output('FILE', 'JSON file that keeps each flight, and from which the command goes on')
    add_seeds(out, 100)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_coverage``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('identify_coverage', lambda: _work(options))


if __name__ == '__main__':
    raise SystemExit(main())
