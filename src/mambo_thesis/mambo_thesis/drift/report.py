"""Tables and figure of ``drift_experiments``: predicted and flown drift of each mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.compare import digest
from mambo_analysis.identify.regression import plus_minus
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

    loop: float            # area enclosed in x and height (first seed) over that of the path
    perfect: float         # m, predicted with perfect tracking
    predicted: float       # m, predicted along the motion flown (first seed)
    measured: list[float]  # m
    vehicle: list[float]   # m, drift of the vehicle itself


class Identification(NamedTuple):
    """The mechanism identified from flights whose true mechanism is known."""

    truth: str
    data_set: str
    model: tuple[str, ...]  # the most probable model
    probability: float
    included: float         # probability of the true mechanism, alone or in a pair
    value: float            # parameter of the true mechanism, fitted alone
    sigma: float            # its standard deviation


Drifts = Mapping[str, Mapping[str, Flown]]  # {experiment: {flight: drift}}


def signed(x: float) -> str:
    """Return metres with sign and three decimals; below half a millimetre ``0``."""
    return '0' if abs(x) < 5e-4 else f'{x:+.3f}'


def perfect_table(perfect: Mapping[str, Array]) -> str:
    """Return the table of predicted drift, {row: drift (paths, 2) m}, compared with the audit."""
    out = ['| mechanism | ' + ' | '.join(PATHS) + ' | largest difference |',
           '|---' * (len(PATHS) + 2) + '|']
    for name, found in perfect.items():
        difference = np.abs(found - np.array(ROWS[name].audit))
        cells = ' | '.join(f'{signed(x)}, {signed(y)}' for x, y in found)
        out.append(f'| {name}: {ROWS[name].description} | {cells} | {np.nanmax(difference):.3f} |')
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
        *(f'| {o.name} | {o.source} | {o.description} |' for o in OBSERVATIONS)]) + '\n'


def flown_table(flown: Drifts) -> str:
    """Return predicted and flown drift, one row for each experiment and mechanism."""
    out = ['| experiment | mechanism | predicted, perfect tracking | loop area | predicted, as '
           'flown | flown, mean of seeds (range) | vehicle |', '|---|---|---|---|---|---|---|']
    for name, drifts in flown.items():
        for key, d in drifts.items():
            span = f'{signed(min(d.measured))} to {signed(max(d.measured))}'
            out.append(
                f'| `{name}` | {key.upper()} | {signed(d.perfect)} | {d.loop:.2f} | '
                f'{signed(d.predicted)} | **{signed(float(np.mean(d.measured)))}** ({span}) | '
                f'{signed(float(np.mean(d.vehicle)))} |')
    return '\n'.join(out) + '\n'


def identification_table(found: Sequence[Identification], value: Mapping[str, float]) -> str:
    """Return the identified mechanisms; ``value`` is {flight: true value of its parameter}."""
    out = ['| true mechanism | flights and evidence | most probable model | its probability | '
           'probability of the true mechanism | its value, fitted alone | true value |',
           '|---|---|---|---|---|---|---|']
    for f in found:
        out.append(
            f'| {f.truth.upper()} | {f.data_set} | {"+".join(f.model) or "none"} | '
            f'{f.probability:.2f} | {f.included:.2f} | {plus_minus(f.value, 1.96 * f.sigma)} | '
            f'{value[f.truth]:.3f} |')
    return '\n'.join(out) + '\n'


def replace_tables(tables: Sequence[str], document: str, where: Path) -> str:
    """
    Replace the tables of a document that have the same first line, and return the document.

    Raises
    ------
    BagError
        If the document has no such table.

    """
    lines = document.splitlines()
    for table in tables:
        new = table.splitlines()
        if new[0] not in lines:
            raise BagError(f'{where}: no table begins with "{new[0]}"; add this line where the '
                           'table belongs')
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
    axes.set(xlabel='speed [rad/s]', ylabel='drift per turn [m]')
    axes.legend(fontsize=7, frameon=False, handletextpad=0.2)


def figure_digest(flown_rows: str) -> str:
    """Return the digest of the figure: of its table (:func:`flown_table`) and its colours."""
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
    last.set_title('line: perfect tracking, dot: flown', fontsize='small')
    for axes in (plots[0], plots[3]):
        axes.set_ylabel('drift per turn [m]')
    for axes in bars:
        axes.set_xlabel('mechanism')
    grey = palette.COLOURS['soft']
    figure.legend(handles=[
        Patch(fill=False, edgecolor=grey, label='predicted, perfect tracking'),
        Patch(color=grey, alpha=0.4, label='predicted, as flown'),
        Patch(color=grey, label='flown, mean; dots: seeds')],
        loc='outside upper center', ncols=3, frameon=False, fontsize='small')
    return figure
