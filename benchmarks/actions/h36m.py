"""Human3.6M as VideoPose3D's preparation scripts write it: 3D joints, and 2D joints by CPN.

`data_3d_h36m.npz`: `positions_3d` {subject: {action: (T, 32 or 17, 3) metres, world, z up}}.
`data_2d_h36m_cpn_ft_h36m_dbb.npz`: `positions_2d` {subject: {action: [(T, 17, 2) pixels, one a
camera]}}. Videos may have a few more frames than the motion; both are cut to the shorter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.linalg import rq
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.actions.captured_videos import CapturedVideo, Choice, RecordedView, video_rng
from benchmarks.synthetic.captured import COCO18, HIP_OUTWARD, sample_frames
from imocap_core.camera.projection import project
from imocap_core.conventions import EVAL_12, EVAL_14
from imocap_core.errors import WorkFailed
from imocap_core.io.array_files import read_object

FILE_3D, FILE_2D = "data_3d_h36m.npz", "data_2d_h36m_cpn_ft_h36m_dbb.npz"
FPS = 50.0
SIZE = (1000, 1002)  # pixels; the cameras' pictures are 1000 x 1000 or 1000 x 1002
CAMERAS = 4
# The 17 of the 32 joints that move, by the project's names; `head` is the top of the head there.
H36M_17: tuple[str, ...] = (
    *("pelvis", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle"),
    *("spine2", "neck", "nose", "head", "left_shoulder", "left_elbow", "left_wrist"),
    *("right_shoulder", "right_elbow", "right_wrist"),
)
_OF_32 = (0, 1, 2, 3, 6, 7, 8, 12, 13, 14, 15, 17, 18, 19, 25, 26, 27)


@dataclass(frozen=True)
class Recording:
    """One subject's action: world joints (z up) and detections of the four cameras, NaN where
    missing."""

    joints_m: Float[np.ndarray, "T 17 3"]
    xy_px: Float[np.ndarray, "4 T 17 2"]


def read_h36m(folder: Path) -> dict[str, dict[str, Recording]]:
    """Subject -> action -> recording, of the actions that are in both files.

    Raises:
        ValueError: a file is missing, damaged, would run code, or has other content; the message
            names file, subject and action.
    """
    joints = _tree(folder / FILE_3D, "positions_3d")
    pixels = _tree(folder / FILE_2D, "positions_2d")
    recordings = {
        subject: {
            action: _recording(folder, f"{subject}, {action}", joints[subject][action], cameras)
            for action, cameras in actions.items()
            if action in joints[subject]
        }
        for subject, actions in pixels.items()
        if subject in joints
    }
    if not any(recordings.values()):
        raise ValueError(f"{folder}: {FILE_3D} and {FILE_2D} share no subject and action")
    return recordings


def _tree(file: Path, name: str) -> Mapping[str, Mapping[str, Any]]:
    tree = read_object(file, name)
    if not isinstance(tree, dict) or not all(isinstance(value, dict) for value in tree.values()):
        raise ValueError(f"{file}: {name}: expected subject -> action -> arrays")
    return tree


def _recording(folder: Path, where: str, joints: Any, cameras: Any) -> Recording:
    world = _numbers(folder / FILE_3D, where, joints, ((32, 3), (17, 3)))
    if not isinstance(cameras, (list, tuple)) or len(cameras) != CAMERAS:
        got = f"{len(cameras)}" if isinstance(cameras, (list, tuple)) else type(cameras).__name__
        raise ValueError(f"{folder / FILE_2D}: {where}: expected {CAMERAS} cameras, got {got}")
    views = [_numbers(folder / FILE_2D, where, view, ((17, 2),)) for view in cameras]
    length = min(len(world), *(len(view) for view in views))
    moving = world[:length, list(_OF_32)] if world.shape[1] == 32 else world[:length]
    return Recording(moving, np.stack([view[:length] for view in views]))


def _numbers(
    file: Path, where: str, value: Any, shapes: tuple[tuple[int, int], ...]
) -> Float[np.ndarray, "T J d"]:
    numeric = isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    if not numeric or value.shape[1:] not in shapes or not len(value):
        expected = " or ".join(f"(T, {a}, {b})" for a, b in shapes)
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value)
        raise ValueError(f"{file}: {where}: expected numbers {expected}, got {got}")
    return np.asarray(value, dtype=np.float64)


# Camera resection: intrinsics and pose of a camera from pairs of 3D points and their pixels.
#
# A projective camera P (3, 4) is linear in the pairs (direct linear transform; Hartley and
# Zisserman, Multiple View Geometry, 2nd ed., section 7.1). It is estimated from random samples
# (RANSAC), fitted again to its inliers, decomposed into K, R, t, and refined under a robust cost
# with square pixels and no skew. Lens distortion is not modelled.

SAMPLE = 8  # pairs per trial: 6 suffice, more make the estimate more stable
TRIALS = 300
MIN_PAIRS = 50
MIN_INLIER_SHARE = 0.5


@dataclass(frozen=True)
class Resection:
    """Intrinsics K and pose R, t (camera from world) with the reprojection error of the pairs."""

    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, "3"]
    median_px: float
    inlier_share: float
    ok: bool
    status: str


def resect(
    x_world: ArrayLike,
    xy_px: ArrayLike,
    rng: np.random.Generator,
    *,
    scale_px: float = 5.0,
    inlier_px: float = 20.0,
) -> Resection:
    """Intrinsics and pose of the camera that saw pairs of points; pairs with NaN are left out.

    Args:
        x_world: (N, 3) points in the world, metres. xy_px: (N, 2) their pixels.
        rng: of the random samples.
        scale_px: scale of the robust (Cauchy) cost. inlier_px: largest error of an inlier.

    Raises:
        ValueError: wrong shapes, or fewer than 50 pairs.
    """
    world, pixels = np.asarray(x_world, dtype=np.float64), np.asarray(xy_px, dtype=np.float64)
    if world.ndim != 2 or world.shape[1:] != (3,) or pixels.shape != (len(world), 2):
        raise ValueError(
            f"expected x_world (N, 3) and xy_px (N, 2), got {world.shape}, {pixels.shape}"
        )
    complete = np.isfinite(world).all(axis=1) & np.isfinite(pixels).all(axis=1)
    world, pixels = world[complete], pixels[complete]
    if len(world) < MIN_PAIRS:
        raise ValueError(f"x_world: expected at least {MIN_PAIRS} pairs, got {len(world)}")
    P = _best_of_samples(world, pixels, rng, inlier_px)
    near = _errors_px(P[None], world, pixels)[0] < inlier_px
    K, R, t = _split(_linear(world[near][None], pixels[near][None])[0] if near.sum() >= 6 else P)
    K, R, t = _refined(world, pixels, K, R, t, scale_px)
    error = np.linalg.norm(project(world, K, R, t) - pixels, axis=1)
    share, ahead = float((error < inlier_px).mean()), (world @ R.T + t)[:, 2] > 0
    ok = share >= MIN_INLIER_SHARE and bool(ahead.mean() > 0.99)
    status = "found" if ok else f"only {share:.0%} of the pairs agree with one camera"
    return Resection(K, R, t, float(np.median(error)), share, ok, status)


def _best_of_samples(
    world: Float[np.ndarray, "N 3"],
    pixels: Float[np.ndarray, "N 2"],
    rng: np.random.Generator,
    inlier_px: float,
) -> Float[np.ndarray, "3 4"]:
    rows = rng.integers(len(world), size=(TRIALS, SAMPLE))
    cameras = _linear(world[rows], pixels[rows])
    checked = rng.permutation(len(world))[:2000]
    errors = _errors_px(cameras, world[checked], pixels[checked])
    return cameras[int(np.minimum(errors, inlier_px).sum(axis=1).argmin())]


def _linear(
    world: Float[np.ndarray, "B N 3"], pixels: Float[np.ndarray, "B N 2"]
) -> Float[np.ndarray, "B 3 4"]:
    """P by direct linear transform of normalised pairs (mean 0, standard deviation 1)."""
    centre, middle = world.mean(1, keepdims=True), pixels.mean(1, keepdims=True)
    spread = np.maximum(np.std(world - centre, axis=(1, 2)), 1e-9)[:, None, None]
    width = np.maximum(np.std(pixels - middle, axis=(1, 2)), 1e-9)[:, None, None]
    x = np.concatenate([(world - centre) / spread, np.ones((*world.shape[:2], 1))], -1)
    u, v = np.moveaxis((pixels - middle) / width, -1, 0)
    zero = np.zeros_like(x)
    rows = np.concatenate(
        [
            np.concatenate([x, zero, -u[..., None] * x], -1),
            np.concatenate([zero, x, -v[..., None] * x], -1),
        ],
        axis=1,
    )
    _, vectors = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)
    P = vectors[..., 0].reshape(-1, 3, 4)
    to_pixels = np.zeros((len(P), 3, 3))
    to_pixels[:, [0, 1], [0, 1]] = width[:, 0]
    to_pixels[:, :2, 2], to_pixels[:, 2, 2] = middle[:, 0], 1.0
    from_world = np.zeros((len(P), 4, 4))
    from_world[:, [0, 1, 2], [0, 1, 2]] = 1 / spread[:, 0]
    from_world[:, :3, 3], from_world[:, 3, 3] = -centre[:, 0] / spread[:, 0], 1.0
    return to_pixels @ P @ from_world


def _errors_px(
    P: Float[np.ndarray, "B 3 4"], world: Float[np.ndarray, "N 3"], pixels: Float[np.ndarray, "N 2"]
) -> Float[np.ndarray, "B N"]:
    """Reprojection errors of all pairs under each of B cameras."""
    homogeneous = world @ np.swapaxes(P[:, :, :3], 1, 2) + P[:, None, :, 3]
    depth = np.where(np.abs(homogeneous[..., 2:]) > 1e-12, homogeneous[..., 2:], 1e-12)
    return np.linalg.norm(homogeneous[..., :2] / depth - pixels, axis=-1)


def _split(
    P: Float[np.ndarray, "3 4"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """P up to its scale and sign, decomposed into K with square pixels, R and t."""
    P = P * np.sign(np.linalg.det(P[:, :3]))
    upper, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(upper)))
    upper, R = upper @ signs, signs @ R
    t = np.linalg.solve(upper, P[:, 3])
    K = upper / upper[2, 2]
    focal = np.sqrt(K[0, 0] * K[1, 1])
    square = np.array([[focal, 0, K[0, 2]], [0, focal, K[1, 2]], [0, 0, 1.0]])
    return square, np.asarray(R, np.float64), np.asarray(t, np.float64)


def _refined(
    world: np.ndarray,
    pixels: np.ndarray,
    K: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    scale_px: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Focal length, principal point, rotation and translation under a Cauchy cost."""

    def camera(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        focal = np.exp(x[0])
        intrinsic = np.array([[focal, 0, x[1]], [0, focal, x[2]], [0, 0, 1.0]])
        return intrinsic, Rotation.from_rotvec(x[3:6]).as_matrix() @ R, x[6:]

    def residual(x: np.ndarray) -> np.ndarray:
        intrinsic, rotation, translation = camera(x)
        x_cam = world @ rotation.T + translation
        flat = x_cam[:, :2] / np.maximum(x_cam[:, 2:], 1e-3)
        return ((flat * intrinsic[0, 0] + intrinsic[:2, 2]) - pixels).ravel()

    start = np.array([np.log(K[0, 0]), K[0, 2], K[1, 2], 0, 0, 0, *t])
    solved = least_squares(residual, start, loss="cauchy", f_scale=scale_px, x_scale="jac")
    return camera(solved.x)


# Human3.6M in the paper's protocol: one motion, four real cameras, each video other frames of it.
#
# VideoPose3D's files hold no cameras: each subject's four are solved by resection from all of the
# subject's 3D and 2D joints (lens distortion left out). They serve scoring and the oracle; the
# stages read detections alone. The monocular estimate is the simulated one.

SUBJECTS = ("S9", "S11")
ACTIONS = ("SittingDown", "Sitting", "Smoking", "Photo", "Phoning")  # the paper's
FRAMES = 2000
PAIRS = 6000  # for a camera's resection


def h36m_files(choice: Choice) -> list[Path]:
    """The file of the 3D joints and that of the detections; WorkFailed when one is missing."""
    assert choice.data is not None, "Choice asks for it"
    missing = [f for name in (FILE_3D, FILE_2D) if not (f := choice.data / name).is_file()]
    if missing:
        raise WorkFailed(
            f"{missing[0]} does not exist; --data: expected the folder with {FILE_3D} and "
            f"{FILE_2D} as VideoPose3D's preparation scripts write them"
        )
    return [choice.data / FILE_3D, choice.data / FILE_2D]


def h36m_actions(choice: Choice) -> list[str]:
    """Subject and recording, as `S9_Photo_1`, of the paper's five actions."""
    return list(_chosen(choice))


def h36m_videos(choice: Choice, name: str) -> list[CapturedVideo]:
    """The first 2000 frames of a recording, resampled for each video."""
    subject, action = _chosen(choice)[name]
    recordings = _read(choice)[subject]
    recording = recordings[action]
    length = min(len(recording.joints_m), FRAMES)
    all_joints = recording.joints_m[:length]
    joints = all_joints[:, [H36M_17.index(j) for j in EVAL_14]]
    phase = np.arange(length, dtype=np.float64)
    videos = []
    for v in range(choice.videos):
        camera = camera_of(recordings, subject, v)
        xy_px = coco18_pixels(recording.xy_px[v, :length])
        frames = sample_frames(choice.sampling, length, v, video_rng(name, v, 0))
        view = RecordedView(camera.K, camera.R, camera.t, xy_px, SIZE)
        videos.append(
            CapturedVideo(
                joints, phase, frames, FPS,
                recorded=view, truth_joints_m=all_joints, truth_names=H36M_17,
            )
        )  # fmt: skip
    return videos


def camera_of(recordings: dict[str, Recording], subject: str, camera: int) -> Resection:
    """A camera by resection from all recordings of a subject; WorkFailed when that fails."""
    columns = [H36M_17.index(name) for name in EVAL_12]
    world = np.concatenate([r.joints_m[:, columns].reshape(-1, 3) for r in recordings.values()])
    pixels = np.concatenate(
        [r.xy_px[camera][:, columns].reshape(-1, 2) for r in recordings.values()]
    )
    rng = video_rng(subject, camera, 2)
    rows = rng.permutation(len(world))[:PAIRS]
    try:
        resection = resect(world[rows], pixels[rows], rng)
    except ValueError as error:
        raise WorkFailed(f"h36m: {subject}, camera {camera + 1}: {error}") from error
    if not resection.ok:
        raise WorkFailed(
            f"h36m: {subject}, camera {camera + 1}: {resection.status}; the 2D and the 3D file do "
            "not belong together"
        )
    return resection


def coco18_pixels(xy_px: Float[np.ndarray, "T 17 2"]) -> Float[np.ndarray, "T 18 2"]:
    """Human3.6M's 17 joints as COCO's 18: hips moved outwards to where they are marked, the neck
    between the shoulders, the face missing (NaN)."""
    pixels = {name: xy_px[:, k] for k, name in enumerate(H36M_17)}
    left, right = pixels["left_hip"], pixels["right_hip"]
    pixels["left_hip"], pixels["right_hip"] = (
        left + HIP_OUTWARD * (left - right),
        right + HIP_OUTWARD * (right - left),
    )
    pixels["neck"] = (pixels["left_shoulder"] + pixels["right_shoulder"]) / 2
    missing = np.full_like(left, np.nan)
    available = {*EVAL_12, "neck"}
    return np.stack([pixels[n] if n in available else missing for n in COCO18], axis=1)


def _chosen(choice: Choice) -> dict[str, tuple[str, str]]:
    """Name of the action -> subject and recording."""
    chosen = {
        f"{subject}_{action.replace(' ', '_')}": (subject, action)
        for subject in SUBJECTS
        for action in sorted(_read(choice).get(subject, {}))
        if action.split(" ")[0] in ACTIONS
    }
    if not chosen:
        raise WorkFailed(
            f"{choice.data}: expected subjects {', '.join(SUBJECTS)} with actions "
            f"{', '.join(ACTIONS)}, got none of them"
        )
    return chosen


def _read(choice: Choice) -> dict[str, dict[str, Recording]]:
    return _read_files(*h36m_files(choice))


@cache
def _read_files(file_3d: Path, file_2d: Path) -> dict[str, dict[str, Recording]]:
    try:
        return read_h36m(file_3d.parent)
    except ValueError as error:
        raise WorkFailed(str(error)) from error
