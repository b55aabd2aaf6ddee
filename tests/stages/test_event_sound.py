"""`event: true` lets the stage sync listen; without it sound is ignored."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from imocap_core.artifacts.schemas import Keypoints
from imocap_core.pipeline.action import Action, read_action
from imocap_core.pipeline.graph import settings
from imocap_core.pipeline.keys import recipe
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.workspace import Workspace
from stages import sync as stage
from tests.io.made_sound import event, recorded, write_film
from tests.report.made import Made

START_S, SECONDS, FPS = 0.6, 3.0, 30.0


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(2, frames=90)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two films of one event."""
    folder = tmp_path_factory.mktemp("event")
    sound = event(5.0, seed=2)
    videos = []
    for video, start in (("v1", 0.0), ("v2", START_S)):
        write_film(folder / f"{video}.mp4", recorded(sound, start, SECONDS, noise=0.2), SECONDS)
        videos.append({"id": video, "video": f"{video}.mp4", "keypoints": "detect"})
    (folder / "action.yaml").write_text(
        yaml.safe_dump({"name": "event", "event": True, "videos": videos})
    )
    return folder


class Given(Inputs):
    """Inputs of a stage that are there already."""

    def __init__(self, *artifacts: object) -> None:
        super().__init__("sync", {}, {type(a): a for a in artifacts})  # type: ignore[misc]


def run(action: Action, made: Made, reads: list[str]) -> stage.Sync:
    pipeline = Workspace(Path()).pipeline()
    chosen = settings(pipeline, {}, pipeline.file, [])
    videos = [v.model_copy(update={"fps": FPS}) for v in made.keypoints.videos]
    ctx = Context("sync", 7, frozenset(reads), lambda *_: None, Path(), action)  # type: ignore[arg-type]
    return stage.run(
        ctx, Given(Keypoints(videos=videos), made.initial, made.camera_motion), chosen.params
    )


@pytest.mark.long
def test_the_offset_of_the_sound_is_used_and_said(folder: Path, made: Made) -> None:
    sync = run(read_action(folder), made, ["hints", "sound"])
    np.testing.assert_allclose(sync.sound_start_s, [0.0, START_S], atol=0.5 / FPS)
    assert sync.notes[0] == "by their sound, against the beginning of v1: v2 +0.60 s"


def test_without_event_no_sound_is_read(folder: Path, made: Made) -> None:
    sync = run(replace(read_action(folder), event=None), made, ["hints", "sound"])
    assert sync.sound_start_s is None
    assert not any("sound" in note for note in sync.notes)


def test_videos_are_read_for_their_sound_only_where_they_show_one_event(folder: Path) -> None:
    pipeline, action = Workspace(Path()).pipeline(), read_action(folder)
    chosen = settings(pipeline, {}, pipeline.file, [])
    one, other = (
        recipe(pipeline, "sync", replace(action, event=declared), chosen, {})
        for declared in (True, False)
    )
    assert set(one.reads) - set(other.reads) == {f"sound {video.id}" for video in action.videos}
    assert not any(name.startswith("sound") for name in other.reads)
    assert one.key != other.key
