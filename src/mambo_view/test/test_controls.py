"""Buttons are on where the flight takes the command, and a click becomes one order."""

import math

from free_port import free_port
from mambo_view.controls import ALL, Controls, FLIGHT, TIME
import msgspec
import pytest
import viser

ONE, TWO = '/mambo1', '/mambo2'
EVERY = (*FLIGHT, *TIME, 'set')


@pytest.fixture(scope='module')
def gui():
    server = viser.ViserServer('127.0.0.1', free_port(), verbose=False)
    yield server.gui
    server.stop()


@pytest.fixture
def one(gui):
    return Controls(gui, [ONE])


@pytest.fixture
def both(gui):
    made = Controls(gui, [ONE, TWO])
    made.offer({ONE: EVERY, TWO: EVERY}, ['a.csv'])
    return made


def on(controls):
    return {name for name, button in controls._buttons.items() if not button.disabled}


def press(controls, name):
    """Press a button as viser does."""
    for callback in controls._buttons[name]._impl.update_cb:
        callback(None)


def test_every_button_is_off_until_a_flight_is_found(one):
    assert set(one._buttons) == set(EVERY) and not on(one)
    assert 'no flight of /mambo1 is found' in one._reason.content
    press(one, 'takeoff')
    assert not one.take() and 'takeoff: no flight' in one._log.content


def test_a_flight_without_commands_can_be_paused_alone(one):
    one.offer({ONE: (*TIME, 'set')})
    assert on(one) == {*TIME, 'set'}
    assert 'takes no commands: start it with ./run --commanded' in one._reason.content
    press(one, 'land')
    assert not one.take()


def test_a_real_drone_takes_commands_and_no_pause(one):
    one.offer({ONE: (*FLIGHT, 'set')}, ['a.csv'])
    assert on(one) == {*FLIGHT, 'set'} and 'takes commands' in one._reason.content
    press(one, 'pause')
    assert not one.take() and 'is not simulated here' in one._log.content


def test_without_a_file_there_is_nothing_to_follow(one):
    one.offer({ONE: EVERY})
    assert on(one) == {*EVERY} - {'follow'}
    one.offer({ONE: EVERY}, ['a.csv', 'b.csv'])
    assert on(one) == {*EVERY} and one._file.options == ('a.csv', 'b.csv')


def test_a_flight_that_has_ended_takes_the_buttons_with_it(one):
    one.offer({ONE: EVERY}, ['a.csv'])
    one.offer({ONE: ()}, ['a.csv'])
    assert not on(one)


def test_a_click_is_an_order_with_what_is_typed(one):
    one.offer({ONE: EVERY}, ['a.csv'])
    for name in EVERY:
        press(one, name)
    orders = {order.name: order for order in one.take()}
    assert set(orders) == set(EVERY) and not one.take()
    assert {order.drones for order in orders.values()} == {(ONE,)}
    assert orders['takeoff'].arguments == {'height': 1.0}
    assert orders['go_to'].arguments == {
        'goal': (0.0, 0.0, 1.0), 'yaw': 0.0, 'relative': False}
    assert orders['follow'].arguments == {'trajectory': 'a.csv', 'relative': True}
    assert orders['step'].arguments == {'steps': 1}
    assert '=' in orders['set'].arguments['parameters']
    assert not any(orders[name].arguments for name in ('stop', 'land', 'pause', 'resume'))


def test_the_yaw_is_typed_in_degrees(one):
    one.offer({ONE: EVERY})
    one._yaw.value = 90.0
    press(one, 'go_to')
    assert one.take()[0].arguments['yaw'] == math.pi / 2


def test_steps_of_any_size_can_be_sent_on_to_the_other_pages(one):
    one.offer({ONE: EVERY})
    for typed, steps in ((1.0, 1), (7.0, 7), (1.5, -1), (math.inf, -1), (math.nan, -1),
                         (1e30, int(1e30))):
        one._steps.value = type(one._steps.value)(typed)  # as viser does with what it receives
        msgspec.msgpack.encode(one._steps.value)
        press(one, 'step')
        assert one.take()[0].arguments == {'steps': steps}


def test_orders_are_for_the_chosen_drone_or_all(both):
    press(both, 'stop')
    both._drone.value = TWO
    press(both, 'stop')
    assert [order.drones for order in both.take()] == [(ONE, TWO), (TWO,)]


def test_all_of_them_must_take_the_command(both):
    both.offer({ONE: EVERY, TWO: TIME}, ['a.csv'])
    assert both._drone.value == ALL and on(both) == {*TIME}
    assert f'{TWO} takes no commands' in both._reason.content
    both._drone.value = ONE  # viser calls back in a thread of its own
    both._renew()
    assert on(both) == {*EVERY}


def test_clicks_that_nobody_takes_are_bounded(one):
    one.offer({ONE: EVERY})
    for _ in range(100):
        press(one, 'stop')
    assert len(one.take()) == 20 and 'too many clicks' in one._log.content


def test_answers_are_no_markup_and_the_newest_is_first(one):
    for number in range(20):
        one.answer(f'<b>{number}</b>' + 'x' * 999, bool(number % 2))
    assert '<b>' not in one._log.content and len(one._log.content) < 4000
    assert one._log.content.index('&lt;b&gt;19') < one._log.content.index('&lt;b&gt;18')
    assert '&lt;b&gt;2&lt;' not in one._log.content
