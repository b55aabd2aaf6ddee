"""The server of pages for one user, 127.0.0.1 only: who may ask, and the answers of `pick`'s.

Who may ask the page's server: a browser on this machine that was given the address. The server
listens on this machine only, but any page in a browser can send requests there, and any name can be
made to lead to 127.0.0.1. So the address has a random token, compared in constant time; the Host
header must name this machine (DNS rebinding); what changes something must come from the page itself
(Origin), as JSON of limited size.
"""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from socketserver import ThreadingMixIn
from threading import Event, Thread
from typing import Any, Literal
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from bottle import Bottle, HTTPResponse, request  # type: ignore[import-untyped]
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from imocap_core.errors import ImocapError, WorkFailed, program_fault, system_fault
from imocap_core.library.api_errors import plain_errors
from imocap_core.library.new_action import action_of_videos
from imocap_core.pick.edits import Edit
from imocap_core.pick.session import ChangedElsewhere, Session
from imocap_core.pipeline.action import Model, explain_faults, find_action

Environ = dict[str, Any]
Start = Callable[..., Any]
Application = Callable[[Environ, Start], Iterable[bytes]]

MOST_BYTES = 64 * 1024  # of a request
MOST_DIGITS = 20  # of a number of bytes
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


def refusal(environ: Environ, token: str, port: int) -> tuple[str, str] | None:
    """Status and sentence for a request that is refused; None for one that is answered."""
    hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
    host = environ.get("HTTP_HOST", "")
    if host not in hosts:
        return "403 Forbidden", "this server answers to 127.0.0.1 only"
    given = environ.get("PATH_INFO", "").lstrip("/").partition("/")[0]
    if not hmac.compare_digest(given.encode("utf-8", "replace"), token.encode()):
        return "403 Forbidden", "use the whole address that imocap printed"
    if environ.get("HTTP_SEC_FETCH_SITE", "none") not in ("same-origin", "none"):
        return "403 Forbidden", "requests from other pages are refused"
    method = environ.get("REQUEST_METHOD")
    if method == "GET":
        return None
    if method != "POST":
        return "405 Method Not Allowed", "expected GET or POST"
    if environ.get("HTTP_ORIGIN") != f"http://{host}":
        return "403 Forbidden", "changes are taken from the page itself only"
    if environ.get("CONTENT_TYPE", "").partition(";")[0].strip() != "application/json":
        return "415 Unsupported Media Type", "expected JSON"
    length = environ.get("CONTENT_LENGTH", "")
    if not length.isascii() or not length.isdigit():
        return "411 Length Required", "expected a length"
    if len(length) > MOST_DIGITS or int(length) > MOST_BYTES:
        return "413 Content Too Large", f"expected at most {MOST_BYTES} bytes"
    return None


def guarded(
    application: Application,
    token: str,
    port: int,
    fault: Callable[[str], None],
    headers: Mapping[str, str] = HEADERS,
) -> Any:
    """The application behind these checks, below /TOKEN; no error's traceback leaves it.

    fault: called with a sentence about a fault of the program. headers: of every answer.
    """

    def guard(environ: Environ, start: Start) -> Iterable[bytes]:
        def start_safely(status: str, given: list[tuple[str, str]], *rest: Any) -> Any:
            return start(status, [*given, *headers.items()], *rest)

        refused = refusal(environ, token, port)
        if refused is not None:
            return _text(start_safely, *refused)
        path = environ["PATH_INFO"].lstrip("/").partition("/")
        environ["SCRIPT_NAME"], environ["PATH_INFO"] = f"/{token}", f"{path[1]}{path[2]}"
        if not path[1]:
            location = ("Location", f"/{token}/")
            start_safely("308 Permanent Redirect", [location, ("Content-Length", "0")])
            return [b""]
        try:
            return application(environ, start_safely)
        except Exception as error:
            fault(program_fault(error))
            return _text(start_safely, "500 Internal Server Error", "a fault of the program")

    return guard


def _text(start: Start, status: str, sentence: str) -> list[bytes]:
    body = f"imocap: {sentence}\n".encode()
    headers = [
        ("Content-Type", "text/plain; charset=utf-8"),
        ("Content-Length", str(len(body))),
        ("Cache-Control", "no-store"),
    ]
    start(status, headers)
    return [body]


TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


class EmptyRequest(BaseModel):
    """Nothing but the wish."""

    model_config = ConfigDict(extra="forbid")


class EditRequest(EmptyRequest):
    """Edits of a revision of action.yaml, made together."""

    revision: str
    edits: list[Edit] = Field(min_length=1, max_length=50)


class StepRequest(EmptyRequest):
    """A step back or forward from a revision."""

    revision: str
    step: Literal["undo", "redo"]


def routes(session: Session, end: Callable[[], None]) -> Bottle:
    """The application; `end` is called when the user is done."""
    app = Bottle()
    app.catchall = False  # the guard answers for faults of the program
    page = page_files()
    app.route("/", "GET", lambda: _file(page, "index.html"))
    app.route("/page/<name>", "GET", lambda name: _file(page, name))
    app.route("/state", "GET", lambda: json_response(session.document()))
    app.route("/people/<key>", "GET", lambda key: _people(session, key))
    app.route(
        "/pictures/<file:int>/<kind:re:thumb|large>/<number:int>.jpg",
        "GET",
        lambda file, kind, number: _picture(session, file, kind, number),
    )

    def post(path: str, kind: type[Model], change: Callable[[Model], object]) -> None:
        app.route(path, "POST", lambda: _changed(session, lambda: change(_body(kind))))

    def step(asked: StepRequest) -> None:
        (session.file.undo if asked.step == "undo" else session.file.redo)(asked.revision)

    post("/edit", EditRequest, lambda e: session.file.edit(e.revision, e.edits, session.counts()))
    post("/step", StepRequest, step)
    post("/detect", EmptyRequest, lambda _: session.find_people())
    post("/done", EmptyRequest, lambda _: end())
    app.default_error_handler = nothing_here
    return app


def page_files() -> dict[str, bytes]:
    """The files of the page by name; nothing else can be asked for by name."""
    folder = resources.files("imocap_core.pick") / "web"
    return {file.name: file.read_bytes() for file in folder.iterdir() if _type_of(file.name)}


def _type_of(name: str) -> str | None:
    return TYPES.get(name[name.rfind(".") :]) if "." in name else None


def _file(page: dict[str, bytes], name: str) -> HTTPResponse:
    if name not in page:
        return error_response(404, "there is nothing here")
    return response(200, page[name], str(_type_of(name)))


def _people(session: Session, key: str) -> HTTPResponse:
    outlines = session.tracks.get(key)
    if outlines is None:
        return error_response(404, "there is nothing here")
    return response(200, outlines, "application/json", "private, max-age=3600")


def _picture(session: Session, number: int, kind: str, frame: int) -> HTTPResponse:
    try:
        picture = session.media.picture(number, kind, frame)
    except ValueError as error:
        return error_response(422, str(error))
    if picture is None:
        return error_response(404, "there is nothing here")
    return response(200, picture, "image/jpeg", "private, max-age=3600")


def _body(model: type[Model]) -> Model:
    """The request's JSON. ValueError when it is none."""
    length = int(request.environ["CONTENT_LENGTH"])
    try:
        data = request.environ["wsgi.input"].read(length)
    except OSError:  # it sends nothing more
        data = b""
    if len(data) < length:
        raise ValueError(f"the request broke off: {len(data)} of its {length} bytes came")
    return model.model_validate_json(data)


def _changed(session: Session, change: Callable[[], object]) -> HTTPResponse:
    """The state after a change; 409 when another program was faster, 422 with a sentence."""
    try:
        change()
    except ChangedElsewhere as error:
        return error_response(409, str(error))
    except ValidationError as error:
        return error_response(422, explain_faults(error, "the request"))
    except (ImocapError, ValueError, RecursionError) as error:
        return error_response(422, session.plain(str(error)))
    except OSError as error:
        return error_response(
            422, session.plain(f"action.yaml cannot be written: {system_fault(error)}")
        )
    return json_response(session.document())


def nothing_here(error: Any) -> HTTPResponse:
    """What Bottle's own errors become."""
    return error_response(error.status_code, "there is nothing here")


def json_response(document: dict[str, Any]) -> HTTPResponse:
    """A document as the answer."""
    return response(200, json.dumps(document, allow_nan=False).encode(), "application/json")


def error_response(status: int, sentence: str) -> HTTPResponse:
    """A sentence on what went wrong."""
    return response(status, json.dumps({"error": sentence}).encode(), "application/json")


def response(status: int, body: bytes, kind: str, cache: str = "no-store") -> HTTPResponse:
    """An answer of a content type."""
    return HTTPResponse(
        body,
        status,
        {"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": cache},
    )


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
    routes_of: Callable[[Callable[[], None]], Application],
    port: int,
    fault: Callable[[str], None],
    remarks: Sequence[str] = (),
    headers: Mapping[str, str] = HEADERS,
) -> Iterator[Served]:
    """Serve a page while the body runs.

    routes_of: the application; it is given what to call when the user is done. port: 0 for any that
    is free. fault, headers: as of `guarded`. WorkFailed when the port is taken.
    """
    token, done = secrets.token_urlsafe(TOKEN_BYTES), Event()
    try:
        server = _Server((HOST, port), _Handler)
    except (OSError, OverflowError) as error:
        raise WorkFailed(f"cannot listen on {HOST}:{port}: {error}; leave out --port") from None
    bound = int(server.server_address[1])
    server.set_app(guarded(routes_of(done.set), token, bound, fault, headers))
    thread = Thread(target=server.serve_forever, args=(0.1,), name="server", daemon=True)
    thread.start()
    try:
        yield Served(f"http://{HOST}:{bound}/{token}/", done, [*remarks])
    finally:
        server.shutdown()
        server.server_close()


@plain_errors
def open_session(name: str, videos: Sequence[Path], root: Path) -> tuple[Session, list[str]]:
    """The session of an action, by name or folder, and remarks on its files.

    With videos it is made first, as by `init`. WrongUse when there is none, WorkFailed when its
    action.yaml is wrong.
    """
    remarks = action_of_videos(root, name, videos)[1] if videos else []
    return Session(root, name, find_action(name, root)), remarks


@contextmanager
def picking(
    name: str,
    videos: Sequence[Path],
    root: Path,
    port: int = 0,
    fault: Callable[[str], None] = lambda sentence: None,
) -> Iterator[Served]:
    """Serve the page of an action while the body runs (arguments: `open_session`, `serving`)."""
    session, remarks = open_session(name, videos, root)
    with (
        closing(session),
        serving(lambda end: routes(session, end), port, fault, remarks) as served,
    ):
        yield served
