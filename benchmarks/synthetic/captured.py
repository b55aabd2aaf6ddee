"""The paper's simulation of unsynchronised videos: each video samples other frames of one motion.

The first 2000 frames are sampled at 150 equal intervals (segments lie between these anchors). The
first video has only these frames; every other video has further frames inside 50 of the segments.
`paper` follows the caption (any number of frames of each segment), `released` the counts of the
published lists: the fully sampled region (80 or 81 frames) lists its six anchors twice, which makes
296 or 297 frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imocap_core.camera.projection import intrinsics, project
from imocap_core.conventions import EVAL_14
from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.synthetic.cameras import CameraPlacement, look_at

BASE = 150
CHOSEN = 50
WHOLE_REACH = 3  # segments on each side of the anchor around which all frames are sampled
THIRDS, SIXTHS = 4, 5  # segments of which a third and a sixth of the frames are sampled
SAMPLINGS = ("released", "paper")


def base_frames(length: int) -> Int64[np.ndarray, "150"]:
    """150 frames at equal intervals over a clip, first and last included."""
    if length < 2 * BASE:
        raise ValueError(f"expected a clip of at least {2 * BASE} frames, got {length}")
    return np.linspace(0, length - 1, BASE).round().astype(np.int64)


def sample_frames(
    name: str, length: int, video: int, rng: np.random.Generator
) -> Int64[np.ndarray, " T"]:
    """Source frames of a video in order; video 0 has only the 150 base frames.

    name: a sampling. length: frames of the clip. `released` lists the anchors of its fully sampled
    region twice: no other counting gives the 296 or 297 frames of the published lists (distinct,
    they would be 290 or 291).
    """
    if name not in SAMPLINGS:
        raise ValueError(f"sampling: expected one of {', '.join(SAMPLINGS)}, got {name!r}")
    base = base_frames(length)
    if video == 0:
        return base
    draw = _released if name == "released" else _paper
    return np.sort(np.concatenate([base, *draw(base, rng)])).astype(np.int64)


def _paper(base: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    chosen = rng.choice(BASE - 1, CHOSEN, replace=False).tolist()
    return [_some(base, s, int(rng.integers(1, len(_inside(base, s)) + 1)), rng) for s in chosen]


def _released(base: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    whole = int(rng.integers(WHOLE_REACH, BASE - 1 - WHOLE_REACH))
    near = range(whole - WHOLE_REACH, whole + WHOLE_REACH)
    rest = rng.choice([s for s in range(BASE - 1) if s not in near], CHOSEN - 1, replace=False)
    frames = [np.arange(base[near.start], base[near.stop])]  # including its anchors
    for rank, segment in enumerate(rest.tolist()):
        length = int(base[segment + 1] - base[segment])
        part = 3 if rank < THIRDS else 6 if rank < THIRDS + SIXTHS else length
        frames.append(_some(base, segment, length // part, rng))
    return frames


def _inside(base: np.ndarray, segment: int) -> Int64[np.ndarray, " N"]:
    return np.arange(base[segment] + 1, base[segment + 1])


def _some(
    base: np.ndarray, segment: int, count: int, rng: np.random.Generator
) -> Int64[np.ndarray, " N"]:
    return rng.choice(_inside(base, segment), count, replace=False)


# Motion-capture skeletons as inputs of a simulated detector and camera.
#
# The 14 joints that all captured skeletons share (EVAL_14) give the keypoints of a 2D detector. The
# keypoints of face and feet, which captured skeletons define differently, are missing.

JOINT_INDEX = {name: index for index, name in enumerate(EVAL_14)}
COCO18 = (
    *("nose", "neck", "right_shoulder", "right_elbow", "right_wrist"),
    *("left_shoulder", "left_elbow", "left_wrist", "right_hip", "right_knee", "right_ankle"),
    *("left_hip", "left_knee", "left_ankle", "right_eye", "left_eye", "right_ear", "left_ear"),
)
HIP_OUTWARD = 0.12  # of the hips' distance: detected hips lie further out (body/data/layouts.toml)
ANKLE_TO_FLOOR_AND_HEAD_TO_CROWN_M = 0.28
MARGIN = 0.06  # of the picture, free on each side of the performer
STEP_BACK = 1.05

# Four sides; focal lengths (over the picture's width) around what the pipeline assumes.
CAMERA_PLACEMENTS: tuple[CameraPlacement, ...] = (
    CameraPlacement(35.0, 4.0, 1.4, 1.0),
    CameraPlacement(125.0, 4.0, 1.0, 0.85),
    CameraPlacement(215.0, 4.0, 1.8, 1.15),
    CameraPlacement(305.0, 4.0, 1.2, 1.05),
)
# Between them, for actions of more videos.
FURTHER_PLACEMENTS: tuple[CameraPlacement, ...] = (
    CameraPlacement(80.0, 4.0, 1.5, 0.9),
    CameraPlacement(260.0, 4.0, 1.1, 1.1),
    CameraPlacement(350.0, 4.0, 1.7, 0.95),
    CameraPlacement(170.0, 4.0, 1.3, 1.0),
    CameraPlacement(55.0, 4.0, 2.0, 1.1),
    CameraPlacement(235.0, 4.0, 1.0, 0.9),
    CameraPlacement(325.0, 4.0, 1.4, 1.15),
    CameraPlacement(145.0, 4.0, 1.6, 0.85),
)


def hip_middle(joints_m: Float[np.ndarray, "... 14 3"]) -> Float[np.ndarray, "... 3"]:
    """Midpoint of the hips."""
    return joints_m[..., [JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]], :].mean(axis=-2)


def coco18_points(joints_m: Float[np.ndarray, "... 14 3"]) -> Float[np.ndarray, "... 18 3"]:
    """COCO's 18 keypoints in space, from captured joints; NaN for the face."""
    points = np.full((*joints_m.shape[:-2], len(COCO18), 3), np.nan)
    for k, name in enumerate(COCO18):
        if name in JOINT_INDEX:
            points[..., k, :] = joints_m[..., JOINT_INDEX[name], :]
    left, right = (
        joints_m[..., JOINT_INDEX["left_hip"], :],
        joints_m[..., JOINT_INDEX["right_hip"], :],
    )
    points[..., COCO18.index("left_hip"), :] = left + HIP_OUTWARD * (left - right)
    points[..., COCO18.index("right_hip"), :] = right + HIP_OUTWARD * (right - left)
    shoulders = joints_m[..., [JOINT_INDEX["left_shoulder"], JOINT_INDEX["right_shoulder"]], :]
    points[..., COCO18.index("neck"), :] = shoulders.mean(axis=-2)
    return points


def stature_m(joints_m: Float[np.ndarray, "T 14 3"]) -> float:
    """Standing height of a performer: the bones from ankle to head, and the parts beyond them."""
    chain = [joints_m[:, JOINT_INDEX[f"left_{name}"]] for name in ("ankle", "knee", "hip")]
    chain += [
        hip_middle(joints_m),
        joints_m[:, JOINT_INDEX["neck"]],
        joints_m[:, JOINT_INDEX["head"]],
    ]
    bones = [np.linalg.norm(b - a, axis=-1) for a, b in pairwise(chain)]
    del bones[2]  # from the left hip to the middle of the hips is horizontal
    return float(np.median(np.sum(bones, axis=0))) + ANKLE_TO_FLOOR_AND_HEAD_TO_CROWN_M


def to_scene(joints_m: Float[np.ndarray, "T 14 3"]) -> tuple[Rotation, Float[np.ndarray, "3"]]:
    """Rotation about z and translation of a motion (z up) into the scene.

    In the scene the path is centred on the origin, the feet are on the floor, and the performer
    faces -y at first.
    """
    across = (joints_m[:, JOINT_INDEX["left_hip"]] - joints_m[:, JOINT_INDEX["right_hip"]])[
        : max(1, len(joints_m) // 4)
    ]
    x, y = across.mean(axis=0)[:2]
    turn = Rotation.from_rotvec([0.0, 0.0, -np.arctan2(y, x)])
    placed = turn.apply(joints_m.reshape(-1, 3)).reshape(joints_m.shape)
    middle = np.median(hip_middle(placed), axis=0)
    floor = np.quantile(placed[:, [JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]], 2], 0.05)
    return turn, -np.array([middle[0], middle[1], floor - 0.08])


def place_camera(
    view: CameraPlacement, points_m: Float[np.ndarray, "T J 3"], size: tuple[int, int]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """K, R_cam_from_world and t of a static camera, moved back until all points are in view."""
    K = intrinsics(view.focal_per_width * max(size), size)
    azimuth = np.deg2rad(view.azimuth_deg)
    outward = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    target = np.array([*np.median(points_m[..., :2].reshape(-1, 2), axis=0), view.aim_height_m])
    flat = points_m.reshape(-1, 3)
    distance = view.distance_m
    while True:
        centre = target * (1, 1, 0) + distance * outward + (0, 0, view.height_m)
        R = look_at(centre, target, view.roll_deg, np.zeros(2))
        t = -R @ centre
        if ((flat @ R.T + t)[:, 2] > 0.5).all():
            share = project(flat, K, R, t) / np.array(size)
            if share.min() > MARGIN and share.max() < 1 - MARGIN:
                return K, R, t
        distance *= STEP_BACK


# Captured trials of one action: their correspondence in time, and alignment in one scene.
#
# Different performances have no measured correspondence in time; here it is defined by dynamic time
# warping of their true joints, so that synchronisation errors can be measured on them.

SMOOTH_FRAMES = 2.0  # smoothing of the path, for sub-frame positions
SKIP_SHARE = 1.0  # of the mean distance: cost of a frame before or after the common part
LEAST_RATE = 0.05  # of phase: strictly increasing


@dataclass(frozen=True)
class AlignedTrial:
    """A trial in the scene (z up), and its phase in frames of the first trial.

    R_scene_from_capture, t_scene: where the capture's axes lie in the scene.
    R_common_from_scene, t_common: the transform that aligns poses (not paths) best with the first
    trial's. A performer may face elsewhere on the same path, and cameras are evaluated relative to
    the body.
    """

    joints_m: Float[np.ndarray, "T 14 3"]
    phase: Float[np.ndarray, " T"]
    R_scene_from_capture: Float[np.ndarray, "3 3"]
    t_scene: Float[np.ndarray, "3"]
    R_common_from_scene: Float[np.ndarray, "3 3"]
    t_common: Float[np.ndarray, "3"]


def align_trials(trials: Sequence[Float[np.ndarray, "_ 14 3"]]) -> list[AlignedTrial]:
    """Trials (z up) in one scene: the first by `to_scene`, the others aligned with it by a rotation
    about z and a translation, least squares over corresponding frames."""
    turn, shift = to_scene(trials[0])
    first = turn.apply(trials[0].reshape(-1, 3)).reshape(trials[0].shape) + shift
    phase = np.arange(len(first), dtype=np.float64)
    aligned = [AlignedTrial(first, phase, turn.as_matrix(), shift, np.eye(3), np.zeros(3))]
    for trial in trials[1:]:
        phase = correspondence(trial, first)
        inside, target = _matched(first, phase)
        turn, shift = _alignment(trial[inside], target)
        placed = turn.apply(trial.reshape(-1, 3)).reshape(trial.shape) + shift
        path, target_path = hip_middle(placed[inside]), hip_middle(target)
        facing, _ = _alignment(placed[inside] - path[:, None], target - target_path[:, None])
        t_common = target_path.mean(axis=0) - facing.apply(path.mean(axis=0))
        place = (turn.as_matrix(), shift, facing.as_matrix(), t_common)
        aligned.append(AlignedTrial(placed, phase, *place))
    return aligned


def correspondence(
    joints_m: Float[np.ndarray, "T 14 3"], reference_m: Float[np.ndarray, "U 14 3"]
) -> Float[np.ndarray, " T"]:
    """Increasing position of each frame in the reference; extrapolated beyond its ends.

    Dynamic time warping with open ends, by the mean joint distance after rigid alignment.
    """
    cost = _distances(joints_m, reference_m)
    path, _ = dtw(cost, skip=SKIP_SHARE * float(cost.mean()))
    position = positions_of_rows(path, len(joints_m))
    matched = np.flatnonzero(np.isfinite(position))
    every = np.arange(len(position), dtype=np.float64)
    position = np.interp(every, matched, position[matched])
    position += np.minimum(every - matched[0], 0) + np.maximum(every - matched[-1], 0)
    ramp = LEAST_RATE * every
    smooth = gaussian_filter1d(position - every, SMOOTH_FRAMES, mode="nearest") + every
    return np.maximum.accumulate(smooth - ramp) + ramp


def _distances(
    a: Float[np.ndarray, "T 14 3"], b: Float[np.ndarray, "U 14 3"]
) -> Float[np.ndarray, "T U"]:
    """Mean distance of joints after the best rotation about the middle of the hips."""
    a, b = (x - hip_middle(x)[:, None] for x in (a, b))
    distance = np.empty((len(a), len(b)))
    for row, pose in zip(distance, a, strict=True):
        U, _, Vt = np.linalg.svd(np.einsum("nji,jk->nik", b, pose))
        sign = np.sign(np.linalg.det(U @ Vt))
        U[..., -1] *= sign[:, None]
        turned = np.einsum("nij,kj->nki", U @ Vt, pose)
        row[:] = np.linalg.norm(turned - b, axis=-1).mean(axis=-1)
    return distance


def _matched(
    reference_m: Float[np.ndarray, "U 14 3"], phase: Float[np.ndarray, " T"]
) -> tuple[Bool[np.ndarray, " T"], Float[np.ndarray, "N 14 3"]]:
    """Which frames lie inside the reference, and the reference's interpolated joints there."""
    inside = (phase >= 0) & (phase <= len(reference_m) - 1)
    low = np.minimum(np.floor(phase[inside]).astype(int), len(reference_m) - 2)
    share = (phase[inside] - low)[:, None, None]
    return inside, (1 - share) * reference_m[low] + share * reference_m[low + 1]


def _alignment(
    source_m: Float[np.ndarray, "N 14 3"], target_m: Float[np.ndarray, "N 14 3"]
) -> tuple[Rotation, Float[np.ndarray, "3"]]:
    """Least-squares rotation about z and translation of joints onto the target's."""
    source, target = source_m.reshape(-1, 3), target_m.reshape(-1, 3)
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    sine = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
    cosine = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]).sum()
    turn = Rotation.from_rotvec([0.0, 0.0, np.arctan2(sine, cosine)])
    return turn, target.mean(axis=0) - turn.apply(source.mean(axis=0))
