"""Who may ask the page's server: a browser on this machine that was given the address.

The server listens on this machine only, but any page in a browser can send requests there, and any
name can be made to lead to 127.0.0.1. So the address has a random token, compared in constant
time; the Host header must name this machine (DNS rebinding); what changes something must come from
the page itself (Origin), as JSON of limited size.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable, Iterable
from typing import Any

from imocap_core.errors import program_fault

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
        return "403 Forbidden", "use the whole address that imocap pick printed"
    if environ.get("HTTP_SEC_FETCH_SITE", "none") not in ("same-origin", "none"):
        return "403 Forbidden", "requests from other pages are refused"
    method = environ.get("REQUEST_METHOD")
    if method == "GET":
        return None
    if method != "POST":
        return "405 Method Not Allowed", "expected GET or POST"
    return _refused_write(environ, host)


def _refused_write(environ: Environ, host: str) -> tuple[str, str] | None:
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


def guarded(application: Application, token: str, port: int, fault: Callable[[str], None]) -> Any:
    """The application behind these checks, below /TOKEN; no error's traceback leaves it.

    fault: called with a sentence about a fault of the program.
    """

    def guard(environ: Environ, start: Start) -> Iterable[bytes]:
        def start_safely(status: str, headers: list[tuple[str, str]], *rest: Any) -> Any:
            return start(status, [*headers, *HEADERS.items()], *rest)

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
