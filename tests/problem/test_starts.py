"""From stored keypoints to the lifter's joints, and from these to starts of a fit."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.lifter.measure import LifterRow, markdown, write_table
from imocap_core.adapters.monocular import lifted_joints, starts
from imocap_core.artifacts.schemas import VideoCameraMotion, VideoKeypoints
from imocap_core.body import load_free_body
from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics.position import pa_mpjpe_mm, root_relative
from imocap_core.motion.monocular.starts import make_library
from imocap_core.motion.observations import Observation
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body
from imocap_core.params import InitialSmplParams
from tests.made_keypoints import made_keypoints
from tests.pipeline.test_people import figure

FRAMES = 60


def seen(layout: str = "coco17") -> tuple[VideoKeypoints, VideoCameraMotion]:
    """A made person in a picture of 1280 x 720, missing for a while."""
    xy = figure(1, 0.4, 640, 420)[..., :2]
    xy[20:24] = np.nan
    trust = np.isfinite(xy).all(-1) * 0.9
    video = made_keypoints(np.arange(FRAMES), layout, size=(1280, 720), xy_px=xy, confidence=trust)
    eye = np.repeat(np.eye(3)[None], FRAMES, 0)
    camera = VideoCameraMotion(
        id="v1", K=np.array([[1280.0, 0, 640], [0, 1280.0, 360], [0, 0, 1]]),
        focal_source="assumed", motion="static", note="", residual_px=0.0, H_first_from_frame=eye,
        R_first_from_frame=eye, inliers=np.zeros(FRAMES, int), xy_first_px=xy,
        zoom=np.ones(FRAMES),
    )  # fmt: skip
    return video, camera


def test_the_starts_are_where_the_lifter_says_and_where_the_person_is_seen() -> None:
    video, camera = seen()
    lifted = lifted_joints(video, camera)
    assert lifted is not None
    body, prior = Body.of(load_free_body(), "coco17"), load_pose_prior()
    library = make_library(body, prior, np.random.default_rng(0), poses=800, directions=2)
    observation = Observation(video.xy_px, video.confidence, camera.K, 30.0, noise_share=0.01)
    options = InitialSmplParams(starts=1)
    found = starts(body, library, observation, None, lifted, lifted.joints[::-1].copy(), options)
    assert len(found) == 4  # the lifter's motion and its alternative, the detector's, the library's
    posed = body.model.shape(found[0].trans.new_zeros(1, 10)).pose(found[0].R_local, found[0].trans)
    pair = (
        root_relative(x, SMPL_JOINTS, EVAL_12)
        for x in (posed.keypoints(body.joints).numpy(), lifted.joints)
    )
    assert pa_mpjpe_mm(*pair) < 150
    points = posed.keypoints(body.keypoints).numpy() @ camera.K.T
    away = np.linalg.norm(points[..., :2] / points[..., 2:] - video.xy_px, axis=-1)
    assert np.nanmedian(away) < 0.15 * 420


def test_nobody_and_hands_alone_are_not_lifted() -> None:
    video, camera = seen()
    nobody = camera.model_copy(update={"xy_first_px": np.full_like(camera.xy_first_px, np.nan)})
    assert lifted_joints(video, nobody) is None
    assert lifted_joints(*seen("left_hand21")) is None


def test_the_table_has_a_row_an_action(tmp_path: Path) -> None:
    numbers = {"mpjpe_mm": 101.26, "mpjpe_scaled_mm": 99.0, "pa_mpjpe_mm": 71.0}
    rows = [LifterRow("trials", "generic", "walk", numbers, 70.0, 0.31)]
    text = write_table(rows, tmp_path / "lifter").read_text(encoding="utf-8")
    assert text == markdown(rows)
    assert "| trials | generic | walk | 101.3 | 99.0 | 71.0 | 70.0 | 0.31 |" in text


@pytest.mark.parametrize("layout", ["coco17"])
def test_the_answer_looks_like_the_truth(layout: str) -> None:
    """A pose of the prior from its 2D alone: nearer than any unrelated pose (about 200 mm)."""
    video, camera = seen(layout)
    lifted = lifted_joints(video, camera)
    assert lifted is not None
    assert 0.02 < float(lifted.sigma_m.mean()) < 0.5
    # in the picture, the lifted joints stand where the detections are
    for name in ("left_wrist", "right_wrist", "left_ankle", "right_ankle"):
        column = ("left_wrist", "right_wrist", None, None, None, None, "left_ankle", "right_ankle")
        at = 9 + column.index(name)
        x = lifted.joints[:, SMPL_JOINTS.index(name), :2]
        x = x - lifted.joints[
            :, [SMPL_JOINTS.index("left_hip"), SMPL_JOINTS.index("right_hip")], :2
        ].mean(1)
        y = video.xy_px[:, at] - video.xy_px[:, [11, 12]].mean(1)
        known = np.isfinite(y).all(-1)
        scale = 1.7 / 420
        assert np.median(np.linalg.norm(x[known] - scale * y[known], axis=-1)) < 0.15
