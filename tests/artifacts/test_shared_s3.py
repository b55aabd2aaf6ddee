"""A shared store on a server that speaks S3: errors in between, none that answers, wrong keys."""

from __future__ import annotations

import socket
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from imocap_core.artifacts import shared_store
from imocap_core.artifacts.shared_store import SharedFiles, shared_files
from imocap_core.errors import WorkFailed
from tests.s3_server import BUCKET, HAS_S3, environment, free_port, reaching, s3_server

REFUSAL = b"HTTP/1.1 503 Slow Down\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"

pytestmark = pytest.mark.skipif(not HAS_S3, reason="needs s3fs and moto's server")


@pytest.fixture(scope="module")
def server() -> Iterator[int]:
    import s3fs

    with s3_server() as port:
        with reaching(port):
            s3fs.S3FileSystem().mkdir(BUCKET)
        yield port


class Proxy(socketserver.BaseRequestHandler):
    """Hands a connection on; while the server is `broken`, answers with an error and closes."""

    def handle(self) -> None:
        server = self.server
        assert isinstance(server, ProxyServer)
        with socket.create_connection(("127.0.0.1", server.behind)) as behind:
            back = threading.Thread(target=pump, args=(behind, self.request))
            back.start()
            while data := self.request.recv(2**16):
                if server.broken.is_set():
                    server.refused += 1
                    self.request.sendall(REFUSAL)
                    break
                behind.sendall(data)
            behind.shutdown(socket.SHUT_RDWR)
            back.join()


class ProxyServer(socketserver.ThreadingTCPServer):
    behind, refused = 0, 0
    broken: threading.Event


def pump(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(2**16):
            target.sendall(data)


@contextmanager
def proxy(behind: int) -> Iterator[ProxyServer]:
    with ProxyServer(("127.0.0.1", 0), Proxy) as server:
        server.daemon_threads = True
        server.behind, server.broken = behind, threading.Event()
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def store(name: str) -> SharedFiles:
    return shared_files(f"s3://{BUCKET}/{name}")


def test_a_server_that_answers_errors_for_a_while_loses_nothing(
    server: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(shared_store, "LONGEST_PAUSE_S", 0.5)
    file, copy = tmp_path / "file", tmp_path / "copy"
    file.write_bytes(b"content" * 10_000)
    copy.touch()
    with proxy(server) as between, reaching(between.server_address[1]):
        shared = store("errors")
        for work in (
            lambda: shared.publish(file, "inputs/a"),
            lambda: shared.fetch("inputs/a", copy),
        ):
            between.broken.set()
            timer = threading.Timer(1.5, between.broken.clear)
            timer.start()
            work()
            timer.join()
            assert not between.broken.is_set()
    assert between.refused >= 4
    assert copy.read_bytes() == file.read_bytes()
    assert caplog.text.count("trying again") == 2


def test_nobody_who_answers_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_store, "PATIENCE_S", 1.0)
    with reaching(free_port()), pytest.raises(WorkFailed, match="did not answer for 1 s"):
        store("nobody").has("inputs/a")


def test_a_bucket_that_does_not_exist_is_a_sentence(server: int, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("1")
    with reaching(server), pytest.raises(WorkFailed, match="does not exist"):
        shared_files("s3://nowhere/lab").publish(tmp_path / "file", "inputs/a")


def test_keys_that_the_server_does_not_know_are_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("1")
    with s3_server(INITIAL_NO_AUTH_ACTION_COUNT="0") as port, reaching(port):
        with pytest.raises(WorkFailed, match=r"refuses access .*check its credentials"):
            store("refused").has("inputs/a")
        with pytest.raises(WorkFailed, match=r"refuses access .*check its credentials"):
            store("refused").publish(tmp_path / "file", "inputs/a")


def test_no_keys_at_all_are_a_sentence(server: int, tmp_path: Path) -> None:
    nothing = {"AWS_EC2_METADATA_DISABLED": "true", "AWS_SHARED_CREDENTIALS_FILE": "nowhere"}
    (tmp_path / "file").write_text("1")
    sentence = r"store s3://.* (needs credentials|refuses access)"
    with (
        reaching(server, keys=False),
        environment(nothing),
        pytest.raises(WorkFailed, match=sentence),
    ):
        store("nokeys").publish(tmp_path / "file", "inputs/a")
