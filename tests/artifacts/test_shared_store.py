"""A shared store: names stand for one content, what may pass is waited for, nothing is trusted."""

import errno
import itertools
import logging
import socket
import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from imocap_core.artifacts import shared_store
from imocap_core.artifacts.schemas import Sync
from imocap_core.artifacts.shared_store import (
    FolderFiles,
    RetryingStore,
    SharedFiles,
    fetch_detections,
    shared_files,
)
from imocap_core.artifacts.store import Store, Stored
from imocap_core.errors import WorkFailed
from tests.s3_server import BUCKET, HAS_S3, environment, free_port, reaching, s3_server

NUMBERS = itertools.count()
KEY = "k" * 64


@pytest.fixture(params=["folder", "memory"])
def shared(request: pytest.FixtureRequest, tmp_path: Path) -> SharedFiles:
    if request.param == "memory":
        return shared_files(f"memory://lab/{next(NUMBERS)}")
    folder = tmp_path / "shared"
    folder.mkdir()
    return shared_files(f"file://{folder}")


class Flaky(FolderFiles):
    """Fails a number of times, as the function says, then works."""

    def __init__(self, folder: Path, times: int, error: Callable[[], Exception]) -> None:
        super().__init__(folder)
        self.left, self.error = times, error

    def has(self, name: str) -> bool:
        if self.left:
            self.left -= 1
            raise self.error()
        return super().has(name)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_store, "FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(shared_store, "PATIENCE_S", 0.3)


def machine(tmp_path: Path, shared: SharedFiles, name: str) -> Store:
    return Store(tmp_path / name, shared)


def put(store: Store, sync: Sync, status: str) -> Stored:
    made = store.put("sync", KEY, sync.model_copy(update={"status": status}), {}, {"a.txt": b"1"})
    return store.share("sync", made, made=True)


def remote(shared: SharedFiles) -> str:
    return f"results/sync/{KEY}.mcap"


def test_what_is_published_is_fetched(tmp_path: Path, shared: SharedFiles) -> None:
    file, copy = tmp_path / "file", tmp_path / "copy"
    file.write_bytes(b"content")
    copy.write_bytes(b"something longer that was here")
    assert not shared.has("inputs/a")
    assert not shared.fetch("inputs/a", copy)
    shared.publish(file, "inputs/a")
    assert shared.has("inputs/a")
    assert not shared.has("inputs")
    assert shared.fetch("inputs/a", copy)
    assert copy.read_bytes() == b"content"


def test_a_result_of_one_machine_is_one_of_all(tmp_path, shared, sync):
    here, there = machine(tmp_path, shared, "here"), machine(tmp_path, shared, "there")
    assert there.find("yoga", "sync", KEY) is None
    made = put(here, sync, "first")
    fetched = there.find("yoga", "sync", KEY)
    assert fetched.digest == made.digest
    assert fetched.content.files == {"a.txt": b"1"}
    shared.publish(tmp_path / "here/.cache/sync" / f"{KEY}.mcap", "elsewhere")
    assert Store(there.folder).find("yoga", "sync", KEY) is not None  # without the shared store


def test_what_is_damaged_or_of_another_key_is_absent_and_made_anew(tmp_path, shared, sync):
    here, there = machine(tmp_path, shared, "here"), machine(tmp_path, shared, "there")
    good = put(here, sync, "first").file.read_bytes()
    foreign = here.put("sync", "other", sync, {}, {}).file.read_bytes()
    file = tmp_path / "file"
    for wrong in (good[:-20], good[:300] + b"x" + good[301:], foreign, b""):
        file.write_bytes(wrong)
        shared.publish(file, remote(shared))
        assert there.find("yoga", "sync", KEY) is None
        assert not list(there.folder.rglob("*.mcap"))
    made = put(there, sync, "first")
    fetched = machine(tmp_path, shared, "third").find("yoga", "sync", KEY)
    assert fetched.digest == made.digest


def test_of_two_results_under_one_key_the_first_counts_and_that_is_said(
    tmp_path, shared, sync, caplog
):
    here, there = machine(tmp_path, shared, "here"), machine(tmp_path, shared, "there")
    first = put(here, sync, "first")
    assert not caplog.records
    assert put(there, sync, "first").digest == first.digest
    assert not caplog.records
    (tmp_path / "there/.cache/sync" / f"{KEY}.mcap").unlink()
    second = put(there, sync, "second")
    assert second.digest == first.digest
    assert second.decode(Sync).status == "first"
    assert "two results under the key kkkkkkkkkkkk differ" in caplog.text


def test_a_result_that_is_only_here_is_published_by_the_next_run(tmp_path, shared, sync):
    alone = Store(tmp_path / "here")
    alone.publish("yoga", "sync", put(alone, sync, "first"))
    alone.cached("sync", KEY).unlink()  # the current one remains
    here = machine(tmp_path, shared, "here")
    stored = here.find("yoga", "sync", KEY)
    here.share("sync", stored, made=False)
    assert shared.has(remote(shared))


def test_detections_that_cannot_be_read_are_absent(tmp_path: Path, shared: SharedFiles) -> None:
    source, file = tmp_path / "source.npz", tmp_path / "artifacts/.cache/detections/key.npz"
    assert not fetch_detections(shared, file)
    np.savez(source, joints=np.zeros((3, 2)))
    for content, fine in ((b"PK nonsense", False), (source.read_bytes(), True)):
        (tmp_path / "file").write_bytes(content)
        shared.publish(tmp_path / "file", "results/detections/key.npz")
        assert fetch_detections(shared, file) == fine
        assert file.is_file() == fine
    assert [path.name for path in file.parent.iterdir()] == ["key.npz"]


@pytest.mark.usefixtures("impatient")
def test_an_error_that_passes_is_waited_for_and_said_once(tmp_path, caplog):
    files = RetryingStore(Flaky(tmp_path, 3, lambda: OSError(errno.EBUSY, "slow down")))
    assert not files.has("inputs/a")
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert "does not answer (slow down); trying again" in record.getMessage()


@pytest.mark.usefixtures("impatient")
def test_a_store_that_does_not_answer_is_a_sentence_and_may_be_tried_elsewhere(tmp_path):
    files = RetryingStore(Flaky(tmp_path, 10**6, lambda: TimeoutError("no route")))
    with pytest.raises(WorkFailed, match=r"did not answer for 0 s \(no route\).*run again") as info:
        files.has("inputs/a")
    assert isinstance(info.value.__cause__, ConnectionError)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (PermissionError("Forbidden"), r"refuses access \(Forbidden\); check its credentials"),
        (OSError(errno.ENOSPC, "No space left on device"), r"is full \(No space left"),
        (FileNotFoundError("no such bucket"), r"does not exist \(no such bucket\)"),
        (type("NoCredentialsError", (Exception,), {})("Unable"), r"needs credentials \(Unable\)"),
    ],
)
def test_where_waiting_does_not_help_the_sentence_comes_at_once(tmp_path, error, sentence):
    flaky = Flaky(tmp_path, 1, lambda: error)
    with pytest.raises(WorkFailed, match=sentence):
        RetryingStore(flaky).has("inputs/a")
    assert flaky.left == 0


def test_a_full_disk_of_this_machine_is_its_own(tmp_path, sync, monkeypatch):
    (tmp_path / "shared").mkdir()
    put(machine(tmp_path, FolderFiles(tmp_path / "shared"), "here"), sync, "first")

    def full(self: FolderFiles, name: str, file: Path) -> bool:
        file.write_bytes(b"part")
        raise OSError(errno.ENOSPC, "No space left on device", str(file))

    monkeypatch.setattr(FolderFiles, "fetch", full)
    there = machine(tmp_path, RetryingStore(FolderFiles(tmp_path / "shared")), "there")
    with pytest.raises(OSError, match="No space left"):
        there.find("yoga", "sync", KEY)
    assert not list((tmp_path / "there").rglob("*.mcap"))
    monkeypatch.undo()
    assert there.find("yoga", "sync", KEY) is not None


def test_a_folder_that_is_not_mounted_is_no_empty_store(tmp_path: Path) -> None:
    with pytest.raises(WorkFailed, match="does not exist; make or mount it"):
        shared_files(str(tmp_path / "nowhere")).has("inputs/a")


@pytest.mark.parametrize("url", ["nonsense://a/b", "github://a"])
def test_a_store_of_an_unknown_kind_is_a_sentence(url: str) -> None:
    with pytest.raises(WorkFailed, match=f"store .*{url}"):
        shared_files(url)


REFUSAL = b"HTTP/1.1 503 Slow Down\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"

needs_s3 = pytest.mark.skipif(not HAS_S3, reason="needs s3fs and moto's server")


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


@needs_s3
def test_a_server_that_answers_errors_for_a_while_loses_nothing(
    server, tmp_path, monkeypatch, caplog
):
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


@needs_s3
def test_nobody_who_answers_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_store, "PATIENCE_S", 1.0)
    with reaching(free_port()), pytest.raises(WorkFailed, match="did not answer for 1 s"):
        store("nobody").has("inputs/a")


@needs_s3
def test_a_bucket_that_does_not_exist_is_a_sentence(server: int, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("1")
    with reaching(server), pytest.raises(WorkFailed, match="does not exist"):
        shared_files("s3://nowhere/lab").publish(tmp_path / "file", "inputs/a")


@needs_s3
def test_keys_that_the_server_does_not_know_are_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("1")
    with s3_server(INITIAL_NO_AUTH_ACTION_COUNT="0") as port, reaching(port):
        with pytest.raises(WorkFailed, match=r"refuses access .*check its credentials"):
            store("refused").has("inputs/a")
        with pytest.raises(WorkFailed, match=r"refuses access .*check its credentials"):
            store("refused").publish(tmp_path / "file", "inputs/a")


@needs_s3
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
