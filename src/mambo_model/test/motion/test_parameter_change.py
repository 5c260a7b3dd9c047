"""Changes of a node's parameters: read, refused in one line, in the order of time."""

from dataclasses import dataclass

from mambo_model import schema
from mambo_model.motion import parameter_change as pc
from mambo_model.motion.parameter_change import Change, Changes
from mambo_model.values import values
import pytest


@dataclass(frozen=True)
class Wind:
    """Its values are none in still air: another compiled step."""

    speed: float = schema.quantity(0.0, 'm/s', 0.0, 9.0, 'design choice')

    def __post_init__(self):
        schema.check(self)

    def values(self):
        return values(self) if self.speed else None


@dataclass(frozen=True)
class Params:
    """A node whose gains can change, and whose mass cannot."""

    gain: float = schema.quantity(1.5, '1/s', 0.0, 5.0, 'equation (1)')
    bias: tuple = schema.quantity((0.0, 0.1), 'rad/s', -1.0, 1.0, 'measured')
    mass: float = schema.quantity(1.0, 'kg', 0.1, 5.0, 'weighed')
    wind: Wind = schema.group(Wind)
    changes: str = schema.text('', 'a YAML list')

    def __post_init__(self):
        schema.check(self)
        pc.check(self)

    def fixed(self, name):
        return '' if name.partition('.')[0] in ('gain', 'bias', 'wind') else pc.STARTED

    def kept(self):
        return {}

    def compiled(self):
        return values(self)


SCRIPT = """
- {time: 1, set: {gain: 2}}
- {time: 1.0, set: {gain: 2.5, bias: [1, 0.5]}}
- {time: 0.3e1, set: {gain: 0.1}}
"""


def test_a_script_is_taken_at_its_times_with_the_declared_types():
    changes = Changes(Params(changes=SCRIPT))
    assert changes.due == 1_000_000_000
    taken = changes.take(1_000_000_000)
    assert taken == {'gain': 2.5, 'bias': (1.0, 0.5)} and isinstance(taken['gain'], float)
    assert (changes.params.gain, changes.params.bias) == (2.5, (1.0, 0.5))
    assert changes.due == 3_000_000_000
    assert changes.take(4_000_000_000) == {'gain': 0.1} and changes.due == pc.NEVER


def test_text_reads_back_exactly():
    given = [Change(1_005_000_000, {'gain': 0.1 + 0.2}), Change(86_399_995_000_000, {'bias': [
        1e-9, 1 / 3]})]
    assert pc.parse(pc.to_text(given)) == given
    assert pc.to_text([]) == '' and pc.parse(' ') == []


def test_what_is_offered_comes_between_the_script():
    changes = Changes(Params(changes=SCRIPT))
    assert changes.offer({'gain': 1}, 500_000_000) == {'gain': 1.0}
    assert changes.offer({'bias': (0.0, 0.0)}, 500_000_000) == {'bias': (0.0, 0.0)}
    assert changes.due == 500_000_000
    assert changes.take(500_000_000) == {'gain': 1.0, 'bias': (0.0, 0.0)}
    assert changes.due == 1_000_000_000 and changes.params.gain == 1.0


def test_what_is_refused_has_no_effect():
    changes = Changes(Params())
    changes.offer({'gain': 2.0}, 0)
    with pytest.raises(schema.ParameterError):
        changes.offer({'gain': 3.0, 'mass': 2.0}, 0)
    assert changes.take(0) == {'gain': 2.0} and changes.params.mass == 1.0


@pytest.mark.parametrize(('change', 'words'), [
    ({'gian': 1.0}, 'gian: unknown parameter; did you mean gain'),
    ({'gain': 6.0}, r'gain = 6\.0 1/s is outside \[0, 5\]'), ({'gain': 'x'}, 'must be a number'),
    ({'gain': None}, 'must be a number'), ({'bias': [1.0]}, 'must be 2 numbers'),
    ({'mass': 2.0}, 'mass: cannot be changed in flight: it is fixed when the node starts'),
    ({'changes': ''}, 'changes: cannot be changed in flight'),
    ({'wind.speed': 2.0}, 'wind.speed: cannot be changed in flight: .*another compiled step')])
def test_a_change_is_refused_in_one_line(change, words):
    with pytest.raises(schema.ParameterError, match=words) as error:
        pc.changed(Params(), change)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('text', 'words'), [
    ('{a: 1}', 'changes: must be a list'), ('[3]', 'change 1: must hold a time'),
    ('[{time: 1}]', 'change 1: must hold a time'), ('[{time: 1, set: {}}]', 'must hold a time'),
    ('[{time: x, set: {gain: 1}}]', "time = 'x' must be a number"),
    ('[{time: -1, set: {gain: 1}}]', 'time = -1 s is outside'),
    ('[{time: .nan, set: {gain: 1}}]', 'must be a number'), ('[', 'changes: '),
    ('[{time: .inf, set: {gain: 1}}]', 'time = inf s is outside'),
    (f'[{{time: {"9" * 400}, set: {{gain: 1}}}}]', 'time = 9{60}.* s is outside'),
    ('[{time: 1, set: {gain: 2020-01-01}}]', "'gain' = datetime.date.* must be a number, true"),
    ('[{time: 1, set: {gain: !!binary aGk=}}]', 'must be a number, true'),
    ('[{time: 1, set: {bias: [1, {a: 1}]}}]', 'must be a number, true'),
    ('[{time: 2, set: {gain: 1}}, {time: 1, set: {gain: 1}}]', 'change 2: is earlier'),
    ('[{time: 2, set: {gain: 9}}]', 'changes: at t = 2 s: gain = 9')])
def test_a_wrong_script_is_refused_with_the_parameters(text, words):
    with pytest.raises(schema.ParameterError, match=words) as error:
        Params(changes=text)
    assert '\n' not in str(error.value)
