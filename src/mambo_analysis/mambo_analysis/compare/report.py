"""
A flight, or a comparison, as one HTML file: numbers, interactive plots and a replay.

``./run``, ``mambo compare`` and ``import mambo`` write this page; a section appears if the bags
hold what it shows. The file needs no network: it contains plotly.js, and a content security
policy forbids loading anything else. ``report.js`` draws the content of :func:`of_one` and
:func:`of_two`.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
import gzip
from html import escape
from importlib.resources import files
import itertools
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import Bag, BagError
from mambo_model import palette
from mambo_model.whole_file import PAGE, write_text
from mambo_signals import metrics, motion
from mambo_signals.every_signal import signals
from mambo_signals.flight_phases import Phases
from mambo_signals.metrics import Floats
from mambo_signals.motion import Motion
import numpy as np
from plotly.offline import get_plotlyjs

from . import events, figures, losses, markup, tables
from .figures import Line, Panel, Plot
from .pair import Alignment, Comparison, Quantity, within

POINTS = 1200  # largest number of points of a line
FRAME = 40_000_000  # [ns] between the key frames of the replay
FRAMES = 3000  # at most; a longer flight has fewer per second
INSTANTS = 600  # at which a signal is drawn against another
SIGNALS = 200  # of all bags, at most
POLICY = ("default-src 'none'; script-src 'unsafe-inline' blob:; style-src 'unsafe-inline'; "
          'img-src data: blob:')
DIGITS = {'m': 4, 'm/s': 4, 'deg': 3, '-': 2, 'N': 5, 's': 3}


Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]
"""Caption, head and rows."""


class Report(NamedTuple):
    """Content of a page; the parts drawn by ``report.js`` are plain lists and texts."""

    title: str
    lead: str
    ending: list[str]  # reasons for an early end of the flight
    cards: list[tuple[str, str, str]]  # (name, number, description)
    notes: list[str]
    sections: list[Mapping[str, Any]]  # of compare
    details: list[tuple[str, str]]  # (name, text)
    replay: dict[str, Any]
    figures: Sequence[Plot]
    phases: Phases
    tables: Sequence[Table] = ()  # above the sections
    below: Sequence[Table] = ()
    events: Sequence[events.Event] = ()
    rejected: Sequence[events.Rejected] = ()
    signals: Mapping[str, Any] | None = None  # of :func:`signals_of`


def _numbers(
    values: Floats, digits: int | None = None, significant: int = 6,
) -> list[float | None]:
    """Return rounded numbers for JSON, None for NaN; default: six digits of the largest."""
    values = np.asarray(values, float)
    if digits is None:
        largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        digits = significant - math.ceil(math.log10(largest)) if largest > 1e-300 else 0
    if abs(digits) < 300:
        values = np.round(values, digits)
    return [value if math.isfinite(value) else None for value in values.tolist()]


def _line_data(line: Line, in_time: bool) -> dict[str, Any]:
    """Return a line for ``report.js``."""
    line, (dash, width, _) = line.thinned(POINTS), line.style()
    out = {'name': escape(line.name), 'kind': line.kind, 'colour': line.role,
           'dash': palette.DASHES[dash], 'width': width,
           'x': _numbers(line.x, 3 if in_time else None), 'y': _numbers(line.y)}
    return out if line.low is None else {**out, 'low': _numbers(line.low)}


def _figure_data(plot: Plot) -> dict[str, Any]:
    """Return a plot for ``report.js``."""
    in_time = plot.across == figures.TIME
    return {'id': _id(plot), 'bag': plot.bag, 'across': plot.across, 'log': plot.log,
            'shade': plot.shade, 'time': in_time, 'panels': [
                {'label': panel.label, 'title': panel.title, 'limits': panel.limits,
                 'lines': [_line_data(line, in_time) for line in panel.lines if _known(line)]}
                for panel in plot.panels]}


def _known(line: Line) -> bool:
    return bool(np.isfinite(line.y).any())


def _id(plot: Plot) -> str:
    return plot.name.replace(': ', '-').replace(' ', '-').lower()


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


def _direction(axis: str) -> str:
    """Return the name of an axis, with its direction if there are several."""
    return 'z up' if axis == 'z' else axis


def comparison_figures(
    comparison: Comparison, name: str, others: Mapping[str, Sequence[Motion]],
    colours: Sequence[str],
) -> list[Plot]:
    """Return two figures for each quantity: both sides by axis, and their difference."""
    out, (ours, theirs) = [], comparison.labels
    dashes = [palette.LINES.get(colour, ('-',))[0] for colour in colours]
    if dashes[0] == dashes[1]:
        dashes[0] = '--'
    spans = figures.shade(comparison.phases, *_ends(q.stamps for q in comparison.quantities))
    for q in comparison.quantities:
        panels, t = [], q.stamps * 1e-9
        for axis, label in enumerate(q.axes):
            panels.append(Panel(f'{_direction(label)} [{q.unit}]', [
                *(Line(other.name, other.t, other.position[:, axis], 'reference', dash=':')
                  for other in others.get(q.name, ())),
                Line(theirs, t, q.b[:, axis], colours[1], dash=dashes[1], width=2.6),
                Line(ours, t, q.a[:, axis], colours[0], dash=dashes[0], width=1.4)]))
        shown = figures.listed([ours, theirs, *(other.name for other in others.get(q.name, ()))])
        up = ', z up' if q.axes[-1] == 'z' else ''
        title = f'{name}{q.name}'
        out.append(Plot(title, title[:1].upper() + title[1:],
                        f'{shown} by axis{up}.', panels, shade=spans))
        out.append(_error_figure(q, name, f'{ours} minus {theirs}')._replace(shade=spans))
    return out


def _ends(stamps: Iterable[np.ndarray]) -> tuple[int, int]:
    """Return the least and the greatest of some stamps, 0 without any."""
    ends = [int(one[k]) for one in stamps if len(one) for k in (0, -1)]
    return min(ends, default=0), max(ends, default=0)


def _error_figure(q: Quantity, name: str, what: str) -> Plot:
    label = 'angle' if q.name == 'attitude' else 'length'
    t, panels = q.stamps * 1e-9, []
    if len(q.axes) == 3:
        panels = [Panel(f'Δ{_direction(axis)} [{q.unit}]', [
            Line(f'{axis} error', t, q.error[:, i], 'ink')]) for i, axis in enumerate(q.axes)]
    panels.append(Panel(f'{label} [{q.unit}]', [
        Line(f'{label} of the error', t, np.linalg.norm(q.error, axis=1), 'ink'),
        Line('running RMS', t, metrics.running_rms(q.stamps, q.error), 'sonar', width=2.2)]))
    title = f'{name}{q.name} error'
    return Plot(title, title[:1].upper() + title[1:],
                f'{what}, its {label}, and the RMS up to each instant.', panels)


def replay_of(
    tracks: Sequence[tuple[str, str, Motion]], vehicles: Sequence[tuple[str, str, Motion]],
    span: tuple[int, int] | None = None,
) -> dict[str, Any]:
    """
    Return the paths, and the vehicles on a grid of time; (label, colour, motion) of each.

    ``span`` [ns] is that of the grid; default: that of the vehicles.
    """
    begin, end = span or _ends(m.stamps for _, _, m in vehicles)
    grid = begin + np.arange(0, end - begin + 1, max(FRAME, -(-(end - begin) // FRAMES)))
    out: dict[str, Any] = {'t': _numbers(grid * 1e-9, 3), 'tracks': [], 'vehicles': []}
    for label, colour, track in tracks:
        step = max(1, len(track.stamps) // POINTS)
        dash, width, _ = palette.LINES.get(colour, ('-', 1.4, 0))
        out['tracks'].append({
            'name': escape(label), 'colour': colour, 'dash': palette.DASHES[dash], 'width': width,
            **{axis: _numbers(track.position[::step, i], 4) for i, axis in enumerate('xyz')}})
    for label, colour, vehicle in vehicles:
        there = vehicle.at(grid)
        out['vehicles'].append({
            'name': escape(label), 'colour': colour,
            'p': [_numbers(row, 4) for row in there.position],
            'q': [_numbers(row, 4) for row in there.quaternion]})
    return out


def _cards(
    sections: Sequence[Mapping[str, Any]], ours: str, theirs: str,
) -> list[tuple[str, str, str]]:
    """Return the main numbers: of the position, and the RMS of velocity and attitude."""
    out: list[tuple[str, str, str]] = []
    for entry in sections:
        row, name = tables.main_row(entry), entry['quantity']
        where, few = row['part'], tables.too_few(entry)
        if few and (not row['count'] or where == 'whole flight'):
            out.append((f'{name} RMS', '–', ', '.join(few[-1])))
        elif not row['count']:
            continue
        elif name == 'position' and not out:
            out = [('position RMS', f'{row["rms_total"]:.3f} m', where),
                   ('largest', f'{row["maximum_total"]:.3f} m', where),
                   ('final drift', f'{entry["rows"][0]["drift_total"]:.3f} m',
                    tables.end(entry))]
            delays = [value for value in row['delay'] if value is not None]
            if delays:
                delay = 1e3 * float(np.median(delays))
                out.append(('delay', f'{abs(delay):.0f} ms',
                            f'{ours} {"behind" if delay >= 0.0 else "ahead of"} {theirs}'))
        elif name in ('velocity', 'attitude') and len(out) < 6:
            unit = '°' if entry['unit'] == 'deg' else f' {entry["unit"]}'
            out.append((f'{name} RMS', f'{row["rms_total"]:.2f}{unit}', where))
    return out


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


def signals_of(bags: Sequence[tuple[str, Bag, int]]) -> dict[str, Any]:
    """Return every signal of (label, bag, its clock behind the page's in ns) at common times."""
    begin = min(bag.start + offset for _, bag, offset in bags)
    end = max(bag.end + offset for _, bag, offset in bags)
    instants = begin + (end - begin) * np.arange(INSTANTS) // (INSTANTS - 1)
    found = [(f'{label}{name}', values) for label, bag, offset in bags
             for name, values in signals(bag, instants - offset, SIGNALS // len(bags))]
    return {'t': _numbers(instants * 1e-9, 3), 'names': [name for name, _ in found],
            'values': [_numbers(values, None, 5) for _, values in found]}


def _together(bags: Sequence[tuple[str, Bag, int]]) -> dict[str, Any]:
    """Return the fields of a report that show what each of some bags holds."""
    shown, happened, rejected = [], [], []
    for label, bag, offset in bags:
        seconds = offset * 1e-9
        shown.append([plot.of(label, seconds) if label else plot
                      for plot in figures.plots(bag) if plot.name != 'path'])
        for found, out in ((events.events, happened), (events.rejected, rejected)):
            out += [one._replace(t=one.t + seconds, bag=label) for one in found(bag)]
    order = {plot.name.partition('-')[2]: k for k, plot in enumerate(
        max(shown, key=len))} if len(shown) > 1 else {}
    both = sorted(itertools.chain.from_iterable(shown),  # A beside B
                  key=lambda plot: order.get(plot.name.partition('-')[2], len(order)))
    return {'figures': both if order else shown[0], 'events': sorted(happened),
            'rejected': rejected, 'signals': signals_of(
                [(_whose(label), bag, offset) for label, bag, offset in bags])}


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
    differ = [('Parameters that differ', ['parameter', 'A', 'B'], [
        [name, *('–' if value is None else str(value) for value in values)]
        for name, *values in result['differences']])] if result['differences'] else []
    own = _together([('', a, 0)] if other is a else [
        ('A', a, alignment.offset), ('B', other, 0)])
    own['figures'] = [*comparison_figures(named, '', {'position': references}, colours),
                      *(plot._replace(name=f'bag-{plot.name}') for plot in own['figures'])]
    return Report(
        title, lead, result['ending'], _cards(result['errors'], 'A', 'B'),
        [*tables.times(result), *result['notes']],
        [{**entry, 'title': f'{entry["quantity"]}, A minus B'} for entry in result['errors']],
        _details(a) if other is a else _details(a, other), replay_of(tracks, vehicles),
        phases=comparison.phases, below=differ, **own)


def of_one(bag: Bag, result: Mapping[str, Any]) -> Report:
    """Return the report of :func:`mambo_analysis.compare.compare.compare`."""
    parts = losses.flown(bag, losses.span(bag))
    comparisons = within(bag, parts, [])[::-1]  # the estimate first
    by_name = {}
    for name in (*motion.candidates(bag), 'reference'):
        try:
            by_name[name] = motion.read(bag, name)
        except BagError:  # absent, or too few samples to draw
            continue
    main = comparisons[0].labels if comparisons else tuple(by_name)[:1]
    colours = dict(zip(by_name, roles(list(by_name))))
    vehicles = [(name, colours[name], by_name[name]) for name in main]
    tracks = [(name, colours[name], m) for name, m in by_name.items() if name not in main]
    shown, sections = [], []
    for comparison in comparisons:
        shown += comparison_figures(
            comparison, f'{comparison.title.partition(":")[0].replace(" error", "")}: ', {},
            [colours[label] for label in comparison.labels])
        sections += [{**entry, 'title': f'{entry["quantity"]}: {comparison.title}'}
                     for entry in comparison.sections()]
    facts = [] if result['real_time_factor'] is None else [
        f'real-time factor {result["real_time_factor"]:.2f}']
    facts += [f'imported from {result["source"]}'] if result['source'] else []
    lead = f'{result["duration"]:.2f} s of flight; {comparisons[0].title}.' if comparisons \
        else f'{result["duration"]:.2f} s of flight.'
    topics = [[entry['topic'], str(entry['messages']),
               '-' if entry['rate'] is None else f'{entry["rate"]:.1f}',
               '-' if entry['lost'] is None else str(entry['lost'])] for entry in result['topics']]
    own = _together([('', bag, 0)])
    own['figures'] += [plot for plot in shown if not plot.name.endswith(' position')]
    return Report(
        result['bag'], lead, result['ending'],
        _cards(comparisons[0].sections(), *main) if comparisons else [],
        [*facts, *tables.times(result), *result['notes']], sections, _details(bag),
        replay_of([*tracks, *vehicles[::-1]], vehicles,
                  None if vehicles else (bag.start, bag.end)), phases=parts,
        below=[('Topics', ['topic', 'messages', 'Hz', 'lost'], topics)], **own)


def _section_table(entry: Mapping[str, Any]) -> str:
    digits = DIGITS.get(entry['unit'], 4)
    axes = entry['axes']
    head = ['part', *(f'RMS {axis}' for axis in axes), 'RMS', 'largest', 'final drift',
            *(f'delay {axis} [s]' for axis in axes), 'samples']
    rows = [[row['part'], *(f'{value:.{digits}f}' for value in (
        *row['rms'], row['rms_total'], row['maximum_total'], row['drift_total'])),
        *('–' if value is None else f'{value:.3f}' for value in row['delay']),
        str(row['count'])] for row in entry['rows'] if row['count']]
    if entry['ends_early']:  # the first row is that of the whole flight
        rows[0][head.index('final drift')] += f' {tables.end(entry)}'
    return markup.table(
        f'{entry["title"]} [{entry["unit"]}]', head, rows, tables.too_few(entry))


_TOOLS = ''.join(
    f'<button type="button" data-do="{what}" title="{title}" aria-label="{title}" '
    f'tabindex="{-min(k, 1)}">{text}</button>' for k, (what, text, title) in enumerate((
        ('in', '+', 'zoom in'), ('out', '−', 'zoom out'), ('pan', '✥', 'drag moves the plot'),
        ('reset', '⤢', 'show all'), ('png', 'PNG', 'save as PNG'), ('csv', 'CSV', 'save as CSV'))))


def _figure_html(name: str, title: str, text: str, rows: int, inside: str = '') -> str:
    """Return the frame of a plot: caption, mode bar, and a place that the script draws into."""
    title, text = escape(title, quote=True), escape(text, quote=True)
    return (f'<figure id="{name}"><figcaption><b>{title}</b> {text}</figcaption>{inside}'
            f'<div class="modebar" role="toolbar" aria-label="{title}">{_TOOLS}</div>'
            f'<div class="plot" style="--panels:{rows}" role="img" aria-label="{title}: {text}">'
            '</div></figure>')


_PLAYER = """
<div class="player" role="group" aria-label="time"><button id="play" type="button"
aria-label="play">▶</button>
<input id="when" type="range" min="0" max="1" step="any" value="0" aria-label="time of flight">
<output id="clock">0.00 s</output>
<select id="speed" aria-label="speed"><option value="0.25">¼×</option><option value="1" selected>1×
</option><option value="4">4×</option><option value="16">16×</option></select></div>
"""
_REPLAY = """
<section id="replay"><h2>The flight</h2>
<div class="views"><div id="scene" role="img" aria-label="Path in three dimensions, z up"></div>
<div id="flat" role="img" aria-label="Path from above and from the side, to scale, z up">
</div></div>
<p class="hint" id="axes">Body axes: <span class="x">forward</span>, <span class="y">left</span>,
<span class="z">up</span>, drawn larger than the vehicle. Drag to turn, scroll or pinch to come
closer.</p></section>
"""
_KEYS = """
<p class="hint">Keys: <kbd>Space</kbd> plays, <kbd>←</kbd> and <kbd>→</kbd> move the time by 0.1 s,
with <kbd>Shift</kbd> by 1 s; <kbd>+</kbd> and <kbd>−</kbd> zoom every plot about it, <kbd>0</kbd>
shows all. A click into a plot moves the time there, and a double click shows all of every plot.
CSV has the points that are drawn.</p>
"""
_CHOICES = """
<div class="choices"><label>across <select id="across" aria-label="signal across"></select></label>
<label>up <select id="up" aria-label="signal up"></select></label></div>
"""


def _whose(bag: str) -> str:
    return f'{bag}: ' if bag else ''


def _events_html(report: Report) -> str:
    """Return what happened in the flight, each with a button that moves the time there."""
    rows = ''.join(
        f'<li><button type="button" class="when" data-t="{one.t:.3f}" '
        f'aria-label="move the time to {one.t:.2f} s">{one.t:.2f} s</button> '
        f'<span class="{one.role}">{_whose(one.bag)}{escape(one.text)}</span></li>'
        for one in report.events)
    lost = ''.join(
        f'<li>{_whose(one.bag)}{one.sensor}: {one.count} sample{"s" * (one.count != 1)} rejected'
        '</li>' for one in report.rejected)
    if not rows and not lost:
        return ''
    return (f'<section id="events"><h2>Events</h2><p class="hint">Lines in the plots mark these '
            'times; ticks at the lower edge mark rejected samples.</p>'
            f'<ul class="events">{rows}{lost}</ul></section>')


@cache
def _library() -> str:
    """Return plotly.js, compressed, as base64: a third of its size."""
    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), 6, mtime=0)).decode()


def html(report: Report) -> str:
    """Return the page."""
    here = files(__package__)
    style = palette.css() + here.joinpath('report.css').read_text(encoding='utf-8')
    script = here.joinpath('report.js').read_text(encoding='utf-8')
    drawn = [plot for plot in report.figures if any(
        _known(line) for panel in plot.panels for line in panel.lines)]
    chosen = report.signals if report.signals and report.signals['names'] else None
    data = json.dumps({  # without any <, which may end the element or hide its end
        'replay': report.replay, 'figures': list(map(_figure_data, drawn)),
        'colours': palette.by_theme(), 'signals': chosen,
        'events': [[one.bag, one.role, round(one.t, 3)] for one in report.events],
        'rejected': [[one.bag, _numbers(one.t, 3)] for one in report.rejected],
    }, allow_nan=False, separators=(',', ':')).replace('<', '\\u003c')
    cards = ''.join(
        f'<div class="card"><dt>{escape(name)}</dt><dd>{escape(number)}</dd>'
        f'<dd class="what">{escape(what)}</dd></div>' for name, number, what in report.cards)
    cards = f'<dl class="cards">{cards}</dl>' if cards else ''
    ending = ''.join(f'<p><strong>{escape(line)}.</strong></p>' for line in report.ending)
    notes = ''.join(f'<li>{escape(note)}</li>' for note in report.notes)
    pages = ''.join(_figure_html(_id(plot), plot.title, plot.text, max(len(plot.panels), 3))
                    for plot in drawn)
    explore = '<section id="any"><h2>Any signal against any other</h2>' + _figure_html(
        'explore', 'Two signals', f'Every number in the bag, at {INSTANTS} instants.', 4,
        _CHOICES) + '</section>' if chosen else ''
    above, below = (''.join(itertools.starmap(markup.table, one))
                    for one in (report.tables, report.below))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(report.title)}</title><style>{style}</style></head><body><main>'
        f'<header><h1>{escape(report.title)}</h1><p>{escape(report.lead)}</p>{ending}'
        f'{cards}</header>'
        f'{_REPLAY if report.replay["tracks"] else ""}{_PLAYER}{_KEYS}{_events_html(report)}'
        f'<section id="plots"><h2>Signals and differences</h2><p class="hint">'
        f'{figures.shaded(report.phases)} Zooming in time zooms every plot.</p>'
        f'<div class="figures">{pages}</div></section>{explore}'
        f'<section id="numbers"><h2>Numbers</h2>{above}'
        f'{"".join(map(_section_table, report.sections))}{below}</section>'
        f'<section id="notes"><h2>What was compared</h2>{f"<ul>{notes}</ul>" if notes else ""}'
        f'{"".join(itertools.starmap(markup.details, report.details))}</section></main>'
        f'<script id="data" type="application/json">{data}</script>'
        f'<script id="library" type="text/plain">{_library()}</script>'
        f'<script>{script}</script></body></html>\n')


def write(path: Path, report: Report) -> Path:
    """
    Write the page.

    Raises
    ------
    InputError, JobError
        If the file cannot be written, or exists and is not a page.

    """
    return write_text(path, html(report), PAGE)
