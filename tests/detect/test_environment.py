"""Where the detector's Python is looked for, and what is messages when it cannot be made."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from imocap_core.detect import environment
from imocap_core.detect.environment import FOLDER, python_for
from imocap_core.errors import WorkFailed


@pytest.fixture(autouse=True)
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No environment of the checkout's is found."""
    monkeypatch.delenv("IMOCAP_DETECT_PYTHON", raising=False)
    monkeypatch.setattr(environment, "PROJECT", tmp_path / "installed")


def packages(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "made.txt"
    file.write_text(text)
    return file


def test_it_is_made_once_and_again_when_the_versions_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages: list[str] = []
    wanted = packages(tmp_path, "")
    python = python_for(wanted, tmp_path, messages.append)
    assert python.is_relative_to(tmp_path / FOLDER)
    assert python.exists()
    assert len(messages) == 2
    assert python_for(wanted, tmp_path / "artifacts" / "deep", messages.append) == python
    assert len(messages) == 2
    wanted.write_text("# newer\n")
    assert python_for(wanted, tmp_path, messages.append) == python
    assert len(messages) == 3
    stamp = tmp_path / FOLDER / ".installed-made.txt"
    assert stamp.read_text() == "# newer\n"
    monkeypatch.setenv("PIP_NO_INDEX", "1")  # as without a network
    wanted.write_text("a-package-that-is-nowhere==1.0\n")
    with pytest.raises(WorkFailed, match="run `make detect-env` once, or name a Python") as failed:
        python_for(wanted, tmp_path, messages.append)
    assert "\n" not in str(failed.value)
    assert stamp.read_text() == "# newer\n"


def test_a_named_python_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMOCAP_DETECT_PYTHON", sys.executable)
    assert python_for(packages(tmp_path, "x"), tmp_path, print) == Path(sys.executable)
    monkeypatch.setenv("IMOCAP_DETECT_PYTHON", str(tmp_path / "nothing"))
    with pytest.raises(WorkFailed, match=r"the program .*nothing does not exist"):
        python_for(packages(tmp_path, "x"), tmp_path, print)


def test_an_unfit_python_says_which_fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "VERSIONS", ((9, 9),))
    with pytest.raises(WorkFailed, match=r"detection needs Python 3\.11 or 3\.12"):
        python_for(packages(tmp_path, ""), tmp_path, lambda what: None)
