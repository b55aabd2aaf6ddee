"""The joint motion's inputs and the way back: mirrored and excluded videos of a made scene."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.artifacts.schemas import Camera, SyncMap, VideoMotion
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.problem.mirroring import (
    JointWork,
    joint_work,
    mirrored_camera,
    mirrored_detections,
    mirrored_keypoints,
    mirrored_motion,
)
from tests.report.made import K, Made


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=4, frames=24)


def work_of(made: Made, **decided: list[str]) -> JointWork:
    sync = made.sync.model_copy(update=decided)
    return joint_work(made.keypoints, made.camera_motion, made.initial, sync, made.model)


def test_without_anything_to_do_nothing_is_done(made: Made) -> None:
    work = work_of(made)
    assert work.keypoints.videos == made.keypoints.videos
    assert work.initial.videos == made.initial.videos
    assert work.out(made.single) is made.single


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
    seen, camera = made.keypoints.videos[0], made.camera_motion.videos[0]
    turned = mirrored_keypoints(seen, K)
    back = mirrored_keypoints(turned, K)
    np.testing.assert_allclose(back.xy_px, seen.xy_px, atol=1e-9)
    np.testing.assert_allclose(back.person_box_px, seen.person_box_px, atol=1e-9)
    assert (turned.person_box_px[:, 0] <= turned.person_box_px[:, 2]).all()
    warped = mirrored_detections(camera, seen.layout)
    np.testing.assert_array_equal(warped.xy_first_px, turned.xy_px)


def test_a_reflected_camera_films_the_reflected_world() -> None:
    R = rotations.exp(torch.tensor([0.3, -0.5, 0.2], dtype=torch.float64)).numpy()
    camera = Camera(id="a", K=K, R=R, t=np.array([0.1, 0.2, 3.0]))
    turned = mirrored_camera(camera)
    point, S = np.array([0.4, -0.3, 1.0]), np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(np.linalg.det(turned.R), 1.0)
    np.testing.assert_allclose(turned.R @ (S * point) + turned.t, S * (R @ point + camera.t))


def test_excluded_videos_stay_out_and_keep_their_monocular_motion(made: Made) -> None:
    work = work_of(made, excluded=["v2"])
    assert [v.id for v in work.keypoints.videos] == ["v1", "v3", "v4"]
    assert work.sync_in(made.sync).ids == ["v1", "v3", "v4"]
    part = made.single.model_copy(
        update={
            "videos": [v for v in made.single.videos if v.id != "v2"],
            "cameras": [c for c in made.single.cameras if c.id != "v2"],
        }
    )
    whole = work.out(part)
    assert [v.id for v in whole.videos] == [c.id for c in whole.cameras] == made.ids
    np.testing.assert_array_equal(whole.videos[1].theta, made.initial.videos[1].theta)
    np.testing.assert_array_equal(whole.cameras[1].R, np.eye(3))


def test_a_mirrored_video_is_recovered_as_unmirrored() -> None:
    made, flipped = Made(count=3, frames=12), Made(count=3, frames=12)
    straight = solve(made, [])
    v = 2
    flipped.keypoints.videos[v] = mirrored_keypoints(made.keypoints.videos[v], K)
    flipped.camera_motion.videos[v] = mirrored_detections(made.camera_motion.videos[v], "body25")
    flipped.initial.videos[v] = mirrored_motion(made.initial.videos[v], made.model)
    found = solve(flipped, [made.ids[v]])
    wanted = [m.joints for m in straight]
    wanted[v] = mirrored_motion(straight[v], made.model).joints
    for motion, joints in zip(found, wanted, strict=True):
        assert float(np.linalg.norm(motion.joints - joints, axis=-1).mean()) < 0.003
    # and it stays the mirror image that was filmed
    across = found[v].joints[:, SMPL_JOINTS.index("left_hip")] - straight[v].joints[:, 1]
    assert np.linalg.norm(across, axis=-1).mean() > 0.05


def solve(made: Made, mirrored: list[str]) -> list[VideoMotion]:
    """Every video's motion after one pass of the joint motion, as filmed."""
    from imocap_core.motion.multiview.joint import recover_motion
    from imocap_core.params import Params
    from imocap_core.problem.motion import (
        body_for,
        observations_of,
        scene_of,
        smpl_ba_of,
        state_of,
    )

    params = Params()
    maps = [
        SyncMap(
            id=i,
            reference_frame=np.where(f <= made.frames[0][-1], f.astype(float), np.nan),
            confidence=(f <= made.frames[0][-1]).astype(float),
        )
        for i, f in zip(made.ids, made.frames, strict=True)
    ]
    sync = made.sync.model_copy(update={"mirrored": mirrored, "maps": maps})
    body = body_for(made.keypoints)
    work = joint_work(made.keypoints, made.camera_motion, made.initial, sync, body.model)
    observations = observations_of(body, work.keypoints, work.camera_motion, params.fit)
    motion = recover_motion(
        scene_of(body, observations, work.sync_in(sync), params.fit),
        state_of(work.initial.videos),
        params.motion,
    )
    whole = work.out(smpl_ba_of(body, motion, observations, work.keypoints, sync.reference))
    return whole.videos


def test_cameras_come_back_into_the_world_of_the_joint_motion(made: Made) -> None:
    work = work_of(made, mirrored=["v2"], excluded=["v4"])
    found = made.single.model_copy(
        update={"videos": made.single.videos[:3], "cameras": made.single.cameras[:3]}
    )
    back = work.cameras_in(work.out(found).cameras)
    assert [c.id for c in back] == ["v1", "v2", "v3"]
    for camera, before in zip(back, found.cameras, strict=True):
        np.testing.assert_allclose(camera.R, before.R, atol=1e-12)
        np.testing.assert_allclose(camera.t, before.t, atol=1e-12)
