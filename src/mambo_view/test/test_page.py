"""The page is served on this machine alone and shows what it is given; texts stay texts."""

import socket
import sys
import urllib.request

from free_port import free_port
from mambo_model.errors import InputError
from mambo_view import page
from mambo_view.drone_state import DroneState, ESTIMATE, Pose, ROLES, SIGNALS, TRUTH
import pytest
import viser

HERE = Pose((0.5, -1.0, 1.5), (0.6, 0.0, 0.8, 0.0))


@pytest.fixture
def shown(capfd):
    one = page.Page(['/mambo1', '/mambo2'], free_port(), 100)
    assert capfd.readouterr().out == ''
    yield one
    one.close()


def test_it_is_served_on_the_loopback_interface_alone(shown):
    with urllib.request.urlopen(shown.address, timeout=20) as answer:
        assert b'<html' in answer.read().lower()
    port = shown.server.get_port()
    assert shown.address == page.address(port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(('192.0.2.1', 9))  # sends nothing: which address would be used
            outer = probe.getsockname()[0]
        except OSError:
            outer = '127.0.0.2'
    with pytest.raises(OSError), socket.create_connection((outer, port), 5):
        pass


def test_drones_are_where_their_poses_are_and_hidden_without(shown):
    shown.show([DroneState(1.0, {TRUTH: HERE}), DroneState()])
    frames = [drone._frames for drone in shown._drones]
    assert frames[0][TRUTH].visible and not frames[0][ESTIMATE].visible
    assert tuple(frames[0][TRUTH].position) == HERE.position
    assert tuple(frames[0][TRUTH].wxyz) == HERE.attitude
    assert not any(frame.visible for frame in frames[1].values())
    shown._roles[TRUTH].value = False
    shown.show([DroneState(1.0, {TRUTH: HERE}), DroneState()])
    assert not frames[0][TRUTH].visible


def test_paths_and_curves_are_drawn_from_the_histories(shown):
    for t in range(3):
        shown.histories[0].add(DroneState(float(t), {TRUTH: Pose((t, 0.0, 1.0), HERE.attitude)}))
    shown.draw()
    assert shown._drones[0]._paths[TRUTH].visible
    assert shown._drones[0]._paths[TRUTH].points.shape == (2, 2, 3)
    assert not shown._drones[1]._paths[TRUTH].visible
    before = shown._plot
    assert before.data[0].tolist() == [0.0, 1.0, 2.0]
    assert shown.controls is None  # commands are for a running flight
    y = before.scales['y']  # the other roles are unknown, which is no limit
    assert (y['min'], y['max']) == (0.5, 1.5)
    shown._signal.value = 'x, m'
    shown.draw()
    assert shown._plot is not before and shown._plot.data[1].tolist() == [0.0, 1.0, 2.0]
    assert len(shown._plot.series) == len(SIGNALS['x, m']) + 1 == len(ROLES) + 1
    shown._chooser.value = '/mambo2'
    shown.draw()
    assert shown._plot.data[0].tolist() == [0.0, 1.0, 2.0]  # nothing yet to draw of it


def test_axes_stay_while_the_curves_fit_and_a_climb_changes_them_seldom():
    now, seen = page._scales(0.0, 0.0), []
    for height in [0.001 * k for k in range(1, 1500)]:
        now = page._scales(0.0, height, now)
        assert now['y']['min'] <= 0.0 and height <= now['y']['max']
        if not seen or now is not seen[-1]:
            seen.append(now)
    assert len(seen) < 25 and now['y']['max'] < 1.6
    assert page._scales(0.2, 1.4, now) is now
    assert page._scales(1.49, 1.5, now)['y']['min'] > 1.4  # not a line between far axes
    assert page._scales(2.0, 2.0, now)['y'] == {'auto': False, 'min': 1.5, 'max': 2.5}


def test_nothing_new_is_not_drawn_again(shown, monkeypatch):
    shown.draw()
    monkeypatch.setattr(shown._drones[0], 'draw', None)
    shown.draw()
    shown._roles[TRUTH].value = False
    with pytest.raises(TypeError):
        shown.draw()


def test_texts_of_strangers_are_no_markup(shown):
    evil = '<img src=x onerror=alert(1)>{alert(2)}' + 'x' * 500
    state = DroneState(0.0, health={evil: (9, evil), 'sim_node': (0, 'flying')})
    shown.report([state, state], '<b>t</b>')
    assert '<img' not in shown._health.content and '&lt;img' in shown._health.content
    assert 'ERROR' in shown._health.content and len(shown._health.content) < 2000
    assert '&lt;b&gt;t' in shown._status.content


def test_the_health_of_a_node_that_is_silent_is_not_shown_as_good(shown):
    state = DroneState(0.0, health={'sim_node': (0, 'flying')}, heard={'sim_node': 100.0})
    for now, said in ((104.0, 'flying'), (112.4, 'no report for 12 s'), (113.0, '13 s')):
        shown.report([state, state], 't', now)
        assert said in shown._health.content and ('OK' in shown._health.content) == (now < 105.0)


@pytest.mark.long
def test_garbage_of_a_stranger_fills_no_terminal(shown, caplog):
    port = shown.server.get_port()
    hello = (b'GET / HTTP/1.1\r\nHost: localhost\r\nOrigin: http://localhost\r\n'
             b'Upgrade: websocket\r\nConnection: Upgrade\r\n'
             b'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n'
             b'Sec-WebSocket-Protocol: viser-v%b\r\n\r\n' % viser.__version__.encode())
    text = b'\x81\x85\x00\x00\x00\x00hello'  # a frame of text, where viser expects bytes
    with socket.create_connection(('127.0.0.1', port), 20) as stranger:
        stranger.sendall(hello)
        assert b'101 Switching' in stranger.recv(4096)
        stranger.sendall(text)
        stranger.settimeout(20)
        while stranger.recv(1 << 16):  # until the server has closed it
            pass
    with urllib.request.urlopen(shown.address, timeout=20) as answer:
        assert answer.status == 200
    assert not caplog.records


def test_a_port_in_use_or_out_of_range_and_a_missing_package_are_one_line(shown, monkeypatch):
    port = shown.server.get_port()
    with pytest.raises(InputError, match=f'port {port}: .*give another'):
        page.check(port)
    for wrong in (0, 65536, -1):
        with pytest.raises(InputError, match='must be from 1 to 65535'):
            page.check(wrong)
    monkeypatch.setitem(sys.modules, 'viser', None)
    with pytest.raises(InputError, match='pip install -r requirements/view.txt'):
        page.check(free_port())
