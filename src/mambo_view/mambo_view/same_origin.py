"""
Only pages that this server has sent may talk to it.

Every page of every site that is open in a browser of this machine may open a websocket to
127.0.0.1, and may get there under a name of its own (DNS rebinding). The browser says truthfully
in ``Origin`` which page asks, and in ``Host`` under which name. A request is served if its host is
this machine, and its origin, which every websocket of a browser has, that same host. No other page
may show this one in a frame, where it could trick somebody into a click.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
import threading
from typing import Any

from mambo_model.errors import JobError

from . import incoming

NAMES = ('127.0.0.1', 'localhost')
"""Hosts of the page; any port, because a tunnel, such as one of ``ssh -L``, may have another."""
NO_FRAME = {'X-Frame-Options': 'DENY', 'Content-Security-Policy': "frame-ancestors 'none'"}
_patching = threading.Lock()


def refusal(headers: Any) -> str:
    """
    Return why a request is refused; empty if it is not.

    Parameters
    ----------
    headers : websockets.datastructures.Headers
        Of the request, with ``get_all``.

    """
    hosts, origins = headers.get_all('Host'), headers.get_all('Origin')
    name, _, port = hosts[0].lower().partition(':') if len(hosts) == 1 else ('', '', '')
    if name not in NAMES or not (port.isascii() and (port.isdigit() or not port)):
        return f'open this page as http://{NAMES[0]} with its port'
    own = f'http://{hosts[0].lower()}'
    if (origins or headers.get_all('Upgrade')) and [one.lower() for one in origins] != [own]:
        return f'pages of {own} alone may connect'
    return ''


def _checked(process: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a ``process_request`` of websockets that refuses what is not of the same origin."""
    def check(connection: Any, request: Any) -> Any:
        """Refuse a request, or return the response to it; None: it goes on as a websocket."""
        if reason := refusal(request.headers):
            return connection.respond(HTTPStatus.FORBIDDEN, f'{reason}\n')
        response = process(connection, request)
        if response is not None:
            response.headers.update(NO_FRAME)
        return response
    return check


@contextmanager
def enforced() -> Iterator[None]:
    """
    Let servers of viser that start in this context serve their own pages alone.

    Of what these send, :mod:`mambo_view.incoming` passes on what they may.

    viser 1.1 has no option for this, and keeps to itself the server that it makes. It makes it by
    ``websockets.asyncio.server.serve``, whose public argument ``process_request`` sees every
    request, page or websocket, before anything is answered. That function is replaced while the
    server starts; nothing of viser's own is changed.

    Raises
    ------
    mambo_model.errors.JobError
        At the end, if no server was started through that function: then nothing is checked.

    """
    from websockets.asyncio import server
    seen = []

    def serve(handler: Callable[[Any], Any], *args: Any,
              process_request: Callable[[Any, Any], Any], **options: Any) -> Any:
        """Start a server that checks every request and every message."""
        async def handle(connection: Any) -> None:
            """Handle a websocket whose messages are checked."""
            connection.recv = incoming.screened(connection.recv)
            await handler(connection)
        seen.append(process_request)
        return original(handle, *args, process_request=_checked(process_request),
                        **{**options, 'max_size': incoming.LARGEST})
    with _patching:
        original, server.serve = server.serve, serve
        try:
            yield
        finally:
            server.serve = original
    if not seen:
        raise JobError('this version of viser starts its server in another way, by which any web '
                       'page could connect: pip install -r requirements/view.txt')
