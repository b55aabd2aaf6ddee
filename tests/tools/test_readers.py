"""The runner of the tests that need other programs; none is installed here."""

from __future__ import annotations

from pathlib import Path

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
