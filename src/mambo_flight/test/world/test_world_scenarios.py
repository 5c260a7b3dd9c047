"""Several drones by a scenario file, by options and by the command fly."""

from mambo_bags.command import Parser
from mambo_bags.reader import read_bag
from mambo_flight import closed_loop, flight_options, fly, recording_to_bag, scenario_file
from mambo_flight.scenario import from_yaml
from mambo_flight.scenario_file import load, load_world, read
from mambo_flight.world import formation, world_file
from mambo_model.schema import ParameterError
from mambo_ros import topics
from mambo_sim.world import WorldParams
import numpy as np
import pytest

SHIPPED = ('several_exchange', 'several_follow', 'several_formation')


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / 'mine.yaml'
        path.write_text(f'title: several\ntrajectory: hover\nduration: 4\nlanding: false\n{text}')
        return path
    return write


def options(*words):
    out = Parser('fly', 'Flies.')
    out.add_argument('--scenario')
    flight_options.add(out)
    return out.parse_args(list(words))


def test_a_section_of_a_file_makes_it_a_flight_of_several_drones(file):
    path = file('world:\n  drones: 3\n  formation: circle\n  downwash: {enabled: true}\n')
    world = load_world(str(path))
    assert (world.drones, world.formation, world.downwash.enabled) == (3, 'circle', True)
    assert world.spacing == WorldParams().spacing
    assert read(path).world == world
    assert load(str(path))[1].sim_node.duration == 4.0  # the flight of the first drone


def test_a_file_without_the_section_is_a_flight_of_one(file):
    assert load_world(str(file(''))) == WorldParams()
    assert WorldParams().drones == 1


@pytest.mark.parametrize(('text', 'message'), [
    ('world: 3\n', r'mine.yaml:5: world: must hold names and values'),
    ('world: {drone: 3}\n', r'mine.yaml:5: world.drone: unknown parameter; did you mean'),
    ('world: {drones: 0}\n', r'mine.yaml:5: .*drones = 0 is outside \[1, 32\]'),
    ('world: {drones: 33}\n', r'mine.yaml:5: .*drones = 33 is outside \[1, 32\]'),
    ('world: {drones: two}\n', r"mine.yaml:5: .*drones: 'two' is not a number"),
    ('world: {drones: 1.5}\n', r'mine.yaml:5: .*drones = 1.5 must be a whole number'),
    ('world: {spacing: .nan}\n', r"mine.yaml:5: world.spacing: '.nan' is not a number"),
    ('world: {formation: heap}\n', r"mine.yaml:5: .*formation = 'heap' is not one of line, "),
    ('world:\n  drones: 2\n  spacing: 0.3\n',
     r'mine.yaml:7: world.spacing = 0.3 m is less than least_separation = 0.5 m'),
    ('world: {downwash: {enabled: maybe}}\n', r'mine.yaml:5: .*must be true or false'),
    ('world: {drones: 2, drones: 3}\n', r'mine.yaml:5: drones: duplicate key'),
    ('flights:\n  one:\n    world: {drones: 2}\n', r'mine.yaml:7: world: unknown')])
def test_what_is_wrong_in_the_section_is_located(file, text, message):
    with pytest.raises(ParameterError, match=message) as error:
        load_world(str(file(text)))
    assert '\n' not in str(error.value)


def test_options_count_before_the_file(file):
    path = str(file('world: {drones: 3, spacing: 2.0}\n'))
    assert flight_options.world(options('--scenario', path)).drones == 3
    world = flight_options.world(options(
        '--scenario', path, '--drones', '5', '--set', 'world.formation=circle', '--set',
        'world.downwash.thrust_loss=0.1', '--set', 'world.downwash.enabled=true', '--set',
        'sim_node.simulator.seed=4'))
    assert (world.drones, world.formation, world.spacing) == (5, 'circle', 2.0)
    assert world.downwash.thrust_loss == 0.1
    assert flight_options.world(options()).drones == 1


def test_a_value_of_the_world_is_no_parameter_of_a_node(file):
    given = options('--drones', '2', '--set', 'world.spacing=4', '--set',
                    'sim_node.simulator.seed=4')
    _, flight = load(str(file('')))
    assert flight_options.applied(flight, given).seed == 4


@pytest.mark.parametrize(('words', 'message'), [
    (['--set', 'world.spacing=2'], '--set world.spacing: needs several drones: give --drones'),
    (['--drones', '2', '--set', 'world.space=2'], 'world.space: unknown parameter; did you mean'),
    (['--drones', '2', '--set', 'world.spacing=0.1'], 'spacing = 0.1 m is outside'),
    (['--drones', '2', '--set', 'world.spacing=far'], "spacing = 'far' must be a number")])
def test_wrong_options_are_named(words, message):
    with pytest.raises(ParameterError, match=message):
        flight_options.world(options(*words))


@pytest.mark.parametrize(('option', 'needs'), [
    ('delay=2', 'formation is line: choose world.formation: follow'),
    ('turn_time=9', 'formation is line: choose world.formation: exchange'),
    ('downwash.decay=9', 'downwash is off: set world.downwash.enabled: true'),
    ('capture.cameras=4', 'no drone hides another: set world.capture.occlusion: true'),
    ('capture.body_radius=0.1', 'no drone hides another'),
    ('capture.swap_time=3', 'no drone is taken for another: set world.capture.swap_distance')])
def test_an_option_without_effect_is_refused_with_what_it_needs(file, option, needs):
    name, _, value = option.partition('=')
    for given in (lambda: flight_options.world(options('--drones', '3', '--set',
                                                       f'world.{option}')),
                  lambda: load_world(str(file(f'world: {{drones: 3, {name}: {value}}}\n')))):
        with pytest.raises(ParameterError, match=f'world.{name}: has no effect, .*{needs}') as e:
            given()
        assert '\n' not in str(e.value)


def test_what_such_an_option_needs_lets_it_act():
    for words in (['formation=follow', 'delay=2'], ['formation=exchange', 'turn_time=9'],
                  ['downwash.enabled=true', 'downwash.decay=9'],
                  ['capture.occlusion=true', 'capture.cameras=4', 'capture.body_height=0.1'],
                  ['capture.swap_distance=0.3', 'capture.swap_time=3']):
        given = [part for word in words for part in ('--set', f'world.{word}')]
        assert flight_options.world(options('--drones', '3', *given)).drones == 3


def test_a_trajectory_that_an_exchange_does_not_fly_is_refused():
    words = ['--drones', '3', '--set', 'world.formation=exchange', '--trajectory']
    assert flight_options.world(options(*words, 'hover')).drones == 3
    with pytest.raises(ParameterError, match='--trajectory: circle has no effect'):
        flight_options.world(options(*words, 'circle'))


@pytest.mark.parametrize('name', ['circle', 'step'])  # circle is the default, but asked for here
def test_a_trajectory_of_a_file_that_an_exchange_does_not_fly_is_refused(file, name):
    world = 'world: {drones: 3, formation: exchange}\n'
    assert load_world(str(file(world))).formation == 'exchange'
    with pytest.raises(ParameterError, match=rf'mine.yaml:\d+: {name} has no effect, as the form'):
        load_world(str(file(f'{world}flights:\n  one: {{trajectory: {name}}}\n')))


@pytest.mark.parametrize('words', [['--duration', '40'], ['--set', 'sim_node.duration = 40']])
def test_an_exchange_lasts_as_long_as_the_options_say_even_by_default(words):
    exchange = ['--drones', '2', '--set', 'world.formation=exchange']
    assert not flight_options.timed(options(*exchange))
    assert flight_options.timed(options(*exchange, *words))


def test_a_world_of_one_drone_is_not_silently_flown_alone(file):
    path = str(file('world: {formation: circle, spacing: 2.0}\n'))
    with pytest.raises(ParameterError, match='mine.yaml: world: has no effect, as one drone'):
        flight_options.world(options('--scenario', path))
    assert flight_options.world(options('--scenario', path, '--drones', '4')).drones == 4


@pytest.mark.parametrize('words', [['--drones', '0'], ['--drones', '33'], ['--drones', '2.5']])
def test_the_number_of_drones_is_bounded(words, capsys):
    with pytest.raises(SystemExit):
        options(*words)
    assert '--drones' in capsys.readouterr().err


@pytest.mark.parametrize('name', SHIPPED)
def test_the_shipped_scenarios_are_free_of_collisions(name):
    assert name in scenario_file.names()
    world, (_, flight) = load_world(name), load(name)
    drones = formation.hall(flight, world)  # refuses references that meet
    assert len(drones.flights) == world.drones > 2
    assert world.least_separation >= 0.5


@pytest.fixture(scope='module')
def flown(tmp_path_factory):
    """Return the folder of the bags of two drones, flown by the command."""
    folder = tmp_path_factory.mktemp('world')
    path = folder / 'mine.yaml'
    path.write_text('title: two\ntrajectory: hover\nduration: 4\nlanding: false\n'
                    'world: {drones: 2, spacing: 1.0}\n')
    assert fly.main([str(path), '--seed', '5', '-o', str(folder / 'out')]) == 0
    return folder / 'out'


def test_the_command_writes_a_bag_of_each_drone_with_its_hall(flown):
    assert sorted(path.name for path in flown.iterdir()) == ['mambo1', 'mambo2']
    for number, name in enumerate(('mambo1', 'mambo2')):
        bag = read_bag(flown / name)
        assert bag.namespace == f'/{name}'
        hall = world_file.parse(bag.attachments['world.yaml'], name)
        assert hall.params.drones == 2
        assert hall.places == {'/mambo1': (0.0, -0.5, 0.0), '/mambo2': (0.0, 0.5, 0.0)}
        assert from_yaml(bag.attachments['scenario.yaml']).seed == 5 + number


def test_each_bag_holds_the_messages_of_the_drone_alone(flown, tmp_path):
    bag = read_bag(flown / 'mambo2')
    flight = from_yaml(bag.attachments['scenario.yaml'])
    recording_to_bag.write(tmp_path / 'alone', flight, closed_loop.fly(flight, inner=True))
    alone = read_bag(tmp_path / 'alone')
    for topic in topics.RECORDED:
        mine, its = (
            list(map(bytes, one[topics.full_name(topic, one.namespace)].raw))
            for one in (alone, bag))
        assert mine and mine == its, topic.name


def test_the_command_says_how_near_they_came(tmp_path, capsys):
    words = ['--trajectory', 'hover', '--duration', '3', '--no-landing', '--drones', '2']
    assert fly.main([*words, '-o', str(tmp_path / 'out')]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith('/mambo1: tracking error ')
    row = next(line for line in printed if line.startswith('/mambo1 - /mambo2'))
    assert 2.5 < float(row.split()[3]) <= 3.0
    assert printed[-2].startswith('hover: 2 drones, 3.00 s flown in ')
    assert printed[-1] == f'bags: {tmp_path / "out"}'


def test_the_hall_is_printed_instead_of_flown(tmp_path, capsys):
    assert fly.main(['several_exchange', '--print-scenario']) == 0
    hall = world_file.parse(capsys.readouterr().out, 'printed')
    assert len(hall.places) == 6
    np.testing.assert_allclose([np.hypot(x, y) for x, y, _ in hall.places.values()], 1.0)


def test_references_that_meet_are_not_flown(tmp_path, capsys):
    out = tmp_path / 'out'
    assert fly.main([
        '--trajectory', 'circle', '--duration', '25', '--drones', '2', '--set',
        'world.formation=follow', '--set', 'world.delay=3.14', '--set', 'world.spacing=2.0',
        '-o', str(out)]) == 2
    printed = capsys.readouterr().err
    assert 'the references of drones 1 and 2 come within' in printed and printed.count('\n') == 1
    assert not out.exists()
