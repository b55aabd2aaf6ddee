"""The stage on a made scene: what it says is complete, as filmed, and of every video."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from imocap_core.adapters.joint import solved_groups
from imocap_core.adapters.participants import (
    mirrored_camera,
    mirrored_detections,
    mirrored_keypoints,
    mirrored_motion,
)
from imocap_core.adapters.uncertainty import lasting_residual_m
from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    Uncertainty,
)
from imocap_core.biomechanics.joint_angles import ANATOMICAL_JOINTS, mirrored_rotation_covariance
from imocap_core.motion.state import mirrored_covariance
from imocap_core.params import Params
from imocap_core.pipeline.stage import Inputs
from stages.uncertainty import run
from tests.report.made import K, Made

Given = tuple[Keypoints, CameraMotion, InitialSmpl, RefineSync]
PARAMS = Params()
JOINTS = ("trunk", "left_shoulder")


def claimed(*given: Any) -> Uncertainty:
    by_kind = {type(x): x for x in (*given, Redetect(videos=[], note="made"))}
    context = SimpleNamespace(progress=lambda share, said: None, device="cpu")
    inputs = Inputs("uncertainty", {}, by_kind)
    return run(context, inputs, PARAMS)  # type: ignore[arg-type]


def artifacts(made: Made, **decided: list[str]) -> Given:
    """The made scene, its cameras where the performer is seen in one place."""
    sync = made.refined.sync.model_copy(update=decided)
    middle = np.array([0.0, 0.0, 3.0])
    cameras = [c.model_copy(update={"t": middle - c.R @ middle}) for c in made.single.cameras]
    motion = made.refined.motion.model_copy(update={"cameras": cameras})
    refined = made.refined.model_copy(update={"sync": sync, "motion": motion})
    return made.keypoints, made.camera_motion, made.initial, refined


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=3, frames=16)


@pytest.fixture(scope="module")
def plain(made: Made) -> Uncertainty:
    return claimed(*artifacts(made))


def test_every_frame_of_every_video_has_its_claims(made: Made, plain: Uncertainty) -> None:
    assert [v.id for v in plain.videos] == made.ids
    for video, frames in zip(plain.videos, made.frames, strict=True):
        np.testing.assert_array_equal(video.frames, frames)
        assert np.isfinite(video.covariance_mm2).all()
        trace = np.einsum("tjxx->tj", video.covariance_mm2)
        np.testing.assert_allclose(video.sigma_mm**2, trace, rtol=1e-4)
        split = video.depth_mm**2 + video.across_mm**2
        np.testing.assert_allclose(video.sigma_mm**2, split, rtol=1e-6)
        of_rotations = np.einsum("tjxx->tj", video.rotation_covariance_deg2)
        trunk, shoulder = (
            np.sqrt(of_rotations[:, ANATOMICAL_JOINTS.index(j)].mean()) for j in JOINTS
        )
        assert 1 < trunk < shoulder < 60
        wrist, knee = video.sigma_mm[:, 20].mean(), video.sigma_mm[:, 4].mean()
        assert 3 < knee < wrist < 500
    turn = np.diff([v.azimuth_deg for v in plain.videos])
    assert np.abs((turn + 180) % 360 - 180) == pytest.approx(np.degrees(0.7), abs=3)
    assert len(plain.viewpoints) == 8
    assert plain.near == []
    assert f"below {plain.median_mm:.0f} mm" in plain.status


def test_an_excluded_video_speaks_for_itself(made: Made, plain: Uncertainty) -> None:
    *given, refined = artifacts(made, excluded=["v3"])
    cameras = [
        c.model_copy(update={"R": np.eye(3), "t": np.zeros(3)}) if c.id == "v3" else c
        for c in refined.motion.cameras
    ]  # an excluded video is in its own camera's axes
    motion = refined.motion.model_copy(update={"cameras": cameras})
    found = claimed(*given, refined.model_copy(update={"motion": motion}))
    alone, together = found.videos[2], plain.videos[2]
    assert alone.sigma_mm.mean() > together.sigma_mm.mean()
    turn = abs((alone.azimuth_deg - together.azimuth_deg + 180) % 360 - 180)
    assert turn < 20  # by its own motion, which is nearly the others'


def test_a_mirrored_video_has_the_claims_of_its_mirror_image(made, plain):
    keypoints, camera_motion, initial, refined = artifacts(made, mirrored=["v2"])

    def second(values: list, turned: Callable[[Any], Any]) -> list:
        return [turned(x) if x.id == "v2" else x for x in values]

    motion = refined.motion.model_copy(
        update={
            "videos": second(refined.motion.videos, lambda m: mirrored_motion(m, made.model)),
            "cameras": second(refined.motion.cameras, mirrored_camera),
        }
    )
    layout, K = keypoints.videos[1].layout, camera_motion.videos[1].K
    found = claimed(
        Keypoints(videos=second(keypoints.videos, lambda v: mirrored_keypoints(v, K))),
        CameraMotion(videos=second(camera_motion.videos, lambda c: mirrored_detections(c, layout))),
        initial.model_copy(
            update={"videos": second(initial.videos, lambda m: mirrored_motion(m, made.model))}
        ),
        refined.model_copy(update={"motion": motion}),
    )
    expected = mirrored_covariance(plain.videos[1].covariance_mm2)
    scale = expected.max()
    np.testing.assert_allclose(found.videos[1].covariance_mm2, expected, atol=1e-3 * scale)
    rotations = mirrored_rotation_covariance(plain.videos[1].rotation_covariance_deg2)
    found_rotations = found.videos[1].rotation_covariance_deg2
    np.testing.assert_allclose(found_rotations, rotations, atol=1e-3 * rotations.max())
    np.testing.assert_allclose(found.videos[0].sigma_mm, plain.videos[0].sigma_mm, rtol=1e-3)


def test_one_video_alone_is_told_what_it_lacks() -> None:
    alone = Made(count=1, frames=16)
    found = claimed(*artifacts(alone))
    assert np.isfinite(found.videos[0].sigma_mm).all()
    assert max(found.viewpoints, key=lambda v: v.reduction).reduction > 0.1


def test_what_keypoints_are_off_all_through_a_video_is_measured_in_metres(made: Made) -> None:
    keypoints, cameras, *solved = artifacts(made)

    def residual_m(off_px: float) -> float:
        off = [v.model_copy(update={"xy_first_px": v.xy_first_px + off_px}) for v in cameras.videos]
        given = (keypoints, CameraMotion(videos=off), *solved, PARAMS.fit, PARAMS.motion)
        return lasting_residual_m(*solved_groups(*given))

    assert residual_m(0.0) < 0.01
    assert residual_m(5.0) == pytest.approx(5.0 / K[0, 0] * 3.0, rel=0.1)  # at 3 m
