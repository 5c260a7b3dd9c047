"""Tables and figure of ``drift_experiments``: predicted and flown drift of each mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.compare import digest
from mambo_bags.mcap_reader import BagError
from mambo_model import palette
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullLocator
import numpy as np

from ..figures.drawing import sheet
from .observations import OBSERVATIONS
from .paths import Array, EXPERIMENTS, PATHS
from .table import ROWS

TITLES = {
    'drift_w_half': '0.5 rad/s', 'drift_w_1': '1 rad/s', 'drift_w_2': '2 rad/s',
    'drift_half_amplitude': 'half the size, 1 rad/s',
    'drift_hand_loop': 'by hand, level, 1 rad/s'}
SPEEDS = [name for name in EXPERIMENTS if name.startswith('drift_w')]


class Flown(NamedTuple):
    """Drift in x per turn of one mechanism in one experiment; lists have one value per seed."""

    loop: float            # area that the first seed encloses in x and h, over that of the path
    perfect: float         # m, with perfect tracking
    predicted: float       # m, by the equation along the motion of the first seed
    measured: list[float]  # m
    vehicle: list[float]   # m, by which the vehicle itself moves on


class Found(NamedTuple):
    """What flights of one mechanism support."""

    truth: str
    grain: str
    model: tuple[str, ...]  # the most probable one
    probability: float
    included: float         # probability of the true mechanism, alone or with another one
    value: float            # of its parameter, fitted alone
    sigma: float


Drifts = Mapping[str, Mapping[str, Flown]]  # {experiment: {flight: drift}}


def number(x: float) -> str:
    """Return metres with three digits and sign, 0 where they are 0."""
    return '0' if abs(x) < 5e-4 else f'{x:+.3f}'


def perfect_table(perfect: Mapping[str, Array]) -> str:
    """Return the table of predicted drift, {row: drift (paths, 2) m}, compared with the audit."""
    out = ['| mechanism | ' + ' | '.join(PATHS) + ' | largest difference |',
           '|---' * (len(PATHS) + 2) + '|']
    for name, found in perfect.items():
        apart = np.abs(found - np.array(ROWS[name].audit))
        cells = ' | '.join(f'{number(x)}, {number(y)}' for x, y in found)
        out.append(f'| {name}: {ROWS[name].says} | {cells} | {np.nanmax(apart):.3f} |')
    return '\n'.join(out) + '\n'


def observed_table(shown: Mapping[str, Mapping[str, bool]]) -> str:
    """Return which of the thesis's observations each mechanism shows."""
    out = ['| mechanism | ' + ' | '.join(o.name for o in OBSERVATIONS) + ' | of ten |',
           '|---' * (len(OBSERVATIONS) + 2) + '|']
    out += [f'| {name} | ' + ' | '.join('yes' if x else '-' for x in row.values())
            + f' | {sum(row.values())} |' for name, row in shown.items()]
    return '\n'.join(out) + '\n'


def sources_table() -> str:
    """Return what the thesis observed, and where."""
    return '\n'.join([
        '| observation | where | what |', '|---|---|---|',
        *(f'| {o.name} | {o.source} | {o.says} |' for o in OBSERVATIONS)]) + '\n'


def flown_table(flown: Drifts) -> str:
    """Return predicted and flown drift, one row for each experiment and mechanism."""
    out = ['| experiment | mechanism | perfect tracking | loop flown | along it | flown, mean of '
           'seeds (least to most) | vehicle |', '|---|---|---|---|---|---|---|']
    for name, drifts in flown.items():
        for key, d in drifts.items():
            span = f'{number(min(d.measured))} to {number(max(d.measured))}'
            out.append(
                f'| `{name}` | {key.upper()} | {number(d.perfect)} | {d.loop:.2f} | '
                f'{number(d.predicted)} | **{number(float(np.mean(d.measured)))}** ({span}) | '
                f'{number(float(np.mean(d.vehicle)))} |')
    return '\n'.join(out) + '\n'


def found_table(found: Sequence[Found], value: Mapping[str, float]) -> str:
    """Return what the flights of each mechanism support; ``value`` {flight: its true value}."""
    out = ['| true | flights and evidence | most probable | probability | of the true one | '
           'its value, alone | true value |', '|---|---|---|---|---|---|---|']
    for f in found:
        out.append(
            f'| {f.truth.upper()} | {f.grain} | {"+".join(f.model) or "none"} | '
            f'{f.probability:.2f} | {f.included:.2f} | {f.value:.3f} +- {1.96 * f.sigma:.3f} | '
            f'{value[f.truth]:.3f} |')
    return '\n'.join(out) + '\n'


def put(tables: Sequence[str], document: str, where: Path) -> str:
    """
    Return a document with tables in place of those with the same first line.

    Raises
    ------
    BagError
        If it has no such table.

    """
    lines = document.splitlines()
    for table in tables:
        new = table.splitlines()
        if new[0] not in lines:
            raise BagError(f'{where}: has no table that begins with "{new[0]}": put this line '
                           'where the table shall be')
        begin = end = lines.index(new[0])
        while end < len(lines) and lines[end].startswith('|'):
            end += 1
        lines[begin:end] = new
    return '\n'.join(lines) + '\n'


def _bars(axes: Axes, drifts: Mapping[str, Flown]) -> None:
    """Draw the predicted and flown drift of each mechanism in one experiment."""
    for k, (d, style) in enumerate(zip(drifts.values(), palette.lines(drifts), strict=True)):
        colour = style['color']
        mean = float(np.mean(d.measured))
        axes.bar(k - 0.27, d.perfect, 0.25, fill=False, edgecolor=colour)
        axes.bar(k, d.predicted, 0.25, color=colour, alpha=0.4)
        axes.bar(k + 0.27, mean, 0.25, color=colour)
        axes.plot([k + 0.27] * len(d.measured), d.measured, '.', color=palette.INK, markersize=2)
        top = max(*d.measured, 0.0)
        axes.annotate(f'{mean:.2f}' if abs(mean) > 5e-3 else '0', (k + 0.27, top), (0, 2),
                      textcoords='offset points', ha='center', va='bottom', fontsize=7)
    axes.set_xticks(range(len(drifts)), [key.upper() for key in drifts])
    axes.grid(False, axis='x')
    axes.axhline(0.0, color=palette.INK, linewidth=0.6)


def _over_speed(axes: Axes, flown: Drifts) -> None:
    """Draw the drift over the speed: lines for perfect tracking, points for flights."""
    speeds = [EXPERIMENTS[name][0] for name in SPEEDS]
    keys = flown[SPEEDS[0]]
    for key, style, marker in zip(keys, palette.lines(keys), 'os^Dv', strict=False):
        axes.loglog(speeds, [flown[n][key].perfect for n in SPEEDS], **style)
        axes.loglog(speeds, [np.mean(flown[n][key].measured) for n in SPEEDS], marker,
                    color=style['color'], markersize=4, label=key.upper())
    axes.set_xticks(speeds, [f'{speed:g}' for speed in speeds])
    axes.set_yticks([0.05, 0.1, 0.2, 0.5, 1.0], ['0.05', '0.1', '0.2', '0.5', '1'])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set(xlabel='speed [rad/s]', ylabel='drift in a turn [m]')
    axes.legend(fontsize=7, frameon=False, handletextpad=0.2)


def shows(flown_rows: str) -> str:
    """Return the digest of the figure, by its table (:func:`flown_table`) and its colours."""
    return digest.of_text(flown_rows.strip(), str(palette.ROLES))


def draw(flown: Drifts) -> Figure:
    """Draw the drift by mechanism, predicted and flown, for each experiment and over speed."""
    figure, plots = sheet(2, 3, 2.3)
    *bars, last = plots
    for axes, (name, drifts) in zip(bars, flown.items(), strict=True):
        _bars(axes, drifts)
        axes.set_title(TITLES[name], fontsize='small')
        axes.margins(y=0.1)
    _over_speed(last, flown)
    last.set_title('line: perfect, dot: flown', fontsize='small')
    for axes in (plots[0], plots[3]):
        axes.set_ylabel('drift in a turn [m]')
    for axes in bars:
        axes.set_xlabel('mechanism')
    grey = palette.COLOURS['soft']
    figure.legend(handles=[
        Patch(fill=False, edgecolor=grey, label='predicted, perfect tracking'),
        Patch(color=grey, alpha=0.4, label='predicted along the motion flown'),
        Patch(color=grey, label='flown, mean; dots: seeds')],
        loc='outside upper center', ncols=3, frameon=False, fontsize='small')
    return figure
