"""Commands as text: read back exactly, refused with the place of what is wrong."""

import random

from mambo_control.commanded import script
from mambo_control.commanded.command_params import CommandParams
from mambo_model.motion import flight_command as fc
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
import pytest

TEXT = """
- {time: 2.0, takeoff: {height: 1.0}}
- {time: 6.0, go_to: {goal: [1.0, 0.5, 1.2], yaw: 0.5, duration: 4}}
- {time: 12.0, stop: null}
- {time: 14.0, land: {}}
"""


def test_axes_are_z_up_and_times_become_steps():
    takeoff, go, stop, land = script.parse(TEXT)
    assert (takeoff.t, takeoff.kind, takeoff.height) == (2 * 10**9, fc.TAKEOFF, 1.0)
    assert go.position == (1.0, -0.5, -1.2) and (go.yaw, go.duration) == (-0.5, 4.0)
    assert (stop.kind, land.kind) == (fc.STOP, fc.LAND)
    assert script.parse('- {time: 0.0051, stop: {}}')[0].t == 10_000_000
    assert script.parse('') == []


def test_commands_of_every_kind_read_back_exactly():
    draw = random.Random(1)

    def number():
        return draw.uniform(-3.0, 3.0) * 10.0 ** draw.randint(-9, 3)

    def vector():
        return number(), number(), number()
    made = [
        fc.FlightCommand(0, fc.TAKEOFF, height=number()),
        fc.FlightCommand(5_000_000, fc.LAND, duration=number(), height=number()),
        fc.FlightCommand(35_000_000, fc.GO_TO, True, number(), position=vector(), yaw=number()),
        fc.FlightCommand(10**9 // 3 // 5_000_000 * 5_000_000, fc.FOLLOW, timescale=number(),
                         trajectory='duration,"x"\n1 # ü: {}\n'),
        fc.FlightCommand(10**9, fc.STOP),
        fc.FlightCommand(10**9, fc.VELOCITY, duration=number(), velocity=vector(),
                         yaw_rate=number()),
        fc.FlightCommand(86_399_995_000_000, fc.SETPOINT, False, 0.0, 0.0, *(
            vector() for _ in range(5)), number(), number())]
    assert script.parse(script.to_text(made)) == made


@pytest.mark.parametrize(('text', 'words'), [
    ('- {time: 1, fly: {}}', 'command 1: fly: unknown command'),
    ('- {time: 1, takeof: {}}', 'did you mean takeoff'),
    ('- {time: 1}', 'must hold a time and one command'),
    ('- {takeoff: {height: 1}, land: {}}', 'must hold a time'),
    ('- {time: 1, takeoff: {}}', 'takeoff needs height'),
    ('- {time: 1, takeoff: {heigth: 1, height: 1}}', 'did you mean height'),
    ('- {time: 1, takeoff: {height: .nan}}', 'height = nan must be finite'),
    (f'- {{time: 1, takeoff: {{height: {10**400}}}}}', 'must be finite'),
    ('- {time: 1, takeoff: {height: yes}}', 'must be a number'),
    ('- {time: -1, land: {}}', 'time = -1 s is outside'),
    ('- {time: 1, go_to: {goal: [1, 2]}}', 'must be 3 numbers'),
    ('- {time: 1, go_to: {goal: [1, 2, x]}}', 'must be a number'),
    ('- {time: 1, go_to: {goal: [1, 2, 3], relative: 1}}', 'must be true or false'),
    ('- {time: 1, follow: {trajectory: 3}}', 'must be the text of a course'),
    ('- {time: 1, land: [1]}', 'must hold names and values'),
    ('- {time: 2, land: {}}\n- {time: 1, land: {}}', 'command 2: is earlier'),
    ('takeoff', 'must be a list'), ('- [', 'script: line'), ('- 3', 'command 1')])
def test_what_is_wrong_is_named_with_its_place(text, words):
    with pytest.raises(ParameterError) as error:
        script.parse(text)
    assert words in str(error.value) and '\n' not in str(error.value)


def test_a_script_is_checked_whole():
    assert script.flown(CommandParams(script=TEXT), Vehicle()).until > 14.0
    with pytest.raises(ParameterError, match='go_to at t = 6 s: the path leaves the volume'):
        script.flown(CommandParams(script=TEXT, x_limit=0.5), Vehicle())
