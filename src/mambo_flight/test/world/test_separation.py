"""Distance over time from bags: the distances of the flight, and refusals of other bags."""

import json
import shutil

from mambo_flight import fly
from mambo_flight.world import separation
from mambo_flight.world.separation import pairs, Track
from mambo_model.errors import InputError
import numpy as np
import pytest


@pytest.fixture(scope='module')
def flown(tmp_path_factory):
    """Return a folder with the bags of three drones."""
    out = tmp_path_factory.mktemp('separation') / 'flown'
    assert fly.main([  # the components of the other flight here: compiled once
        '--trajectory', 'hover', '--duration', '4', '--no-landing',
        '--drones', '3', '--set', 'world.spacing=0.8', '-o', str(out)]) == 0
    return out


def track(*rows, t=(0, 5, 10)):
    return Track(np.array(t), np.array(rows, dtype=float))


def test_distances_are_taken_at_common_stamps():
    still = track((0, 0, 0), (0, 0, 0), (0, 0, 0))
    moving = track((3, 4, 0), (0, 0, 2), (9, 9, 9), t=(0, 10, 20))
    far = track(*[(100, 0, 0)] * 3)
    found = pairs({'/a': still, '/b': moving, '/c': far})
    assert [pair.names for pair in found] == [('/a', '/b'), ('/b', '/c'), ('/a', '/c')]
    assert found[0].t.tolist() == [0, 10] and found[0].distance.tolist() == [5.0, 2.0]
    assert found[0].least == (2.0, 10e-9)
    with pytest.raises(InputError, match='no stamp in common'):
        pairs({'/a': still, '/b': track((0, 0, 0), (0, 0, 0), (0, 0, 0), t=(1, 2, 3))})


def test_bags_give_the_separation_of_the_flight(flown, tmp_path, capsys):
    picture, numbers = tmp_path / 'separation.png', tmp_path / 'separation.json'
    assert separation.main([str(flown), '-o', str(picture), '--json', str(numbers)]) == 0
    printed = capsys.readouterr().out
    assert printed.count('/mambo') == 6 and 'collision' not in printed
    assert picture.read_bytes().startswith(b'\x89PNG')
    found = json.loads(numbers.read_text())
    assert found['collision_distance'] == 0.18
    near = [pair for pair in found['pairs'] if pair['drones'] != ['/mambo1', '/mambo3']]
    assert len(near) == 2 and all(0.5 < pair['least'] <= 0.8 for pair in near)
    assert found['missing'] == []


@pytest.mark.parametrize(('shorten', 'said'), [
    (('/mambo2',), '2 of 3 pairs have no distance for a part of the flight, /mambo1 and /mambo2 '
     'for 3.00 s: one of their bags is shorter, or has gaps'),
    (('/mambo1', '/mambo2', '/mambo3'), 'distances end at t = 1.00 s of 4 s of flight')])
def test_bags_that_end_before_the_flight_exclude_no_collision(
        flown, tmp_path, capsys, monkeypatch, shorten, said):
    whole = separation.tracks_of

    def tracks(drones):
        return {name: Track(*(x[:201] if name in shorten else x for x in one))
                for name, one in whole(drones).items()}
    monkeypatch.setattr(separation, 'tracks_of', tracks)
    numbers = tmp_path / 'separation.json'
    assert separation.main([str(flown), '--json', str(numbers)]) == 1
    output = capsys.readouterr()
    assert output.out.splitlines()[-1] == f'warning: {said}'
    assert output.err == f'separation: collisions cannot be excluded: {said}\n'
    found = json.loads(numbers.read_text())['pairs']
    assert sorted(round(pair['lacking'], 3) for pair in found) == (
        [0.0, 3.0, 3.0] if len(shorten) == 1 else [0.0] * 3)
    assert {pair['to'] for pair in found} == {1.0, 4.0} if len(shorten) == 1 else {1.0}


def test_drones_that_are_missing_are_told(flown, tmp_path, capsys):
    single, numbers = [str(flown / name) for name in ('mambo1', 'mambo3')], tmp_path / 'x.json'
    assert separation.main([*single, '--json', str(numbers)]) == 0  # bags one by one
    printed = capsys.readouterr().out
    assert '/mambo1 - /mambo3' in printed
    assert 'warning: /mambo2 of the 3 drones of the hall is missing' in printed
    assert json.loads(numbers.read_text())['missing'] == ['/mambo2']
    partial = tmp_path / 'partial'  # as an interruption leaves it
    for name in ('mambo1', 'mambo2'):
        shutil.copytree(flown / name, partial / name)
    assert separation.main([str(partial)]) == 2
    printed = capsys.readouterr().err
    assert '/mambo3 of the 3 drones of the hall is missing' in printed
    assert printed.count('\n') == 1


@pytest.mark.parametrize('options, difference', [
    (['--drones', '4'], 'world.drones = 4, not 3'),
    (['--drones', '3', '--set', 'world.spacing=0.9'], 'world.spacing = 0.9, not 0.8'),
    (['--drones', '3', '--seed', '5'], 'seed 5, not 1'),
    (['--drones', '3', '--duration', '5'], 'duration 5.0, not 4.0'),
    (['--drones', '3', '--trajectory', 'circle'], 'trajectory circle, not hover')])
def test_bags_of_two_flights_have_no_distance(flown, tmp_path, capsys, options, difference):
    other = tmp_path / 'other'
    assert fly.main([
        '--trajectory', 'hover', '--duration', '4', '--no-landing',
        *([] if '--set' in options else ['--set', 'world.spacing=0.8']), *options, '-o',
        str(other)]) == 0
    capsys.readouterr()
    assert separation.main([str(flown / 'mambo1'), str(other / 'mambo2')]) == 2
    assert capsys.readouterr().err == (
        f'separation: {other / "mambo2"}: is not of the flight of {flown / "mambo1"}: '
        f'{difference}\n')


def test_a_collision_is_an_error(tmp_path, capsys):
    out = tmp_path / 'near'
    assert fly.main([
        '--trajectory', 'hover', '--duration', '4', '--no-landing',
        '--drones', '2', '--set', 'world.spacing=0.2', '--set', 'world.least_separation=0.1',
        '--set', 'world.collision_distance=0.199', '--seed', '2', '-o', str(out)]) == 1
    flown = capsys.readouterr()
    assert '/mambo1 and /mambo2 collided at t = ' in flown.err and '  collision' in flown.out
    assert separation.main([str(out)]) == 1
    assert '/mambo1 and /mambo2 collided: 0.1' in capsys.readouterr().err


def test_bags_of_other_flights_are_refused(flown, tmp_path, capsys):
    alone = tmp_path / 'alone'
    assert fly.main(['--trajectory', 'hover', '--duration', '0.1', '-o', str(alone)]) == 0
    copy = tmp_path / 'copy'
    shutil.copytree(flown / 'mambo1', copy)
    for bags, message in (
            ([flown / 'mambo1'], 'mambo1: one drone: give a folder with the bags of 2 to'),
            ([flown / 'nothing'], 'nothing: no such bag or folder of bags'),
            ([flown / 'mambo1', copy], '/mambo1 is in another bag, too'),
            ([flown / 'mambo1', alone], 'holds no world.yaml'),
            ([flown / 'mambo1', tmp_path / 'none'], 'none')):
        assert separation.main([str(bag) for bag in bags]) == 2
        printed = capsys.readouterr().err
        assert message in printed and printed.count('\n') == 1
    assert separation.main([str(flown), '-o', str(tmp_path / 'x.gif')]) == 2
