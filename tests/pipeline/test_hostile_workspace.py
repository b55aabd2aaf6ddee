"""A working folder from somebody else: nothing outside it is written, nothing runs unasked."""

from __future__ import annotations

from dataclasses import replace

from imocap_core.artifacts import codec
from imocap_core.artifacts.store import Store
from imocap_core.files import appearing
from imocap_core.pipeline.graph import VARIABLE
from tests.pipeline.conftest import Toy


def test_a_cached_result_with_a_side_file_outside_is_made_again(toy: Toy) -> None:
    assert toy.imocap(["run", "toy"]) == 0
    before, script = toy.digests(), toy.root / "toys" / "gather.py"
    text = script.read_text()
    store = Store(toy.root / "artifacts")
    current = store.load("toy", "evaluate")
    for name in ("../../../toys/gather.py", str(script)):
        hostile = replace(current.content, files={name: b"raise SystemExit('planted')"})
        with appearing(store.current("toy", "evaluate")) as stream:
            codec.write(stream, hostile, {})
        store.cached("evaluate", current.key).unlink()
        toy.ran()
        assert toy.imocap(["run", "toy"]) == 0
        assert toy.ran() == ["evaluate"]
        assert script.read_text() == text
        assert toy.digests() == before


def test_scripts_of_the_folder_run_only_where_they_are_allowed(toy, monkeypatch, capsys):
    monkeypatch.delenv(VARIABLE)
    assert toy.imocap(["run", "toy"]) == 1
    error = capsys.readouterr().err
    assert f"stages.gather.script: {toy.root / 'toys' / 'gather.py'} is no part of imocap" in error
    assert "--allow-scripts" in error
    assert toy.ran() == []
    monkeypatch.setenv(VARIABLE, str(toy.root.parent))  # another folder's
    assert toy.imocap(["run", "toy"]) == 1
    assert toy.ran() == []
    monkeypatch.setenv(VARIABLE, "")  # which --allow-scripts changes: restored after the test
    assert toy.imocap(["run", "toy", "--allow-scripts"]) == 0
    assert toy.ran() == ["gather", "scale", "evaluate"]


def test_on_a_terminal_scripts_are_asked_for(toy, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, "")
    for stream in ("stdin", "stdout"):
        monkeypatch.setattr(f"sys.{stream}.isatty", lambda: True)
    asked: list[str] = []
    for agreed in (False, True):

        def confirm(text: str, answer: bool = agreed) -> bool:
            asked.append(text)
            return answer

        monkeypatch.setattr("typer.confirm", confirm)
        assert toy.imocap(["run", "toy"]) == (0 if agreed else 1)
        assert toy.ran() == (["gather", "scale", "evaluate"] if agreed else [])
    assert asked == ["They would run with your rights. Run them?"] * 2
    assert str(toy.root / "toys" / "scale.py") in capsys.readouterr().out
