"""What a command holds, what is refused before anything is sent, and what an answer says."""

from types import SimpleNamespace

from mambo_model.errors import InputError, JobError
from mambo_ros.commands import command_request, table
import pytest

COMMANDS = command_request.COMMANDS


def test_every_service_has_its_command():
    served = {one for one in vars(table).values() if isinstance(one, table.Service)}
    assert {kind.service for kind in COMMANDS.values()} == served


def test_arguments_become_the_fields_of_the_request():
    made = COMMANDS['go_to'].request((1, -2, 3), yaw=0.5, relative=True, duration=2.25)
    assert (made.goal.x, made.goal.y, made.goal.z, made.yaw) == (1.0, -2.0, 3.0, 0.5)
    assert made.relative and (made.duration.sec, made.duration.nanosec) == (2, 250_000_000)
    assert COMMANDS['takeoff'].request(height=1).height == 1.0
    assert COMMANDS['land'].request().duration.sec == 0
    made = COMMANDS['follow'].request('text', timescale=2)
    assert (made.trajectory, made.timescale, made.relative) == ('text', 2.0, False)
    assert COMMANDS['pause'].request().data and not COMMANDS['resume'].request().data
    assert COMMANDS['step'].request(5).steps == 5


def test_parameters_are_set_at_the_service_of_their_node():
    service, request = command_request.prepare(
        'set', {'parameters': {'sim_node.speed': 2.0, 'sim_node.wind': (1, 2)}})
    assert service == command_request.parameters_of('sim_node')
    assert service.name == 'sim_node/set_parameters_atomically'
    assert [one.name for one in request.parameters] == ['speed', 'wind']
    assert list(request.parameters[1].value.double_array_value) == [1.0, 2.0]


@pytest.mark.parametrize(('name', 'success', 'message', 'words'), [
    ('land', True, 'from t = 1.000 s', ''), ('land', False, 'on the floor', 'on the floor'),
    ('land', False, '', 'refused without a reason')])
def test_a_refusal_is_an_error_with_its_reason(name, success, message, words):
    plain = SimpleNamespace(success=success, message=message)
    of_set = SimpleNamespace(result=SimpleNamespace(successful=success, reason=message))
    for kind, response in ((name, plain), ('set', of_set)):
        if success:
            assert command_request.answer(kind, response) == message
        else:
            with pytest.raises(JobError, match=words):
                command_request.answer(kind, response)


def test_a_setting_is_read_as_yaml():
    assert command_request.setting(' a.b = [1, 2]') == ('a.b', [1, 2])
    assert command_request.setting('a.b=1e-3') == ('a.b', 0.001)
    for wrong in ('a.b', '=1', 'a.b=[1', 'a.b=!!python/object:x'):
        with pytest.raises(InputError, match='a.b|=1') as error:
            command_request.setting(wrong)
        assert '\n' not in str(error.value)
