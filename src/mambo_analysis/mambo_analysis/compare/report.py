"""
A comparison as one HTML file: numbers, interactive plots and a replay of the flight.

The file needs no network: it contains plotly.js, and a content security policy forbids loading
anything else. ``report.js`` draws the content of :func:`of_one` and :func:`of_two`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
import itertools
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import Bag, BagError
from mambo_model import palette
from mambo_model.whole_file import write_text
from mambo_signals import metrics, motion
from mambo_signals.flight_phases import Phases, phases
from mambo_signals.metrics import Floats, Ints
from mambo_signals.motion import Motion
import numpy as np
from plotly.offline import get_plotlyjs

from . import figures, markup, tables
from .pair import Alignment, Comparison, Quantity, within

POINTS = 1200  # largest number of points of a line
FRAME = 40_000_000  # [ns] between the key frames of the replay
FRAMES = 3000  # at most; a longer flight has fewer per second
POLICY = ("default-src 'none'; script-src 'unsafe-inline' blob:; style-src 'unsafe-inline'; "
          'img-src data: blob:')
DIGITS = {'m': 4, 'm/s': 4, 'deg': 3, '-': 2, 'N': 5, 's': 3}


class Report(NamedTuple):
    """Content of a page; the parts drawn by ``report.js`` are plain lists and texts."""

    title: str
    lead: str
    ending: list[str]  # reasons for an early end of the flight
    cards: list[tuple[str, str, str]]  # (name, number, description)
    notes: list[str]
    sections: list[Mapping[str, Any]]  # of compare
    differences: list[list[Any]]  # (parameter, A, B)
    details: list[tuple[str, str]]  # (name, text)
    replay: dict[str, Any]
    figures: list[dict[str, Any]]
    phases: Phases
    tables: Sequence[tuple[str, Sequence[str], Sequence[Sequence[str]]]] = ()
    """(caption, head, rows) of tables above the sections."""


def _numbers(values: Floats, digits: int) -> list[float | None]:
    """Return rounded numbers for JSON, None for NaN."""
    return [None if not math.isfinite(value) else round(value, digits)
            for value in np.asarray(values, float).tolist()]


def line_of(
    name: str, stamps: Ints, values: Floats, digits: int, style: Mapping[str, Any],
) -> dict[str, Any]:
    """Return a line over stamps in ns; style: colour (a role), dash and width."""
    t, y = metrics.envelope(stamps * 1e-9, values, POINTS)
    return {'name': escape(name), **style, 't': _numbers(t, 3), 'y': _numbers(y, digits)}


def _style(role: str) -> dict[str, Any]:
    """Return the line style of a role for ``report.js``."""
    dashes, width, _ = palette.LINES.get(role, ('-', 1.4, 0))
    return {'colour': role, 'dash': palette.DASHES[dashes], 'width': width}


def roles(names: Sequence[str]) -> list[str]:
    """
    Return the role of each topic's motion, which sets its colour; all differ.

    Of two motions of one role the first has its colour, the other one that is free.
    """
    used: list[str] = []
    for name in names:
        role = palette.LABELS.get(name)
        used.append(palette.free((*used, 'reference')) if role is None or role in used else role)
    return used


def figure_of(
    name: str, title: str, text: str, panels: Sequence[tuple[str, list[dict[str, Any]]]],
) -> dict[str, Any]:
    """Return a figure of stacked panels (axis label, lines)."""
    return {'id': name.replace(': ', '-').replace(' ', '-').lower(), 'title': title,
            'text': text, 'panels': [{'label': label, 'lines': lines} for label, lines in panels]}


def _direction(axis: str) -> str:
    """Return the name of an axis, with its direction if there are several."""
    return 'z up' if axis == 'z' else axis


def comparison_figures(
    comparison: Comparison, name: str, others: Mapping[str, Sequence[Motion]],
    colours: Sequence[str],
) -> list[dict[str, Any]]:
    """Return two figures for each quantity: both sides by axis, and their difference."""
    out, (ours, theirs) = [], comparison.labels
    a, b = ({**_style(colour), 'width': width} for colour, width in zip(colours, (1.4, 2.6)))
    if a['dash'] == b['dash']:
        a['dash'] = 'dash'
    for q in comparison.quantities:
        digits = DIGITS.get(q.unit, 4) + 3  # so that small differences do not become staircases
        panels = []
        for axis, label in enumerate(q.axes):
            lines = [line_of(other.name, other.stamps, other.position[:, axis], digits,
                           {**_style('reference'), 'dash': 'dot'})
                     for other in others.get(q.name, ())]
            panels.append((f'{_direction(label)} [{q.unit}]', [
                *lines, line_of(theirs, q.stamps, q.b[:, axis], digits, b),
                line_of(ours, q.stamps, q.a[:, axis], digits, a)]))
        shown = figures.listed([ours, theirs, *(other.name for other in others.get(q.name, ()))])
        up = ', z up' if q.axes[-1] == 'z' else ''
        out.append(figure_of(
            f'{name} {q.name}', f'{name}{q.name}'[:1].upper() + f'{name}{q.name}'[1:],
            f'{shown} by axis{up}.', panels))
        out.append(_error_figure(q, name, f'{ours} minus {theirs}', digits))
    return out


def _error_figure(q: Quantity, name: str, what: str, digits: int) -> dict[str, Any]:
    label = 'angle' if q.name == 'attitude' else 'length'
    panels = []
    if len(q.axes) == 3:
        panels = [(f'Δ{_direction(axis)} [{q.unit}]', [
            line_of(f'{axis} error', q.stamps, q.error[:, i], digits, _style('ink'))])
            for i, axis in enumerate(q.axes)]
    length = np.linalg.norm(q.error, axis=1)
    panels.append((f'{label} [{q.unit}]', [
        line_of(f'{label} of the error', q.stamps, length, digits, _style('ink')),
        line_of('running RMS', q.stamps, metrics.running_rms(q.stamps, q.error), digits,
              {**_style('sonar'), 'width': 2.2})]))
    title = f'{name}{q.name} error'
    return figure_of(title, title[:1].upper() + title[1:],
                   f'{what}, its {label}, and the RMS up to each instant.', panels)


def replay_of(
    tracks: Sequence[tuple[str, str, Motion]], vehicles: Sequence[tuple[str, str, Motion]],
) -> dict[str, Any]:
    """Return the paths, and the vehicles on a grid of time; (label, colour, motion) of each."""
    begin = min(int(m.stamps[0]) for _, _, m in vehicles)
    end = max(int(m.stamps[-1]) for _, _, m in vehicles)
    grid = begin + np.arange(0, end - begin + 1, max(FRAME, -(-(end - begin) // FRAMES)))
    out: dict[str, Any] = {'t': _numbers(grid * 1e-9, 3), 'tracks': [], 'vehicles': []}
    for label, colour, track in tracks:
        step = max(1, len(track.stamps) // POINTS)
        out['tracks'].append({'name': escape(label), **_style(colour), **{
            axis: _numbers(track.position[::step, i], 4) for i, axis in enumerate('xyz')}})
    for label, colour, vehicle in vehicles:
        there = vehicle.at(grid)
        out['vehicles'].append({
            'name': escape(label), 'colour': colour,
            'p': [_numbers(row, 4) for row in there.position],
            'q': [_numbers(row, 4) for row in there.quaternion]})
    return out


def _cards(sections: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Return the main numbers: of the position, and the RMS of velocity and attitude."""
    out: list[tuple[str, str, str]] = []
    for entry in sections:
        row, unit = tables.main_row(entry), entry['unit']
        if not row['count']:
            continue
        where = row['part']
        if entry['quantity'] == 'position' and not out:
            out = [('position RMS', f'{row["rms_total"]:.3f} m', where),
                   ('largest', f'{row["maximum_total"]:.3f} m', where),
                   ('final drift', f'{entry["rows"][0]["drift_total"]:.3f} m', 'at the end')]
            delays = [value for value in row['delay'] if value is not None]
            if delays:
                out.append(('delay', f'{1e3 * float(np.median(delays)):.0f} ms',
                            'of A behind B' if np.median(delays) >= 0 else 'A is ahead of B'))
        elif entry['quantity'] in ('velocity', 'attitude') and len(out) < 6:
            unit = '°' if unit == 'deg' else f' {unit}'
            out.append((f'{entry["quantity"]} RMS', f'{row["rms_total"]:.2f}{unit}', where))
    return out


def _shade(report: Report) -> Report:
    """Add the take-off and landing to the figures, to be shaded."""
    parts, begin, end = report.phases, report.replay['t'][0], report.replay['t'][-1]
    shade = []
    if parts.takeoff_end is not None:
        shade.append([begin, parts.takeoff_end * 1e-9])
    if parts.landing_start is not None:
        shade.append([parts.landing_start * 1e-9, end])
    return report._replace(figures=[{**figure, 'shade': shade} for figure in report.figures])


def _details(*bags: Bag) -> list[tuple[str, str]]:
    """Return metadata and scenario of the bags."""
    out = []
    for bag in bags:
        for name, values in sorted(bag.metadata.items()):
            if name != 'rosbag2':
                out.append((f'{bag.path.name}: {name}', '\n'.join(
                    f'{key}: {value}' for key, value in values.items())))
        scenario = bag.attachments.get('scenario.yaml')
        if isinstance(scenario, str):
            out.append((f'{bag.path.name}: scenario.yaml', scenario))
    return out


def of_two(
    a: Bag, b: Bag | None, result: Mapping[str, Any], comparison: Comparison,
    alignment: Alignment,
) -> Report:
    """Return the report of :func:`mambo_analysis.compare.compare.compare_bags`."""
    other = a if b is None else b
    names = [f'{letter}: {bag}' for letter, bag in zip('AB', result['bags'])]
    ours = alignment.moved(motion.read(a, result['compared'][0]))
    theirs = motion.read(other, result['compared'][1])
    references = [motion.read(other, 'reference')] if 'reference' in other else []
    title = f'{result["bags"][0]} against {result["bags"][1]}'
    if other is a:
        title = f'{result["bags"][0]}: {ours.name} against {theirs.name}'
        names = [f'{letter}: {m.name}' for letter, m in zip('AB', (ours, theirs))]
    named = Comparison(comparison.title, (names[0], names[1]), comparison.quantities,
                       comparison.phases)
    colours = roles([m.name for m in (ours, theirs)])
    vehicles = [(names[0], colours[0], ours), (names[1], colours[1], theirs)]
    tracks = [('reference', 'reference', m) for m in references] + vehicles[::-1]
    lead = (f'A, {ours.name} of {result["bags"][0]}, minus B, {theirs.name} of '
            f'{result["bags"][1]}: {result["duration"]:.2f} s in common.')
    return _shade(Report(
        title, lead, result['ending'], _cards(result['errors']),
        [*tables.times(result), *result['notes']],
        [{**entry, 'title': f'{entry["quantity"]}, A minus B'} for entry in result['errors']],
        result['differences'], _details(a) if other is a else _details(a, other),
        replay_of(tracks, vehicles),
        comparison_figures(named, '', {'position': references}, colours), comparison.phases))


def of_one(bag: Bag, result: Mapping[str, Any]) -> Report:
    """
    Return the report of :func:`mambo_analysis.compare.compare.compare`.

    Raises
    ------
    BagError
        If nothing in the bag tells a motion.

    """
    parts = phases(bag)
    comparisons = within(bag, parts, [])[::-1]  # the estimate first
    topics = motion.candidates(bag)
    moving = []
    for name in topics:
        try:
            moving.append(motion.read(bag, name))
        except BagError:  # too few samples to draw
            continue
    if not moving:
        raise BagError(f'{bag.path}: nothing to show, no topic with a motion '
                       '(Odometry or PoseStamped) of two samples or more')
    references = [motion.read(bag, 'reference')] if 'reference' in bag else []
    by_name = {m.name: m for m in (*moving, *references)}
    main = comparisons[0].labels if comparisons else (moving[0].name,)
    colours = dict(zip(by_name, roles(list(by_name))))
    vehicles = [(name, colours[name], by_name[name]) for name in main]
    tracks = [(name, colours[name], m) for name, m in by_name.items() if name not in main]
    shown, sections = [], []
    names = [f'{comparison.title.split()[0]}: ' for comparison in comparisons]
    for comparison, name in zip(comparisons, names):
        shown += comparison_figures(comparison, name, {
            'position': references} if 'reference' not in comparison.labels else {},
            [colours[label] for label in comparison.labels])
        sections += [{**entry, 'title': f'{entry["quantity"]}: {comparison.title}'}
                     for entry in comparison.sections()]
    facts = [] if result['real_time_factor'] is None else [
        f'real-time factor {result["real_time_factor"]:.2f}']
    facts += [f'imported from {result["source"]}'] if result['source'] else []
    lead = f'{result["duration"]:.2f} s of flight; {comparisons[0].title}.' if comparisons \
        else f'{result["duration"]:.2f} s of flight.'
    return _shade(Report(
        result['bag'], lead, result['ending'],
        _cards(comparisons[0].sections() if comparisons else []),
        [*facts, *tables.times(result), *result['notes']], sections, [], _details(bag),
        replay_of([*tracks, *vehicles[::-1]], vehicles), shown, parts))


def _section_table(entry: Mapping[str, Any]) -> str:
    digits = DIGITS.get(entry['unit'], 4)
    axes = entry['axes']
    head = ['part', *(f'RMS {axis}' for axis in axes), 'RMS', 'largest', 'final drift',
            *(f'delay {axis} [s]' for axis in axes), 'samples']
    rows = [[row['part'], *(f'{value:.{digits}f}' for value in (
        *row['rms'], row['rms_total'], row['maximum_total'], row['drift_total'])),
        *('–' if value is None else f'{value:.3f}' for value in row['delay']),
        str(row['count'])] for row in entry['rows'] if row['count']]
    return markup.table(
        f'{entry["title"]} [{entry["unit"]}]', head, rows, tables.too_few(entry))


def _figure_html(figure: Mapping[str, Any]) -> str:
    return (f'<figure id="{figure["id"]}"><figcaption><b>{escape(figure["title"])}</b> '
            f'{escape(figure["text"])}</figcaption>'
            f'<div class="plot" data-panels="{len(figure["panels"])}" role="img" '
            f'aria-label="{escape(figure["title"] + ": " + figure["text"], quote=True)}"></div>'
            '</figure>')


_REPLAY = """
<section id="replay"><h2>The flight</h2>
<div class="views"><div id="scene" role="img" aria-label="Path in three dimensions, z up"></div>
<div id="flat" role="img" aria-label="Path from above and from the side, to scale, z up">
</div></div>
<div class="player"><button id="play" type="button" aria-label="play">▶</button>
<input id="when" type="range" min="0" max="1" step="any" value="0" aria-label="time of flight">
<output id="clock">0.00 s</output>
<select id="speed" aria-label="speed"><option value="0.25">¼×</option><option value="1" selected>1×
</option><option value="4">4×</option><option value="16">16×</option></select></div>
<p class="hint" id="axes">Body axes: <span class="x">forward</span>, <span class="y">left</span>,
<span class="z">up</span>, drawn larger than the vehicle. Drag to turn, scroll or pinch to come
closer.</p><p class="hint">A click into a plot below moves the vehicle to that time.</p></section>
"""


def html(report: Report) -> str:
    """Return the page."""
    here = files(__package__)
    style = palette.css() + here.joinpath('report.css').read_text(encoding='utf-8')
    script = here.joinpath('report.js').read_text(encoding='utf-8')
    data = json.dumps({
        'replay': report.replay, 'figures': report.figures, 'colours': palette.by_theme(),
    }, allow_nan=False, separators=(',', ':')).replace('</', '<\\/')
    cards = ''.join(
        f'<div class="card"><dt>{escape(name)}</dt><dd>{escape(number)}</dd>'
        f'<dd class="what">{escape(what)}</dd></div>' for name, number, what in report.cards)
    ending = ''.join(f'<p><strong>{escape(line)}.</strong></p>' for line in report.ending)
    notes = ''.join(f'<li>{escape(note)}</li>' for note in report.notes)
    pages = ''.join(map(_figure_html, report.figures))
    differ = markup.table('Parameters that differ', ['parameter', 'A', 'B'], [
        [name, *('–' if value is None else str(value) for value in values)]
        for name, *values in report.differences]) if report.differences else ''
    details = ''.join(itertools.starmap(markup.details, report.details))
    above = ''.join(itertools.starmap(markup.table, report.tables))
    shaded = figures.shaded(report.phases)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(report.title)}</title><style>{style}</style></head><body><main>'
        f'<header><h1>{escape(report.title)}</h1><p>{escape(report.lead)}</p>{ending}'
        f'<dl class="cards">{cards}</dl></header>{_REPLAY}'
        f'<section id="plots"><h2>Signals and differences</h2><p class="hint">'
        f'{shaded} Zooming in time zooms every plot; a double click shows all of every plot '
        'again.</p>'
        f'<div class="figures">{pages}</div></section>'
        f'<section id="numbers"><h2>Numbers</h2>{above}'
        f'{"".join(map(_section_table, report.sections))}'
        f'{differ}</section><section id="notes"><h2>What was compared</h2><ul>{notes}</ul>'
        f'{details}</section></main><script id="data" type="application/json">{data}</script>'
        f'<script>{get_plotlyjs()}</script><script>{script}</script></body></html>\n')


def write(path: Path, report: Report) -> Path:
    """
    Write the page.

    Raises
    ------
    InputError, JobError
        If the file cannot be written.

    """
    return write_text(path, html(report))
