"""A small made scene as artifacts: a body that waves its limbs before two or more cameras."""

from pathlib import Path

import numpy as np
import torch

from imocap_core import rotations
from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    Round,
    SmplBa,
    Sync,
    SyncMap,
    Uncertainty,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
    VideoUncertainty,
    Viewpoint,
)
from imocap_core.body import load_free_body
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.evaluate.scoreboard import body_points
from imocap_core.io.truth import model_text
from tests.made_keypoints import made_keypoints, write_openpose
from tests.made_sync import stored_matrix

SIZE = (320, 240)
K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
FPS = 30.0
LAYOUT = "body25"
FLIP = np.diag([1.0, -1.0, -1.0])  # y up to y down: the rest pose stands upright before the camera


class Made:
    """Artifacts of `count` videos of `frames` frames; video v starts 2 v frames late.

    The monocular answer bends knees and elbows by `bend_rad` too much, the final one by a fifth.
    The first synchronisation is one frame late, the final one exact.
    """

    def __init__(self, count: int = 3, frames: int = 16, bend_rad: float = 0.25) -> None:
        self.model = load_free_body()
        self.ids = [f"v{i + 1}" for i in range(count)]
        self.frames = [np.arange(2 * i, 2 * i + frames) for i in range(count)]
        self.R = [self._turned(0.7 * i) for i in range(count)]
        self.true = [self._motion(i, 0.0) for i in range(count)]
        self.bent = [self._motion(i, bend_rad) for i in range(count)]
        self.final = [self._motion(i, bend_rad / 5) for i in range(count)]
        self.keypoints = Keypoints(videos=[self._seen(i) for i in range(count)])
        self.camera_motion = CameraMotion(videos=[self._camera(i) for i in range(count)])
        digest = {"model": self.model.name, "model_digest": self.model.digest}
        self.initial = InitialSmpl(
            **digest, videos=self.bent, source=dict.fromkeys(self.ids, "monocular")
        )
        self.sync = self._sync(shift=1.0)
        single = SmplBa(
            **digest,
            reference="v1",
            videos=self.final,
            cameras=[
                Camera(id=i, K=K, R=R @ self.R[0].T, t=np.zeros(3))
                for i, R in zip(self.ids, self.R, strict=True)
            ],
            objective=[30.0, 12.0, 9.0],
            misfit=1.0,
            status="converged",
        )
        self.single = single
        self.again = Redetect(videos=[], note="made")
        after = self._sync(shift=0.0)
        rounds = [
            Round(sync=s, motion=single, cost=c, sync_change_frames=d)
            for s, c, d in ((self.sync, 12.0, 1.0), (after, 9.0, 0.1))
        ]
        self.refined = RefineSync(
            rounds=rounds, best=1, sync=after, motion=single, status="settled"
        )
        self.claimed = self._claimed(sigma_mm=20.0)

    def write_truth(self, path: Path) -> None:
        """truth.npz: the world is the first camera turned by some rotation."""
        R_world = rotations.exp(torch.tensor([0.3, -1.0, 0.2], dtype=torch.float64)).numpy()
        arrays: dict[str, np.ndarray] = {"joint_names": np.array(SMPL_JOINTS)}
        for i, name in enumerate(self.ids):
            R = self.R[i] @ R_world
            theta = self.true[i].theta.copy()
            root_cam = rotations.exp(torch.from_numpy(theta[:, :3]))
            theta[:, :3] = rotations.log(torch.from_numpy(R.T) @ root_cam).numpy()
            pelvis_rest = self.model.joints_template[0].numpy()
            arrays |= {
                f"{name}/joints": self.true[i].joints @ R,  # R^T x
                f"{name}/K": K,
                f"{name}/R": R,
                f"{name}/t": np.zeros(3),
                f"{name}/phase": self.frames[i].astype(float),
                f"{name}/theta": theta,
                f"{name}/betas": np.zeros(10),
                f"{name}/trans": (pelvis_rest + self.true[i].trans) @ R - pelvis_rest,
            }
        model = model_text(self.model.name, self.model.digest)
        np.savez(path, phase_end=float(self.frames[-1][-1]), model=model, **arrays)

    def write_openpose(self, folder: Path, v: int, frames: int | None = None) -> Path:
        """What OpenPose would write of a video, or of its first frames."""
        columns = list(self.model.points(LAYOUT).columns)
        people = np.zeros((len(self.frames[v]), 25, 3))
        people[:, columns, :2], people[:, columns, 2] = self.keypoints.videos[v].xy_px, 0.9
        return write_openpose(folder, people[:frames, None])

    def _turned(self, angle: float) -> np.ndarray:
        return rotations.exp(torch.tensor([0.0, angle, 0.0], dtype=torch.float64)).numpy()

    def _motion(self, v: int, bend_rad: float) -> VideoMotion:
        frames = self.frames[v]
        theta = np.zeros((len(frames), 24, 3))
        for joint, axis in (("left_shoulder", 2), ("right_knee", 0), ("right_shoulder", 1)):
            theta[:, SMPL_JOINTS.index(joint), axis] = 0.6 * np.sin(frames / 6)
        theta[:, [4, 5], 0] += bend_rad
        theta[:, [18, 19], 1] += bend_rad
        stand = np.full((len(frames), 1), 1.0) * np.array([np.pi, 0, 0])
        R_root = self.R[v] @ rotations.exp(torch.from_numpy(stand)).numpy()
        theta[:, 0] = rotations.log(torch.from_numpy(R_root)).numpy()
        trans = np.column_stack([0.02 * (frames - 8), 0 * frames, 0 * frames + 3.0])
        posed = self.model.shape(torch.zeros(10, dtype=torch.float64)).pose(
            rotations.exp(torch.from_numpy(theta)), torch.from_numpy(trans)
        )
        return VideoMotion(
            id=self.ids[v], frames=frames, theta=theta.reshape(-1, 72), betas=np.zeros(10),
            trans=trans, joints=posed.joints.numpy(), reprojection_px=np.zeros(len(frames)),
        )  # fmt: skip

    def _seen(self, v: int) -> VideoKeypoints:
        xyz = body_points(self.model, self.true[v], LAYOUT, K).keypoints_m
        xy = xyz @ K.T
        xy = xy[..., :2] / xy[..., 2:]
        low, high = xy.min(axis=1), xy.max(axis=1)
        return made_keypoints(
            self.frames[v],
            LAYOUT,
            id=self.ids[v], fps=FPS, size=SIZE, xy_px=xy, confidence=np.full(xy.shape[:2], 0.9),
            person_box_px=np.concatenate([low, high], axis=1),
        )  # fmt: skip

    def _camera(self, v: int) -> VideoCameraMotion:
        frames = len(self.frames[v])
        eye = np.tile(np.eye(3), (frames, 1, 1))
        return VideoCameraMotion(
            id=self.ids[v], K=K, focal_source="assumed", motion="static", note="", residual_px=0.2,
            H_first_from_frame=eye, R_first_from_frame=eye, zoom=np.ones(frames),
            inliers=np.full(frames, 80), xy_first_px=self.keypoints.videos[v].xy_px,
        )  # fmt: skip

    def _claimed(self, sigma_mm: float) -> Uncertainty:
        """Every joint is as uncertain as every other, in all directions alike."""
        videos = []
        for video, frames in zip(self.ids, self.frames, strict=True):
            all_ = np.full((len(frames), 24), sigma_mm)
            covariance = np.tile(sigma_mm**2 / 3 * np.eye(3), (len(frames), 24, 1, 1))
            videos.append(
                VideoUncertainty(
                    id=video, frames=frames, sigma_mm=all_, depth_mm=all_ / np.sqrt(3),
                    across_mm=all_ * np.sqrt(2 / 3), covariance_mm2=covariance.astype(np.float32),
                    rotation_covariance_deg2=covariance[:, :15].astype(np.float32), azimuth_deg=0.0,
                    deviation_covariance_deg2=covariance[:, :15].astype(np.float32),
                )
            )  # fmt: skip
        return Uncertainty(
            videos=videos, median_mm=sigma_mm, weak=[], near=[],
            viewpoints=[Viewpoint(azimuth_deg=a, reduction=0.3 - a / 1800) for a in (0, 90, 180)],
            azimuth_from="performer", status="made",
        )  # fmt: skip

    def _sync(self, shift: float) -> Sync:
        lengths = [len(f) for f in self.frames]
        maps = []
        for v, frames in enumerate(self.frames):
            reference_frame = frames.astype(float) + (shift if v else 0.0)
            reference_frame[reference_frame > self.frames[0][-1]] = np.nan
            maps.append(
                SyncMap(
                    id=self.ids[v],
                    reference_frame=reference_frame,
                    confidence=np.full(len(reference_frame), 0.8),
                )
            )
        phase = np.concatenate(self.frames)
        affinity = np.exp(-(((phase[:, None] - phase[None]) / 3.0) ** 2)).astype(np.float32)
        return Sync(
            reference="v1", ids=self.ids, lengths=lengths, maps=maps, method="softmap",
            centrality=np.linspace(1, 0.5, len(lengths)), status="converged",
            **stored_matrix(affinity, self.ids, lengths),
        )  # fmt: skip
