"""
The colours of all pages and figures; no other module names a colour.

A role has the same colour everywhere: black for the reference, grey for the ground truth, sky
blue for Optitrack, rust for the estimate. Any two roles can be told apart with every kind of
colour vision. Each has a contrast of at least 3:1 with the background (WCAG 2.2, 1.4.11), text of
at least 4.5:1 (1.4.3). Lines that may overlap also differ in width or dashes.
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
"""Colours on white, by role."""
INK, LINE, PAPER = (COLOURS[name] for name in ('ink', 'line', 'paper'))
SERIES = ('onboard', 'sonar', 'barometer', 'flow', 'truth', 'estimate', 'optitrack', 'reference')
"""Roles whose colours curves without a role take, in this order, if the plot does not use them."""
MEASURED = 'truth'
"""The role whose colour is used for bench data."""
LABELS = {
    'reference': 'reference', 'ground truth': 'truth', 'Optitrack': 'optitrack', 'IMU': 'estimate',
    'estimate': 'estimate', 'onboard estimate': 'onboard', 'optical flow': 'flow',
    'sonar': 'sonar', 'barometer': 'barometer', 'ground_truth/odom': 'truth',
    'optitrack/pose': 'optitrack', 'estimate/odom': 'estimate', 'onboard/odom': 'onboard'}
"""Role by label and topic."""
LINES = {  # (dashes, width in points, drawing order)
    'reference': ('--', 1.4, 5), 'truth': ('-', 2.8, 1), 'optitrack': ('-', 2.0, 2),
    'estimate': ('-', 1.2, 4), 'onboard': ('-.', 1.2, 3), 'flow': (':', 1.6, 3),
    'sonar': ('-', 1.3, 3), 'barometer': ('-', 1.3, 3)}
DASHES = {'-': 'solid', '--': 'dash', '-.': 'dashdot', ':': 'dot'}  # plotly's names


def line(role: str) -> dict[str, Any]:
    """Return the matplotlib style of the line of a role: colour, dashes, width and order."""
    dashes, width, order = LINES[role]
    return {'color': COLOURS[role], 'ls': dashes, 'lw': width, 'zorder': order}


def free(used: Collection[str]) -> str:
    """Return the first role of ``SERIES`` that is not used."""
    return next(role for role in SERIES if role not in used)


def lines(labels: Iterable[str]) -> list[dict[str, Any]]:
    """
    Return the matplotlib styles of the lines of one plot, all of them different.

    Parameters
    ----------
    labels
        One per line. A label in ``LABELS`` gets the style of its role; others get free colours
        and dashes.

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
    """Return the colours as CSS variables: light by default and in print, dark on request."""
    light, dark = (''.join(f'--{name}:{pair[k]};' for name, pair in (
        *ROLES.items(), *PAGE.items())) for k in (0, 1))
    return (f':root{{color-scheme:light dark;{light}}}\n'
            f'@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n')


def by_theme() -> dict[str, dict[str, str]]:
    """Return {'light' or 'dark': {role: colour}}, for scripts."""
    return {theme: {name: pair[k] for name, pair in (*ROLES.items(), *PAGE.items())}
            for k, theme in enumerate(('light', 'dark'))}


def variables(text: str) -> str:
    """Replace the colours on white in an SVG by the variables of :func:`css`."""
    for name, colour in COLOURS.items():
        text = text.replace(colour, f'var(--{name})')
    return text


def in_figure(text: str) -> str:
    """Escape a text for matplotlib, so that a dollar sign does not start a formula."""
    return visible(text).replace('$', r'\$')
