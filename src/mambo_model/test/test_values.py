"""What compiled code reads follows from the declaration of the parameters, each told once."""

from dataclasses import dataclass
import math
import pickle

from mambo_model import schema
from mambo_model.values import derived, Parameters, values, values_type
from mambo_model.vehicle.parameters import OptionValues, Vehicle, VehicleValues
import pytest


@dataclass(frozen=True)
class WingParams(Parameters):
    """A part."""

    span: float = schema.quantity(2.0, 'm', 0.1, 9.0, 'drawing')


@dataclass(frozen=True)
class KiteParams(Parameters):
    """A component with a parameter of every kind."""

    wing: WingParams = schema.group(WingParams)
    pull: float = schema.quantity(2.0, 'N', 0.5, 8.0, 'a spring balance')
    lines: int = schema.quantity(4, '1', 1, 16, 'a look')
    bore: tuple[float, float] = schema.quantity((0.1, 0.2), 'm', 0.0, 1.0, 'a ruler')
    form: str = schema.choice('delta', ('box', 'delta'), 'the maker')
    lit: bool = schema.flag(False, 'the maker')
    label: str = schema.text('', 'the owner')
    angle: float = schema.quantity(0.0, 'rad', -1.0, 1.0, 'a protractor')

    @derived('-', 'angle')
    def cosine(self) -> float:
        """Cosine of the angle."""
        return math.cos(self.angle)


KiteValues = values_type(KiteParams)


def test_fields_are_the_parameters_and_what_is_derived():
    assert KiteValues._fields == ('wing', 'pull', 'lines', 'bore', 'form', 'lit', 'cosine')
    seen = KiteParams(angle=0.5).values()
    assert isinstance(seen, KiteValues)
    assert seen == ((2.0,), 2.0, 4, (0.1, 0.2), 1, False, math.cos(0.5))


def test_numbers_have_the_type_of_their_default():
    whole = KiteParams(pull=3, bore=(0, 1), wing=WingParams(span=1)).values()
    assert [type(x) for x in (whole.pull, *whole.bore, whole.wing.span, whole.lines)] == [
        float, float, float, float, int]


def test_each_field_says_its_unit_and_source():
    docs = {name: getattr(KiteValues, name).__doc__ for name in KiteValues._fields}
    assert docs['pull'] == '[N] a spring balance'
    assert docs['form'] == 'Index in box, delta; the maker'
    assert docs['cosine'] == '[-] Cosine of the angle.'
    assert docs['lit'] == 'the maker'
    assert 'WingParams' in docs['wing'] and 'KiteParams' in KiteValues.__doc__


def test_the_type_can_be_pickled_and_stays_the_same():
    assert KiteParams.Values is KiteValues is values_type(KiteParams)
    seen = Vehicle().values()
    copy = pickle.loads(pickle.dumps(seen))
    assert copy == seen and type(copy) is type(seen) is VehicleValues
    assert OptionValues.__qualname__ == 'Vehicle.Options'


def test_one_declaration_has_several_readers():
    assert not set(VehicleValues._fields) & set(OptionValues._fields)
    assert set(VehicleValues._fields) | set(OptionValues._fields) == {
        name.partition('.')[0] for name, _ in schema.walk(Vehicle)}


def test_a_field_may_be_given():
    assert values(KiteParams(), cosine=7.0).cosine == 7.0


def test_a_subclass_is_read_as_its_base_unless_it_has_a_type_of_its_own():
    @dataclass(frozen=True)
    class Other(WingParams):
        """Narrower."""

        span: float = schema.quantity(1.0, 'm', 0.1, 2.0, 'drawing')

    values_type(WingParams)
    assert type(Other().values()) is WingParams.Values
    with pytest.raises(schema.ParameterError, match='span'):
        Other(span=5.0)


def test_plain_dataclasses_are_read_too():
    @dataclass(frozen=True)
    class Plain:
        """Without the base."""

        gain: float = schema.quantity(1, '1', 0.0, 2.0, 'taste')

    assert values(Plain()) == (1,)
