"""The server of the page: 127.0.0.1 only, for one user, until it is ended."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from socketserver import ThreadingMixIn
from threading import Event, Thread
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from imocap_core.errors import WorkFailed
from imocap_core.pick.guard import guarded
from imocap_core.pick.routes import routes
from imocap_core.pick.session import Session

HOST = "127.0.0.1"
TOKEN_BYTES = 24
PATIENCE_S = 30.0  # with a client that sends nothing


class _Handler(WSGIRequestHandler):
    timeout = PATIENCE_S

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged."""

    def address_string(self) -> str:
        """Without asking for the name of an address."""
        return str(self.client_address[0])


class _Server(ThreadingMixIn, WSGIServer):
    daemon_threads = True

    def server_bind(self) -> None:
        """Without asking for the name of this machine."""
        self.allow_reuse_address = True
        super(WSGIServer, self).server_bind()
        self.setup_environ()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that broke off is none of the user's business."""


@dataclass(frozen=True)
class Served:
    """A page that is being served: its address, whether its user is done, remarks for them."""

    address: str
    done: Event
    remarks: list[str]


@contextmanager
def serving(
    session: Session, port: int, fault: Callable[[str], None], remarks: list[str]
) -> Iterator[Served]:
    """Serve the page of a session while the body runs.

    port: 0 for any that is free. fault: called with a sentence about a fault of the program.
    WorkFailed when the port is taken.
    """
    token, done = secrets.token_urlsafe(TOKEN_BYTES), Event()
    try:
        server = _Server((HOST, port), _Handler)
    except (OSError, OverflowError) as error:
        session.close()
        raise WorkFailed(f"cannot listen on {HOST}:{port}: {error}; leave out --port") from None
    bound = int(server.server_address[1])
    server.set_app(guarded(routes(session, done.set), token, bound, fault))
    thread = Thread(target=server.serve_forever, args=(0.1,), name="server", daemon=True)
    thread.start()
    try:
        yield Served(f"http://{HOST}:{bound}/{token}/", done, remarks)
    finally:
        server.shutdown()
        server.server_close()
        session.close()
