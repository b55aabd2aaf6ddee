"""Anchors, forbidden spans and mirrored of action.yaml: read, checked, part of sync's key."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imocap_core.adapters.hints import hints_of
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.action import Action, AnchorEntry, ForbiddenEntry, read_action
from imocap_core.pipeline.graph import read_pipeline, settings
from imocap_core.pipeline.keys import recipe
from imocap_core.sync import Anchor
from tests.sync.test_stage import made

HEAD = """\
name: serve
videos:
  - {id: v1, keypoints: a, format: openpose, layout: body25, fps: 30, size: [64, 48]}
  - {id: v2, keypoints: a, format: openpose, layout: body25, fps: 30, size: [64, 48],
     mirrored: true}
  - {id: v3, keypoints: a, format: openpose, layout: body25, fps: 30, size: [64, 48]}
"""


def action(folder: Path, more: str) -> Action:
    (folder / "a").mkdir(exist_ok=True)
    (folder / "action.yaml").write_text(HEAD + more)
    return read_action(folder)


def test_hints_are_read(tmp_path: Path) -> None:
    found = action(
        tmp_path,
        "anchors: [{v1: 120, v2: 88, hard: true}, {v1: 130, v2: 90, v3: 95}]\n"
        "forbidden: [{video: v1, frames: [0, 40]}]\n",
    )
    assert [a.frames for a in found.anchors] == [
        {"v1": 120, "v2": 88},
        {"v1": 130, "v2": 90, "v3": 95},
    ]
    assert [a.hard for a in found.anchors] == [True, False]
    assert found.forbidden[0].frames == (0, 40)
    assert [v.mirrored for v in found.videos] == [None, True, None]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("anchors: [{v1: 1, v9: 2}]", "anchors.0: unknown video 'v9'; expected one of v1, v2, v3"),
        ("anchors: [{v1: 1}]", "expected frames of at least two videos"),
        ("anchors: [{v1: 1, v2: -4}]", "anchors.0.v2: Input should be greater than or equal to 0"),
        ("anchors: [{v1: 1, v2: 2.5}]", "anchors.0.v2: Input should be a valid integer"),
        ("anchors: [{v1: 10, v2: 20}, {v1: 30, v2: 5}]", "anchors.0 and anchors.1 contradict"),
        (
            "anchors: [{v1: 10, v2: 20}, {v1: 10, v2: 21}]",
            "contradict the order of time: v1 10 = v2 20, but",
        ),
        ("forbidden: [{video: v9, frames: [0, 4]}]", "forbidden.0: unknown video 'v9'"),
        (
            "forbidden: [{video: v1, frames: [4, 4]}]",
            "frames: expected [first, one past last], got [4, 4]",
        ),
        (
            "anchors: [{v1: 3, v2: 4}]\nforbidden: [{video: v1, frames: [0, 9]}]",
            "anchors.0: frame 3 of v1 is in the forbidden span [0, 9]",
        ),
    ],
)
def test_what_cannot_be_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(WorkFailed) as caught:
        action(tmp_path, text)
    assert said in str(caught.value)


def videos() -> Keypoints:
    _, keypoints = made(["v1", "v2"], [0.0, 0.4])
    late = keypoints.videos[1].model_copy(update={"frames": np.arange(100, 160)})
    return Keypoints(videos=[keypoints.videos[0], late])


def test_source_frames_become_used_frames() -> None:
    hints = hints_of(
        [AnchorEntry(v1=20, v2=110, hard=True)],
        [ForbiddenEntry(video="v2", frames=(90, 105))],
        videos(),
        "action.yaml",
    )
    assert hints.anchors == (Anchor(0, 20, 1, 10.0, True),)
    assert hints.forbidden == ((1, 0, 5),)


def test_hints_on_a_video_that_was_left_out_are_not_used() -> None:
    hints = hints_of(
        [AnchorEntry(v1=20, v2=110, bad=7), AnchorEntry(v1=30, bad=8)],
        [ForbiddenEntry(video="bad", frames=(0, 5))],
        videos(),
        "action.yaml",
    )
    assert hints.anchors == (Anchor(0, 20, 1, 10.0, False),)
    assert hints.forbidden == ()


def test_frames_that_are_not_used_are_named() -> None:
    with pytest.raises(ValueError, match=r"action\.yaml: anchors\.0") as caught:
        hints_of(
            [AnchorEntry(v1=20, v2=10)],
            [ForbiddenEntry(video="v1", frames=(200, 300))],
            videos(),
            "action.yaml",
        )
    said = str(caught.value)
    assert "expected a used frame of v2, 100 to 159, got 10" in said
    assert "forbidden.0: expected frames of v1 within 0 to 59, got [200, 300]" in said


def test_hints_change_the_key_of_sync_and_of_nothing_before_it(tmp_path: Path) -> None:
    pipeline = read_pipeline(Path(__file__).parents[2] / "pipeline.yaml")
    chosen = settings(pipeline, {}, tmp_path, [])
    plain, anchored = (
        action(tmp_path, more) for more in ("", "anchors: [{v1: 1, v2: 2, hard: true}]")
    )
    for stage, same in (("keypoints", True), ("initial_smpl", True), ("sync", False)):
        inputs = dict.fromkeys(pipeline.stages[stage].inputs, "x")
        one, two = (recipe(pipeline, stage, a, chosen, inputs).key for a in (plain, anchored))
        assert (one == two) is same
