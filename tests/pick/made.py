"""A client that asks the page's server as a browser does, or as one must not."""

import json
import socket
import time
from http.client import HTTPConnection, HTTPResponse
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from imocap_core.pick.server import Served

PATIENCE_S = 90.0


class Asker:
    """Requests to a page that is served; `file`: its action.yaml."""

    def __init__(self, served: Served, file: Path) -> None:
        self.served, self.file = served, file
        parts = urlsplit(served.address)
        self.port, self.token = parts.port, parts.path.strip("/")
        self.host = f"127.0.0.1:{self.port}"

    def ask(
        self,
        path: str,
        body: Any = None,
        *,
        method: str | None = None,
        token: str | None = None,
        **headers: str | None,
    ) -> tuple[HTTPResponse, bytes]:
        """Answer and its content. headers: others than a browser's; None leaves one out."""
        data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        sent: dict[str, str | None] = {"Host": self.host}
        if data is not None:
            sent |= {
                "Origin": f"http://{self.host}",
                "Content-Type": "application/json",
                "Content-Length": str(len(data)),
            }
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection = HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        where = self.token if token is None else token
        method = method or ("GET" if data is None else "POST")
        connection.putrequest(method, f"/{where}/{path}", skip_host=True, skip_accept_encoding=True)
        for name, value in sent.items():
            if value is not None:
                connection.putheader(name, value)
        connection.endheaders(data)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return answer, content

    def state(self) -> dict[str, Any]:
        """What the page shows."""
        answer, content = self.ask("state")
        assert answer.status == 200, content
        document: dict[str, Any] = json.loads(content)
        return document

    def wait(self, ready: Any) -> dict[str, Any]:
        """The state once `ready` is true of it."""
        end = time.monotonic() + PATIENCE_S
        while not ready(state := self.state()):
            assert time.monotonic() < end, state
            time.sleep(0.05)
        return state

    def edit(self, *edits: dict[str, Any], revision: str | None = None) -> tuple[int, Any]:
        """Status and document after edits of the present revision, or another."""
        body = {"revision": revision or self.state()["revision"], "edits": list(edits)}
        answer, content = self.ask("edit", body)
        return answer.status, json.loads(content)

    def raw(self, text: bytes) -> bytes:
        """The answer to bytes as they are."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S) as connection:
            connection.sendall(text)
            connection.shutdown(socket.SHUT_WR)
            return b"".join(iter(lambda: connection.recv(4096), b""))
