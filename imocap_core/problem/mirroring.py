"""What the joint motion is solved on: the videos that show the action, none of them mirrored.

Videos that sync excluded are left out, and mirrored ones are reflected about the optical axis of
their camera (x -> -x in camera axes, left and right swapped), so that everything downstream sees
one action. Results go back as they were filmed: a mirrored video's motion is reflected again and
its camera stands in the mirror image of the world; an excluded video keeps its monocular motion, in
its own camera's axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from imocap_core.artifacts.schemas import (
    Camera,
    CameraMotion,
    InitialSmpl,
    Keypoints,
    SmplBa,
    SyncSummary,
    VideoCameraMotion,
    VideoKeypoints,
    VideoMotion,
)
from imocap_core.body import Model
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS, mirror_indices

REFLECTION = np.array([-1.0, 1.0, 1.0])
TWINS = list(mirror_indices(SMPL_JOINTS))


@dataclass(frozen=True)
class JointWork:
    """The inputs of the joint motion, and the way back; build it with `joint_work`."""

    keypoints: Keypoints
    camera_motion: CameraMotion
    initial: InitialSmpl
    all_initial: InitialSmpl
    all_cameras: CameraMotion
    mirrored: frozenset[str]
    excluded: frozenset[str]
    body: Model

    def sync_in(self, sync: SyncSummary) -> SyncSummary:
        """Correspondences of the videos that take part."""
        at = [k for k, i in enumerate(sync.ids) if i not in self.excluded]
        return SyncSummary(
            reference=sync.reference,
            ids=[sync.ids[k] for k in at],
            lengths=[sync.lengths[k] for k in at],
            maps=[sync.maps[k] for k in at],
            method=sync.method,
            centrality=sync.centrality[at],
            status=sync.status,
        )

    def motions_in(self, videos: Sequence[VideoMotion]) -> list[VideoMotion]:
        """Motions as filmed to those the joint motion starts from."""
        return [self._turned(v) for v in videos if v.id not in self.excluded]

    def cameras_in(self, cameras: Sequence[Camera]) -> list[Camera]:
        """A result's cameras (as filmed) in the world that the joint motion is solved in."""
        return [
            mirrored_camera(c) if c.id in self.mirrored else c
            for c in cameras
            if c.id not in self.excluded
        ]

    def out(self, found: SmplBa) -> SmplBa:
        """The joint result as filmed, of all videos."""
        if not self.mirrored and not self.excluded:
            return found
        motions = {v.id: self._turned(v) for v in found.videos}
        cameras = {c.id: mirrored_camera(c) if c.id in self.mirrored else c for c in found.cameras}
        for own, seen in zip(self.all_initial.videos, self.all_cameras.videos, strict=True):
            if own.id in self.excluded:
                motions[own.id] = own
                cameras[own.id] = Camera(id=own.id, K=seen.K, R=np.eye(3), t=np.zeros(3))
        ids = [v.id for v in self.all_initial.videos]
        return found.model_copy(
            update={"videos": [motions[i] for i in ids], "cameras": [cameras[i] for i in ids]}
        )

    def _turned(self, motion: VideoMotion) -> VideoMotion:
        return mirrored_motion(motion, self.body) if motion.id in self.mirrored else motion


def joint_work(
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    initial: InitialSmpl,
    sync: SyncSummary,
    body: Model,
) -> JointWork:
    """The joint work that a synchronisation asks for; `body` with SMPL's joints."""
    flips, out = frozenset(sync.mirrored), frozenset(sync.excluded)
    seen, cameras, motions = [], [], []
    rows = zip(keypoints.videos, camera_motion.videos, initial.videos, strict=True)
    for video, camera, motion in rows:
        if video.id in out:
            continue
        flip = video.id in flips
        seen.append(mirrored_keypoints(video, camera.K) if flip else video)
        cameras.append(mirrored_detections(camera, video.layout) if flip else camera)
        motions.append(mirrored_motion(motion, body) if flip else motion)
    return JointWork(
        keypoints=Keypoints(videos=seen),
        camera_motion=CameraMotion(videos=cameras),
        initial=initial.model_copy(update={"videos": motions}),
        all_initial=initial,
        all_cameras=camera_motion,
        mirrored=flips - out,
        excluded=out,
        body=body,
    )


def mirrored_motion(motion: VideoMotion, body: Model) -> VideoMotion:
    """The motion seen in a mirror: R -> S R S for each joint's twin, S = diag(-1, 1, 1)."""
    theta = motion.theta.reshape(-1, 24, 3)[:, TWINS] * -REFLECTION  # axes of rotation turn too
    rest = body.shape(torch.as_tensor(motion.betas)).joints_rest[..., 0, :].numpy().reshape(3)
    return motion.model_copy(
        update={
            "theta": theta.reshape(-1, 72),
            "trans": (rest + motion.trans) * REFLECTION - rest,
            "joints": motion.joints[:, TWINS] * REFLECTION,
        }
    )


def mirrored_camera(camera: Camera) -> Camera:
    """The camera that films the mirror image of the world and shows the mirror image: S R S, S t.

    K stays, as pictures are reflected about the principal point.
    """
    return camera.model_copy(
        update={
            "R": REFLECTION[:, None] * camera.R * REFLECTION,
            "t": REFLECTION * camera.t,
        }
    )


def mirrored_keypoints(video: VideoKeypoints, K: np.ndarray) -> VideoKeypoints:
    """Detections of the reflected picture, left and right swapped."""
    twins = list(mirror_indices(layout_names(video.layout)))
    box = video.person_box_px.copy()
    box[:, [0, 2]] = 2.0 * K[0, 2] - box[:, [2, 0]]
    return video.model_copy(
        update={
            "xy_px": _reflected(video.xy_px, K)[:, twins],
            "confidence": video.confidence[:, twins],
            "person_box_px": box,
        }
    )


def mirrored_detections(camera: VideoCameraMotion, layout: str) -> VideoCameraMotion:
    """A camera's warped detections, reflected; the homographies stay those of the pictures."""
    twins = list(mirror_indices(layout_names(layout)))
    xy = _reflected(camera.xy_first_px, camera.K)[:, twins]
    return camera.model_copy(update={"xy_first_px": xy})


def _reflected(xy_px: np.ndarray, K: np.ndarray) -> np.ndarray:
    return np.stack([2.0 * K[0, 2] - xy_px[..., 0], xy_px[..., 1]], axis=-1)
