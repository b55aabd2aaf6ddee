"""The runners of the tests that need other programs, none of which is installed here, or other
Pythons."""

from __future__ import annotations

import os
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tools import other_pythons, readers

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


ANSWERS = "#!/bin/sh\necho 3.99\n"
FAILS = "#!/bin/sh\nexit 127\n"


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Nothing but what a test puts into its folders bin and pyenv."""
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}/usr/bin{os.pathsep}/bin")
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    return tmp_path


def test_the_python_on_the_path_is_taken_but_a_failing_shim_gives_way_to_pyenv_s_newest(
    machine: Path,
) -> None:
    expected = script(machine / "bin" / "python3.99", ANSWERS)
    script(machine / "pyenv/versions/3.99.2/bin/python", ANSWERS)
    assert other_pythons.interpreter("3.99") == expected
    script(machine / "bin" / "python3.99", FAILS)
    newest = script(machine / "pyenv/versions/3.99.10/bin/python", ANSWERS)
    script(machine / "pyenv/versions/3.99.11/bin/python", FAILS)
    assert other_pythons.interpreter("3.99") == newest


def test_a_python_of_another_version_does_not_count(machine: Path) -> None:
    script(machine / "bin" / "python3.98", ANSWERS)
    assert other_pythons.interpreter("3.98") is None


@pytest.mark.parametrize(
    ("install", "tests", "code", "line"),
    [
        ("exit 0", "exit 0", 0, "the tests on Python 3.99"),
        ("exit 0", "exit 2", 1, "the tests on Python 3.99"),
        ("exit 2", "exit 2", 0, "skipped Python 3.99: its installation ended with exit code 2"),
        ("sleep 60", "exit 2", 0, "skipped Python 3.99: its installation took longer than 0.5 s"),
    ],
)
def test_only_a_failing_test_is_a_failure(machine, capfd, monkeypatch, install, tests, code, line):
    script(machine / "bin" / "python3.99", ANSWERS)
    script(
        machine / "bin" / "make", f'#!/bin/sh\ncase "$2" in setup) {install};; *) {tests};; esac\n'
    )
    monkeypatch.chdir(machine)
    environment = machine / ".venv-3.99"
    environment.mkdir()
    seconds = "0.5" if "sleep" in install else "30"
    assert other_pythons.main(["3.99", "3.97", "--install-seconds", seconds]) == code
    lines = capfd.readouterr().out.splitlines()
    assert lines == [f"imocap: {line}", "imocap: skipped Python 3.97, which is not here"]
    assert environment.exists() == (install == "exit 0")  # half of it may be gigabytes
