"""A flight as a page: ``flight.png`` and one self-contained ``index.html``."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from io import StringIO
from pathlib import Path
import re
from typing import Any

from mambo_bags.reader import Bag
from mambo_model import palette
from mambo_model.whole_file import write_text
import matplotlib

from . import figures, markup, tables

_STYLE = palette.css() + """
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1rem; max-width: 54rem; background: var(--paper);
  color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.5rem; margin: .5rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.1rem; margin: 2rem 0 .25rem; }
p { margin: .25rem 0 .75rem; }
figure { margin: .5rem 0 0; }
figure svg { width: 100%; height: auto; display: block; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .25rem 0 1rem; }
th, td { padding: .2rem .7rem .2rem 0; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--line); }
th:first-child, td.text { text-align: left; } tbody th { font-weight: inherit; }
caption { text-align: left; font-weight: 600; padding: .5rem 0 .2rem; }
details { background: var(--card); border-radius: .5rem; padding: .5rem .8rem; margin-top: 2rem; }
pre { overflow-x: auto; font-size: .8rem; }
@media print { body { max-width: none; padding: 0; font-size: 11px; } details { display: none; }
  h2 { break-after: avoid; } figure, table { break-inside: avoid; }
  .scroll { overflow: visible; } th, td { padding-right: .5rem; } }
"""


def _svg(plot: figures.Plot, bag: Bag) -> str:
    """Return a plot as an SVG element that takes ink and grid colour from the page."""
    figure, buffer = figures.figure_of(plot, bag), StringIO()
    with matplotlib.rc_context(figures.STYLE):
        figure.savefig(buffer, format='svg', transparent=True, dpi=150,
                       metadata={'Date': None, 'Creator': None})
    text = buffer.getvalue()
    text = text[text.index('<svg'):]
    text = re.sub(r'<metadata>.*?</metadata>', '', text, flags=re.DOTALL)
    text = re.sub(r'(?<!\d)(?<!scale\()(\d+\.\d\d)\d+', r'\1', text)  # hundredths of a point
    text = palette.variables(text)
    # ids are unique within one figure only
    text = re.sub(r'(\bid="|href="#|url\(#)', rf'\g<1>{plot.name}-', text)
    label = escape(f'{plot.title}: {plot.text}', quote=True)
    return re.sub(r'<svg ', f'<svg role="img" aria-label="{label}" ', text, count=1)


def _tables(result: Mapping[str, Any]) -> str:
    parts = []
    for section in result['errors']:
        unit = section['unit']
        head = [f'RMS [{unit}]', *section['axes'], 'total', 'max', 'samples']
        rows = [[row['part'],
                 *(f'{value:.4f}' for value in (*row['rms'], row['rms_total'],
                                                row['maximum_total'])),
                 str(row['count'])] for row in section['rows'] if row['count']]
        parts.append(markup.table(section['title'], head, rows, tables.too_few(section)))
    rows = [[entry['topic'], str(entry['messages']),
             '-' if entry['rate'] is None else f'{entry["rate"]:.1f}',
             '-' if entry['lost'] is None else str(entry['lost'])] for entry in result['topics']]
    parts.append(markup.table('Topics', ['topic', 'messages', 'Hz', 'lost'], rows))
    return ''.join(parts)


def _summary(result: Mapping[str, Any]) -> str:
    facts = [f'{result["duration"]:.2f} s of flight']
    if result['real_time_factor'] is not None:
        facts.append(f'real-time factor {result["real_time_factor"]:.2f}')
    if result['source']:
        facts.append(f'imported from {result["source"]}')
    if result['takeoff_end'] is not None:
        facts.append(f'take-off ends at {result["takeoff_end"]:.2f} s ({result["takeoff"]})')
    if result['landing_start'] is not None:
        facts.append(f'landing begins at {result["landing_start"]:.2f} s')
    notes = ''.join(f'<p>{escape(note)}.</p>' for note in result['notes'])
    ending = ''.join(f'<p><strong>{escape(line)}.</strong></p>' for line in result['ending'])
    return f'{ending}<p>{escape("; ".join(facts))}.</p>{notes}'


def _details(bag: Bag) -> str:
    """Return metadata and scenario of the bag."""
    out = []
    for name, values in sorted(bag.metadata.items()):
        if name != 'rosbag2':
            lines = '\n'.join(f'{key}: {value}' for key, value in values.items())
            out.append(markup.details(name, lines))
    scenario = bag.attachments.get('scenario.yaml')
    if isinstance(scenario, str):
        out.append(markup.details('scenario.yaml', scenario))
    return ''.join(out)


def html(bag: Bag, result: Mapping[str, Any]) -> str:
    """Return the page of a flight; ``result`` is what ``compare`` returned."""
    pieces = [
        f'<h2 id="{plot.name}">{escape(plot.title)}</h2><p>{escape(plot.text)}</p>'
        f'<figure>{_svg(plot, bag)}</figure>' for plot in figures.plots(bag)]
    title = escape(result['bag'])
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{title}</title><style>{_STYLE}</style></head><body><main>'
        f'<h1>{title}</h1>{_summary(result)}{_tables(result)}{"".join(pieces)}'
        f'{_details(bag)}</main></body></html>\n')


def write_page(bag: Bag, result: Mapping[str, Any], out: Path) -> Path:
    """
    Write ``flight.png`` and ``index.html``.

    Parameters
    ----------
    bag, result
        A flight and its comparison.
    out
        Directory, made if needed; an older page in it is replaced.

    Returns
    -------
    Path of the page.

    Raises
    ------
    InputError, JobError
        If the directory cannot be written.

    """
    text = html(bag, result)  # a failure here leaves no folder behind
    figures.write_overview(bag, out / 'flight.png', result['bag'])
    return write_text(out / 'index.html', text)
