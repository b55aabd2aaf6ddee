"""An action's artifacts as a store holds them: two videos of one motion, at two frame rates."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from imocap_core.artifacts.schemas import (
    Artifact,
    Camera,
    CameraMotion,
    Keypoints,
    RefineSync,
    SmplBa,
    Sync,
    SyncMap,
    VideoCameraMotion,
    VideoHands,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.artifacts.store import Store
from imocap_core.body import load_free_body
from imocap_core.body.model import rotations_from_pose
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.export.formats import Exported, export
from imocap_core.library.result import Result
from imocap_core.pipeline.action import Action
from tests.made_keypoints import made_keypoints
from tests.made_sync import stored_matrix, trust_in

K = np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]])
LENGTHS = {"a": 31, "b": 21}
FPS = {"a": 30.0, "b": 20.0}
R_B = Rotation.from_euler("y", 90, degrees=True).as_matrix()
POSES = {"a": (np.eye(3), np.zeros(3)), "b": (R_B, np.array([0.0, 0.0, 4.0]))}
BETAS = np.linspace(-1, 1, 10)
# Both show one second of the same: a its whole second, b from a tenth to the end and beyond.
PHASES = {"a": np.arange(31) / 30.0, "b": 0.1 + np.arange(21) / 20.0}


def world_motion(phase_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """theta (T, 72), trans (T, 3) in the world of `a`: upright, y down; arms swing, it walks."""
    upright = Rotation.from_euler("x", 180, degrees=True)
    theta = np.zeros((len(phase_s), 24, 3))
    theta[:, 0] = upright.as_rotvec()
    theta[:, SMPL_JOINTS.index("left_shoulder"), 2] = -1.2 + 0.5 * np.sin(2 * phase_s)
    theta[:, SMPL_JOINTS.index("right_knee"), 0] = 0.4 * phase_s
    trans = np.stack([0.5 * phase_s, np.zeros(len(phase_s)), 3.0 + 0 * phase_s], axis=1)
    return theta.reshape(len(phase_s), 72), trans


def motion(video: str) -> VideoMotion:
    """What the camera of `video` saw of it."""
    theta, trans = world_motion(PHASES[video])
    R, t = POSES[video]
    root = Rotation.from_matrix(R) * Rotation.from_rotvec(theta[:, :3])
    theta = np.concatenate([root.as_rotvec(), theta[:, 3:]], axis=1)
    trans = trans @ R.T + t
    shaped = load_free_body().shape(torch.as_tensor(BETAS))
    local = rotations_from_pose(torch.as_tensor(theta))
    joints = shaped.pose(local, torch.as_tensor(trans)).joints.numpy()
    count = LENGTHS[video]
    return VideoMotion(
        id=video, frames=100 + np.arange(count), theta=theta, betas=BETAS,
        trans=joints[:, 0] - shaped.joints_rest[0].numpy(), joints=joints,
        reprojection_px=np.zeros(count),
    )  # fmt: skip


def keypoints(video: str) -> VideoKeypoints:
    return made_keypoints(100 + np.arange(LENGTHS[video]), id=video, fps=FPS[video])


def hands(video: str) -> VideoHands:
    """Hands whose wrists and fingers bend; their points lie along the body's wrists."""
    count = LENGTHS[video]
    return VideoHands(
        id=video, frames=100 + np.arange(count), fingers=np.full((count, 2, 15, 3), 0.3),
        wrists=np.full((count, 2, 3), 0.1),
        points_m=np.repeat(motion(video).joints[:, 20:22, None], 21, axis=2),
        visible=np.ones((count, 2), dtype=np.int64),
    )  # fmt: skip


def turned(video: str) -> VideoCameraMotion:
    """Camera `b` turns evenly about its own y axis, and zooms."""
    count = LENGTHS[video]
    angles = np.linspace(0, 0.5, count) if video == "b" else np.zeros(count)
    zoom = np.linspace(1.0, 1.5, count) if video == "b" else np.ones(count)
    turns = Rotation.from_rotvec(np.outer(angles, [0, 1, 0])).as_matrix()
    K_frames = np.tile(K, (count, 1, 1))
    K_frames[:, :2, :2] *= zoom[:, None, None]
    return VideoCameraMotion(
        id=video, K=K, focal_source="given", motion="rotating", note="", residual_px=0.0,
        H_first_from_frame=1.3 * K @ turns @ np.linalg.inv(K_frames), R_first_from_frame=turns,
        inliers=np.zeros(count, dtype=np.int64), zoom=zoom,
        xy_first_px=np.zeros((count, 25, 2)),
    )  # fmt: skip


def refined(phases: dict[str, np.ndarray] | None) -> RefineSync:
    body = load_free_body()
    ba = SmplBa(
        reference="a", model=body.name, model_digest=body.digest,
        videos=[motion(v) for v in LENGTHS],
        cameras=[Camera(id=v, K=K, R=R, t=t) for v, (R, t) in POSES.items()],
        objective=[1.0], misfit=1.0, status="",
    )  # fmt: skip
    trust = None if phases is None else trust_in(phases)
    count = sum(LENGTHS.values())
    sync = Sync(
        reference="a", ids=list(LENGTHS), lengths=list(LENGTHS.values()),
        maps=[
            SyncMap(id=v, reference_frame=30 * PHASES[v], confidence=np.ones(LENGTHS[v]))
            for v in LENGTHS
        ],
        method="als", centrality=np.ones(2), status="", trust=trust,
        **stored_matrix(np.zeros((count, count)), list(LENGTHS), list(LENGTHS.values())),
    )  # fmt: skip
    return RefineSync(rounds=[], best=0, sync=sync, motion=ba, status="")


@dataclass
class Made:
    """An action's store."""

    store: Store
    out: Path

    def export(self, format: str, up: str | None = None, time: str = "own") -> Exported:
        return export(self.result(), format, self.out, up, time)  # type: ignore[arg-type]

    def result(self, folder: Path = Path()) -> Result:
        return Result.of_action(self.store, Action(folder, "walk", ()))

    def publish(self, stage: str, artifact: Artifact) -> None:
        self.store.publish("walk", stage, self.store.put(stage, "k", artifact, {}, {}))


def made_result(folder: Path) -> Made:
    """A store below `folder`."""
    made = Made(Store(folder / "artifacts"), folder / "out")
    made.publish("keypoints", Keypoints(videos=[keypoints(v) for v in LENGTHS]))
    made.publish("camera_motion", CameraMotion(videos=[turned(v) for v in LENGTHS]))
    made.publish("refine_sync", refined(PHASES))
    return made
