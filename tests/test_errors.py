"""Sentences about the system's faults name a place and a remedy, and nothing a terminal obeys."""

import errno
from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed, WrongUse, system_fault
from imocap_core.files import write_whole
from imocap_core.identifiers import is_portable
from imocap_core.pipeline.action import action_of


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "run again with more space"),
        (errno.ENOENT, "make the folder"),
        (errno.EACCES, "may write"),
        (errno.EROFS, "may write"),
    ],
)
@pytest.mark.parametrize("name", ["out/film.mp4", None])
def test_a_place_and_a_remedy(number: int, words: str, name: str | None) -> None:
    error = OSError(number, "no") if name is None else OSError(number, "no", name)
    sentence = system_fault(error)
    assert words in sentence
    assert (name or str(Path.cwd())) in sentence


def test_a_full_disk_names_the_file_that_was_written(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space") as error:
        write_whole(tmp_path / "a.json", "{}")
    assert str(tmp_path / "a.json") in system_fault(error.value)


def test_a_refusal_shows_escape_characters_as_such() -> None:
    for kind in (WorkFailed, WrongUse):
        assert str(kind("a\x1b[31m\x07\u202e b\né\U0001f600")) == (
            "a\\x1b[31m\\x07\\u202e b\né\U0001f600"
        )
    with pytest.raises(WorkFailed, match="unknown field") as error:
        action_of({"name": "a", "videos": [], "\x1b[2Jkey": 1}, Path("a"))
    assert "\x1b" not in str(error.value)


def test_names_that_windows_reserves() -> None:
    for name in ("con", "Nul.txt", "COM1", "lpt3.tar.gz", "aux .x", "a.", "b "):
        assert not is_portable(name)
    for name in ("console", "com", "com10", "v1.mp4", "lpt", ".hidden", "nul_1"):
        assert is_portable(name)
