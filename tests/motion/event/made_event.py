"""A walking stick figure that four cameras film at once, with known truth."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.motion.event_calibration import EventProblem
from imocap_core.motion.event_rig import CameraRig, EventVideo, bones_of

NAMES = (
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
)
JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
FRAMES, CAMERAS, SIZE_PX = 24, 4, 400.0
OFFSET = np.array([0.0, 3.4, -2.7, 1.25])


def figure(time: np.ndarray) -> np.ndarray:
    """(T, 12, 3) joints at fractional frames: limbs swing, the figure walks a circle; z is up."""
    swing = 0.6 * np.sin(0.2 * time)
    out = np.zeros((len(time), len(NAMES), 3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        place = {joint: NAMES.index(f"{side}_{joint}") for joint in JOINTS}
        upper, lower = _hanging(sign * swing), _hanging(1.5 * sign * swing)
        out[:, place["shoulder"]] = [0.0, 0.18 * sign, 1.4]
        out[:, place["elbow"]] = out[:, place["shoulder"]] + 0.3 * upper * [-1, 1, 1]
        out[:, place["wrist"]] = out[:, place["elbow"]] + 0.25 * lower * [-1, 1, 1]
        out[:, place["hip"]] = [0.0, 0.1 * sign, 0.9]
        out[:, place["knee"]] = out[:, place["hip"]] + 0.42 * upper
        out[:, place["ankle"]] = out[:, place["knee"]] + 0.4 * lower
    turn = Rotation.from_euler("z", 0.08 * time[:, None]).as_matrix()
    path = np.stack([np.cos(0.05 * time), np.sin(0.05 * time), 0 * time], axis=1)
    return np.asarray(out @ turn.swapaxes(1, 2) + path[:, None])


def _hanging(angle: np.ndarray) -> np.ndarray:
    """(T, 3) direction of a limb that hangs down, swung forward by an angle."""
    return np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=1)


def poses() -> tuple[np.ndarray, np.ndarray]:
    """(4, 3, 3) and (4, 3): the cameras from the figure's world."""
    R, t = [], []
    for v in range(CAMERAS):
        about = Rotation.from_euler("z", 90.0 * v + 20.0, degrees=True).as_matrix()
        centre = about @ [4.5, 0.0, 1.2 + 0.2 * v]
        ahead = np.array([0.0, 0.0, 0.9]) - centre
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        R.append(np.stack([right, np.cross(ahead, right), ahead]))
        t.append(-R[-1] @ centre)
    return np.stack(R), np.stack(t)


def in_first_camera(time: np.ndarray) -> np.ndarray:
    """The figure in the axes of the first camera, the world of a rig."""
    R, t = poses()
    return np.asarray(figure(time) @ R[0].T + t[0])


def true_rig(distortion: float = 0.0) -> CameraRig:
    """The cameras about the figure; the first one's axes are the world's."""
    R, t = poses()
    relative = R @ R[0].T
    focal = 900.0 * (1 + 0.08 * np.arange(CAMERAS))
    K = np.tile(np.array([[0, 0, 500.0], [0, 0, 500.0], [0, 0, 1]]), (CAMERAS, 1, 1))
    K[:, [0, 1], [0, 1]] = focal[:, None]
    points = in_first_camera(np.arange(FRAMES, dtype=float))
    return CameraRig(
        K, relative, t - relative @ t[0], np.full(CAMERAS, distortion), OFFSET.copy(),
        np.ones(CAMERAS), np.zeros((CAMERAS, len(NAMES), 2)), points, lengths(points),
    )  # fmt: skip


def lengths(points: np.ndarray) -> np.ndarray:
    """Median lengths of the bones."""
    a, b = bones_of(NAMES).T
    return np.median(np.linalg.norm(points[:, a] - points[:, b], axis=-1), axis=0)


def made_problem(
    truth: CameraRig, rng: np.random.Generator, noise_px: float = 0.0, bias_share: float = 0.0
) -> EventProblem:
    """Keypoints that the true rig shows, with noise and constant biases."""
    world = true_rig()
    videos = []
    for v in range(CAMERAS):
        time = np.arange(FRAMES) - truth.offset[v]
        x = in_first_camera(time) @ truth.R[v].T + truth.t[v]
        flat = x[..., :2] / x[..., 2:]
        bent = flat * (1 + truth.distortion[v] * (flat**2).sum(-1, keepdims=True))
        xy = truth.K[v, 0, 0] * bent + truth.K[v, :2, 2]
        xy = xy + SIZE_PX * bias_share * rng.standard_normal((len(NAMES), 2))
        xy = xy + noise_px * rng.standard_normal(xy.shape)
        weight = np.full(xy.shape[:2], max(noise_px, 1.0) ** -2.0)
        videos.append(EventVideo(xy, weight, np.full(FRAMES, SIZE_PX)))
    prior = replace(world, K=world.K.copy(), distortion=np.zeros(CAMERAS))
    prior.K[:, [0, 1], [0, 1]] = 1000.0
    return EventProblem(
        videos, np.arange(FRAMES, dtype=float), bones_of(NAMES), 0, np.full(CAMERAS, 0.15),
        np.zeros(CAMERAS, dtype=int), prior, np.full(CAMERAS, 5.0),
        np.zeros(CAMERAS, dtype=bool),
    )  # fmt: skip


def disturbed(truth: CameraRig, rng: np.random.Generator) -> CameraRig:
    """A start: cameras off by degrees and decimetres, focal lengths assumed, points off by cm."""
    turn = Rotation.from_rotvec(0.05 * rng.standard_normal((CAMERAS, 3))).as_matrix()
    turn[0] = np.eye(3)
    K = truth.K.copy()
    K[:, [0, 1], [0, 1]] = 1000.0
    shift = 0.1 * rng.standard_normal((CAMERAS, 3)) * (np.arange(CAMERAS) > 0)[:, None]
    return replace(
        truth, K=K, R=turn @ truth.R, t=truth.t + shift, distortion=np.zeros(CAMERAS),
        offset=truth.offset + np.array([0.0, 1.5, -1.0, 0.8]),
        points=truth.points + 0.05 * rng.standard_normal(truth.points.shape),
    )  # fmt: skip
