"""A phone's video of variable frame rate: speeds and sync are right by time stamps, and wrong at
the constant rate that its header gives."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.linalg import inv

from imocap_core.adapters.estimates import estimate_of
from imocap_core.adapters.even_moments import camera_at_used_frames, nearest_used
from imocap_core.adapters.hints import hints_of
from imocap_core.adapters.synchronisation import synchronise_joints
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.body.layouts import layout_names
from imocap_core.camera.camera_motion import static_camera
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.detection_findings import detection_findings
from imocap_core.evaluate.scoreboard import action_truth
from imocap_core.io.video import probe
from imocap_core.pipeline.action import Action, AnchorEntry, Declaration, ForbiddenEntry
from imocap_core.pipeline.stage import Context
from imocap_core.sequences import even_moments, points_at_moments
from tests.io.made_videos import write_timed
from tests.made_keypoints import write_openpose
from tests.stages.test_keypoints import run
from tests.sync.test_synchronise import PARAMS, pose_at

SIZE = (640, 360)
NAMES = layout_names("body25")
# 30 frames a second, 12 where it is dark, and every now and then one is dropped
STEPS = np.r_[np.full(40, 1 / 30), np.full(14, 1 / 12), np.full(30, 1 / 30)]
STEPS[[7, 19, 61]] *= 2
TIME_S = np.r_[0.0, np.cumsum(STEPS)]
SPEED_PX_S = 90.0


def joints_at(time_s):
    """24 joints (T, 24, 3) of a known motion, metres."""
    pose = pose_at(time_s)
    return np.concatenate([pose, 0.9 * pose[:, ::-1]], axis=1)


def pixels_at(time_s):
    """Its joints in the picture of someone who walks past at constant speed."""
    xy = np.full((len(time_s), 25, 2), np.nan)
    for column, name in enumerate(NAMES):
        if name in SMPL_JOINTS:
            xy[:, column] = 40 * joints_at(time_s)[:, SMPL_JOINTS.index(name), :2]
    return xy + np.stack([100 + SPEED_PX_S * time_s, 180 + 0 * time_s], axis=-1)[:, None]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The video and its detections, frame by frame."""
    folder = tmp_path_factory.mktemp("phone")
    write_timed(folder / "phone.mp4", TIME_S, SIZE)
    xy = pixels_at(TIME_S)
    people = np.nan_to_num(np.concatenate([xy, 0.9 * np.isfinite(xy[..., :1])], axis=-1))
    write_openpose(folder / "keypoints" / "v1", people[:, None])
    return folder


def by_stamps(folder, **changes):
    return run(folder, video="phone.mp4", fps=None, size=None, **changes)


@pytest.fixture(scope="module")
def read(folder):
    return by_stamps(folder)


def hips_x(xy_px):
    return np.nanmean(xy_px[:, [NAMES.index("left_hip"), NAMES.index("right_hip")], 0], axis=1)


def test_speeds_are_those_of_the_action(folder, read):
    """By time stamps to a hundredth of the walker's speed; at the mean rate a fifth is wrong."""
    wrong = run(folder, fps=probe(folder / "phone.mp4").fps)
    error = read.fps * np.diff(hips_x(read.xy_px) - hips_x(pixels_at(read.time_s)))
    assert np.abs(error).max() < 0.01 * SPEED_PX_S
    assert read.fps == pytest.approx(30)
    true = np.diff(hips_x(pixels_at(TIME_S))) / STEPS
    assert np.median(np.abs(wrong.fps * np.diff(hips_x(wrong.xy_px)) - true)) > 0.2 * SPEED_PX_S


def test_frames_stay_those_of_the_source(read):
    assert (np.diff(read.frames) >= 0).all()
    assert (read.frames[0], read.frames[-1]) == (0, len(TIME_S) - 1)
    apart = np.abs(TIME_S[read.frames] - read.time_s)
    assert (apart <= np.abs(TIME_S[:, None] - read.time_s).min(axis=0) + 1e-4).all()
    np.testing.assert_allclose(read.seconds_of(np.arange(len(TIME_S))), TIME_S, atol=0.02)
    (finding,) = detection_findings([read])
    assert finding.text.startswith("the frame rate varies (12 to 30 frames/s)")
    assert not finding.serious


def test_a_part_of_constant_rate_is_read_frame_by_frame(folder):
    read = by_stamps(folder, frames=(41, 53))
    np.testing.assert_allclose(read.source_frames, np.arange(41, 53), atol=1e-6)
    np.testing.assert_allclose(read.time_s, TIME_S[41:53], atol=1e-4)
    assert read.fps == pytest.approx(12, rel=1e-3)


def matched(joints, fps, time_s):
    """Mean error of the matches with a video of constant rate that began 0.3 s earlier, ms."""
    noise = np.random.default_rng(2)
    reference = joints_at(np.arange(100) / 30) + 0.02 * noise.normal(size=(100, 24, 3))
    sync = synchronise_joints(
        [reference, joints], ["a", "b"], [30.0, fps], replace(PARAMS, max_rate=2.0),
        np.random.default_rng(0), reference="a",
    )  # fmt: skip
    error_s = sync.maps[1].reference_frame / 30 - (time_s + 0.3)
    return 1000 * float(np.nanmean(np.abs(error_s)))


@pytest.mark.long
def test_sync_is_right_by_time_stamps():
    """15 ms instead of 33."""
    joints = joints_at(0.3 + TIME_S)
    joints += 0.02 * np.random.default_rng(3).normal(size=joints.shape)
    moments = even_moments(TIME_S)
    by_times = points_at_moments(joints, moments, TIME_S)
    mean_fps = len(TIME_S) / (TIME_S[-1] + STEPS[-1])
    right, wrong = matched(by_times, moments.fps, moments.time_s), matched(joints, mean_fps, TIME_S)
    assert right < 20
    assert right < 0.6 * wrong


def test_a_camera_is_known_between_frames(read):
    """A pan of constant speed is one at even moments too."""
    angle = 0.2 * TIME_S
    c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    R = np.moveaxis(np.array([[c, o, s], [o, o + 1, o], [-s, o, c]]), -1, 0)
    still = static_camera(len(TIME_S), SIZE, 500.0, 1.0)
    pan = replace(still, R_first_from_frame=R, H_first_from_frame=still.K @ R @ inv(still.K))
    at = camera_at_used_frames(pan, read)
    turned = np.arctan2(at.R_first_from_frame[:, 0, 2], at.R_first_from_frame[:, 0, 0])
    np.testing.assert_allclose(turned, 0.2 * read.time_s, atol=1e-4)
    exact = still.K @ at.R_first_from_frame @ inv(still.K)
    assert np.abs(at.H_first_from_frame / exact[:, 2:, 2:] - exact / exact[:, 2:, 2:]).max() < 0.1
    assert len(nearest_used(read)) == len(TIME_S)


def test_truth_is_sampled_at_the_moments(folder, read):
    np.savez(
        folder / "truth.npz", **{"v1/joints": joints_at(TIME_S), "v1/phase": TIME_S},
        joint_names=np.array(SMPL_JOINTS),
    )  # fmt: skip
    truth = action_truth(folder, folder / "truth.npz", Keypoints(videos=[read])).videos["v1"]
    np.testing.assert_allclose(truth.phase, read.time_s, atol=1e-4)
    np.testing.assert_allclose(truth.joints, joints_at(read.time_s), atol=0.005)


def test_a_reference_of_the_source_frames_is_used_at_the_moments(folder):
    """An estimator's joints, frame by frame, are between frames where the keypoints are."""
    np.savez(folder / "est.npz", joints=joints_at(TIME_S), joint_names=np.array(SMPL_JOINTS))
    read = by_stamps(folder, initial="est.npz", initial_format="joints_npz")
    declared = Declaration(id="v1", keypoints="keypoints/v1", video="phone.mp4",
                           initial="est.npz", initial_format="joints_npz")  # fmt: skip
    context = Context(
        stage="initial_smpl", seed=0, reads=frozenset(("initial",)), progress=lambda share, what: 0,
        report=folder, _action=Action(folder, "made", (declared,)),
    )  # fmt: skip
    still = torch.eye(3, dtype=torch.float64).expand(len(read.frames), 3, 3)
    estimate = estimate_of(context, read, still)
    np.testing.assert_allclose(estimate, joints_at(read.time_s), atol=0.005)


def test_anchors_are_at_the_nearest_moment(read):
    """They are source frames in action.yaml."""
    other = read.model_copy(update={"id": "v2"})
    hints = hints_of(
        [AnchorEntry(v1=50, v2=20)],
        [ForbiddenEntry(video="v1", frames=(0, 10))],
        Keypoints(videos=[read, other]),
        "action.yaml",
    )
    (anchor,) = hints.anchors
    assert abs(read.time_s[anchor.frame_a] - TIME_S[50]) < 0.5 / read.fps
    assert abs(read.time_s[round(anchor.frame_b)] - TIME_S[20]) < 0.5 / read.fps
    ((_, first, stop),) = hints.forbidden
    assert first == 0
    assert read.source_frames[stop - 1] < 10 <= read.source_frames[stop] + 0.5
