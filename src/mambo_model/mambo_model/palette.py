"""
The colours of every page and figure, and the only module that names one.

A role has one colour wherever it is drawn: black for the reference, grey for the ground truth,
sky blue for Optitrack, rust for the estimate. Any two roles differ for all kinds of colour vision.
Each has a contrast of at least 3:1 with the paper (WCAG 2.2, 1.4.11), text of at least 4.5:1
(1.4.3). Lines that may lie on each other differ in width or dashes, too.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

from .errors import visible

ROLES = {  # (on white, on a dark page)
    'reference': ('#111111', '#ffffff'), 'truth': ('#8f8f8f', '#909090'),
    'optitrack': ('#0a8ff0', '#3fa9ff'), 'estimate': ('#a83200', '#d84c00'),
    'onboard': ('#1b1bd6', '#7038ff'), 'flow': ('#5c0a6b', '#c8c890'),
    'sonar': ('#d0780c', '#ffb000'), 'barometer': ('#4f5a50', '#23745f')}
PAGE = {  # (on white, on a dark page)
    'ink': ('#202124', '#e8eaed'), 'soft': ('#55595f', '#a8adb3'), 'line': ('#d0d3d6', '#44484e'),
    'paper': ('#ffffff', '#17181a'), 'card': ('#f5f6f7', '#1f2124'),
    'shade': ('#e9ebee', '#26292d'), 'good': ('#12682e', '#81c995'),
    'half': ('#8a4b00', '#fdd663'), 'bad': ('#b3261e', '#f28b82')}
COLOURS = {name: light for name, (light, _) in (*ROLES.items(), *PAGE.items())}
"""Colours on white by role."""
INK, LINE, PAPER = (COLOURS[name] for name in ('ink', 'line', 'paper'))
SERIES = ('onboard', 'sonar', 'barometer', 'flow', 'truth', 'estimate', 'optitrack', 'reference')
"""Whose colours curves without a role take, in this order, as far as the plot has them free."""
MEASURED = 'truth'
"""The role whose colour data of a test bench take."""
LABELS = {
    'reference': 'reference', 'ground truth': 'truth', 'Optitrack': 'optitrack', 'IMU': 'estimate',
    'estimate': 'estimate', 'onboard estimate': 'onboard', 'optical flow': 'flow',
    'sonar': 'sonar', 'barometer': 'barometer', 'ground_truth/odom': 'truth',
    'optitrack/pose': 'optitrack', 'estimate/odom': 'estimate', 'onboard/odom': 'onboard'}
"""Role by label and topic."""
LINES = {  # (dashes, width in points, above others)
    'reference': ('--', 1.4, 5), 'truth': ('-', 2.8, 1), 'optitrack': ('-', 2.0, 2),
    'estimate': ('-', 1.2, 4), 'onboard': ('-.', 1.2, 3), 'flow': (':', 1.6, 3),
    'sonar': ('-', 1.3, 3), 'barometer': ('-', 1.3, 3)}
DASHES = {'-': 'solid', '--': 'dash', '-.': 'dashdot', ':': 'dot'}  # plotly's names


def line(role: str) -> dict[str, Any]:
    """Return how matplotlib draws the line of a role: colour, dashes, width and order."""
    dashes, width, order = LINES[role]
    return {'color': COLOURS[role], 'ls': dashes, 'lw': width, 'zorder': order}


def free(used: Collection[str]) -> str:
    """Return the first role of ``SERIES`` that is not used."""
    return next(role for role in SERIES if role not in used)


def lines(labels: Iterable[str]) -> list[dict[str, Any]]:
    """
    Return how matplotlib draws the lines of one plot, each unlike the others.

    Parameters
    ----------
    labels
        One a line. One of ``LABELS`` takes its role's line, others take free colours and dashes.

    Raises
    ------
    ValueError
        If there are more lines than colours.

    """
    labels = list(labels)
    used = [LABELS[label] for label in labels if label in LABELS]
    if len(labels) > len(ROLES):
        raise ValueError(f'{len(labels)} lines in a plot of at most {len(ROLES)} colours')
    out, dashes = [], tuple(DASHES)
    for number, label in enumerate(labels):
        if label in LABELS:
            out.append(line(LABELS[label]))
            continue
        role = free(used)
        used.append(role)
        out.append({'color': COLOURS[role], 'ls': dashes[number % len(dashes)], 'lw': 1.5,
                    'zorder': 3})
    return out


def css() -> str:
    """Return the colours as variables of a page: light, dark where asked for, light on paper."""
    light, dark = (''.join(f'--{name}:{pair[k]};' for name, pair in (
        *ROLES.items(), *PAGE.items())) for k in (0, 1))
    return (f':root{{color-scheme:light dark;{light}}}\n'
            f'@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n')


def by_theme() -> dict[str, dict[str, str]]:
    """Return {'light' or 'dark': {role: colour}}, for scripts."""
    return {theme: {name: pair[k] for name, pair in (*ROLES.items(), *PAGE.items())}
            for k, theme in enumerate(('light', 'dark'))}


def variables(text: str) -> str:
    """Return an SVG with the variables of :func:`css` in place of the colours on white."""
    for name, colour in COLOURS.items():
        text = text.replace(colour, f'var(--{name})')
    return text


def in_figure(text: str) -> str:
    """Return a text as matplotlib draws it: dollars are dollars, not the ends of a formula."""
    return visible(text).replace('$', r'\$')
