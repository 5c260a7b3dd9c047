"""The colours: told apart by everybody, seen on the paper, and named in one place."""

import ast
from itertools import combinations
from pathlib import Path
import re

from mambo_model import palette
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
# Complete loss of one kind of cone, on linear RGB: Machado, Oliveira, Fernandes (2009), table 1
VISION = {
    'normal': np.eye(3),
    'protanopia': np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                            [-0.003882, -0.048116, 1.051998]]),
    'deuteranopia': np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                              [-0.011820, 0.042940, 0.968881]]),
    'tritanopia': np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                            [0.004733, 0.691367, 0.303900]])}
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])  # of linear sRGB, D65
APART = 10.0  # CIEDE2000; 1 is just seen side by side, above 10 thin lines differ at a glance


def linear(colour):
    c = np.array([int(colour[k:k + 2], 16) / 255.0 for k in (1, 3, 5)])
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055)**2.4)


def lab(rgb):
    ratio = XYZ @ np.clip(rgb, 0.0, 1.0) / XYZ.sum(axis=1)
    x, y, z = np.where(ratio > (6 / 29)**3, np.cbrt(ratio), ratio / (3 * (6 / 29)**2) + 4 / 29)
    return 116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)


def ciede2000(one, other):
    """Return the difference of two colours in Lab: Sharma, Wu, Dalal (2005)."""
    (L1, a1, b1), (L2, a2, b2) = one, other
    C = 0.5 * (np.hypot(a1, b1) + np.hypot(a2, b2))
    G = 0.5 * (1.0 - np.sqrt(C**7 / (C**7 + 25.0**7)))
    a1, a2 = a1 * (1.0 + G), a2 * (1.0 + G)
    C1, C2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = np.degrees(np.arctan2(b1, a1)) % 360.0, np.degrees(np.arctan2(b2, a2)) % 360.0
    dh = (h2 - h1 + 180.0) % 360.0 - 180.0 if C1 * C2 else 0.0
    L, C, h = 0.5 * (L1 + L2), 0.5 * (C1 + C2), np.radians(h1 + 0.5 * dh if C1 * C2 else h1 + h2)
    dH = 2.0 * np.sqrt(C1 * C2) * np.sin(np.radians(0.5 * dh))
    T = (1.0 - 0.17 * np.cos(h - np.radians(30.0)) + 0.24 * np.cos(2.0 * h)
         + 0.32 * np.cos(3.0 * h + np.radians(6.0)) - 0.2 * np.cos(4.0 * h - np.radians(63.0)))
    lightness = (L2 - L1) / (1.0 + 0.015 * (L - 50.0)**2 / np.sqrt(20.0 + (L - 50.0)**2))
    chroma, hue = (C2 - C1) / (1.0 + 0.045 * C), dH / (1.0 + 0.015 * C * T)
    turn = np.radians(60.0 * np.exp(-(((np.degrees(h) % 360.0) - 275.0) / 25.0)**2))
    R = -2.0 * np.sqrt(C**7 / (C**7 + 25.0**7)) * np.sin(turn)
    return float(np.sqrt(lightness**2 + chroma**2 + hue**2 + R * chroma * hue))


def contrast(one, other):
    dark, light = sorted(float(XYZ[1] @ linear(colour)) for colour in (one, other))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize('one, other, difference', [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((6.7747, -0.2908, -2.4247), (5.8714, -0.0985, -2.2286), 0.6377),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644)])
def test_the_difference_of_colours_is_that_of_its_paper(one, other, difference):
    assert ciede2000(one, other) == pytest.approx(difference, abs=1e-4)


@pytest.mark.parametrize('theme', [0, 1], ids=['light', 'dark'])
@pytest.mark.parametrize('vision', VISION)
def test_any_two_roles_are_told_apart_by_everybody(theme, vision):
    seen = {role: lab(VISION[vision] @ linear(pair[theme]))
            for role, pair in palette.ROLES.items()}
    for one, other in combinations(seen, 2):
        assert ciede2000(seen[one], seen[other]) >= APART, (one, other)


@pytest.mark.parametrize('theme', [0, 1], ids=['light', 'dark'])
def test_lines_and_texts_stand_out_from_the_page(theme):
    paper, card = palette.PAGE['paper'][theme], palette.PAGE['card'][theme]
    for role, pair in palette.ROLES.items():
        assert contrast(pair[theme], paper) >= 3.0, role
    for text in ('ink', 'soft', 'good', 'half', 'bad'):
        assert min(contrast(palette.PAGE[text][theme], behind)
                   for behind in (paper, card)) >= 4.5, text


def test_lines_that_may_lie_on_each_other_differ_in_more_than_colour():
    styles = [(dashes, width) for role, (dashes, width, _) in palette.LINES.items()
              if role in ('reference', 'truth', 'optitrack', 'estimate', 'onboard', 'flow')]
    assert len(set(styles)) == len(styles) and set(palette.LINES) == set(palette.ROLES)


def test_lines_of_a_plot_keep_their_role_and_never_share_a_colour():
    labels = ['reference', 'IMU', 'old map', 'Optitrack', 'new map', 'optical flow']
    styles = palette.lines(labels)
    assert styles[1]['color'] == palette.COLOURS['estimate']
    assert styles[3]['color'] == palette.COLOURS['optitrack']
    assert len({style['color'] for style in styles}) == len(styles)
    with pytest.raises(ValueError, match='9 lines in a plot of at most 8 colours'):
        palette.lines('abcdefghi')


SOURCES = sorted(file for folder in ('src', 'examples', 'tools', 'benchmarks')
                 for file in (ROOT / folder).rglob('*') if file.suffix in ('.py', '.js', '.css')
                 and file.name != 'palette.py' and 'test' not in file.parts)
LITERAL = re.compile(
    r'#(?:[0-9a-f]{3,4}|[0-9a-f]{6}|[0-9a-f]{8})(?![0-9a-z_-])|\b(?:rgb|hsl)a?\(|\btab:',
    re.IGNORECASE)
NAMED = ('color', 'colors', 'facecolor', 'edgecolor', 'markerfacecolor', 'markeredgecolor', 'c',
         'ecolor', 'mfc', 'mec', 'background', 'fill')
DRAWING = ('plot', 'errorbar', 'bar', 'barh', 'hist', 'fill_between', 'scatter', 'loglog',
           'semilogx', 'semilogy', 'axhline', 'axvline', 'axvspan')


@pytest.mark.parametrize('file', [f for f in SOURCES if f.suffix != '.py'],
                         ids=lambda file: file.name)
def test_no_style_sheet_or_script_names_a_colour(file):
    text = file.read_text()
    assert not LITERAL.findall(text)
    assert not re.findall(r'(?:color|background|fill|stroke)\s*:\s*[\'"]?(?!inherit|transparent)'
                          r'(?:white|black|gr[ae]y|red|green|blue|orange)\b', text)


def colours_of(tree):
    """Yield the lines of a module that name a colour, or let matplotlib choose one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and LITERAL.search(
                node.value):
            yield node.lineno, node.value[:40]
        if not isinstance(node, ast.Call):
            continue
        given = {keyword.arg: keyword.value for keyword in node.keywords}
        for name in set(given) & set(NAMED):
            value = given[name]
            if isinstance(value, ast.Constant) and isinstance(value.value, str) and \
                    value.value != 'none':
                yield node.lineno, f'{name}={value.value!r}'
        if isinstance(node.func, ast.Attribute) and node.func.attr in DRAWING and not {
                'color', 'edgecolor', 'facecolor', None} & set(given):
            yield node.lineno, f'{node.func.attr} without a colour'


@pytest.mark.parametrize('file', [f for f in SOURCES if f.suffix == '.py'],
                         ids=lambda file: file.name)
def test_no_other_module_names_a_colour(file):
    assert list(colours_of(ast.parse(file.read_text()))) == []


@pytest.mark.parametrize('code', [
    'axes.plot(x, y)', "f(color='black')", "INK = '#202124'", "x.plot(1, color='C0')",
    "s = 'color: #fff;'", "f(facecolor='white')"])
def test_a_colour_is_found(code):
    assert list(colours_of(ast.parse(code)))
