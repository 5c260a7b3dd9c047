"""Lines of roles and of what has none; tests/workspace/test_palette.py has the colours."""

from mambo_model import palette
from mambo_model.errors import visible
from mambo_model.palette import by_theme, COLOURS, css, free, LABELS, line, lines, ROLES, variables
from matplotlib.figure import Figure
import pytest


@pytest.mark.parametrize('role', ROLES)
def test_a_role_has_one_line(role):
    drawn = line(role)
    assert drawn['color'] == COLOURS[role] == ROLES[role][0]
    assert (drawn['ls'], drawn['lw'], drawn['zorder']) == palette.LINES[role]


def test_labels_take_the_lines_of_their_roles_and_others_what_is_free():
    drawn = lines(['IMU', 'mine', 'reference', 'yours'])
    assert drawn[0] == line('estimate') and drawn[2] == line('reference')
    assert drawn[1]['color'] == COLOURS['onboard'] and drawn[3]['color'] == COLOURS['sonar']
    assert len({one['color'] for one in drawn}) == 4
    assert drawn[1]['ls'] != drawn[3]['ls']


def test_a_free_colour_is_none_that_a_later_label_has():
    drawn = lines(['mine', 'onboard estimate'])
    assert drawn[0]['color'] != drawn[1]['color'] == COLOURS['onboard']
    assert free(()) == palette.SERIES[0] and free(palette.SERIES[:3]) == palette.SERIES[3]


def test_more_lines_than_colours_are_refused():
    assert len({one['color'] for one in lines('abcdefgh')}) == 8
    with pytest.raises(ValueError, match='9 lines in a plot of at most 8 colours'):
        lines('abcdefghi')


def test_a_page_has_both_themes_and_an_svg_its_variables():
    light, dark = css().split('@media screen and (prefers-color-scheme:dark)')
    themes = by_theme()
    for name, (white, black) in {**ROLES, **palette.PAGE}.items():
        assert f'--{name}:{white};' in light and f'--{name}:{black};' in dark
        assert (themes['light'][name], themes['dark'][name]) == (white, black)
    assert variables(f'<path stroke="{COLOURS["truth"]}"/>') == '<path stroke="var(--truth)"/>'
    assert variables('<path stroke="#123456"/>') == '<path stroke="#123456"/>'


def test_every_label_has_a_role():
    assert set(LABELS.values()) <= set(ROLES) and set(palette.LINES) == set(ROLES)


@pytest.mark.parametrize('name', ['a$\\foo$b', '$x_{$', '$', 'a\\$b$', 'x\udcff', 'plain'])
def test_any_name_can_be_drawn(name):
    figure = Figure()
    title = figure.suptitle(palette.in_figure(name))
    figure.canvas.draw()
    assert title.get_text() == visible(name).replace('$', r'\$')
