"""The page of several drones: their distances over time, the limit, and all in one hall."""

import json
import re
import shutil

import browser
from mambo_analysis.compare import compare, separation_page
from mambo_flight import fly
from mambo_flight.world import separation
import numpy as np
import pytest

pytestmark = pytest.mark.long


@pytest.fixture(scope='module')
def flown(tmp_path_factory):
    """Return a folder with the bags of three drones."""
    out = tmp_path_factory.mktemp('page') / 'three'
    assert fly.main(['--trajectory', 'hover', '--duration', '4', '--no-landing', '--drones', '3',
                     '--set', 'world.spacing=0.8', '-o', str(out)]) == 0
    return out


@pytest.fixture(scope='module')
def text(flown):
    return separation_page.report.html(separation_page.of_several(flown))


def data(text):
    """Return what the page draws."""
    return json.loads(re.search(
        r'<script id="data" type="application/json">(.*?)</script>', text, re.DOTALL)[1])


def test_the_page_draws_the_smallest_distance_and_the_limit(flown, text):
    found = separation.pairs(separation.read([flown])[0])
    figure, = data(text)['figures']
    lines = {line['name']: line for panel in figure['panels'] for line in panel['lines']}
    assert [len(panel['lines']) for panel in figure['panels']] == [4, 2]
    assert lines['collision']['y'] == [0.18, 0.18]
    least = np.array(lines['smallest of all pairs']['y'])
    assert min(least) == pytest.approx(found[0].least[0], abs=1e-4)
    assert max(least) <= 0.81 < min(lines['/mambo1 - /mambo3']['y'])
    assert f'{found[0].least[0]:.3f} m' in text and text.count('<tr><th scope="row">/mambo') == 3


def test_the_replay_has_every_drone_at_its_place(text):
    replay = data(text)['replay']
    assert [vehicle['name'] for vehicle in replay['vehicles']] == [
        '/mambo1', '/mambo2', '/mambo3']
    across = [vehicle['p'][0][1] for vehicle in replay['vehicles']]  # y up to the west
    assert across == pytest.approx([0.8, 0.0, -0.8], abs=0.02)
    assert len({vehicle['colour'] for vehicle in replay['vehicles']}) == 3


def test_the_smallest_distance_is_of_the_pairs_that_have_a_stamp():
    pair = separation.Pair
    t, least = separation.smallest([
        pair(('/a', '/b'), np.array([0, 10, 20]), np.array([3.0, 1.0, 2.0])),
        pair(('/a', '/c'), np.array([10, 20, 30]), np.array([2.0, 1.5, 9.0]))])
    assert t.tolist() == [0, 10, 20, 30] and least.tolist() == [3.0, 1.0, 1.5, 9.0]


def test_a_collision_is_named_on_the_page(tmp_path):
    out = tmp_path / 'near'
    assert fly.main([
        '--trajectory', 'hover', '--estimator', 'kalman', '--duration', '4', '--no-landing',
        '--drones', '2', '--set', 'world.spacing=0.2', '--set', 'world.least_separation=0.1',
        '--set', 'world.collision_distance=0.199', '-o', str(out)]) == 1
    made = separation_page.of_several(out)
    assert made.ending[0].startswith('/mambo1 and /mambo2 collided: 0.1')
    assert made.cards[2] == ('pairs that collided', '1', 'of 1')


def test_compare_takes_the_folder(flown, tmp_path, capsys):
    page = tmp_path / 'three.html'
    assert compare.main([str(flown), '--html', str(page)]) == 0
    assert '/mambo1 - /mambo2' in capsys.readouterr().out and page.stat().st_size > 1e6
    assert compare.main([str(flown), '--csv', str(tmp_path / 'x.csv')]) == 2
    refusal = capsys.readouterr().err
    assert 'several drones' in refusal and refusal.count('\n') == 1


@browser.NEEDED
def test_the_browser_draws_it(text, tmp_path):
    tab = browser.opened(text, tmp_path)
    names = tab.evaluate(
        "return document.querySelector('#separation .plot').data.map((line) => line.name);")
    assert 'smallest of all pairs' in names and 'collision' in names


@browser.AXE_NEEDED
@pytest.mark.parametrize('theme', ['light', 'dark'])
def test_axe_finds_nothing(text, theme, tmp_path):
    assert browser.findings(text, tmp_path, width=390, theme=theme) == []


def test_of_many_pairs_the_nearest_are_drawn_and_listed(monkeypatch, flown):
    drones, hall = separation.read_drones([flown])
    first = next(iter(drones.values()))
    many = {f'/mambo{k}': first._replace(place=(0.0, float(k), 0.0)) for k in range(1, 11)}
    monkeypatch.setattr(separation, 'read_drones', lambda paths: (many, hall))
    made = separation_page.of_several(flown)
    names = [line.name for line in made.figures[0].panels[0].lines]
    assert len(names) == 7 and '/mambo1 - /mambo2' in names and '/mambo1 - /mambo9' not in names
    assert 'the nearest pairs' in made.figures[0].text
    assert len(made.tables[0][2]) == 30 and made.notes[-1].startswith('15 pairs')
    assert made.cards[0][1] == '1.000 m' and len(made.replay['vehicles']) == 10


def test_a_folder_without_all_drones_of_its_hall_is_refused(flown, tmp_path, capsys):
    partial, page = tmp_path / 'partial', tmp_path / 'page.html'
    for name in ('mambo1', 'mambo2'):
        shutil.copytree(flown / name, partial / name)
    assert compare.main([str(partial), '--html', str(page)]) == 2
    assert '/mambo3 of the 3 drones of the hall is missing' in capsys.readouterr().err
    assert not page.exists()


def test_a_folder_of_other_bags_is_refused(flown, tmp_path, capsys):
    folder = tmp_path / 'others'
    assert fly.main(['--trajectory', 'hover', '--duration', '0.1', '--no-landing', '-o',
                     str(folder / 'alone')]) == 0
    assert compare.main([str(folder)]) == 2
    assert 'give a folder with the bags of 2 to 32 drones' in capsys.readouterr().err
