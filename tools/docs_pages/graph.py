"""The picture of the graph: its nodes and the topics between them, from the table of topics."""

from __future__ import annotations

from mambo_model import palette

from .topics import USES

SIZE = {'box': (150, 40), 'picture': (900, 380)}  # pixels
PLACES = {  # centres of the nodes
    'sim_node': (100, 180), 'estimator_node': (470, 90), 'reference_node': (470, 180),
    'optitrack_node': (470, 270), 'controller_node': (790, 180), 'recorder_node': (470, 350)}
PATHS = {  # line from node to node; where its label stands
    ('sim_node', 'estimator_node'): ('M175 165 L395 95', (290, 58)),
    ('sim_node', 'reference_node'): ('M175 180 L395 180', (300, 172)),
    ('sim_node', 'optitrack_node'): ('M175 195 L395 265', (250, 262)),
    ('estimator_node', 'controller_node'): ('M545 90 L715 168', (655, 112)),
    ('reference_node', 'controller_node'): ('M545 180 L715 180', (630, 172)),
    ('controller_node', 'sim_node'): ('M790 160 L790 24 L100 24 L100 160', (445, 16))}
_INK, _SOFT, _CARD, _EDGE = (
    palette.COLOURS[name] for name in ('ink', 'soft', 'card', 'optitrack'))


def between(source: str, target: str) -> list[str]:
    """Return the names of the topics from one node to another."""
    return [name for name, use in USES.items()
            if source in use.publishers and target in use.subscribers]


def _label(names: list[str], place: tuple[int, int]) -> str:
    """Return names of topics, two in a line, about a place."""
    lines = [', '.join(names[first:first + 2]) for first in range(0, len(names), 2)]
    return ''.join(f'<text x="{place[0]}" y="{place[1] + 15 * row}" text-anchor="middle" '
                   f'fill="{_SOFT}" font-size="12">{line}</text>'
                   for row, line in enumerate(lines))


def svg() -> str:
    """Return the graph of a flight as a picture."""
    width, height = SIZE['picture']
    wide, tall = SIZE['box']
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
           'font-family="system-ui, sans-serif" font-size="14">',
           '<title>The nodes of a flight and their topics</title>'
           '<defs><marker id="to" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" '
           f'markerHeight="8" orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="{_INK}"/></marker>'
           f'</defs><rect width="{width}" height="{height}" rx="10" fill="{palette.PAPER}"/>']
    for (source, target), (path, place) in PATHS.items():
        out += [f'<path d="{path}" fill="none" stroke="{_INK}" marker-end="url(#to)"/>',
                _label(between(source, target), place)]
    for name, (x, y) in PLACES.items():
        dashed = ' stroke-dasharray="5 4"' if name == 'recorder_node' else ''
        out.append(
            f'<rect x="{x - wide / 2:g}" y="{y - tall / 2:g}" width="{wide}" height="{tall}" '
            f'rx="6" fill="{_CARD}" stroke="{_EDGE}"{dashed}/>'
            f'<text x="{x}" y="{y + 5}" text-anchor="middle" fill="{_INK}">{name}</text>')
    out += [f'<text x="560" y="355" fill="{_SOFT}" font-size="12">records every topic</text>',
            '</svg>\n']
    return '\n'.join(out)
