"""No page of another site can watch or command: not by its origin, nor by a name of its own."""

import socket
import threading
import urllib.error
import urllib.request

from free_port import free_port
from mambo_model.errors import JobError
from mambo_view import page, same_origin
import pytest
import viser
from websockets.asyncio import server
from websockets.datastructures import Headers

HERE = '127.0.0.1:8080'


@pytest.fixture(scope='module')
def port():
    one = page.Page(['/mambo'], free_port(), 10, True)
    yield one.server.get_port()
    one.close()


def request(*pairs):
    headers = Headers()
    for name, value in pairs:
        headers[name] = value  # a second one is added
    return headers


@pytest.mark.parametrize('host', [HERE, 'localhost:8080', 'LocalHost:9000', '127.0.0.1'])
def test_a_page_of_this_machine_may_get_and_connect(host):
    assert not same_origin.refusal(request(('Host', host)))
    own = ('Origin', f'http://{host.lower()}')
    assert not same_origin.refusal(request(('Host', host), own))
    assert not same_origin.refusal(request(('Host', host), own, ('Upgrade', 'websocket')))


@pytest.mark.parametrize('host', [
    'evil.example:8080', 'evil.example', '127.0.0.1.evil.example:8080', 'localhost.:8080', '',
    'evil@127.0.0.1:8080', '127.0.0.1:8080@evil', '127.0.0.1:80a', '192.168.0.7:8080',
    '[::1]:8080', '127.0.0.1:8080:1', '127.0.0.1:\xb2'])
def test_another_name_of_this_machine_is_refused_to_get_and_to_connect(host):
    assert same_origin.refusal(request(('Host', host)))
    assert same_origin.refusal(request(
        ('Host', host), ('Origin', f'http://{host}'), ('Upgrade', 'websocket')))


@pytest.mark.parametrize('origins', [
    [], ['null'], [''], ['http://evil.example'], ['http://localhost:8080'], ['http://127.0.0.1'],
    ['http://127.0.0.1:3000'], ['https://127.0.0.1:8080'], ['file://'],
    ['http://127.0.0.1:8080.evil.example'], ['http://127.0.0.1:8080', 'http://evil.example']])
def test_another_origin_or_none_cannot_connect(origins):
    asked = request(('Host', HERE), ('Upgrade', 'websocket'), *(
        ('Origin', one) for one in origins))
    assert 'alone may connect' in same_origin.refusal(asked)
    if origins:  # nor read the page from a script
        assert same_origin.refusal(request(('Host', HERE), *(('Origin', o) for o in origins)))


def test_no_host_and_two_hosts_are_refused():
    assert same_origin.refusal(request())
    assert same_origin.refusal(request(('Host', HERE), ('Host', 'evil.example')))


def hello(port, host, *more):
    """Return the first line of the answer to a websocket, as a browser asks for one."""
    lines = [f'GET / HTTP/1.1\r\nHost: {host}', 'Upgrade: websocket', 'Connection: Upgrade',
             'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==', 'Sec-WebSocket-Version: 13',
             f'Sec-WebSocket-Protocol: viser-v{viser.__version__}', *more, '', '']
    with socket.create_connection(('127.0.0.1', port), 20) as end:
        end.sendall('\r\n'.join(lines).encode())
        return end.recv(4096).split(b'\r\n')[0].decode()


def test_the_server_refuses_websockets_of_other_pages(port):
    own = f'127.0.0.1:{port}'
    assert '101' in hello(port, own, f'Origin: http://{own}')
    for host, *more in ((own,), (own, 'Origin: null'), (own, 'Origin: http://evil.example'),
                        (f'evil.example:{port}', f'Origin: http://evil.example:{port}'),
                        (own, 'Origin: http://evil.example', 'Upgrade: WebSocket'),
                        (own, f'Origin: http://{own}', 'Origin: http://evil.example')):
        assert '403' in hello(port, host, *more), (host, more)


def test_the_server_refuses_pages_under_another_name_and_forbids_frames(port):
    def get(host):
        asked = urllib.request.Request(f'http://127.0.0.1:{port}', headers={'Host': host})
        with urllib.request.urlopen(asked, timeout=20) as answer:
            return answer
    answer = get(f'localhost:{port}')
    assert answer.headers['X-Frame-Options'] == 'DENY'
    assert answer.headers['Content-Security-Policy'] == "frame-ancestors 'none'"
    with pytest.raises(urllib.error.HTTPError, match='403'):
        get(f'evil.example:{port}')


def test_a_server_that_starts_another_way_is_an_error_and_nothing_stays_replaced():
    before = server.serve
    with pytest.raises(JobError, match='in another way'), same_origin.enforced():
        assert server.serve is not before
    assert server.serve is before
    with pytest.raises(ZeroDivisionError), same_origin.enforced():
        raise ZeroDivisionError
    assert server.serve is before


def test_a_page_that_cannot_be_checked_is_not_served(monkeypatch):
    monkeypatch.setattr(page, 'check', lambda port: None)
    stopped = threading.Event()

    class Other:
        """A viser that makes its server in another way."""

        def __init__(self, **_):
            pass

        def stop(self):
            stopped.set()
    monkeypatch.setattr(viser, 'ViserServer', Other)
    with pytest.raises(JobError, match='in another way'):
        page.Page(['/mambo'], free_port())
    assert stopped.is_set()
