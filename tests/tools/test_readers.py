"""The runner of the tests that need other programs; none is installed here."""

from __future__ import annotations

import os
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tools import readers

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", list(readers.GROUPS))
def test_the_tests_look_for_their_readers_by_the_variable(name: str) -> None:
    group = readers.GROUPS[name]
    for test in group.tests:
        files = sorted((ROOT / test).rglob("*.py")) if (ROOT / test).is_dir() else [ROOT / test]
        assert any(group.variable in file.read_text(encoding="utf-8") for file in files), test


def test_what_cannot_be_installed_is_named(monkeypatch, capsys):
    for group in readers.GROUPS.values():
        monkeypatch.delenv(group.variable, raising=False)
    monkeypatch.setattr(readers, "install", lambda name, seconds: "no network")
    assert readers.main(["rerun", "scenes"]) == 0
    said = capsys.readouterr().out
    assert "rerun: left out, no network" in said
    assert "scenes: left out, no network" in said
    assert "nothing was tested" in said


def test_a_reader_that_a_variable_names_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[dict[str, str]] = []

    def run(line: list[str], env: dict[str, str], **_: object) -> CompletedProcess:
        started.append(env)
        return CompletedProcess(line, 3)

    monkeypatch.setattr(readers.subprocess, "run", run)
    monkeypatch.setenv("IMOCAP_RERUN", "/somewhere/rerun")
    assert readers.main(["rerun"]) == 3
    assert started[0]["IMOCAP_RERUN"] == "/somewhere/rerun"
    assert set(started[0]) == set(os.environ)


def test_an_unknown_name_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        readers.main(["maya"])
    assert end.value.code == 2
    assert "no readers maya; there are: blender" in capsys.readouterr().err


def test_a_changed_list_of_packages_is_installed_again(monkeypatch, tmp_path):
    started = []

    def run(line: list[str], **_: object) -> CompletedProcess:
        started.append(line)
        return CompletedProcess(line, 0)

    packages = tmp_path / "packages.txt"
    packages.write_text("bpy==5.0.1\n")
    group = readers.Readers("IMOCAP_BLENDER", ("-r", str(packages)), ())
    monkeypatch.setitem(readers.GROUPS, "blender", group)
    monkeypatch.setattr(readers, "FOLDER", tmp_path)
    monkeypatch.setattr(readers.subprocess, "run", run)
    (tmp_path / "blender").mkdir()
    for content, lines in (("bpy==5.0.1\n", 2), ("bpy==5.0.1\n", 2), ("bpy==5.0.2\n", 4)):
        packages.write_text(content)
        assert readers.install("blender", 1.0) == ""
        assert len(started) == lines
