"""Who may ask the server, and for what: asked over real HTTP, as an attacker would."""

import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from imocap_core.pick.server import MOST_BYTES, picking
from tests.pick.conftest import working_folder
from tests.pick.made import Asker

MIRROR = {"kind": "mirrored", "video": "v1", "mirrored": True}


@pytest.fixture(scope="module")
def asker(tmp_path_factory: pytest.TempPathFactory, films: Path) -> Iterator[Asker]:
    """One page for all: what is refused changes nothing."""
    root = working_folder(tmp_path_factory.mktemp("guarded"), films)
    with picking("made", [], root) as served:
        asker = Asker(served, root / "actions" / "made" / "action.yaml")
        asker.wait(lambda s: s["plan"] and all("count" in f for f in s["files"]))
        yield asker
    files = {p.name for p in (root / "actions" / "made").iterdir()}
    assert files == {"action.yaml", "v1", "v2", "v1.mp4", "v2.mp4"}


def test_the_page_comes_with_its_protection(asker: Asker) -> None:
    answer, content = asker.ask("")
    assert answer.status == 200
    assert b"<!doctype html>" in content
    policy = str(answer.getheader("Content-Security-Policy"))
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "http" not in policy
    assert answer.getheader("Referrer-Policy") == "no-referrer"
    assert answer.getheader("X-Content-Type-Options") == "nosniff"
    assert b"://" not in content.replace(b"http://www.w3.org", b"")


@pytest.mark.parametrize("token", ["", "x", "state", "..", "%2e%2e"])
def test_without_the_token_there_is_nothing(asker: Asker, token: str) -> None:
    for path in ("", "state", "page/main.js", "pictures/0/thumb/0.jpg"):
        answer, content = asker.ask(path, token=token)
        assert answer.status == 403
        assert b"whole address" in content
    for near in (asker.token[:-1], asker.token + "x", asker.token.swapcase()):
        assert asker.ask("state", token=near)[0].status == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1", "", None])
def test_another_host_is_refused(asker: Asker, host: str | None) -> None:
    named = None if host is None else host.format(port=asker.port)
    assert asker.ask("state", Host=named)[0].status == 403


def test_localhost_is_this_machine(asker: Asker) -> None:
    assert asker.ask("state", Host=f"localhost:{asker.port}")[0].status == 200


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": None}, 403),
        ({"Origin": "https://127.0.0.1:{port}"}, 403),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content_Length": None}, 411),
        ({"Content_Length": "-5"}, 411),
        ({"Content_Length": str(MOST_BYTES + 1)}, 413),
    ],
)
def test_changes_come_from_the_page_alone(asker, headers, status):
    before = asker.file.read_bytes()
    sent = {k: v and v.format(port=asker.port) for k, v in headers.items()}
    body = {"revision": asker.state()["revision"], "edits": [MIRROR]}
    for path in ("edit", "step", "detect", "done"):
        assert asker.ask(path, body, **sent)[0].status == status
    assert asker.file.read_bytes() == before
    assert not asker.served.done.is_set()


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_other_methods_are_refused(asker: Asker, method: str) -> None:
    assert asker.ask("state", method=method)[0].status == 405


@pytest.mark.parametrize(
    "path",
    [
        "page/../action.yaml",
        "page/..%2f..%2froutes.py",
        "page/%2fetc%2fpasswd",
        "page/__init__.py",
        "pictures/0/thumb/..%2f..%2f0.jpg",
        "pictures/99/thumb/0.jpg",
        "pictures/0/thumb/4000.jpg",
        "pictures/-1/thumb/0.jpg",
        "pictures/0/whole/0.jpg",
        "people/0123",
        "people/..%2f..%2faction.yaml",
        "actions/made/v1.mp4",
        "%00",
    ],
)
def test_nothing_is_read_by_its_path(asker: Asker, path: str) -> None:
    answer, content = asker.ask(path)
    assert answer.status == 404
    assert content == b'{"error": "there is nothing here"}'


@pytest.mark.parametrize(
    "body", [b"{", b"\xff\xfe", b"[" * 5000, b'"x"', b"{}", b'{"revision": 1, "edits": []}']
)
def test_nonsense_is_answered_with_a_sentence(asker: Asker, body: bytes) -> None:
    before = asker.file.read_bytes()
    for path in ("edit", "step"):
        answer, content = asker.ask(path, body)
        assert answer.status == 422
        assert b"Traceback" not in content
    assert asker.file.read_bytes() == before


def test_a_length_without_end_and_a_short_body(asker: Asker) -> None:
    answer, content = asker.ask("edit", b"{}", Content_Length=5000 * "9")
    assert (answer.status, b"Traceback" in content) == (413, False)
    head = (
        f"POST /{asker.token}/edit HTTP/1.1\r\nHost: {asker.host}\r\nOrigin: http://{asker.host}\r\n"
        "Content-Type: application/json\r\nContent-Length: 50\r\n\r\n{"
    )
    answered = asker.raw(head.encode())
    assert b"422" in answered.partition(b"\r\n")[0]
    assert b"the request broke off: 1 of its 50 bytes came" in answered


def test_requests_that_are_no_http_break_nothing(asker: Asker) -> None:
    for text in (b"", b"\x16\x03\x01\x00", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n"):
        answer = asker.raw(text)
        assert b"Traceback" not in answer
        assert b"site-packages" not in answer
    long = b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n"
    assert b" 414 " in asker.raw(long)
    assert asker.state()["action"] == "made"


def test_a_fault_of_the_program_shows_no_traceback(root, monkeypatch):
    faults: list[str] = []
    with picking("made", [], root, fault=faults.append) as served:
        asker = Asker(served, root)
        monkeypatch.setattr("imocap_core.pick.session.warnings_of", lambda *_: 1 / 0)
        answer, content = asker.ask("state")
    assert answer.status == 500
    assert content == b"imocap: a fault of the program\n"
    assert "ZeroDivisionError" in faults[0]


def test_other_machines_cannot_reach_it(asker: Asker) -> None:
    names = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in names - {"127.0.0.1"} | {"127.0.0.2"}:
        with closing(socket.socket()) as connection:
            connection.settimeout(5)
            assert connection.connect_ex((address, asker.port)) != 0


def test_every_page_has_an_address_of_its_own(root: Path, asker: Asker) -> None:
    with picking("made", [], root) as other:
        assert Asker(other, root).token != asker.token
        assert len(asker.token) >= 32
        assert asker.ask("state", token=Asker(other, root).token)[0].status == 403
