"""Results of the figures as text for a terminal, as Markdown, as JSON and as one HTML page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
import html
import io
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.compare import digest, markup
from mambo_model import palette
from matplotlib.figure import Figure

from .claim import Claim, Result, VERDICTS

COMMAND = 'mambo reproduce'
COUNTS = ('verdict', 'count', 'meaning')
HEAD = ('measured', 'value', 'expected', 'reason', 'holds')
LEAD = (
    'Every figure of the thesis whose data can be simulated, with its claim in our words and the '
    'result of the simulated drone. Ranges are over five seeds of the sensor noise. "Expected" '
    'is the number in the thesis or in our independent audit of it, where there is one, and '
    'otherwise the condition that the claim sets; the reason for a tolerance is beside it. '
    'Positions are drawn as in the thesis: inertial NED, z down.')


class Examined(NamedTuple):
    """A claim and its result."""

    claim: Claim
    result: Result

    @property
    def verdict(self) -> str:
        """Return the verdict."""
        return self.claim.verdict(self.result)


def summary(examined: list[Examined]) -> str:
    """Return the number of figures with each verdict, in one line."""
    counts: dict[str, int] = {}
    for each in examined:
        counts[each.verdict] = counts.get(each.verdict, 0) + 1
    return ', '.join(f'{count} {name}' for name, count in counts.items())


def counted(examined: list[Examined]) -> list[tuple[str, int, str]]:
    """Return every verdict with its count and meaning."""
    found = [each.verdict for each in examined]
    return [(name, found.count(name), meaning) for name, meaning in VERDICTS.items()]


def line(each: Examined) -> str:
    """Return the result of one figure as lines for a terminal."""
    rows = [f'{each.claim.title:<24} {each.verdict}']
    rows += [f'    {"ok " if m.holds else "NO "} {m.what}: {m} (expected: {m.expected})'
             for m in each.result.measured]
    return '\n'.join(rows)


def markdown(examined: list[Examined]) -> str:
    """Return the page ``docs/evidence/reproduction.md``."""
    out = ['# Which figures of the thesis are reproduced', '', LEAD, '', f'    {COMMAND}', '',
           f'prints these results and draws the figures into a report: {summary(examined)}.', '',
           '[The matrix](claims.md) gives the mutated drones that each claim notices.', '',
           *table(COUNTS, counted(examined)), '']
    for each in examined:
        c, r = each
        flown = f' Scenario `{c.scenario}`.' if c.scenario else ''
        out += [f'## {c.title}: {each.verdict}', '', f'{_sentence(c.statement)}.{flown}', '']
        if c.contains:
            out += [f'*In the simulator:* {c.contains}. *Tested:* {c.tests}.', '']
        if r.measured:
            out += [*table(HEAD, [(m.what, m, m.expected, m.reason, 'yes' if m.holds else '**no**')
                                  for m in r.measured]), '']
        if r.remark:
            out += [f'{_sentence(r.remark).rstrip(".")}.', '']
    return '\n'.join(out)


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Return a table in Markdown, line by line."""
    return ['| ' + ' | '.join(map(str, row)) + ' |' for row in (
        head, ['---'] * len(head), *rows)]


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def data(examined: list[Examined]) -> list[Mapping[str, object]]:
    """Return all measurements in a form that JSON can hold."""
    return [{
        'figure': e.claim.title, 'claim': e.claim.statement, 'scenario': e.claim.scenario,
        'verdict': e.verdict, 'remark': e.result.remark, 'contains': e.claim.contains,
        'tests': e.claim.tests,
        'measured': [m._asdict() for m in e.result.measured]} for e in examined]


def picture(figure: Figure, path: Path) -> None:
    """Save a figure as a PNG file."""
    digest.save(figure, path, dpi=130)


def _embedded(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=110)
    return base64.b64encode(buffer.getvalue()).decode()


STYLE = palette.css() + """
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 56rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .4rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .2rem; padding-top: .8rem;
  border-top: 1px solid var(--line); }
p.lead, p.why { color: var(--soft); } a { color: inherit; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .92rem; margin: .6rem 0;
  font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: .3rem 0; }
td, th { text-align: left; padding: .25rem .8rem .25rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; } thead th { color: var(--soft); } tbody th { font-weight: inherit; }
img { width: 100%; height: auto; border-radius: 4px; }
.verdict { font-size: .85rem; font-weight: 600; margin-left: .5rem; }
.reproduced { color: var(--good); } .partly { color: var(--half); } .not { color: var(--bad); }
.by { color: var(--ink); } .nothing { color: var(--soft); }
nav ul { display: flex; flex-wrap: wrap; gap: .2rem .8rem; font-size: .9rem; margin: 1rem 0;
  padding: 0; list-style: none; }
nav a { text-decoration: none; display: inline-block; min-height: 1.6rem; }
.hidden { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
@media print { nav { display: none; } h2 { break-after: avoid; } img { break-inside: avoid; }
  body { max-width: none; padding: 0; font-size: 11px; } .scroll { overflow: visible; } }
"""


MARKS = {'reproduced': ' ✓', 'by': ' ≡', 'partly': ' ½', 'not': ' ✗', 'nothing': ''}
"""The mark of each verdict in a link, so that colour is not needed to tell them apart."""


def page(examined: list[Examined]) -> str:
    """Return one HTML page with every figure embedded, so that it needs no network."""
    links = ''.join(
        f'<li><a class="{_css(e)}" href="#{_anchor(e)}">{html.escape(e.claim.number)}'
        f'{MARKS[_css(e)]}<span class="hidden"> {e.verdict}</span></a></li>'
        for e in examined)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>The thesis, redrawn</title><style>{STYLE}</style></head><body><main>'
        f'<h1>The thesis, redrawn</h1><p class="lead">{html.escape(LEAD)}</p>'
        f'{markup.table("Verdicts", COUNTS, _texts(counted(examined)))}'
        f'<nav aria-label="Figures"><ul>{links}</ul></nav>'
        f'{"".join(map(_section, examined))}</main></body></html>\n')


def _texts(rows: Sequence[Sequence[object]]) -> list[tuple[str, ...]]:
    return [tuple(map(str, row)) for row in rows]


def _css(each: Examined) -> str:
    return each.verdict.split()[0]


def _anchor(each: Examined) -> str:
    return 'figure-' + ''.join(c if c.isalnum() else '-' for c in each.claim.number.lower())


def _section(each: Examined) -> str:
    c, r = each
    out = [
        f'<section id="{_anchor(each)}"><h2>{html.escape(c.title)}'
        f'<span class="verdict {_css(each)}">{each.verdict}</span></h2>'
        f'<p>{html.escape(_sentence(c.statement))}.'
        + (f' <code>./run --scenario {c.scenario}</code>' if c.scenario else '') + '</p>']
    if r.figure is not None:
        out.append(f'<img alt="{html.escape(c.title)}: {html.escape(c.statement)}" '
                   f'src="data:image/png;base64,{_embedded(r.figure)}">')
    if c.contains:
        out.append(f'<p>In the simulator: {html.escape(c.contains)}. '
                   f'Tested: {html.escape(c.tests)}.</p>')
    if r.measured:
        out.append(markup.table(f'{c.title}, measured', HEAD, _texts([
            (m.what, m, m.expected, m.reason, 'yes' if m.holds else 'no') for m in r.measured])))
    if r.remark:
        out.append(f'<p class="why">{html.escape(_sentence(r.remark))}</p>')
    return ''.join(out) + '</section>'
