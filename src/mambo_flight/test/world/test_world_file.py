"""The hall as text survives the way there and back; anything else is refused in one line."""

from mambo_flight.scenario import override, scenario
from mambo_flight.world import world_file
from mambo_flight.world.world_file import Hall, parse, to_text
from mambo_model.schema import ParameterError
from mambo_sim.downwash import DownwashParams
from mambo_sim.sensors.hall_capture import HallCaptureParams
from mambo_sim.world import WorldParams
import pytest

HALL = Hall(
    WorldParams(drones=2, formation='circle', downwash=DownwashParams(enabled=True)),
    {'/mambo1': (0.1, -1.5, 0.0), '/mambo2': (1.0 / 3.0, 1.5, 0.0)})


def test_a_hall_survives_being_written():
    assert parse(to_text(HALL), 'bag') == HALL
    assert 'inertial NED' in to_text(HALL)  # a reader must know: the topics have z up
    assert world_file.NAME == 'world.yaml'


def test_a_hall_of_a_bag_from_before_the_shared_motion_capture_is_read():
    old, _, _ = to_text(HALL).partition('  capture:')
    _, found, places = to_text(HALL).partition('places:')
    assert parse(old + found + places, 'bag') == HALL


def test_drones_that_cannot_share_a_motion_capture_are_refused():
    flights = [scenario(), override(scenario(), {'optitrack_node.optitrack.model': 'pose'})]
    world_file.check_cameras(HALL, flights)
    seen = HALL._replace(params=WorldParams(drones=2, capture=HallCaptureParams(occlusion=True)))
    with pytest.raises(ParameterError, match='optitrack_node.optitrack.model: markers'):
        world_file.check_cameras(seen, flights)


@pytest.mark.parametrize('old, new, message', [
    ('drones: 2', 'drones: 99', 'drones = 99'),
    ('formation: circle', 'formation: heap', 'heap'),
    ('world:', 'word:', 'must hold world and places'),
    ('/mambo1:', 'mambo1:', 'not the namespace'),
    ('/mambo1:', '"/mambo1\\n":', 'not the namespace'),
    ('- 0.1', '- .nan', 'must be 3 numbers'),
    ('- 0.1', '- true', 'must be 3 numbers'),
    ('- 0.1\n', '- 0.1\n  - 0.2\n', 'must be 3 numbers'),
    ('- 0.1', f'- {10 ** 400}', 'must be 3 numbers'),
    ('- 0.1', '- -.inf', 'must be 3 numbers'),
    ('drones: 2', 'drones: 3', '2 places, but drones = 3'),
    ('drones: 2', 'drones: 2\n  drones: 2', "line 3: 'drones' is given twice"),
    ('/mambo2:', '/mambo1:', "'/mambo1' is given twice"),
    ('places:', 'places: {}\nplaces:', "'places' is given twice"),
    ('places:', 'places: [', 'line'),
    ('spacing: 3.0', 'speed: 3.0', 'unknown'),
])
def test_what_is_not_a_hall_is_refused_in_one_line(old, new, message):
    text = to_text(HALL)
    assert old in text
    with pytest.raises(ParameterError, match=message) as error:
        parse(text.replace(old, new), 'bag')
    assert str(error.value).startswith('bag: world.yaml: ') and '\n' not in str(error.value)


def test_a_hall_without_places_is_refused():
    text, _, _ = to_text(HALL).partition('places:')
    with pytest.raises(ParameterError, match='0 places, but drones = 2'):
        parse(f'{text}places: {{}}', 'bag')


def test_there_are_at_most_so_many_places():
    many = Hall(HALL.params, {f'/mambo{k}': (0.0, float(k), 0.0) for k in range(33)})
    with pytest.raises(ParameterError, match='33 places; at most 32'):
        parse(to_text(many), 'bag')
