"""make test-pythons: a Python that is not to be had is skipped, a test that fails is a failure."""

import os
from pathlib import Path

import pytest

from tools import other_pythons

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


def test_the_python_on_the_path_is_taken(machine: Path) -> None:
    expected = script(machine / "bin" / "python3.99", ANSWERS)
    script(machine / "pyenv/versions/3.99.2/bin/python", ANSWERS)
    assert other_pythons.interpreter("3.99") == expected


def test_a_shim_that_fails_gives_way_to_the_newest_that_pyenv_installed(machine: Path) -> None:
    script(machine / "bin" / "python3.99", FAILS)
    script(machine / "pyenv/versions/3.99.2/bin/python", ANSWERS)
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
