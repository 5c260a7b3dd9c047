"""Common parts of the identification commands: options, table, JSON, plot, vehicle file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.command import guard, Parser, write_json
from mambo_bags.reader import Bag, BagError, read_bag
from mambo_model import palette
from mambo_model.schema import ParameterError
from mambo_model.vehicle import vehicle_file
from mambo_model.vehicle.mass_properties import impossible
from mambo_model.vehicle.parameters import PRESETS, Vehicle
from mambo_model.whole_file import PICTURE, replacing, write_text
from mambo_signals import stamps
from matplotlib.figure import Figure

from .regression import IdentifyError, LEVEL, Value

METHOD = ('intervals of 95 %: least squares on residuals whitened by an autoregressive model '
          '(order by BIC), Gauss-Newton covariance, Student t')

DEFAULT = 'identified'  # the base of what nobody knows more of


class Report(NamedTuple):
    """Result of a command."""

    title: str
    values: dict[str, Value]           # by the name in the table
    facts: dict[str, Any]              # plain numbers and text besides
    notes: list[str]
    vehicle: dict[str, tuple[Any, str]]  # {name in Vehicle: (value, source)}; empty: no file
    draw: Callable[[Figure], None]
    files: dict[str, str] = {}         # {name: text} written besides, never changed
    method: str = METHOD               # of the intervals
    base: str = ''                     # that a vehicle file starts from; empty: --base


def parser(name: str, description: str) -> Parser:
    """Return the parser of a command with the common options."""
    out = Parser(name, description)
    out.add_output('DIR', 'write NAME.json, NAME.png and NAME.yaml, a vehicle, into it; older '
                   'files are replaced')
    out.add_json()
    out.add_argument('--base', metavar='VEHICLE',
                     help=f'vehicle that the new one starts from: {", ".join(PRESETS)}, or a '
                          'FILE.yaml (default: that of the scenario in the bag; without one '
                          f'{DEFAULT})')
    return out


def table(report: Report) -> str:
    """Return the report as text."""
    width = max([len(name) for name in (*report.values, *report.facts)])
    lines = [report.title, '']
    lines += [
        f'{name:<{width}}  {v.value:>12.6g} {v.unit:<9} {100 * LEVEL:.0f} %: {_bounds(v)}'
        for name, v in report.values.items()]
    lines += [f'{name:<{width}}  {_short(value)}' for name, value in report.facts.items()]
    notes = [*report.notes, *(
        f'{name}: an interval without width: its samples do not scatter beyond the resolution of '
        'the file, so it says nothing of the error'
        for name, v in report.values.items() if v.low == v.high)]
    if 'inertia' in report.vehicle and (why := impossible(report.vehicle['inertia'][0])):
        notes.append(f'no vehicle can be flown with this inertia yet: {why}, and give all three')
    return '\n'.join([*lines, '', *(f'note: {note}' for note in notes), report.method])


def _bounds(v: Value) -> str:
    """Return the limits of an interval, with as many digits as tell them apart."""
    digits = next((n for n in range(6, 17) if f'{v.low:.{n}g}' != f'{v.high:.{n}g}'), 6)
    return f'{v.low:.{digits}g} .. {v.high:.{digits}g}'


def _checked(base: str) -> str:
    """Return the name or file of a base; a file must be one that a vehicle can start from."""
    if base.endswith('.yaml'):
        content = vehicle_file.read(Path(base), Vehicle)
        if content.base is None or content.base.value not in PRESETS or content.markers:
            raise ParameterError(
                f'--base: {base}: a vehicle starts from a file with a known "base" and without '
                '"markers"')
    return base


def _based(
    base: str, values: dict[str, tuple[Any, str]],
) -> tuple[str, dict[str, tuple[Any, str]]]:
    """Return the known vehicle at the root of a base, and the values with those of its file."""
    if not base.endswith('.yaml'):
        return base, values
    content = vehicle_file.read(Path(base), Vehicle)
    kept = {name: (value, f'of {Path(base).name}') for name, value in content.values.items()}
    return content.base.value if content.base else base, kept | values


def _short(value: Any) -> str:
    return f'{value:>12.6g}' if isinstance(value, float) else str(value)


def as_json(report: Report) -> str:
    """Return the report as JSON."""
    return json.dumps({
        'title': report.title, 'level': LEVEL, 'method': report.method,
        'values': {name: v._asdict() for name, v in report.values.items()},
        'facts': report.facts, 'notes': report.notes}, indent=2, allow_nan=False)


def drawn_force(
    t: Any, measured: Any, residual: Any, axes: str = 'xyz',
) -> Callable[[Figure], None]:
    """
    Return what draws the specific force, measured and as fitted, one row for each of ``axes``.

    Parameters
    ----------
    t : (n,) s
    measured, residual : (n, 3) m/s^2, body FLU

    """
    def draw(figure: Figure) -> None:
        """Draw the rows."""
        rows = figure.subplots(len(axes), 1, sharex=True, squeeze=False)[:, 0]
        flown, fitted = palette.lines(['accelerometer', 'model'])
        for row, axis in zip(rows, axes):
            i = 'xyz'.index(axis)
            row.plot(t, measured[:, i], label='accelerometer', **flown)
            row.plot(t, measured[:, i] - residual[:, i], label='model', **fitted)
            row.set_title(f'specific force along {axis} [m/s^2], FLU')
        rows[0].legend()
        rows[-1].set_xlabel('time [s]')
    return draw


def vehicle_text(report: Report, base: str) -> str:
    """
    Return the vehicle file of a report; empty without values of one.

    Raises
    ------
    mambo_model.schema.ParameterError
        If a value is none that a vehicle can have.

    """
    if not report.vehicle:
        return ''
    return vehicle_file.to_text(report.title, *_based(base, report.vehicle), Vehicle)


def write(name: str, report: Report, folder: Path, base: str) -> list[Path]:
    """
    Write a report into a folder, which is created; return the files.

    Raises
    ------
    InputError, JobError
        If that is not possible.
    mambo_model.schema.ParameterError
        If a value is none that a vehicle can have.

    """
    texts = {f'{name}.json': as_json(report) + '\n', **report.files}
    if vehicle := vehicle_text(report, base):
        texts[f'{name}.yaml'] = vehicle
    for file, text in texts.items():
        write_text(folder / file, text)
    figure = Figure(figsize=(9.0, 6.0), layout='constrained')
    report.draw(figure)
    with replacing(folder / f'{name}.png', PICTURE) as part:
        figure.savefig(part, format='png', dpi=120)
    return [folder / file for file in (*texts, f'{name}.png')]


def run(name: str, options: argparse.Namespace, work: Callable[[], Report]) -> int:
    """Do the work of a command, print and write its report; return the exit code."""
    def whole() -> None:
        """Check the base; work, print and write."""
        if options.base is not None:
            if not options.base.endswith('.yaml') and options.base not in PRESETS:
                raise ParameterError(
                    f'--base: vehicle {options.base!r} is unknown; known: {", ".join(PRESETS)}, '
                    'or a FILE.yaml')
            options.base = _checked(options.base)
        report = _named(options, work)
        base = report.base or options.base or DEFAULT
        vehicle_text(report, base)  # refuses values of no vehicle, also without --output
        if options.json != '-':
            print(table(report))
        if options.json and (path := write_json(options.json, as_json(report))):
            print(f'wrote {path}')
        if options.output:
            for file in write(name, report, options.output, base):
                if options.json != '-':
                    print(f'wrote {file}')
    return guard(name, whole)


def _named(options: argparse.Namespace, work: Callable[[], Report]) -> Report:
    """Return the report of a command; an error about the data names their file or bag."""
    source: Path | None = getattr(options, 'file', None) or getattr(options, 'bag', None)
    try:
        return work()
    except IdentifyError as error:
        if source is None or source.name in str(error) or str(error).startswith('--'):
            raise
        raise type(error)(f'{source}: {error}') from None


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag, a directory or an MCAP file, not a bench file."""
    return path.is_dir() or path.suffix == '.mcap'


def open_bag(path: Path, topics: tuple[str, ...], namespace: str | None = None,
             also: tuple[str, ...] = ()) -> Bag:
    """
    Read a bag that must have topics, and may have others.

    Raises
    ------
    mambo_bags.reader.BagError
        If it cannot be read, lacks one or its messages, or has stamps that go back.

    """
    bag = read_bag(path, (*topics, *also), namespace)
    for topic in topics:
        if not len(bag.messages(topic)):  # which says which there are, if not this one
            raise BagError(f'{path}: {bag.name(topic)} has no messages')
    stamps.refuse_wrong(bag, topics)
    return bag
