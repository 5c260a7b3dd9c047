"""
Optitrack takes as bags: ``import_motive TAKE.csv OUT --body NAME``.

Reads the CSV export of Motive 1.9 to 3.x, format versions 1.2 to 1.29 (docs.optitrack.com, Data
Export: CSV): a line of keys and values about the take, then the type, name and ID of what each
column belongs to (and its parent, from 1.25), then Rotation or Position, then the axes. A column
without a name of its own (marker error, time code) is skipped. The columns of one rigid body
become ``optitrack/pose``; where its markers were lost the cells are empty, and there is no pose;
likewise where the quaternion is of zeros. Frozen and impossible poses are left out
(:mod:`mambo_signals.poses.frozen`, :mod:`mambo_signals.poses.outliers`). All are counted.

Axes
    The file does not say which axis is up. Motive's own is y, with x to the right and z towards
    the viewer, and becomes z up by a quarter turn about x: (x, -z, y), for the axes of the body
    alike, which in Motive are those of the room at the moment the body is defined. ``--up z`` for
    an export or a ground plane with z up. ``--nose`` says how the nose stood then.

Angles
    Quaternions x y z w; or Euler angles in degrees about the axes of the moving body in the
    order of their name (NatNet SDK, EulOrdXYZr).

Time
    In seconds, as Motive always writes it; a take whose times give another frame rate than its
    header is refused, as their unit is then unknown. The time column of some versions is rounded
    to ms. Where it agrees with frame number over export rate to its last digit, the latter is
    used. Stamps are from the start of the take; when that was, in the words of the file, is in
    the bag's metadata.
"""

from __future__ import annotations

import csv
import dataclasses
from io import StringIO
import math
from pathlib import Path
import re
from typing import Any

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser
from mambo_bags.mcap_reader import BagError
from mambo_bags.writer import BagWriter
from mambo_signals.motion import Motion
from mambo_signals.poses import frozen, outliers
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .checks import plausible, slips, tilts
from .common import (
    importer_parser, LARGEST, LONGEST, number, provenance, Publisher, quoted, read_source, report,
    shortened, Source, stamps_ns, unused)

Floats = NDArray[np.float64]
TOPIC = 'optitrack/pose'
UNITS = {'meters': 1.0, 'metres': 1.0, 'centimeters': 0.01, 'millimeters': 0.001,
         'inches': 0.0254, 'feet': 0.3048}
ORDERS = ('XYZ', 'XZY', 'YXZ', 'YZX', 'ZXY', 'ZYX')
UP = {'y': Rotation.from_euler('x', 90.0, degrees=True), 'z': Rotation.identity()}
LOOSE_NORM = 0.01  # [-] how far from 1 a rounded quaternion may be
KEYS = ('Format Version', 'Coordinate Space', 'Length Units', 'Rotation Type',
        'Export Frame Rate', 'Capture Frame Rate', 'Total Exported Frames')
"""Keys of the first line that are used."""
RATES = (0.01, 1e5)  # [Hz] of a take
ROUNDED = 6e-4  # [s] half of the last digit of the coarsest time column, and a little
GAP = 1.5  # [-] usual periods between two frames; beyond, one is missing
RATE_ERROR = 0.05
"""By which the rate of the times may differ from the header's [-]. Motive writes frame number over
rate, so only the rounding of a nominal rate (29.97 Hz as 30) and of the times is left."""


@dataclasses.dataclass(frozen=True)
class Take:
    """
    One rigid body of a take, in the file's axes.

    Attributes
    ----------
    times : (n,) s
        From the start of the take.
    position : (n, 3) m
        NaN where the markers were lost.
    rotation : (n, 4)
        x y z w, NaN likewise.
    body
        Name.
    about
        The first line of the file.
    others
        Names of what else the file holds.
    zeros
        How many frames have a quaternion of zeros, no attitude: NaN.

    """

    times: Floats
    position: Floats
    rotation: Floats
    body: str
    about: dict[str, str]
    others: list[str]
    zeros: int = 0

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Return where there is a pose, (n,)."""
        return np.isfinite(self.position).all(axis=1) & np.isfinite(self.rotation).all(axis=1)


def _about(path: Path, row: list[str]) -> dict[str, str]:
    """Return the keys and values of the first line."""
    cells = [cell.strip() for cell in row]
    other = re.match(r'"?Format Version"?\s*?([;|\t])', row[0]) if row else None
    if other:
        name = 'a tab' if other[1] == '\t' else repr(other[1])
        raise BagError(f'{path}: its cells are separated by {name}: export or save it with commas '
                       'instead')
    if not cells or cells[0] != 'Format Version':
        raise BagError(
            f'{path}: no CSV export of Motive (line 1 must begin with "Format Version"; export '
            'with header information)')
    twice = [key for key in KEYS if cells[::2].count(key) > 1]
    if twice:
        raise BagError(f'{path}: line 1 gives {quoted(twice[0])} twice: keep only the right one')
    about = dict(zip(cells[::2], cells[1::2]))
    version = about['Format Version'] if 'Format Version' in about else ''
    if not re.fullmatch(r'1\.2\d?', version):
        raise BagError(f'{path}: format version {quoted(version)}; 1.2 to 1.29 are read')
    if about.get('Coordinate Space', 'Global') != 'Global':
        raise BagError(f'{path}: coordinates are {quoted(about["Coordinate Space"])}; export with '
                       'world (global) coordinates')
    if about.get('Length Units', '').lower() not in UNITS:
        raise BagError(f'{path}: length unit {quoted(about.get("Length Units", ""))} is not one '
                       f'of {", ".join(UNITS)}')
    if about.get('Rotation Type') not in ('Quaternion', *ORDERS):
        raise BagError(f'{path}: rotation type {quoted(about.get("Rotation Type", ""))} is not '
                       f'one of Quaternion, {", ".join(ORDERS)}')
    return about


def _header(path: Path, rows: list[list[str]]) -> tuple[int, dict[str, dict[str, int]]]:
    """Return the line of the axes and {rigid body: {Rotation X: column, ...}}."""
    line = next((i for i, row in enumerate(rows[:16]) if row and row[0].strip() == 'Frame'), -1)
    head = [row for row in rows[1:max(line, 0)] if any(cell.strip() for cell in row)]
    if line < 0 or len(head) < 3:
        raise BagError(f'{path}: the lines with Type, Name, Rotation and Position and the axes '
                       'are missing or cut off')
    width = len(rows[line])
    types, names, kinds = ([cell.strip().strip('"') for cell in row] + [''] * width
                           for row in (head[0], head[1], head[-1]))
    bodies: dict[str, dict[str, int]] = {}
    twice: dict[str, list[str]] = {}
    for column in range(2, width):
        name = f'{kinds[column]} {rows[line][column].strip()}'
        if types[column] == 'Rigid Body' and name.startswith(('Rotation ', 'Position ')):
            if name in bodies.setdefault(names[column], {}):
                twice.setdefault(names[column], []).append(name)
            bodies[names[column]][name] = column
    for body, doubled in twice.items():
        if len(set(doubled)) == len(bodies[body]):
            raise BagError(f'{path}: two rigid bodies are named {quoted(body)}')
        raise BagError(f'{path}: line {line + 1}: rigid body {quoted(body)} has the column '
                       f'{doubled[0]} twice: the axes are damaged')
    if not bodies:
        raise BagError(f'{path}: no rigid body; export with rigid bodies (rigid body bones) on')
    return line, bodies


def _others(rows: list[list[str]], line: int, body: str) -> list[str]:
    """Return the names of rigid bodies and markers that are not a body."""
    names = [row for row in rows[1:line] if any(cell.strip() for cell in row)][1][2:]
    found = dict.fromkeys(cell.strip().strip('"') for cell in names)
    return [name for name in found if name and name != body]


def _choose(path: Path, bodies: dict[str, dict[str, int]], body: str | None) -> str:
    names = shortened([quoted(name) for name in bodies])
    if body is None and len(bodies) > 1:
        raise BagError(f'{path}: several rigid bodies; say which with --body: {names}')
    if body is not None and body not in bodies:
        raise BagError(f'{path}: no rigid body {quoted(body)}; it has {names}')
    return next(iter(bodies)) if body is None else body


def _numbers(path: Path, rows: list[list[str]], line: int, columns: list[int]) -> Floats:
    """Return cells as (n, k), empty ones as NaN."""
    width, out = len(rows[line]), []
    for at, row in enumerate(rows[line + 1:], line + 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) < width or any(cell.strip() for cell in row[width:]):
            raise BagError(f'{path}: line {at} has {len(row)} cells, not {width}: the file '
                           'is cut off or damaged')
        try:
            out.append([number(row[c]) if row[c].strip() else math.nan for c in columns])
        except ValueError as error:
            raise BagError(f'{path}: line {at}: {error}') from None
        absurd = [value for value in out[-1] if abs(value) >= LARGEST]
        if absurd:
            raise BagError(f'{path}: line {at}: {absurd[0]:g} is absurdly large')
    if not out:
        raise BagError(f'{path}: no frames, only a header')
    return np.array(out)


def _rates(about: dict[str, str]) -> dict[str, float]:
    """Return {name: Hz} of the frame rates of the header that can be true; the export's first."""
    out = {}
    for name in ('Export Frame Rate', 'Capture Frame Rate'):
        try:
            rate = number(about.get(name, ''))
        except ValueError:
            continue
        if RATES[0] <= rate <= RATES[1]:
            out[name] = rate
    return out


def _check_unit(
    path: Path, label: str, frames: Floats, times: Floats, rates: dict[str, float],
) -> None:
    """Raise BagError if times, (n,), are not in seconds by their label or by the frame rates."""
    unit = re.fullmatch(r'Time\s*\((.*)\)', label.strip().strip('"'))
    if unit and unit[1].strip().lower() not in ('seconds', 'sec', 's'):
        raise BagError(f'{path}: the unit of its times is {quoted(unit[1])}: export them in '
                       'seconds')
    if len(times) < 2 or not rates:
        return
    span, count = times[-1] - times[0], frames[-1] - frames[0]
    if all(abs(span - count / rate) > RATE_ERROR * count / rate + 2.0 * ROUNDED
           for rate in rates.values()):
        name, rate = next(iter(rates.items()))
        raise BagError(f'{path}: its times give {count / span:.4g} frames/s, its {name} is '
                       f'{rate:g} Hz: export times in seconds, with the rate of the take')


def _times(
    path: Path, label: str, frames: Floats, times: Floats, about: dict[str, str],
) -> Floats:
    """Return exact times, (n,) s, checked against their label, the frames and the frame rate."""
    sound = np.isfinite(frames) & (times <= LONGEST)
    sound[0] &= times[0] >= 0.0
    if not sound.all():
        raise BagError(f'{path}: row {int(np.argmin(sound)) + 1} of the frames has no frame '
                       f'number, or no time from 0 to {LONGEST:g} s')
    for values, what in ((frames, 'frame numbers'), (times, 'times')):
        back = np.flatnonzero(np.diff(values) <= 0.0)
        if len(back):
            raise BagError(f'{path}: its {what} do not increase after frame '
                           f'{frames[back[0]]:.0f} ({times[back[0]]:g} s)')
    told = about.get('Total Exported Frames', '')
    if told.isascii() and told.isdecimal() and told.lstrip('0') != str(len(frames)):
        raise BagError(f'{path}: it has {len(frames)} of {told[:20]} exported frames: the file is '
                       'cut off')
    rates = _rates(about)
    _check_unit(path, label, frames, times, rates)
    if not rates:
        return times
    rate = next(iter(rates.values()))
    by_frame = (frames - frames[0] + round(times[0] * rate)) / rate
    return by_frame if (np.abs(by_frame - times) <= ROUNDED).all() else times


def _rotations(path: Path, frames: Floats, angles: Floats, kind: str) -> Floats:
    """
    Return x y z w, (n, 4); NaN where an angle is NaN or a quaternion is all zeros.

    Errors name the number of the frame.
    """
    if kind == 'Quaternion':
        norm = np.linalg.norm(angles, axis=1)
        norm = np.where(norm == 0.0, math.nan, norm)
        wrong = np.flatnonzero(np.abs(norm - 1.0) > LOOSE_NORM)
        if len(wrong):
            raise BagError(f'{path}: the quaternion of frame {frames[wrong[0]]:.0f} has the '
                           f'length {norm[wrong[0]]:.3g}, not 1')
        return angles / norm[:, None]
    out = np.full((len(angles), 4), math.nan)
    good = np.isfinite(angles).all(axis=1)
    ordered = angles[good][:, ['XYZ'.index(axis) for axis in kind]]
    if len(ordered):
        out[good] = Rotation.from_euler(kind, ordered, degrees=True).as_quat()
    return out


def read_take(source: Source, body: str | None = None) -> Take:
    """
    Read one rigid body of a CSV export.

    Raises
    ------
    BagError
        If the file is no such export, is damaged or cut off, the body is not in it or is never
        seen.

    """
    path = source.path
    try:
        rows = list(csv.reader(StringIO(source.text(), newline='')))
    except csv.Error as error:
        raise BagError(f'{path}: no CSV file ({error})') from None
    about = _about(path, rows[0] if rows else [])
    line, bodies = _header(path, rows)
    name = _choose(path, bodies, body)
    turn = about['Rotation Type']
    wanted = [f'Rotation {axis}' for axis in ('XYZW' if turn == 'Quaternion' else 'XYZ')]
    wanted += [f'Position {axis}' for axis in 'XYZ']
    missing = [column for column in wanted if column not in bodies[name]]
    if missing:
        raise BagError(f'{path}: rigid body {quoted(name)} lacks the columns {", ".join(missing)}')
    if turn != 'Quaternion' and 'Rotation W' in bodies[name]:
        raise BagError(f'{path}: its header has the rotation type {turn}, but the columns of '
                       f'{quoted(name)} are a quaternion, X, Y, Z and W: export it again')
    table = _numbers(path, rows, line, [0, 1, *(bodies[name][column] for column in wanted)])
    times = _times(path, rows[line][1], table[:, 0], table[:, 1], about)
    zeros = (table[:, 2:-3] == 0.0).all(axis=1).sum() if turn == 'Quaternion' else 0
    take = Take(times, UNITS[about['Length Units'].lower()] * table[:, -3:],
                _rotations(path, table[:, 0], table[:, 2:-3], turn), name, about,
                _others(rows, line, name), int(zeros))
    if not take.seen.any():
        raise BagError(f'{path}: rigid body {quoted(name)} is never seen'
                       f'{": its quaternions are of zeros" if take.zeros else ""}')
    return take


def poses(take: Take, up: str = 'y', nose: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """
    Return the valid poses of a take, with z up.

    Parameters
    ----------
    take
    up
        The axis that is up in the file, y or z.
    nose : rad
        Direction of the nose in the body's axes, counter-clockwise from their x, from above.

    Returns
    -------
    Times (n,) s; position (n, 3) m, z up; orientation (n, 4) x y z w, body FLU to z up.

    """
    seen, turn = take.seen, UP[up]
    attitude = turn * Rotation.from_quat(take.rotation[seen]) * turn.inv()
    attitude = attitude * Rotation.from_euler('z', nose)
    return take.times[seen], turn.apply(take.position[seen]), attitude.as_quat()


def _still(times: Floats, position: Floats, attitude: Floats) -> list[str]:
    """Return a line about a body that hardly moves."""
    found = plausible.still(times, position, attitude)
    if found is None:
        return []
    span, turns = found
    hint = ('while the attitude changes: check the unit of the export, unless the vehicle was '
            'held' if turns else 'throughout: was another rigid body flown?')
    return [f'{TOPIC}: the positions stay within {span:.2g} m {hint}']


def _gaps(times: Floats) -> list[str]:
    """Return a line about frames that are missing between others, at times (n,) s."""
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    gaps = np.flatnonzero(steps > GAP * usual)
    if not len(gaps):
        return []
    missing, longest = int(np.rint(steps[gaps] / usual - 1.0).sum()), int(steps.argmax())
    return [f'{TOPIC}: {missing} frame{"s are" if missing > 1 else " is"} missing in the file, '
            f'most from {times[longest]:.2f} to {times[longest + 1]:.2f} s: was it cut?']


def import_motive(
    source: Path, target: Path, body: str | None = None, up: str = 'y', nose: float = 0.0,
) -> tuple[dict[str, int], list[str]]:
    """
    Write a bag from a CSV export of Motive.

    Parameters
    ----------
    source
        CSV file.
    target
        Directory to make.
    body
        Name of the rigid body; may be left out if there is one only.
    up, nose
        As for :func:`poses`.

    Returns
    -------
    {topic: messages}; lines on what was left out or not used.

    Raises
    ------
    BagError
        If the file is not usable; nothing is written then.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    file = read_source(source)
    take = read_take(file, body)
    times, position, attitude = poses(take, up, nose)
    still, wrong, turned = plausible.doubtful_poses(
        f'{source}: {TOPIC}', TOPIC, times, position, attitude)
    good = ~(still | wrong)
    frames, lost, impossible = len(take.times), int((~take.seen).sum()), int(wrong.sum())
    times, position, attitude = times[good], position[good], attitude[good]
    notes = [f'{TOPIC}: {lost} of {frames} frames have no pose of {quoted(take.body)} and are '
             'left out'] if lost else []
    notes += [f'{TOPIC}: {take.zeros} of them have a quaternion of zeros, no attitude'
              ] if take.zeros else []
    notes += [frozen.describe(TOPIC, int(still.sum()))] if still.any() else []
    notes += [outliers.describe(TOPIC, impossible)] if impossible else []
    notes += [*turned, *slips.describe(TOPIC, times, position), *_still(times, position, attitude)]
    flown = Motion(TOPIC, stamps_ns(times), position, attitude)
    notes += [f'{TOPIC}: {line}' for line in filter(None, [tilts.describe(flown)])]
    notes += _gaps(take.times)
    details: dict[str, Any] = {
        'body': take.body, 'up': up, 'nose_rad': nose, 'frames': frames, 'frames_lost': lost,
        **({'poses_frozen': int(still.sum())} if still.any() else {}),
        'poses_impossible': impossible}
    details |= {f'motive_{key.lower().replace(" ", "_")}': value
                for key, value in take.about.items() if key}
    record = provenance(source.name, file.sha256, 'import_motive', 'Motive CSV export', details)
    with BagWriter(target, metadata=record) as writer:
        out = Publisher(writer, {TOPIC: 'geometry_msgs/msg/PoseStamped'})
        for stamp, p, q in zip(stamps_ns(times).tolist(), position.tolist(), attitude.tolist()):
            out.publish(TOPIC, stamp, 'map', pose=out.pose(p, q))
        return writer.counts, [*notes, *unused(take.others)]


def parser() -> Parser:
    """Return the command line."""
    out = importer_parser('import_motive', __doc__, 'take', 'CSV export of Motive')
    out.add_argument('--body', help='name of the rigid body, if there are several')
    out.add_argument('--up', choices=tuple(UP), default='y',
                     help="axis that is up in the file (default: %(default)s, Motive's own)")
    out.add_argument('--nose', type=real(-360.0, 360.0, 'deg'), default=0.0, metavar='DEG',
                     help="direction of the nose from the rigid body's x axis, "
                          'counter-clockwise from above (default: %(default)g)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``import_motive``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        counts, notes = import_motive(options.take, options.output, options.body, options.up,
                                      math.radians(options.nose))
        report(options.take, options.output, counts, *notes)

    return guard('import_motive', work)


if __name__ == '__main__':
    raise SystemExit(main())
