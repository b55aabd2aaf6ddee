"""The page's requests: its files, pictures by number, and changes of action.yaml."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import resources
from typing import Any, Literal

from bottle import Bottle, HTTPResponse, request  # type: ignore[import-untyped]
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from imocap_core.errors import ImocapError, system_fault
from imocap_core.pick.action_file import ChangedElsewhere
from imocap_core.pick.edits import Edit
from imocap_core.pick.session import Session
from imocap_core.pipeline.action import Model, explain_faults

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


class EditRequest(BaseModel):
    """Edits of a revision of action.yaml, made together."""

    model_config = ConfigDict(extra="forbid")

    revision: str
    edits: list[Edit] = Field(min_length=1, max_length=50)


class StepRequest(BaseModel):
    """A step back or forward from a revision."""

    model_config = ConfigDict(extra="forbid")

    revision: str
    step: Literal["undo", "redo"]


class EmptyRequest(BaseModel):
    """Nothing but the wish."""

    model_config = ConfigDict(extra="forbid")


def routes(session: Session, end: Callable[[], None]) -> Bottle:
    """The application; `end` is called when the user is done."""
    app = Bottle()
    app.catchall = False  # the guard answers for faults of the program
    page = page_files()
    app.route("/", "GET", lambda: _file(page, "index.html"))
    app.route("/page/<name>", "GET", lambda name: _file(page, name))
    app.route("/state", "GET", lambda: _json(session.document()))
    app.route("/people/<key>", "GET", lambda key: _people(session, key))
    app.route(
        "/pictures/<file:int>/<kind:re:thumb|large>/<number:int>.jpg",
        "GET",
        lambda file, kind, number: _picture(session, file, kind, number),
    )
    app.route("/edit", "POST", lambda: _changed(session, lambda: _edit(session)))
    app.route("/step", "POST", lambda: _changed(session, lambda: _step(session)))
    app.route("/detect", "POST", lambda: _changed(session, lambda: _detect(session)))
    app.route("/done", "POST", lambda: _changed(session, lambda: _end(end)))
    app.default_error_handler = lambda error: _error(error.status_code, "there is nothing here")
    return app


def page_files() -> dict[str, bytes]:
    """The files of the page by name; nothing else can be asked for by name."""
    folder = resources.files("imocap_core.pick") / "web"
    return {file.name: file.read_bytes() for file in folder.iterdir() if _type_of(file.name)}


def _type_of(name: str) -> str | None:
    return TYPES.get(name[name.rfind(".") :]) if "." in name else None


def _file(page: dict[str, bytes], name: str) -> HTTPResponse:
    if name not in page:
        return _error(404, "there is nothing here")
    return _response(200, page[name], str(_type_of(name)))


def _people(session: Session, key: str) -> HTTPResponse:
    outlines = session.tracks.get(key)
    if outlines is None:
        return _error(404, "there is nothing here")
    return _response(200, outlines, "application/json", "private, max-age=3600")


def _picture(session: Session, number: int, kind: str, frame: int) -> HTTPResponse:
    try:
        picture = session.media.picture(number, kind, frame)
    except ValueError as error:
        return _error(422, str(error))
    if picture is None:
        return _error(404, "there is nothing here")
    return _response(200, picture, "image/jpeg", "private, max-age=3600")


def _edit(session: Session) -> None:
    asked = _body(EditRequest)
    session.file.edit(asked.revision, asked.edits, session.counts())


def _step(session: Session) -> None:
    asked = _body(StepRequest)
    (session.file.undo if asked.step == "undo" else session.file.redo)(asked.revision)


def _detect(session: Session) -> None:
    _body(EmptyRequest)
    session.find_people()


def _end(end: Callable[[], None]) -> None:
    _body(EmptyRequest)
    end()


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


def _changed(session: Session, change: Callable[[], None]) -> HTTPResponse:
    """The state after a change; 409 when another program was faster, 422 with a sentence."""
    try:
        change()
    except ChangedElsewhere as error:
        return _error(409, str(error))
    except ValidationError as error:
        return _error(422, explain_faults(error, "the request"))
    except (ImocapError, ValueError, RecursionError) as error:
        return _error(422, session.plain(str(error)))
    except OSError as error:
        return _error(422, session.plain(f"action.yaml cannot be written: {system_fault(error)}"))
    return _json(session.document())


def _json(document: dict[str, Any]) -> HTTPResponse:
    return _response(200, json.dumps(document, allow_nan=False).encode(), "application/json")


def _error(status: int, sentence: str) -> HTTPResponse:
    return _response(status, json.dumps({"error": sentence}).encode(), "application/json")


def _response(status: int, body: bytes, kind: str, cache: str = "no-store") -> HTTPResponse:
    return HTTPResponse(
        body,
        status,
        {"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": cache},
    )
