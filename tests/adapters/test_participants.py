"""The joint motion's inputs and the way back: mirrored and excluded videos of a made scene."""

import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.adapters.participants import (
    Participants,
    known_mirrors,
    mirrored_camera,
    mirrored_detections,
    mirrored_keypoints,
    mirrored_motion,
    participants_of,
)
from imocap_core.artifacts.schemas import Camera
from imocap_core.conventions import SMPL_JOINTS
from tests.report.made import K, Made


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=4, frames=24)


def participants(made: Made, **decided: list[str]) -> Participants:
    sync = made.sync.model_copy(update=decided)
    return participants_of(made.keypoints, made.camera_motion, made.initial, sync, made.model)


def test_a_file_that_is_shown_in_a_mirror_is_mirrored_unless_declared(made: Made) -> None:
    first, *others = made.keypoints.videos
    shown = first.model_copy(update={"mirrored": True})
    keypoints = made.keypoints.model_copy(update={"videos": [shown, *others]})
    nothing = {video.id: None for video in keypoints.videos}
    assert known_mirrors(nothing, keypoints) == [True, None, None, None]
    declared = {**nothing, first.id: False, others[0].id: True}
    assert known_mirrors(declared, keypoints) == [False, True, None, None]


def test_without_anything_to_do_nothing_is_done(made: Made) -> None:
    work = participants(made)
    assert work.keypoints.videos == made.keypoints.videos
    assert work.initial.videos == made.initial.videos
    assert work.as_filmed(made.single) is made.single


def test_a_reflected_motion_is_the_reflection_of_its_joints(made: Made) -> None:
    motion = made.true[1]
    turned = mirrored_motion(motion, made.model)
    posed = made.model.shape(torch.as_tensor(turned.betas)).pose(
        rotations.exp(torch.as_tensor(turned.theta.reshape(-1, 24, 3))),
        torch.as_tensor(turned.trans),
    )
    assert np.abs(posed.joints.numpy() - turned.joints).max() < 0.004  # the body is nearly even
    left, right = (SMPL_JOINTS.index(f"{side}_wrist") for side in ("left", "right"))
    np.testing.assert_array_equal(turned.joints[:, left, 0], -motion.joints[:, right, 0])
    back = mirrored_motion(turned, made.model)
    np.testing.assert_allclose(back.theta, motion.theta, atol=1e-12)
    np.testing.assert_allclose(back.trans, motion.trans, atol=1e-12)


def test_reflected_detections_are_where_the_reflected_joints_are(made: Made) -> None:
    video, camera = made.keypoints.videos[0], made.camera_motion.videos[0]
    turned = mirrored_keypoints(video, K)
    back = mirrored_keypoints(turned, K)
    np.testing.assert_allclose(back.xy_px, video.xy_px, atol=1e-9)
    np.testing.assert_allclose(back.person_box_px, video.person_box_px, atol=1e-9)
    assert (turned.person_box_px[:, 0] <= turned.person_box_px[:, 2]).all()
    warped = mirrored_detections(camera, video.layout)
    np.testing.assert_array_equal(warped.xy_first_px, turned.xy_px)


def test_a_reflected_camera_films_the_reflected_world() -> None:
    R = rotations.exp(torch.tensor([0.3, -0.5, 0.2], dtype=torch.float64)).numpy()
    camera = Camera(id="a", K=K, R=R, t=np.array([0.1, 0.2, 3.0]))
    turned = mirrored_camera(camera)
    point, S = np.array([0.4, -0.3, 1.0]), np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(np.linalg.det(turned.R), 1.0)
    np.testing.assert_allclose(turned.R @ (S * point) + turned.t, S * (R @ point + camera.t))


def test_excluded_videos_stay_out_and_keep_their_monocular_motion(made: Made) -> None:
    work = participants(made, excluded=["v2"])
    assert [v.id for v in work.keypoints.videos] == ["v1", "v3", "v4"]
    assert work.sync(made.sync).ids == ["v1", "v3", "v4"]
    part = made.single.model_copy(
        update={
            "videos": [v for v in made.single.videos if v.id != "v2"],
            "cameras": [c for c in made.single.cameras if c.id != "v2"],
        }
    )
    whole = work.as_filmed(part)
    assert [v.id for v in whole.videos] == [c.id for c in whole.cameras] == made.ids
    np.testing.assert_array_equal(whole.videos[1].theta, made.initial.videos[1].theta)
    np.testing.assert_array_equal(whole.cameras[1].R, np.eye(3))


def test_cameras_come_back_into_the_world_of_the_joint_motion(made: Made) -> None:
    work = participants(made, mirrored=["v2"], excluded=["v4"])
    solved = made.single.model_copy(
        update={"videos": made.single.videos[:3], "cameras": made.single.cameras[:3]}
    )
    back = work.cameras(work.as_filmed(solved).cameras)
    assert [c.id for c in back] == ["v1", "v2", "v3"]
    for camera, before in zip(back, solved.cameras, strict=True):
        np.testing.assert_allclose(camera.R, before.R, atol=1e-12)
        np.testing.assert_allclose(camera.t, before.t, atol=1e-12)


def test_joints_and_covariances_come_back_as_filmed(made: Made) -> None:
    work = participants(made, mirrored=["v2"], excluded=["v4"])
    solved = [v.joints for v in work.initial.videos]
    for joints, filmed in zip(work.filmed_joints(solved), made.initial.videos, strict=True):
        np.testing.assert_allclose(joints, filmed.joints, atol=1e-12)
    spread = np.random.default_rng(0).normal(size=(5, 24, 3, 3))
    assert work.filmed_covariance("v1", spread) is spread
    turned = work.filmed_covariance("v2", spread)
    np.testing.assert_array_equal(work.filmed_covariance("v2", turned), spread)
    left, right = (SMPL_JOINTS.index(f"{side}_wrist") for side in ("left", "right"))
    S = np.diag([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(turned[:, left], S @ spread[:, right] @ S)
