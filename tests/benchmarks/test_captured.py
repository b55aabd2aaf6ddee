"""Captured motion as videos: frame sampling, detectors, the estimator, trials."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.synthetic.captured import (
    CAMERA_PLACEMENTS,
    COCO18,
    JOINT_INDEX,
    coco18_points,
    hip_middle,
    place_camera,
    stature_m,
    to_scene,
)
from benchmarks.synthetic.detector_presets import DETECTORS, detect_person
from benchmarks.synthetic.estimator import TREE, EstimatorErrors, estimate
from benchmarks.synthetic.frame_sampling import base_frames, sample_frames
from benchmarks.synthetic.trials import align_trials, correspondence
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_12
from imocap_core.metrics.position import mpjpe_mm, pa_mpjpe_mm
from imocap_core.synthetic.detector import with_offsets
from tools.calibrate_estimator import TARGET_MM, camera_clips, errors_mm

DATA = Path(os.environ.get("IMOCAP_DATA", Path(__file__).parents[3] / "shared" / "data"))
SIZE = (1000, 1000)


def figure(frames: int = 60, seed: int = 0) -> np.ndarray:
    """A standing figure (T, 14, 3), z up, facing -y, whose limbs sway; metres."""
    half = {"ankle": 0.1, "knee": 0.1, "hip": 0.1, "wrist": 0.3, "elbow": 0.25, "shoulder": 0.18}
    height = {"ankle": 0.1, "knee": 0.5, "hip": 0.9, "wrist": 0.9, "elbow": 1.15, "shoulder": 1.4}
    joints = np.zeros((frames, 14, 3))
    for name in EVAL_12:
        side, part = name.split("_")
        joints[:, JOINT_INDEX[name], 0] = half[part] * (1 if side == "left" else -1)
        joints[:, JOINT_INDEX[name], 2] = height[part]
    joints[:, JOINT_INDEX["neck"], 2], joints[:, JOINT_INDEX["head"], 2] = 1.45, 1.6
    sway = np.random.default_rng(seed).normal(0, 0.1, (1, 14, 3))
    moment = np.linspace(0, 1, frames)[:, None, None]
    return joints + sway * np.sin(3 * moment + moment**2) * (joints[..., 2:] < 1.3)


def before_a_camera(frames: int) -> np.ndarray:
    """The figure upright in camera axes (y down, z forward), four metres away."""
    return figure(frames) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]]) + [0.0, 1.0, 4.0]


# --- samplings


def test_the_base_video_holds_150_frames_at_equal_intervals():
    frames = sample_frames("paper", 2000, 0, np.random.default_rng(0))
    assert len(frames) == 150
    assert (frames[0], frames[-1]) == (0, 1999)
    assert set(np.diff(frames)) == {13, 14}


@pytest.mark.parametrize(("name", "low", "high"), [("released", 296, 297), ("paper", 390, 580)])
def test_other_videos_hold_as_many_frames_as_the_protocol_says(name: str, low: int, high: int):
    for seed in range(20):
        frames = sample_frames(name, 2000, 1, np.random.default_rng(seed))
        assert low <= len(frames) <= high
        assert (np.diff(frames) >= 0).all()
        assert (np.diff(frames) == 0).sum() == (6 if name == "released" else 0)
        assert set(base_frames(2000)) <= set(frames)


def test_released_films_six_segments_without_gaps_and_forty_with_one_frame():
    base = base_frames(2000)
    listed = sample_frames("released", 2000, 1, np.random.default_rng(3))
    frames = np.unique(listed)
    twice = listed[1:][np.diff(listed) == 0]
    assert set(twice) <= set(base)
    assert np.diff(np.searchsorted(base, twice)).tolist() == [1] * 5
    extra = np.histogram(frames, np.append(base[:-1], 2000))[0][:-1] - 1
    whole = extra == (np.diff(base) - 1)[: len(extra)]
    assert whole.sum() in (5, 6)  # the last bin holds two segments
    assert (extra == 1).sum() >= 38


def test_a_sampling_is_a_function_of_its_seed():
    a, b = (sample_frames("paper", 2000, 1, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, sample_frames("paper", 2000, 1, np.random.default_rng(6)))


def test_a_short_clip_and_an_unknown_name_are_refused():
    with pytest.raises(ValueError, match="at least 300 frames, got 299"):
        base_frames(299)
    with pytest.raises(ValueError, match="expected one of released, paper, got 'x'"):
        sample_frames("x", 2000, 1, np.random.default_rng(0))


# --- what cameras and detectors see


def test_in_the_scene_the_performer_faces_the_front_with_the_feet_on_the_floor():
    turned = figure() @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) + [3.0, -2.0, 5.0]
    turn, shift = to_scene(turned)
    placed = turn.apply(turned.reshape(-1, 3)).reshape(turned.shape) + shift
    across = (placed[:, JOINT_INDEX["left_hip"]] - placed[:, JOINT_INDEX["right_hip"]]).mean(0)
    assert across[0] > 0.1
    assert abs(across[1]) < 0.05
    assert placed[:, JOINT_INDEX["left_ankle"], 2].min() == pytest.approx(0.08, abs=0.1)
    assert np.median(hip_middle(placed), axis=0)[:2] == pytest.approx([0, 0], abs=1e-9)


def test_four_cameras_see_everything_from_four_sides():
    wide = figure() + np.linspace([-3, 0, 0], [3, 2, 0], 60)[:, None]
    centres = []
    for view in CAMERA_PLACEMENTS:
        K, R, t = place_camera(view, wide, SIZE)
        share = project(wide, K, R, t) / SIZE
        assert share.min() > 0.05
        assert share.max() < 0.95
        centres.append(-R.T @ t)
    sides = np.unwrap([np.arctan2(c[1], c[0]) for c in centres])
    assert np.abs(np.diff(sides)).min() > np.deg2rad(60)


def test_detected_hips_stand_out_and_faces_stay_unseen():
    points = coco18_points(figure())
    present = np.isfinite(points).all((0, 2))
    names = {n for n, s in zip(COCO18, present, strict=True) if not s}
    assert names == {"nose", "right_eye", "left_eye", "right_ear", "left_ear"}
    wide = points[0, COCO18.index("left_hip")] - points[0, COCO18.index("right_hip")]
    assert np.linalg.norm(wide) == pytest.approx(1.24 * 0.2, rel=0.01)


def test_stature_is_near_the_height_of_the_figure():
    assert 1.6 < stature_m(figure()) < 1.95


@pytest.mark.parametrize(
    ("detector", "noise_px", "missing"), [("fine_tuned", 4, 0.02), ("generic", 8, 0.05)]
)
def test_a_detector_has_the_errors_that_the_benchmarks_state(
    detector: str, noise_px: float, missing: float
):
    truth = np.tile(np.random.default_rng(0).uniform(100, 900, (1, 18, 2)), (3000, 1, 1))
    truth[:, 0] = np.nan
    height = np.full(3000, 600.0)
    detections = detect_person(truth, height, 30.0, detector, np.random.default_rng(1))
    assert (detections.confidence[:, 0] == 0).all()
    detected = detections.confidence[:, 1:] > 0
    assert (~detected).mean() == pytest.approx(missing, rel=0.15)
    error = (detections.xy_px - truth)[:, 1:][detected]
    typical = np.median(np.abs(error)) / 0.6745
    assert typical == pytest.approx(noise_px, rel=0.2)
    far = (np.linalg.norm(error, axis=-1) > 6 * noise_px).mean()
    assert 0 < far < DETECTORS[detector].outlier_rate + DETECTORS[detector].swap_rate


def test_the_measured_detector_has_the_measured_errors():
    """MediaPipe on rendered films of training clips: half of all points within 1.7 hundredths of
    the height, nine in ten within 4.6."""
    rng = np.random.default_rng(0)
    truth = 300 + 300 * rng.uniform(size=(1, 18, 2)) + np.zeros((200, 1, 1))
    height, limbs = np.full(200, 600.0), [k for k, n in enumerate(COCO18) if "_" in n]
    limbs = [k for k in limbs if "eye" not in COCO18[k] and "ear" not in COCO18[k]]
    detections = [detect_person(truth, height, 30.0, "mediapipe", np.random.default_rng(n))
             for n in range(20)]  # fmt: skip
    bare = with_offsets(truth, COCO18, DETECTORS["mediapipe"].by_kind)
    off = np.stack([np.linalg.norm(d.xy_px - bare, axis=-1)[:, limbs] / 600 for d in detections])
    detected = np.stack([d.confidence[:, limbs] > 0 for d in detections])
    assert np.median(off[detected]) == pytest.approx(0.014, rel=0.15)
    assert 0.03 < np.quantile(off[detected], 0.9) < 0.05
    typical_place = np.median(np.stack([d.xy_px for d in detections])[..., limbs, :], axis=(0, 1))
    assert typical_place == pytest.approx(
        bare[0][limbs], abs=4.0
    )  # each marks joints at its own places
    assert np.abs(typical_place - truth[0][limbs]).max() > 10


# --- the estimator


def test_the_estimator_keeps_bones_and_the_origin():
    true = before_a_camera(200)
    estimated = estimate(true, 30.0, np.random.default_rng(0))
    assert hip_middle(estimated) == pytest.approx(np.zeros((200, 3)), abs=1e-9)
    for child, parent in TREE[3:]:
        bones = [
            np.linalg.norm(x[:, JOINT_INDEX[child]] - x[:, JOINT_INDEX[parent]], axis=-1)
            for x in (estimated, true)
        ]
        assert bones[0] == pytest.approx(bones[1])


def test_the_estimator_errs_in_depth_and_slowly():
    true = before_a_camera(3000)
    errors = EstimatorErrors(orientation_rad=0.0)
    estimated = estimate(true, 30.0, np.random.default_rng(0), errors)
    error = estimated - (true - hip_middle(true)[:, None])
    spread = error.std((0, 1))
    assert spread[2] > 1.4 * spread[0]
    step = np.linalg.norm(np.diff(error, axis=0), axis=-1).mean()
    assert step < 0.4 * np.linalg.norm(error, axis=-1).mean()


def test_orientation_drift_costs_mpjpe_and_not_p_mpjpe():
    true = before_a_camera(3000)
    errors = EstimatorErrors(joint_m=0.0, orientation_rad=0.2)
    estimated = estimate(true, 30.0, np.random.default_rng(0), errors)
    relative = true - hip_middle(true)[:, None]
    assert mpjpe_mm(estimated, relative) > 80
    assert pa_mpjpe_mm(estimated, relative) < 1e-6


@pytest.mark.skipif(
    not (DATA / "protocol").is_dir(), reason="needs the protocol clips (IMOCAP_DATA)"
)
def test_the_estimator_errs_as_hmmr_on_the_protocol_clips():
    mpjpe, pa, scaled = errors_mm(camera_clips(DATA), EstimatorErrors(), seeds=(0,)).mean(0)
    assert mpjpe == pytest.approx(TARGET_MM[0], abs=2.0)
    assert scaled == pytest.approx(TARGET_MM[0], abs=2.0)
    assert pa == pytest.approx(TARGET_MM[1], abs=2.0)


# --- several performances


def test_a_time_warped_copy_corresponds_to_where_it_was_taken_from():
    reference = figure(80, seed=2)
    position = 79 * np.linspace(0, 1, 60) ** 1.3
    low = np.minimum(position.astype(int), 78)
    share = (position - low)[:, None, None]
    copy = (1 - share) * reference[low] + share * reference[low + 1]
    phase = correspondence(copy, reference)
    assert (np.diff(phase) > 0).all()
    assert np.abs(phase - position).mean() < 1.5


def test_trials_are_aligned_in_one_scene():
    reference = figure(60, seed=4)
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    first, second = align_trials([reference, reference @ quarter.T + [2.0, 1.0, 0.3]])
    assert np.linalg.norm(second.joints_m - first.joints_m, axis=-1).mean() < 0.02


def test_the_common_world_is_where_poses_agree_though_paths_part():
    along = np.linspace([0, 0, 0], [0, 3, 0], 60)[:, None]
    eighth = np.array([[1, -1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    pose = figure(60, seed=4)
    first, second = align_trials([pose + along, pose @ eighth.T + along])
    common = second.joints_m @ second.R_common_from_scene.T + second.t_common
    apart = [x - hip_middle(x)[:, None] for x in (common, first.joints_m, second.joints_m)]
    assert np.linalg.norm(apart[0] - apart[1], axis=-1).mean() < 0.02
    assert np.linalg.norm(apart[2] - apart[1], axis=-1).mean() > 0.05
