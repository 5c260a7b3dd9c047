"""A click is sent once to each drone; its answer is shown; nothing waits for another."""

import math
import threading

from mambo_model.errors import InputError, JobError
from mambo_view import dispatcher
from mambo_view.controls import FLIGHT, Order, TIME
import pytest

ONE, TWO = '/mambo1', '/mambo2'


class Controls:
    """Holds clicks and answers as the page would."""

    def __init__(self):
        self.orders, self.answers, self.offered = [], [], None

    def take(self):
        out, self.orders = self.orders, []
        return out

    def answer(self, text, good):
        self.answers.append((text, good))

    def offer(self, commands, files):
        self.offered = commands, files


class Call:
    """A command on its way whose answer the test gives."""

    def __init__(self, name, drone, arguments):
        self.name, self.drone, self.arguments = name, drone, arguments
        self.sent, self.reply, self.closed = False, None, False

    def poll(self, now):
        if isinstance(self.reply, Exception):
            raise self.reply
        return self.reply

    def close(self):
        self.closed = True


class Stand:
    """A dispatcher between a page and flights of the test."""

    def __init__(self, folder, read=lambda path: f'text of {path.name}', drones=(ONE, TWO)):
        self.controls, self.calls = Controls(), []
        (folder / 'a.csv').write_text('t,x\n')
        self.file = str(folder / 'a.csv')
        self.it = dispatcher.Dispatcher(
            self.controls, drones, self.call, read, self.setting, [folder])
        self.it.offer(lambda drone, service: True)

    def call(self, name, drone, **arguments):
        if arguments.get('height') == -1.0:
            raise InputError('takeoff: height')
        self.calls.append(Call(name, drone, arguments))
        return self.calls[-1]

    @staticmethod
    def setting(text):
        name, equals, value = text.partition('=')
        if not equals:
            raise InputError(f'{text}: write NODE.PARAMETER=VALUE')
        return name, float(value)

    def click(self, name, *drones, **arguments):
        self.controls.orders.append(Order(name, drones or (ONE,), arguments))
        self.it.step(0.0)

    def until_sent(self, count):
        while len(self.calls) < count:  # a thread reads
            self.it.step(0.0)


@pytest.fixture
def stand(tmp_path):
    return Stand(tmp_path)


def test_each_chosen_drone_gets_the_command_and_its_answer_is_shown(stand):
    stand.click('takeoff', ONE, TWO, height=1.2)
    assert [(c.name, c.drone, c.arguments) for c in stand.calls] == [
        ('takeoff', ONE, {'height': 1.2}), ('takeoff', TWO, {'height': 1.2})]
    stand.it.step(0.1)
    assert not stand.controls.answers
    stand.calls[1].reply = 'from t = 2.000 s'
    stand.it.step(0.2)
    assert stand.controls.answers == [(f'{TWO} take off to 1.2 m: from t = 2.000 s', True)]
    stand.calls[0].reply = JobError('already in the air')
    stand.it.step(0.3)
    assert stand.controls.answers[1] == (f'{ONE} take off to 1.2 m: already in the air', False)
    assert all(call.closed for call in stand.calls) and not stand.it._pending


def test_a_single_drone_needs_no_name_and_goals_are_shown(tmp_path):
    stand = Stand(tmp_path, drones=(ONE,))
    for arguments in ({'relative': True, 'yaw': 0.0}, {'relative': False, 'yaw': math.pi / 2}):
        stand.click('go_to', goal=(1.0, -0.5, 1.25), **arguments)
        stand.calls[-1].reply = 'from t = 1.000 s'
        stand.it.step(0.1)
    assert [text for text, _ in stand.controls.answers] == [
        'go to 1, -0.5, 1.25 m from where it is: from t = 1.000 s',
        'go to 1, -0.5, 1.25 m, yaw 90 degrees: from t = 1.000 s']


def test_one_that_does_not_answer_holds_up_no_other(stand):
    stand.click('go_to', ONE, goal=(0, 0, 1), yaw=0.0, relative=False)
    stand.calls[0].sent = True
    stand.click('stop', ONE)
    stand.calls[1].reply = 'from t = 3.000 s'
    stand.it.step(0.1)
    assert stand.controls.answers == [(f'{ONE} stop: from t = 3.000 s', True)]
    assert len(stand.it._pending) == 1


def test_what_was_not_sent_before_a_stop_is_never_sent(tmp_path):
    go = threading.Event()
    stand = Stand(tmp_path, lambda path: go.wait(60) and 'text')
    stand.click('follow', ONE, TWO, trajectory=stand.file, relative=True)
    stand.click('stop', ONE)
    assert stand.controls.answers == [
        (f'{ONE} follow {stand.file}: not sent: stop came after it', False)]
    go.set()
    stand.until_sent(2)
    stand.it.step(0.1)
    assert {(c.name, c.drone) for c in stand.calls} == {('stop', ONE), ('follow', TWO)}


def test_a_pause_does_not_take_the_place_of_a_command(stand):
    stand.click('land', ONE)
    stand.click('pause', ONE)
    assert [call.name for call in stand.calls] == ['land', 'pause'] and not stand.controls.answers


def test_a_step_of_a_hall_is_made_once(stand):
    stand.click('step', ONE, TWO, steps=5)
    assert [(call.drone, call.arguments) for call in stand.calls] == [(ONE, {'steps': 5})]


def test_a_file_is_read_beside_the_view_and_only_one_that_is_offered(stand):
    stand.click('follow', trajectory=stand.file, relative=False)
    stand.until_sent(1)
    assert stand.calls[0].arguments == {'trajectory': 'text of a.csv', 'relative': False}
    for other in ('/etc/passwd', '../a.csv', 'a.csv'):
        stand.click('follow', trajectory=other, relative=False)
        assert stand.controls.answers[-1] == (
            f'follow {other}: {other}: choose one of the files', False)
    assert len(stand.calls) == 1


@pytest.mark.parametrize('error', [InputError('row 3: x'), RuntimeError('boom')])
def test_a_file_that_cannot_be_read_is_an_answer(tmp_path, error):
    def read(path):
        raise error
    stand = Stand(tmp_path, read)
    stand.click('follow', trajectory=stand.file, relative=False)
    while not stand.controls.answers:
        stand.it.step(0.0)
    (text, good), = stand.controls.answers
    assert str(error) in text and not good and not stand.calls and not stand.it._pending


def test_a_file_that_takes_too_long_is_given_up_and_a_second_does_not_wait_for_it(tmp_path):
    go = threading.Event()
    stand = Stand(tmp_path, lambda path: go.wait(60) and 'text')
    stand.click('follow', trajectory=stand.file, relative=False)
    stand.click('follow', TWO, trajectory=stand.file, relative=False)
    assert 'another file is being read' in stand.controls.answers[0][0]
    stand.it.step(1e12)
    assert 'not read within 20 s' in stand.controls.answers[1][0]
    go.set()
    assert not stand.calls and not stand.it._pending


def test_parameters_are_set_as_they_are_typed(stand):
    stand.click('set', ONE, TWO, parameters='a.b=1 a.c=2')
    assert [call.arguments for call in stand.calls] == [
        {'parameters': {'a.b': 1.0, 'a.c': 2.0}}] * 2
    for wrong in ('a.b', 'a.b=x', 'a.b=1 a.c=2 a.b=3'):
        stand.click('set', parameters=wrong)
        assert not stand.controls.answers[-1][1]
    assert len(stand.calls) == 2


def test_what_cannot_be_sent_is_an_answer(stand):
    stand.click('takeoff', height=-1.0)
    assert stand.controls.answers == [(f'{ONE} take off to -1 m: takeoff: height', False)]


def test_the_commands_on_their_way_are_bounded(stand):
    for _ in range(100):
        stand.click('pause')
    assert len(stand.calls) == 64
    assert stand.controls.answers == [
        ('pause: too many commands wait for their answers', False)] * 36


def test_what_is_offered_is_what_the_services_of_each_drone_are(stand):
    there = {(ONE, 'takeoff'), (ONE, 'pause'), (TWO, 'pause')}
    stand.it.offer(lambda *service: service in there)
    commands, files = stand.controls.offered
    assert commands == {ONE: (*FLIGHT, *TIME, 'set'), TWO: (*TIME, 'set')}
    assert files == [stand.file]


def test_trajectories_are_the_files_that_may_be_one(tmp_path):
    for name, text in {'b.csv': '', 'A.CSV': '', 'gate.yaml': '# x\nwaypoints:\n',
                       'car.yaml': 'mass: 1\n', '.c.csv': '', 'notes.txt': 'waypoints:\n',
                       'bytes.yml': '\xff'}.items():
        (tmp_path / name).write_text(text, encoding='latin-1')
    (tmp_path / 'folder.csv').mkdir()
    found = dispatcher.trajectories([tmp_path / 'none', tmp_path])
    assert found == [str(tmp_path / name) for name in ('A.CSV', 'b.csv', 'gate.yaml')]
    for number in range(200):
        (tmp_path / f'{number}.csv').touch()
    assert len(dispatcher.trajectories([tmp_path])) == 100
