"""The joint motion decides again which videos take part and which are mirrored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from imocap_core.adapters.loop_sync import decided_again
from imocap_core.adapters.participants import mirrored_keypoints
from imocap_core.adapters.synchronisation import evidence_of
from imocap_core.artifacts.schemas import Keypoints, SyncSummary
from imocap_core.motion.state import mirrored_joints
from imocap_core.params import SyncParams
from imocap_core.sync import screened
from imocap_core.sync.screening.screening import Screening, corrected, sentences
from tests.report.made import K, Made

FRAMES = 50


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=4, frames=FRAMES)


def first_of(made: Made, **decided: list[str]) -> SyncSummary:
    first = SyncSummary.model_validate({n: getattr(made.sync, n) for n in SyncSummary.model_fields})
    return first.model_copy(update=decided)


def again(
    made: Made,
    first: SyncSummary,
    joints: list[np.ndarray] | None = None,
    keypoints: Keypoints | None = None,
    declared: list[bool | None] | None = None,
) -> SyncSummary | None:
    joints = joints or [motion.joints for motion in made.true]
    evidence = evidence_of(joints, keypoints or made.keypoints, SyncParams())
    evidence = replace(evidence, mirrored=declared or [None] * 4, rates=np.ones(4))
    return decided_again(first, screened(evidence, SyncParams()))


def test_nothing_changes_where_the_first_screening_was_right(made: Made) -> None:
    assert again(made, first_of(made)) is None


def test_a_video_that_the_joint_motion_explains_takes_part_again(made: Made) -> None:
    notes = [
        "v1 stands still",
        "v3 seems to show another action: the other videos explain each other and not it",
        "v4 seems to show another action: the other videos explain each other and not it",
        "only two videos are left, and with two it cannot be decided",
    ]
    decided = again(made, first_of(made, excluded=["v3", "v4"], notes=notes))
    assert decided is not None
    assert decided.excluded == []
    assert [note.split(" ", 1)[0] for note in decided.notes] == ["v1", "v3", "v4"]
    assert all(note.endswith("explains it: it takes part") for note in decided.notes[1:])


def test_a_video_of_another_action_is_left_out(made: Made) -> None:
    stranger = made.keypoints.videos[3]
    rng = np.random.default_rng(2)
    away = gaussian_filter1d(rng.normal(0, 400.0, stranger.xy_px.shape), 6.0, axis=0)
    xy_px = stranger.xy_px + away - away.mean(axis=(0, 1))
    videos = [*made.keypoints.videos[:3], stranger.model_copy(update={"xy_px": xy_px})]
    decided = again(made, first_of(made), keypoints=Keypoints(videos=videos))
    assert decided is not None
    assert decided.excluded == ["v4"]
    assert decided.notes[-1].startswith("v4 seems to show another action")
    assert again(made, first_of(made, excluded=["v4"]), keypoints=Keypoints(videos=videos)) is None


def test_a_mirrored_video_is_found_and_a_declared_one_left_alone(made: Made) -> None:
    videos = list(made.keypoints.videos)
    videos[2] = mirrored_keypoints(videos[2], K)
    joints = [motion.joints for motion in made.true]
    joints[2] = mirrored_joints(joints[2])
    decided = again(made, first_of(made), joints, Keypoints(videos=videos))
    assert decided is not None
    assert (decided.mirrored, decided.excluded) == (["v3"], [])
    assert "better reflected: treated as its mirror image" in decided.notes[-1]
    straight = again(made, first_of(made, mirrored=["v3"]))
    assert straight is not None
    assert straight.mirrored == []
    assert straight.notes[-1].startswith("v3 at first seemed to be mirrored")
    assert again(made, first_of(made, mirrored=["v3"]), declared=[None, None, True, None]) is None


def test_sentences_of_what_stays_decided_stay() -> None:
    margin, names = np.array([-0.5, 0.4, -0.5, -0.5]), ["v1", "v2", "v3", "v4"]
    screening = Screening((2,), (1,), (2,), (1,), np.array([0.1, 0.2, 1.4, 0.3]), margin, (3,))
    left_out, mirrored, undecided = sentences(screening, names)
    before, nothing = [left_out, mirrored, undecided, "v2 stands still"], list[str]()

    def after(changed: str, second: list[str]) -> list[str]:
        return corrected(before, second, changed=[changed], returned=nothing, straight=nothing)

    assert after("v3", nothing) == [mirrored, undecided, "v2 stands still"]
    assert after("v2", nothing) == [left_out, undecided, "v2 stands still"]
    assert after("v4", [left_out, "v4 seems to show another action: it does"]) == [
        left_out, mirrored, "v2 stands still", "v4 seems to show another action: it does",
    ]  # fmt: skip
