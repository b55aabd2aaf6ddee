"""The stage on a made scene: hands where there are keypoints of hands, else nothing at once."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from imocap_core.artifacts.schemas import (
    CameraMotion,
    HandKeypoints,
    Hands,
    Keypoints,
    RefineSync,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import load_free_body
from imocap_core.evaluate.action_scores import hand_rows
from imocap_core.io.truth import Truth, VideoTruth
from imocap_core.params import Params
from imocap_core.report.tables import hand_tables
from imocap_core.rotations import exp
from stages.hands import run
from tests.report.made import K, Made

PARAMS = Params()
MODEL = load_free_body(hands=True)


def handed(*given: Any, device: str = "cpu") -> Hands:
    by_kind = {type(artifact): artifact for artifact in given}
    context = SimpleNamespace(progress=lambda share, said: None, device=device)
    return run(context, SimpleNamespace(get=lambda kind: by_kind[kind]), PARAMS)  # type: ignore[arg-type]


def points_of(motion: VideoMotion) -> np.ndarray:
    """(T, 2, 21, 3) of the motion's hands with fingers at rest, camera axes."""
    local = exp(torch.as_tensor(motion.theta).reshape(-1, 24, 3))[:, :22]
    rest = torch.eye(3, dtype=torch.float64).expand(len(local), 30, 3, 3)
    posed = MODEL.shape(torch.as_tensor(motion.betas)).pose(
        torch.cat([local, rest], 1), torch.as_tensor(motion.trans)
    )
    hands = [posed.keypoints(MODEL.points(f"{side}_hand21")) for side in ("left", "right")]
    return torch.stack(hands, 1).numpy()


def seen(video: VideoKeypoints, motion: VideoMotion) -> VideoKeypoints:
    h = points_of(motion) @ K.T
    confidence = np.ones(h.shape[:3])
    confidence[3, 0] = 0.0
    hands = HandKeypoints(xy_px=h[..., :2] / h[..., 2:], confidence=confidence)
    return video.model_copy(update={"hands": hands})


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=2, frames=10)


@pytest.fixture(scope="module")
def inputs(made: Made) -> tuple[Keypoints, CameraMotion, RefineSync]:
    videos = zip(made.keypoints.videos, made.refined.motion.videos, strict=True)
    return Keypoints(videos=[seen(*v) for v in videos]), made.camera_motion, made.refined


def test_without_keypoints_of_hands_there_is_nothing(made: Made) -> None:
    found = handed(made.keypoints, made.camera_motion, made.refined)
    assert found.videos == []
    assert hand_rows("after loop", found, None) == []
    assert hand_tables([]) == []


def test_hands_that_rest_are_found_resting_and_scored(inputs, made):
    found = handed(*inputs)
    assert [v.id for v in found.videos] == made.ids
    assert found.size == pytest.approx(1.0, abs=0.02)
    truths = {}
    for hands, motion in zip(found.videos, made.refined.motion.videos, strict=True):
        true = points_of(motion)
        assert np.linalg.norm(hands.points_m - true, axis=-1).mean() < 0.006
        assert hands.fingers.shape == (10, 2, 15, 3)
        assert hands.visible.sum() == 19
        truths[hands.id] = VideoTruth(None, (), None, np.eye(3), None, None, None, true)
    rows = hand_rows("after loop", found, Truth(truths, None))
    values = {(r.video, r.metric): r.value for r in rows}
    assert all(0 < (values[i, "hand_mpjpe_mm"] or 0) < 5 for i in made.ids)
    assert values["v1", "hand_seen_share"] == pytest.approx(0.95)
    assert len(hand_tables(rows)[0].rows) == 2


@pytest.mark.long
def test_an_excluded_video_has_hands_of_its_own(inputs, made):
    sync = made.refined.sync.model_copy(update={"excluded": ["v2"]})
    found = handed(*inputs[:2], made.refined.model_copy(update={"sync": sync}))
    assert [v.id for v in found.videos] == made.ids
    assert np.isfinite(found.videos[1].points_m).all()
