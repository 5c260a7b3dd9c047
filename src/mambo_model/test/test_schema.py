"""Parameters say what is wrong, where and within which limits."""

from dataclasses import dataclass
import math

from mambo_model import schema
import pytest


@dataclass(frozen=True)
class Engine:
    """A component with a parameter of every kind."""

    power: float = schema.quantity(2.0, 'kW', 0.5, 8.0, 'a source')
    cylinders: int = schema.quantity(4, '1', 1, 16, 'a source')
    bore: tuple[float, float] = schema.quantity((0.1, 0.2), 'm', 0.0, 1.0, 'a source')
    fuel: str = schema.choice('petrol', ('diesel', 'petrol'), 'a source')
    turbo: bool = schema.flag(False, 'a source')
    label: str = schema.text('', 'a source')

    def __post_init__(self):
        schema.check(self)


@dataclass(frozen=True)
class Car:
    """A component with a part."""

    engine: Engine = schema.group(Engine)
    doors: int = schema.quantity(5, '1', 2, 5, 'a source')

    def __post_init__(self):
        schema.check(self)


@pytest.mark.parametrize(('name', 'value', 'message'), [
    ('power', 9, r'^power = 9 kW is outside \[0.5, 8\]'),
    ('power', 0.4, r'^power = 0.4 kW is outside \[0.5, 8\]'),
    ('power', math.nan, r'^power = nan kW is outside'),
    ('power', 'high', r"^power = 'high' must be a number"),
    ('power', True, r'^power = True must be a number'),
    ('power', (1.0, 2.0), r'^power = \(1.0, 2.0\) must be a number'),
    ('cylinders', 4.0, r'^cylinders = 4.0 must be a whole number'),
    ('bore', 0.1, r'^bore = 0.1 must be 2 numbers'),
    ('bore', (0.1,), r'^bore = \(0.1,\) must be 2 numbers'),
    ('bore', (0.1, 2.0), r'^bore = \(0.1, 2.0\) m is outside \[0, 1\]'),
    ('bore', (0.1, None), r'^bore = \(0.1, None\) must be a number'),
    ('fuel', 'steam', r"^fuel = 'steam' is not one of diesel, petrol"),
    ('fuel', ['petrol'], r'^fuel = .* is not one of'),
    ('turbo', 1, r'^turbo = 1 must be true or false'),
    ('label', 3, r'^label = 3 must be text'),
])
def test_bad_values_are_named_with_unit_and_range(name, value, message):
    with pytest.raises(schema.ParameterError, match=message):
        Engine(**{name: value})


def test_bounds_belong_to_the_range():
    assert Engine(power=0.5).power == 0.5
    assert Engine(power=8.0).power == 8.0


def test_a_section_fills_what_it_names_and_keeps_the_rest():
    car = schema.build(Car, {'doors': 3, 'engine': {'power': 3, 'bore': [0.3, 0.4]}})
    assert car == Car(engine=Engine(power=3.0, bore=(0.3, 0.4)), doors=3)
    assert isinstance(car.engine.power, float)


def test_dotted_names_mean_the_same_as_sections():
    dotted = schema.build(Car, {'engine.power': 3.0, 'engine': {'turbo': True}})
    assert dotted == schema.build(Car, {'engine': {'turbo': True}, 'engine.power': 3.0})
    assert dotted == Car(engine=Engine(power=3.0, turbo=True))


@pytest.mark.parametrize(('values', 'message'), [
    ({'wheels': 4}, r'file.yaml: wheels: unknown parameter; known: doors, engine'),
    ({'engine': {'powr': 1.0}}, r'engine.powr: unknown parameter; did you mean power.*\?$'),
    ({'engine': {'xyz': 1.0}}, r'file.yaml: engine.xyz: unknown parameter; known: bore, cyl'),
    ({'engine': {'power': 99.0}}, r'file.yaml: engine.power = 99.0 kW is outside'),
    ({'engine': 3}, r'file.yaml: engine = 3 must be a section'),
    ({'engine': 3, 'engine.power': 1.0}, r'file.yaml: engine = 3 must be a section'),
    ({'doors': '5'}, r"file.yaml: doors = '5' must be a whole number"),
    ({'doors': True}, r'file.yaml: doors = True must be a whole number'),
])
def test_errors_say_where_the_value_came_from(values, message):
    with pytest.raises(schema.ParameterError, match=message):
        schema.build(Car, values, 'file.yaml: ')


def test_many_known_names_are_listed_by_their_groups():
    many = ['speed', *(f'{group}.x{k}' for group in ('imu', 'wind') for k in range(20))]
    assert schema.unknown('QQ', many) == 'QQ: unknown parameter; known: imu.*, speed, wind.*'
    # alike by its middle alone: neither its node nor what it sets
    assert schema.unknown('natnet_server_node.data_port', ['controller_node.dat_prt.k_p']) == (
        'natnet_server_node.data_port: unknown parameter; known: controller_node.dat_prt.k_p')
    for name in ('controler_node.cascaded.k_q', 'cascaded.k_p', 'control.cascaded.k_p'):
        assert schema.unknown(name, ['controller_node.cascaded.k_p']).endswith(
            'did you mean controller_node.cascaded.k_p?')
    assert schema.unknown('QQ', many[:3]).endswith('known: imu.x0, imu.x1, speed')


def test_flattened_parameters_build_the_same_component():
    car = Car(engine=Engine(fuel='diesel', bore=(0.5, 0.6)), doors=2)
    flat = schema.flatten(car)
    assert flat['engine.fuel'] == 'diesel'
    assert schema.build(Car, flat) == car
    assert [name for name, _ in schema.walk(Car)] == list(flat)
