"""imocap view: one page from an action's artifacts, written once, and faults in a sentence."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from imocap_core.artifacts.schemas import InitialSmpl, RefineSync, SyncSummary
from imocap_core.cli import main
from tests.pipeline.stored import publish
from tests.report.made import FPS, LAYOUT, SIZE, Made

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, made_small: Made) -> Path:
    """A folder with one action and the artifacts that its page needs."""
    action = tmp_path / "actions" / "waving"
    action.mkdir(parents=True)
    videos = [
        {"id": v, "keypoints": v, "layout": LAYOUT, "fps": FPS, "size": list(SIZE)}
        for v in made_small.ids
    ]
    (action / "action.yaml").write_text(yaml.safe_dump({"name": "waving", "videos": videos}))
    for v in made_small.ids:
        (action / v).write_text("keypoints")
    for stage, artifact in (
        ("keypoints", made_small.keypoints),
        ("camera_motion", made_small.camera_motion),
        ("initial_smpl", made_small.initial),
        ("refine_sync", summarised(made_small.refined)),
    ):
        publish(tmp_path, "waving", stage, artifact)
    return tmp_path


def summarised(refined: RefineSync) -> RefineSync:
    """As the stage makes it: its rounds without the matrices."""
    fields, rounds = SyncSummary.model_fields, refined.rounds
    syncs = [SyncSummary(**{f: getattr(r.sync, f) for f in fields}) for r in rounds]
    rounds = [r.model_copy(update={"sync": s}) for r, s in zip(rounds, syncs, strict=True)]
    return refined.model_copy(update={"rounds": rounds})


@pytest.fixture(scope="session")
def made_small() -> Made:
    return Made(count=2, frames=6)


@pytest.fixture
def imocap(folder, capsys):
    def call(*words: str) -> tuple[int, str]:
        code = main(["--root", str(folder), *words])
        shown = capsys.readouterr()
        return code, shown.out + shown.err

    return call


def test_the_page_is_written_once(folder: Path, imocap: Callable[..., tuple[int, str]]) -> None:
    file = folder / "artifacts" / "waving" / "report" / "viewer.html"
    code, message = imocap("view", "waving")
    assert code == 0
    assert f"The viewer of waving is {file}" in message
    assert "already" not in message
    before = file.stat().st_mtime_ns
    assert "already up to date" in imocap("view", "waving")[1]
    assert file.stat().st_mtime_ns == before
    assert "already" not in imocap("view", "waving", "--small")[1]  # other pictures
    assert str(folder) not in file.read_text(encoding="utf-8")


def test_it_is_written_anew_when_the_result_has_changed(folder, imocap, made_small):
    assert imocap("view", "waving")[0] == 0
    other = made_small.initial.model_copy(update={"source": {"v1": "hmr2", "v2": "hmr2"}})
    publish(folder, "waving", "initial_smpl", other)
    code, message = imocap("view", "waving")  # the motion was made from another one
    assert code == 1
    assert "refine_sync: input: initial_smpl has changed" in message
    assert message.endswith("Bring them up to date: imocap run waving\n")
    publish(folder, "waving", "refine_sync", summarised(made_small.refined))
    code, message = imocap("view", "waving")
    assert code == 0
    assert "already" not in message


def test_a_page_that_breaks_off_is_written_again(folder, imocap):
    file = folder / "artifacts" / "waving" / "report" / "viewer.html"
    assert imocap("view", "waving")[0] == 0
    whole = file.read_bytes()
    file.write_bytes(whole[:5000])
    code, message = imocap("view", "waving")
    assert code == 0
    assert "already" not in message
    assert file.read_bytes() == whole


def test_out_says_where(folder: Path, imocap: Callable[..., tuple[int, str]]) -> None:
    file = folder / "shown" / "here.html"
    code, message = imocap("view", "waving", "--out", str(file))
    assert code == 0
    assert str(file) in message
    assert file.read_text(encoding="utf-8").startswith("<!doctype html>")
    file.write_text("<!doctype html>mine</html>")
    code, message = imocap("view", "waving", "--out", str(file))
    assert code == 1
    assert "here.html exists and is no viewer; choose another name with --out" in message
    assert file.read_text() == "<!doctype html>mine</html>"
    code, message = imocap("view", "waving", "--out", str(folder))
    assert code == 2
    assert "expected the name of an .html file" in message


def test_artifacts_of_other_frames_are_refused(folder, imocap, made_small):
    initial: InitialSmpl = Made(count=2, frames=5).initial
    publish(folder, "waving", "initial_smpl", initial)
    publish(folder, "waving", "refine_sync", summarised(made_small.refined))
    code, message = imocap("view", "waving")
    assert code == 1
    assert "waving: its artifacts are of different frames (initial_smpl of v1, v2); run" in message
    assert "Traceback" not in message


def test_a_broken_artifact_is_named(folder: Path, imocap: Callable[..., tuple[int, str]]) -> None:
    (folder / "artifacts" / "waving" / "refine_sync.mcap").write_bytes(b"nonsense")
    code, message = imocap("view", "waving")
    assert code == 1
    assert "refine_sync.mcap" in message
    assert "run it with: imocap run waving" in message


def test_open_shows_the_page_in_the_browser(folder, imocap, monkeypatch):
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda page: bool(opened.append(page)) or True)
    code, text = imocap("view", "waving", "--open")
    assert code == 0
    assert "open it in a browser" not in text
    assert opened == [(folder / "artifacts/waving/report/viewer.html").resolve().as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda page: False)
    code, text = imocap("view", "waving", "--open")
    assert code == 1
    assert "no browser could be started; open " in text
