"""What a page may send, and what never reaches the view."""

import asyncio
import logging

from free_port import free_port
from mambo_view import incoming, page
from mambo_view.controls import chosen
import msgspec
import pytest
import viser
import websockets

CAMERA = {
    'type': 'ViewerCameraMessage', 'wxyz': [1, 0, 0, 0.0], 'position': [0, 0, 1.0], 'fov': 1.0,
    'near': 0.1, 'far': 100.0, 'image_height': 100, 'image_width': 100, 'look_at': [0, 0, 0],
    'up_direction': [0, 0, 1]}


def update(value, name='value', **more):
    """Return the message of a widget that has another value."""
    return {'type': 'GuiUpdateMessage', 'uuid': 'a', 'updates': {name: value, **more}}


@pytest.mark.parametrize('message', [
    CAMERA, update(1), update(1.5), update(True), update('text'), update([0.0, 1.0, 2.0])])
def test_what_a_browser_sends_is_passed_on(message):
    assert incoming.sound(message)


@pytest.mark.parametrize('message', [
    None, [], {}, {'type': 'ShareUrlRequest'}, {'type': 'FileTransferStartUpload'},
    update(float('nan')), update(float('-inf')), update(10**400), update([0.0, float('nan')]),
    update('x' * 2001), update([0.0] * 17), update([[0.0]]), update({}), update(1, 'update_cb'),
    update(1, visible=False), {**update(1), 'uuid': []}, {**update(1), 'updates': [1]},
    {**update(1), 'more': 1}, {**CAMERA, 'fov': float('nan')}, {**CAMERA, 'wxyz': [1, 0, 0]},
    {**CAMERA, 'position': 'here'}])
def test_nothing_else_is(message):
    assert not incoming.sound(message)


@pytest.fixture
def shown():
    one = page.Page(['/mambo1', '/mambo2'], free_port(), 10, True)
    yield one
    one.close()


def send(one, *messages):
    """Send messages as a browser that has the page open; wait until they are handled."""
    async def talk():
        here = f'127.0.0.1:{one.server.get_port()}'
        async with websockets.connect(
                f'ws://{here}/', subprotocols=[f'viser-v{viser.__version__}'],
                origin=f'http://{here}', max_size=None) as end:
            for message in messages:
                await end.send(message if isinstance(message, bytes | str)
                               else msgspec.msgpack.encode(message))
            await asyncio.sleep(0.5)
    asyncio.run(asyncio.wait_for(talk(), 30.0))


def test_a_stranger_with_the_page_open_breaks_nothing(shown, capfd, caplog):
    number, text, curves, drone = (handle._impl.uuid for handle in (
        shown.controls._yaw, shown.controls._file, shown._signal, shown._chooser))

    def to(uuid, *value, name='value'):
        return {'type': 'GuiUpdateMessage', 'uuid': uuid, 'updates': {name: value[0]}}
    with caplog.at_level(logging.ERROR, 'mambo'):
        send(shown, CAMERA, to(curves, 'nope'), to(drone, '/nope'), to(text, '/etc/passwd'),
             to(number, [1.0]), to(number, 'one'), to(number, [1], name='update_cb'),
             to(number, 1, name='nope'), to(number, float('nan')), {'type': 'ShareUrlRequest'},
             {'type': 'nope'}, to(drone, '/mambo3'))
        for garbage in (b'\xff\xff', 'text', b'', {**CAMERA, 'more': 1}):
            send(shown, garbage)
    send(shown, CAMERA, to(number, 12))
    shown.draw()
    assert shown.controls._yaw.value == 12.0
    assert shown._signal.value in page.SIGNALS and shown._chosen == 0
    assert chosen(shown.controls._file) == '(no file)'
    assert capfd.readouterr() == ('', '') and not caplog.records
