"""A body takes over a captured performer's limbs and trunk."""

import os
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.synthetic import retargeting
from benchmarks.synthetic.captured import (
    CAMERA_PLACEMENTS,
    COCO18,
    JOINT_INDEX,
    align_trials,
    base_frames,
    coco18_points,
    correspondence,
    hip_middle,
    place_camera,
    sample_frames,
    to_scene,
)
from benchmarks.synthetic.captured_skeleton import (
    ELEVATION_DEG,
    TWIST_DEG,
    CapturedSkeleton,
    NeutralStance,
    angles_rad,
    captured_skeleton,
    natural_arm,
    neutral_stance,
    rotations_between,
    standing_frames,
    trunk_bone_rotations,
)
from benchmarks.synthetic.simulated import DETECTORS, TREE, EstimatorErrors, detect_person, estimate
from imocap_core.body import load_free_body
from imocap_core.body.model import Shaped
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_12, SMPL_JOINTS
from imocap_core.metrics.position import mpjpe_mm, pa_mpjpe_mm
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.state import Body, MotionState
from imocap_core.rotations import exp, log
from imocap_core.synthetic.detector import with_offsets
from tools.calibrate_estimator import TARGET_MM, camera_clips, errors_mm


def test_a_shape_has_the_limbs_that_were_asked_for() -> None:
    model, betas = load_free_body(), torch.zeros(10, dtype=torch.float64)
    betas[:2] = torch.tensor([-1.0, 0.8])
    rest = model.shape(betas).joints_rest
    place = {
        name: rest[SMPL_JOINTS.index(f"left_{name}")]
        for name in (*retargeting.BONES, *retargeting.BONES.values())
    }
    lengths = {
        far: float((place[far] - place[near]).norm()) for far, near in retargeting.BONES.items()
    }
    shaped = model.shape(retargeting.shape_of_limbs(model, lengths)).joints_rest
    for far, near in retargeting.BONES.items():
        ends = [shaped[SMPL_JOINTS.index(f"left_{name}")] for name in (far, near)]
        assert abs(float((ends[0] - ends[1]).norm()) - lengths[far]) < 0.003, far


def test_a_performance_is_taken_over() -> None:
    stance, skeleton = stance_and_skeleton()
    thetas = [performed(6), performed(7)[:25]]
    clips = [captured(theta) for theta in thetas]
    betas, motions = retargeting.perform(load_free_body(), skeleton, stance, clips)
    assert np.abs(betas).max() < 0.3  # the skeleton was made of the mean body
    assert set(retargeting.limb_lengths_m(skeleton, clips)) == set(retargeting.BONES)
    for theta, motion in zip(thetas, motions, strict=True):
        assert motion.R_local.shape == (len(theta), 24, 3, 3)
        R = exp(torch.as_tensor(theta)).numpy()
        np.testing.assert_allclose(motion.R_local[:, 0], WORLD_FROM_BODY @ R[:, 0], atol=0.05)
        knee = SMPL_JOINTS.index("left_knee")
        bend = [log(torch.as_tensor(x[:, knee])).norm(dim=-1).numpy() for x in (motion.R_local, R)]
        np.testing.assert_allclose(*bend, atol=0.1)


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
    names = {n for n, xyz in zip(COCO18, points.swapaxes(0, 1), strict=True) if np.isnan(xyz).any()}
    assert names == {"nose", "right_eye", "left_eye", "right_ear", "left_ear"}
    wide = points[0, COCO18.index("left_hip")] - points[0, COCO18.index("right_hip")]
    assert np.linalg.norm(wide) == pytest.approx(1.24 * 0.2, rel=0.01)


@pytest.mark.parametrize(
    ("detector", "noise_px", "missing"), [("fine_tuned", 4, 0.02), ("generic", 8, 0.05)]
)
def test_a_detector_has_the_errors_that_the_benchmarks_state(detector, noise_px, missing):
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
    seeds = map(np.random.default_rng, range(20))
    detections = [detect_person(truth, height, 30.0, "mediapipe", rng) for rng in seeds]
    bare = with_offsets(truth, COCO18, DETECTORS["mediapipe"].by_kind)
    off = np.stack([np.linalg.norm(d.xy_px - bare, axis=-1)[:, limbs] / 600 for d in detections])
    detected = np.stack([d.confidence[:, limbs] > 0 for d in detections])
    assert np.median(off[detected]) == pytest.approx(0.014, rel=0.15)
    assert 0.03 < np.quantile(off[detected], 0.9) < 0.05
    typical_place = np.median(np.stack([d.xy_px for d in detections])[..., limbs, :], axis=(0, 1))
    assert typical_place == pytest.approx(bare[0][limbs], abs=4.0)  # joints at its own places
    assert np.abs(typical_place - truth[0][limbs]).max() > 10


# --- the estimator


def test_the_estimator_keeps_bones_and_the_origin():
    true = before_a_camera(200)
    estimated = estimate(true, 30.0, np.random.default_rng(0))
    assert hip_middle(estimated) == pytest.approx(np.zeros((200, 3)), abs=1e-9)
    for child, parent in TREE[3:]:
        ends = [JOINT_INDEX[child], JOINT_INDEX[parent]]
        bones = [np.linalg.norm(np.diff(x[:, ends], axis=1), axis=-1) for x in (estimated, true)]
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


FRAMES = 40
WORLD_FROM_BODY = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # z up from y up
PARENTS = {
    "hip": None, "abdomen": "hip", "chest": "abdomen", "neck": "chest", "head": "neck",
    "leftEye": "head", "rightEye": "head",
    **{f"{s}{part}": f"{s}{parent}" if parent[0].isupper() else parent
       for s in "lr" for part, parent in (
           ("Collar", "chest"), ("Shldr", "Collar"), ("ForeArm", "Shldr"), ("Hand", "ForeArm"),
           ("Mid1", "Hand"), ("Buttock", "hip"), ("Thigh", "Buttock"), ("Shin", "Thigh"),
           ("Foot", "Shin"), ("Foot_end", "Foot"))},
}  # fmt: skip
NAMES = list(PARENTS)
LIMBS = {"Shldr": "shoulder", "ForeArm": "elbow", "Hand": "wrist", "Mid1": "hand", "Thigh": "hip",
         "Shin": "knee", "Foot": "ankle", "Foot_end": "foot"}  # fmt: skip
# Places of a made skeleton that no body joint has: (SMPL joint they turn with, offset in metres).
ATTACHED = {
    "hip": ("pelvis", (0.0, -0.06, 0.02)), "abdomen": ("pelvis", (0.0, 0.14, 0.0)),
    "lButtock": ("pelvis", (0.09, -0.03, 0.01)), "rButtock": ("pelvis", (-0.09, -0.03, 0.01)),
    "chest": ("spine3", (0.0, -0.1, 0.0)), "neck": ("spine3", (0.0, 0.14, 0.0)),
    "lCollar": ("spine3", (0.03, 0.1, -0.02)), "rCollar": ("spine3", (-0.03, 0.1, -0.02)),
    "head": ("head", (0.0, 0.02, 0.0)), "leftEye": ("head", (0.03, 0.1, 0.08)),
    "rightEye": ("head", (-0.03, 0.1, 0.08)),
}  # fmt: skip


def performed(seed: int, size: float = 0.4) -> np.ndarray:
    """Local rotations (T, 24, 3) of a made motion: arms hang, trunk and limbs move smoothly."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, FRAMES)[:, None]
    theta = np.zeros((FRAMES, 24, 3))
    index = SMPL_JOINTS.index
    theta[:, index("left_shoulder"), 2], theta[:, index("right_shoulder"), 2] = -1.2, 1.2
    spine = size * rng.normal(size=3) * np.sin(3 * t)
    for joint, share in zip(("spine1", "spine2", "spine3"), retargeting.SPINE_SHARES, strict=True):
        theta[:, index(joint)] = spine * share
    for name in ("left_hip", "right_hip", "left_shoulder", "right_shoulder"):
        theta[:, index(name)] += size * rng.normal(size=3) * np.sin(2 * t + rng.uniform())
    for name, axis, sign in (("left_knee", 0, 1), ("right_knee", 0, 1),
                             ("left_elbow", 1, -1), ("right_elbow", 1, 1)):  # fmt: skip
        theta[:, index(name), axis] = sign * (0.1 + size * (1 + np.sin(2 * t[:, 0])))
    theta[:, 0] = size * rng.normal(size=3) * np.sin(t)
    return theta


def captured(theta: np.ndarray) -> np.ndarray:
    """Joints (T, J, 3), z up, of the made skeleton that performs a motion of the free body."""
    posed = mean_body().pose(exp(torch.as_tensor(theta)), torch.zeros(len(theta), 3).double())
    joints, R = posed.joints.numpy(), posed.R_world.numpy()
    places = []
    for name in NAMES:
        if name in ATTACHED:
            joint, offset = ATTACHED[name]
            k = SMPL_JOINTS.index(joint)
            places.append(joints[:, k] + R[:, k] @ np.array(offset))
        else:
            side = {"l": "left", "r": "right"}[name[0]]
            places.append(joints[:, SMPL_JOINTS.index(f"{side}_{LIMBS[name[1:]]}")])
    return np.stack(places, 1) @ WORLD_FROM_BODY.T


def mean_body() -> Shaped:
    return load_free_body().shape(torch.zeros(10, dtype=torch.float64))


def stance_and_skeleton() -> tuple[NeutralStance, CapturedSkeleton]:
    skeleton = captured_skeleton(
        NAMES, [-1 if p is None else NAMES.index(p) for p in PARENTS.values()]
    )
    return neutral_stance(skeleton, [captured(np.zeros((5, 24, 3)))]), skeleton


def retargeted(xyz: np.ndarray) -> MotionState:
    """The motion of the mean body that was fitted to captured joints."""
    stance, skeleton = stance_and_skeleton()
    wanted = retargeting.trunk_and_joints(mean_body(), skeleton, stance, xyz)
    body, betas = Body.of(load_free_body(), "smpl24"), torch.zeros(10, dtype=torch.float64)
    return retargeting.fit_to_trunk_and_joints(body, [wanted], betas)


def test_the_trunk_turns_as_the_captured_one() -> None:
    stance, skeleton = stance_and_skeleton()
    theta = performed(3)
    result = retargeting.trunk_and_joints(mean_body(), skeleton, stance, captured(theta))
    R_true = exp(torch.as_tensor(theta)).numpy()
    np.testing.assert_allclose(result.R_local[:, 0], WORLD_FROM_BODY @ R_true[:, 0], atol=1e-6)
    spine = [SMPL_JOINTS.index(f"spine{k}") for k in (1, 2, 3)]
    bends = [reduce(np.matmul, (R[:, k] for k in spine)) for R in (result.R_local, R_true)]
    np.testing.assert_allclose(*bends, atol=1e-6)
    bent = log(torch.as_tensor(result.R_local[:, spine])).norm(dim=-1).numpy()
    assert (bent < 0.6 * bent.sum(1, keepdims=True) + 1e-9).all()  # the bend is shared
    assert bent.sum(1).max() > 0.2


@pytest.mark.parametrize("seed", [4, 7])
def test_limbs_point_where_the_captured_ones_do(seed: int) -> None:
    xyz = captured(performed(seed))
    state = retargeted(xyz)
    joints = mean_body().pose(state.R_local[0], state.trans[0]).joints.numpy()
    for side, c in (("left", "l"), ("right", "r")):
        for near, far, a, b in (("hip", "knee", "Thigh", "Shin"), ("knee", "ankle", "Shin", "Foot"),
                                ("shoulder", "elbow", "Shldr", "ForeArm")):  # fmt: skip
            ends = [SMPL_JOINTS.index(f"{side}_{name}") for name in (near, far)]
            ours = np.diff(joints[:, ends], axis=1)[:, 0]
            theirs = xyz[:, NAMES.index(c + b)] - xyz[:, NAMES.index(c + a)]
            cosine = (ours * theirs).sum(1) / np.linalg.norm(ours, axis=1)
            angle = np.degrees(np.arccos(np.clip(cosine / np.linalg.norm(theirs, axis=1), -1, 1)))
            assert angle.mean() < 4.5, (side, far)
    hips = [SMPL_JOINTS.index(f"{side}_hip") for side in ("left", "right")]
    middle = xyz[:, [NAMES.index("lThigh"), NAMES.index("rThigh")]].mean(1)
    np.testing.assert_allclose(joints[:, hips].mean(1), middle, atol=0.02)


def test_a_bent_elbow_turns_the_upper_arm_and_bends_about_its_hinge() -> None:
    theta = np.zeros((FRAMES, 24, 3))
    arm, elbow = (SMPL_JOINTS.index(f"left_{name}") for name in ("shoulder", "elbow"))
    turned = exp(torch.tensor([[0.0, 0.0, -0.4], [-0.9, 0.0, 0.0]], dtype=torch.float64))
    theta[:, arm] = log(turned[0] @ turned[1]).numpy()
    theta[:, elbow, 1] = -1.2
    fitted = retargeted(captured(theta)).axis_angle[0, FRAMES // 2].numpy()
    assert abs(fitted[elbow, 2]) < 0.15  # sideways
    np.testing.assert_allclose(fitted[elbow, 1], -1.2, atol=0.15)
    np.testing.assert_allclose(fitted[arm], theta[0, arm], atol=0.2)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_straight_arm_turns_as_bent_ones_of_its_elevation(side: float) -> None:
    elevation = np.radians(ELEVATION_DEG)
    direction = np.stack([side * np.cos(elevation), np.sin(elevation), 0 * elevation], 1)
    R = natural_arm(np.array([side * 0.25, 0.0, 0.0]), direction)
    np.testing.assert_allclose(R @ [side, 0.0, 0.0], direction, atol=1e-9)
    untwisted = exp(torch.as_tensor(side * elevation[:, None] * [0.0, 0.0, 1.0])).numpy()
    twist = log(torch.as_tensor(untwisted.swapaxes(1, 2) @ R)).numpy()[:, 0]
    np.testing.assert_allclose(np.degrees(twist), TWIST_DEG, atol=1e-6)


def test_a_straightened_forearm_takes_its_hand_along() -> None:
    skeleton = stance_and_skeleton()[1]
    xyz = captured(np.zeros((5, 24, 3)))
    for side, sign in (("l", 1.0), ("r", -1.0)):  # elbows behind straight arms look bent
        xyz[:, NAMES.index(f"{side}ForeArm")] += [0.0, 0.04, 0.02 * sign]
    stance = neutral_stance(skeleton, [xyz])
    assert stance.bend_rad["wrist"] > 0.2
    wanted = retargeting.trunk_and_joints(mean_body(), skeleton, stance, xyz).joints
    for side in ("left", "right"):
        elbow, wrist, hand = (SMPL_JOINTS.index(f"{side}_{n}") for n in ("elbow", "wrist", "hand"))
        forearm, palm = wanted[:, wrist] - wanted[:, elbow], wanted[:, hand] - wanted[:, wrist]
        at_rest = -np.diff(mean_body().joints_rest.numpy()[[hand, wrist, elbow]], axis=0)
        expected = np.full(len(xyz), angles_rad(*at_rest))
        np.testing.assert_allclose(angles_rad(forearm, palm), expected, atol=0.02)


def test_turning_the_world_turns_the_root_alone() -> None:
    stance, skeleton = stance_and_skeleton()
    xyz = captured(performed(5))
    turn = exp(torch.tensor([0.0, 0.0, 1.1], dtype=torch.float64)).numpy()
    given, both = (mean_body(), skeleton, stance), (xyz, xyz @ turn.T)
    straight, turned = (retargeting.trunk_and_joints(*given, x) for x in both)
    np.testing.assert_allclose(turned.R_local[:, 1:], straight.R_local[:, 1:], atol=1e-6)
    np.testing.assert_allclose(turned.R_local[:, 0], turn @ straight.R_local[:, 0], atol=1e-6)
    np.testing.assert_allclose(turned.joints, straight.joints @ turn.T, atol=1e-6)


def test_rotations_between_vectors_are_recovered() -> None:
    rng = np.random.default_rng(0)
    template = rng.normal(size=(4, 3))
    R = exp(torch.as_tensor(rng.normal(size=(6, 3)))).numpy()
    observed = np.einsum("tij,cj->tci", R, template)
    np.testing.assert_allclose(rotations_between(template, observed), R, atol=1e-9)


def test_neck_and_collars_point_where_the_captured_bones_do() -> None:
    stance, skeleton = stance_and_skeleton()
    xyz = captured(performed(6))
    rotations = trunk_bone_rotations(skeleton, stance, xyz)
    for R, (name, template) in zip(rotations, stance.trunk_bones.items(), strict=True):
        np.testing.assert_allclose(R @ template, skeleton.trunk_bone(xyz, name), atol=1e-9)
        np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-9)
    standing = captured(np.zeros((3, 24, 3)))
    for R in trunk_bone_rotations(skeleton, stance, standing):
        np.testing.assert_allclose(R, np.tile(WORLD_FROM_BODY, (3, 1, 1)), atol=0.01)


def test_who_never_stands_has_no_stance() -> None:
    _, skeleton = stance_and_skeleton()
    lying = captured(np.zeros((5, 24, 3))) @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert not standing_frames(skeleton, lying).any()
    with pytest.raises(ValueError, match="standing upright"):
        neutral_stance(skeleton, [lying])
    with pytest.raises(ValueError, match="CMU's or OptiTrack's"):
        captured_skeleton(["a", "b"], [-1, 0])


def test_the_shipped_prior_stands_upright_with_straight_wrists() -> None:
    """No component folds the trunk to reach captured joint centres, and on average nobody bends the
    wrists sideways (about y, palms down) by more than they can."""
    prior = load_pose_prior()
    share = (prior.weight / prior.weight.sum()).numpy()
    bent = np.degrees(prior.mean.reshape(-1, 23, 3).numpy())
    for name, limit in (("spine1", 12), ("spine2", 12), ("spine3", 12), ("left_collar", 10)):
        assert share @ np.linalg.norm(bent[:, SMPL_JOINTS.index(name) - 1], axis=-1) < limit
    for side in ("left", "right"):
        assert abs(share @ bent[:, SMPL_JOINTS.index(f"{side}_wrist") - 1, 1]) < 15
