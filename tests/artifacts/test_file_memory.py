"""A file is read again when, and only when, it may have changed."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from imocap_core import limits
from imocap_core.artifacts import file_memory
from imocap_core.artifacts.file_memory import files_below, load_memory, remembered, save_memory
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.source import content_digest

LONG_AGO_S = 1_600_000_000


class Reader:
    """Returns a file's text, or a folder's file names, and counts how often it did."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, path: Path) -> str:
        self.count += 1
        return ",".join(files_below(path)) if path.is_dir() else path.read_text()


@pytest.fixture
def reader() -> Reader:
    return Reader()


@pytest.fixture
def forget(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Begin with nothing remembered; called, as a new process would."""

    def anew() -> None:
        memory = file_memory._Memory()
        monkeypatch.setattr(file_memory, "_memory", lambda: memory)

    anew()
    return anew


def written(file: Path, text: str, age: int = 0) -> Path:
    """A file that was last changed long ago, `age` seconds after others of age 0."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    os.utime(file, (LONG_AGO_S + age, LONG_AGO_S + age))
    return file


def test_an_unchanged_file_is_read_once(tmp_path, reader, forget):
    file = written(tmp_path / "a", "one")
    assert [remembered("text", file, reader) for _ in range(3)] == ["one"] * 3
    assert reader.count == 1
    assert remembered("other", file, reader) == "one"
    assert reader.count == 2


@pytest.mark.parametrize("text", ["two", "longer"])
def test_a_changed_file_is_read_again(tmp_path, reader, forget, text):
    file = written(tmp_path / "a", "one")
    remembered("text", file, reader)
    written(file, text, age=1)
    assert remembered("text", file, reader) == text


def test_another_file_in_its_place_is_read_though_size_and_time_agree(tmp_path, reader, forget):
    file = written(tmp_path / "a", "one")
    remembered("text", file, reader)
    written(tmp_path / "b", "two").replace(file)
    assert remembered("text", file, reader) == "two"


def test_a_file_that_has_just_changed_is_not_remembered(tmp_path, reader, forget):
    file = tmp_path / "a"
    file.write_text("one")
    remembered("text", file, reader)
    remembered("text", file, reader)
    assert reader.count == 2


def test_a_folder_changes_with_each_of_its_files(tmp_path, reader, forget):
    folder = tmp_path / "folder"
    written(folder / "sub" / "b", "1")
    written(folder / "a", "1")
    os.utime(folder, (LONG_AGO_S, LONG_AGO_S))
    assert remembered("names", folder, reader) == "a,sub/b"
    remembered("names", folder, reader)
    assert reader.count == 1
    written(folder / "sub" / "b", "2", age=1)
    remembered("names", folder, reader)
    assert reader.count == 2
    written(folder / "sub" / "c", "1")
    assert remembered("names", folder, reader) == "a,sub/b,sub/c"


def test_the_next_process_remembers(tmp_path, reader, forget):
    store = tmp_path / "artifacts"
    store.mkdir()
    file, lost = written(tmp_path / "a", "one"), written(tmp_path / "b", "gone")
    remembered("text", file, reader)
    remembered("text", lost, reader)
    lost.unlink()
    save_memory(store)
    forget()
    load_memory(store)
    assert remembered("text", file, reader) == "one"
    assert reader.count == 2
    assert str(lost) not in (store / file_memory.FILE).read_text()
    assert [p.name for p in (store / ".cache").iterdir()] == ["files.json"]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"made_by": "other", "entries": {}}', '{"a": 1}', 100_000 * "["]
)
def test_a_damaged_or_foreign_memory_is_as_none(tmp_path, reader, forget, text):
    written(tmp_path / file_memory.FILE, text)
    load_memory(tmp_path)
    file = written(tmp_path / "a", "one")
    assert remembered("text", file, reader) == "one"


def test_nothing_is_made_where_there_is_no_store(tmp_path, reader, forget):
    remembered("text", written(tmp_path / "a", "one"), reader)
    save_memory(tmp_path / "artifacts")
    assert not (tmp_path / "artifacts").exists()


def test_a_missing_file_is_an_error(tmp_path, reader, forget):
    with pytest.raises(FileNotFoundError):
        remembered("text", tmp_path / "nowhere", reader)


@pytest.mark.parametrize(("limit", "most"), [("MAX_FOLDER_FILES", 3), ("MAX_FOLDER_BYTES", 30)])
def test_a_folder_of_a_whole_disk_is_no_input(tmp_path, monkeypatch, limit, most):
    for name in ("a", "b", "c"):
        (tmp_path / name).write_text(10 * "x")
    monkeypatch.setattr(limits, limit, most)
    digest = content_digest(tmp_path)
    (tmp_path / "c").write_text(11 * "x")
    if limit == "MAX_FOLDER_FILES":
        assert content_digest(tmp_path) != digest
        (tmp_path / "d").touch()
    with pytest.raises(WorkFailed, match=f"cannot read {tmp_path}: more than"):
        content_digest(tmp_path)
